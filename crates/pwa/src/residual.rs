//! The arithmetic of the third pass, row by row and vectorised over targets.
//!
//! Targets are padded to whole vectors, with zeros. `mul_add` gives the same bits on every machine. The kernels are
//! structs, because only code inlined into the dispatched function gets its vector instructions.

use fleetfoot_stats::kernel::{LANES, padded};
use pulp::NullaryFnOnce;

use crate::region_model::RegionModel;

/// Affine maps of regions: for each a row of constants, then one row a regressor.
pub(crate) struct Maps {
    regressors: usize,
    width: usize,
    table: Vec<f64>,
}

impl Maps {
    pub(crate) fn new(models: &[RegionModel], regressors: usize, targets: usize) -> Self {
        let width = padded(targets);
        let mut table = vec![0.0; models.len() * (regressors + 1) * width];
        for (model, rows) in models.iter().zip(table.chunks_exact_mut((regressors + 1) * width)) {
            for t in 0..targets {
                rows[t] = model.intercept[t];
                for j in 0..regressors {
                    rows[(j + 1) * width + t] = model.coefficients[(j, t)];
                }
            }
        }
        Self { regressors, width, table }
    }

    /// Number of regions.
    fn regions(&self) -> usize {
        self.table.len() / ((self.regressors + 1) * self.width).max(1)
    }

    /// `out = y - map(x)`, rows of `x` (regressors) and of `y` and `out` (padded targets); a row without a region gets the last one's.
    pub(crate) fn residuals(&self, regions: &[u32], x: &[f64], y: &[f64], out: &mut [f64]) {
        fleetfoot_data::arch().dispatch(Residuals { maps: self, regions, x, y, out });
    }
}

struct Residuals<'a> {
    maps: &'a Maps,
    regions: &'a [u32],
    x: &'a [f64],
    y: &'a [f64],
    out: &'a mut [f64],
}

impl NullaryFnOnce for Residuals<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (p, width) = (self.maps.regressors, self.maps.width);
        let last = self.maps.regions().saturating_sub(1);
        for (row, &region) in self.regions.iter().enumerate() {
            let region = (region as usize).min(last);
            let table = &self.maps.table[region * (p + 1) * width..(region + 1) * (p + 1) * width];
            let x = &self.x[row * p..(row + 1) * p];
            for lane in (0..width).step_by(LANES) {
                let mut sum = [0.0; LANES];
                sum.copy_from_slice(&table[lane..lane + LANES]);
                for (coefficients, &value) in table[width..].chunks_exact(width).zip(x) {
                    let coefficients = &coefficients[lane..lane + LANES];
                    for i in 0..LANES {
                        sum[i] = coefficients[i].mul_add(value, sum[i]);
                    }
                }
                let at = row * width + lane;
                for i in 0..LANES {
                    self.out[at + i] = self.y[at + i] - sum[i];
                }
            }
        }
    }
}

/// Weighted sums of |e|, e^2 and of the Mahalanobis score of the error vector e.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    /// Of absolute errors, padded.
    pub(crate) absolute: Vec<f64>,
    /// Of squared errors, padded.
    pub(crate) squared: Vec<f64>,
    /// Of Mahalanobis scores (equation (10)).
    pub(crate) mahalanobis: f64,
}

impl Sums {
    pub(crate) fn new(targets: usize) -> Self {
        Self { absolute: vec![0.0; padded(targets)], squared: vec![0.0; padded(targets)], mahalanobis: 0.0 }
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        self.absolute.iter_mut().zip(&other.absolute).for_each(|(a, b)| *a += b);
        self.squared.iter_mut().zip(&other.squared).for_each(|(a, b)| *a += b);
        self.mahalanobis += other.mahalanobis;
    }

    /// Adds rows of residuals. `whitening` is the transpose of the whitening matrix, q rows of padded length.
    pub(crate) fn add(&mut self, residuals: &[f64], whitening: &[f64], weights: Option<&[f64]>) {
        fleetfoot_data::arch().dispatch(Add { sums: self, residuals, whitening, weights });
    }
}

struct Add<'a> {
    sums: &'a mut Sums,
    residuals: &'a [f64],
    whitening: &'a [f64],
    weights: Option<&'a [f64]>,
}

impl NullaryFnOnce for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let width = self.sums.absolute.len();
        for (row, error) in self.residuals.chunks_exact(width).enumerate() {
            let weight = self.weights.map_or(1.0, |weights| weights[row]);
            let mut squares = [0.0; LANES];
            for lane in (0..width).step_by(LANES) {
                let absolute = &mut self.sums.absolute[lane..lane + LANES];
                let squared = &mut self.sums.squared[lane..lane + LANES];
                let mut white = [0.0; LANES];
                for (column, &e) in self.whitening.chunks_exact(width).zip(error) {
                    let column = &column[lane..lane + LANES];
                    for i in 0..LANES {
                        white[i] = column[i].mul_add(e, white[i]);
                    }
                }
                let error = &error[lane..lane + LANES];
                for i in 0..LANES {
                    absolute[i] = weight.mul_add(error[i].abs(), absolute[i]);
                    squared[i] = (weight * error[i]).mul_add(error[i], squared[i]);
                    squares[i] = white[i].mul_add(white[i], squares[i]);
                }
            }
            let square: f64 = squares.iter().sum();
            self.sums.mahalanobis = weight.mul_add(square.sqrt(), self.sums.mahalanobis);
        }
    }
}

/// Weighted scatter of the residuals in every region: `targets` rows of padded length each, and the weights.
#[derive(Debug, Clone)]
pub(crate) struct Scatter {
    targets: usize,
    weights: Vec<f64>,
    products: Vec<f64>,
}

impl Scatter {
    pub(crate) fn new(regions: usize, targets: usize) -> Self {
        Self { targets, weights: vec![0.0; regions], products: vec![0.0; regions * targets * padded(targets)] }
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        self.weights.iter_mut().zip(&other.weights).for_each(|(a, b)| *a += b);
        self.products.iter_mut().zip(&other.products).for_each(|(a, b)| *a += b);
    }

    pub(crate) fn add(&mut self, regions: &[u32], residuals: &[f64], weights: Option<&[f64]>) {
        fleetfoot_data::arch().dispatch(AddScatter { scatter: self, regions, residuals, weights });
    }

    /// Covariance (divisor: weight) of a region, packed lower triangle; NaN without rows.
    pub(crate) fn covariance(&self, region: usize) -> Vec<f64> {
        let width = padded(self.targets);
        let products = &self.products[region * self.targets * width..(region + 1) * self.targets * width];
        (0..self.targets)
            .flat_map(|i| (0..=i).map(move |j| (i, j)))
            .map(|(i, j)| products[i * width + j] / self.weights[region])
            .collect()
    }
}

struct AddScatter<'a> {
    scatter: &'a mut Scatter,
    regions: &'a [u32],
    residuals: &'a [f64],
    weights: Option<&'a [f64]>,
}

impl NullaryFnOnce for AddScatter<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let targets = self.scatter.targets;
        let width = padded(targets);
        let last = self.scatter.weights.len().saturating_sub(1);
        for ((row, &region), error) in self.regions.iter().enumerate().zip(self.residuals.chunks_exact(width)) {
            let region = (region as usize).min(last);
            let weight = self.weights.map_or(1.0, |weights| weights[row]);
            self.scatter.weights[region] += weight;
            let products = &mut self.scatter.products[region * targets * width..(region + 1) * targets * width];
            for (sums, &e) in products.chunks_exact_mut(width).zip(error) {
                let scaled = weight * e;
                for lane in (0..width).step_by(LANES) {
                    let (sums, error) = (&mut sums[lane..lane + LANES], &error[lane..lane + LANES]);
                    for i in 0..LANES {
                        sums[i] = scaled.mul_add(error[i], sums[i]);
                    }
                }
            }
        }
    }
}

/// Columns of one length into rows of `width` values; places without a column stay zero.
pub(crate) fn by_rows(columns: &[&[f64]], width: usize, out: &mut Vec<f64>) {
    /// Rows that are turned while their lines stay in first-level cache.
    const BLOCK: usize = 64;
    let rows = columns.first().map_or(0, |column| column.len());
    out.clear();
    out.resize(rows * width, 0.0);
    for (block, target) in out.chunks_mut(BLOCK * width.max(1)).enumerate() {
        for (j, column) in columns.iter().enumerate() {
            let from = block * BLOCK;
            let source = &column[from..(from + BLOCK).min(rows)];
            for (row, &value) in target.chunks_exact_mut(width).zip(source) {
                row[j] = value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Mat;

    #[test]
    fn sums_match_definition() {
        let (n, p, q) = (150, 3, 10);
        let value = |i: usize| ((i * 37 % 101) as f64 * 0.1).sin();
        let columns: Vec<Vec<f64>> = (0..p + q).map(|c| (0..n).map(|row| value(row * 7 + c * 13)).collect()).collect();
        let models: Vec<RegionModel> = (0..2)
            .map(|region| RegionModel {
                coefficients: Mat::from_fn(p, q, |j, t| value(j + 5 * t + 50 * region)),
                intercept: (0..q).map(|t| value(t + 70 * region)).collect(),
                rank: p,
                condition: 1.0,
                confounded: Vec::new(),
            })
            .collect();
        let regions: Vec<u32> = (0..n).map(|row| if row % 5 == 4 { u32::MAX } else { (row % 2) as u32 }).collect();
        let weights: Vec<f64> = (0..n).map(|row| f64::from(row as u32 % 3)).collect();
        let (mut x, mut y) = (Vec::new(), Vec::new());
        let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        by_rows(&slices[..p], p, &mut x);
        by_rows(&slices[p..], padded(q), &mut y);
        let mut out = vec![0.0; n * padded(q)];
        Maps::new(&models, p, q).residuals(&regions, &x, &y, &mut out);
        // The identity whitens nothing: the score is the Euclidean norm.
        let mut whitening = vec![0.0; q * padded(q)];
        (0..q).for_each(|i| whitening[i * padded(q) + i] = 1.0);
        let (mut sums, mut scatter) = (Sums::new(q), Scatter::new(2, q));
        sums.add(&out, &whitening, Some(&weights));
        scatter.add(&regions, &out, Some(&weights));
        let mut expected = (vec![0.0; q], vec![0.0; q], 0.0, [0.0, 0.0], [0.0, 0.0]);
        for row in 0..n {
            let region = (regions[row] as usize).min(1);
            let error: Vec<f64> = (0..q)
                .map(|t| {
                    let model = &models[region];
                    let map: f64 = (0..p).map(|j| model.coefficients[(j, t)] * columns[j][row]).sum();
                    columns[p + t][row] - model.intercept[t] - map
                })
                .collect();
            for t in 0..q {
                assert!((error[t] - out[row * padded(q) + t]).abs() < 1e-14);
                expected.0[t] += weights[row] * error[t].abs();
                expected.1[t] += weights[row] * error[t] * error[t];
            }
            expected.2 += weights[row] * error.iter().map(|e| e * e).sum::<f64>().sqrt();
            expected.3[region] += weights[row];
            expected.4[region] += weights[row] * error[9] * error[2];
        }
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-11, "{a} {b}");
        (0..q).for_each(|t| close(sums.absolute[t], expected.0[t]));
        (0..q).for_each(|t| close(sums.squared[t], expected.1[t]));
        close(sums.mahalanobis, expected.2);
        for region in 0..2 {
            close(scatter.covariance(region)[9 * 10 / 2 + 2], expected.4[region] / expected.3[region]);
        }
    }
}
