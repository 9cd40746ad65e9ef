//! Values that start on a cache line, so that no vector straddles two.

use std::ops::{Deref, DerefMut};

/// Values that are aligned together: whole cache lines of either precision.
const VALUES: usize = 16;

#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Line<T>([T; VALUES]);

/// A slice of fixed length that starts on a cache line.
#[derive(Debug)]
pub(crate) struct Aligned<T = f64> {
    /// Enough lines for `length` values.
    lines: Box<[Line<T>]>,
    length: usize,
}

impl<T: Copy> Aligned<T> {
    /// `length` times `value`.
    pub(crate) fn new(length: usize, value: T) -> Self {
        Self { lines: vec![Line([value; VALUES]); length.div_ceil(VALUES)].into_boxed_slice(), length }
    }
}

impl Aligned {
    /// A copy of these values.
    pub(crate) fn from_slice(values: &[f64]) -> Self {
        let mut aligned = Self::new(values.len(), 0.0);
        aligned.copy_from_slice(values);
        aligned
    }
}

impl<T> Deref for Aligned<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        const { assert!(size_of::<Line<T>>() == VALUES * size_of::<T>()) };
        // SAFETY: the only constructor made `length.div_ceil(VALUES)` lines. A `Line` begins with its values (C layout), and is nothing but them
        // where 16 of them fill whole cache lines, which is asserted. So the lines are consecutive values, all initialised, of which `length` are lent as long as `self` is.
        unsafe { std::slice::from_raw_parts(self.lines.as_ptr().cast(), self.length) }
    }
}

impl<T> DerefMut for Aligned<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        const { assert!(size_of::<Line<T>>() == VALUES * size_of::<T>()) };
        // SAFETY: as for `deref`; the borrow is exclusive.
        unsafe { std::slice::from_raw_parts_mut(self.lines.as_mut_ptr().cast(), self.length) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_start_on_a_line() {
        for length in [0, 1, 7, 8, 16, 17, 1000] {
            let mut aligned = Aligned::new(length, 2.5);
            assert_eq!(aligned.as_ptr() as usize % 64, 0);
            assert_eq!(&*aligned, vec![2.5; length]);
            aligned.fill(1.0);
            assert_eq!(&*Aligned::from_slice(&aligned), &*aligned);
            let single = Aligned::new(length, 1.5f32);
            assert_eq!(single.as_ptr() as usize % 64, 0);
            assert_eq!(&*single, vec![1.5; length]);
        }
    }
}
