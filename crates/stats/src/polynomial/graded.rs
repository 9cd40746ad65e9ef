//! The exponents of all monomials up to a total degree, in graded lexicographic order.

use std::collections::HashMap;

/// All exponent vectors of `variables` variables with total degree `0..=degree`: 1, x, y, x^2, x*y, y^2, ...
///
/// The same list names monomials and tensor Chebyshev polynomials. Degree 0 is index 0.
#[derive(Debug, Clone)]
pub(super) struct Graded {
    variables: usize,
    degree: usize,
    exponents: Vec<u8>,
    /// Index of the first function of each degree; one entry more than there are degrees.
    starts: Vec<usize>,
    lookup: HashMap<Box<[u8]>, usize>,
}

/// C(variables + degree, variables): the number of functions of total degree `0..=degree`; saturates.
pub(super) fn count(variables: usize, degree: usize) -> usize {
    let (small, large) = (variables.min(degree), variables.max(degree));
    let mut value: u128 = 1;
    for k in 1..=small as u128 {
        // Exact at every step: the product is C(large + k, k).
        value = value.saturating_mul(large as u128 + k) / k;
        if value > usize::MAX as u128 {
            return usize::MAX;
        }
    }
    value as usize
}

impl Graded {
    /// The list; the caller has checked that its length is affordable and that `degree <= 255`.
    pub(super) fn new(variables: usize, degree: usize) -> Self {
        let (mut exponents, mut starts) = (Vec::new(), vec![0]);
        let mut current = vec![0u8; variables];
        for d in 0..=degree {
            if d == 0 || variables > 0 {
                compositions(&mut exponents, &mut current, 0, d);
            }
            // No variables: the constant is all there is.
            starts.push(exponents.len().checked_div(variables).unwrap_or(1));
        }
        let mut list = Self { variables, degree, exponents, starts, lookup: HashMap::new() };
        list.lookup = (0..list.len()).map(|i| (list.exponent(i).into(), i)).collect();
        list
    }

    pub(super) fn len(&self) -> usize {
        self.starts[self.degree + 1]
    }

    pub(super) fn exponent(&self, index: usize) -> &[u8] {
        &self.exponents[index * self.variables..(index + 1) * self.variables]
    }

    /// The functions of total degree `degree`.
    pub(super) fn of_degree(&self, degree: usize) -> std::ops::Range<usize> {
        self.starts[degree]..self.starts[degree + 1]
    }

    /// Place of an exponent vector in the list; `None` if its degree is above that of the list.
    pub(super) fn index(&self, exponent: &[u8]) -> Option<usize> {
        self.lookup.get(exponent).copied()
    }

    /// The last variable of a function and the function with that variable's exponent lowered by one; `None` for the constant.
    pub(super) fn parent(&self, index: usize) -> Option<(usize, usize)> {
        let exponent = self.exponent(index);
        let last = exponent.iter().rposition(|&e| e > 0)?;
        let mut lower = exponent.to_vec();
        lower[last] -= 1;
        Some((last, self.index(&lower)?))
    }
}

/// Appends all exponents of total degree `left` over the variables from `at` on, the first variable's largest power first.
fn compositions(out: &mut Vec<u8>, current: &mut [u8], at: usize, left: usize) {
    if at + 1 >= current.len() {
        if let Some(last) = current.last_mut() {
            *last = left as u8;
        }
        out.extend_from_slice(current);
        return;
    }
    for power in (0..=left).rev() {
        current[at] = power as u8;
        compositions(out, current, at + 1, left - power);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn graded_lexicographic_order() {
        let list = Graded::new(2, 2);
        let all: Vec<&[u8]> = (0..list.len()).map(|i| list.exponent(i)).collect();
        assert_eq!(all, [&[0, 0], &[1, 0], &[0, 1], &[2, 0], &[1, 1], &[0, 2]]);
        assert_eq!(list.of_degree(2), 3..6);
        assert_eq!(list.parent(4), Some((1, 1)));
        assert_eq!(list.parent(0), None);
    }

    #[test]
    fn counts_are_binomials() {
        assert_eq!((count(3, 10), count(3, 5), count(16, 4), count(0, 7), count(1, 9)), (286, 56, 4845, 1, 10));
        assert_eq!(count(200, 200), usize::MAX);
        for (variables, degree) in [(0, 3), (1, 5), (4, 3), (6, 2)] {
            let list = Graded::new(variables, degree);
            assert_eq!(list.len(), count(variables, degree));
            assert!((0..list.len()).all(|i| list.index(list.exponent(i)) == Some(i)));
        }
    }
}
