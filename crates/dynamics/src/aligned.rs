//! Values that start on a cache line, so that no vector straddles two.

use std::ops::{Deref, DerefMut};

/// Values on a cache line.
const VALUES: usize = 8;

#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Line([f64; VALUES]);

/// A slice of fixed length that starts on a cache line.
#[derive(Debug)]
pub(crate) struct Aligned {
    /// Enough lines for `length` values.
    lines: Box<[Line]>,
    length: usize,
}

impl Aligned {
    /// `length` times `value`.
    pub(crate) fn new(length: usize, value: f64) -> Self {
        Self { lines: vec![Line([value; VALUES]); length.div_ceil(VALUES)].into_boxed_slice(), length }
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
        // SAFETY: a `Line` is nothing but its eight values (C layout, no padding), so the lines are `8 * lines.len()` consecutive
        // values, all initialised, of which `length` (rounded up to lines by the only constructor) are lent as long as `self` is.
        unsafe { std::slice::from_raw_parts(self.lines.as_ptr().cast(), self.length) }
    }
}

impl DerefMut for Aligned {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f64] {
        // SAFETY: as for `deref`; the borrow is exclusive.
        unsafe { std::slice::from_raw_parts_mut(self.lines.as_mut_ptr().cast(), self.length) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_start_on_a_line() {
        for length in [0, 1, 7, 8, 1000] {
            let mut aligned = Aligned::new(length, 2.5);
            assert_eq!(aligned.as_ptr() as usize % 64, 0);
            assert_eq!(&*aligned, vec![2.5; length]);
            aligned.fill(1.0);
            assert_eq!(&*Aligned::from_slice(&aligned), &*aligned);
        }
    }
}
