//! Flight mechanics in the vertical plane: equations (26)-(29) of the block-sparse bolasso paper.

use super::latent::{Latent, Terms};
use crate::plant::atmosphere::{Air, GRAVITY};

/// State and controls: h (m), V (true airspeed, m/s), gamma (rad), m (kg), alpha (rad), N1 (1).
pub(super) type State = [f64; 6];

/// Forces, air and flow of a state, from the latent functions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forces {
    /// The air around.
    pub air: Air,
    /// Mach number.
    pub mach: f64,
    /// Dynamic pressure rho V^2 / 2, Pa.
    pub dynamic_pressure: f64,
    /// N
    pub thrust: f64,
    /// N
    pub drag: f64,
    /// N
    pub lift: f64,
    /// Thrust over mass flow, m/s.
    pub specific_impulse: f64,
}

impl Forces {
    /// At h, V, gamma, m, alpha, N1, on a day `isa_deviation` K warmer than standard.
    #[inline]
    pub fn at(terms: &Terms, &[altitude, speed, _, _, alpha, fan]: &[f64; 6], isa_deviation: f64) -> Self {
        let air = Air::at(altitude, isa_deviation);
        let mach = speed / air.sound_speed;
        let dynamic_pressure = 0.5 * air.density * speed * speed;
        Self {
            air,
            mach,
            dynamic_pressure,
            thrust: terms.value(Latent::Thrust, [fan, air.density, mach]),
            drag: terms.value(Latent::Drag, [dynamic_pressure, alpha, mach]),
            lift: terms.value(Latent::Lift, [dynamic_pressure, alpha, mach]),
            specific_impulse: terms.value(Latent::SpecificImpulse, [air.temperature, altitude, mach]),
        }
    }

    /// Specific force along the path and normal to it, m/s^2: what accelerometers would say.
    #[inline]
    pub(super) fn specific(&self, &[_, _, _, mass, alpha, _]: &State) -> [f64; 2] {
        let (sin, cos) = alpha.sin_cos();
        [(self.thrust * cos - self.drag) / mass, (self.thrust * sin + self.lift) / mass]
    }

    /// h', V', gamma', m' (26)-(29), with accelerations along the path and normal to it that the equations do not
    /// explain (m/s^2).
    #[inline]
    pub fn derivatives(&self, state: &[f64; 6], unexplained: [f64; 2]) -> [f64; 4] {
        let [_, speed, path, ..] = *state;
        let (sin, cos) = path.sin_cos();
        let [along, normal] = self.specific(state);
        [
            speed * sin,
            along - GRAVITY * sin + unexplained[0],
            (normal - GRAVITY * cos + unexplained[1]) / speed,
            -self.thrust / self.specific_impulse,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::integrator::rk4_step;

    /// Steady climb in closed form: with gamma' = V' = 0, T sin a + L = m g cos gamma and T cos a - D = m g sin gamma,
    /// so that (T cos a - D)^2 + (T sin a + L)^2 = (m g)^2. Solved for alpha and N1 at a chosen gamma, the aircraft
    /// flies straight on.
    #[test]
    fn a_steady_climb_is_an_equilibrium() {
        let terms = Terms::default();
        let (path, mass) = (0.06f64, 62_000.0);
        let mut state = [4_000.0, 180.0, path, mass, 0.03, 0.9];
        for _ in 0..60 {
            let forces = Forces::at(&terms, &state, 0.0);
            let (sin, cos) = state[4].sin_cos();
            let thrust = (mass * GRAVITY * path.sin() + forces.drag) / cos;
            state[5] *= thrust / forces.thrust;
            let lift = mass * GRAVITY * path.cos() - thrust * sin;
            state[4] += (lift - forces.lift) / (forces.dynamic_pressure * 650.0);
        }
        assert!((0.0..0.15).contains(&state[4]) && (0.4..1.1).contains(&state[5]), "{state:?}");
        let forces = Forces::at(&terms, &state, 0.0);
        let [along, normal] = forces.specific(&state);
        assert!((along.hypot(normal) / GRAVITY - 1.0).abs() < 1e-12);
        let rates = forces.derivatives(&state, [0.0; 2]);
        assert!((rates[0] - 180.0 * path.sin()).abs() < 1e-12);
        assert!(rates[1].abs() < 1e-11 && rates[2].abs() < 1e-13, "{rates:?}");
    }

    /// Without air a mass is a stone: a parabola, which the method integrates up to its order.
    #[test]
    fn without_forces_the_path_is_a_parabola() {
        let nothing = Terms { thrust: vec![], drag: vec![], lift: vec![], ..Terms::default() };
        let (speed, path) = (200.0f64, 0.2f64);
        let run = |steps: usize| {
            let mut state = [8_000.0, speed, path, 6e4, 0.0, 0.0];
            for _ in 0..steps {
                state = rk4_step(&state, 10.0 / steps as f64, |s| {
                    let d = Forces::at(&nothing, s, 0.0).derivatives(s, [0.0; 2]);
                    [d[0], d[1], d[2], d[3], 0.0, 0.0]
                });
            }
            (state[0] - (8_000.0 + speed * path.sin() * 10.0 - 0.5 * GRAVITY * 100.0)).abs()
        };
        assert!(run(200) < 1e-6);
        assert!(run(20) < run(10) / 12.0, "{:e} {:e}", run(10), run(20));
    }
}
