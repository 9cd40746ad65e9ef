//! Figure 2: which functions the bolasso selects, aircraft by aircraft.

use fleetfoot::{
    Silent,
    data::MemorySource,
    sim::plant::aircraft::Airplane,
    sparse::{
        bolasso::{BootstrapOptions, BootstrapUnit, Selection, block_bootstrap, refit, row_bootstrap},
        select::{CrossValidation, Folds, Lambdas, RandomSplits, SelectOptions, cross_validate},
        structured::Assembly,
    },
    stats::SquareRoot,
    sums::structured::{Banks, Plan, Scanned},
};

use super::{Arguments, Failure, Resample, confounding::remainder, equations};

/// The lasso's grid: down to a millionth of the lambda at which the first function enters.
const GRID: Lambdas = Lambdas::Grid { count: 121, ratio: 1e-6 };

/// What was found of one aircraft.
pub(crate) struct Aircraft {
    pub(crate) number: u32,
    pub(crate) rows: u64,
    pub(crate) truth: Vec<f64>,
    pub(crate) cross_validation: CrossValidation,
    /// The strength of the lasso.
    pub(crate) lambda: f64,
    pub(crate) selection: Selection,
    /// Least squares on the selected functions.
    pub(crate) theta: Vec<f64>,
    /// True functions that were not selected, and what the selected ones leave of them (relative length).
    pub(crate) missed: Vec<(usize, f64)>,
}

/// An aircraft's rows behind its statistic.
pub(crate) struct Scan {
    pub(crate) plan: Plan,
    pub(crate) scanned: Scanned,
    pub(crate) banks: Banks,
    pub(crate) roots: Vec<SquareRoot>,
}

impl Scan {
    pub(crate) fn new(source: &MemorySource) -> Result<Self, Failure> {
        let plan = Plan::new(equations::regression()?, Vec::new(), 4_096, source)?;
        let scanned = plan.scan(source, &Silent)?;
        let banks = Banks::new(&scanned, |_| true);
        Ok(Self { roots: banks.total(), plan, scanned, banks })
    }

    /// Cross-validated lambda: repeated random thirds of the flights are held out (section 9.2).
    pub(crate) fn choose(&self, assembly: &Assembly, arguments: &Arguments) -> Result<(CrossValidation, f64), Failure> {
        let splits = RandomSplits { repeats: arguments.splits, seed: arguments.seed, ..RandomSplits::default() };
        let folds = Folds::random_splits(self.banks.keys(), self.banks.rows(), &splits)?;
        let structure = self.plan.regression.structure();
        let options = SelectOptions { lambdas: GRID, ..SelectOptions::default() };
        let validation = cross_validate(&structure, &self.banks, assembly, &folds, &options, &Silent)?;
        let lambda = if arguments.one_standard_error {
            validation.one_standard_error_lambda()
        } else {
            validation.best_lambda()
        };
        Ok((validation, lambda))
    }

    /// The bolasso at a lambda, and the refit on its support.
    pub(crate) fn bolasso(
        &self,
        source: &MemorySource,
        assembly: &Assembly,
        lambda: f64,
        arguments: &Arguments,
    ) -> Result<(Selection, Vec<f64>), Failure> {
        let structure = self.plan.regression.structure();
        let options = BootstrapOptions {
            replicates: arguments.replicates,
            seed: arguments.seed,
            threshold: arguments.threshold,
            ..BootstrapOptions::new(lambda)
        };
        let selection = match arguments.resample {
            Resample::Rows => row_bootstrap(&self.plan, assembly, source, &options, &Silent)?,
            Resample::Flights => {
                block_bootstrap(&structure, &self.banks, assembly, BootstrapUnit::Episode, &options, &Silent)?
            }
        };
        let theta = refit(&structure, &self.roots, assembly, &selection.support)?;
        Ok((selection, theta))
    }
}

/// Chooses lambda and runs the bolasso for one aircraft.
pub(crate) fn select(
    airplane: &Airplane,
    source: &MemorySource,
    scan: &Scan,
    arguments: &Arguments,
) -> Result<Aircraft, Failure> {
    let assembly = equations::assembly(&scan.scanned, arguments.lambda_t)?;
    let (cross_validation, lambda) = scan.choose(&assembly, arguments)?;
    let (selection, theta) = scan.bolasso(source, &assembly, lambda, arguments)?;
    let truth = equations::truth(airplane);
    let missed = (0..truth.len()).filter(|j| truth[*j] != 0.0 && !selection.support.contains(j));
    let missed =
        missed.map(|j| Ok::<_, Failure>((j, remainder(scan, &selection.support, j)?))).collect::<Result<_, _>>()?;
    Ok(Aircraft {
        number: airplane.index(),
        rows: scan.roots.first().map_or(0, |root| root.rows),
        missed,
        truth,
        cross_validation,
        lambda,
        selection,
        theta,
    })
}
