//! Episodes, read at the rows of their grids.

use fleetfoot_data::{Halo, Source};
use fleetfoot_library::UnknownColumn;
use fleetfoot_model::{Model, RotationKind};

use crate::{EstimateError, recorded::Recorded, transcription::Transcription};

/// Reads episodes.
pub(crate) struct Reader<'a> {
    source: &'a dyn Source,
    every: usize,
    states: usize,
    /// Columns of the source: those that are followed, then those that are replayed.
    columns: Vec<usize>,
    followed: usize,
    angle: Vec<bool>,
    /// The rotations: how they are written, and the place of each part among the columns.
    rotations: Vec<(RotationKind, Vec<usize>)>,
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
            angle: names.clone().map(angle).collect(),
            rotations: model.rotations_among(&names.collect::<Vec<_>>()),
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
        let column = |&column: &usize| rows.iter().map(|&row| block.core(column)[row]).collect();
        let mut columns: Vec<Vec<f64>> = self.columns.iter().map(column).collect();
        for (kind, places) in &self.rotations {
            let mut parts: Vec<Vec<f64>> = places.iter().map(|&place| std::mem::take(&mut columns[place])).collect();
            kind.turn_on(&mut parts);
            places.iter().zip(parts).for_each(|(&place, part)| columns[place] = part);
        }
        for (at, mut column) in columns.into_iter().enumerate() {
            let known: Vec<bool> = column.iter().map(|value| value.is_finite()).collect();
            if self.angle[at] {
                unwrap(&mut column);
            }
            if !fill(&seconds, &mut column) {
                return Ok(None);
            }
            for (k, (value, known)) in column.into_iter().zip(known).enumerate() {
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

/// Fills missing values on the line between their neighbours; `false` without any value.
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
}
