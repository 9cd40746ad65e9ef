//! Derivatives of the constraints of Hermite and Simpson by the coefficients of a model.
//!
//! A coefficient c of a function phi in the derivative of the state s moves f at both rows and in the middle. It moves
//! the middle itself too:
//!
//! ```text
//! d zeta_i/dc = -h/6 (phi_0 + 4 phi_m + phi_1) [i = s] - h^2/12 A_m[i, s] (phi_0 - phi_1)
//! ```

use fleetfoot_dynamics::Coefficient;
use fleetfoot_library::{Expr, Leaf, Program, Scratch};
use fleetfoot_model::{Model, Prediction, Role};

use crate::{
    EstimateError,
    recorded::Recorded,
    transcription::{Middles, Transcription},
};

/// Functions of coefficients, compiled over states and replayed columns.
pub(super) struct Candidates {
    program: Program,
    /// Of every leaf: a state, or behind them a replayed column; `None`: time.
    leaves: Vec<Option<usize>>,
    /// Of every coefficient the output of the program, and the state whose derivative it is in.
    entries: Vec<(usize, usize)>,
    states: usize,
}

/// Values of the functions (outputs x stride) at the rows, and in the middles of the intervals.
pub(super) struct Values {
    at_rows: Vec<f64>,
    in_middles: Vec<f64>,
    stride: usize,
}

impl Candidates {
    pub(super) fn new(
        model: &Model,
        transcription: &Transcription,
        coefficients: &[Coefficient],
    ) -> Result<Self, EstimateError> {
        let names: Vec<&str> =
            transcription.names().iter().chain(transcription.replayed()).map(String::as_str).collect();
        let mut functions: Vec<Expr> = Vec::new();
        let mut entries = Vec::with_capacity(coefficients.len());
        for coefficient in coefficients {
            let latent = &model.latents[coefficient.latent];
            let function = match coefficient.function {
                None => Expr::number(1.0),
                Some(j) => {
                    let library = &model.libraries[latent.library];
                    latent.map.expression(j, library).unwrap_or_else(|| Expr::number(0.0))
                }
            };
            let output = functions.iter().position(|known| *known == function).unwrap_or_else(|| {
                functions.push(function);
                functions.len() - 1
            });
            entries.push((output, state_of(model, transcription, &latent.name)?));
        }
        let program = Program::compile(&functions, &names)?;
        let place = |leaf: &Leaf| match *leaf {
            Leaf::Column { column, lag: 0 } => Ok(Some(column)),
            Leaf::Time { lag: 0 } => Ok(None),
            _ => Err(EstimateError::LooksBack { rows: leaf.lag().unsigned_abs() as usize }),
        };
        let leaves = program.leaves().iter().map(place).collect::<Result<_, _>>()?;
        Ok(Self { program, leaves, entries, states: transcription.states() })
    }

    /// The functions at the rows of a grid whose states are z (r x n), and in the middles.
    pub(super) fn evaluate(&self, grid: &Recorded, z: &[f64], middles: &Middles) -> Values {
        let rows = grid.seconds.len();
        let at = |states: &[f64], replayed: &[f64], seconds: &[f64]| {
            let count = seconds.len();
            let replays = replayed.len() / count.max(1);
            let column = |leaf: &Option<usize>| -> Vec<f64> {
                match *leaf {
                    None => seconds.to_vec(),
                    Some(state) if state < self.states => (0..count).map(|k| states[k * self.states + state]).collect(),
                    Some(place) => (0..count).map(|k| replayed[k * replays + place - self.states]).collect(),
                }
            };
            let columns: Vec<Vec<f64>> = self.leaves.iter().map(column).collect();
            let leaves: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
            let mut out = vec![0.0; self.program.outputs() * rows];
            self.program.evaluate(&leaves, count, &mut out, rows, &mut Scratch::default());
            out
        };
        Values {
            at_rows: at(z, &grid.replayed, &grid.seconds),
            in_middles: at(&middles.values, &middles.replayed, &middles.seconds),
            stride: rows,
        }
    }

    /// The derivatives of a constraint of an interval by the coefficients, into `out`, times `weight`.
    pub(super) fn slopes(
        &self,
        (values, middles): (&Values, &Middles),
        (interval, state, step): (usize, usize, f64),
        weight: f64,
        out: &mut [f64],
    ) {
        let n = self.states;
        let by_states = &middles.slopes[(interval * n + state) * n..][..n];
        for (out, &(output, entry)) in out.iter_mut().zip(&self.entries) {
            let at = output * values.stride + interval;
            let (before, behind, middle) = (values.at_rows[at], values.at_rows[at + 1], values.in_middles[at]);
            let mut slope = -step * step / 12.0 * by_states[entry] * (before - behind);
            if entry == state {
                slope -= step / 6.0 * (before + 4.0 * middle + behind);
            }
            *out = weight * slope;
        }
    }
}

/// The state whose derivative has a latent.
fn state_of(model: &Model, transcription: &Transcription, latent: &str) -> Result<usize, EstimateError> {
    let has = |equation: &&fleetfoot_model::Equation| {
        equation.prediction == Prediction::Derivative && equation.right.derivative(latent).as_number() == Some(1.0)
    };
    let owner = model.equations.iter().find(has);
    let state = owner.and_then(|equation| transcription.names().iter().position(|name| *name == equation.subject));
    state.ok_or_else(|| EstimateError::NotAdditive { latent: latent.to_owned() })
}

/// The model with every column that its functions read, other than states, among its inputs. The set of read columns
/// then does not change with the coefficients.
pub(super) fn with_inputs(model: &Model) -> Model {
    let mut model = model.clone();
    let read: Vec<_> = model.libraries.iter().flatten().flat_map(|function| function.columns()).collect();
    for column in model.columns.iter_mut().filter(|column| column.role == Role::Auxiliary) {
        if read.iter().any(|name| **name == *column.name) {
            column.role = Role::Input;
        }
    }
    model
}
