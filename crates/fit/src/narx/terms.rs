//! The terms of an order in every region, by forward regression.

use faer::Mat;
use fleetfoot_recipe::Criterion;
use fleetfoot_sparse::threshold::{
    Criterion as By, CriterionOptions, Frols, FrolsChoice, Optimizer, Terms, ThresholdError, Trail, optimize,
};
use fleetfoot_stats::Compressed;
use fleetfoot_sums::system::SystemScan;

use super::TermRule;

/// The problems of one training set: all rows, and the rows of every region, with the constant first.
pub(crate) struct Problems {
    pub(crate) whole: Compressed,
    /// Empty where there is one region only.
    pub regions: Vec<Compressed>,
}

impl Problems {
    /// Of all rows.
    pub(crate) fn all(whole: &SystemScan, regions: Option<&SystemScan>) -> Self {
        let of = |scan: &SystemScan| (0..scan.regions()).map(|r| scan.root(r).compressed(true)).collect();
        Self { whole: whole.root(0).compressed(true), regions: regions.map_or_else(Vec::new, of) }
    }

    /// Of every training set; `weights` are those of the units (units x sets), which both scans share.
    pub(crate) fn sets(
        whole: &SystemScan,
        regions: Option<&SystemScan>,
        weights: &dyn Fn(&SystemScan) -> Mat<f64>,
    ) -> Vec<Self> {
        let of = |scan: &SystemScan, region: usize| -> Vec<Compressed> {
            scan.roots(region, weights(scan).as_ref()).iter().map(|root| root.compressed(true)).collect()
        };
        let mut sets: Vec<Self> = of(whole, 0).into_iter().map(|whole| Self { whole, regions: Vec::new() }).collect();
        for (scan, region) in regions.iter().flat_map(|scan| (0..scan.regions()).map(move |region| (scan, region))) {
            sets.iter_mut().zip(of(scan, region)).for_each(|(set, problem)| set.regions.push(problem));
        }
        sets
    }
}

/// The models of an order on one training set, by number of terms.
pub(crate) struct Trails {
    columns: Vec<usize>,
    /// Of all rows: one a target.
    whole: Vec<Trail>,
    /// Rows of every region, and its models.
    regions: Vec<(u64, Vec<Trail>)>,
}

/// The terms of an equation in a region.
#[derive(Debug, Clone)]
pub(crate) struct EquationTerms {
    /// Candidate, coefficient and error reduction ratio, in the order in which they entered.
    pub(crate) terms: Vec<(usize, f64, f64)>,
    /// True if the region has too few rows and takes the terms of all rows.
    pub(crate) shared: bool,
}

impl Trails {
    /// Forward regression on the columns of an order; all of them with [`TermRule::All`].
    pub(crate) fn new(
        problems: &Problems,
        columns: Vec<usize>,
        rule: TermRule,
        choice: FrolsChoice,
    ) -> Result<Self, ThresholdError> {
        let optimizer = match rule {
            TermRule::All => Optimizer::LeastSquares,
            TermRule::Count(max_terms) | TermRule::Auto(max_terms) => {
                Optimizer::Frols(Frols { max_terms, choice, ..Frols::default() })
            }
        };
        let trails = |problem: &Compressed| -> Result<Vec<Trail>, ThresholdError> {
            let selected = problem.select(&columns);
            (0..selected.targets()).map(|t| optimize(&selected, t, &optimizer, &Terms::all())).collect()
        };
        let regions = problems.regions.iter().map(|problem| {
            // A region without rows has the model of all.
            Ok((problem.rows, if problem.rows > 0 { trails(problem)? } else { Vec::new() }))
        });
        Ok(Self { whole: trails(&problems.whole)?, regions: regions.collect::<Result<_, ThresholdError>>()?, columns })
    }

    /// The terms of every region (outer) and equation: `count` terms of each, or as many as there are; `None`: the
    /// number that forward regression chose.
    pub(crate) fn terms(&self, count: Option<usize>) -> Vec<Vec<EquationTerms>> {
        let one = |trail: &Trail, shared: bool| {
            let at = count.map_or(trail.chosen, |count| count.min(trail.steps.len() - 1));
            EquationTerms::of(trail, at, &self.columns, shared)
        };
        let whole = |shared: bool| self.whole.iter().map(|trail| one(trail, shared)).collect::<Vec<_>>();
        if self.regions.is_empty() {
            return vec![whole(false)];
        }
        let region = |(rows, trails): &(u64, Vec<Trail>)| {
            let terms: Vec<EquationTerms> = trails.iter().map(|trail| one(trail, false)).collect();
            // Fewer than two rows a term say little about the terms.
            let most = terms.iter().map(|equation| equation.terms.len() as u64).max();
            match most {
                Some(most) if *rows >= 2 * most && *rows > 0 => terms,
                _ => whole(true),
            }
        };
        self.regions.iter().map(region).collect()
    }

    /// The columns of [`Trails::terms`].
    pub(crate) fn supports(&self, count: Option<usize>) -> Vec<Vec<Support>> {
        let support = |equation: &EquationTerms| Support {
            columns: equation.terms.iter().map(|(column, ..)| *column).collect(),
            shared: equation.shared,
        };
        self.terms(count).iter().map(|equations| equations.iter().map(support).collect()).collect()
    }
}

/// Candidates of an equation in a region.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Support {
    /// Columns of the problem.
    pub(crate) columns: Vec<usize>,
    /// True if they are those of all rows.
    pub(crate) shared: bool,
}

impl Problems {
    /// The rows for an equation of a region: the region's, or all rows if its support is that of all or it has fewer
    /// than two rows a term.
    fn rows_of(&self, region: usize, support: &Support) -> &Compressed {
        let enough = |problem: &&Compressed| problem.rows > 0 && problem.rows >= 2 * support.columns.len() as u64;
        self.regions.get(region).filter(|_| !support.shared).filter(enough).unwrap_or(&self.whole)
    }

    /// Squared one-step errors of every output over all rows, by coefficients of every region (all candidates x equations), and the weight of the rows.
    pub(crate) fn error(&self, coefficients: &[Mat<f64>]) -> (Vec<f64>, f64) {
        let rows = if self.regions.is_empty() { std::slice::from_ref(&self.whole) } else { &self.regions };
        let mut error = vec![0.0; self.whole.targets()];
        for (problem, coefficient) in rows.iter().zip(coefficients).filter(|(problem, _)| problem.weight > 0.0) {
            error.iter_mut().zip(problem.error(coefficient.as_ref())).for_each(|(sum, error)| *sum += error);
        }
        (error, rows.iter().map(|problem| problem.weight).sum())
    }

    /// The mean over the outputs of squared one-step errors over their variance; `None` without rows.
    pub(crate) fn loss(&self, coefficients: &[Mat<f64>], variance: &[f64]) -> Option<f64> {
        let (error, weight) = self.error(coefficients);
        let sum: f64 = error.iter().zip(variance).map(|(error, variance)| error / (weight * variance)).sum();
        (weight > 0.0).then(|| sum / error.len() as f64)
    }

    /// Least squares on given supports, of every region (outer) and equation: the same model on other rows.
    pub(crate) fn refitted(&self, supports: &[Vec<Support>]) -> Result<Vec<Vec<EquationTerms>>, ThresholdError> {
        self.fitted(supports, |_| Optimizer::LeastSquares)
    }

    /// The same, the terms in the order in which forward regression takes them, with their error reduction ratios.
    pub(crate) fn ordered(&self, supports: &[Vec<Support>]) -> Result<Vec<Vec<EquationTerms>>, ThresholdError> {
        self.fitted(supports, |terms| {
            Optimizer::Frols(Frols { max_terms: terms, choice: FrolsChoice::Last, ..Frols::default() })
        })
    }

    fn fitted(
        &self,
        supports: &[Vec<Support>],
        optimizer: impl Fn(usize) -> Optimizer,
    ) -> Result<Vec<Vec<EquationTerms>>, ThresholdError> {
        let one = |region: usize, target: usize, support: &Support| {
            let selected = self.rows_of(region, support).select(&support.columns);
            let trail = optimize(&selected, target, &optimizer(support.columns.len()), &Terms::all())?;
            Ok(EquationTerms::of(&trail, trail.steps.len() - 1, &support.columns, support.shared))
        };
        let equations = |(region, supports): (usize, &Vec<Support>)| {
            supports.iter().enumerate().map(|(target, support)| one(region, target, support)).collect()
        };
        supports.iter().enumerate().map(equations).collect()
    }
}

impl EquationTerms {
    /// The terms of one step of a trail over these columns.
    fn of(trail: &Trail, at: usize, columns: &[usize], shared: bool) -> Self {
        let step = &trail.steps[at];
        let order = if trail.order.is_empty() { &step.support } else { &trail.order };
        let err = |k: usize| step.err.as_ref().and_then(|err| err.get(k)).copied().unwrap_or(f64::NAN);
        let terms = order.iter().take(step.terms()).enumerate();
        Self { terms: terms.map(|(k, &j)| (columns[j], step.coefficients[j], err(k))).collect(), shared }
    }
}

/// Coefficients of every region: all candidates x equations.
pub(crate) fn coefficients(terms: &[Vec<EquationTerms>], candidates: usize) -> Vec<Mat<f64>> {
    let matrix = |equations: &Vec<EquationTerms>| {
        let mut coefficients = Mat::zeros(candidates, equations.len());
        for (t, equation) in equations.iter().enumerate() {
            equation.terms.iter().for_each(|&(j, value, _)| coefficients[(j, t)] = value);
        }
        coefficients
    };
    terms.iter().map(matrix).collect()
}

/// Forward regression's choice by an information criterion, where there is one.
pub(crate) fn choice(criterion: Criterion) -> FrolsChoice {
    let by = |criterion| FrolsChoice::Criterion(criterion, CriterionOptions::default());
    match criterion {
        Criterion::Aic => by(By::Aic),
        Criterion::Bic => by(By::Bic),
        Criterion::Ebic => by(By::Ebic),
        Criterion::CrossValidation | Criterion::OneStandardError => FrolsChoice::Last,
    }
}
