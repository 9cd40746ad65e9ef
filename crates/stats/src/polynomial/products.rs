//! From Chebyshev moments to the products of the library's functions.

use fleetfoot_data::packed;

use super::graded::Graded;

/// For each pair (i, j), j <= i, of library functions: the moments whose mean is the sum of their products.
///
/// `T_a T_b = (T_{a+b} + T_{|a-b|}) / 2` in each variable in which both appear: 2^k moments with equal weights for k such variables.
#[derive(Debug, Clone)]
pub(super) struct ProductTable {
    /// Packed lower triangle over all functions, the constant included; one entry more than there are pairs.
    offsets: Vec<u32>,
    terms: Vec<u32>,
}

impl ProductTable {
    pub(super) fn new(library: &Graded, moments: &Graded) -> Self {
        let mut table = Self { offsets: vec![0], terms: Vec::new() };
        for i in 0..library.len() {
            for j in 0..=i {
                table.push(library.exponent(i), library.exponent(j), moments);
                table.offsets.push(table.terms.len() as u32);
            }
        }
        table
    }

    fn push(&mut self, a: &[u8], b: &[u8], moments: &Graded) {
        let mut exponents: Vec<Vec<u8>> = vec![a.iter().zip(b).map(|(a, b)| a + b).collect()];
        for k in (0..a.len()).filter(|&k| a[k] > 0 && b[k] > 0) {
            for e in 0..exponents.len() {
                let mut other = exponents[e].clone();
                other[k] = a[k].abs_diff(b[k]);
                exponents.push(other);
            }
        }
        // Every exponent has total degree at most twice the library's, which is what `moments` holds.
        self.terms.extend(exponents.iter().filter_map(|exponent| moments.index(exponent)).map(|index| index as u32));
    }

    /// The weighted sum of function i times function j, from the moments.
    pub(super) fn product(&self, i: usize, j: usize, moments: &[f64]) -> f64 {
        let at = packed(i, j);
        let terms = &self.terms[self.offsets[at] as usize..self.offsets[at + 1] as usize];
        terms.iter().map(|&term| moments[term as usize]).sum::<f64>() / terms.len() as f64
    }
}
