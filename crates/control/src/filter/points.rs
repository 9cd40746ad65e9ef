//! Points that stand for a normal distribution.

use fleetfoot_data::mix;

use super::Gaussian;

/// The least number of points.
const LEAST: usize = 128;
/// Points a dimension, where that is more.
const EACH: usize = 16;

/// Points of the standard normal distribution in n dimensions (points x n). Every coordinate has a value in each of as
/// many strata of equal probability, in a separate order (Latin hypercube: McKay, Beckman and Conover, "A comparison of
/// three methods for selecting values of input variables", Technometrics 21, 1979). Each point has its opposite, and
/// all are scaled so that mean and covariance are 0 and I to rounding.
pub(super) fn standard_points(n: usize) -> Vec<f64> {
    let half = LEAST.max(EACH * n) / 2;
    let strata: Vec<f64> = (0..half).map(|k| quantile((k as f64 + 0.5) / half as f64)).collect();
    let mut points = vec![0.0; half * n];
    for i in 0..n {
        let mut order: Vec<usize> = (0..half).collect();
        order.sort_by_key(|&point| mix(((i as u64) << 32) | point as u64));
        order.iter().zip(&strata).for_each(|(&point, &value)| points[point * n + i] = value);
    }
    let spread =
        |i: usize, j: usize| (0..half).map(|p| points[p * n + i] * points[p * n + j]).sum::<f64>() / half as f64;
    let covariance = (0..n * n).map(|at| spread(at / n, at % n)).collect();
    let lower = Gaussian { mean: vec![0.0; n], covariance }.factor(n);
    for point in points.chunks_exact_mut(n.max(1)) {
        for i in 0..n {
            for k in 0..i {
                point[i] -= lower[i * n + k] * point[k];
            }
            point[i] /= lower[i * n + i];
        }
    }
    points.iter().copied().chain(points.iter().map(|value| -value)).collect()
}

/// The number below which a standard normal one lies with this probability, by bisection of `1/2 + phi(x) (x + x^3/3 + x^5/15 + ...)`.
fn quantile(p: f64) -> f64 {
    let below = |x: f64| {
        let (mut term, mut sum, mut k) = (x, x, 1.0);
        while term.abs() > 1e-17 * sum.abs() {
            k += 2.0;
            term *= x * x / k;
            sum += term;
        }
        0.5 + sum * (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt()
    };
    let (mut low, mut high) = (-6.0, 6.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if below(middle) < p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sigma_points_match_normal_moments() {
        for n in [1, 2, 3, 6, 16] {
            let points = standard_points(n);
            let count = points.len() / n;
            for i in 0..n {
                for j in 0..=i {
                    let of = |p: &[f64]| p[i] * p[j];
                    let moment = points.chunks_exact(n).map(of).sum::<f64>() / count as f64;
                    assert!((moment - f64::from(u8::from(i == j))).abs() < 1e-12, "{n} {i} {j}: {moment}");
                }
                // 15.9 % lie above one deviation.
                let above = points.chunks_exact(n).filter(|p| p[i] > 1.0).count() as f64 / count as f64;
                assert!((above - 0.159).abs() < 0.06, "{n} {i}: {above}");
            }
        }
    }
}
