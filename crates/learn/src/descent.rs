//! L-BFGS (Nocedal and Wright, "Numerical Optimization", 2nd edition, algorithm 7.4) with steps that are halved until they pay (algorithm 3.1).

use crate::Error;

/// Pairs of steps and changes of the gradient that are kept.
const PAIRS: usize = 12;
/// Share of the decrease along the tangent that a step must bring.
const SUFFICIENT: f64 = 1e-4;
/// Halvings of a step before the descent ends.
const HALVINGS: usize = 20;

/// The value and gradient at a place; `None` where there is no finite one.
pub(crate) type Evaluated = Option<(f64, Vec<f64>)>;

/// Descends from `place` for so many steps at most; `after` sees every place that was taken, and says whether to go on.
pub(crate) fn descend(
    place: Vec<f64>,
    steps: usize,
    mut evaluate: impl FnMut(&[f64]) -> Result<Evaluated, Error>,
    mut after: impl FnMut(&[f64]) -> Result<bool, Error>,
) -> Result<(), Error> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let Some((mut value, mut gradient)) = evaluate(&place)? else { return Ok(()) };
    let (mut place, mut pairs) = (place, Vec::<(Vec<f64>, Vec<f64>, f64)>::new());
    for _ in 0..steps {
        let mut direction: Vec<f64> = gradient.iter().map(|slope| -slope).collect();
        let mut factors = Vec::with_capacity(pairs.len());
        for (s, y, rho) in pairs.iter().rev() {
            let alpha = rho * dot(s, &direction);
            direction.iter_mut().zip(y).for_each(|(to, y)| *to -= alpha * y);
            factors.push(alpha);
        }
        let scale = pairs
            .last()
            .map_or_else(|| 0.1 / dot(&gradient, &gradient).sqrt().max(1e-300), |(_, y, rho)| 1.0 / (rho * dot(y, y)));
        direction.iter_mut().for_each(|to| *to *= scale);
        for ((s, y, rho), alpha) in pairs.iter().zip(factors.into_iter().rev()) {
            let beta = rho * dot(y, &direction);
            direction.iter_mut().zip(s).for_each(|(to, s)| *to += (alpha - beta) * s);
        }
        let along = dot(&gradient, &direction);
        if along.is_nan() || along >= 0.0 {
            return Ok(());
        }
        let (mut step, mut taken) = (1.0, None);
        for _ in 0..HALVINGS {
            let next: Vec<f64> = place.iter().zip(&direction).map(|(at, to)| at + step * to).collect();
            match evaluate(&next)? {
                Some((new, slope)) if new <= value + SUFFICIENT * step * along => {
                    taken = Some((next, new, slope));
                    break;
                }
                _ => step *= 0.5,
            }
        }
        let Some((next, new, slope)) = taken else { return Ok(()) };
        let s: Vec<f64> = next.iter().zip(&place).map(|(new, old)| new - old).collect();
        let y: Vec<f64> = slope.iter().zip(&gradient).map(|(new, old)| new - old).collect();
        let curvature = dot(&s, &y);
        // Without positive curvature the pair says nothing of a minimum.
        if curvature > 1e-10 * dot(&s, &s).sqrt() * dot(&y, &y).sqrt() {
            if pairs.len() == PAIRS {
                pairs.remove(0);
            }
            pairs.push((s, y, 1.0 / curvature));
        }
        let decrease = value - new;
        (place, value, gradient) = (next, new, slope);
        if !after(&place)? || decrease <= 1e-12 * value.abs() {
            return Ok(());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley, whose minimum is known.
    #[test]
    fn descent_reaches_the_valleys_minimum() {
        let mut last = Vec::new();
        let valley = |x: &[f64]| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            Ok(Some((a * a + 100.0 * b * b, vec![-2.0 * a - 400.0 * x[0] * b, 200.0 * b])))
        };
        let see = |place: &[f64]| {
            last = place.to_vec();
            Ok(true)
        };
        descend(vec![-1.2, 1.0], 200, valley, see).unwrap();
        assert!(last.iter().all(|x| (x - 1.0).abs() < 1e-5), "{last:?}");
    }
}
