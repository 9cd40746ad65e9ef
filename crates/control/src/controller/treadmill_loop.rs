//! The treadmill's law around a model.

use serde::{Deserialize, Serialize};

use super::{Controller, ControllerState, ParameterError, Sampling, Treadmill, check};

/// [`Treadmill`] as the controller of a rollout: II-F of Buchan, Haldane, Fearing, which computes the input from the
/// simulated state "using the same control law".
///
/// A command is computed every `period` from the state as it was `latency` ago, and held. Until the first state of the trajectory itself has
/// come through the latency, the recorded inputs of its start are held.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TreadmillLoop {
    /// The law.
    #[serde(flatten)]
    pub law: Treadmill,
    /// Age of the state that a command is computed from, s.
    pub latency: f64,
    /// The column of the place along the belt, m.
    pub x: String,
    /// The column of the place across the belt, m; read if the law has a gain for it.
    pub y: String,
    /// The column of the heading against the belt, rad.
    pub yaw: String,
    /// The belt's speed: a column, or a number in m/s.
    pub speed: TreadmillSpeed,
    /// The input that takes the forward velocity, m/s.
    pub u_v: String,
    /// The input that takes the yaw rate, rad/s.
    pub u_w: String,
}

/// Source of the belt's speed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum TreadmillSpeed {
    /// Always this, m/s.
    Constant(f64),
    /// A column of the recording, m/s.
    Column(String),
}

impl Default for TreadmillLoop {
    /// The columns of a generated log, and the mean latency of II-B.
    fn default() -> Self {
        Self {
            law: Treadmill::default(),
            latency: 0.01,
            x: "x".into(),
            y: "y".into(),
            yaw: "yaw".into(),
            speed: TreadmillSpeed::Column("belt_speed".into()),
            u_v: "u_v".into(),
            u_w: "u_w".into(),
        }
    }
}

impl Controller for TreadmillLoop {
    fn reads(&self) -> Vec<String> {
        let mut names = vec![self.x.clone(), self.yaw.clone()];
        if let TreadmillSpeed::Column(name) = &self.speed {
            names.push(name.clone());
        }
        if self.law.k_y != 0.0 {
            names.push(self.y.clone());
        }
        names
    }

    fn drives(&self) -> Vec<String> {
        vec![self.u_v.clone(), self.u_w.clone()]
    }

    fn validate(&self) -> Result<(), ParameterError> {
        self.law.validate()?;
        if let TreadmillSpeed::Constant(speed) = self.speed {
            check("speed", speed, true, "a column or a speed in m/s")?;
        }
        check("latency", self.latency, self.latency >= 0.0, "0 or a time in s")
    }

    fn start(&self) -> Box<dyn ControllerState> {
        let speed = match self.speed {
            TreadmillSpeed::Constant(speed) => Some(speed),
            TreadmillSpeed::Column(_) => None,
        };
        Box::new(TreadmillState { law: self.law, speed, sampling: Sampling::new(self.law.period, self.latency) })
    }
}

struct TreadmillState {
    law: Treadmill,
    speed: Option<f64>,
    sampling: Sampling<3>,
}

impl ControllerState for TreadmillState {
    fn control(&mut self, seconds: f64, columns: &[f64], inputs: &mut [f64]) {
        // In the order of `reads`.
        let y = if self.law.k_y != 0.0 { columns[columns.len() - 1] } else { 0.0 };
        if let Some(pose) = self.sampling.observe(seconds, [columns[0], y, columns[1]]) {
            let speed = self.speed.unwrap_or_else(|| columns[2]);
            inputs.copy_from_slice(&self.law.command(speed, pose));
        }
    }
}
