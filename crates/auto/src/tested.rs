//! Errors of a chosen model on the rows that neither fits nor the choice saw.

use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::{Logs, Part};
use fleetfoot_dynamics::{Error as DynamicsError, Estimate, Starts, student_t_95};
use fleetfoot_fit::{Error, against_persistence, simulation_options};
use fleetfoot_model::Model;
use fleetfoot_recipe::Recipe;
use fleetfoot_run::{opened_to_roll, roll_rows};

use crate::horizon::HorizonChoice;

/// Simulations of the test at most, and the parts of it whose errors give the intervals.
const STARTS: usize = 200;
const PARTS: usize = 10;

/// Simulations of the test rows.
pub(crate) struct Simulated {
    pub(crate) states: Vec<String>,
    /// Of every part, state by state: squared errors, mean over the part's simulations and steps.
    model: Vec<Vec<f64>>,
    persistence: Vec<Vec<f64>>,
    /// Simulations that left the training range.
    pub(crate) outside: usize,
    /// Simulations that diverged.
    pub(crate) ended: usize,
    pub(crate) starts: usize,
}

/// Simulates a model on the test rows of logs. Starts are the same for all models.
///
/// # Errors
/// Those of opening and simulating.
pub(crate) fn simulated(
    model: &Model,
    changes: &Recipe,
    logs: &Logs,
    horizon: &HorizonChoice,
    progress: &dyn Progress,
) -> Result<Simulated, Error> {
    let (model, dataset) = opened_to_roll(model, changes, &logs.only(Part::Test), None, progress)?;
    let view = dataset.view()?;
    // A test that is a little shorter than the folds is simulated as far as it reaches.
    let longest = view.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
    let steps = horizon.steps.min(longest.saturating_sub(horizon.before + 2)).max(1);
    let starts = Starts::Even(STARTS).choose(&view, steps, horizon.before, steps + 1)?;
    let options = simulation_options(steps);
    let mut tested =
        Simulated { states: Vec::new(), model: Vec::new(), persistence: Vec::new(), outside: 0, ended: 0, starts: 0 };
    let mut missing = None;
    for part in starts.chunks(starts.len().div_ceil(PARTS)) {
        let rolled = match roll_rows(&model, &dataset, &Starts::At(part.to_vec()), &options, None, progress) {
            Ok(rolled) => rolled.rollouts,
            // The first rows of the test have no past for an input that acts late.
            Err(error @ Error::Dynamics(DynamicsError::MissingValues { .. })) => {
                missing = Some(error);
                continue;
            }
            Err(error) => return Err(error),
        };
        let (model_errors, still) = against_persistence(&rolled.horizon);
        let squares = |errors: Vec<f64>| errors.into_iter().map(|error| error * error).collect::<Vec<f64>>();
        tested.model.push(squares(model_errors));
        tested.persistence.push(squares(still));
        tested.states.clone_from(&rolled.horizon.states);
        tested.outside += rolled.left_domain();
        tested.ended += rolled.diverged() + rolled.without_region();
        tested.starts += rolled.outcomes.len();
    }
    match missing {
        Some(error) if tested.starts == 0 => Err(error),
        _ => Ok(tested),
    }
}

impl Simulated {
    /// The error of a state with the interval in which 95 % of the errors on other rows of such logs are: as wide as that over the parts of the test, and as the scatter between
    /// the test and the folds that held other rows out.
    pub(crate) fn interval(&self, state: usize, folds: &[f64]) -> Estimate {
        widened(self.rmse(state), folds)
    }

    /// Root of the mean squared error of a state, with its 95 % interval over the parts of the test.
    pub(crate) fn rmse(&self, state: usize) -> Estimate {
        root(self.model.iter().map(|part| part[state]))
    }

    /// The same of persistence.
    pub(crate) fn persistence(&self, state: usize) -> Estimate {
        root(self.persistence.iter().map(|part| part[state]))
    }
}

/// The root of a mean, with its interval on a logarithmic scale: no end of it is negative.
fn root(squares: impl Iterator<Item = f64>) -> Estimate {
    let squares: Vec<f64> = squares.filter(|value| value.is_finite()).collect();
    let count = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / count;
    let value = mean.sqrt();
    if squares.len() < 2 || mean == 0.0 {
        return Estimate { value, low: f64::NAN, high: f64::NAN };
    }
    let variance = squares.iter().map(|square| (square - mean).powi(2)).sum::<f64>() / (count - 1.0);
    // Of the logarithm of the root: half of that of the mean.
    let half = 0.5 * student_t_95(squares.len() - 1) * (variance / count).sqrt() / mean;
    Estimate { value, low: value * (-half).exp(), high: value * half.exp() }
}

/// An interval widened to that in which the error of one more part of the logs is, given the errors of the test and of
/// the folds: the prediction interval of a normal distribution of their logarithms.
fn widened(error: Estimate, others: &[f64]) -> Estimate {
    let usable = |value: &f64| value.is_finite() && *value > 0.0;
    let logs: Vec<f64> = others.iter().copied().chain([error.value]).filter(usable).map(f64::ln).collect();
    let count = logs.len() as f64;
    if logs.len() < 3 || !usable(&error.value) {
        return error;
    }
    let mean = logs.iter().sum::<f64>() / count;
    let variance = logs.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let half = student_t_95(logs.len() - 1) * (variance * (1.0 + 1.0 / count)).sqrt();
    let (low, high) = ((mean - half).exp(), (mean + half).exp());
    Estimate { value: error.value, low: low.min(error.low), high: high.max(error.high) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors of parts that scatter by a factor: nine in ten of others are within the interval, and those of the parts of one test alone are not.
    #[test]
    fn the_scatter_between_folds_widens_the_interval() {
        let narrow = Estimate { value: 2.0, low: 1.9, high: 2.1 };
        let same = widened(narrow, &[2.0; 5]);
        assert_eq!((same.low, same.high), (1.9, 2.1));
        let wide = widened(narrow, &[1.0, 4.0, 2.0, 1.0, 4.0]);
        // Logarithms to base 2 are 0, 0, 1, 1, 2, 2: mean 1, variance 0.8; t of five degrees of freedom is 2.5706.
        let half = 2.5706 * (0.8 * 7.0 / 6.0f64).sqrt();
        let end = |sign: f64| (1.0 + sign * half).exp2();
        assert!((wide.low / end(-1.0) - 1.0).abs() < 1e-4 && (wide.high / end(1.0) - 1.0).abs() < 1e-4, "{wide:?}");
        assert_eq!(wide.value, 2.0);
        assert_eq!(widened(narrow, &[f64::INFINITY, f64::NAN]), narrow);
    }

    #[test]
    fn intervals_of_roots_are_positive() {
        let interval = root([1.0, 4.0, 100.0].into_iter());
        assert!(
            (interval.value - 35.0f64.sqrt()).abs() < 1e-12 && interval.low > 0.0 && interval.high > interval.value
        );
        assert!(root([4.0].into_iter()).low.is_nan());
        let same = root([4.0; 5].into_iter());
        assert_eq!((same.value, same.low, same.high), (2.0, 2.0, 2.0));
    }
}
