//! Options for the fusion of a joint: its data, and prior knowledge of noise and constants.

use crate::{
    Estimate, Loss, SignalError,
    error::{check, check_finite, check_stamps},
    fuse::Prior,
};

/// The most sensors that a joint may have.
pub(super) const MOST: usize = 16;

/// The readings of a sensor: a value a stamp (s).
#[derive(Debug, Clone, Copy)]
pub struct JointRecord<'a> {
    /// Increasing.
    pub times: &'a [f64],
    /// Finite.
    pub values: &'a [f64],
}

/// One recording of a joint.
#[derive(Debug, Clone)]
pub struct JointRun<'a> {
    /// A record a sensor, in their order; empty where a sensor was silent.
    pub records: Vec<JointRecord<'a>>,
    /// Instants at which the state is wanted, s by the clock of the records, increasing.
    pub at: &'a [f64],
}

/// Quantity that a sensor of a joint measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Its position.
    Position,
    /// Its rate.
    Rate,
}

/// A sensor of a joint; `u` is the unit of positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointSensor {
    /// Measured quantity.
    pub quantity: Quantity,
    /// Resolution: step between two neighbouring values, u or u/s; 0: none. The error of a step is uniform, and equal
    /// readings in a row share it.
    pub resolution: f64,
    /// Seconds before the stamp over which a reading is the mean.
    pub average: f64,
    /// Standard deviation of a reading, steps aside, u or u/s; `None`: estimated from the readings.
    pub noise: Option<f64>,
    /// Seconds by which readings are stamped late.
    pub delay: Prior<f64>,
    /// Bias of a reading (reading less true value), u or u/s.
    pub bias: Prior<f64>,
}

impl JointSensor {
    /// A sensor of which nothing is said.
    pub fn new(quantity: Quantity) -> Self {
        Self { quantity, resolution: 0.0, average: 0.0, noise: None, delay: 0.0.into(), bias: 0.0.into() }
    }
}

/// Options for the fusion of a joint's sensors.
#[derive(Debug, Clone, PartialEq)]
pub struct JointOptions {
    /// The sensors.
    pub sensors: Vec<JointSensor>,
    /// Density of the white noise that models the jerk, u/s^3/sqrt(Hz); `None`: estimated from the readings.
    pub jerk: Option<f64>,
    /// Loss of the residuals.
    pub loss: Loss,
    /// Deviations beyond which a reading is left out; 0: no gate.
    pub gate: f64,
    /// Measurements from which states are estimated.
    pub estimate: Estimate,
}

impl JointOptions {
    /// These sensors, and nothing said of them.
    pub fn new(sensors: Vec<JointSensor>) -> Self {
        Self { sensors, jerk: None, loss: Loss::default(), gate: 10.0, estimate: Estimate::Smoother }
    }

    pub(super) fn check(&self) -> Result<(), SignalError> {
        let count = self.sensors.len();
        check((1..=MOST).contains(&count), "the number of sensors of a joint", count as f64, "it must be 1 to 16")?;
        for sensor in &self.sensors {
            let JointSensor { resolution, average, noise, delay, bias, .. } = sensor;
            for (what, value) in [("the resolution of a sensor", *resolution), ("the window of a sensor", *average)] {
                check(value >= 0.0 && value.is_finite(), what, value, "it must be 0 (none) or positive, and finite")?;
            }
            for (what, prior) in [("a delay", delay), ("a bias", bias)] {
                check(prior.value.is_finite(), what, prior.value, "it is finite")?;
                let deviation = prior.deviation;
                check(
                    deviation >= 0.0,
                    what,
                    deviation,
                    "its deviation must be 0 (given), positive, or infinite (unknown)",
                )?;
            }
            positive("the noise of a sensor", *noise)?;
        }
        positive("the density of the jerk", self.jerk)?;
        check(self.gate >= 0.0, "the gate", self.gate, "it must be a number of deviations, or 0 for none")?;
        self.loss.check()?;
        let tells = |sensor: &JointSensor| sensor.quantity == Quantity::Position && sensor.bias.deviation.is_finite();
        if !self.sensors.iter().any(tells) {
            return Err(SignalError::NotFused {
                problem: "no sensor measures the position of the joint: name one with kind \"position\" whose bias is given",
            });
        }
        if self.sensors.iter().all(|sensor| sensor.delay.deviation.is_infinite()) {
            return Err(SignalError::NotFused {
                problem: "all delays are unknown, and a delay is estimated relative to another sensor: give the delay of one sensor",
            });
        }
        Ok(())
    }
}

fn positive(what: &'static str, value: Option<f64>) -> Result<(), SignalError> {
    match value {
        Some(value) => check(value > 0.0 && value.is_finite(), what, value, "it must be positive and finite"),
        None => Ok(()),
    }
}

impl JointRun<'_> {
    pub(super) fn check(&self, sensors: usize) -> Result<(), SignalError> {
        if self.records.len() != sensors {
            return Err(SignalError::Length {
                what: "the list of records",
                count: self.records.len(),
                expected: sensors,
            });
        }
        for JointRecord { times, values } in &self.records {
            if times.len() != values.len() {
                return Err(SignalError::Length { what: "a record", count: values.len(), expected: times.len() });
            }
            check_finite(times)?;
            check_stamps(times)?;
            check_finite(values)?;
        }
        check_finite(self.at)?;
        check_stamps(self.at)
    }
}
