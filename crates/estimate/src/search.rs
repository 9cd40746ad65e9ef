//! Global search without derivatives: evolution with an adapted covariance matrix.
//!
//! CMA-ES (Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772, 2016) draws points from a normal
//! distribution. It moves the distribution's mean and covariance to the better half of them. A run that has converged
//! begins anew elsewhere with twice as many points (Auger and Hansen, CEC 2005), until the evaluations are used up.
//!
//! A search begins at the initial values and ends at the best point that it evaluated. A descent goes on from there.

mod axis;
mod distribution;

use axis::Axis;
use distribution::Distribution;
use fleetfoot_data::mix;

/// First standard deviation in every direction; an interval between bounds has the length 1.
const SPREAD: f64 = 0.3;
/// Largest standard deviation at which a run has converged: a descent is faster from there.
const CONVERGED: f64 = 1e-4;

/// The best of `evaluations` points, the first of them `start`. `cost` is infinite where a point is impossible.
///
/// The same numbers in every call.
pub(crate) fn search<E>(
    bounds: &[[f64; 2]],
    start: Vec<f64>,
    evaluations: usize,
    mut cost: impl FnMut(&[f64]) -> Result<f64, E>,
) -> Result<Vec<f64>, E> {
    let axes: Vec<(usize, Axis)> =
        bounds.iter().enumerate().filter_map(|(j, bounds)| Some((j, Axis::new(*bounds, start[j])?))).collect();
    if axes.is_empty() || evaluations == 0 {
        return Ok(start);
    }
    let mut best = (cost(&start)?, start.clone());
    let (mut used, mut draws) = (1, Draws { count: 0 });
    for run in 0_u32.. {
        let place = |(j, axis): &(usize, Axis)| if run == 0 { axis.place(start[*j]) } else { axis.drawn(&mut draws) };
        let mean: Vec<f64> = axes.iter().map(place).collect();
        let points = (4 + (3.0 * (axes.len() as f64).ln()).floor() as usize) << run.min(16);
        let mut distribution = Distribution::new(mean, SPREAD, points);
        while !distribution.has_converged(CONVERGED) {
            let drawn: Vec<Vec<f64>> = (0..points).map(|_| distribution.draw(&mut draws)).collect();
            let mut costs = Vec::with_capacity(points);
            for point in &drawn {
                if used == evaluations {
                    return Ok(best.1);
                }
                used += 1;
                let mut values = start.clone();
                axes.iter().zip(point).for_each(|((j, axis), place)| values[*j] = axis.value(*place));
                let at = cost(&values)?;
                costs.push(if at.is_nan() { f64::INFINITY } else { at });
                if at < best.0 {
                    best = (at, values);
                }
            }
            if costs.iter().all(|cost| cost.is_infinite()) {
                break;
            }
            distribution.adapt(&drawn, &costs);
        }
    }
    Ok(best.1)
}

/// Random numbers by counting.
pub(super) struct Draws {
    count: u64,
}

impl Draws {
    /// Uniform in (0, 1).
    fn uniform(&mut self) -> f64 {
        self.count += 1;
        ((mix(self.count) >> 11) as f64 + 0.5) * 2.0_f64.powi(-53)
    }

    /// Standard normal (Box and Muller 1958).
    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    fn minimum(
        bounds: &[[f64; 2]],
        start: &[f64],
        evaluations: usize,
        cost: impl Fn(&[f64]) -> f64,
    ) -> (Vec<f64>, usize) {
        let mut used = 0;
        let found = search(bounds, start.to_vec(), evaluations, |x| {
            used += 1;
            Ok::<f64, Infallible>(cost(x))
        });
        (found.unwrap(), used)
    }

    #[test]
    fn narrow_valleys_are_followed() {
        let rosenbrock =
            |x: &[f64]| x.windows(2).map(|x| 100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2)).sum::<f64>();
        let (found, used) = minimum(&[[-5.0, 5.0]; 4], &[-1.2, 1.0, -1.2, 1.0], 6_000, rosenbrock);
        assert_eq!(used, 6_000);
        assert!(found.iter().all(|x| (x - 1.0).abs() < 1e-2), "{found:?}");
    }

    #[test]
    fn restarts_leave_local_minima() {
        // Rastrigin's function: 11 x 11 minima between the bounds.
        let cost = |x: &[f64]| x.iter().map(|x| x * x + 10.0 - 10.0 * (std::f64::consts::TAU * x).cos()).sum::<f64>();
        let (found, _) = minimum(&[[-5.0, 5.4]; 2], &[4.0, -3.0], 4_000, cost);
        assert!(found.iter().all(|x| x.abs() < 1e-2), "{found:?}");
    }

    #[test]
    fn scales_and_steps_are_no_obstacle() {
        // Six powers of ten between bounds, a cost without slope, and a coordinate without bounds.
        let bounds = [[1e-4, 1e2], [f64::NEG_INFINITY, f64::INFINITY], [0.0, f64::INFINITY], [2.0, 2.0]];
        let cost = |x: &[f64]| {
            let steps = (8.0 * (x[0] / 0.03).ln().abs()).floor() + (20.0 * (x[1] - 7.0).abs()).floor();
            if x[2] > 40.0 { f64::INFINITY } else { steps + (10.0 * (x[2] - 3.0).abs()).floor() + x[3] }
        };
        let (found, _) = minimum(&bounds, &[50.0, 1.0, 60.0, 2.0], 3_000, cost);
        assert!((found[0] / 0.03).ln().abs() < 0.2 && (found[1] - 7.0).abs() < 0.1, "{found:?}");
        assert!((found[2] - 3.0).abs() < 0.2 && found[3] == 2.0, "{found:?}");
    }

    #[test]
    fn bounds_are_kept_and_reached() {
        let bounds = [[-1.0, 1.0], [0.5, f64::INFINITY]];
        let cost = |x: &[f64]| {
            assert!(x[0].abs() <= 1.0 && x[1] >= 0.5, "{x:?}");
            (x[0] - 3.0).powi(2) + x[1].powi(2)
        };
        let (found, _) = minimum(&bounds, &[0.0, 4.0], 1_000, cost);
        assert!(found[0] > 0.99 && found[1] < 0.51, "{found:?}");
        assert_eq!(minimum(&bounds, &[0.0, 4.0], 1, cost), (vec![0.0, 4.0], 1));
        assert_eq!(minimum(&[[1.0, 1.0]], &[1.0], 50, |_| 0.0), (vec![1.0], 0));
    }
}
