//! Steps of the simulations that compare models: the correlation time of the states, at most half of a held-out part.

use fleetfoot_data::{Halo, Source};
use fleetfoot_dataset::Error;
use fleetfoot_fit::{RolloutRule, Simulations};
use fleetfoot_stats::Autocorrelation;
use serde::Serialize;

/// The shortest and the longest horizon, rows.
const LEAST: usize = 5;
const MOST: usize = 500;
/// Rows of an episode, and of all, that the correlation is computed from.
const ROWS: usize = 50_000;
const ALL: usize = 200_000;
/// Rows in front of every simulation: the lags that models may have.
const BEFORE: usize = 20;

/// Steps of the simulations that compare models.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct HorizonChoice {
    /// Steps, one a row.
    pub steps: usize,
    /// The same in seconds; 0 without a clock.
    pub seconds: f64,
    /// Rows after which the autocorrelation of the states is 1/e, in the median.
    pub correlation: usize,
    /// Rows in front of every simulation.
    pub before: usize,
    /// Rows of the longest held-out part of a fold.
    #[serde(skip)]
    pub(crate) room: usize,
}

impl HorizonChoice {
    /// The same time in steps of so many rows.
    pub(crate) fn at_every(&self, every: usize) -> Self {
        Self { steps: (self.steps / every).max(1), before: self.before.min(self.room / every / 4), ..*self }
    }

    /// Simulations of the folds, for a model that sees one of so many rows.
    pub(crate) fn simulations(&self, every: usize) -> Simulations {
        let shorter = self.at_every(every);
        Simulations { rule: RolloutRule::new(shorter.steps), before: shorter.before, limit: None }
    }

    /// Most steps of a simulation that held-out spans of `room` rows have room for; 0: none.
    pub(crate) fn longest(room: usize) -> usize {
        MOST.min(room.saturating_sub(before(room) + 2))
    }

    /// The horizon of rows, whose states are these columns; no longer than held-out spans of `room` rows allow. `None`: they are too short for any.
    ///
    /// # Errors
    /// Those of reading.
    pub(crate) fn of(
        rows: &dyn Source,
        states: &[(usize, bool)],
        room: usize,
        (given, step): (Option<usize>, f64),
    ) -> Result<Option<Self>, Error> {
        let (before, most) = (before(room), Self::longest(room));
        let correlation = correlation(rows, states)?;
        if most < LEAST.min(given.unwrap_or(LEAST)) {
            return Ok(None);
        }
        // Half of a held-out part has room for starts that differ, and for models of longer steps.
        let chosen = correlation.clamp(LEAST, MOST.min(room / 2).max(LEAST));
        let steps = given.unwrap_or(chosen).min(most);
        Ok(Some(Self { steps, seconds: steps as f64 * step, correlation, before, room }))
    }
}

/// Rows in front of every simulation, of held-out spans of `room` rows.
fn before(room: usize) -> usize {
    BEFORE.min(room / 4)
}

/// Rows after which the autocorrelation of the states is below 1/e, in the median over the states.
fn correlation(rows: &dyn Source, states: &[(usize, bool)]) -> Result<usize, Error> {
    let lags = lags();
    let mut seen: Vec<Autocorrelation> = states.iter().map(|_| Autocorrelation::new(&lags)).collect();
    let mut left = ALL;
    for (at, episode) in rows.episodes().iter().enumerate() {
        let count = episode.rows.min(ROWS).min(left);
        left -= count;
        if count == 0 {
            break;
        }
        let block = rows.read(at, 0..count, Halo::default())?;
        for (correlations, &(place, angle)) in seen.iter_mut().zip(states) {
            block.core(place).iter().for_each(|&value| correlations.push(if angle { value.sin() } else { value }));
            correlations.interrupt();
        }
    }
    let first = |correlations: &Autocorrelation| {
        let by_lag = correlations.coefficients();
        let below = by_lag.iter().position(|value| *value < (-1.0f64).exp());
        below.map_or(MOST, |at| lags[at])
    };
    let mut horizons: Vec<usize> = seen.iter().map(first).collect();
    horizons.sort_unstable();
    Ok(horizons.get(horizons.len() / 2).copied().unwrap_or(LEAST))
}

/// Lags up to the longest horizon, each about a tenth longer than the one before.
fn lags() -> Vec<usize> {
    let mut lags = vec![1];
    while let Some(&last) = lags.last().filter(|last| **last < MOST) {
        lags.push((last + 1).max(last * 11 / 10).min(MOST));
    }
    lags
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource};

    use super::*;

    /// A first-order system under white noise forgets within its time constant.
    #[test]
    fn horizon_is_the_memory_of_states() {
        let mut state = 1u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let mut x = 0.0;
        let values: Vec<f64> = (0..40_000)
            .map(|_| {
                x = (-1.0f64 / 30.0).exp() * x + noise();
                x
            })
            .collect();
        let mut source = MemorySource::new(vec![Column::float("x")]);
        source.push_uniform("a", 0.01, vec![values]);
        let choice = HorizonChoice::of(&source, &[(0, false)], 1000, (None, 0.01)).unwrap().unwrap();
        assert!((24..=37).contains(&choice.steps), "{choice:?}");
        assert!((choice.seconds - 0.01 * choice.steps as f64).abs() < 1e-12);
        assert_eq!(HorizonChoice::of(&source, &[(0, false)], 40, (None, 0.01)).unwrap().unwrap().steps, 20);
        assert_eq!(HorizonChoice::of(&source, &[(0, false)], 1000, (Some(7), 0.01)).unwrap().unwrap().steps, 7);
        assert_eq!(HorizonChoice::of(&source, &[(0, false)], 6, (None, 0.01)).unwrap(), None);
        // The longest horizon of a short span is one that can be asked for.
        let longest = HorizonChoice::longest(6);
        let choice = HorizonChoice::of(&source, &[(0, false)], 6, (Some(longest), 0.01)).unwrap().unwrap();
        assert_eq!((choice.steps, choice.steps + choice.before + 2), (3, 6));
    }
}
