//! The first half of an identification (paper, II-E.1): rows, survey, partitions. No regression yet.

use fleetfoot_data::{Progress, Source};
use fleetfoot_model::Partition;
use fleetfoot_stats::{Chunk, Grid};

use crate::{
    Error, Options, Problem, Specification,
    identify::{STATS_BUDGET, expected_regions, gram_bytes},
    regions::{Segmentation, segment},
    rows::Rows,
    survey::Survey,
};

/// Partitions of the rows of a source.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Partitioned {
    /// What was asked for and what it gave, in the order of [`Options::partitions`]. The regions carry no statistics yet
    /// ([`Partition::regions`] is empty); [`fleetfoot_model::Rule::count`] tells how many there are.
    pub partitions: Vec<(Specification, Partition)>,
    /// Rows with all values: of library, targets, partition columns, labels and weight.
    pub rows: u64,
    /// What the user should know: k-means on a sample, or not converged.
    pub notes: Vec<String>,
}

/// Makes the partitions of [`Options::partitions`] on all rows of a source whose columns are the problem's: those that [`crate::identify`] would
/// report, without the regression: the same bits as without folds. One pass over the rows.
///
/// Rows count when all that the problem speaks of is there: give it the library and targets of the regression to come, so that both see the same rows.
///
/// # Errors
/// Those of reading, of an unknown column, of too few rows, constant targets and too many labels.
pub fn partition(
    problem: &Problem,
    options: &Options,
    source: &dyn Source,
    progress: &dyn Progress,
) -> Result<Partitioned, Error> {
    let options = Options { folds: 0, ..options.clone() };
    let Prepared { survey, segmentation, .. } = prepare(problem, &options, source, progress)?;
    let of = |index: usize| segmentation.partitions[index].clone();
    Ok(Partitioned {
        partitions: segmentation.candidates.iter().map(|c| (c.specification.clone(), of(c.full))).collect(),
        rows: survey.complete,
        notes: segmentation.notes,
    })
}

/// What stands before the regression.
pub(crate) struct Prepared {
    pub(crate) rows: Rows,
    pub(crate) grid: Grid,
    pub(crate) chunks: Vec<Chunk>,
    pub(crate) survey: Survey,
    pub(crate) segmentation: Segmentation,
}

/// Surveys the rows and cuts them into regions, on all rows and on the training rows of every fold.
pub(crate) fn prepare(
    problem: &Problem,
    options: &Options,
    source: &dyn Source,
    progress: &dyn Progress,
) -> Result<Prepared, Error> {
    let rows = Rows::compile(problem, &options.partitions, source)?;
    let regions: usize =
        options.partitions.iter().map(expected_regions).sum::<usize>() * (1 + usize::from(options.folds)) + 1;
    let grid = Grid {
        chunk_rows: Grid::for_budget(source.rows(), regions, gram_bytes(rows.dimension()), STATS_BUDGET),
        folds: options.folds,
        purge: options.purge.max(rows.halo().before + rows.halo().after),
    };
    check_purge(&grid, source)?;
    let chunks = grid.chunks(source.episodes());
    progress.stage("survey");
    let survey = Survey::scan(&rows, source, &chunks, &options.partitions, options.memory, progress)?;
    check(problem, &rows, &survey)?;
    progress.stage("partition");
    let segmentation = segment(problem, options, &rows, &survey, progress)?;
    Ok(Prepared { rows, grid, chunks, survey, segmentation })
}

/// A purge gap reaches into the neighbouring spans only, so it must not be longer than a span.
fn check_purge(grid: &Grid, source: &dyn Source) -> Result<(), Error> {
    let longest = source.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
    let spans = grid.folds > 1 && source.episodes().len() < usize::from(grid.folds);
    let span = longest / usize::from(grid.folds.max(1));
    // Spans of a few rows cannot keep even the reach of the lags apart; such data are too few for folds anyway, and the fit says what it has.
    if spans && grid.purge > span && span > 0 {
        return Err(Error::PurgeTooLong { purge: grid.purge, span, folds: grid.folds });
    }
    Ok(())
}

fn check(problem: &Problem, rows: &Rows, survey: &Survey) -> Result<(), Error> {
    if survey.complete < rows.regressors as u64 + 2 {
        return Err(Error::TooFewRows {
            complete: survey.complete,
            regressors: rows.regressors + 1,
            at_border: survey.at_border,
            incomplete: survey.incomplete,
        });
    }
    for (target, equation) in problem.equations.iter().filter(|equation| equation.target.is_some()).enumerate() {
        if survey.scales.get(target, target) <= 0.0 {
            return Err(Error::ConstantTarget { target: equation.label(), value: survey.scales.mean[target] });
        }
    }
    Ok(())
}
