//! What was recorded, at the rows of a grid.

use fleetfoot_data::{Halo, Source};
use fleetfoot_library::UnknownColumn;
use fleetfoot_model::Model;

use crate::EstimateError;
use crate::transcription::Transcription;

/// An episode at the rows of its grid.
pub(crate) struct Recorded {
    pub(crate) episode: usize,
    /// Rows of the episode (r).
    pub(crate) rows: Vec<usize>,
    /// Nanoseconds (r).
    pub(crate) stamps: Vec<i64>,
    /// Since the episode's start (r).
    pub(crate) seconds: Vec<f64>,
    /// States and free inputs (r x columns): angles without jumps, what is missing between its neighbours.
    pub(crate) values: Vec<f64>,
    /// Whether a value was recorded (r x columns).
    pub(crate) there: Vec<bool>,
    /// What is replayed (r x replayed).
    pub(crate) replayed: Vec<f64>,
    /// Whether all of it was recorded (r).
    pub(crate) whole: Vec<bool>,
}

/// Reads episodes.
pub(crate) struct Reader<'a> {
    source: &'a dyn Source,
    every: usize,
    states: usize,
    /// Columns of the source: those that are followed, then those that are replayed.
    columns: Vec<usize>,
    followed: usize,
    angle: Vec<bool>,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(
        model: &Model,
        transcription: &Transcription,
        source: &'a dyn Source,
        every: usize,
    ) -> Result<Self, EstimateError> {
        let names = transcription.names().iter().chain(transcription.replayed());
        let find = |name: &String| {
            source.column_index(name).ok_or_else(|| {
                let known = source.columns().iter().map(|column| column.name.as_str());
                EstimateError::from(UnknownColumn { name: name.clone(), nearest: fleetfoot_data::nearest(name, known) })
            })
        };
        let angle = |name: &String| model.column(name).is_some_and(|at| model.columns[at].angle);
        Ok(Self {
            source,
            every,
            states: transcription.states(),
            columns: names.clone().map(find).collect::<Result<_, _>>()?,
            followed: transcription.names().len(),
            angle: names.map(angle).collect(),
        })
    }

    /// States, and columns that are followed.
    pub(crate) fn shape(&self) -> [usize; 2] {
        [self.states, self.followed]
    }

    /// Reads an episode; `None` where a column has no value at all, or the grid has fewer than two rows.
    pub(crate) fn read(&self, episode: usize) -> Result<Option<Recorded>, EstimateError> {
        let count = self.source.episodes()[episode].rows;
        let rows: Vec<usize> = (0..count).step_by(self.every).collect();
        if rows.len() < 2 {
            return Ok(None);
        }
        let block = self.source.read(episode, 0..count, Halo::default())?;
        let stamps: Vec<i64> = rows.iter().map(|&row| block.stamps()[row]).collect();
        let (width, replays) = (self.followed, self.columns.len() - self.followed);
        let seconds: Vec<f64> = stamps.iter().map(|stamp| (stamp - block.start) as f64 * 1e-9).collect();
        let mut values = vec![0.0; rows.len() * width];
        let mut there = vec![false; rows.len() * width];
        let mut replayed = vec![0.0; rows.len() * replays];
        let mut whole = vec![true; rows.len()];
        for (at, &column) in self.columns.iter().enumerate() {
            let mut own: Vec<f64> = rows.iter().map(|&row| block.core(column)[row]).collect();
            let known: Vec<bool> = own.iter().map(|value| value.is_finite()).collect();
            if self.angle[at] {
                unwrap(&mut own);
            }
            if !fill(&seconds, &mut own) {
                return Ok(None);
            }
            for (k, (value, known)) in own.into_iter().zip(known).enumerate() {
                match at.checked_sub(width) {
                    Some(place) => {
                        replayed[k * replays + place] = value;
                        whole[k] &= known;
                    }
                    None => (values[k * width + at], there[k * width + at]) = (value, known),
                }
            }
        }
        Ok(Some(Recorded { episode, rows, stamps, seconds, values, there, replayed, whole }))
    }
}

/// Turns an angle on where it jumps by more than half a turn.
fn unwrap(values: &mut [f64]) {
    let turn = std::f64::consts::TAU;
    let mut last: Option<f64> = None;
    for value in values.iter_mut().filter(|value| value.is_finite()) {
        if let Some(last) = last {
            *value += turn * ((last - *value) / turn).round();
        }
        last = Some(*value);
    }
}

/// Puts what is missing on the line between its neighbours; `false` where there is nothing.
fn fill(seconds: &[f64], values: &mut [f64]) -> bool {
    let known: Vec<usize> = (0..values.len()).filter(|&k| values[k].is_finite()).collect();
    let (Some(&first), Some(&last)) = (known.first(), known.last()) else { return false };
    let (head, tail) = (values[first], values[last]);
    values[..first].fill(head);
    values[last..].fill(tail);
    for pair in known.windows(2).filter(|pair| pair[1] > pair[0] + 1) {
        let (from, to) = (pair[0], pair[1]);
        let slope = (values[to] - values[from]) / (seconds[to] - seconds[from]);
        for k in from + 1..to {
            values[k] = values[from] + slope * (seconds[k] - seconds[from]);
        }
    }
    true
}

impl Recorded {
    /// Columns that are followed.
    pub(crate) fn width(&self) -> usize {
        self.values.len() / self.rows.len()
    }

    /// Weights of the trapezoid rule, over the mean step (r).
    pub(crate) fn weights(&self) -> Vec<f64> {
        let rows = self.seconds.len();
        let mean = (self.seconds[rows - 1] - self.seconds[0]) / (rows - 1) as f64;
        let step = |k: usize| self.seconds[k + 1] - self.seconds[k];
        let weight =
            |k: usize| 0.5 * (if k > 0 { step(k - 1) } else { 0.0 } + if k + 1 < rows { step(k) } else { 0.0 }) / mean;
        (0..rows).map(weight).collect()
    }

    pub(crate) fn survey(&self) -> Survey {
        let width = self.width();
        let mut columns =
            vec![Seen { count: 0.0, mean: 0.0, squares: 0.0, range: [f64::INFINITY, f64::NEG_INFINITY] }; width];
        for (at, &value) in self.values.iter().enumerate().filter(|(at, _)| self.there[*at]) {
            columns[at % width].add(value);
        }
        Survey { columns }
    }
}

/// What the recordings show of every column.
pub(crate) struct Survey {
    columns: Vec<Seen>,
}

#[derive(Clone, Copy)]
struct Seen {
    count: f64,
    mean: f64,
    /// Of what differs from the mean.
    squares: f64,
    range: [f64; 2],
}

impl Seen {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        let before = value - self.mean;
        self.mean += before / self.count;
        self.squares += before * (value - self.mean);
        self.range = [self.range[0].min(value), self.range[1].max(value)];
    }

    /// Chan's formula.
    fn merge(&mut self, other: &Self) {
        let (count, apart) = (self.count + other.count, other.mean - self.mean);
        self.squares += other.squares + apart * apart * self.count * other.count / count;
        self.mean += apart * other.count / count;
        self.count = count;
        self.range = [self.range[0].min(other.range[0]), self.range[1].max(other.range[1])];
    }

    /// The standard deviation; of what does not move, its size.
    fn spread(&self) -> f64 {
        let deviation = (self.squares / self.count).sqrt();
        let size = if self.mean == 0.0 { 1.0 } else { self.mean.abs() };
        if deviation > 1e-9 * size { deviation } else { size }
    }
}

impl Survey {
    pub(crate) fn pooled(surveys: impl Iterator<Item = Self>) -> Self {
        let mut pooled: Option<Self> = None;
        for own in surveys {
            match &mut pooled {
                None => pooled = Some(own),
                Some(pooled) => pooled.columns.iter_mut().zip(&own.columns).for_each(|(sum, seen)| sum.merge(seen)),
            }
        }
        pooled.unwrap_or(Self { columns: Vec::new() })
    }

    pub(crate) fn spreads(&self) -> Vec<f64> {
        self.columns.iter().map(Seen::spread).collect()
    }

    /// The ranges, widened on both sides by a share of them; of what does not move, of its size.
    pub(crate) fn ranges(&self, widen: f64) -> Vec<[f64; 2]> {
        let widened = |seen: &Seen| {
            let [low, high] = seen.range;
            let by = (widen * (high - low)).max(1e-6 * seen.spread());
            [low - by, high + by]
        };
        self.columns.iter().map(widened).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_bridged_and_angles_turn_on() {
        let seconds = [0.0, 1.0, 3.0, 4.0, 5.0];
        let mut values = [f64::NAN, 2.0, f64::NAN, 8.0, f64::NAN];
        assert!(fill(&seconds, &mut values));
        assert_eq!(values, [2.0, 2.0, 6.0, 8.0, 8.0]);
        assert!(!fill(&seconds, &mut [f64::NAN; 5]));
        let mut angle = [3.0, f64::NAN, -3.0, -1.0];
        unwrap(&mut angle);
        assert!((angle[2] - (std::f64::consts::TAU - 3.0)).abs() < 1e-15 && angle[3] > angle[2]);
    }

    #[test]
    fn surveys_of_parts_are_that_of_the_whole() {
        let values: Vec<f64> = (0..40).map(|k| f64::from(k * k % 17) + 1e6).collect();
        let of = |values: &[f64]| {
            let mut seen = Seen { count: 0.0, mean: 0.0, squares: 0.0, range: [f64::INFINITY, f64::NEG_INFINITY] };
            values.iter().for_each(|&value| seen.add(value));
            Survey { columns: vec![seen] }
        };
        let parts = Survey::pooled([of(&values[..7]), of(&values[7..])].into_iter());
        let whole = of(&values);
        assert!((parts.spreads()[0] / whole.spreads()[0] - 1.0).abs() < 1e-12);
        assert_eq!(parts.ranges(0.5), [[1e6 - 8.0, 1e6 + 24.0]]);
    }
}
