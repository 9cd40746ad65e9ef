//! The canonical systems: their equations as sums of candidate functions, and where their recordings begin.

use super::candidates::Features;

/// A system of ordinary differential equations, each a sum of coefficients times candidate functions.
#[derive(Debug)]
pub(crate) struct System {
    pub(crate) name: &'static str,
    pub(crate) states: &'static [&'static str],
    /// Of every state's derivative: functions and their coefficients.
    pub(crate) equations: &'static [&'static [(&'static str, f64)]],
    pub(crate) features: Features,
    /// Seconds between rows.
    pub(crate) period: f64,
    /// Where a recording begins: lower and upper end of every state.
    pub(crate) begins: &'static [[f64; 2]],
}

/// All monomials up to the third degree, the constant among them.
const CUBIC: Features = Features { degree: 3, trigonometric: false };

/// Lorenz, "Deterministic nonperiodic flow" (J. Atmos. Sci. 20, 1963): sigma = 10, r = 28, b = 8/3.
const LORENZ: System = System {
    name: "Lorenz",
    states: &["x", "y", "z"],
    equations: &[
        &[("x", -10.0), ("y", 10.0)],
        &[("x", 28.0), ("y", -1.0), ("x*z", -1.0)],
        &[("x*y", 1.0), ("z", -8.0 / 3.0)],
    ],
    features: CUBIC,
    period: 0.005,
    begins: &[[-15.0, 15.0], [-15.0, 15.0], [10.0, 40.0]],
};

/// Lotka (1925) and Volterra (1926): prey x and predators y about their equilibrium (1, 1/2).
const LOTKA_VOLTERRA: System = System {
    name: "Lotka-Volterra",
    states: &["x", "y"],
    equations: &[&[("x", 2.0 / 3.0), ("x*y", -4.0 / 3.0)], &[("x*y", 1.0), ("y", -1.0)]],
    features: CUBIC,
    period: 0.02,
    begins: &[[0.3, 1.8], [0.2, 1.0]],
};

/// Van der Pol (1926), mu = 1/2.
const VAN_DER_POL: System = System {
    name: "Van der Pol",
    states: &["x", "y"],
    equations: &[&[("y", 1.0)], &[("x", -1.0), ("y", 0.5), ("x^2*y", -0.5)]],
    features: CUBIC,
    period: 0.02,
    begins: &[[-3.0, 3.0], [-3.0, 3.0]],
};

/// Rössler, "An equation for continuous chaos" (Phys. Lett. A 57, 1976): a = b = 0.2, c = 5.7.
const ROSSLER: System = System {
    name: "Rössler",
    states: &["x", "y", "z"],
    equations: &[&[("y", -1.0), ("z", -1.0)], &[("x", 1.0), ("y", 0.2)], &[("1", 0.2), ("x*z", 1.0), ("z", -5.7)]],
    features: CUBIC,
    period: 0.02,
    begins: &[[-6.0, 6.0], [-6.0, 6.0], [0.0, 1.0]],
};

/// A pendulum of 2 m (g = 9.81 m/s^2) with viscous friction.
const PENDULUM: System = System {
    name: "damped pendulum",
    states: &["angle", "rate"],
    equations: &[&[("rate", 1.0)], &[("sin(angle)", -4.905), ("rate", -0.2)]],
    features: Features { trigonometric: true, ..CUBIC },
    period: 0.02,
    begins: &[[-2.8, 2.8], [-0.5, 0.5]],
};

/// Lorenz, "Predictability: a problem partly solved" (ECMWF Seminar on Predictability, 1996), five states, F = 8:
/// `x_i' = (x_{i+1} - x_{i-2}) x_{i-1} - x_i + F` around a ring.
const LORENZ_96: System = System {
    name: "Lorenz 96, 5 states",
    states: &["a", "b", "c", "d", "e"],
    equations: &[
        &[("b*e", 1.0), ("d*e", -1.0), ("a", -1.0), ("1", 8.0)],
        &[("a*c", 1.0), ("a*e", -1.0), ("b", -1.0), ("1", 8.0)],
        &[("b*d", 1.0), ("a*b", -1.0), ("c", -1.0), ("1", 8.0)],
        &[("c*e", 1.0), ("b*c", -1.0), ("d", -1.0), ("1", 8.0)],
        &[("a*d", 1.0), ("c*d", -1.0), ("e", -1.0), ("1", 8.0)],
    ],
    features: CUBIC,
    period: 0.01,
    begins: &[[-4.0, 8.0]; 5],
};

/// All of them, in the order of the table.
pub(crate) static SYSTEMS: [System; 6] = [LORENZ, LOTKA_VOLTERRA, VAN_DER_POL, ROSSLER, PENDULUM, LORENZ_96];
