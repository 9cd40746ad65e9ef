//! The passes: maps, their error, separators, regions, each the best for the present others.

use fleetfoot_data::{Cancelled, Progress};
use fleetfoot_stats::ridge;

use super::separators::{Probabilities, Separators};
use crate::{
    examples::{Chunk, Examples},
    region_model::RegionModel,
    residual::Maps,
};

/// Rows of the one map of all that every region has seen beside its own.
const PULL: f64 = 1.0;
/// Penalty of the separators: one over the variance of their weights.
const PENALTY: f64 = 0.1;
/// The same with sharp borders: regions without overlap are separated exactly.
const SHARP: f64 = 1e-4;
/// Passes at most.
const PASSES: usize = 25;
/// A pass that lowers the objective by less ends the descent.
const LEAST_FALL: f64 = 1e-5;
/// Newton's steps of a pass, and at the end.
const STEPS: usize = 3;
const LAST_STEPS: usize = 20;
/// Errors of maps below this share of a standard deviation are rounding (squared).
pub(super) const LEAST_ERROR: f64 = 1e-20;

/// The state of a descent.
pub(super) struct Descent<'a> {
    examples: &'a Examples,
    /// The region of every row, by chunk.
    labels: Vec<Vec<u32>>,
    separators: Separators,
}

impl<'a> Descent<'a> {
    pub(super) fn new(examples: &'a Examples, labels: Vec<Vec<u32>>, separators: Separators) -> Self {
        Self { examples, labels, separators }
    }

    /// Passes until the objective hardly falls; the objective after every pass.
    pub(super) fn run(&mut self, progress: &dyn Progress) -> Result<Vec<f64>, Cancelled> {
        let mut objective: Vec<f64> = Vec::new();
        for pass in 0..PASSES {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            let (value, moved) = self.pass();
            progress.advance(1, PASSES);
            let fall = objective.last().map_or(f64::INFINITY, |last| last - value);
            objective.push(value);
            if !moved || (pass > 0 && fall < LEAST_FALL) {
                break;
            }
        }
        Ok(objective)
    }

    /// The separators in the end, as they were penalised and hardly penalised.
    pub(super) fn ends(&self) -> [Separators; 2] {
        let mut plain = self.separators.clone();
        plain.improve(self.examples, &self.labels, PENALTY, LAST_STEPS);
        let mut sharp = plain.clone();
        sharp.improve(self.examples, &self.labels, SHARP, LAST_STEPS);
        [plain, sharp]
    }

    /// One pass: the objective after it, and whether a row changed its region.
    fn pass(&mut self) -> (f64, bool) {
        let (models, error, pull) = self.fit();
        let (examples, q) = (self.examples, self.examples.targets as f64);
        let square = ((error + pull) / (examples.weight * q)).max(LEAST_ERROR);
        self.separators.improve(examples, &self.labels, PENALTY, STEPS);
        let (cost, moved) = self.assign(&models, square);
        let maps = 0.5 * pull / (square * examples.weight) + 0.5 * q * square.ln();
        (cost + maps + self.separators.penalty(examples, PENALTY), moved)
    }

    /// The maps of the regions, the squared error of their rows, and their penalty for leaving the one map of all.
    fn fit(&self) -> (Vec<RegionModel>, f64, f64) {
        let (examples, base) = (self.examples, &self.examples.base);
        let (mut error, mut pull) = (0.0, 0.0);
        let grams = examples.grams(&self.labels, self.separators.regions);
        let models = grams.iter().map(|gram| {
            if gram.weight <= 0.0 {
                return base.average.clone();
            }
            let root = examples.root(gram);
            let prior = base.average.coefficients.as_ref();
            let solution = ridge(&root, &base.scale, PULL / root.weight, Some(prior));
            error += examples.scaled(&solution.rss);
            let left = &solution.coefficients - prior;
            let square = |t: usize| base.scale.iter().enumerate().map(|(j, s)| (s * left[(j, t)]).powi(2)).sum::<f64>();
            pull += PULL * examples.scaled(&(0..examples.targets).map(square).collect::<Vec<f64>>());
            RegionModel::new(solution)
        });
        (models.collect(), error, pull)
    }

    /// Gives every row the region that costs it least; the mean cost, and whether one moved.
    fn assign(&mut self, models: &[RegionModel], square: f64) -> (f64, bool) {
        let (examples, separators) = (self.examples, &self.separators);
        let maps = examples.maps(models);
        let assigned = examples.map(|_, chunk| cheapest(examples, chunk, separators, &maps, square));
        let total: f64 = assigned.iter().map(|(_, cost)| cost).sum();
        let labels: Vec<Vec<u32>> = assigned.into_iter().map(|(labels, _)| labels).collect();
        let moved = labels != self.labels;
        self.labels = labels;
        (total / examples.weight, moved)
    }
}

/// The region that costs each row of a chunk least, the first of equal ones; the weighted sum of the costs.
fn cheapest(examples: &Examples, chunk: &Chunk, separators: &Separators, maps: &Maps, square: f64) -> (Vec<u32>, f64) {
    let probabilities = Probabilities::new(separators.scores(chunk), chunk.rows);
    let (mut labels, mut least) = (vec![0; chunk.rows], vec![f64::INFINITY; chunk.rows]);
    let mut errors = vec![0.0; chunk.rows];
    for region in 0..separators.regions {
        examples.errors(chunk, maps, region as u32, &mut errors);
        for (row, error) in errors.iter().enumerate() {
            let cost = 0.5 * error / square - probabilities.logarithm(region, row);
            if cost < least[row] {
                (labels[row], least[row]) = (region as u32, cost);
            }
        }
    }
    let total = least.iter().enumerate().map(|(row, cost)| chunk.weight(row) * cost).sum();
    (labels, total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::tests::{rows_of, waves};
    use fleetfoot_data::Silent;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn the_objective_falls_in_every_pass(seed in 0u64..1000, regions in 2usize..7, rows in 40usize..400) {
            let examples = rows_of(&waves(rows));
            let label = |row: usize| (fleetfoot_data::mix(seed ^ row as u64) % regions as u64) as u32;
            let labels: Vec<Vec<u32>> = examples.map(|_, chunk| (0..chunk.rows).map(label).collect());
            let objective = Descent::new(&examples, labels, Separators::zero(regions, 2)).run(&Silent).unwrap();
            // Rounding error of sums of some hundred rows.
            prop_assert!(objective.windows(2).all(|pair| pair[1] <= pair[0] + 1e-10 * (1.0 + pair[0].abs())), "{:?}", objective);
        }
    }
}
