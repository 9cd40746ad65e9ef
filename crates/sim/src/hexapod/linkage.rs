//! From crank to legs.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::parameter_error::{ParameterError, in_range, not_negative};

/// Position of a leg that its linkage demands at a crank angle, with derivatives by the angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegTarget {
    /// Fore-aft angle of the leg about the hip, forward positive, rad.
    pub swing: f64,
    /// Derivative of the swing with the crank angle, rad/rad.
    pub swing_gain: f64,
    /// Height of the leg over its middle position in the trunk, m.
    pub lift: f64,
    /// Derivative of the lift with the crank angle, m/rad.
    pub lift_gain: f64,
}

/// The map from a side's crank angle to its three legs.
///
/// With the leg's phase a (the crank angle for the fore and aft legs, half a turn more for the middle leg):
/// `swing = A tanh(k cos a) / tanh k`, `lift = -H sin a - C (1 - cos swing)`. A leg touches down at a = 0 swung forward, is in mid-stance at pi/2, lifts off at pi swung back,
/// and returns through the air: a positive rate walks forward. The second term of the lift makes up for the arc of the swing: where C is the leg's length,
/// the foot of an unloaded leg goes up and down by H sin a alone. The swing has its dead bands near multiples of pi, wider for larger k, as
/// Fig. 2 of Buchan, Haldane, Fearing, *Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot* (IROS 2013); the middle leg's
/// mid-stance is at 3 pi/2.
///
/// It departs from the real four-bars where the paper gives no numbers: forward and backward strokes are mirror images, swing and lift are
/// exact functions without backlash, and the linkage's own masses are neglected (the leg carries them).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Linkage {
    /// A: largest swing to either side, rad.
    pub swing_amplitude: f64,
    /// k: 0 is a sine; the larger, the wider the dead bands, 1.
    pub dead_band: f64,
    /// H: how far a foot is pushed down in mid-stance and raised in mid-swing, m.
    pub lift_amplitude: f64,
    /// C: radius of the arc that the lift makes up for, m; 0 leaves it.
    pub arc_radius: f64,
}

impl Default for Linkage {
    fn default() -> Self {
        Self { swing_amplitude: 0.7, dead_band: 1.0, lift_amplitude: 1e-3, arc_radius: 0.022 }
    }
}

impl Linkage {
    /// Checks every value.
    ///
    /// # Errors
    /// Names the parameter, its value and what is allowed.
    pub fn validate(&self) -> Result<(), ParameterError> {
        in_range("swing_amplitude", self.swing_amplitude, 1e-3, 1.2, "from 0.001 to 1.2 rad")?;
        in_range("dead_band", self.dead_band, 0.0, 5.0, "from 0 to 5")?;
        not_negative("lift_amplitude", self.lift_amplitude)?;
        not_negative("arc_radius", self.arc_radius)
    }

    /// The target of a fore or aft leg at a crank angle (rad).
    pub fn outer(&self, crank_angle: f64) -> LegTarget {
        let (sine, cosine) = crank_angle.sin_cos();
        self.target(sine, cosine)
    }

    /// The target of the middle leg at a crank angle (rad), half a turn behind.
    pub fn middle(&self, crank_angle: f64) -> LegTarget {
        let (sine, cosine) = crank_angle.sin_cos();
        self.target(-sine, -cosine)
    }

    fn target(&self, sine: f64, cosine: f64) -> LegTarget {
        let (shape, slope) = self.shape(cosine);
        let swing = self.swing_amplitude * shape;
        let swing_gain = -self.swing_amplitude * slope * sine;
        let (swing_sine, swing_cosine) = swing.sin_cos();
        LegTarget {
            swing,
            swing_gain,
            lift: -self.lift_amplitude * sine - self.arc_radius * (1.0 - swing_cosine),
            lift_gain: -self.lift_amplitude * cosine - self.arc_radius * swing_sine * swing_gain,
        }
    }

    /// Travel of the body per crank angle if no foot slips and no leg bends, m/rad: the radius r of the paper's
    /// equation (2).
    ///
    /// A stance is half a turn and takes the foot from `leg_length sin A` before the hip to as much behind it.
    pub fn effective_radius(&self, leg_length: f64) -> f64 {
        2.0 * leg_length * self.swing_amplitude.sin() / PI
    }

    /// tanh(k c) / tanh k and its derivative with c; c itself where k vanishes.
    fn shape(&self, cosine: f64) -> (f64, f64) {
        if self.dead_band < 1e-6 {
            return (cosine, 1.0);
        }
        let (value, end) = ((self.dead_band * cosine).tanh(), self.dead_band.tanh());
        (value / end, self.dead_band * (1.0 - value * value) / end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_the_derivatives() {
        for linkage in [Linkage::default(), Linkage { dead_band: 0.0, ..Linkage::default() }] {
            for i in 0..100 {
                let (a, h) = (i as f64 * 0.13 - 5.0, 1e-5);
                for map in [Linkage::outer, Linkage::middle] {
                    let (here, before, after) = (map(&linkage, a), map(&linkage, a - h), map(&linkage, a + h));
                    assert!((here.swing_gain - (after.swing - before.swing) / (2.0 * h)).abs() < 1e-9);
                    assert!((here.lift_gain - (after.lift - before.lift) / (2.0 * h)).abs() < 1e-11);
                }
            }
        }
    }

    #[test]
    fn the_middle_leg_is_half_a_turn_off() {
        let linkage = Linkage::default();
        for i in 0..50 {
            let a = i as f64 * 0.3 - 4.0;
            let (middle, outer) = (linkage.middle(a), linkage.outer(a + PI));
            assert!((middle.swing - outer.swing).abs() < 1e-14 && (middle.lift - outer.lift).abs() < 1e-16);
        }
    }

    #[test]
    fn dead_bands_lie_at_multiples_of_pi() {
        let linkage = Linkage::default();
        assert!((linkage.outer(0.0).swing - linkage.swing_amplitude).abs() < 1e-15);
        for turn in [0.0, PI, 2.0 * PI] {
            let slope = linkage.outer(turn + 0.3).swing_gain.abs();
            assert!(slope < 0.25 * linkage.outer(PI / 2.0).swing_gain.abs(), "{slope}");
        }
        let stance = linkage.outer(PI / 2.0);
        assert!(stance.swing.abs() < 1e-15 && stance.swing_gain < 0.0 && stance.lift < 0.0);
        assert!(linkage.middle(1.5 * PI).lift < 0.0);
    }
}
