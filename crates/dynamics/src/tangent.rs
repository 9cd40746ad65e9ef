//! Exact derivatives of a model at points, for filters and controllers.

use fleetfoot_model::{Equation, Prediction};

use crate::{
    Error, Method, Points, Stepper, StepperWorkspace,
    slopes::{Reading, Slopes},
};

/// The derivatives of a model's right sides with respect to its states and inputs, compiled.
///
/// Within the region of a point; values of earlier rows, and time, are held.
pub struct Tangent {
    slopes: Slopes,
    /// Columns of the states, then of the inputs.
    variables: Vec<usize>,
}

/// `f = A x + B u + c` to first order at a point; matrices by rows.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Linearized {
    /// States x states.
    pub a: Vec<f64>,
    /// States x inputs.
    pub b: Vec<f64>,
    /// One a state.
    pub c: Vec<f64>,
}

impl Tangent {
    /// Differentiates the equations of the stepper's model.
    ///
    /// # Errors
    /// [`Error::UnknownColumn`].
    pub fn new(stepper: &Stepper) -> Result<Self, Error> {
        let model = &stepper.model;
        let variables: Vec<usize> =
            stepper.states.iter().map(|state| state.column).chain(stepper.inputs.iter().copied()).collect();
        let of_state = |column: usize| {
            let advances = |equation: &&Equation| {
                equation.subject == model.columns[column].name && equation.prediction != Prediction::Value
            };
            let lag = stepper.lags.iter().find(|lag| lag.column == column).map(|lag| &lag.equation);
            model.equations.iter().find(advances).or(lag)
        };
        let sides: Vec<Option<&Equation>> = stepper.states.iter().map(|state| of_state(state.column)).collect();
        let present: Vec<Reading> = variables.iter().map(|&column| (column, 0)).collect();
        Ok(Self { slopes: Slopes::new(model, &stepper.compiled, &sides, &present)?, variables })
    }

    /// Derivatives of the states' right sides at the points (points x states x variables, the states before the inputs), after
    /// [`Stepper::evaluate`] there.
    pub(crate) fn right_slopes(&self, stepper: &Stepper, points: &Points, workspace: &StepperWorkspace) -> Vec<f64> {
        self.slopes.evaluate(&stepper.compiled, points.count(), &|leaf| points.leaf(leaf), &workspace.model).total
    }

    /// The equations at each point to first order: the derivatives of the states, where any is integrated, else their next values (angles not wrapped).
    pub fn linearize(&self, stepper: &Stepper, points: &Points, workspace: &mut StepperWorkspace) -> Vec<Linearized> {
        stepper.evaluate(points, workspace);
        let mut slopes = self.right_slopes(stepper, points, workspace);
        let (count, states, width) = (points.count(), stepper.states.len(), self.variables.len());
        let mut values: Vec<f64> = Vec::with_capacity(count * states);
        for b in 0..count {
            for (s, state) in stepper.states.iter().enumerate() {
                // `gain * f + factor * x`: of a lag that is (f - x)/c where derivatives are integrated, else its value a sample later.
                let (gain, factor) = match (stepper.is_continuous(), state.advance.lag) {
                    (true, Some(constant)) => (1.0 / constant, -1.0 / constant),
                    (true, None) => (1.0, 0.0),
                    (false, _) => (state.advance.gain(stepper.step()), state.advance.factor(stepper.step())),
                };
                let row = &mut slopes[(b * states + s) * width..][..width];
                row.iter_mut().for_each(|slope| *slope *= gain);
                row[s] += factor;
                let (right, x) = (stepper.right_side(s, count, workspace)[b], points.column(state.column, 0)[b]);
                values.push(gain * right + if factor == 0.0 { 0.0 } else { factor * x });
            }
        }
        self.split(&values, &slopes, points, states)
    }

    /// A step of `seconds` ([`Stepper::next`]) at each point to first order, inputs held (angles not wrapped).
    pub fn linearize_step(
        &self,
        stepper: &Stepper,
        points: &mut Points,
        seconds: f64,
        method: Method,
        workspace: &mut StepperWorkspace,
    ) -> Vec<Linearized> {
        let (count, states, width) = (points.count(), stepper.states.len(), self.variables.len());
        let present: Vec<f64> =
            stepper.states.iter().flat_map(|state| points.column(state.column, 0).to_vec()).collect();
        let stages: &[f64] =
            if method == Method::Rk4 && stepper.is_continuous() { &[0.0, 0.5, 0.5, 1.0] } else { &[0.0] };
        let weights: &[f64] = if stages.len() == 4 { &[1.0, 2.0, 2.0, 1.0] } else { &[6.0] };
        let mut mean = (vec![0.0; states * count], vec![0.0; count * states * width]);
        let mut last: (Vec<f64>, Vec<f64>) = (vec![0.0; states * count], vec![0.0; count * states * width]);
        let mut first = None;
        for (&fraction, &weight) in stages.iter().zip(weights) {
            let offset = fraction * seconds;
            stepper.move_states(points, &present, &last.0, offset);
            points.wait(offset);
            stepper.evaluate(points, workspace);
            let slopes = self.right_slopes(stepper, points, workspace);
            points.wait(-offset);
            let values: Vec<f64> = (0..states).flat_map(|s| stepper.right_side(s, count, workspace).to_vec()).collect();
            let derivatives = chained(stepper, &slopes, &last.1, offset, [count, states, width]);
            mean.0.iter_mut().zip(&values).for_each(|(sum, value)| *sum += weight / 6.0 * value);
            mean.1.iter_mut().zip(&derivatives).for_each(|(sum, value)| *sum += weight / 6.0 * value);
            first.get_or_insert_with(|| (values.clone(), derivatives.clone()));
            last = (values, derivatives);
        }
        let (first_values, first_slopes) = first.unwrap_or_else(|| last.clone());
        let mut values = vec![0.0; count * states];
        let mut slopes = vec![0.0; count * states * width];
        for (s, state) in stepper.states.iter().enumerate() {
            points.column_mut(state.column, 0).copy_from_slice(&present[s * count..(s + 1) * count]);
            let gain = state.advance.gain(seconds);
            // Differences and next values are those of the row itself.
            let (f, d) = if state.advance.continuous { (&mean.0, &mean.1) } else { (&first_values, &first_slopes) };
            for b in 0..count {
                let row = b * states + s;
                values[row] = state.advance.factor(seconds) * present[s * count + b] + gain * f[s * count + b];
                for variable in 0..width {
                    slopes[row * width + variable] = gain * d[row * width + variable];
                }
                slopes[row * width + s] += state.advance.factor(seconds);
            }
        }
        self.split(&values, &slopes, points, states)
    }

    /// A, B and c from values (points x states) and slopes (points x states x variables).
    fn split(&self, values: &[f64], slopes: &[f64], points: &Points, states: usize) -> Vec<Linearized> {
        let width = self.variables.len();
        (0..points.count())
            .map(|b| {
                let (mut a, mut input, mut c) = (Vec::new(), Vec::new(), Vec::new());
                for s in 0..states {
                    let row = &slopes[(b * states + s) * width..][..width];
                    a.extend_from_slice(&row[..states]);
                    input.extend_from_slice(&row[states..]);
                    let linear: f64 =
                        row.iter().zip(&self.variables).map(|(slope, &v)| slope * points.column(v, 0)[b]).sum();
                    c.push(values[b * states + s] - linear);
                }
                Linearized { a, b: input, c }
            })
            .collect()
    }
}

/// The chain rule through `x + offset * slope(x)`: derivatives of a stage's slopes from the slopes of the right sides
/// there and of the stage before.
fn chained(stepper: &Stepper, slopes: &[f64], before: &[f64], offset: f64, shape: [usize; 3]) -> Vec<f64> {
    let [count, states, width] = shape;
    let mut chained = slopes.to_vec();
    for b in 0..count {
        for row in 0..states {
            for (k, state) in stepper.states.iter().enumerate().filter(|(_, state)| state.advance.continuous) {
                debug_assert!(state.advance.keep == 1.0);
                let slope = slopes[(b * states + row) * width + k] * offset;
                for variable in 0..width {
                    chained[(b * states + row) * width + variable] +=
                        slope * before[(b * states + k) * width + variable];
                }
            }
        }
    }
    chained
}
