//! Numbers of a predictive controller, and their dimensionless form.

use serde::{Deserialize, Serialize};

use super::{ParameterError, Regulator};
use crate::predictive::{Program, ProgramBound, ProgramStep};

/// Prediction of a regulator with n errors, q integrals, m inputs and k measured columns: the steps
/// `e+ = A e + B (u - u*) + c + G (w - w*)` by region, and the cost of a plan. Matrices by rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prediction {
    /// Samples that are planned.
    pub horizon: usize,
    /// The step of each law's region.
    pub steps: Vec<PredictedStep>,
    /// The inputs u* that steps count from (m).
    pub at: Vec<f64>,
    /// Typical deviation of each input (m).
    pub input_sizes: Vec<f64>,
    /// Weights of errors, then of integrals (n + q).
    pub weights: Vec<f64>,
    /// Weights of inputs (m).
    pub input_weights: Vec<f64>,
    /// Cost of the last errors and integrals (n + q x n + q): the solution of the Riccati equation at the set point.
    pub terminal: Vec<Vec<f64>>,
    /// The rest that costs nothing.
    pub target: PredictedTarget,
    /// Bounds of errors.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bounds: Vec<ErrorBound>,
}

/// The step of a region.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictedStep {
    /// A (n x n).
    pub a: Vec<Vec<f64>>,
    /// B (n x m).
    pub b: Vec<Vec<f64>>,
    /// c (n).
    pub constant: Vec<f64>,
    /// G (n x k).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measured: Vec<Vec<f64>>,
}

/// The rest that costs nothing, for the measurements of the set point, and its change with them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictedTarget {
    /// Law of the set point, an index.
    pub law: usize,
    /// Errors (n).
    pub errors: Vec<f64>,
    /// Inputs (m).
    pub inputs: Vec<f64>,
    /// Change of the errors (n x k).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measured_errors: Vec<Vec<f64>>,
    /// Change of the inputs (m x k).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measured_inputs: Vec<Vec<f64>>,
}

/// A soft bound of an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorBound {
    /// Index of the error.
    pub error: usize,
    /// Lowest value.
    pub lowest: f64,
    /// Highest value.
    pub highest: f64,
    /// Weight of the squared violation.
    pub weight: f64,
}

/// A prediction without dimensions: errors and integrals (n, all of them here) divided by the sizes of their errors,
/// inputs less u* divided by theirs (m). Matrices by rows, one after the other; k measured columns, r regions.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictionTables {
    /// The program.
    pub program: Program,
    /// Sizes (n).
    pub sizes: Vec<f64>,
    /// Sizes of inputs (m).
    pub input_sizes: Vec<f64>,
    /// u* (m).
    pub at: Vec<f64>,
    /// Limits of inputs (m).
    pub limits: Vec<[f64; 2]>,
    /// Constants of steps (r x n), and their change by measured columns (r x n x k).
    pub constants: Vec<f64>,
    /// See `constants`.
    pub constant_slopes: Vec<f64>,
    /// The target (n), and its change by measured columns (n x k).
    pub target: Vec<f64>,
    /// See `target`.
    pub target_slopes: Vec<f64>,
    /// Inputs of the target (m), and their change by measured columns (m x k).
    pub input_target: Vec<f64>,
    /// See `input_target`.
    pub input_target_slopes: Vec<f64>,
    /// Gain of the linear law about the target (m x n).
    pub gain: Vec<f64>,
}

/// Longest horizon, samples.
pub const MOST_SAMPLES: usize = 200;

impl Prediction {
    /// Checks the shapes and numbers for a regulator.
    pub(super) fn validate(&self, law: &Regulator) -> Result<(), ParameterError> {
        let (n, m, k) = (law.sizes().len(), law.inputs.len(), law.measured.len());
        let all = n + law.integrated.len();
        let is = |matrix: &[Vec<f64>], rows: usize, columns: usize| {
            (columns == 0 && matrix.is_empty())
                || (matrix.len() == rows && matrix.iter().all(|row| row.len() == columns && finite(row)))
        };
        let is_vector = |vector: &[f64], length: usize| vector.len() == length && finite(vector);
        let step = |step: &PredictedStep| {
            is(&step.a, n, n) && is(&step.b, n, m) && is_vector(&step.constant, n) && is(&step.measured, n, k)
        };
        if !(1..=MOST_SAMPLES).contains(&self.horizon) {
            let allowed = format!("1 to {MOST_SAMPLES} samples");
            return Err(ParameterError::new("horizon", self.horizon, allowed));
        }
        let target = &self.target;
        let shapes = self.steps.len() == law.laws.len()
            && self.steps.iter().all(step)
            && is_vector(&self.at, m)
            && is_vector(&self.input_sizes, m)
            && is_vector(&self.weights, all)
            && is_vector(&self.input_weights, m)
            && is(&self.terminal, all, all)
            && target.law < law.laws.len()
            && is_vector(&target.errors, n)
            && is_vector(&target.inputs, m)
            && is(&target.measured_errors, n, k)
            && is(&target.measured_inputs, m, k)
            && self.bounds.iter().all(|bound| bound.error < n && finite(&[bound.lowest, bound.highest, bound.weight]));
        if !shapes {
            let allowed = format!("finite steps of {n} errors by {m} inputs, and the weights of a plan");
            return Err(ParameterError::new("prediction", format!("{} steps", self.steps.len()), allowed));
        }
        // The plan has one best only if every input costs something, and no error pays.
        let positive = self.input_weights.iter().chain(&self.input_sizes).all(|value| *value > 0.0);
        let mut costs = self.weights.iter().copied().chain(self.bounds.iter().map(|bound| bound.weight));
        let bounded = self.bounds.iter().all(|bound| bound.lowest < bound.highest);
        if !positive || !bounded || costs.any(|weight| weight < 0.0) {
            let allowed = "positive weights of inputs, no negative weight of an error, and ordered bounds";
            return Err(ParameterError::new("prediction", "its weights", allowed));
        }
        Ok(())
    }
}

fn finite(values: &[f64]) -> bool {
    values.iter().all(|value| value.is_finite())
}

impl Regulator {
    /// The prediction without dimensions; `None` of a regulator without one. The regulator is valid.
    pub fn prediction_tables(&self) -> Option<PredictionTables> {
        let prediction = self.prediction.as_ref()?;
        let (errors, q, m, k) = (self.sizes(), self.integrated.len(), self.inputs.len(), self.measured.len());
        let n = errors.len();
        let sizes: Vec<f64> =
            errors.iter().copied().chain(self.integrated.iter().map(|&error| errors[error])).collect();
        let scales = &prediction.input_sizes;
        let all = n + q;
        let entry = |matrix: &[Vec<f64>], i: usize, j: usize| matrix.get(i).map_or(0.0, |row| row[j]);
        let step = |step: &PredictedStep| {
            let a = |i: usize, j: usize| match (i < n, j < n) {
                (true, true) => step.a[i][j],
                (true, false) => 0.0,
                (false, true) if self.integrated[i - n] == j => self.period,
                (false, true) => 0.0,
                (false, false) => f64::from(u8::from(i == j)),
            };
            let b = |i: usize, j: usize| if i < n { step.b[i][j] } else { 0.0 };
            ProgramStep {
                a: by_rows(all, all, |i, j| a(i, j) * sizes[j] / sizes[i]),
                b: by_rows(all, m, |i, j| b(i, j) * scales[j] / sizes[i]),
            }
        };
        let steps: Vec<ProgramStep> = prediction.steps.iter().map(step).collect();
        let target = &prediction.target;
        let law = &self.laws[target.law];
        let gain = |i: usize, j: usize| if j < n { law.gain[i][j] } else { entry(&law.integral, i, j - n) };
        let terminal = by_rows(all, all, |i, j| prediction.terminal[i][j] * sizes[i] * sizes[j]);
        let input_weights: Vec<f64> =
            prediction.input_weights.iter().zip(scales).map(|(weight, size)| weight * size * size).collect();
        let own = &steps[target.law].b;
        let curvature = |j: usize| {
            let along = |i: usize| (0..all).map(|l| terminal[all * i + l] * own[m * l + j]).sum::<f64>();
            input_weights[j] + (0..all).map(|i| own[m * i + j] * along(i)).sum::<f64>()
        };
        let limit = |value: f64, j: usize| ((value - prediction.at[j]) / scales[j]).clamp(f64::MIN, f64::MAX);
        let of_errors = |values: &[f64], i: usize| if i < n { values[i] / sizes[i] } else { 0.0 };
        let slope = |matrix: &[Vec<f64>], i: usize, j: usize| if i < n { entry(matrix, i, j) / sizes[i] } else { 0.0 };
        let regions = steps.len();
        let part = |row: usize| (&prediction.steps[row / all], row % all);
        Some(PredictionTables {
            limits: (self.inputs.iter().enumerate())
                .map(|(j, input)| [limit(input.lowest, j), limit(input.highest, j)])
                .collect(),
            constants: (0..regions * all).map(|row| of_errors(&part(row).0.constant, part(row).1)).collect(),
            constant_slopes: by_rows(regions * all, k, |row, j| slope(&part(row).0.measured, part(row).1, j)),
            target: (0..all).map(|i| of_errors(&target.errors, i)).collect(),
            target_slopes: by_rows(all, k, |i, j| slope(&target.measured_errors, i, j)),
            input_target: (0..m).map(|j| (target.inputs[j] - prediction.at[j]) / scales[j]).collect(),
            input_target_slopes: by_rows(m, k, |i, j| entry(&target.measured_inputs, i, j) / scales[i]),
            gain: by_rows(m, all, |i, j| gain(i, j) * sizes[j] / scales[i]),
            at: prediction.at.clone(),
            input_sizes: scales.clone(),
            program: Program {
                horizon: prediction.horizon,
                weights: prediction.weights.iter().zip(&sizes).map(|(weight, size)| weight * size * size).collect(),
                curvature: (0..m).map(curvature).collect(),
                bounds: prediction.bounds.iter().map(|bound| bound.without_dimension(sizes[bound.error])).collect(),
                input_weights,
                terminal,
                steps,
            },
            sizes,
        })
    }
}

impl ErrorBound {
    fn without_dimension(&self, size: f64) -> ProgramBound {
        ProgramBound {
            state: self.error,
            lowest: (self.lowest / size).max(f64::MIN),
            highest: (self.highest / size).min(f64::MAX),
            weight: self.weight * size * size,
        }
    }
}

fn by_rows(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    (0..rows * columns).map(|at| entry(at / columns, at % columns)).collect()
}
