//! Values that start on a cache line, so that no vector straddles two.

use std::ops::{Deref, DerefMut};

/// Bytes of a cache line, and of the widest vector.
const LINE: usize = 64;

/// A slice of fixed length that starts on a cache line.
#[derive(Debug, Default)]
pub(crate) struct Aligned {
    values: Vec<f64>,
    offset: usize,
    length: usize,
}

impl Aligned {
    /// `length` times `value`.
    pub(crate) fn new(length: usize, value: f64) -> Self {
        let values = vec![value; length + LINE / size_of::<f64>()];
        // The vector is never resized: its values stay where they are.
        let offset = values.as_ptr().align_offset(LINE).min(LINE / size_of::<f64>());
        Self { values, offset, length }
    }

    /// A copy of these values.
    pub(crate) fn from_slice(values: &[f64]) -> Self {
        let mut aligned = Self::new(values.len(), 0.0);
        aligned.copy_from_slice(values);
        aligned
    }
}

impl Deref for Aligned {
    type Target = [f64];

    #[inline(always)]
    fn deref(&self) -> &[f64] {
        &self.values[self.offset..self.offset + self.length]
    }
}

impl DerefMut for Aligned {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.values[self.offset..self.offset + self.length]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_start_on_a_line() {
        for length in [0, 1, 7, 8, 1000] {
            let mut aligned = Aligned::new(length, 2.5);
            assert_eq!(aligned.as_ptr() as usize % LINE, 0);
            assert_eq!(&*aligned, vec![2.5; length]);
            aligned.fill(1.0);
            assert_eq!(&*Aligned::from_slice(&aligned), &*aligned);
        }
    }
}
