//! A model's behaviour projected onto a plane of two columns: how often trajectories change region where, and how well rows are predicted where.
//!
//! Section III-D and Fig. 9 of Buchan, Haldane, Fearing, "Automatic Identification of Dynamic Piecewise Affine Models
//! for a Running Robot". The plane is cut into bins x bins cells. A *passage* is a trajectory's stay in a cell:
//! consecutive rows of one episode that fall into it. The *transition ratio* of a cell is the share of its passages in
//! which the region changes, the step into the cell included. A change between two rows belongs to the cell of the
//! later one. The *score* of a cell is the mean Mahalanobis score (equation (10)) of the one-step errors of its rows.

use std::f64::consts::TAU;

use fleetfoot_data::{Block, Progress, Source};
use fleetfoot_library::{Expr, Program, Scratch};
use fleetfoot_model::Model;
use fleetfoot_stats::{Grid, reduce};

use crate::{Error, Mahalanobis, Predicted, Predictor, PredictorWorkspace, RowStatus, baseline::evaluate};

/// Cells along an axis, at most.
pub const MAX_BINS: usize = 1000;
/// Rows of a chunk.
const CHUNK_ROWS: usize = 65_536;

/// One axis of a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Projected expression, over the columns of the source.
    pub expression: Expr,
    /// Lower end, in the expression's unit.
    pub low: f64,
    /// Upper end; values there and beyond are outside.
    pub high: f64,
    /// True if values are angles (rad), brought into the range by whole turns.
    pub periodic: bool,
}

impl Axis {
    /// One turn of an angle, `[0, 2 pi)`: the crank angles of Fig. 9.
    pub fn angle(expression: Expr) -> Self {
        Self { expression, low: 0.0, high: TAU, periodic: true }
    }

    /// The range `[low, high)`.
    pub fn range(expression: Expr, low: f64, high: f64) -> Self {
        Self { expression, low, high, periodic: false }
    }

    /// An axis for an expression over a model's columns: an angle if all columns in it are angles. Else the range of
    /// the source's values, which takes a pass over the rows.
    ///
    /// # Errors
    /// [`Error::Plane`] without a finite value; [`Error::UnknownColumn`]; those of reading.
    pub fn of_model(
        model: &Model,
        expression: Expr,
        source: &dyn Source,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let names = expression.columns();
        let is_angle = |name: &str| model.column(name).is_some_and(|column| model.columns[column].angle);
        if !names.is_empty() && names.iter().all(|name| is_angle(name)) {
            return Ok(Self::angle(expression));
        }
        let (low, high) = extent(&expression, source, progress)?;
        if low > high {
            return Err(Error::Plane(format!("{expression} has no finite value in these rows")));
        }
        // The largest value is inside, and a column that never changes has an axis too.
        let reach = (high - low).max(1e-9 * high.abs()).max(f64::MIN_POSITIVE);
        Ok(Self::range(expression, low, high + 1e-9 * reach))
    }

    /// The centre of a bin.
    pub fn centre(&self, bin: usize, bins: usize) -> f64 {
        self.low + (bin as f64 + 0.5) * (self.high - self.low) / bins as f64
    }

    fn bin(&self, value: f64, bins: usize) -> Option<usize> {
        let offset = if self.periodic { (value - self.low).rem_euclid(TAU) } else { value - self.low };
        let place = offset / (self.high - self.low) * bins as f64;
        // Rounding may bring an angle just below a whole turn onto it.
        let place = if self.periodic && place >= bins as f64 { 0.0 } else { place };
        (place >= 0.0 && place < bins as f64).then_some(place as usize)
    }

    fn check(&self) -> Result<(), Error> {
        let sound = self.low.is_finite() && self.high.is_finite() && self.low < self.high;
        if !sound || (self.periodic && self.high - self.low != TAU) {
            let Self { expression, low, high, .. } = self;
            return Err(Error::Plane(format!(
                "the range [{low}, {high}) of {expression} is not valid: write two finite numbers, the lower one first (a whole turn for an angle)"
            )));
        }
        Ok(())
    }
}

/// Counts of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlaneCell {
    /// Rows.
    pub rows: u64,
    /// Stays of a trajectory: consecutive rows.
    pub passages: u64,
    /// Passages in which the region changed.
    pub transitions: u64,
    /// Rows whose one-step error is known.
    pub scored: u64,
    /// Sum of their Mahalanobis scores.
    pub score: f64,
}

impl PlaneCell {
    /// Share of the passages in which the region changed; NaN without passages.
    pub fn transition_ratio(&self) -> f64 {
        self.transitions as f64 / self.passages as f64
    }

    /// Mean Mahalanobis score; NaN without scored rows.
    pub fn mean_score(&self) -> f64 {
        self.score / self.scored as f64
    }

    fn add(&mut self, other: &Self) {
        self.rows += other.rows;
        self.passages += other.passages;
        self.transitions += other.transitions;
        self.scored += other.scored;
        self.score += other.score;
    }
}

/// A model projected onto a plane.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Plane {
    /// The axes, across and up.
    pub axes: [Axis; 2],
    /// Cells along each axis.
    pub bins: usize,
    /// Cells: the second axis' bins of the first axis' first bin, then of its second, ...
    pub cells: Vec<PlaneCell>,
    /// Rows outside the axes, without a value on them, or without a region.
    pub outside: u64,
}

impl Plane {
    /// The cell of two bins.
    pub fn cell(&self, across: usize, up: usize) -> &PlaneCell {
        &self.cells[across * self.bins + up]
    }

    /// All cells as one.
    pub fn total(&self) -> PlaneCell {
        self.cells.iter().fold(PlaneCell::default(), |mut sum, cell| {
            sum.add(cell);
            sum
        })
    }
}

/// Projects a model's regions and one-step scores onto a plane, in one pass over the rows of a source whose columns are the model's.
///
/// Regions are those of the first latent's partition.
///
/// # Errors
/// [`Error::Plane`] for an axis without a range or no bins; those of [`Predictor::new`] and of reading.
pub fn plane(
    model: &Model,
    source: &dyn Source,
    axes: &[Axis; 2],
    bins: usize,
    progress: &dyn Progress,
) -> Result<Plane, Error> {
    if !(1..=MAX_BINS).contains(&bins) {
        return Err(Error::Plane(format!("{bins} bins; give 1 to {MAX_BINS}")));
    }
    axes.iter().try_for_each(Axis::check)?;
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let projector = Projector {
        predictor: Predictor::new(model, &names)?,
        program: Program::compile(&axes.each_ref().map(|axis| axis.expression.clone()), &names)?,
        metric: Mahalanobis::of_covariance(&model.training.target_covariance, model.training.target_mean.len()),
        axes,
        bins,
    };
    let (a, b) = (projector.predictor.halo(), projector.program.halo());
    let halo = fleetfoot_data::Halo { before: a.before.max(b.before), after: a.after.max(b.after) };
    let chunks = Grid { chunk_rows: CHUNK_ROWS }.chunks(source.episodes());
    let mut total = Trace::new(bins);
    let mut episode = usize::MAX;
    reduce(
        source,
        &chunks,
        halo,
        progress,
        || (Trace::new(bins), Tile::default()),
        |(trace, tile), _, block, rows| -> Result<(), Error> {
            projector.add(block, rows, tile, trace);
            Ok(())
        },
        |chunk, (trace, _)| {
            if chunk.episode != episode {
                total.leave();
                episode = chunk.episode;
            }
            total.append(&trace);
            Ok(())
        },
    )?;
    Ok(Plane { axes: axes.clone(), bins, cells: total.cells, outside: total.outside })
}

/// The smallest and the largest finite value; infinite the wrong way round where there is none.
fn extent(expression: &Expr, source: &dyn Source, progress: &dyn Progress) -> Result<(f64, f64), Error> {
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let program = Program::compile(std::slice::from_ref(expression), &names)?;
    let chunks = Grid { chunk_rows: CHUNK_ROWS }.chunks(source.episodes());
    let mut extent = (f64::INFINITY, f64::NEG_INFINITY);
    reduce(
        source,
        &chunks,
        program.halo(),
        progress,
        || ((f64::INFINITY, f64::NEG_INFINITY), Vec::new(), Scratch::default()),
        |((low, high), values, scratch), _, block, rows| -> Result<(), Error> {
            evaluate(&program, block, &rows, values, scratch);
            for &value in values.iter().filter(|value| value.is_finite()) {
                (*low, *high) = (low.min(value), high.max(value));
            }
            Ok(())
        },
        |_, ((low, high), ..)| {
            extent = (extent.0.min(low), extent.1.max(high));
            Ok(())
        },
    )?;
    Ok(extent)
}

struct Projector<'a> {
    predictor: Predictor,
    program: Program,
    metric: Mahalanobis,
    axes: &'a [Axis; 2],
    bins: usize,
}

/// Memory of a tile.
#[derive(Default)]
struct Tile {
    workspace: PredictorWorkspace,
    predicted: Predicted,
    values: Vec<f64>,
    scratch: Scratch,
    error: Vec<f64>,
    whitened: Vec<f64>,
}

impl Projector<'_> {
    fn add(&self, block: &Block, rows: std::ops::Range<usize>, tile: &mut Tile, trace: &mut Trace) {
        let Tile { workspace, predicted, values, scratch, error, whitened } = tile;
        self.predictor.predict(block, rows.clone(), workspace, predicted);
        evaluate(&self.program, block, &rows, values, scratch);
        error.resize(self.metric.dimension(), 0.0);
        whitened.resize(self.metric.width(), 0.0);
        let count = rows.len();
        for row in 0..count {
            let region = predicted.region[row];
            let bin = self.axes[0].bin(values[row], self.bins).zip(self.axes[1].bin(values[count + row], self.bins));
            let place = match bin {
                Some((across, up)) if region != u32::MAX => Some(Place { cell: across * self.bins + up, region }),
                _ => None,
            };
            trace.step(place);
            if let (Some(place), RowStatus::Complete) = (place, predicted.status[row]) {
                for (target, error) in error.iter_mut().enumerate() {
                    *error = predicted.residual[target * count + row];
                }
                let cell = &mut trace.cells[place.cell];
                cell.scored += 1;
                cell.score += self.metric.score_with(error, whitened);
            }
        }
    }
}

/// Place of a trajectory: cell and region.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    cell: usize,
    region: u32,
}

/// Sums over consecutive rows of an episode. Two traces of which one continues the other are appended exactly: a
/// passage that the cut divides is counted once.
#[derive(Debug, Clone)]
struct Trace {
    cells: Vec<PlaneCell>,
    outside: u64,
    rows: u64,
    first: Option<Place>,
    last: Option<Place>,
    /// True if all rows so far are one passage, which may have begun before the first.
    single: bool,
    /// True if the region changed within the passage of the first row, and of the last.
    first_changed: bool,
    last_changed: bool,
}

impl Trace {
    fn new(bins: usize) -> Self {
        Self {
            cells: vec![PlaneCell::default(); bins * bins],
            outside: 0,
            rows: 0,
            first: None,
            last: None,
            single: true,
            first_changed: false,
            last_changed: false,
        }
    }

    /// The next row.
    fn step(&mut self, place: Option<Place>) {
        if self.rows == 0 {
            self.first = place;
        }
        let Some(next) = place else {
            self.outside += 1;
            self.rows += 1;
            self.leave();
            return;
        };
        let stays = self.last.is_some_and(|last| last.cell == next.cell);
        let changed = self.last.is_some_and(|last| last.region != next.region);
        let cell = &mut self.cells[next.cell];
        cell.rows += 1;
        if stays {
            cell.transitions += u64::from(changed && !self.last_changed);
            self.last_changed |= changed;
        } else {
            cell.passages += 1;
            cell.transitions += u64::from(changed);
            self.last_changed = changed;
            self.single &= self.rows == 0;
        }
        if self.single {
            self.first_changed = self.last_changed;
        }
        self.last = place;
        self.rows += 1;
    }

    /// Ends the trajectory; the next row belongs to another one.
    fn leave(&mut self) {
        self.last = None;
        self.single &= self.rows == 0;
        self.last_changed = false;
    }

    /// Adds the trace of the rows that follow.
    fn append(&mut self, next: &Self) {
        if next.rows == 0 {
            return;
        }
        self.cells.iter_mut().zip(&next.cells).for_each(|(a, b)| a.add(b));
        self.outside += next.outside;
        let mut changed = next.first_changed;
        let mut joined = false;
        if let (Some(last), Some(first)) = (self.last, next.first) {
            joined = last.cell == first.cell;
            let already = u64::from(next.first_changed) + u64::from(joined && self.last_changed);
            changed |= last.region != first.region || (joined && self.last_changed);
            let cell = &mut self.cells[first.cell];
            cell.passages -= u64::from(joined);
            cell.transitions = cell.transitions + u64::from(changed) - already;
        }
        if self.rows == 0 {
            (self.first, self.first_changed) = (next.first, changed);
        } else if self.single && joined {
            self.first_changed = changed;
        }
        self.single = next.single && (self.rows == 0 || (self.single && joined));
        self.last_changed = if next.single { changed } else { next.last_changed };
        self.last = next.last;
        self.rows += next.rows;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(cell: usize, region: u32) -> Option<Place> {
        Some(Place { cell, region })
    }

    #[test]
    fn passages_and_transitions_by_hand() {
        let mut trace = Trace::new(2);
        // Cell 0 without a change, cell 1 entered with a change and two more, cell 1 again after a gap, cell 0 entered with a change.
        for step in [place(0, 5), place(0, 5), place(1, 6), place(1, 7), place(1, 5), None, place(1, 5), place(0, 4)] {
            trace.step(step);
        }
        let summary = |cell: usize| {
            let cell = trace.cells[cell];
            (cell.rows, cell.passages, cell.transitions)
        };
        assert_eq!((summary(0), summary(1), trace.outside), ((3, 2, 1), (4, 2, 1), 1));
        assert_eq!(trace.cells[1].transition_ratio(), 0.5);
        assert!(trace.cells[2].transition_ratio().is_nan());
    }

    #[test]
    fn appended_traces_equal_uncut_traces() {
        // A linear congruential generator is random enough for cuts (Knuth's MMIX constants).
        let mut state = 4u64;
        let mut random = |below: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) % below) as usize
        };
        for _ in 0..2_000 {
            let rows = 1 + random(40);
            let steps: Vec<Option<Place>> = (0..rows)
                .map(|_| {
                    let place = Place { cell: random(3) / 2, region: random(3) as u32 / 2 };
                    (random(8) > 0).then_some(place)
                })
                .collect();
            let (a, b) = (random(rows as u64 + 1), random(rows as u64 + 1));
            let trace = |steps: &[Option<Place>]| {
                let mut trace = Trace::new(2);
                steps.iter().for_each(|&step| trace.step(step));
                trace
            };
            let whole = trace(&steps);
            let (a, b) = (a.min(b), a.max(b));
            let parts = [trace(&steps[..a]), trace(&steps[a..b]), trace(&steps[b..])];
            let mut left = parts[0].clone();
            left.append(&parts[1]);
            left.append(&parts[2]);
            let mut middle = parts[1].clone();
            middle.append(&parts[2]);
            let mut right = parts[0].clone();
            right.append(&middle);
            for appended in [left, right] {
                assert_eq!(appended.cells, whole.cells, "{steps:?} {a} {b}");
                assert_eq!((appended.outside, appended.last), (whole.outside, whole.last));
            }
        }
    }

    #[test]
    fn bins_of_angles_wrap_and_ranges_end() {
        let angle = Axis::angle(Expr::column("a"));
        for (value, bin) in [(0.0, 0), (TAU, 0), (-1e-9, 3), (-1e-18, 0), (-3.0 * TAU + 1.6, 1), (3.2, 2)] {
            assert_eq!(angle.bin(value, 4), Some(bin), "{value}");
        }
        let range = Axis::range(Expr::column("x"), -1.0, 1.0);
        assert_eq!([-1.0, -0.01, 0.0, 0.99].map(|x| range.bin(x, 2)), [Some(0), Some(0), Some(1), Some(1)]);
        assert_eq!([-1.01, 1.0, f64::NAN, f64::INFINITY].map(|x| range.bin(x, 2)), [None; 4]);
        assert_eq!(range.centre(1, 2), 0.5);
        assert_eq!(angle.bin(f64::NAN, 4), None);
    }
}
