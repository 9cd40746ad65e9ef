//! Linear separators by regularised multinomial logistic regression.
//!
//! Over weights `w_k` (d) and offsets `b_k` of K regions, with `l_i` the region of row i, `v_i` its weight and V the sum of the weights,
//!
//! `1/V sum_i v_i [ ln sum_k exp(w_k . z_i + b_k) - (w_l . z_i + b_l) ] + penalty/(2V) sum_k |w_k|^2`
//!
//! is minimised: convex, by Newton's method with backtracking. Value, gradient and Hessian are sums over rows, merged
//! chunk by chunk. With `p_k` the probabilities of a row and `u = (z, 1)`, the Hessian is a graph Laplacian of blocks,
//! `sum v p_k p_l u u'` between the regions k and l (Böhning, "Multinomial logistic regression algorithm", 1992). A row
//! therefore has work only in the pairs of regions that it lies between.

use faer::{Mat, Side, linalg::solvers::Solve};
use fleetfoot_data::packed_row;

use crate::examples::{Chunk, Examples};

/// Penalty of the offsets, relative to the weights': enough to fix the direction in which all move together.
const OFFSET: f64 = 1e-6;

/// A pair of regions in a row below this has no part in the Hessian.
const NEGLIGIBLE: f64 = 1e-9;

/// A logarithm whose exponential is below [`NEGLIGIBLE`]: most regions are that far from a row, and need no exponential.
const FAR: f64 = -20.8;

/// Numbers of all rows' scores up to which the probabilities at a point serve both its value and its curvature.
const KEPT: usize = 1 << 18;

/// Shortest step of the backtracking.
const SHORTEST: f64 = 1e-6;

/// Centres of regions that differ by less, in standard deviations of a partition column, count as equal.
const GRAIN: f64 = 1e-6;

/// `argmax_k (w_k . z + b_k)`: K rows of the d weights and the offset.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Separators {
    pub(super) regions: usize,
    pub(super) dimensions: usize,
    pub(super) table: Vec<f64>,
}

impl Separators {
    pub(super) fn zero(regions: usize, dimensions: usize) -> Self {
        Self { regions, dimensions, table: vec![0.0; regions * (dimensions + 1)] }
    }

    /// The cells of centroids (K x d), as likely as under normal distributions of unit variance around them.
    pub(super) fn voronoi(centroids: &[Vec<f64>], dimensions: usize) -> Self {
        let row = |c: &Vec<f64>| [c.as_slice(), &[-0.5 * c.iter().map(|v| v * v).sum::<f64>()]].concat();
        let table: Vec<f64> = centroids.iter().flat_map(row).collect();
        Self { regions: table.len() / (dimensions + 1), dimensions, table }
    }

    /// Weights and offset of each region.
    pub(super) fn rows(&self) -> impl Iterator<Item = (&[f64], f64)> {
        self.table.chunks_exact(self.dimensions + 1).map(|row| (&row[..self.dimensions], row[self.dimensions]))
    }

    /// Without some regions.
    pub(super) fn only(&self, kept: &[usize]) -> Self {
        let width = self.dimensions + 1;
        let table =
            kept.iter().flat_map(|&region| &self.table[region * width..(region + 1) * width]).copied().collect();
        Self { regions: kept.len(), table, ..*self }
    }

    /// Scores of the rows of a chunk, region after region.
    pub(super) fn scores(&self, chunk: &Chunk) -> Vec<f64> {
        let mut scores = Vec::with_capacity(self.regions * chunk.rows);
        for (weights, offset) in self.rows() {
            let from = scores.len();
            scores.resize(from + chunk.rows, offset);
            for (column, &weight) in weights.iter().enumerate() {
                for (score, &z) in scores[from..].iter_mut().zip(chunk.column(column)) {
                    *score += weight * z;
                }
            }
        }
        scores
    }

    /// Scores of a row of partition columns and 1.
    pub(super) fn of_row(&self, u: &[f64]) -> Vec<f64> {
        let of = |weights: &[f64]| weights.iter().zip(u).map(|(w, u)| w * u).sum();
        self.table.chunks_exact(self.dimensions + 1).map(of).collect()
    }

    /// Moves weights and offset of a region along a direction.
    pub(super) fn push(&mut self, region: usize, direction: &[f64], step: f64) {
        let table = &mut self.table[region * (self.dimensions + 1)..];
        table.iter_mut().zip(direction).for_each(|(w, g)| *w += step * g);
    }

    /// The region of the greatest score of every row, the first of equal ones.
    pub(super) fn winners(&self, examples: &Examples) -> Vec<Vec<u32>> {
        examples.map(|_, chunk| {
            let scores = self.scores(chunk);
            let mut winner = vec![0; chunk.rows];
            for (row, winner) in winner.iter_mut().enumerate() {
                for region in 1..self.regions {
                    if scores[region * chunk.rows + row] > scores[*winner as usize * chunk.rows + row] {
                        *winner = region as u32;
                    }
                }
            }
            winner
        })
    }

    /// The regions in the order of their centres: by the first partition column, by the next where centres are equal there.
    ///
    /// Descents end with regions numbered as their start was, and rounding may choose between equally good starts. Centres are compared to [`GRAIN`], so that
    /// rounding does not choose the numbers.
    pub(super) fn ordered(&self, examples: &Examples) -> Self {
        let width = self.dimensions + 1;
        let winners = self.winners(examples);
        let parts = examples.map(|at, chunk| {
            let mut sums = vec![0.0; self.regions * width];
            for (row, &region) in winners[at].iter().enumerate() {
                let sums = &mut sums[region as usize * width..][..width];
                let weight = chunk.weight(row);
                sums[self.dimensions] += weight;
                (0..self.dimensions).for_each(|column| sums[column] += weight * chunk.column(column)[row]);
            }
            sums
        });
        let mut sums = vec![0.0; self.regions * width];
        parts.iter().for_each(|part| sums.iter_mut().zip(part).for_each(|(sum, part)| *sum += part));
        let centre = |region: usize| -> Vec<i64> {
            let sums = &sums[region * width..][..width];
            let weight = sums[self.dimensions].max(f64::MIN_POSITIVE);
            sums[..self.dimensions].iter().map(|sum| (sum / weight / GRAIN).round() as i64).collect()
        };
        let mut order: Vec<usize> = (0..self.regions).collect();
        order.sort_by_cached_key(|&region| centre(region));
        self.only(&order)
    }

    /// At most `steps` steps of Newton's method towards the minimum for these regions of the rows; the objective.
    pub(super) fn improve(&mut self, examples: &Examples, labels: &[Vec<u32>], penalty: f64, steps: usize) -> f64 {
        let mut at = self.point(examples, labels, penalty);
        let mut value = at.value;
        for _ in 0..steps {
            let (step, slope) = self.newton(examples, labels, penalty, &at.probabilities);
            let Some((next, improved)) = self.backtrack(examples, labels, penalty, &step, (value, slope)) else {
                break;
            };
            let fall = value - improved.value;
            (*self, value, at) = (next, improved.value, improved);
            if fall <= 1e-7 * value.abs() {
                break;
            }
        }
        value
    }

    fn backtrack(
        &self,
        examples: &Examples,
        labels: &[Vec<u32>],
        penalty: f64,
        step: &[f64],
        (value, slope): (f64, f64),
    ) -> Option<(Self, Point)> {
        let mut length = 1.0;
        while length >= SHORTEST {
            let table = self.table.iter().zip(step).map(|(w, step)| w + length * step).collect();
            let next = Self { table, ..*self };
            let point = next.point(examples, labels, penalty);
            // Armijo.
            if point.value <= value + 1e-4 * length * slope && point.value < value {
                return Some((next, point));
            }
            length *= 0.5;
        }
        None
    }

    /// The objective, and the probabilities of every chunk where these are not too many to be kept.
    fn point(&self, examples: &Examples, labels: &[Vec<u32>], penalty: f64) -> Point {
        let few = self.regions * examples.rows <= KEPT;
        let parts = examples.map(|at, chunk| {
            let probabilities = Probabilities::new(self.scores(chunk), chunk.rows);
            let of = |(row, &label): (usize, &u32)| -chunk.weight(row) * probabilities.logarithm(label as usize, row);
            let sum = labels[at].iter().enumerate().map(of).sum::<f64>();
            (sum, few.then_some(probabilities))
        });
        let value = parts.iter().map(|(sum, _)| sum).sum::<f64>() / examples.weight + self.penalty(examples, penalty);
        Point { value, probabilities: parts.into_iter().map(|(_, probabilities)| probabilities).collect() }
    }

    /// The objective.
    #[cfg(test)]
    fn value(&self, examples: &Examples, labels: &[Vec<u32>], penalty: f64) -> f64 {
        self.point(examples, labels, penalty).value
    }

    /// The penalty's part in the objective.
    pub(super) fn penalty(&self, examples: &Examples, penalty: f64) -> f64 {
        let squares: f64 = self.table.iter().enumerate().map(|(at, w)| self.penalised(at) * w * w).sum();
        0.5 * penalty * squares / examples.weight
    }

    /// Penalty factor of a number of the table.
    fn penalised(&self, at: usize) -> f64 {
        if at % (self.dimensions + 1) == self.dimensions { OFFSET } else { 1.0 }
    }

    /// Newton's step, and the slope of the objective along it; `known` are the probabilities of every chunk.
    fn newton(
        &self,
        examples: &Examples,
        labels: &[Vec<u32>],
        penalty: f64,
        known: &[Option<Probabilities>],
    ) -> (Vec<f64>, f64) {
        let parts = examples.map(|at, chunk| match &known[at] {
            Some(known) => Curvature::of(self, chunk, &labels[at], known),
            None => Curvature::of(self, chunk, &labels[at], &Probabilities::new(self.scores(chunk), chunk.rows)),
        });
        let mut total = Curvature::zero(self);
        parts.iter().for_each(|part| total.add(part));
        let n = self.table.len();
        for (at, gradient) in total.gradient.iter_mut().enumerate() {
            *gradient += penalty * self.penalised(at) * self.table[at];
        }
        let mut hessian = total.laplacian(self.regions, self.dimensions + 1);
        for at in 0..n {
            hessian[(at, at)] += penalty * self.penalised(at) + f64::EPSILON * (examples.weight + hessian[(at, at)]);
        }
        let gradient = &total.gradient;
        let step: Vec<f64> = match hessian.llt(Side::Lower) {
            Ok(factor) => {
                let solution = factor.solve(Mat::from_fn(n, 1, |i, _| -gradient[i]));
                (0..n).map(|i| solution[(i, 0)]).collect()
            }
            // Rounding alone can do it: downhill then.
            Err(_) => gradient.iter().enumerate().map(|(at, g)| -g / hessian[(at, at)]).collect(),
        };
        let slope = step.iter().zip(gradient).map(|(step, g)| step * g).sum::<f64>() / examples.weight;
        (step, slope)
    }
}

/// The objective at some separators, and the probabilities of every chunk where they are kept.
struct Point {
    value: f64,
    probabilities: Vec<Option<Probabilities>>,
}

/// Probabilities of the regions, from scores (region after region).
pub(super) struct Probabilities {
    rows: usize,
    scores: Vec<f64>,
    /// `ln sum_k exp(score_k)` of every row.
    normaliser: Vec<f64>,
}

impl Probabilities {
    pub(super) fn new(scores: Vec<f64>, rows: usize) -> Self {
        let mut largest = vec![f64::NEG_INFINITY; rows];
        for of_region in scores.chunks_exact(rows.max(1)) {
            largest.iter_mut().zip(of_region).for_each(|(largest, score)| *largest = largest.max(*score));
        }
        let mut normaliser = vec![0.0; rows];
        for of_region in scores.chunks_exact(rows.max(1)) {
            for (row, score) in of_region.iter().enumerate() {
                normaliser[row] += (score - largest[row]).exp();
            }
        }
        normaliser.iter_mut().zip(&largest).for_each(|(sum, largest)| *sum = largest + sum.ln());
        Self { rows, scores, normaliser }
    }

    /// Logarithm of the probability that a row is of a region.
    #[inline(always)]
    pub(super) fn logarithm(&self, region: usize, row: usize) -> f64 {
        self.scores[region * self.rows + row] - self.normaliser[row]
    }
}

/// Gradient and the blocks of the Hessian, not yet divided by the weight.
struct Curvature {
    gradient: Vec<f64>,
    /// For each pair of regions k > l, one behind the other, at place `k (k - 1) / 2 + l`: the packed lower triangle of `sum v p_k p_l u u'`.
    blocks: Vec<f64>,
}

impl Curvature {
    fn zero(separators: &Separators) -> Self {
        let pairs = packed_row(separators.regions.saturating_sub(1));
        let block = packed_row(separators.dimensions + 1);
        Self { gradient: vec![0.0; separators.table.len()], blocks: vec![0.0; pairs * block] }
    }

    fn of(separators: &Separators, chunk: &Chunk, labels: &[u32], probabilities: &Probabilities) -> Self {
        let mut curvature = Self::zero(separators);
        let (k, d) = (separators.regions, separators.dimensions);
        let size = packed_row(d + 1);
        let (mut u, mut outer) = (vec![1.0; d + 1], vec![0.0; size]);
        let mut near: Vec<(usize, f64)> = Vec::with_capacity(k);
        for (row, &label) in labels.iter().enumerate() {
            let weight = chunk.weight(row);
            (0..d).for_each(|column| u[column] = chunk.z[column * chunk.rows + row]);
            near.clear();
            for region in 0..k {
                let (logarithm, is_label) = (probabilities.logarithm(region, row), region == label as usize);
                if logarithm < FAR && !is_label {
                    continue;
                }
                let p = logarithm.exp();
                if p > NEGLIGIBLE || is_label {
                    near.push((region, p));
                }
            }
            for &(region, p) in &near {
                let slope = weight * (p - f64::from(u8::from(region == label as usize)));
                add_scaled(&mut curvature.gradient[region * (d + 1)..(region + 1) * (d + 1)], slope, &u);
            }
            if near.len() > 1 {
                products(&u, &mut outer);
                for (at, &(upper, p)) in near.iter().enumerate() {
                    let of_upper = if upper > 0 { packed_row(upper - 1) } else { 0 };
                    for &(lower, other) in &near[..at] {
                        if p * other > NEGLIGIBLE {
                            let block = &mut curvature.blocks[(of_upper + lower) * size..(of_upper + lower + 1) * size];
                            add_scaled(block, weight * p * other, &outer);
                        }
                    }
                }
            }
        }
        curvature
    }

    fn add(&mut self, other: &Self) {
        self.gradient.iter_mut().zip(&other.gradient).for_each(|(a, b)| *a += b);
        self.blocks.iter_mut().zip(&other.blocks).for_each(|(a, b)| *a += b);
    }

    /// The Hessian, lower triangle.
    fn laplacian(&self, regions: usize, width: usize) -> Mat<f64> {
        let mut hessian = Mat::zeros(regions * width, regions * width);
        for upper in 1..regions {
            for lower in 0..upper {
                let at = packed_row(upper - 1) + lower;
                let block = &self.blocks[at * packed_row(width)..(at + 1) * packed_row(width)];
                for i in 0..width {
                    for j in 0..=i {
                        let value = block[packed_row(i) + j];
                        hessian[(upper * width + i, lower * width + j)] -= value;
                        if i != j {
                            hessian[(upper * width + j, lower * width + i)] -= value;
                        }
                        for region in [upper, lower] {
                            hessian[(region * width + i, region * width + j)] += value;
                        }
                    }
                }
            }
        }
        hessian
    }
}

/// `sum += factor * values`; a loop that the compiler keeps in one piece at every level of optimisation.
#[inline(always)]
fn add_scaled(sum: &mut [f64], factor: f64, values: &[f64]) {
    let sum = &mut sum[..values.len()];
    for at in 0..values.len() {
        sum[at] += factor * values[at];
    }
}

/// The packed lower triangle of `u u'`.
fn products(u: &[f64], outer: &mut [f64]) {
    let mut at = 0;
    for (i, &a) in u.iter().enumerate() {
        for &b in &u[..=i] {
            outer[at] = a * b;
            at += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::tests::{rows_of, waves};

    #[test]
    fn the_gradient_vanishes_at_the_minimum_wherever_the_way_began() {
        let examples = rows_of(&waves(500));
        let labels: Vec<Vec<u32>> = examples.map(|_, chunk| {
            (0..chunk.rows)
                .map(|row| u32::from(chunk.column(0)[row].sin() > 0.3) + u32::from(chunk.column(1)[row] > 0.5))
                .collect()
        });
        let mut one = Separators::zero(3, 2);
        let mut other = Separators::voronoi(&[vec![0.3, 1.0], vec![-1.0, 0.2], vec![0.8, -2.0]], 2);
        let values = [&mut one, &mut other].map(|separators| separators.improve(&examples, &labels, 0.7, 100));
        // Values near a minimum are known to the square of the gradient.
        assert!((values[0] - values[1]).abs() < 1e-10 * values[0], "{values:?}");
        for at in 0..one.table.len() {
            let at_step = |step: f64| {
                let mut moved = one.clone();
                moved.table[at] += step;
                moved.value(&examples, &labels, 0.7)
            };
            let slope = (at_step(1e-4) - at_step(-1e-4)) / 2e-4;
            assert!(slope.abs() < 1e-5, "{at}: {slope}");
        }
    }

    #[test]
    fn regions_are_ordered_by_their_centres() {
        let examples = rows_of(&waves(300));
        let separators = |centroids: [[f64; 2]; 3]| Separators::voronoi(&centroids.map(Vec::from), 2);
        let one = separators([[0.9, 0.1], [-1.0, 0.2], [0.1, -0.4]]).ordered(&examples);
        let other = separators([[0.1, -0.4], [0.9, 0.1], [-1.0, 0.2]]).ordered(&examples);
        assert_eq!(one, other);
        assert_eq!(one, separators([[-1.0, 0.2], [0.1, -0.4], [0.9, 0.1]]));
        assert_eq!(one.ordered(&examples), one);
    }

    #[test]
    fn newton_step_agrees_with_finite_differences() {
        let examples = rows_of(&waves(300));
        let labels: Vec<Vec<u32>> =
            examples.map(|_, chunk| (0..chunk.rows).map(|row| u32::from(chunk.column(0)[row] > 0.1)).collect());
        let mut near = Separators::zero(2, 2);
        near.improve(&examples, &labels, 5.0, 2);
        let known = near.point(&examples, &labels, 5.0).probabilities;
        let (step, slope) = near.newton(&examples, &labels, 5.0, &known);
        let along = |length: f64| {
            let table = near.table.iter().zip(&step).map(|(w, step)| w + length * step).collect();
            Separators { table, ..near }.value(&examples, &labels, 5.0)
        };
        let measured = (along(1e-3) - along(-1e-3)) / 2e-3;
        assert!((measured - slope).abs() < 1e-6 * slope.abs().max(1e-6), "{measured} {slope}");
    }

    #[test]
    fn the_cells_of_centroids_are_the_nearest() {
        let examples = rows_of(&waves(200));
        let centroids = [vec![0.5, 0.5], vec![-1.0, 0.0], vec![1.0, -1.0]];
        let separators = Separators::voronoi(&centroids, 2);
        for (chunk, winners) in examples.chunks.iter().zip(separators.winners(&examples)) {
            for (row, &winner) in winners.iter().enumerate() {
                let distance = |c: &Vec<f64>| (0..2).map(|j| (chunk.column(j)[row] - c[j]).powi(2)).sum::<f64>();
                let least = centroids.iter().map(distance).fold(f64::INFINITY, f64::min);
                assert!(distance(&centroids[winner as usize]) <= least + 1e-12);
            }
        }
    }
}
