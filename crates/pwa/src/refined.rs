//! Regions that fit the dynamics: refined partitions.
//!
//! k-means puts regions where rows are dense. Here a region is a set of rows that one affine map fits, and that the
//! partition columns separate from the others. After Bemporad, "A Piecewise Linear Regression and Classification
//! Algorithm with Application to Learning and Model Predictive Control of Hybrid Systems" (PARC, IEEE Trans. Automatic
//! Control 2023): with the region `l_i` of every row, the map of every region and separators `w_k . z + b_k`,
//!
//! `1/V sum_i v_i [ |e_i|^2 / (2 tau^2) + ln sum_k exp(w_k . z_i + b_k) - (w_l . z_i + b_l) ] + q ln tau + pull + penalty`
//!
//! is minimised over one of them at a time, so that it falls in every pass. The passes are maps by exact least squares
//! on the regions' Gram matrices, tau^2 by the mean squared error, separators by Newton's method (`separators`), and
//! regions row by row. `e_i` is the error of the row's region in units of the targets' standard deviations, over q
//! targets; `v_i` are weights and V their sum. PARC's weight between error and separation is `2 tau^2`. With it the
//! objective is the negative logarithm of the likelihood of a mixture of experts with known regions (Jordan and Jacobs,
//! "Hierarchical mixtures of experts and the EM algorithm", 1994), and needs no tuning.
//!
//! Every region behaves as if it had seen `PULL` more rows that obey the one map of all, so that a starved region has a
//! map. Separators are penalised as if each weight had been drawn from a normal distribution of variance `1/PENALTY`.
//! In the end borders are drawn by the error itself ([`exact`](mod@exact)), and the region is that of the greatest
//! `w_k . z + b_k`. Regions with too few rows for a map are given up, and their rows go to their second choice.

mod descent;
mod exact;
mod separators;
mod start;

use std::collections::{BTreeMap, btree_map::Entry};

use fleetfoot_data::{Progress, Silent, mix, parallel_map};
use fleetfoot_model::Rule;

use crate::{
    Error,
    examples::{Examples, Shape},
};
use descent::{Descent, LEAST_ERROR};
use exact::exact;
pub(crate) use exact::{Near, Open, Sample};
use separators::Separators;
use start::{Joined, Start, by_kmeans, by_maps, cells};

/// Numbers in all separators of a partition, at most: their Hessian takes 8 bytes for each pair of them.
const LIMIT: usize = 4096;

/// Numbers of regions whose separators may be the borders of a lattice.
const BORDERS: [usize; 3] = [5, 10, 20];

/// Rows that several starts may go through together, and starts at most: few rows leave much to chance, and cost little.
const STARTED: usize = 2048;
const STARTS: usize = 16;

/// Starts from maps of neighbours, times the square of the rows, and at most (two a row are enough, too): with some
/// hundred rows the most depends on chance.
const BY_MAPS: usize = 1 << 20;
const MOST_BY_MAPS: usize = 128;
/// Descents that are followed to their end, of least objective.
const ENDS: usize = 16;
/// Of few rows, the ends of descents whose borders are sharpened, to see which one is the best.
const SHARPENED: usize = 8;
/// Rows up to which it is so many.
const SHARPENED_ROWS: usize = 128;

/// Rows on which starts are compared if there are many: the best goes on with all.
const FEW: usize = 8192;
/// The same, of each region and number of its map.
const FEW_OF_A_REGION: usize = 16;

/// Separators that were found, and how.
pub(crate) struct Refined {
    pub(crate) rule: Rule,
    /// The objective after every pass.
    pub(crate) objective: Vec<f64>,
    /// Borders that a pass over all rows is to decide, if they come from a sample.
    pub(crate) open: Option<Open>,
}

/// Rows to refine regions on, and the joined cells that refinements begin with, whatever the number of regions.
pub(crate) struct Ground {
    examples: Examples,
    /// Some of them, evenly, where there are many.
    few: Option<Examples>,
    seed: u64,
    /// By the number of rows, that of cells, and the seed.
    joined: BTreeMap<(usize, usize, u64), Joined>,
}

impl Ground {
    /// On some rows of columns ([`Examples::new`]); `None` where none weigh anything.
    pub(crate) fn new(
        columns: &[Vec<f64>],
        shape: Shape,
        units: (&[f64], &[f64]),
        rows: &[usize],
        seed: u64,
    ) -> Option<Self> {
        let every = rows.len() / FEW;
        let some = || rows.iter().copied().step_by(every).collect::<Vec<usize>>();
        let few = (every > 1).then(|| Examples::new(columns, shape, units, &some())).flatten();
        Some(Self { examples: Examples::new(columns, shape, units, rows)?, few, seed, joined: BTreeMap::new() })
    }

    /// Refines `regions` regions from joined cells and from k-means, several times if rows are few. The result is the
    /// one whose regions, as drawn by their separators, fit best. With many rows, it is found on few of them and then
    /// refined on all. If these are a `sample`, a pass over all rows may draw the borders.
    ///
    /// # Errors
    /// More separators than their Hessian has room for; cancelled.
    pub(crate) fn refine(
        &mut self,
        regions: usize,
        sample: Option<Sample>,
        progress: &dyn Progress,
    ) -> Result<Refined, Error> {
        let begun = self.begun(regions, progress)?;
        self.finished(begun, sample, progress)
    }

    /// The best of several starts, on few of the rows where there are many.
    fn begun(&mut self, regions: usize, progress: &dyn Progress) -> Result<Begun, Error> {
        let (examples, d) = (&self.examples, self.examples.dimensions);
        if regions * (d + 1) > LIMIT {
            return Err(Error::TooManySeparators { regions, columns: d, limit: LIMIT });
        }
        let regions = regions.min(examples.rows / (examples.regressors + 2));
        if regions < 2 || d == 0 {
            return Ok(Begun { separators: Separators::zero(1, d), objective: Vec::new(), few: false });
        }
        let enough = |few: &&Examples| few.rows >= regions * (few.regressors + 2) * FEW_OF_A_REGION;
        let few = self.few.as_ref().filter(enough);
        let examples = few.unwrap_or(&self.examples);
        let mut starts = Vec::new();
        for start in 0..(STARTED / examples.rows).clamp(1, STARTS) {
            let seed = self.seed.wrapping_add(start as u64);
            // Of few rows it is not known how large cells should be.
            let cells = (cells(examples, regions) * (1 + start % 3)).min(examples.rows);
            let joined = match self.joined.entry((examples.rows, cells, seed)) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(place) => place.insert(Joined::new(examples, cells, seed, progress)?),
            };
            starts.extend(joined.starts(regions, d));
            starts.extend(by_kmeans(examples, regions, seed, progress)?);
        }
        let maps = (BY_MAPS / (examples.rows * examples.rows)).min(2 * examples.rows).min(MOST_BY_MAPS) as u64;
        starts.extend((0..maps).map(|draw| by_maps(examples, regions, mix(self.seed).wrapping_add(draw))));
        let (separators, objective) = descended(examples, starts, progress)?;
        Ok(Begun { separators, objective, few: few.is_some() })
    }

    /// Completes a refinement that was begun, on all rows.
    fn finished(&self, begun: Begun, sample: Option<Sample>, progress: &dyn Progress) -> Result<Refined, Error> {
        let Begun { mut separators, mut objective, few } = begun;
        if few && separators.regions > 1 {
            let start = (separators.winners(&self.examples), separators);
            (separators, objective) = descended(&self.examples, vec![start], progress)?;
        }
        let separators = separators.ordered(&self.examples);
        let open = sample.and_then(|sample| Open::new(&self.examples, &separators, sample));
        Ok(Refined { rule: rule(&separators), objective, open })
    }

    /// Borders between which maps hold: those of as many regions, among [`BORDERS`], as the Bayesian information
    /// criterion chooses. Many rows are thinned out.
    ///
    /// # Errors
    /// Cancelled.
    pub(crate) fn borders(&mut self, progress: &dyn Progress) -> Result<Rule, Error> {
        let mut best: Option<(f64, Begun)> = None;
        for regions in BORDERS {
            let begun = self.begun(regions.min(LIMIT / (self.examples.dimensions + 1)), progress)?;
            let criterion = criterion(self.few.as_ref().unwrap_or(&self.examples), &begun.separators);
            if best.as_ref().is_none_or(|(least, _)| criterion < *least) {
                best = Some((criterion, begun));
            }
        }
        best.map_or(Ok(Rule::Whole), |(_, separators)| Ok(self.finished(separators, None, progress)?.rule))
    }
}

/// Separators that were found, and whether on few of the rows.
struct Begun {
    separators: Separators,
    objective: Vec<f64>,
    few: bool,
}

/// The Bayesian information criterion of the regions that separators draw, each with a separate map.
fn criterion(examples: &Examples, separators: &Separators) -> f64 {
    let grams = examples.grams(&separators.winners(examples), separators.regions);
    let (rows, q) = (examples.weight, examples.targets as f64);
    let square = grams.iter().map(|gram| examples.error(gram)).sum::<f64>() / (rows * q);
    let numbers = q * (examples.regressors + 1) as f64 + (examples.dimensions + 1) as f64;
    rows * q * square.max(f64::MIN_POSITIVE).ln() + separators.regions as f64 * numbers * rows.ln()
}

/// The best separators among the ends of descents from some starts, and the objective on the way there. Only the best
/// few take the last step.
fn descended(
    examples: &Examples,
    starts: Vec<Start>,
    progress: &dyn Progress,
) -> Result<(Separators, Vec<f64>), Error> {
    // Of few rows a pass leaves nothing to divide; descents do not know of each other.
    let mut descents = parallel_map(starts.len(), &Silent, |at| -> Result<_, Error> {
        let (labels, separators) = starts[at].clone();
        let mut descent = Descent::new(examples, labels, separators);
        let objective = descent.run(progress)?;
        Ok((descent, objective))
    })?;
    drop(starts);
    if descents.len() > ENDS {
        let last = |objective: &[f64]| objective.last().copied().unwrap_or(f64::INFINITY);
        descents.sort_by(|a, b| last(&a.1).total_cmp(&last(&b.1)));
        descents.truncate(ENDS);
    }
    // Of errors that are all rounding the first stays the first: sorts are stable.
    let rounding = LEAST_ERROR * examples.weight * examples.targets as f64;
    let ends = parallel_map(descents.len(), &Silent, |at| -> Result<_, Error> {
        Ok(descents[at].0.ends().map(|separators| settled(examples, separators)))
    })?;
    let mut candidates: Vec<(f64, Separators, Vec<f64>)> = Vec::new();
    for ((_, objective), ends) in descents.into_iter().zip(ends) {
        candidates.extend(ends.map(|(error, separators)| (error.max(rounding), separators, objective.clone())));
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    candidates.truncate((SHARPENED * SHARPENED_ROWS / examples.rows).clamp(1, SHARPENED));
    let mut best = (f64::INFINITY, Separators::zero(1, examples.dimensions), Vec::new());
    let sharpened =
        parallel_map(candidates.len(), &Silent, |at| Ok::<_, Error>(exact(examples, candidates[at].1.clone())))?;
    for ((error, separators), (.., objective)) in sharpened.into_iter().zip(candidates) {
        let error = error.max(rounding);
        if error < best.0 {
            best = (error, separators, objective);
        }
    }
    Ok((best.1, best.2))
}

/// Gives up regions that have too few rows for a map. Returns the remaining squared error, with regions drawn by the
/// separators.
fn settled(examples: &Examples, mut separators: Separators) -> (f64, Separators) {
    let least = examples.regressors as u64 + 2;
    loop {
        let grams = examples.grams(&separators.winners(examples), separators.regions);
        let fewest = (0..grams.len()).min_by_key(|&region| grams[region].rows).unwrap_or(0);
        if separators.regions == 1 || grams[fewest].rows >= least {
            return (grams.iter().map(|gram| examples.error(gram)).sum(), separators);
        }
        let kept: Vec<usize> = (0..separators.regions).filter(|&region| region != fewest).collect();
        separators = separators.only(&kept);
    }
}

fn rule(separators: &Separators) -> Rule {
    let (weights, offsets) = separators.rows().map(|(weights, offset)| (weights.to_vec(), offset)).unzip();
    Rule::Linear { weights, offsets }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::tests::rows_of;

    fn uniform(at: u64) -> f64 {
        2.0 * (mix(mix(at)) >> 11) as f64 * 2f64.powi(-53) - 1.0
    }

    #[test]
    fn joined_cells_are_the_better_start() {
        let functions: [fn(f64, f64) -> f64; 4] = [
            |x, y| (4.0 * x - 5.0 * y * y).sin() + 2.0 * y,
            |x, y| (x.abs() - 0.3 * y).max(0.8 * y + 0.2),
            |x, y| x.signum() * (0.5 + 0.3 * y),
            |x, y| (x + y).max(y - x).max(-0.5 * y),
        ];
        let mut sums = [0.0; 2];
        for (number, f) in functions.into_iter().enumerate() {
            let row = |at: u64| {
                let (x, y) = (uniform(2 * at), uniform(2 * at + 1));
                [1.7 * x, 1.7 * y, f(x, y)]
            };
            let rows: Vec<[f64; 3]> = (0..800).map(|at| row(at + 1000 * number as u64)).collect();
            let examples = rows_of(&rows);
            let joined = Joined::new(&examples, cells(&examples, 5), 0, &Silent).unwrap();
            let starts = [joined.starts(5, 2).swap_remove(0), by_kmeans(&examples, 5, 0, &Silent).unwrap().unwrap()];
            let errors = starts.map(|(labels, separators)| {
                let mut descent = Descent::new(&examples, labels, separators);
                descent.run(&Silent).unwrap();
                let [plain, sharp] = descent.ends();
                settled(&examples, plain).0.min(settled(&examples, sharp).0)
            });
            sums.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error);
        }
        // Not for every function, but over all.
        assert!(sums[0] < sums[1], "{sums:?}");
    }

    #[test]
    fn refined_regions_do_not_depend_on_other_partitions() {
        let rows = crate::examples::tests::waves(500);
        let column = |j: usize| rows.iter().map(|row| row[j]).collect::<Vec<f64>>();
        let (columns, all) = ([0, 1, 0, 1, 2].map(column), (0..rows.len()).collect::<Vec<usize>>());
        let ground = || Ground::new(&columns, (2, 2, 1), (&[0.0; 2], &[1.0; 2]), &all, 3).unwrap();
        let mut together = ground();
        for regions in [2, 5, 3] {
            let alone = ground().refine(regions, None, &Silent).unwrap();
            let refined = together.refine(regions, None, &Silent).unwrap();
            assert_eq!((refined.rule, refined.objective), (alone.rule, alone.objective));
        }
    }
}
