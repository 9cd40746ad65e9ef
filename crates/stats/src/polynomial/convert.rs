//! Between coefficients of the Chebyshev basis and coefficients of raw monomials.

use faer::{Mat, MatRef};

use super::{affine::AffineMap, double::Double, graded::Graded};

/// A matrix of polynomials: column i holds function i of one basis expanded in the other; upper triangular by degree.
struct Expansion {
    functions: usize,
    values: Vec<Double>,
}

impl Expansion {
    fn new(functions: usize) -> Self {
        let mut values = vec![Double::default(); functions * functions];
        values[0] = Double::from(1.0);
        Self { functions, values }
    }

    fn column(&self, i: usize) -> &[Double] {
        &self.values[i * self.functions..(i + 1) * self.functions]
    }

    fn set(&mut self, i: usize, column: &[Double]) {
        self.values[i * self.functions..(i + 1) * self.functions].copy_from_slice(column);
    }

    /// The expansion times coefficients (p x q) and intercepts (q) of the functions; the same shapes in the other basis.
    fn apply(&self, coefficients: MatRef<'_, f64>, intercept: &[f64]) -> (Mat<f64>, Vec<f64>) {
        let mut result = Mat::zeros(coefficients.nrows(), coefficients.ncols());
        let mut constant = vec![0.0; coefficients.ncols()];
        for t in 0..coefficients.ncols() {
            let mut sums = vec![Double::default(); self.functions];
            for i in 0..self.functions {
                let factor = Double::from(if i == 0 { intercept[t] } else { coefficients[(i - 1, t)] });
                sums.iter_mut().zip(self.column(i)).for_each(|(sum, &value)| *sum += factor * value);
            }
            constant[t] = sums[0].to_f64();
            sums[1..].iter().enumerate().for_each(|(i, sum)| result[(i, t)] = sum.to_f64());
        }
        (result, constant)
    }
}

/// Index of `exponent + e_k` for functions below the top degree, by function and variable.
fn raised(library: &Graded, variables: usize) -> Vec<Option<usize>> {
    let mut raised = Vec::with_capacity(library.len() * variables);
    for i in 0..library.len() {
        for k in 0..variables {
            let mut exponent = library.exponent(i).to_vec();
            exponent[k] += 1;
            raised.push(library.index(&exponent));
        }
    }
    raised
}

/// Chebyshev coefficients -> raw monomials: `T_{a} = 2 v_k T_{a - e_k} - T_{a - 2 e_k}` with v_k an affine form of x.
pub(super) fn to_monomials(
    library: &Graded,
    map: &AffineMap,
    coefficients: MatRef<'_, f64>,
    intercept: &[f64],
) -> (Mat<f64>, Vec<f64>) {
    let (m, forms) = (map.variables(), map.forward_forms());
    let raise = raised(library, m);
    let mut expansion = Expansion::new(library.len());
    for i in 1..library.len() {
        let Some((k, parent)) = library.parent(i) else {
            continue;
        };
        let exponent = library.exponent(i);
        let twice = Double::from(if exponent[k] > 1 { 2.0 } else { 1.0 });
        let mut column = vec![Double::default(); library.len()];
        for (j, &value) in expansion.column(parent).iter().enumerate() {
            if value != Double::default() {
                let value = twice * value;
                column[j] += value * forms[k][0];
                for l in 0..m {
                    if let Some(up) = raise[j * m + l] {
                        column[up] += value * forms[k][1 + l];
                    }
                }
            }
        }
        if exponent[k] > 1
            && let Some((_, before)) = library.parent(parent)
        {
            column.iter_mut().zip(expansion.column(before)).for_each(|(c, &b)| *c = *c - b);
        }
        expansion.set(i, &column);
    }
    expansion.apply(coefficients, intercept)
}

/// Raw monomials -> Chebyshev coefficients: `x^a = x_k x^{a - e_k}` with x_k an affine form of v and `2 v_l T_b = T_{b + e_l} + T_{|b - e_l|}`.
fn monomials(library: &Graded, map: &AffineMap) -> Expansion {
    let (m, forms) = (map.variables(), map.inverse_forms());
    let raise = raised(library, m);
    let half = Double::from(0.5);
    let mut expansion = Expansion::new(library.len());
    for i in 1..library.len() {
        let Some((k, parent)) = library.parent(i) else {
            continue;
        };
        let mut column = vec![Double::default(); library.len()];
        for (j, &value) in expansion.column(parent).iter().enumerate() {
            if value == Double::default() {
                continue;
            }
            column[j] += value * forms[k][0];
            for l in 0..m {
                let (Some(up), share) = (raise[j * m + l], value * forms[k][1 + l]) else {
                    continue;
                };
                let mut lower = library.exponent(j).to_vec();
                if lower[l] == 0 {
                    column[up] += share;
                } else {
                    lower[l] -= 1;
                    column[up] += share * half;
                    column[library.index(&lower).unwrap_or(0)] += share * half;
                }
            }
        }
        expansion.set(i, &column);
    }
    expansion
}

/// Coefficients of raw monomials as coefficients of the basis.
pub(super) fn from_monomials(
    library: &Graded,
    map: &AffineMap,
    coefficients: MatRef<'_, f64>,
    intercept: &[f64],
) -> (Mat<f64>, Vec<f64>) {
    monomials(library, map).apply(coefficients, intercept)
}

/// Every raw monomial in the basis: its constant, and its coefficients down to its own place, all later ones being zero.
///
/// A variable of the basis is a combination of the base columns up to its own, so what a monomial expands to is of lower degree or, in the
/// same degree, has more of the earlier variables: it stands before it in graded lexicographic order.
pub(super) fn triangle(library: &Graded, map: &AffineMap) -> Vec<(f64, Vec<f64>)> {
    let expansion = monomials(library, map);
    let column = |i: usize| {
        let values = &expansion.column(i)[..=i];
        (values[0].to_f64(), values[1..].iter().map(|value| value.to_f64()).collect())
    };
    (1..library.len()).map(column).collect()
}
