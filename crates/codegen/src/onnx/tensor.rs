//! Constant tensors: weights, biases, shapes.

use super::messages::{DOUBLE, FLOAT, INT64, TensorProto};

/// A constant tensor, its values in the order of rows.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Constant {
    pub(super) dims: Vec<usize>,
    pub(super) values: Vec<f64>,
    /// True for numbers of shapes, which no network computes with.
    pub(super) is_integer: bool,
}

impl Constant {
    /// Reads a tensor, in typed or raw form.
    ///
    /// # Errors
    /// Data in another file, another element type, lengths that contradict each other, no value, a value that is not
    /// finite; in words.
    pub(super) fn read(tensor: &TensorProto) -> Result<Self, String> {
        if tensor.data_location != 0 || !tensor.external_data.is_empty() {
            return Err("its numbers lie in another file; export the network into one file".into());
        }
        let count = tensor.dims.iter().try_fold(1usize, |count, &dim| count.checked_mul(usize::try_from(dim).ok()?));
        let count = count.filter(|&count| count > 0).ok_or_else(|| format!("the shape {:?}", tensor.dims))?;
        let raw = &tensor.raw_data;
        let values: Vec<f64> = match tensor.data_type {
            FLOAT if raw.is_empty() => tensor.float_data.iter().copied().map(f64::from).collect(),
            FLOAT => words(raw, |word| f64::from(f32::from_le_bytes(word)))?,
            DOUBLE if raw.is_empty() => tensor.double_data.clone(),
            DOUBLE => words(raw, f64::from_le_bytes)?,
            INT64 if raw.is_empty() => tensor.int64_data.iter().map(|&value| value as f64).collect(),
            INT64 => words(raw, |word| i64::from_le_bytes(word) as f64)?,
            other => {
                return Err(format!(
                    "elements of the type {other}; weights have 32-bit ({FLOAT}) or 64-bit ({DOUBLE}) floats"
                ));
            }
        };
        if values.len() != count {
            return Err(format!("{} values for the shape {:?}", values.len(), tensor.dims));
        }
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            return Err(format!("a value is {value}; train the network again"));
        }
        let dims = tensor.dims.iter().map(|&dim| dim as usize).collect();
        Ok(Self { dims, values, is_integer: tensor.data_type == INT64 })
    }

    /// A single row of so many columns, to which the tensor is spread in a sum or product with one.
    pub(super) fn row(&self, columns: usize) -> Option<Vec<f64>> {
        let is_row = self.dims.iter().rev().skip(1).all(|&dim| dim == 1) && self.dims.len() <= 2;
        match self.values.as_slice() {
            [value] if self.dims.len() <= 2 => Some(vec![*value; columns]),
            values if is_row && values.len() == columns => Some(values.to_vec()),
            _ => None,
        }
    }

    /// The rows of a matrix with so many rows, transposed on request.
    pub(super) fn matrix(&self, transposed: bool, rows: usize) -> Option<Vec<Vec<f64>>> {
        let &[height, width] = self.dims.as_slice() else { return None };
        let (inner, columns) = if transposed { (width, height) } else { (height, width) };
        let at = |i: usize, k: usize| self.values[if transposed { k * width + i } else { i * width + k }];
        (inner == rows).then(|| (0..rows).map(|i| (0..columns).map(|k| at(i, k)).collect()).collect())
    }
}

/// Numbers of N bytes each, the lowest byte first.
fn words<const N: usize>(raw: &[u8], value: impl Fn([u8; N]) -> f64) -> Result<Vec<f64>, String> {
    let (words, rest) = raw.as_chunks::<N>();
    match rest {
        [] => Ok(words.iter().map(|&word| value(word)).collect()),
        _ => Err(format!("{} bytes of numbers of {N} bytes", raw.len())),
    }
}
