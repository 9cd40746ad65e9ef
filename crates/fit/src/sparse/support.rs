//! Support of a sparse fit: of the penalised fit at lambda, of a bolasso's replicates, or of a stability selection.

use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::StatisticFile;
use fleetfoot_sparse::{
    Certificate, Path, PathStatus, Solution,
    bolasso::{BootstrapOptions, Selection, StabilityOptions, block_bootstrap, row_bootstrap, stability_selection},
    coordinate::lambda_grid,
};

use super::{Resampled, SparseOptions, problem::Problem};
use crate::error::Error;

/// Lambdas of a stability selection, over two decades above the one that was chosen.
const STABILITY_GRID: usize = 20;
/// Complementary pairs of halves, as Shah and Samworth recommend.
const STABILITY_PAIRS: usize = 50;

/// Selected columns, and the evidence for them.
pub(super) struct Support {
    /// Columns, ascending.
    pub(super) columns: Vec<usize>,
    /// The penalised fit of all rows at lambda.
    pub(super) lasso: Solution,
    /// Share of the replicates that select every column (p), where there are replicates.
    pub(super) frequency: Option<Vec<f64>>,
    /// The replicates of a bolasso.
    pub(super) replicates: Option<Selection>,
    /// The method, as a model is called by it: `lasso`, `group lasso`, `bolasso`, `stability`.
    pub(super) method: &'static str,
    /// Method of the selection, for people.
    pub(super) how: String,
    /// Notes for the user.
    pub(super) notes: Vec<String>,
}

/// The penalised fit of all rows at lambda, and the notes of its path.
pub(super) fn penalised(problem: &Problem<'_>, lambda: f64) -> Result<(Solution, Vec<String>), Error> {
    let (quadratic, penalty) = (&problem.assembled.problem, &problem.assembled.penalty);
    let (solution, path) = problem.estimator.at(quadratic, penalty, lambda)?;
    let mut notes = path_notes(problem, &path);
    if let Some(end) = path.knots.last().filter(|knot| knot.l1 > solution.l1) {
        notes.push(format!(
            "rounding ended the path at lambda = {:.3e}, before {lambda:.3e}; coordinate descent went on",
            end.l1
        ));
    }
    if !solution.converged {
        let (name, certificate) = (problem.estimator.name(), words(&solution.certificate));
        notes.push(format!("the {name} at lambda = {lambda:.3e} did not converge: {certificate}"));
    }
    Ok((solution, notes))
}

/// A certificate for people.
pub(super) fn words(certificate: &Certificate) -> String {
    format!("optimality conditions to {:.1e}, duality gap {:.1e}", certificate.kkt, certificate.gap)
}

fn path_notes(problem: &Problem<'_>, path: &Path) -> Vec<String> {
    let names = |columns: &[usize]| columns.iter().map(|&j| problem.name(j)).collect::<Vec<_>>().join(", ");
    let mut notes = Vec::new();
    if path.status == PathStatus::Saturated {
        notes.push("there are as many independent columns as rows: the data are interpolated".to_owned());
    }
    if !path.constant.is_empty() {
        notes.push(format!("zero or constant in the data, left out: {}", names(&path.constant)));
    }
    if !path.collinear.is_empty() {
        notes.push(format!("equal to other columns up to rounding at lambda, left out: {}", names(&path.collinear)));
    }
    notes
}

/// Selects at lambda. `source` is the rows, where they are at hand.
pub(super) fn select(
    problem: &Problem<'_>,
    file: &StatisticFile,
    options: &SparseOptions,
    lambda: f64,
    source: Option<&dyn Source>,
    progress: &dyn Progress,
) -> Result<Support, Error> {
    let (lasso, notes) = penalised(problem, lambda)?;
    let name = problem.estimator.name();
    let together = options.groups.as_ref().map_or_else(String::new, |groups| format!(", {}", groups.in_words()));
    let mut support = Support {
        columns: lasso.support.clone(),
        lasso,
        frequency: None,
        replicates: None,
        method: name,
        how: format!("the {name}{together}"),
        notes,
    };
    if let Some((what, replicates)) = options.bolasso {
        progress.stage("bootstrap");
        let threshold = options.threshold.unwrap_or(1.0);
        let bootstrap = BootstrapOptions { replicates, lambda, seed: options.seed, threshold };
        let resample = resample(problem, file, what, &bootstrap, source, progress)?;
        support.agree(resample, what, &bootstrap);
    } else if options.stability {
        progress.stage("halves");
        stability(problem, options, lambda, &mut support, progress)?;
    }
    Ok(support)
}

/// The replicates of a bolasso.
fn resample(
    problem: &Problem<'_>,
    file: &StatisticFile,
    what: Resampled,
    bootstrap: &BootstrapOptions,
    source: Option<&dyn Source>,
    progress: &dyn Progress,
) -> Result<Selection, Error> {
    Ok(match (what, source) {
        (Resampled::Units(unit), _) => {
            block_bootstrap(&problem.structure, &problem.banks, &problem.assembly, unit, bootstrap, progress)?
        }
        (Resampled::Rows, Some(source)) => row_bootstrap(&file.plan, &problem.assembly, source, bootstrap, progress)?,
        (Resampled::Rows, None) => {
            return Err(Error::needs_rows(
                "bolasso = rows: a statistic has no rows to draw; give the logs instead, or resample `chunks` or `episodes`, which needs no rows"
                    .into(),
            ));
        }
    })
}

impl Support {
    /// Keeps the columns on which the replicates agree.
    fn agree(&mut self, selection: Selection, what: Resampled, bootstrap: &BootstrapOptions) {
        let BootstrapOptions { replicates, threshold, .. } = *bootstrap;
        let unit = match what {
            Resampled::Rows => "rows",
            Resampled::Units(fleetfoot_sparse::bolasso::BootstrapUnit::Chunk) => "chunks",
            Resampled::Units(_) => "episodes",
        };
        self.method = "bolasso";
        self.how = format!("bolasso: columns in {:.0} % of {replicates} replicates of {unit}", threshold * 100.0);
        for (count, what) in [
            (selection.stalled, "were finished by coordinate descent, because rounding ended their path before lambda"),
            (selection.unconverged, "did not converge, and count as they are"),
            (selection.empty, "drew no rows and were left out"),
        ] {
            if count > 0 {
                self.notes.push(format!("{count} of {replicates} replicates {what}"));
            }
        }
        self.columns.clone_from(&selection.support);
        self.frequency = Some(selection.frequency.clone());
        self.replicates = Some(selection);
    }
}

fn stability(
    problem: &Problem<'_>,
    options: &SparseOptions,
    lambda: f64,
    support: &mut Support,
    progress: &dyn Progress,
) -> Result<(), Error> {
    let grid = lambda_grid(&problem.assembled.problem, &problem.assembled.penalty, 1.0, STABILITY_GRID, 0.01)?;
    let mut lambdas: Vec<f64> = grid.into_iter().filter(|&value| value > lambda).collect();
    lambdas.push(lambda);
    let threshold = options.threshold.unwrap_or(0.9);
    let unit = if problem.episodes() >= super::ENOUGH_EPISODES {
        fleetfoot_sparse::bolasso::BootstrapUnit::Episode
    } else {
        fleetfoot_sparse::bolasso::BootstrapUnit::Chunk
    };
    let halves = StabilityOptions { pairs: STABILITY_PAIRS, lambdas, seed: options.seed, threshold };
    let stability_selection =
        stability_selection(&problem.structure, &problem.banks, &problem.assembly, unit, &halves, progress)?;
    support.method = "stability";
    support.how = format!(
        "stability selection: columns in {:.0} % of {} halves; at most {:.2} false ones expected{}",
        threshold * 100.0,
        2 * STABILITY_PAIRS,
        stability_selection.bound,
        stability_selection
            .unimodal_bound
            .map_or_else(String::new, |bound| format!(" ({bound:.2} by the unimodal bound)")),
    );
    if stability_selection.stalled > 0 {
        support.notes.push(format!(
            "{} halves were finished by coordinate descent, because rounding ended their path before lambda",
            stability_selection.stalled
        ));
    }
    support.columns.clone_from(&stability_selection.support);
    support.frequency = Some(stability_selection.frequency);
    Ok(())
}
