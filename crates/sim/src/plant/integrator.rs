//! The classical Runge-Kutta method for states of fixed size.

/// One step of length `step` (s) of the classical fourth-order Runge-Kutta method for `x' = f(x)`, inputs held.
///
/// Local error O(step^5), global error O(step^4) where `f` is smooth.
#[inline]
pub fn rk4_step<const N: usize>(state: &[f64; N], step: f64, f: impl Fn(&[f64; N]) -> [f64; N]) -> [f64; N] {
    let add = |k: &[f64; N], scale: f64| -> [f64; N] { std::array::from_fn(|i| state[i] + scale * k[i]) };
    let k1 = f(state);
    let k2 = f(&add(&k1, step / 2.0));
    let k3 = f(&add(&k2, step / 2.0));
    let k4 = f(&add(&k3, step));
    std::array::from_fn(|i| state[i] + step / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Error of the pendulum's angle after 2 s against a step that is too small to matter.
    fn pendulum(steps: usize) -> f64 {
        let run = |steps: usize| {
            let mut state = [1.0, 0.0];
            for _ in 0..steps {
                state = rk4_step(&state, 2.0 / steps as f64, |&[angle, rate]| [rate, -9.0 * angle.sin()]);
            }
            state[0]
        };
        (run(steps) - run(20_000)).abs()
    }

    #[test]
    fn halving_the_step_divides_the_error_by_sixteen() {
        let order = (pendulum(50) / pendulum(100)).log2();
        assert!((3.7..4.3).contains(&order), "{order}");
    }

    #[test]
    fn cubics_of_time_are_exact() {
        let mut state = [0.0, 0.0];
        for _ in 0..8 {
            state = rk4_step(&state, 0.25, |&[t, _]| [1.0, 4.0 * t * t * t]);
        }
        assert!((state[1] - 16.0).abs() < 1e-13);
    }
}
