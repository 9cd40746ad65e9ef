//! A positioning stage: a carriage on a rail with dry friction, driven by a motor, that makes strokes of random lengths.
//!
//! `m q'' = g u - c q' - F tanh(q' / v_s) - o`, with the masses and frictions that Janot, Gautier and Brunot identified of their electro-mechanical positioning system ("Data set and
//! reference models of EMPS", Nonlinear System Identification Benchmarks 2019). Position and speed are known at the rows; the voltage is held from one row to the next.

use std::f64::consts::TAU;

use fleetfoot_data::Column;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::parameter_error::{ParameterError, finite, not_negative, positive};
use crate::sensor::{Clock, stream};
use crate::{End, Excitation, Kind, Reading, Regressors, Run, Scenario, Sink, SinkError, Stamps, Topic};

/// Names and units of the columns.
const COLUMNS: [(&str, &str); 4] = [("q", "m"), ("qd", "m/s"), ("u", "V"), ("friction", "N")];
/// When runs begin, ns.
const EPOCH: i64 = 1_700_000_000_000_000_000;
/// Steps of the integrator between rows.
const SUBSTEPS: u32 = 50;

/// A positioning stage with dry friction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Stage {
    /// Seconds between rows, which is the period of its controller as well.
    pub row_period: f64,
    /// Moving mass, kg.
    pub mass: f64,
    /// Viscous friction, N s/m.
    pub viscous: f64,
    /// Dry friction, N.
    pub dry: f64,
    /// Speed at which the dry friction reaches three quarters of its value, m/s.
    pub creep: f64,
    /// A force that is always there, N.
    pub offset: f64,
    /// Force of the motor for a volt, N/V.
    pub gain: f64,
    /// Voltage of its amplifier at most, V.
    pub voltage: f64,
    /// Strokes begin and end at most as far from the middle, m.
    pub stroke: f64,
    /// Shortest and longest stroke, s.
    pub durations: [f64; 2],
    /// Natural frequency of the controlled carriage, Hz.
    pub bandwidth: f64,
    /// Resolution of the encoder that measures its position, m.
    pub resolution: f64,
    /// Standard deviation of noise on the measured speed, m/s.
    pub speed_noise: f64,
    /// Voltage in place of the controller's and its strokes; `none`: strokes.
    #[serde(skip_serializing_if = "is_none")]
    pub excitation: Excitation,
}

fn is_none(excitation: &Excitation) -> bool {
    *excitation == Excitation::None
}

impl Default for Stage {
    fn default() -> Self {
        Self {
            row_period: 0.005,
            mass: 95.1,
            viscous: 203.5,
            dry: 20.39,
            creep: 0.001,
            offset: -3.16,
            gain: 35.15,
            voltage: 10.0,
            stroke: 0.12,
            durations: [0.6, 1.6],
            bandwidth: 2.5,
            resolution: 1e-6,
            speed_noise: 3e-4,
            excitation: Excitation::None,
        }
    }
}

impl Stage {
    /// Checks the parameters.
    ///
    /// # Errors
    /// The first that is not allowed.
    pub fn validate(&self) -> Result<(), ParameterError> {
        let numbers = [
            ("row_period", self.row_period),
            ("mass", self.mass),
            ("creep", self.creep),
            ("gain", self.gain),
            ("voltage", self.voltage),
            ("stroke", self.stroke),
            ("durations", self.durations[0]),
            ("durations", self.durations[1] - self.durations[0]),
            ("bandwidth", self.bandwidth),
            ("resolution", self.resolution),
        ];
        numbers.iter().try_for_each(|&(name, value)| positive(name, value))?;
        not_negative("speed_noise", self.speed_noise)?;
        self.excitation.validate(self.row_period).map_err(|error| error.within("excitation"))?;
        // A stroke that is over within a row would never be.
        if self.durations[0] < self.row_period {
            return Err(ParameterError::new("durations", self.durations[0], "at least the seconds between rows"));
        }
        for (name, value) in [("viscous", self.viscous), ("dry", self.dry), ("offset", self.offset)] {
            finite(name, value)?;
        }
        Ok(())
    }

    /// Dry friction at a speed, N.
    fn friction(&self, speed: f64) -> f64 {
        self.dry * (speed / self.creep).tanh()
    }

    /// Position and speed a row later, the voltage held.
    fn advance(&self, [mut q, mut qd]: [f64; 2], u: f64) -> [f64; 2] {
        let h = self.row_period / f64::from(SUBSTEPS);
        let rate = |qd: f64| (self.gain * u - self.viscous * qd - self.offset - self.friction(qd)) / self.mass;
        for _ in 0..SUBSTEPS {
            let [a, b] = [rate(qd), rate(qd + 0.5 * h * rate(qd))];
            let c = rate(qd + 0.5 * h * b);
            let d = rate(qd + h * c);
            let mean = (a + 2.0 * b + 2.0 * c + d) / 6.0;
            (q, qd) = (q + h * (qd + 0.5 * h * mean), qd + h * mean);
        }
        [q, qd]
    }
}

/// Strokes from one place to the next, without a jerk at their ends.
struct Strokes<'a> {
    stage: &'a Stage,
    random: rand_pcg::Pcg64,
    begun: f64,
    duration: f64,
    places: [f64; 2],
}

impl<'a> Strokes<'a> {
    fn new(stage: &'a Stage, seed: u64) -> Self {
        Self { stage, random: stream(seed, "strokes"), begun: 0.0, duration: 0.0, places: [0.0; 2] }
    }

    /// Reference position and speed of the carriage at a time; times ascend.
    fn at(&mut self, seconds: f64) -> [f64; 2] {
        while seconds >= self.begun + self.duration {
            let Stage { stroke, durations: [shortest, longest], .. } = *self.stage;
            self.begun += self.duration;
            self.places = [self.places[1], self.random.random_range(-stroke..=stroke)];
            self.duration = self.random.random_range(shortest..=longest);
        }
        let s = (seconds - self.begun) / self.duration;
        let way = self.places[1] - self.places[0];
        let speed = 30.0 * s * s * (1.0 - s) * (1.0 - s) / self.duration;
        [self.places[0] + way * s * s * s * (10.0 - 15.0 * s + 6.0 * s * s), way * speed]
    }
}

/// Runs of a stage.
#[derive(Debug, Clone, PartialEq)]
pub struct StageScenario {
    stage: Stage,
}

impl StageScenario {
    /// Runs with these parameters.
    ///
    /// # Errors
    /// Those of [`Stage::validate`].
    pub fn new(stage: &Stage) -> Result<Self, ParameterError> {
        stage.validate()?;
        Ok(Self { stage: stage.clone() })
    }
}

impl Scenario for StageScenario {
    fn topics(&self) -> Vec<Topic> {
        let topic = |name: &str, kind| Topic { name: name.to_owned(), kind, frame: String::new() };
        vec![
            topic("/stage/joint_states", Kind::Joints(vec!["carriage".to_owned()])),
            topic("/stage/voltage", Kind::Number),
            topic("/truth/joint_states", Kind::Joints(vec!["carriage".to_owned()])),
        ]
    }

    fn columns(&self) -> Vec<Column> {
        COLUMNS.iter().map(|&(name, unit)| Column { unit: Some(unit.to_owned()), ..Column::float(name) }).collect()
    }

    fn regressors(&self) -> Regressors {
        Regressors { states: 2, inputs: 1 }
    }

    fn row_period(&self) -> f64 {
        self.stage.row_period
    }

    fn run(&self, run: Run, sink: &mut dyn Sink) -> Result<End, SinkError> {
        let stage = &self.stage;
        let clock = Clock::perfect(EPOCH);
        let rows = (run.seconds / stage.row_period).round() as u64;
        let natural = TAU * stage.bandwidth;
        let mut strokes = Strokes::new(stage, run.seed);
        let mut noise = stream(run.seed, "speed");
        let excited = !is_none(&stage.excitation);
        let mut excitation = stage.excitation.signal(stage.row_period, stream(run.seed, "excitation"));
        let mut state = [0.0; 2];
        for index in 0..rows {
            let seconds = index as f64 * stage.row_period;
            let [q, qd] = state;
            let [to, speed] = strokes.at(seconds);
            // Critically damped, the drag of the reference made up for.
            let wanted = natural * natural * (to - q) + 2.0 * natural * (speed - qd);
            let strokes = (stage.mass * wanted + stage.viscous * speed) / stage.gain;
            let u = if excited { excitation.next(qd) } else { strokes }.clamp(-stage.voltage, stage.voltage);
            let stamp = clock.read((seconds * 1e9).round() as i64);
            let stamps = Stamps { header: stamp, log: stamp };
            let shake: f64 = StandardNormal.sample(&mut noise);
            let measured = [(q / stage.resolution).round() * stage.resolution, qd + stage.speed_noise * shake];
            let joint = |[q, qd]: [f64; 2]| ([q], [qd], [stage.gain * u]);
            for (topic, (position, velocity, effort)) in [(0, joint(measured)), (2, joint(state))] {
                let reading = Reading::Joints { position: &position, velocity: &velocity, effort: &effort };
                sink.message(topic, stamps, reading)?;
            }
            sink.message(1, stamps, Reading::Number(u))?;
            sink.row(stamp, &[q, qd, u, stage.friction(qd)])?;
            state = stage.advance(state, u);
        }
        Ok(End::Complete)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without friction the voltage and the mass alone say how fast the carriage is; with dry friction alone it loses `F/m` a second.
    #[test]
    fn speeds_match_closed_form() {
        let mut stage = Stage { viscous: 0.0, dry: 0.0, offset: 0.0, ..Stage::default() };
        let seconds = |rows: usize| rows as f64 * 0.005;
        let after =
            |stage: &Stage, start: [f64; 2], u: f64, rows: usize| (0..rows).fold(start, |s, _| stage.advance(s, u));
        let [q, qd] = after(&stage, [0.0; 2], 2.0, 100);
        let a = 2.0 * stage.gain / stage.mass;
        assert!((qd - a * seconds(100)).abs() < 1e-12 && (q - 0.5 * a * seconds(100).powi(2)).abs() < 1e-12);
        stage.dry = 20.39;
        let [_, qd] = after(&stage, [0.0, 0.5], 0.0, 100);
        assert!((qd - (0.5 - stage.dry / stage.mass * seconds(100))).abs() < 1e-9, "{qd}");
        stage.viscous = 203.5;
        stage.dry = 0.0;
        let [_, qd] = after(&stage, [0.0, 0.5], 0.0, 100);
        assert!((qd - 0.5 * (-stage.viscous / stage.mass * seconds(100)).exp()).abs() < 1e-12, "{qd}");
    }

    #[test]
    fn strokes_stay_within_bounds() {
        #[derive(Default)]
        struct Rows(Vec<Vec<f64>>);
        impl Sink for Rows {
            fn row(&mut self, _: i64, values: &[f64]) -> Result<(), SinkError> {
                self.0.push(values.to_vec());
                Ok(())
            }
        }
        let scenario = StageScenario::new(&Stage::default()).unwrap();
        let mut rows = Rows::default();
        assert_eq!(scenario.run(Run { seconds: 20.0, seed: 3 }, &mut rows).unwrap(), End::Complete);
        assert_eq!(rows.0.len(), 4_000);
        assert!(rows.0.iter().all(|row| row[0].abs() < 0.14 && row[2].abs() <= 10.0));
        // It moves to both sides, and rests between strokes.
        let moving = |sign: f64| rows.0.iter().filter(|row| sign * row[1] > 0.02).count();
        assert!(moving(1.0) > 500 && moving(-1.0) > 500);
        let error = StageScenario::new(&Stage { mass: 0.0, ..Stage::default() }).unwrap_err();
        assert!(error.to_string().contains("mass"), "{error}");
        let short = Stage { durations: [1e-300, 1.0], ..Stage::default() };
        assert!(StageScenario::new(&short).unwrap_err().to_string().contains("durations"));
    }
}
