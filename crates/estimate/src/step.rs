//! The step of least squares within a region of trust and between bounds.

use faer::Mat;
use fleetfoot_stats::svd;

use crate::EstimateError;

/// Singular values below this share of the largest are rounding: the step has no part in their directions.
pub(crate) fn rank_level(columns: usize) -> f64 {
    16.0 * f64::EPSILON * ((columns + 1) as f64).sqrt()
}

/// A trial step.
#[derive(Debug, Clone)]
pub(crate) struct Step {
    /// s (p).
    pub(crate) step: Vec<f64>,
    /// `|D s|`.
    pub(crate) length: f64,
    /// The same of the step that the region holds back, if limits of matrices shorten it. At their border steps end
    /// while the region is to stay.
    pub(crate) reach: f64,
    /// Reduction of the cost by the linear model.
    pub(crate) predicted: f64,
    /// True if the region held it back.
    pub(crate) bounded: bool,
    /// The damping mu with which it is least, of the parameters that no bound held.
    pub(crate) damping: f64,
}

/// The region: `|D s| <= radius`, `low <= s <= high`.
pub(crate) struct Region<'a> {
    /// D (p), positive.
    pub(crate) scale: &'a [f64],
    pub(crate) radius: f64,
    /// Least and greatest step of every parameter; both 0 for one that is fixed.
    pub(crate) room: &'a [[f64; 2]],
}

/// Minimises `|rhs + J s|` over the region: the problem of Levenberg and Marquardt as posed by More (1978), with the
/// damping from the singular values. A parameter whose step would leave its bounds goes to the bound and stays there,
/// and the others are solved for again.
pub(crate) fn step(jacobian: &Mat<f64>, rhs: &[f64], region: &Region<'_>) -> Result<Step, EstimateError> {
    let p = region.scale.len();
    let mut step = vec![0.0; p];
    let mut free: Vec<usize> = (0..p).filter(|&j| region.room[j][0] < region.room[j][1]).collect();
    let mut left = rhs.to_vec();
    let (mut bounded, mut damping) = (false, 0.0);
    while !free.is_empty() {
        let (candidate, held) = within_radius(jacobian, &left, region, &free)?;
        (bounded, damping) = (bounded || held > 0.0, held);
        let beyond = |&(j, s): &(usize, f64)| s < region.room[j][0] || s > region.room[j][1];
        let pairs: Vec<(usize, f64)> = free.iter().copied().zip(candidate).collect();
        if !pairs.iter().any(beyond) {
            pairs.iter().for_each(|&(j, s)| step[j] = s);
            break;
        }
        for &(j, s) in pairs.iter().filter(|pair| beyond(pair)) {
            step[j] = s.clamp(region.room[j][0], region.room[j][1]);
            left.iter_mut().zip(jacobian.col_as_slice(j)).for_each(|(left, a)| *left += a * step[j]);
        }
        free = pairs.iter().filter(|pair| !beyond(pair)).map(|&(j, _)| j).collect();
    }
    let mut moved = vec![0.0; rhs.len()];
    for (j, &s) in step.iter().enumerate().filter(|(_, s)| **s != 0.0) {
        moved.iter_mut().zip(jacobian.col_as_slice(j)).for_each(|(moved, a)| *moved += a * s);
    }
    let predicted = -moved.iter().zip(rhs).map(|(moved, rhs)| moved * (2.0 * rhs + moved)).sum::<f64>();
    let length = step.iter().zip(region.scale).map(|(s, d)| (s * d).powi(2)).sum::<f64>().sqrt();
    Ok(Step { step, length, reach: length, predicted, bounded, damping })
}

/// The step of the free parameters, bounds aside, and the damping by which the radius held it back.
fn within_radius(
    jacobian: &Mat<f64>,
    rhs: &[f64],
    region: &Region<'_>,
    free: &[usize],
) -> Result<(Vec<f64>, f64), EstimateError> {
    let scaled = Mat::from_fn(rhs.len(), free.len(), |i, k| jacobian[(i, free[k])] / region.scale[free[k]]);
    let factors = svd(scaled.as_ref()).ok_or(EstimateError::Overflow)?;
    let least = factors.s.first().map_or(0.0, |largest| largest * rank_level(free.len()));
    let rank = factors.s.iter().filter(|&&s| s > least).count();
    let s = &factors.s[..rank];
    let along: Vec<f64> =
        (0..rank).map(|i| factors.u.col_as_slice(i).iter().zip(rhs).map(|(u, r)| u * r).sum()).collect();
    let damping = damping(s, &along, region.radius);
    let mut step = vec![0.0; free.len()];
    for i in 0..rank {
        let share = -along[i] * s[i] / (s[i] * s[i] + damping);
        step.iter_mut().zip(factors.v.col_as_slice(i)).for_each(|(value, v)| *value += share * v);
    }
    step.iter_mut().zip(free).for_each(|(value, &j)| *value /= region.scale[j]);
    Ok((step, damping))
}

/// The damping mu at which `|y(mu)|`, `y_i = s_i c_i / (s_i^2 + mu)`, is the radius up to a tenth. It is 0 when the
/// undamped step is short enough.
///
/// Newton's method on `1/radius - 1/|y|` (Hebden 1973), which is nearly linear in mu, between bounds that close in.
fn damping(s: &[f64], c: &[f64], radius: f64) -> f64 {
    let terms = || s.iter().zip(c);
    let length = |mu: f64| terms().map(|(s, c)| (s * c / (s * s + mu)).powi(2)).sum::<f64>().sqrt();
    if length(0.0) <= 1.1 * radius {
        return 0.0;
    }
    let mut low = 0.0_f64;
    let mut high = terms().map(|(s, c)| (s * c).powi(2)).sum::<f64>().sqrt() / radius;
    let mut mu = high * 1e-3;
    for _ in 0..100 {
        let now = length(mu);
        if (now - radius).abs() <= 0.1 * radius {
            break;
        }
        if now > radius {
            low = low.max(mu)
        } else {
            high = high.min(mu)
        }
        let slope = terms().map(|(s, c)| (s * c).powi(2) / (s * s + mu).powi(3)).sum::<f64>();
        mu += (now - radius) / radius * now * now / slope;
        if !(mu > low && mu < high) {
            mu = (low * high).sqrt().max(1e-3 * high);
        }
    }
    mu
}
