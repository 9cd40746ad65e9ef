//! The first half of an identification (paper, II-E.1): rows, survey, partitions. No regression yet.

use fleetfoot_data::{Progress, Source};
use fleetfoot_model::{Partition, Rule};
use fleetfoot_stats::{COARSE, Chunk, FoldLayout, FoldRule, Grid, Preconditioner};

use crate::{
    Error, Options, Problem, Specification,
    borders::close,
    budget::{STATS_BUDGET, expected_regions, gram_bytes},
    continuous::check as check_continuous,
    cuts::Cuts,
    effective::with_effective_weights,
    lattice::{Sets, Tree, grow, joined_ranges},
    phase::Scale,
    regions::segment,
    rows::Rows,
    scan::{Scan, Wanted, sum},
    segmentation::Segmentation,
    survey::Survey,
};

/// Partitions of the rows of a source.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Partitioned {
    /// Specifications and their partitions, in the order of [`Options::partitions`]. Rows of the regions are not
    /// counted yet; [`fleetfoot_model::Rule::count`] gives the number of regions.
    pub partitions: Vec<(Specification, Partition)>,
    /// Rows with all values: of library, targets, partition columns, labels and weight.
    pub rows: u64,
    /// Notes for the user: k-means on a sample, or not converged.
    pub notes: Vec<String>,
}

/// Makes the partitions of [`Options::partitions`] on all rows of a source whose columns are the problem's. They are
/// those of [`crate::identify`], without the regression: the same bits as without folds. One pass over the rows, one
/// more for cells that are joined, and one for weights.
///
/// A row counts if all columns of the problem have values. Give it the library and targets of the regression to come,
/// so that both see the same rows.
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
    let weighed = with_effective_weights(problem, source, progress)?;
    let problem = weighed.as_ref().unwrap_or(problem);
    let Prepared { rows, chunks, survey, mut segmentation, .. } = prepare(problem, &options, source, progress)?;
    if !segmentation.lattices.is_empty() {
        progress.stage("cells");
        let cells = Segmentation::of_cells(std::mem::take(&mut segmentation.lattices));
        let preconditioner = rows.coordinates(source)?;
        let wanted = Wanted { plans: &[], cuts: Cuts::new(&chunks), cut: &[true] };
        let mut scanned = sum(&rows, &cells, &preconditioner, source, &wanted, "", progress)?;
        segmentation.lattices = cells.lattices;
        join_cells(&mut segmentation, &mut scanned, &preconditioner)?;
    }
    let of = |index: usize| segmentation.partitions[index].clone();
    Ok(Partitioned {
        partitions: segmentation.candidates.iter().map(|c| (c.specification.clone(), of(c.full))).collect(),
        rows: survey.counts.complete,
        notes: segmentation.notes.iter().map(ToString::to_string).collect(),
    })
}

/// Grows the trees of the cells, where there are any, and joins the partitions; the cells' sums, and the trees.
pub(crate) fn join_cells(
    segmentation: &mut Segmentation,
    scanned: &mut Scan,
    preconditioner: &Preconditioner,
) -> Result<Option<(Sets, Vec<Tree>)>, Error> {
    let Some(cells) = scanned.cells.take() else { return Ok(None) };
    let Some(whole) = scanned.stats.total(|key| key.partition == 0).filter(|gram| gram.weight > 0.0) else {
        return Ok(None);
    };
    let total = preconditioner.square_root(&whole).total;
    // Constant columns have no errors.
    let variance = |total: &f64| if *total > 0.0 { total / whole.weight } else { 1.0 };
    let all = cells.cell_ranges();
    let sets = cells.sets();
    let variance: Vec<f64> = total.iter().map(variance).collect();
    let trees = grow(&segmentation.lattices, &sets, preconditioner, &variance)?;
    segmentation.join(&trees);
    for candidate in &segmentation.candidates {
        // A scan of cells alone has no other partitions.
        if let Rule::Joined { regions, .. } = &segmentation.partitions[candidate.full].rule
            && let Some(ranges) = scanned.ranges.get_mut(candidate.full)
        {
            *ranges = joined_ranges(&all, regions);
        }
    }
    Ok(Some((sets, trees)))
}

/// Preparations for the regression.
pub(crate) struct Prepared {
    pub(crate) rows: Rows,
    pub(crate) grid: Grid,
    /// Layout of the held-out rows; `None` without folds.
    pub(crate) folds: Option<FoldLayout>,
    pub(crate) chunks: Vec<Chunk>,
    pub(crate) survey: Survey,
    pub(crate) segmentation: Segmentation,
    /// Bins of the phase's values, if there is a phase.
    pub(crate) phase: Option<Scale>,
}

/// Surveys the rows and cuts them into regions, on all rows and on the training rows of every fold.
pub(crate) fn prepare(
    problem: &Problem,
    options: &Options,
    source: &dyn Source,
    progress: &dyn Progress,
) -> Result<Prepared, Error> {
    let places = if options.continuous { check_continuous(problem, &options.partitions)? } else { Vec::new() };
    let rows = Rows::compile(problem, options, source)?;
    let regions: usize =
        options.partitions.iter().map(expected_regions).sum::<usize>() * (1 + usize::from(options.folds)) + 1;
    let bytes = gram_bytes(rows.dimension());
    Grid::check(source.episodes(), 1, bytes)?;
    let grid = Grid { chunk_rows: Grid::for_budget(source.rows(), regions, bytes, STATS_BUDGET, COARSE) };
    let folds = fold_layout(options, rows.halo().before + rows.halo().after, source);
    let chunks = match &folds {
        Ok(Some(folds)) => grid.chunks_in(folds, source.episodes()),
        _ => grid.chunks(source.episodes()),
    };
    progress.stage("survey");
    // As without folds.
    let keys = options.partitions.iter().map(expected_regions).sum::<usize>() + 1;
    let whole = Grid { chunk_rows: Grid::for_budget(source.rows(), keys, bytes, STATS_BUDGET, COARSE) };
    let passed = (&whole.chunks(source.episodes())[..], &Cuts::new(&chunks));
    let survey = Survey::scan(&rows, source, passed, options, progress)?;
    check(problem, &rows, &survey)?;
    let phase = survey.phase.as_ref().zip(options.phase.as_ref());
    let phase = phase.map(|(seen, phase)| seen.scale(phase)).transpose()?;
    // Rows that are too few for a model are too few for folds: the former is said first.
    let folds = folds?;
    let mut segmentation = segment((problem, &places), options, &rows, &survey, progress)?;
    close(&rows, &mut segmentation, source, &chunks, progress)?;
    Ok(Prepared { rows, grid, folds, chunks, survey, segmentation, phase })
}

/// The folds, where there are any; `halo`: the rows that lags and differences reach over.
fn fold_layout(options: &Options, halo: usize, source: &dyn Source) -> Result<Option<FoldLayout>, Error> {
    if options.folds < 2 {
        return Ok(None);
    }
    let purge = options.gap(halo);
    let episodes = source.episodes().iter().map(|episode| (episode.id, episode.rows));
    let layout = FoldLayout::new(FoldRule::Count(options.folds.into()), episodes, purge)?;
    let longest = source.episodes().iter().max_by_key(|episode| episode.rows);
    let spans = longest.map_or_else(Vec::new, |episode| layout.spans(episode.id, episode.rows));
    let span = spans.iter().map(|(span, _)| span.len()).min().unwrap_or(0);
    // A gap reaches into the neighbouring spans only, so it must not be longer than a span.
    if let (false, Some(purge)) = (layout.whole_episodes(), options.purge.filter(|&purge| purge > span)) {
        return Err(Error::PurgeTooLong { purge, span, folds: options.folds });
    }
    Ok(Some(layout))
}

fn check(problem: &Problem, rows: &Rows, survey: &Survey) -> Result<(), Error> {
    if survey.counts.complete < rows.regressors as u64 + 2 {
        return Err(Error::TooFewRows {
            complete: survey.counts.complete,
            regressors: rows.regressors + 1,
            at_border: survey.counts.at_border,
            incomplete: survey.counts.incomplete,
        });
    }
    for (target, equation) in problem.equations.iter().filter(|equation| equation.target.is_some()).enumerate() {
        if survey.scales.get(target, target) <= 0.0 {
            return Err(Error::ConstantTarget { target: equation.label(), value: survey.scales.mean[target] });
        }
    }
    Ok(())
}
