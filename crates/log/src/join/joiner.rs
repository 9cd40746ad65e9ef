//! The join: base rows block by block, each series looked up along the way.

use std::ops::Range;

use fleetfoot_data::{Progress, parallel_fold};

use crate::{
    Error,
    join::{
        Run, Series,
        grid::Grid,
        interpolate::{Place, Reach, SignCarry, angle, linear, places_between, places_held, slerp},
        overlap::{LogTimes, no_overlap, shared},
        plan::{Feed, JoinColumn, feeds},
    },
    store::SEGMENT,
};

/// Values of a block at most; a block has fewer rows when there are many columns, so that the blocks in flight stay small.
const BLOCK_VALUES: usize = 8 * SEGMENT;
/// Rows a second at most and at least.
const RATES: Range<f64> = 1e-6..1e6;
/// Rows of a grid for each sample at most: stamps that lie about a century are no reason to fill a disk.
const GRID_ROWS_PER_SAMPLE: usize = 10_000;

/// Source of the stamps of the joined rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Base {
    /// Those of a series, all its runs one after the other.
    Series(usize),
    /// An even grid of so many rows a second, from the latest start to the earliest end of the runs that belong together. Latched columns
    /// do not end it.
    Rate(f64),
}

/// Result of a join.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct JoinReport {
    /// Rows of the joined table.
    pub rows: usize,
    /// The rows of each run of the base; none is empty. The stamps rise strictly within each.
    pub runs: Vec<Range<usize>>,
    /// For each column, rows without a value.
    pub missing: Vec<usize>,
}

/// Joins columns of several series into one table and hands it on block by block: stamps, and one `Vec` a column.
///
/// The rows do not depend on the number of threads. Blocks are small and begin anew with every run of the base. In memory are at most a few
/// blocks a thread, and as many rows of each series.
///
/// # Errors
/// No moment in common, a rate out of range, a temporary file that cannot be read, and what `out` returns.
pub(crate) fn join(
    series: &[Series],
    columns: &[JoinColumn],
    base: Base,
    progress: &dyn Progress,
    out: impl FnMut(&[i64], &[Vec<f64>]) -> Result<(), Error> + Send,
) -> Result<JoinReport, Error> {
    let rows = (BLOCK_VALUES / (columns.len() + 1)).clamp(1024, SEGMENT);
    join_blocks(series, columns, base, rows, progress, out)
}

/// [`join`] in blocks of so many rows, at least 2.
pub(super) fn join_blocks(
    series: &[Series],
    columns: &[JoinColumn],
    base: Base,
    block_rows: usize,
    progress: &dyn Progress,
    mut out: impl FnMut(&[i64], &[Vec<f64>]) -> Result<(), Error> + Send,
) -> Result<JoinReport, Error> {
    let feeds = feeds(series, columns);
    let stretches = match base {
        Base::Series(base) => series_stretches(series, &feeds, base)?,
        Base::Rate(hz) => grid_stretches(series, &feeds, hz)?,
    };
    let joiner = Joiner { series, feeds: &feeds, stretches: &stretches, columns: columns.len(), block_rows };
    let mut report = JoinReport { missing: vec![0; columns.len()], ..JoinReport::default() };
    for stretch in &stretches {
        report.runs.push(report.rows..report.rows + stretch.rows());
        report.rows += stretch.rows();
    }
    let blocks = joiner.blocks();
    let mut signs = vec![SignCarry::default(); feeds.iter().map(|feed| feed.rotations.len()).sum()];
    let mut stretch = 0;
    parallel_fold(
        blocks.len(),
        progress,
        |i| joiner.block(&blocks[i]),
        |mut block| {
            if block.stretch != stretch {
                stretch = block.stretch;
                signs.fill(SignCarry::default());
            }
            block.turn_signs(&feeds, &mut signs);
            for (missing, column) in report.missing.iter_mut().zip(&block.columns) {
                *missing += column.iter().filter(|value| value.is_nan()).count();
            }
            out(&block.stamps, &block.columns)
        },
    )?;
    Ok(report)
}

/// Base rows over which every feed stays with one run.
struct Stretch {
    stamps: Stamps,
    /// For each feed, its run.
    matched: Vec<Option<usize>>,
}

enum Stamps {
    /// Rows of a series.
    Rows {
        series: usize,
        rows: Range<usize>,
    },
    Grid(Grid),
}

impl Stretch {
    fn rows(&self) -> usize {
        match &self.stamps {
            Stamps::Rows { rows, .. } => rows.len(),
            Stamps::Grid(grid) => grid.rows,
        }
    }
}

/// The runs of a series as base. Every other series must share a moment with it, be it only one.
fn series_stretches(series: &[Series], feeds: &[Feed], base: usize) -> Result<Vec<Stretch>, Error> {
    let base_stretches = &series[base];
    let matches = matches(series, feeds, base);
    let rows = base_stretches.runs.iter().map(|run| Stamps::Rows { series: base, rows: run.rows.clone() });
    let stretches: Vec<Stretch> = rows.zip(matches).map(|(stamps, matched)| Stretch { stamps, matched }).collect();
    for (place, feed) in feeds.iter().enumerate() {
        let other = &series[feed.series];
        let meets = |(run, stretch): (&Run, &Stretch)| {
            let (start, end) = match stretch.matched[place] {
                Some(matched) => shared(run, &other.runs[matched], feed.latched()),
                None => return false,
            };
            start <= end
        };
        let nothing_to_meet = base_stretches.runs.is_empty() || other.runs.is_empty();
        if !nothing_to_meet && !base_stretches.runs.iter().zip(&stretches).any(meets) {
            return Err(no_overlap(base_stretches, other));
        }
    }
    Ok(stretches)
}

/// For each run of the base and each feed: the feed's run.
fn matches(series: &[Series], feeds: &[Feed], base: usize) -> Vec<Vec<Option<usize>>> {
    let base_stretches = &series[base];
    let alone = base_stretches.runs.len() == 1;
    let log_times: Vec<LogTimes> = feeds.iter().map(|feed| LogTimes::new(&series[feed.series])).collect();
    let matched = |run: usize| {
        let of_feed = |(feed, log_times): (&Feed, &LogTimes)| match feed.series == base {
            true => Some(run),
            false => log_times.matching(&base_stretches.runs[run], alone, feed.latched()),
        };
        feeds.iter().zip(&log_times).map(of_feed).collect()
    };
    (0..base_stretches.runs.len()).map(matched).collect()
}

/// A grid for each run of the series that has most of them, over what the matching runs share.
fn grid_stretches(series: &[Series], feeds: &[Feed], hz: f64) -> Result<Vec<Stretch>, Error> {
    if !RATES.contains(&hz) && hz != RATES.end {
        return Err(Error::BadRate { hz });
    }
    let used = feeds.iter().map(|feed| feed.series);
    // Of equals the first.
    let Some(lead) = used.rev().max_by_key(|&place| series[place].runs.len()) else {
        return Ok(Vec::new());
    };
    let mut stretches = Vec::new();
    let mut disjoint = None;
    for matched in matches(series, feeds, lead) {
        let runs = || {
            let feeds_matched = feeds.iter().zip(&matched);
            feeds_matched.filter_map(|(feed, &run)| Some((feed, &series[feed.series].runs[run?])))
        };
        let latest = runs().max_by_key(|(_, run)| run.start);
        let lasting = runs().filter(|(feed, _)| !feed.latched()).min_by_key(|(_, run)| run.end);
        let (Some((late, first)), Some((early, last))) =
            (latest, lasting.or_else(|| runs().min_by_key(|(_, run)| run.end)))
        else {
            continue;
        };
        let grid = Grid::new(first.start, last.end, hz);
        if grid.rows > 0 {
            stretches.push(Stretch { stamps: Stamps::Grid(grid), matched });
        } else {
            disjoint.get_or_insert((early.series, late.series));
        }
    }
    if let (true, Some((early, late))) = (stretches.is_empty(), disjoint) {
        return Err(no_overlap(&series[early], &series[late]));
    }
    refuse_endless(series, feeds, &stretches, lead, hz)?;
    Ok(stretches)
}

fn refuse_endless(series: &[Series], feeds: &[Feed], stretches: &[Stretch], lead: usize, hz: f64) -> Result<(), Error> {
    let rows = stretches.iter().fold(0usize, |rows, stretch| rows.saturating_add(stretch.rows()));
    let samples = feeds.iter().map(|feed| series[feed.series].store.rows()).max().unwrap_or(0);
    if rows <= samples.saturating_mul(GRID_ROWS_PER_SAMPLE) {
        return Ok(());
    }
    let longest = series[lead].runs.iter().max_by_key(|run| run.end.abs_diff(run.start));
    Err(Error::GridTooLong {
        path: series[lead].source.clone(),
        name: series[lead].name.clone(),
        hz,
        rows,
        samples,
        range: longest.map_or((0, 0), |run| (run.start, run.end)),
    })
}

/// Data that all blocks share.
struct Joiner<'a> {
    series: &'a [Series],
    feeds: &'a [Feed],
    stretches: &'a [Stretch],
    columns: usize,
    block_rows: usize,
}

/// Rows of a stretch.
struct BlockPlan {
    stretch: usize,
    rows: Range<usize>,
}

/// A joined block. The columns of quaternions stand apart until their signs are known.
struct Block {
    stretch: usize,
    stamps: Vec<i64>,
    columns: Vec<Vec<f64>>,
    rotations: Vec<[Vec<f64>; 4]>,
}

impl Block {
    fn turn_signs(&mut self, feeds: &[Feed], signs: &mut [SignCarry]) {
        let rotations = feeds.iter().flat_map(|feed| &feed.rotations);
        for ((rotation, rows), sign) in rotations.zip(&mut self.rotations).zip(signs) {
            sign.apply(rows);
            for &(component, output) in &rotation.outputs {
                self.columns[output].clone_from(&rows[component]);
            }
        }
    }
}

impl Joiner<'_> {
    fn blocks(&self) -> Vec<BlockPlan> {
        let mut blocks = Vec::new();
        for (stretch, stretch_rows) in self.stretches.iter().enumerate() {
            let starts = (0..stretch_rows.rows()).step_by(self.block_rows);
            blocks.extend(starts.map(|from| BlockPlan {
                stretch,
                rows: from..from.saturating_add(self.block_rows).min(stretch_rows.rows()),
            }));
        }
        blocks
    }

    fn block(&self, plan: &BlockPlan) -> Result<Block, Error> {
        let stretch = &self.stretches[plan.stretch];
        let stamps = match &stretch.stamps {
            Stamps::Grid(grid) => plan.rows.clone().map(|row| grid.stamp(row)).collect(),
            Stamps::Rows { series, rows } => {
                let absolute = rows.start + plan.rows.start..rows.start + plan.rows.end;
                self.series[*series].store.stamps(absolute)?.to_vec()
            }
        };
        let nothing = || vec![f64::NAN; stamps.len()];
        let mut columns: Vec<_> = (0..self.columns).map(|_| nothing()).collect();
        let mut rotations = Vec::new();
        for (feed, matched) in self.feeds.iter().zip(&stretch.matched) {
            let first = rotations.len();
            rotations.extend(feed.rotations.iter().map(|_| std::array::from_fn(|_| nothing())));
            if let Some(run) = matched {
                self.feed(feed, *run, &stamps, &mut columns, &mut rotations[first..])?;
            }
        }
        Ok(Block { stretch: plan.stretch, stamps, columns, rotations })
    }

    /// Walks the samples of a run along the stamps of a block, at most so many samples at a time as a block has rows.
    fn feed(
        &self,
        feed: &Feed,
        run: usize,
        stamps: &[i64],
        columns: &mut [Vec<f64>],
        rotations: &mut [[Vec<f64>; 4]],
    ) -> Result<(), Error> {
        let series = &self.series[feed.series];
        let run = &series.runs[run];
        let mut at = stamps.partition_point(|&stamp| stamp < run.start);
        let (Some(&first), Some(&last)) = (stamps.get(at), stamps.last()) else {
            return Ok(());
        };
        let mut from = last_at_or_before(series, run.rows.clone(), first)?;
        // The sample after the last that is needed, and its successor.
        let end = (last_at_or_before(series, from..run.rows.end, last)? + 2).min(run.rows.end);
        let mut places = Vec::new();
        let breaks = feed.breaks.then_some((&series.breaks, series.median_step));
        let reach = Reach { limit: feed.limit, breaks };
        while at < stamps.len() {
            let to = from.saturating_add(self.block_rows).min(end);
            let samples = series.store.values(from..to)?;
            let upto = match samples.time.last() {
                Some(&newest) if to < end => at + stamps[at..].partition_point(|&stamp| stamp <= newest),
                _ => stamps.len(),
            };
            let wanted = &stamps[at..upto];
            if feed.held {
                places_held(&samples.time, wanted, reach, run.end, &mut places);
            } else {
                places_between(&samples.time, wanted, reach, &mut places);
            }
            let values: Vec<&[f64]> = samples.columns.iter().map(|column| &column[..]).collect();
            fill(feed, &places, &values, at..upto, columns, rotations);
            at = upto;
            if let Some(&next) = stamps.get(at) {
                from = last_at_or_before(series, to - 1..end, next)?;
            }
        }
        Ok(())
    }
}

/// Applies the kernels of a feed to the rows `rows` of a block.
fn fill(
    feed: &Feed,
    places: &[Place],
    values: &[&[f64]],
    rows: Range<usize>,
    columns: &mut [Vec<f64>],
    rotations: &mut [[Vec<f64>; 4]],
) {
    for scalar in &feed.scalars {
        let out = &mut columns[scalar.output][rows.clone()];
        let kernel = if scalar.angle { angle } else { linear };
        kernel(places, values[scalar.column], out);
    }
    for (rotation, out) in feed.rotations.iter().zip(rotations) {
        slerp(
            places,
            rotation.columns.map(|column| values[column]),
            out.each_mut().map(|column| &mut column[rows.clone()]),
        );
    }
}

/// The last of these rows whose stamp is at or before `stamp`; the first when there is none.
fn last_at_or_before(series: &Series, rows: Range<usize>, stamp: i64) -> Result<usize, Error> {
    let (mut low, mut high) = (rows.start, rows.end);
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        let stamp_there = series.store.stamps(middle..middle + 1)?;
        if stamp_there.first().is_some_and(|&stamp_there| stamp_there <= stamp) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(low)
}
