//! A model's equations as constraints between neighbouring rows of a grid, with their exact derivatives.
//!
//! For derivatives the rule is that of Hermite and Simpson, its middle eliminated (Betts, Practical Methods for Optimal
//! Control, 2010, equations 4.105 to 4.107). The inputs and the replayed columns are linear in between:
//!
//! ```text
//! x_m = (x_0 + x_1)/2 + h/8 (f_0 - f_1),    zeta = x_1 - x_0 - h/6 (f_0 + 4 f_m + f_1)
//! ```
//!
//! With G = df/d(x, u) at the two rows and in the middle its derivatives are
//!
//! ```text
//! d zeta/d z_0 = -(I 0) - h/6 (G_0 + 2 G_m + h/2 A_m G_0),    d zeta/d z_1 = (I 0) - h/6 (G_1 + 2 G_m - h/2 A_m G_1)
//! ```
//!
//! For equations that give the next row, zeta = x_1 - f(x_0, u_0).

use fleetfoot_data::{did_you_mean, nearest};
use fleetfoot_dynamics::{Course, InputSequence, Integration, Linearized, Method, Stepper, StepperWorkspace, Tangent};
use fleetfoot_model::{Model, RotationKind};

use crate::EstimateError;
use crate::recorded::Recorded;

/// Rows that are evaluated at once.
const ROWS: usize = 1_024;

/// A model compiled for grids.
pub(crate) struct Transcription {
    stepper: Stepper,
    tangent: Tangent,
    continuous: bool,
    /// States, then free inputs.
    names: Vec<String>,
    replayed: Vec<String>,
    /// Of every input of the stepper: its place among the free ones, or behind them among the replayed.
    places: Vec<usize>,
    angle: Vec<bool>,
    /// The rotations among the states, and the places of their parts.
    rotations: Vec<(RotationKind, Vec<usize>)>,
}

/// The constraints at some point: of every interval n values, and their derivatives (n x columns) by the row before and the row behind.
pub(crate) struct Defects {
    pub(crate) values: Vec<f64>,
    pub(crate) before: Vec<f64>,
    pub(crate) behind: Vec<f64>,
}

/// Values at the middles of the intervals (r - 1) for the rule of Hermite and Simpson.
pub(crate) struct Middles {
    /// States and free inputs (intervals x columns).
    pub(crate) values: Vec<f64>,
    /// Replayed columns (intervals x replayed).
    pub(crate) replayed: Vec<f64>,
    /// Seconds since the episode's start.
    pub(crate) seconds: Vec<f64>,
    /// Derivatives of the right sides there (intervals x n x columns).
    pub(crate) slopes: Vec<f64>,
}

/// Right sides at rows (r x n) and their derivatives (r x n x columns).
struct Rates {
    values: Vec<f64>,
    slopes: Vec<f64>,
}

impl Transcription {
    pub(crate) fn new(model: &Model, continuous: bool, free: &[String]) -> Result<Self, EstimateError> {
        let stepper = Stepper::new(model)?;
        if stepper.history() > 0 {
            return Err(EstimateError::LooksBack { rows: stepper.history() });
        }
        let states: Vec<String> = stepper.states().map(str::to_owned).collect();
        if let Some(filter) = states.iter().find(|name| model.column(name).is_none()) {
            return Err(EstimateError::Filtered { filter: filter.clone() });
        }
        let inputs: Vec<String> = stepper.inputs().map(str::to_owned).collect();
        if let Some(name) = free.iter().find(|name| !inputs.contains(name)) {
            let near = did_you_mean(&nearest(name, inputs.iter().map(String::as_str)));
            return Err(EstimateError::NoInput { name: name.clone(), inputs: inputs.join(", "), near });
        }
        let free: Vec<String> = inputs.iter().filter(|name| free.contains(name)).cloned().collect();
        let replayed: Vec<String> = inputs.iter().filter(|name| !free.contains(name)).cloned().collect();
        let place = |name: &String| match free.iter().position(|known| known == name) {
            Some(at) => at,
            None => free.len() + replayed.iter().position(|known| known == name).unwrap_or(0),
        };
        let places = inputs.iter().map(place).collect();
        let names: Vec<String> = states.into_iter().chain(free).collect();
        let angle = names.iter().map(|name| model.column(name).is_some_and(|at| model.columns[at].angle)).collect();
        let rotations = model.rotations_among(&names);
        Ok(Self { tangent: Tangent::new(&stepper)?, stepper, continuous, names, replayed, places, angle, rotations })
    }

    /// States in the model's order, then the inputs that may move.
    pub(crate) fn names(&self) -> &[String] {
        &self.names
    }

    pub(crate) fn replayed(&self) -> &[String] {
        &self.replayed
    }

    pub(crate) fn states(&self) -> usize {
        self.stepper.states().len()
    }

    pub(crate) fn is_angle(&self, column: usize) -> bool {
        self.angle[column]
    }

    /// Returns true if a column is an angle or a part of a rotation: its range is no bound.
    pub(crate) fn goes_round(&self, column: usize) -> bool {
        self.angle[column] || self.rotations.iter().any(|(_, places)| places.contains(&column))
    }

    /// Brings the quaternions of rows (r x columns) to unit length. Kinematics keep the initial length, which nothing
    /// else in an equation determines.
    pub(crate) fn normalise(&self, values: &mut [f64]) {
        let quaternions = self.rotations.iter().filter(|(kind, _)| *kind == RotationKind::Quaternion);
        for (kind, places) in quaternions {
            for row in values.chunks_exact_mut(self.names.len()) {
                let mut parts: Vec<f64> = places.iter().map(|&place| row[place]).collect();
                kind.retract(&mut parts);
                places.iter().zip(parts).for_each(|(&place, part)| row[place] = part);
            }
        }
    }

    /// The place of a named column.
    pub(crate) fn place(&self, name: &str) -> Result<usize, EstimateError> {
        let place = self.names.iter().position(|known| known == name);
        place.ok_or_else(|| EstimateError::NotFollowed { name: name.to_owned(), columns: self.names.join(", ") })
    }

    /// The constraints at `z` (r x columns); `None` where the model has no finite value or derivative.
    pub(crate) fn defects(&self, grid: &Recorded, z: &[f64]) -> Option<Defects> {
        let defects = if self.continuous { self.collocated(grid, z).0 } else { self.stepped(grid, z) };
        let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
        (finite(&defects.values) && finite(&defects.before) && finite(&defects.behind)).then_some(defects)
    }

    /// The constraints of equations of derivatives at `z`, and their middles.
    pub(crate) fn collocated(&self, grid: &Recorded, z: &[f64]) -> (Defects, Middles) {
        let (n, c, replays) = (self.states(), self.names.len(), self.replayed.len());
        let intervals = grid.seconds.len() - 1;
        let at_rows = self.rates(z, &grid.seconds, &grid.replayed);
        let mut middles = vec![0.0; intervals * c];
        let mut replayed = vec![0.0; intervals * replays];
        let mut seconds = vec![0.0; intervals];
        for k in 0..intervals {
            let h = grid.seconds[k + 1] - grid.seconds[k];
            for j in 0..c {
                let bend =
                    if j < n { h / 8.0 * (at_rows.values[k * n + j] - at_rows.values[(k + 1) * n + j]) } else { 0.0 };
                middles[k * c + j] = 0.5 * (z[k * c + j] + z[(k + 1) * c + j]) + bend;
            }
            for j in 0..replays {
                replayed[k * replays + j] =
                    0.5 * (grid.replayed[k * replays + j] + grid.replayed[(k + 1) * replays + j]);
            }
            seconds[k] = 0.5 * (grid.seconds[k] + grid.seconds[k + 1]);
        }
        let in_middle = self.rates(&middles, &seconds, &replayed);
        let mut defects = Defects::zeros(intervals, n, c);
        for k in 0..intervals {
            let h = grid.seconds[k + 1] - grid.seconds[k];
            let slopes = |rates: &Rates, at: usize, s: usize, j: usize| rates.slopes[(at * n + s) * c + j];
            for s in 0..n {
                let f = [at_rows.values[k * n + s], in_middle.values[k * n + s], at_rows.values[(k + 1) * n + s]];
                defects.values[k * n + s] = z[(k + 1) * c + s] - z[k * c + s] - h / 6.0 * (f[0] + 4.0 * f[1] + f[2]);
                for j in 0..c {
                    let through = |row: usize| {
                        (0..n).map(|i| slopes(&in_middle, k, s, i) * slopes(&at_rows, row, i, j)).sum::<f64>()
                    };
                    let (identity, middle) = (f64::from(u8::from(s == j)), 2.0 * slopes(&in_middle, k, s, j));
                    let at = (k * n + s) * c + j;
                    defects.before[at] =
                        -identity - h / 6.0 * (slopes(&at_rows, k, s, j) + middle + 0.5 * h * through(k));
                    defects.behind[at] =
                        identity - h / 6.0 * (slopes(&at_rows, k + 1, s, j) + middle - 0.5 * h * through(k + 1));
                }
            }
        }
        (defects, Middles { values: middles, replayed, seconds, slopes: in_middle.slopes })
    }

    fn stepped(&self, grid: &Recorded, z: &[f64]) -> Defects {
        let (n, c) = (self.states(), self.names.len());
        let intervals = grid.seconds.len() - 1;
        let rates = self.rates(&z[..intervals * c], &grid.seconds[..intervals], &grid.replayed);
        let mut defects = Defects::zeros(intervals, n, c);
        for at in 0..intervals * n {
            let (k, s) = (at / n, at % n);
            defects.values[at] = z[(k + 1) * c + s] - rates.values[at];
            defects.behind[at * c + s] = 1.0;
        }
        defects.before.iter_mut().zip(&rates.slopes).for_each(|(before, slope)| *before = -slope);
        defects
    }

    /// Right sides at rows of columns (r x columns) and of replayed columns (r x replayed).
    fn rates(&self, z: &[f64], seconds: &[f64], replayed: &[f64]) -> Rates {
        let (n, c, replays, rows) = (self.states(), self.names.len(), self.replayed.len(), seconds.len());
        let mut rates = Rates { values: Vec::with_capacity(rows * n), slopes: Vec::with_capacity(rows * n * c) };
        let mut workspace = StepperWorkspace::default();
        for first in (0..rows).step_by(ROWS) {
            let count = ROWS.min(rows - first);
            let mut points = self.stepper.points(count);
            points.seconds_mut(0).copy_from_slice(&seconds[first..first + count]);
            for s in 0..n {
                let column = points.column_mut(self.stepper.state_column(s), 0);
                column.iter_mut().enumerate().for_each(|(k, value)| *value = z[(first + k) * c + s]);
            }
            let input = |k: usize, place: usize| match place.checked_sub(c - n) {
                None => z[(first + k) * c + n + place],
                Some(place) => replayed[(first + k) * replays + place],
            };
            for (i, &place) in self.places.iter().enumerate() {
                let column = points.column_mut(self.stepper.input_column(i), 0);
                column.iter_mut().enumerate().for_each(|(k, value)| *value = input(k, place));
            }
            let linearized = self.tangent.linearize(&self.stepper, &points, &mut workspace);
            for (k, linear) in linearized.iter().enumerate() {
                let x = |j: usize| z[(first + k) * c + j];
                self.push(linear, x, |i| input(k, self.places[i]), &mut rates);
            }
        }
        rates
    }

    /// A linearised row: its value, and its derivatives by the states and the inputs that may move.
    fn push(&self, linear: &Linearized, x: impl Fn(usize) -> f64, u: impl Fn(usize) -> f64, rates: &mut Rates) {
        let (n, c, inputs) = (self.states(), self.names.len(), self.places.len());
        for s in 0..n {
            let (a, b) = (&linear.a[s * n..(s + 1) * n], &linear.b[s * inputs..(s + 1) * inputs]);
            let by_states: f64 = a.iter().enumerate().map(|(j, slope)| slope * x(j)).sum();
            let by_inputs: f64 = b.iter().enumerate().map(|(i, slope)| slope * u(i)).sum();
            rates.values.push(linear.c[s] + (by_states + by_inputs));
            rates.slopes.extend_from_slice(a);
            let at = rates.slopes.len();
            rates.slopes.resize(at + c - n, 0.0);
            for (&place, &slope) in self.places.iter().zip(b).filter(|(place, _)| **place < c - n) {
                rates.slopes[at + place] = slope;
            }
        }
    }

    /// The states of a simulation from the recorded beginning with the recorded inputs (r x states); of derivatives
    /// also those in the middle of every interval. NaN after divergence.
    pub(crate) fn open_loop(&self, recorded: &Recorded) -> Result<Vec<f64>, EstimateError> {
        let (n, c, replays, rows) = (self.states(), self.names.len(), self.replayed.len(), recorded.rows.len());
        let grid = self.stepper.grid(recorded.seconds.clone())?;
        let value = |k: usize, place: usize| match place.checked_sub(c - n) {
            None => recorded.values[k * c + n + place],
            Some(place) => recorded.replayed[k * replays + place],
        };
        let next = |k: usize| if self.continuous { k + 1 } else { k };
        let mean = |k: usize, place: usize| 0.5 * (value(k, place) + value(next(k), place));
        let inputs: Vec<f64> =
            (0..rows - 1).flat_map(|k| self.places.iter().map(move |&place| mean(k, place))).collect();
        let mut points = self.stepper.points(1);
        points.seconds_mut(0)[0] = recorded.seconds[0];
        (0..n).for_each(|s| points.column_mut(self.stepper.state_column(s), 0)[0] = recorded.values[s]);
        let mut values = vec![f64::NAN; rows * n];
        let sequence = InputSequence { values: &inputs, by_point: false, course: Course::Held };
        let integration = Integration::Fixed { method: Method::Rk4, substeps: None };
        let mut last = recorded.values[..n].to_vec();
        self.stepper.simulate(&mut points, &grid, sequence, &integration, |k, states| {
            let finite = states.iter().all(|value| value.is_finite());
            if finite {
                let mut turns: Vec<Vec<f64>> = Vec::new();
                for (kind, places) in &self.rotations {
                    let mut parts: Vec<f64> = places.iter().map(|&s| states[s]).collect();
                    kind.nearest(&mut parts, &places.iter().map(|&s| last[s]).collect::<Vec<_>>());
                    turns.push(parts);
                }
                for (s, (value, last)) in states.iter().zip(&mut last).enumerate() {
                    let turn = std::f64::consts::TAU;
                    // As the recording, without jumps.
                    *last = value + if self.angle[s] { turn * ((*last - value) / turn).round() } else { 0.0 };
                }
                for ((_, places), parts) in self.rotations.iter().zip(turns) {
                    places.iter().zip(parts).for_each(|(&s, part)| last[s] = part);
                }
                values[k * n..(k + 1) * n].copy_from_slice(&last);
            }
            finite
        });
        Ok(values)
    }
}

impl Defects {
    fn zeros(intervals: usize, states: usize, columns: usize) -> Self {
        let slopes = vec![0.0; intervals * states * columns];
        Self { values: vec![0.0; intervals * states], before: slopes.clone(), behind: slopes }
    }

    /// In units of the columns.
    pub(crate) fn scaled(mut self, states: usize, units: &[f64]) -> Self {
        let c = units.len();
        for (at, value) in self.values.iter_mut().enumerate() {
            let size = units[at % states];
            *value /= size;
            for (j, unit) in units.iter().enumerate() {
                self.before[at * c + j] *= unit / size;
                self.behind[at * c + j] *= unit / size;
            }
        }
        self
    }
}
