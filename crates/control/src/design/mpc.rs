//! Predictive control of a model about a set point: the numbers of the program that is solved at every sample.

use fleetfoot_model::Model;

use super::{
    MpcOptions,
    gains::Answer,
    lqr::{Design, Lqr, designed, rows_of},
    setpoint::Rest,
};
use crate::{
    Error,
    control_error::ControlError,
    controller::{ErrorBound, MOST_SAMPLES, PredictedStep, PredictedTarget, Prediction},
    pieces::Affine,
};

/// Weight of the squared violation of a bound in sizes of its state, of the largest weight of a state in sizes. A
/// violation that saves as much cost as the heaviest error then has a ten-thousandth of this error.
const PENALTY: f64 = 1e4;

/// The regulator of [`super::lqr`] with a prediction: at every sample a plan of inputs within their limits that
/// minimises the regulator's cost over the horizon, the last state weighed by the regulator's cost of its future
/// (Mayne, Rawlings, Rao, Scokaert, "Constrained model predictive control: stability and optimality", Automatica 36,
/// 2000). While no limit and no bound is active, the first input of the plan is that of the regulator.
///
/// The submodels are linearised about the set point, as for the regulator. The regions of a plan are those along the
/// path that it predicts.
///
/// # Errors
/// Those of [`super::lqr`]; a horizon that is 0 or longer than [`MOST_SAMPLES`], bounds of unknown states, and bounds
/// without the set point.
pub fn mpc(model: &Model, options: &MpcOptions) -> Result<Lqr, Error> {
    if !(1..=MOST_SAMPLES).contains(&options.horizon) {
        let value = options.horizon as f64;
        let allowed = "a number of samples from 1 to 200";
        return Err(ControlError::Value { of: "horizon", name: "it".into(), value, allowed }.into());
    }
    designed(model, &options.lqr, Some(options))
}

impl Design<'_> {
    /// The prediction by the steps of the laws; `own` is the law of the set point.
    pub(super) fn prediction(
        &self,
        options: &MpcOptions,
        steps: &[&Affine],
        own: usize,
        rest: &Rest,
    ) -> Result<Prediction, ControlError> {
        let step = |step: &&Affine| {
            let (a, b) = self.kept_step(step);
            let columns: Vec<Vec<f64>> = self.measured.iter().map(|&input| self.moved_by(step, input)).collect();
            PredictedStep {
                a: rows_of(&a),
                b: rows_of(&b),
                constant: self.moved(step, rest),
                measured: transposed(&columns, self.kept.len()),
            }
        };
        let (a, b) = self.kept_step(steps[own]);
        let gains = self
            .weights
            .gains(a.as_ref(), b.as_ref())
            .ok_or_else(|| ControlError::Riccati { place: "the model".into(), problem: "it diverges".into() })?;
        let answer = |d: &[f64]| self.weights.answer(&gains, a.as_ref(), b.as_ref(), d);
        let Answer { errors, inputs, .. } = answer(&self.moved(steps[own], rest));
        let slopes: Vec<Answer> =
            self.measured.iter().map(|&input| answer(&self.moved_by(steps[own], input))).collect();
        let of = |values: &dyn Fn(&Answer) -> Vec<f64>, rows: usize| {
            transposed(&slopes.iter().map(values).collect::<Vec<_>>(), rows)
        };
        let (n, m) = (self.kept.len(), self.driven.len());
        let integrals = self.weights.integrated.iter().map(|&(_, weight)| weight);
        Ok(Prediction {
            horizon: options.horizon,
            weights: self.weights.q.iter().copied().chain(integrals).collect(),
            input_weights: self.weights.r.clone(),
            input_sizes: self.weights.input_sizes.clone(),
            terminal: rows_of(&gains.cost()),
            target: PredictedTarget {
                law: own,
                measured_errors: of(&|answer| answer.errors.clone(), n),
                measured_inputs: of(&|answer| answer.inputs.clone(), m),
                inputs: self.driven.iter().zip(inputs).map(|(&input, change)| rest.u[input] + change).collect(),
                errors,
            },
            bounds: self.bounds(options, rest)?,
            at: self.driven.iter().map(|&input| rest.u[input]).collect(),
            steps: steps.iter().map(step).collect(),
        })
    }

    fn bounds(&self, options: &MpcOptions, rest: &Rest) -> Result<Vec<ErrorBound>, ControlError> {
        let heaviest = (self.weights.q.iter().zip(&self.weights.state_sizes))
            .map(|(weight, size)| weight * size * size)
            .fold(0.0, f64::max);
        let mut bounds = Vec::new();
        for (name, lowest, highest) in &options.bounds {
            let at = |place: usize| self.coordinates.of_state(self.kept[place], &rest.x);
            for place in self.coordinates.find("bounds", "kept state", name, &self.kept)? {
                let (lowest, highest, at) = (*lowest, *highest, at(place));
                if lowest >= highest || lowest.is_nan() || highest.is_nan() {
                    let allowed = "a number above the lowest value";
                    return Err(ControlError::Value { of: "bounds", name: name.clone(), value: highest, allowed });
                }
                if !(lowest..=highest).contains(&at) {
                    return Err(ControlError::Excluded { name: name.clone(), at, lowest, highest });
                }
                bounds.push(ErrorBound {
                    error: place,
                    lowest: (lowest - at).max(f64::MIN),
                    highest: (highest - at).min(f64::MAX),
                    weight: PENALTY * heaviest / self.weights.state_sizes[place].powi(2),
                });
            }
        }
        Ok(bounds)
    }
}

/// Columns as rows of so many; none if there is no column.
fn transposed(columns: &[Vec<f64>], rows: usize) -> Vec<Vec<f64>> {
    if columns.is_empty() {
        return Vec::new();
    }
    (0..rows).map(|row| columns.iter().map(|column| column[row]).collect()).collect()
}
