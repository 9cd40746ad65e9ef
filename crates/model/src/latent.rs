//! Latent functions: a library, a partition, coefficients.

/// A fitted function: in the region that a row falls in, `constant + sum_j coefficient_j * function_j(row)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Latent {
    /// Its name, by which equations speak of it.
    pub name: String,
    /// Index into the model's libraries.
    pub library: usize,
    /// Index into the model's partitions.
    pub partition: usize,
    /// Constant term, one per region.
    pub constants: Vec<f64>,
    /// Coefficients, regions x functions.
    pub coefficients: Vec<Vec<f64>>,
}
