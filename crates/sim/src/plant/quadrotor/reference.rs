//! Reference trajectories of the quadrotor.

use std::f64::consts::TAU;

use glam::DVec3;
use rand::RngExt;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::parameter_error::{ParameterError, finite, in_range, positive};
use crate::sensor::stream;

/// Trajectory to fly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Reference {
    /// It stays.
    Hover {
        /// m
        position: [f64; 3],
    },
    /// A lying eight, x = a sin p, y = b sin 2p, z = c + d sin p, begun from rest.
    FigureEight {
        /// Centre, m.
        centre: [f64; 3],
        /// Amplitudes a, b, d, m.
        amplitude: [f64; 3],
        /// Of one round, s.
        period: f64,
    },
    /// One random point of a box after the other, along straight lines of least jerk, at rest at each.
    Waypoints {
        /// Centre of the box, m.
        centre: [f64; 3],
        /// Half its size, m.
        half_size: [f64; 3],
        /// The greatest speed between two points, m/s.
        speed: f64,
    },
}

impl Default for Reference {
    fn default() -> Self {
        Self::Waypoints { centre: [0.0, 0.0, 1.5], half_size: [1.5, 1.5, 0.7], speed: 1.5 }
    }
}

impl Reference {
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        let each = |name: &str, values: &[f64; 3]| (0..3).try_for_each(|i| finite(&format!("{name}[{i}]"), values[i]));
        match self {
            Self::Hover { position } => each("position", position),
            Self::FigureEight { centre, amplitude, period } => {
                each("centre", centre)?;
                each("amplitude", amplitude)?;
                in_range("period", *period, 0.1, 1e6, "from 0.1 to 1000000 s")
            }
            Self::Waypoints { centre, half_size, speed } => {
                each("centre", centre)?;
                (0..3).try_for_each(|i| positive(&format!("half_size[{i}]"), half_size[i]))?;
                in_range("speed", *speed, 0.01, 100.0, "from 0.01 to 100 m/s")
            }
        }
    }
}

/// A point of the trajectory with its derivatives, m, m/s, m/s^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Target {
    pub(super) position: DVec3,
    pub(super) velocity: DVec3,
    pub(super) acceleration: DVec3,
}

impl Target {
    fn rest(position: DVec3) -> Self {
        Self { position, velocity: DVec3::ZERO, acceleration: DVec3::ZERO }
    }
}

/// A trajectory under way: asked for at times that do not decrease.
pub(super) struct Trajectory {
    reference: Reference,
    random: Pcg64,
    /// Of the present segment.
    from: DVec3,
    to: DVec3,
    begin: f64,
    length: f64,
}

impl Trajectory {
    pub(super) fn new(reference: &Reference, seed: u64) -> Self {
        let start = match reference {
            Reference::Hover { position } => DVec3::from_array(*position),
            Reference::FigureEight { centre, .. } | Reference::Waypoints { centre, .. } => DVec3::from_array(*centre),
        };
        let random = stream(seed, "reference");
        Self { reference: reference.clone(), random, from: start, to: start, begin: 0.0, length: 1.0 }
    }

    pub(super) fn at(&mut self, time: f64) -> Target {
        match self.reference {
            Reference::Hover { position } => Target::rest(DVec3::from_array(position)),
            Reference::FigureEight { centre, amplitude, period } => {
                eight(DVec3::from_array(centre), DVec3::from_array(amplitude), period, time)
            }
            Reference::Waypoints { centre, half_size, speed } => {
                while time >= self.begin + self.length {
                    self.next_segment(DVec3::from_array(centre), DVec3::from_array(half_size), speed);
                }
                least_jerk(self.from, self.to, self.length, time - self.begin)
            }
        }
    }

    fn next_segment(&mut self, centre: DVec3, half_size: DVec3, speed: f64) {
        self.begin += self.length;
        self.from = self.to;
        let uniform = DVec3::from_array(std::array::from_fn(|_| self.random.random_range(-1.0..1.0)));
        self.to = centre + half_size * uniform;
        // The greatest speed of a least-jerk segment is 15/8 of the mean.
        self.length = (1.875 * self.from.distance(self.to) / speed).max(0.5);
    }
}

/// The phase p = w (t - s (1 - exp(-t/s))) begins from rest and gathers its rate w within some s = a quarter of a
/// round.
fn eight(centre: DVec3, amplitude: DVec3, period: f64, time: f64) -> Target {
    let (rate, start) = (TAU / period, period / 4.0);
    let decay = (-time / start).exp();
    let phase = rate * (time - start * (1.0 - decay));
    let (phase_rate, phase_acceleration) = (rate * (1.0 - decay), rate * decay / start);
    let (sin, cos) = phase.sin_cos();
    let (sin2, cos2) = (2.0 * phase).sin_cos();
    let first = amplitude * DVec3::new(cos, 2.0 * cos2, cos);
    let second = amplitude * DVec3::new(-sin, -4.0 * sin2, -sin);
    Target {
        position: centre + amplitude * DVec3::new(sin, sin2, sin),
        velocity: first * phase_rate,
        acceleration: second * phase_rate * phase_rate + first * phase_acceleration,
    }
}

/// From rest to rest along a line with the least integral of the squared jerk: 10 s^3 - 15 s^4 + 6 s^5 (Flash and
/// Hogan, 1985).
fn least_jerk(from: DVec3, to: DVec3, length: f64, time: f64) -> Target {
    let s = time / length;
    let way = to - from;
    Target {
        position: from + way * (s * s * s * (10.0 + s * (6.0 * s - 15.0))),
        velocity: way * (30.0 * s * s * (1.0 + s * (s - 2.0)) / length),
        acceleration: way * (60.0 * s * (1.0 + s * (2.0 * s - 3.0)) / (length * length)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocities_and_accelerations_are_derivatives() {
        let references = [
            Reference::default(),
            Reference::FigureEight { centre: [0.0, 1.0, 2.0], amplitude: [1.0, 0.5, 0.3], period: 5.0 },
        ];
        for reference in references {
            let mut trajectory = Trajectory::new(&reference, 4);
            let step = 1e-4;
            let targets: Vec<Target> = (0..200_000).map(|i| trajectory.at(f64::from(i) * step)).collect();
            assert_eq!(targets[0].velocity, DVec3::ZERO);
            for three in targets.windows(3) {
                let velocity = (three[2].position - three[0].position) / (2.0 * step);
                let acceleration = (three[2].velocity - three[0].velocity) / (2.0 * step);
                assert!(velocity.distance(three[1].velocity) < 1e-4);
                // The jerk jumps where two segments meet.
                assert!(acceleration.distance(three[1].acceleration) < 2e-2);
            }
        }
    }

    #[test]
    fn waypoints_stay_in_their_box_below_their_speed() {
        let mut trajectory = Trajectory::new(&Reference::default(), 7);
        let mut fastest: f64 = 0.0;
        for i in 0..60_000 {
            let target = trajectory.at(f64::from(i) * 0.01);
            let inside = (target.position - DVec3::new(0.0, 0.0, 1.5)).abs().cmple(DVec3::new(1.5, 1.5, 0.7)).all();
            assert!(inside);
            fastest = fastest.max(target.velocity.length());
        }
        assert!((1.4..=1.5 + 1e-9).contains(&fastest), "{fastest}");
    }
}
