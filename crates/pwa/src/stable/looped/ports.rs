//! Passivity as a constraint: where a model exchanges energy it gives no more than it took.
//!
//! At its ports the product of an input u and a state y is the power that goes in: a force and the speed of the point
//! that it acts on. A region has the linear part `x+ = M x + N u`, `y = C x`. It is to dissipate with one storage
//! `V(x) = x'P x` (twice the energy) for all regions,
//!
//! ```text
//! V(x+) <= rho^2 V(x) + h (2 u'y + u'E u)
//! ```
//!
//! which is the inequality of Kalman, Yakubovich and Popov for a sampled map (Hitz and Anderson 1969; Willems 1972),
//!
//! ```text
//! [M N]' P [M N] <= S,    S = [rho^2 P, h C'; h C, h E]
//! ```
//!
//! The shortage E, diagonal, is the discretisation error: a held input does work on the motion that it starts. Over a
//! step on a mass m that is `h u^2 / m` more than its power at the row. Without E no sampled map with N other than 0 is
//! passive (the entry N'P N has nothing above it but h E). It goes to zero with h. Dividing by h shows that the flow
//! `dx/dt = A x + B u` of a model of derivatives, whose Euler step is bounded, dissipates with the same shortage:
//! `2 x'P(A x + B u) <= 2 u'y + u'E u`.
//!
//! With `T'T = P` and `S = L L'` in the coordinates T x, the inequality is `|T [M N] L^-T|_2 <= 1`. Like a contraction,
//! it is the norm of a matrix that is affine in a region's coefficients. It holds for the linear parts, for every
//! sequence of regions; constants act as one more input, whose power is not counted.

use faer::{Mat, Side, linalg::solvers::Solve};
use fleetfoot_library::Expr;

use super::{Loop, reads, slopes};
use crate::{Error, Problem, port::Port, region_model::Base};

/// Passivity of the maps of a model, with their allowed energy gains.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Passivity {
    /// The ports, with the shortage that was allowed.
    pub ports: Vec<Port>,
    /// One a region.
    pub regions: Vec<PassiveRegion>,
}

/// Use of the allowed energy by a region's map: `|T [M N] L^-T|_2`, at most 1 if it is passive.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PassiveRegion {
    /// Of the free map.
    pub free: f64,
    /// Of the map that is written.
    pub norm: f64,
}

/// The ports of a loop.
#[derive(Debug, Clone)]
pub(crate) struct Ports {
    pub(crate) ports: Vec<Port>,
    /// The variable of every output (m).
    pub(crate) outputs: Vec<usize>,
    /// h: seconds of a step, 1 where rows have no clock.
    pub(crate) step: f64,
}

/// Default of a port's allowed energy gain, over the discretisation error.
const ROOM: f64 = 2.0;

/// Iterations of the storage at most: time constants of so many rows.
const ITERATIONS: usize = 5000;

impl Ports {
    /// # Errors
    /// A pair that is no port. The input is none of the model; the state is not fitted, or not advanced linearly. Or no
    /// regressor reads the input, or one reads it at other rows, or not linearly.
    pub(crate) fn new(
        ports: &[Port],
        problem: &Problem,
        library: &[Expr],
        outputs: impl Fn(&str) -> Option<usize>,
    ) -> Result<Self, Error> {
        let refused = |port: &Port, reason: &str| {
            Err(Error::NoPort { input: port.input.clone(), output: port.output.clone(), reason: reason.to_owned() })
        };
        let mut places = Vec::with_capacity(ports.len());
        for (at, port) in ports.iter().enumerate() {
            if ports[..at].iter().any(|other| other.input == port.input) {
                return refused(port, "its input has another port already");
            }
            if problem.equations.iter().any(|equation| equation.subject == port.input) {
                return refused(port, "the model predicts its input, so nothing outside supplies it");
            }
            let mut readers = library.iter().filter(|function| reads(function, &port.input)).peekable();
            if readers.peek().is_none() {
                return refused(port, "no regressor reads its input");
            }
            let straight = |function: &Expr| {
                slopes(function, &port.input).is_some_and(|slopes| slopes.iter().all(|(lag, _)| *lag == 0))
            };
            if let Some(function) = readers.find(|function| !straight(function)) {
                return refused(port, &format!("the regressor `{function}` is not linear in its input at the row"));
            }
            let Some(place) = outputs(&port.output) else {
                return refused(port, "its output is not a state that the model advances and a regressor reads");
            };
            places.push(place);
        }
        let step = if problem.step > 0.0 { problem.step } else { 1.0 };
        Ok(Self { ports: ports.to_vec(), outputs: places, step })
    }

    /// C (m x n).
    pub(crate) fn output(&self, n: usize) -> Mat<f64> {
        Mat::from_fn(self.outputs.len(), n, |i, k| f64::from(u8::from(self.outputs[i] == k)))
    }

    /// E; of a port whose shortage is not known yet, none.
    fn shortage(&self, port: usize) -> f64 {
        self.ports[port].shortage.unwrap_or(0.0)
    }

    /// S in the coordinates of a metric, `[rho^2 I, h G'; h G, h E]` for G = C T^-1 (m x n).
    pub(crate) fn supply(&self, gamma: &Mat<f64>, bound: f64) -> Mat<f64> {
        let (m, n, h) = (gamma.nrows(), gamma.ncols(), self.step);
        Mat::from_fn(n + m, n + m, |i, j| match (i < n, j < n) {
            (true, true) => bound * bound * f64::from(u8::from(i == j)),
            (true, false) => h * gamma[(j - n, i)],
            (false, true) => h * gamma[(i - n, j)],
            (false, false) => h * self.shortage(i - n) * f64::from(u8::from(i == j)),
        })
    }
}

impl Loop {
    /// The loop with every shortage settled. The default is twice the discretisation error of the one-region model,
    /// `h |C B|` by rows in units of the inputs.
    pub(crate) fn settled(&self, base: &Base) -> Self {
        let mut settled = self.clone();
        let n = self.variables.len();
        let Some(ports) = &mut settled.ports else { return settled };
        let map = self.map(&base.average.coefficients);
        let units: Vec<f64> = (0..ports.ports.len()).map(|port| self.input_unit(port, base)).collect();
        for port in 0..ports.ports.len() {
            let across = |other: usize| (map[(ports.outputs[port], n + other)] * units[other] / units[port]).abs();
            let taken: f64 = (0..units.len()).map(across).sum();
            ports.ports[port].shortage.get_or_insert(ROOM * taken);
        }
        settled
    }

    /// Deviation of the input of a port, by the functions that read it.
    pub(crate) fn input_unit(&self, port: usize, base: &Base) -> f64 {
        let column = self.variables.len() + port;
        let of = |&j: &usize| base.scale[j] / self.reads[(j, column)].abs();
        let readers = self.regressors.iter().filter(|&&j| self.reads[(j, column)] != 0.0);
        let unit = readers.map(of).fold(0.0, f64::max);
        if unit > 0.0 && unit.is_finite() { unit } else { 1.0 }
    }

    /// A storage P with which a map (n x n + m) dissipates strictly: the least one that leaves `margin` of the units'
    /// squares at every step. `None` if there is none, or the iteration does not end.
    ///
    /// It is the energy that can be drawn from the model, by value iteration from zero:
    /// `P+ = rho^-2 (M'P M + (h C' - M'P N)(h E - N'P N)^-1 (h C - N'P M)) + margin`.
    pub(crate) fn storage(&self, map: &Mat<f64>, units: &[f64], margin: f64) -> Option<Mat<f64>> {
        let ports = self.ports.as_ref()?;
        let (n, m, h) = (self.variables.len(), ports.outputs.len(), ports.step);
        // In units of the variables.
        let M = Mat::from_fn(n, n, |i, j| map[(i, j)] * units[j] / units[i]);
        let N = Mat::from_fn(n, m, |i, j| map[(i, n + j)] / units[i]);
        let C = ports.output(n);
        let supplied = Mat::from_fn(m, n, |i, j| h * C[(i, j)] * units[j]);
        let mut P = Mat::<f64>::zeros(n, n);
        for _ in 0..ITERATIONS {
            let (PM, PN) = (&P * &M, &P * &N);
            let across = &supplied - N.transpose() * &PM;
            let spent = N.transpose() * &PN;
            let R = Mat::from_fn(m, m, |i, j| {
                h * ports.shortage(i) * f64::from(u8::from(i == j)) - 0.5 * (spent[(i, j)] + spent[(j, i)])
            });
            let inverse = R.llt(Side::Lower).ok()?.solve(&across);
            let next = M.transpose() * &PM + across.transpose() * &inverse;
            let next = Mat::from_fn(n, n, |i, j| {
                0.5 * (next[(i, j)] + next[(j, i)]) / (self.bound * self.bound) + margin * f64::from(u8::from(i == j))
            });
            let change = (&next - &P).norm_l2();
            if !change.is_finite() {
                return None;
            }
            // It falls short of its own iterate by less than the margin: strictly within.
            let done = change < 0.5 * margin;
            P = next;
            if done {
                return Some(Mat::from_fn(n, n, |i, j| P[(i, j)] / (units[i] * units[j])));
            }
        }
        None
    }
}
