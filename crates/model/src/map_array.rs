//! Numbers of a map for files of arrays.

use std::borrow::Cow;

/// Numbers of a map, by name, with their shape: what a file of arrays holds of it.
#[derive(Debug, Clone, PartialEq)]
pub struct MapArray {
    /// Its name within the latent: `coefficients`.
    pub name: Cow<'static, str>,
    /// The numbers, the last dimension fastest.
    pub values: Vec<f64>,
    /// Lengths of the dimensions.
    pub shape: Vec<usize>,
}
