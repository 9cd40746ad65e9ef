//! Set points: where a model can rest, for given values of some of its states and inputs.

use faer::Mat;
use fleetfoot_stats::svd;

use super::coordinates::Coordinates;
use crate::pieces::{Affine, Pieces};

/// Newton's steps.
const MOST_STEPS: usize = 100;
/// A step that moves every unknown by less than this share of its size is the last.
const STILL: f64 = 1e-12;
/// Singular values below this share of the largest one are taken for zero: the directions they belong to stay as they are.
const DEPENDENT: f64 = 1e-10;
/// Remaining motion, in sizes of states (per second, or per sample), below which the model is at rest.
const AT_REST: f64 = 1e-7;
/// Standard errors of the model's numbers within which a remaining motion counts as rest.
const DOUBTED: f64 = 3.0;

/// A point where a submodel rests, or moves as little as it can.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rest {
    pub(crate) x: Vec<f64>,
    pub(crate) u: Vec<f64>,
    /// Remaining motion: derivatives (or, of a discrete model, changes a sample), one a coordinate.
    pub(crate) drift: Vec<f64>,
    /// Moving coordinates: those that neither stand still nor could do so within the standard errors of the submodel.
    pub(crate) moving: Vec<usize>,
    /// True if only rounding remains.
    pub(crate) exact: bool,
}

impl Rest {
    /// Returns true if the submodel rests there, within its accuracy.
    pub(crate) fn holds(&self) -> bool {
        self.moving.is_empty()
    }
}

/// Requirements of a set point.
pub(super) struct Wanted {
    /// Start of the search, with the given values.
    pub(crate) x: Vec<f64>,
    pub(crate) u: Vec<f64>,
    /// Coordinates, then inputs, that may be chosen.
    pub(crate) unknown: Vec<bool>,
    /// Coordinates that must rest.
    pub(crate) rests: Vec<bool>,
}

/// Derivatives, or next states, to first order at states and inputs.
type About<'a> = &'a dyn Fn(&[f64], &[f64]) -> Affine;

/// The rest of a submodel, by Gauss-Newton steps of least length in sizes of coordinates and inputs, halved while they make things worse. `affine` gives the derivatives
/// (or next states) to first order at a point, `doubt` the standard error of each, a state.
pub(super) fn rest(
    pieces: &Pieces,
    coordinates: &Coordinates<'_>,
    wanted: &Wanted,
    (affine, doubt): (About<'_>, &[f64]),
) -> Rest {
    let n = coordinates.len();
    let size = |v: usize| match coordinates.of.get(v) {
        Some(coordinate) => coordinate.size,
        None => pieces.size(wanted.x.len() + v - n),
    };
    let unknown: Vec<usize> = (0..wanted.unknown.len()).filter(|&v| wanted.unknown[v]).collect();
    let rows: Vec<usize> = (0..n).filter(|&s| wanted.rests[s]).collect();
    let (mut x, mut u) = (wanted.x.clone(), wanted.u.clone());
    let drift_of = |affine: &Affine, x: &[f64], u: &[f64]| -> Vec<f64> {
        let values = coordinates.values(x);
        let next = affine.at(&values, u);
        if pieces.continuous { next } else { next.iter().zip(&values).map(|(next, value)| next - value).collect() }
    };
    let affine = |x: &[f64], u: &[f64]| coordinates.reduced(&affine(x, u), x, pieces.continuous);
    let length = |drift: &[f64]| rows.iter().map(|&s| (drift[s] / size(s)).powi(2)).sum::<f64>().sqrt();
    let mut here = affine(&x, &u);
    let mut drift = drift_of(&here, &x, &u);
    for _ in 0..MOST_STEPS {
        let jacobian = Mat::from_fn(rows.len(), unknown.len(), |i, j| {
            let (s, v) = (rows[i], unknown[j]);
            let slope = if v < n { here.a[(s, v)] } else { here.b[(s, v - n)] };
            let slope = slope - f64::from(u8::from(!pieces.continuous && v == s));
            slope * size(v) / size(s)
        });
        let right: Vec<f64> = rows.iter().map(|&s| -drift[s] / size(s)).collect();
        let Some(step) = shortest(&jacobian, &right) else { break };
        let (mut share, before) = (1.0, length(&drift));
        let moved = |share: f64| {
            let (mut change, mut to_u) = (vec![0.0; n], u.clone());
            for (&v, step) in unknown.iter().zip(&step) {
                let value = if v < n { &mut change[v] } else { &mut to_u[v - n] };
                *value += share * step * size(v);
            }
            (coordinates.moved(&x, &change), to_u)
        };
        let (moved_point, next, rest_drift) = loop {
            let (to_x, to_u) = moved(share);
            let next = affine(&to_x, &to_u);
            let next_drift = drift_of(&next, &to_x, &to_u);
            if length(&next_drift) <= before || share < 1e-6 {
                break ((to_x, to_u), next, next_drift);
            }
            share *= 0.5;
        };
        // A residual that no longer falls is at its minimum.
        let no_worse = length(&rest_drift) <= before;
        if !no_worse {
            break;
        }
        (x, u) = moved_point;
        (here, drift) = (next, rest_drift);
        if step.iter().all(|step| step.abs() < STILL) {
            break;
        }
    }
    let still = |s: usize, doubted: f64| drift[s].abs() <= AT_REST * size(s) + doubted * coordinates.of_state(s, doubt);
    let moving = rows.iter().copied().filter(|&s| !still(s, DOUBTED)).collect();
    let exact = rows.iter().all(|&s| still(s, 0.0));
    Rest { x, u, drift, moving, exact }
}

/// The shortest vector that minimises `|A v - b|`.
pub(super) fn shortest(a: &Mat<f64>, b: &[f64]) -> Option<Vec<f64>> {
    let factors = svd(a.as_ref())?;
    let floor = DEPENDENT * factors.s.first().copied().unwrap_or(0.0);
    let mut out = vec![0.0; a.ncols()];
    for (k, &s) in factors.s.iter().enumerate().filter(|(_, s)| **s > floor) {
        let along = b.iter().enumerate().map(|(i, b)| factors.u[(i, k)] * b).sum::<f64>() / s;
        out.iter_mut().enumerate().for_each(|(j, out)| *out += along * factors.v[(j, k)]);
    }
    Some(out)
}
