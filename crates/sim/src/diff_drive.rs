//! A wheeled robot with two motors, whose wheels grip at low speed and slip at high speed: a piecewise-affine system with known truth.

use fleetfoot_data::{Column, MemorySource, Source};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use crate::OrnsteinUhlenbeck;

/// How speed and yaw rate answer to the motors in one mode:
/// `v' = -damping v + gain (left + right) / 2 + offset`, `w' = -yaw_damping w + yaw_gain (right - left)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// 1/s
    pub damping: f64,
    /// m/s^2 per unit of command
    pub gain: f64,
    /// m/s^2
    pub offset: f64,
    /// 1/s
    pub yaw_damping: f64,
    /// rad/s^2 per unit of command
    pub yaw_gain: f64,
}

/// The robot and its sensors.
#[derive(Debug, Clone, PartialEq)]
pub struct DiffDrive {
    /// Below the slip speed.
    pub grip: Mode,
    /// Above it.
    pub slip: Mode,
    /// m/s
    pub slip_speed: f64,
    /// Sampling period of the log, s.
    pub dt: f64,
    /// Standard deviation of the noise on speed (m/s) and yaw rate (rad/s).
    pub noise: f64,
}

impl Default for DiffDrive {
    fn default() -> Self {
        Self {
            grip: Mode { damping: 2.0, gain: 3.0, offset: 0.0, yaw_damping: 4.0, yaw_gain: 9.0 },
            slip: Mode { damping: 5.0, gain: 2.0, offset: 1.0, yaw_damping: 7.0, yaw_gain: 4.0 },
            slip_speed: 0.5,
            dt: 0.01,
            noise: 0.001,
        }
    }
}

/// Speed, yaw rate, yaw, x, y.
type State = [f64; 5];

impl DiffDrive {
    /// The names of the logged columns: `t x y yaw v w left right` without the time.
    pub fn columns() -> Vec<Column> {
        let column = |name: &str, unit: &str| Column { unit: Some(unit.to_owned()), ..Column::float(name) };
        vec![
            column("x", "m"),
            column("y", "m"),
            column("yaw", "rad"),
            column("v", "m/s"),
            column("w", "rad/s"),
            column("left", "1"),
            column("right", "1"),
        ]
    }

    /// The mode at a speed.
    pub fn mode(&self, speed: f64) -> &Mode {
        if speed > self.slip_speed { &self.slip } else { &self.grip }
    }

    /// One run of `seconds`, driven by random motor commands; the same seed gives the same run.
    pub fn run(&self, seconds: f64, seed: u64) -> impl Source + use<> {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut common = OrnsteinUhlenbeck::new(0.35, 1.5, self.dt, &mut random);
        let mut turning = OrnsteinUhlenbeck::new(0.2, 0.7, self.dt, &mut random);
        let mut state: State = [0.0; 5];
        let rows = (seconds / self.dt).round() as usize;
        let mut values = vec![Vec::new(); 7];
        for _ in 0..rows {
            let forward = (0.35 + common.next(&mut random)).clamp(-1.0, 1.0);
            let turn = turning.next(&mut random).clamp(-1.0, 1.0);
            let command = [forward - turn, forward + turn];
            let [v, w, yaw, x, y] = state;
            let noise: [f64; 2] = [StandardNormal.sample(&mut random), StandardNormal.sample(&mut random)];
            let wrapped = yaw.sin().atan2(yaw.cos());
            let row = [x, y, wrapped, v + self.noise * noise[0], w + self.noise * noise[1], command[0], command[1]];
            values.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
            state = self.advance(state, command);
        }
        let mut source = MemorySource::new(Self::columns());
        source.push_uniform(format!("run {seed}"), self.dt, values);
        source
    }

    /// One sampling period with held commands, in ten steps of the classical Runge-Kutta method.
    fn advance(&self, mut state: State, command: [f64; 2]) -> State {
        const STEPS: usize = 10;
        let h = self.dt / STEPS as f64;
        let add = |a: &State, k: &State, s: f64| -> State { std::array::from_fn(|i| a[i] + s * k[i]) };
        for _ in 0..STEPS {
            let k1 = self.derivative(&state, command);
            let k2 = self.derivative(&add(&state, &k1, h / 2.0), command);
            let k3 = self.derivative(&add(&state, &k2, h / 2.0), command);
            let k4 = self.derivative(&add(&state, &k3, h), command);
            state = std::array::from_fn(|i| state[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
        state
    }

    fn derivative(&self, &[v, w, yaw, ..]: &State, [left, right]: [f64; 2]) -> State {
        let mode = self.mode(v);
        [
            -mode.damping * v + mode.gain * (left + right) / 2.0 + mode.offset,
            -mode.yaw_damping * w + mode.yaw_gain * (right - left),
            w,
            v * yaw.cos(),
            v * yaw.sin(),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fleetfoot_data::Halo;

    #[test]
    fn runs_repeat_and_visit_both_modes() {
        let robot = DiffDrive::default();
        let (a, b) = (robot.run(20.0, 3), robot.run(20.0, 3));
        assert_eq!(a.episodes()[0].id, b.episodes()[0].id);
        assert_ne!(a.episodes()[0].id, robot.run(20.0, 4).episodes()[0].id);
        let block = a.read(0, 0..2000, Halo::default()).unwrap();
        let slipping = block.core(3).iter().filter(|&&v| v > robot.slip_speed).count();
        assert!((200..1800).contains(&slipping), "{slipping}");
    }

    #[test]
    fn without_commands_speed_decays_as_the_mode_says() {
        let robot = DiffDrive::default();
        let mut state = [0.4, 0.3, 0.0, 0.0, 0.0];
        for _ in 0..100 {
            state = robot.advance(state, [0.0, 0.0]);
        }
        assert!((state[0] - 0.4 * (-2.0f64).exp()).abs() < 1e-9);
        assert!((state[1] - 0.3 * (-4.0f64).exp()).abs() < 1e-8);
        assert!((state[2] - 0.3 * (1.0 - (-4.0f64).exp()) / 4.0).abs() < 1e-8);
    }
}
