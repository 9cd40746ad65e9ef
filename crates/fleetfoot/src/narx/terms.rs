//! The terms of an order in every region, by forward regression.

use faer::Mat;
use fleetfoot_sparse::{
    Criterion as By, CriterionOptions, Frols, FrolsChoice, Optimizer, SystemScan, Terms, ThresholdError, Trail,
    optimize,
};
use fleetfoot_stats::Compressed;

use super::TermRule;
use crate::Criterion;

/// The problems of one training set: all rows, and the rows of every region, with the constant first.
pub(crate) struct Problems {
    pub(crate) whole: Compressed,
    /// Empty where there is one region only.
    pub(crate) regions: Vec<Compressed>,
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
    candidates: usize,
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
    /// Whether the region saw too few rows and has the terms of all of them.
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
            let own = problem.select(&columns);
            (0..own.targets()).map(|t| optimize(&own, t, &optimizer, &Terms::all())).collect()
        };
        let regions = problems.regions.iter().map(|problem| {
            // A region without rows has the model of all.
            Ok((problem.rows, if problem.rows > 0 { trails(problem)? } else { Vec::new() }))
        });
        Ok(Self {
            candidates: problems.whole.columns(),
            whole: trails(&problems.whole)?,
            regions: regions.collect::<Result<_, ThresholdError>>()?,
            columns,
        })
    }

    /// The most terms of any equation.
    pub(crate) fn longest(&self) -> usize {
        let all = self.whole.iter().chain(self.regions.iter().flat_map(|(_, trails)| trails));
        all.map(|trail| trail.steps.last().map_or(0, |step| step.terms())).max().unwrap_or(0)
    }

    /// The terms of every region (outer) and equation: `count` terms of each, or as many as there are; `None`: what forward regression itself chose.
    pub(crate) fn terms(&self, count: Option<usize>) -> Vec<Vec<EquationTerms>> {
        let one = |trail: &Trail, shared: bool| {
            let at = count.map_or(trail.chosen, |count| count.min(trail.steps.len() - 1));
            let step = &trail.steps[at];
            let order = if trail.order.is_empty() { &step.support } else { &trail.order };
            let err = |k: usize| step.err.as_ref().and_then(|err| err.get(k)).copied().unwrap_or(f64::NAN);
            let terms = order.iter().take(step.terms()).enumerate();
            EquationTerms {
                terms: terms.map(|(k, &j)| (self.columns[j], step.coefficients[j], err(k))).collect(),
                shared,
            }
        };
        let whole = |shared: bool| self.whole.iter().map(|trail| one(trail, shared)).collect::<Vec<_>>();
        if self.regions.is_empty() {
            return vec![whole(false)];
        }
        let region = |(rows, trails): &(u64, Vec<Trail>)| {
            let own: Vec<EquationTerms> = trails.iter().map(|trail| one(trail, false)).collect();
            // Fewer than two rows a term say little about the terms.
            let most = own.iter().map(|equation| equation.terms.len() as u64).max();
            match most {
                Some(most) if *rows >= 2 * most && *rows > 0 => own,
                _ => whole(true),
            }
        };
        self.regions.iter().map(region).collect()
    }

    /// Coefficients of every region: all candidates x equations.
    pub(crate) fn coefficients(&self, terms: &[Vec<EquationTerms>]) -> Vec<Mat<f64>> {
        let matrix = |equations: &Vec<EquationTerms>| {
            let mut coefficients = Mat::zeros(self.candidates, equations.len());
            for (t, equation) in equations.iter().enumerate() {
                equation.terms.iter().for_each(|&(j, value, _)| coefficients[(j, t)] = value);
            }
            coefficients
        };
        terms.iter().map(matrix).collect()
    }
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
