//! fleetfoot's fits of one recording: one pass, then everything from the statistic.

use faer::Mat;
use fleetfoot::{
    Silent,
    data::{Source, mix},
    library::{CentralDifference, Expr, Spacing, central_difference},
    sparse::{
        select::Folds,
        threshold::{
            EnsembleOptions, FoldProblem, Optimizer, Stlsq, SweepOptions, Terms, Thresholds, ensemble, optimize, sweep,
        },
    },
    stats::{Compressed, Fold, FoldRule, Key, Purge, blocks},
    sums::system::{System, SystemPlan, SystemScan, Unit, sampled_mean_squares},
};

use super::{Failure, candidates::Candidates, recordings::Recorded};

/// Parts of the episodes that are held out in turn: with ten of them, each alone.
const FOLDS: usize = 10;
/// Models of an ensemble, and the share of them that must have a term.
pub(crate) const REPLICATES: usize = 100;
pub(crate) const PROBABILITY: f64 = 0.8;

/// A recording behind its statistic.
pub(crate) struct Prepared {
    rows: Compressed,
    /// None where there are fewer episodes than folds.
    folds: Vec<FoldProblem>,
    scan: SystemScan,
    constant: bool,
}

impl Prepared {
    /// Scans a recording: derivatives are columns where they are known, else central differences of the states.
    pub(crate) fn new(names: &[&str], recorded: &Recorded, candidates: &Candidates) -> Result<Self, Failure> {
        let source = recorded.source(names);
        let target = |name: &&str| match recorded.derivatives {
            Some(_) => Expr::column(format!("d_{name}")),
            None => central_difference(&Expr::column(*name), false),
        };
        let targets = names[..recorded.targets()].iter().map(target).collect();
        let system = System::new(candidates.functions.clone(), targets);
        let resolution = match recorded.derivatives {
            Some(_) => vec![0.0; recorded.targets()],
            None => resolution(&names[..recorded.targets()], &source)?,
        };
        let scan = SystemPlan::new(system, None, &source)?.scan(&source, &Silent)?;
        let constant = candidates.constant;
        let folds = if recorded.states.len() < FOLDS { Vec::new() } else { folds(&scan, constant, &resolution)? };
        Ok(Self { rows: scan.root(0).compressed(constant).known_to(&resolution), folds, scan, constant })
    }

    /// Sequentially thresholded least squares with pysindy's options, at every threshold: coefficients of every equation.
    pub(crate) fn stlsq(&self, thresholds: &[f64], ridge: f64) -> Result<Vec<Vec<Vec<f64>>>, Failure> {
        let at = |&threshold: &f64| self.all(&Optimizer::Stlsq(Stlsq { threshold, alpha: ridge, ..Stlsq::default() }));
        thresholds.iter().map(at).collect()
    }

    /// Least squares on all candidates.
    pub(crate) fn least_squares(&self) -> Result<Vec<Vec<f64>>, Failure> {
        self.all(&Optimizer::LeastSquares)
    }

    fn all(&self, optimizer: &Optimizer) -> Result<Vec<Vec<f64>>, Failure> {
        let one = |target| Ok(optimize(&self.rows, target, optimizer, &Terms::all())?.choice().coefficients.clone());
        (0..self.rows.targets()).map(one).collect()
    }

    /// The same with the threshold, equation by equation, that held-out episodes choose.
    pub(crate) fn chosen(&self, thresholds: &[f64], ridge: f64) -> Result<Vec<Vec<f64>>, Failure> {
        let optimizer = Optimizer::Stlsq(Stlsq { alpha: ridge, ..Stlsq::default() });
        let options = SweepOptions { thresholds: Thresholds::List(thresholds.to_vec()), ..SweepOptions::default() };
        let terms = vec![Terms::all(); self.rows.targets()];
        let sweeps = sweep(&self.rows, &self.folds, &terms, &optimizer, &options, &Silent)?;
        Ok(sweeps.iter().map(|sweep| sweep.choice().coefficients.clone()).collect())
    }

    /// STLSQ at one threshold on bootstrap replicates of blocks of rows; the terms of most of the models, refitted on all rows.
    pub(crate) fn ensemble(&self, threshold: f64, ridge: f64, seed: u64) -> Result<Vec<Vec<f64>>, Failure> {
        let blocks = blocks(self.scan.units().iter().map(|unit| (unit.episode, unit.rows)));
        let count = blocks.last().map_or(0, |last| last + 1);
        let mut weights = Mat::<f64>::zeros(blocks.len(), REPLICATES);
        for replicate in 0..REPLICATES {
            let start = mix(mix(seed).wrapping_add(replicate as u64));
            for draw in 0..count {
                let random = mix(start.wrapping_add(draw as u64));
                let block = ((u128::from(random) * count as u128) >> 64) as usize;
                let units = (0..blocks.len()).filter(|&unit| blocks[unit] == block);
                units.for_each(|unit| weights[(unit, replicate)] += 1.0);
            }
        }
        let replicates = self.scan.roots(0, weights.as_ref());
        let replicates: Vec<Compressed> = replicates.iter().map(|root| root.compressed(self.constant)).collect();
        let optimizer = Optimizer::Stlsq(Stlsq { threshold, alpha: ridge, ..Stlsq::default() });
        let options = EnsembleOptions { probability: PROBABILITY, ..EnsembleOptions::default() };
        let terms = vec![Terms::all(); self.rows.targets()];
        let ensembles = ensemble(&self.rows, &replicates, &terms, &optimizer, &options, &Silent)?;
        Ok(ensembles.into_iter().map(|ensemble| ensemble.model.coefficients).collect())
    }

    /// Mean squared error of equations over all rows and targets.
    pub(crate) fn mean_squared_error(&self, coefficients: &[Vec<f64>]) -> f64 {
        let beta = Mat::from_fn(self.rows.columns(), self.rows.targets(), |j, t| coefficients[t][j]);
        let errors = self.rows.error(beta.as_ref());
        errors.iter().sum::<f64>() / (self.rows.weight * errors.len() as f64)
    }
}

/// Mean squared error of the central differences of some states, twice as large as it is estimated: below it no model is better than another.
fn resolution(names: &[&str], source: &dyn Source) -> Result<Vec<f64>, Failure> {
    let error = |name: &&str| {
        let of = Expr::column(*name);
        CentralDifference { of, angle: false, reach: 1, spacing: Spacing::Stamps }.truncation()
    };
    let squares = sampled_mean_squares(&names.iter().map(error).collect::<Vec<_>>(), source)?;
    Ok(squares.into_iter().map(|square| 4.0 * square).collect())
}

/// Training and held-out rows of every fold.
fn folds(scan: &SystemScan, constant: bool, resolution: &[f64]) -> Result<Vec<FoldProblem>, Failure> {
    let key =
        |unit: &Unit| Key { episode: unit.episode, chunk: unit.chunk, fold: Fold::default(), partition: 0, region: 0 };
    let keys: Vec<Key> = scan.units().iter().map(key).collect();
    let rows: Vec<u64> = scan.units().iter().map(|unit| unit.rows).collect();
    let split = Folds::of(&keys, &rows, FoldRule::Count(FOLDS), Purge::TENTH)?;
    let sides = scan.roots(0, split.train()).into_iter().zip(scan.roots(0, split.test()));
    Ok(sides
        .map(|(train, test)| FoldProblem {
            train: train.compressed(constant),
            test: test.compressed(constant).known_to(resolution),
        })
        .collect())
}
