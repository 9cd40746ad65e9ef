//! The controller's computer beside the treadmill.

use std::collections::VecDeque;

use fleetfoot_control::controller::Treadmill;

use super::parameters::{COMMANDS, HexapodTreadmill, SHOWN};
use crate::excitation::Signal;
use crate::regulated::Regulated;
use crate::sensor::{self, MocapFrame};

/// Equation (1), or a regulator, on what the motion capture last said.
pub(super) struct Desk {
    law: Treadmill,
    regulator: Option<Regulated>,
    /// When it first commanded, ns.
    began: Option<i64>,
    /// Poses on their way from the motion capture: arrival; x, y and yaw.
    coming: VecDeque<(i64, [f64; 3])>,
    seen: [f64; 3],
    excitation: [Signal; 2],
}

impl Desk {
    pub(super) fn new(scenario: &HexapodTreadmill, seed: u64) -> Self {
        let excitation = &scenario.excitation;
        let signal = |excitation: &crate::Excitation, purpose: &str| {
            excitation.signal(scenario.controller.period, sensor::stream(seed, purpose))
        };
        Self {
            law: scenario.controller,
            regulator: scenario.regulator.as_ref().map(|law| Regulated::new(law, &SHOWN, &COMMANDS)),
            began: None,
            coming: VecDeque::new(),
            seen: [0.0; 3],
            excitation: [
                signal(&excitation.velocity, "excitation/velocity"),
                signal(&excitation.yaw_rate, "excitation/yaw_rate"),
            ],
        }
    }

    /// A frame leaves the motion capture.
    pub(super) fn send(&mut self, frame: &MocapFrame) {
        let Some(pose) = frame.pose else { return };
        let [x, y, z, w] = pose.orientation.to_array();
        let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
        self.coming.push_back((frame.arrival, [pose.position.x, pose.position.y, yaw]));
    }

    /// The command at a true time (ns): forward velocity (m/s) and yaw rate (rad/s). While markers are lost the last known pose stands.
    /// `motion` is the robot's own velocity and yaw rate, for excitations that look at it.
    pub(super) fn command(&mut self, now: i64, belt_speed: f64, motion: [f64; 2]) -> [f64; 2] {
        while self.coming.front().is_some_and(|(arrival, ..)| *arrival <= now) {
            if let Some((_, pose)) = self.coming.pop_front() {
                self.seen = pose;
            }
        }
        let mut command = self.law.command(belt_speed, self.seen);
        if let Some(regulator) = &mut self.regulator {
            let seconds = (now - *self.began.get_or_insert(now)) as f64 * 1e-9;
            let [x, y, yaw] = self.seen;
            regulator.command(seconds, &[x, y, yaw, belt_speed], &mut command);
        }
        let [v, w] = command;
        let [dv, dw] = [0, 1].map(|channel| self.excitation[channel].next(motion[channel]));
        self.law.limited(v + dv, w + dw)
    }
}
