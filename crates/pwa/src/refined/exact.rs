//! The last step: separators moved to where the squared error itself is least.
//!
//! Multinomial regression puts a border where labels change, with rows on both sides blurred and a penalty. Here it is put where
//!
//! `E(w, b) = sum_i v_i |e_i(argmax_k w_k . z_i + b_k)|^2`
//!
//! is least for given maps, along one line after another. Where the separator of one region moves, `(w_k, b_k) + t g`,
//! each row passes into the region or out of it at one `t`. So E is a step function of t, whose steps are sorted and
//! summed, and whose minimum is exact. It is the least-squares estimate of a threshold (Hansen, "Sample splitting and
//! threshold estimation", Econometrica 2000), whose error falls with the number of rows and not with its root.
//! Directions g are those in which the rows between the region and its neighbours do not go together, so that a border
//! moves and turns one by one.
//!
//! Only rows near a border can pass; the others are skipped, and all steps together are not so long that one of them
//! would. A pass over all rows keeps those near the borders ([`Open`]), and so decides the borders that a sample leaves
//! open.

use faer::{Mat, Side};
use fleetfoot_data::mix;
use fleetfoot_model::Rule;
use fleetfoot_stats::least_squares;

use super::separators::Separators;
use crate::{
    examples::{Chunk, Examples, Shape},
    region_model::RegionModel,
    residual::Maps,
};

/// Rows near borders that are searched, at most; of a pass over all rows, about as many. Fewer for many lines: rows
/// times numbers of the separators.
const NEAR: usize = 1 << 14;
const WORK: usize = 1 << 20;
/// Numbers of the rows that a pass keeps near the borders of all partitions, at most (64 MiB).
const NUMBERS: usize = 1 << 23;
/// Times that maps are fitted anew, and that all lines are searched with the same maps, at most.
const ROUNDS: usize = 8;
const SWEEPS: usize = 16;
/// Rounds end where the error falls by a smaller share, sweeps where that of the near rows does.
const LEAST_FALL: f64 = 1e-4;
/// Partition columns up to which lines between the axes are searched as well.
const OBLIQUE: usize = 6;
/// All steps together, where all rows are near: in so many of the greatest score. A longer step would round the scores of the other rows away, and a row that the direction
/// does not move passes at infinity.
const FARTHEST: f64 = 1e9;

/// The squared error, and separators with less of it than these, by more than as many numbers would lower it by chance; else these.
pub(super) fn exact(examples: &Examples, separators: Separators) -> (f64, Separators) {
    let mut state = State::of(examples, separators.clone());
    let before = state.error;
    if separators.regions < 2 {
        return (before, separators);
    }
    for _ in 0..ROUNDS {
        let near = state.near(examples);
        let next = State::of(examples, near.searched(state.look.separators.clone()).0);
        if next.fewest < examples.regressors as u64 + 2 || next.error >= state.error {
            break;
        }
        let fall = state.error - next.error;
        state = next;
        if fall < LEAST_FALL * state.error {
            break;
        }
    }
    let sizes = (examples.weight, examples.targets);
    if pays((before, state.error), sizes, &separators) {
        (state.error, state.look.separators)
    } else {
        (before, separators)
    }
}

/// Number of rows that are searched for such separators.
fn near_rows(separators: &Separators) -> usize {
    NEAR.min(WORK / (separators.regions * (separators.dimensions + 1)))
}

/// Returns true if the error falls by more than the price, in the Bayesian information criterion, of all numbers of the
/// separators.
fn pays((before, after): (f64, f64), (rows, targets): (f64, usize), separators: &Separators) -> bool {
    let gain = rows * targets as f64 * (before.max(f64::MIN_POSITIVE) / after.max(f64::MIN_POSITIVE)).ln();
    let numbers = (separators.regions - 1) * (separators.dimensions + 1);
    gain > numbers as f64 * rows.ln()
}

/// Separators, and the cost of rows in every region.
struct Look {
    separators: Separators,
    maps: Maps,
    /// Of the targets, which errors are measured by.
    variance: Vec<f64>,
}

/// The same of some rows, with the residuals of the targets.
struct State {
    look: Look,
    error: f64,
    /// Rows of the region that has fewest.
    fewest: u64,
}

impl State {
    fn of(examples: &Examples, separators: Separators) -> Self {
        let grams = examples.grams(&separators.winners(examples), separators.regions);
        let map = |gram| RegionModel::new(least_squares(&examples.root(gram), &examples.base.scale));
        let models: Vec<RegionModel> = grams
            .iter()
            .map(|gram| if gram.weight > 0.0 { map(gram) } else { examples.base.average.clone() })
            .collect();
        Self {
            error: grams.iter().map(|gram| examples.error(gram)).sum(),
            fewest: grams.iter().map(|gram| gram.rows).min().unwrap_or(0),
            look: Look { separators, maps: examples.maps(&models), variance: examples.variance.clone() },
        }
    }

    /// The margin within which so many rows are; none where all are.
    fn margin(&self, examples: &Examples, rows: usize) -> Option<f64> {
        (examples.rows > rows).then(|| {
            let mut all = examples.map(|_, chunk| self.look.margins(chunk)).concat();
            *all.select_nth_unstable_by(rows, f64::total_cmp).1
        })
    }

    /// The rows near borders.
    fn near(&self, examples: &Examples) -> Near {
        let margin = self.margin(examples, near_rows(&self.look.separators));
        let mut near = Near::new(self.look.separators.dimensions);
        examples
            .map(|_, chunk| {
                let mut part = Near::new(self.look.separators.dimensions);
                let margins = self.look.margins(chunk);
                let inside = |row: &usize| margin.is_none_or(|margin| margins[*row] < margin);
                part.see(chunk);
                self.look.add(&mut part, chunk, &(0..chunk.rows).filter(inside).collect::<Vec<_>>());
                part
            })
            .into_iter()
            .for_each(|part| near.merge(part));
        near.margin = margin;
        near
    }
}

impl Look {
    /// Margins of a chunk: best minus second best score of every row.
    fn margins(&self, chunk: &Chunk) -> Vec<f64> {
        let scores = self.separators.scores(chunk);
        let mut best = vec![[f64::NEG_INFINITY; 2]; chunk.rows];
        for of_region in scores.chunks_exact(chunk.rows.max(1)) {
            for (best, &score) in best.iter_mut().zip(of_region) {
                *best = [best[0].max(score), best[1].max(score.min(best[0]))];
            }
        }
        best.iter().map(|[first, second]| first - second).collect()
    }

    /// Adds rows of a chunk, with the weighted squared errors of every region's map there.
    fn add(&self, near: &mut Near, chunk: &Chunk, rows: &[usize]) {
        if rows.is_empty() {
            return;
        }
        let columns: Vec<&[f64]> = (0..self.separators.dimensions).map(|column| chunk.column(column)).collect();
        for &row in rows {
            near.u.extend(columns.iter().map(|column| column[row]).chain([1.0]));
        }
        let (from, regions) = (near.costs.len(), self.separators.regions);
        near.costs.resize(from + rows.len() * regions, 0.0);
        let mut errors = vec![0.0; chunk.rows];
        for region in 0..regions {
            chunk.errors(&self.maps, region as u32, &self.variance, &mut errors);
            let costs = near.costs[from..].iter_mut().skip(region).step_by(regions);
            costs.zip(rows).for_each(|(cost, &row)| *cost = chunk.weight(row) * errors[row]);
        }
    }
}

/// Rows that stand for more.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// Their share of all rows.
    pub(crate) share: f64,
    /// Partitions whose borders are drawn together by a pass over all rows.
    pub(crate) borders: usize,
}

/// Borders that a sample of the rows has drawn, and all rows draw better.
pub(crate) struct Open {
    look: Look,
    margin: f64,
    /// The squared error of the sample, a unit of weight.
    error: f64,
}

impl Open {
    /// Of separators that were refined on a sample; none where all of its rows are near borders, or there is one region.
    pub(super) fn new(examples: &Examples, separators: &Separators, sample: Sample) -> Option<Self> {
        let wanted =
            near_rows(separators).min(NUMBERS / (sample.borders * (separators.dimensions + 1 + separators.regions)));
        let near = (wanted as f64 * sample.share) as usize;
        if separators.regions < 2 || near == 0 {
            return None;
        }
        let state = State::of(examples, separators.clone());
        let margin = state.margin(examples, near)?;
        Some(Self { margin, error: state.error / examples.weight, look: state.look })
    }

    /// No rows yet.
    pub(crate) fn begin(&self) -> Near {
        Near { margin: Some(self.margin), ..Near::new(self.look.separators.dimensions) }
    }

    /// Adds the rows of a tile that are near: columns as [`Chunk::new`] has them.
    pub(crate) fn gather(&self, near: &mut Near, columns: &[&[f64]], shape: Shape, units: (&[f64], &[f64])) {
        let rows = columns.first().map_or(0, |column| column.len());
        let places = Chunk::places(&columns[..shape.0], units, rows);
        near.see(&places);
        let margins = self.look.margins(&places);
        let wanted: Vec<usize> = (0..rows).filter(|&row| margins[row] < self.margin).collect();
        let of = |column: &&[f64]| wanted.iter().map(|&row| column[row]).collect();
        let chosen: Vec<Vec<f64>> = columns.iter().map(of).collect();
        let chunk = Chunk::new(&chosen, shape, units, 0..wanted.len());
        self.look.add(near, &chunk, &(0..wanted.len()).collect::<Vec<_>>());
    }

    /// The separators that the rows near the borders ask for, of all rows of so much weight.
    pub(crate) fn closed(self, near: &Near, weight: f64) -> Rule {
        let (before, sizes) = (self.error * weight, (weight, self.look.variance.len()));
        let (moved, fall) = near.searched(self.look.separators.clone());
        let separators = self.look.separators;
        let pays = weight > 0.0 && pays((before, (before - fall).max(0.0)), sizes, &separators);
        super::rule(if pays { &moved } else { &separators })
    }
}

/// Rows near borders.
pub(crate) struct Near {
    /// Partition columns and 1, by rows.
    u: Vec<f64>,
    /// The weighted squared error of every region's map, by rows.
    costs: Vec<f64>,
    /// The greatest of the partition columns, and 1, over all rows that were seen.
    largest: Vec<f64>,
    /// Least margin between the two best scores among rows that are not near; `None` if all are near.
    margin: Option<f64>,
}

impl Near {
    fn new(dimensions: usize) -> Self {
        let largest = (0..dimensions).map(|_| 0.0).chain([1.0]).collect();
        Self { u: Vec::new(), costs: Vec::new(), largest, margin: None }
    }

    fn see(&mut self, chunk: &Chunk) {
        let columns = self.largest.len() - 1;
        for (column, most) in self.largest[..columns].iter_mut().enumerate() {
            *most = chunk.column(column).iter().fold(*most, |most, z| most.max(z.abs()));
        }
    }

    /// Adds the rows that follow.
    pub(crate) fn merge(&mut self, next: Self) {
        self.u.extend(next.u);
        self.costs.extend(next.costs);
        self.largest.iter_mut().zip(next.largest).for_each(|(most, largest)| *most = most.max(largest));
    }

    /// The separators after all lines are searched, until none lowers the error; by how much it falls.
    fn searched(&self, mut separators: Separators) -> (Separators, f64) {
        let (regions, width) = (separators.regions, separators.dimensions + 1);
        let mut scores: Vec<f64> = self.u.chunks_exact(width).flat_map(|u| separators.of_row(u)).collect();
        let cost_of = |(scores, costs): (&[f64], &[f64])| {
            costs[(1..regions).fold(0, |best, region| if scores[region] > scores[best] { region } else { best })]
        };
        let total: f64 = scores.chunks_exact(regions).zip(self.costs.chunks_exact(regions)).map(cost_of).sum();
        let greatest = scores.iter().fold(1.0f64, |most, score| most.max(score.abs()));
        let (mut fallen, mut left) = (0.0, self.margin.unwrap_or(FARTHEST * greatest));
        let (rows, dimensions) = (scores.len() / regions, separators.dimensions);
        let mut gaps = vec![(0, 0.0); rows];
        let mut along = vec![0.0; rows];
        for sweep in 0..SWEEPS {
            let before = fallen;
            for region in 0..regions {
                let mut lines = self.directions(region, &scores, regions);
                if dimensions <= OBLIQUE {
                    lines.extend(oblique(&lines, (sweep * regions + region) as u64));
                }
                // Other regions stand still meanwhile.
                for (gap, scores) in gaps.iter_mut().zip(scores.chunks_exact(regions)) {
                    let other = second(scores, region);
                    *gap = (other, scores[other] - scores[region]);
                }
                for direction in lines {
                    along.iter_mut().zip(self.u.chunks_exact(width)).for_each(|(along, u)| *along = dot(u, &direction));
                    let most: f64 = direction.iter().zip(&self.largest).map(|(g, most)| g.abs() * most).sum();
                    let (fall, step) = self.step((region, regions), &gaps, &along, left / most);
                    if fall > 0.0 {
                        (fallen, left) = (fallen + fall, left - step.abs() * most);
                        separators.push(region, &direction, step);
                        let scores = scores.iter_mut().skip(region).step_by(regions);
                        for ((score, gap), along) in scores.zip(&mut gaps).zip(&along) {
                            *score += step * along;
                            gap.1 -= step * along;
                        }
                    }
                }
            }
            if fallen - before <= LEAST_FALL * (total - fallen) {
                break;
            }
        }
        (separators, fallen)
    }

    /// Directions in which the rows between a region and the next do not go together, each with a mean square of 1 over them.
    fn directions(&self, region: usize, scores: &[f64], regions: usize) -> Vec<Vec<f64>> {
        let width = self.largest.len();
        let mut gram = Mat::<f64>::zeros(width, width);
        let mut count = 0.0;
        for (u, scores) in self.u.chunks_exact(width).zip(scores.chunks_exact(regions)) {
            let better = scores.iter().filter(|score| **score > scores[region]).count();
            if better <= 1 {
                count += 1.0;
                for i in 0..width {
                    for j in 0..=i {
                        gram[(i, j)] += u[i] * u[j];
                    }
                }
            }
        }
        // A column that does not change along the border has no direction of its own.
        let floor = 1e-9 * (0..width).map(|i| gram[(i, i)]).fold(0.0, f64::max);
        (0..width).for_each(|i| gram[(i, i)] += floor);
        let Ok(factor) = gram.llt(Side::Lower) else { return Vec::new() };
        let lower = factor.L();
        // Columns of the inverse of L': the first is the last column alone.
        (0..width)
            .rev()
            .map(|at| {
                let mut column = vec![0.0; width];
                column[at] = 1.0 / lower[(at, at)];
                for i in (0..at).rev() {
                    let sum: f64 = (i + 1..=at).map(|j| lower[(j, i)] * column[j]).sum();
                    column[i] = -sum / lower[(i, i)];
                }
                column.iter_mut().for_each(|value| *value *= f64::sqrt(count));
                column
            })
            .collect()
    }

    /// By how much the error falls at the most, and how far a region's separator moves along a direction to there.
    fn step(
        &self,
        (region, regions): (usize, usize),
        gaps: &[(usize, f64)],
        along: &[f64],
        longest: f64,
    ) -> (f64, f64) {
        let mut passes: [Vec<(f64, f64)>; 2] = [Vec::new(), Vec::new()];
        for ((&(other, gap), costs), &along) in gaps.iter().zip(self.costs.chunks_exact(regions)).zip(along) {
            let at = gap / along;
            if at.abs() <= longest && at != 0.0 {
                let inward = (along > 0.0) == (at > 0.0);
                let change = if inward { costs[region] - costs[other] } else { costs[other] - costs[region] };
                passes[usize::from(at < 0.0)].push((at.abs(), change));
            }
        }
        let [(up, forth), (down, back)] = passes.map(|passes| least(passes, longest));
        if up <= down { (-up, forth) } else { (-down, -back) }
    }
}

/// As many random directions between the given ones. Along its axes alone a search of steps stops where a border has to
/// move and to turn at once.
fn oblique(directions: &[Vec<f64>], key: u64) -> Vec<Vec<f64>> {
    let uniform = |draw: usize| (mix(mix(key).wrapping_add(draw as u64)) >> 11) as f64 * 2f64.powi(-52) - 1.0;
    let one = |at: usize| {
        let mut sum = vec![0.0; directions[at].len()];
        for (other, direction) in directions.iter().enumerate() {
            let share = uniform(at * directions.len() + other);
            sum.iter_mut().zip(direction).for_each(|(sum, direction)| *sum += share * direction);
        }
        sum
    };
    (0..directions.len()).map(one).collect()
}

/// The least sum of changes on the way, and where it is: in the middle between two passing rows.
fn least(mut passes: Vec<(f64, f64)>, longest: f64) -> (f64, f64) {
    passes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut best, mut sum) = ((0.0, 0.0), 0.0);
    for (i, &(at, change)) in passes.iter().enumerate() {
        sum += change;
        let next = passes.get(i + 1).map_or_else(|| longest.min(1.01 * at), |next| next.0);
        if sum < best.0 && next > at {
            best = (sum, 0.5 * (at + next));
        }
    }
    best
}

/// The other region of the greatest score.
fn second(scores: &[f64], but: usize) -> usize {
    let other = (0..scores.len()).filter(|&region| region != but);
    other.reduce(|best, region| if scores[region] > scores[best] { region } else { best }).unwrap_or(but)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::tests::{rows_of, waves};
    use proptest::prelude::*;

    fn separators(table: Vec<f64>) -> Separators {
        Separators { regions: table.len() / 3, dimensions: 2, table }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn error_never_rises_and_matches_regions(table in prop::collection::vec(-3.0..3.0f64, 9), rows in 40usize..400) {
            let examples = rows_of(&waves(rows));
            let before = State::of(&examples, separators(table.clone())).error;
            let (error, costs) = exact(&examples, separators(table));
            prop_assert!(error <= before);
            prop_assert_eq!(error, State::of(&examples, costs).error);
        }

        /// The sums of passing rows equal the costs of all rows by their winners. A row that a border passes within
        /// rounding may count on either side.
        #[test]
        fn predicted_fall_equals_the_fall_of_the_costs(table in prop::collection::vec(-3.0..3.0f64, 9), rows in 40usize..200) {
            let examples = rows_of(&waves(rows));
            let state = State::of(&examples, separators(table));
            let near = state.near(&examples);
            let costs = |separators: &Separators| -> [f64; 2] {
                let rows = near.u.chunks_exact(3).zip(near.costs.chunks_exact(3));
                let of_row = |(u, costs): (&[f64], &[f64])| {
                    let scores = separators.of_row(u);
                    let best = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                    let rounding = 1e-12 * (1.0 + scores.iter().map(|score| score.abs()).fold(0.0, f64::max));
                    let winners = || (0..3).filter(|&region| scores[region] >= best - rounding).map(|region| costs[region]);
                    [winners().fold(f64::INFINITY, f64::min), winners().fold(f64::NEG_INFINITY, f64::max)]
                };
                rows.map(of_row).fold([0.0; 2], |sum, cost| [sum[0] + cost[0], sum[1] + cost[1]])
            };
            let (separators, fall) = near.searched(state.look.separators.clone());
            let (before, after) = (costs(&state.look.separators), costs(&separators));
            let tolerance = 1e-9 * (1.0 + before[1]);
            let range = before[0] - after[1] - tolerance..=before[1] - after[0] + tolerance;
            prop_assert!(range.contains(&fall), "{:?} {:?} {}", before, after, fall);
        }
    }

    /// Row 0 lies at x = 0: a direction along x alone never moves it past a border.
    #[test]
    fn unmoved_row_gives_finite_separators() {
        let examples = rows_of(&waves(168));
        let table = [2.7579634409923792, -2.103920767363529, 0.0, -2.6265179614664587, 0.6167634672702993];
        let rest = [-1.8092079364231335, -0.32889448789607145, -1.7533015107123253, 0.0];
        let state = State::of(&examples, separators([&table[..], &rest].concat()));
        let (separators, _) = state.near(&examples).searched(state.look.separators.clone());
        assert!(separators.table.iter().all(|value| value.is_finite()), "{:?}", separators.table);
    }

    #[test]
    fn the_border_lies_between_the_rows_of_a_jump() {
        // y jumps at x = 0.3; no two rows have the same x.
        let row = |at: usize| {
            let x = -1.0 + at as f64 / 250.0;
            [x, (at as f64 * 0.7).sin(), if x < 0.3 { x } else { 2.0 - x }]
        };
        let rows: Vec<[f64; 3]> = (0..500).map(row).collect();
        let examples = rows_of(&rows);
        // The border begins at 0.1, and obliquely.
        let (error, costs) = exact(&examples, separators(vec![-1.0, 0.05, 0.1, 1.0, 0.0, -0.1]));
        // A sum of 500 squares of values of order 1, each subtraction rounded.
        assert!(error < 500.0 * 16.0 * f64::EPSILON, "{error}");
        for row in rows {
            let scores = costs.of_row(&[row[0], row[1], 1.0]);
            assert_eq!(scores[1] > scores[0], row[0] >= 0.3, "{row:?}: {scores:?}");
        }
    }

    #[test]
    fn noise_is_no_reason_to_move_a_border() {
        let uniform = |key: u64| mix(key) as f64 / u64::MAX as f64 - 0.5;
        let row = |at: u64| [uniform(3 * at), uniform(3 * at + 1), uniform(3 * at + 2)];
        let examples = rows_of(&(0..500).map(row).collect::<Vec<_>>());
        let separators = separators(vec![-1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        assert_eq!(exact(&examples, separators.clone()).1, separators);
    }
}
