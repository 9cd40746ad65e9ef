//! The joints of a recipe: their sensors in the form for fusion, and the report of the fusion.

use fleetfoot_data::{Progress, did_you_mean, nearest};
use fleetfoot_dataset::{Dataset, Error, Logs, estimated_clocks::Clocks};
use fleetfoot_recipe::{JointSection, Kind, Recipe, SensorKind, SensorSection, Tunable};
use fleetfoot_signal::{
    fuse::Prior,
    joint::{FusedJoint, JointOptions, JointRecord, JointRun, JointSensor, JointStates, Quantity, fuse_joint},
};

use super::{
    super::{
        CorrelationReport, JointReport, JointSensorReport, Places,
        channel::{unwrapped, wrapped},
    },
    rows::{Layout, LogRows},
    sensors::{channels, loss, numbers, refused},
};

/// The correlation of their errors beyond which two sensors are one.
const ONE: f64 = 0.35;

/// Correlation above which a note names it.
const TOLD: f64 = 0.15;

/// Deviations by which a correlation differs from none.
const SURE: f64 = 6.0;

/// Ratio of a sensor's noise to that about its separate curve above which a note says that sensors contradict each
/// other.
const CONTRADICTED: f64 = 3.0;

/// A joint and its sensors, checked.
pub(super) struct JointPlan {
    pub(super) name: String,
    pub(super) angle: bool,
    pub(super) unit: Option<String>,
    correlated: bool,
    /// Names, and the channel of each.
    sensors: Vec<(String, String)>,
    options: JointOptions,
}

/// The joints of a recipe.
pub(super) fn plans(recipe: &Recipe) -> Result<Vec<JointPlan>, Error> {
    let of_joints = || recipe.sensor.iter().filter(|(_, sensor)| sensor.kind.is_of_joint()).map(|(name, _)| name);
    let mut taken: Vec<&String> = Vec::new();
    let mut plans = Vec::new();
    for (name, section) in &recipe.joint {
        let names: Vec<&String> = match section.sensors.is_empty() && recipe.joint.len() == 1 {
            true => of_joints().collect(),
            false => section.sensors.iter().collect(),
        };
        if names.is_empty() {
            return Err(Error::missing(format!(
                "[joint.{name}]: name its sensors, sensors = [\"encoder\"], and a [sensor.encoder] of kind \"position\""
            )));
        }
        for sensor in &names {
            let Some(section) = recipe.sensor.get(*sensor).filter(|section| section.kind.is_of_joint()) else {
                let mend = did_you_mean(&nearest(sensor, of_joints().map(String::as_str)));
                return Err(Error::unknown(
                    sensor.as_str(),
                    format!("[joint.{name}] sensors: there is no [sensor.{sensor}] of a position or a rate{mend}"),
                ));
            };
            if section.channels.len() != channels(section.kind) {
                let given = format!("channels has {}", section.channels.len());
                return Err(refused(sensor, &given, "a sensor of a joint has 1 channel; write one"));
            }
            if taken.contains(sensor) {
                return Err(refused(sensor, "joint", "a sensor belongs to one joint; remove it from the other"));
            }
            taken.push(sensor);
        }
        plans.push(JointPlan::new(recipe, name, section, &names)?);
    }
    match of_joints().find(|name| !taken.contains(name)) {
        None => Ok(plans),
        Some(name) => Err(Error::missing(format!(
            "[sensor.{name}] belongs to no joint: add it to one, [joint.NAME] sensors = [\"{name}\"]"
        ))),
    }
}

impl JointPlan {
    fn new(recipe: &Recipe, name: &str, section: &JointSection, names: &[&String]) -> Result<Self, Error> {
        let place = format!("[joint.{name}]");
        let sensors: Vec<JointSensor> =
            names.iter().map(|name| sensor(name, &recipe.sensor[*name])).collect::<Result<_, _>>()?;
        let mut options = JointOptions::new(sensors);
        options.jerk = section.jerk;
        options.loss = loss(&place, section.huber, section.student)?;
        options.gate = section.gate.unwrap_or(options.gate);
        options.estimate = section.estimate.map_or(options.estimate, Into::into);
        let channel = |name: &&String| ((*name).clone(), recipe.sensor[*name].channels[0].clone());
        Ok(Self {
            name: name.to_owned(),
            angle: section.kind == Some(Kind::Angle),
            unit: section.unit.clone(),
            correlated: section.correlated.unwrap_or(false),
            sensors: names.iter().map(channel).collect(),
            options,
        })
    }

    /// The channel whose rows are written if there is no body: the first position.
    pub(super) fn base(&self) -> Option<&String> {
        let is_position = |at: &usize| self.options.sensors[*at].quantity == Quantity::Position;
        (0..self.sensors.len()).find(is_position).map(|at| &self.sensors[at].1)
    }
}

fn sensor(name: &str, section: &SensorSection) -> Result<JointSensor, Error> {
    if section.lever.is_some() || section.mounting.is_some() || section.walk.is_some() {
        return Err(refused(name, "lever, mounting, walk", "only sensors of a body have these; remove them"));
    }
    let prior = |what: &str, value_or_word: &Option<Tunable>| match value_or_word {
        None => Ok(Prior::from(0.0)),
        Some(Tunable::Number(value)) => Ok((*value).into()),
        Some(Tunable::Word(word)) if word == "auto" => Ok(Prior { value: 0.0, deviation: f64::INFINITY }),
        Some(Tunable::Word(word)) => Err(refused(name, &format!("{what} = {word:?}"), "write a number, or \"auto\"")),
    };
    let mut joint_sensor = JointSensor::new(match section.kind {
        SensorKind::Rate => Quantity::Rate,
        _ => Quantity::Position,
    });
    joint_sensor.resolution = super::sensors::seconds(name, "resolution", section.resolution)?;
    joint_sensor.average = super::sensors::seconds(name, "average", section.average)?;
    joint_sensor.delay = prior("delay", &section.delay)?;
    joint_sensor.bias = prior("bias", &section.bias)?;
    if let Some(noise) = &section.noise {
        let [noise] = numbers(name, "noise", noise)?;
        joint_sensor.noise = Some(noise);
    }
    Ok(joint_sensor)
}

/// A joint whose sensors are fused.
pub(super) struct Joint {
    pub(super) plan: JointPlan,
    pub(super) fused: FusedJoint,
    /// Stamps of each sensor, log by log.
    records: Vec<Vec<LogRows>>,
}

/// Inputs of the joints' logs.
#[derive(Clone, Copy)]
pub(super) struct Opening<'a> {
    pub(super) recipe: &'a Recipe,
    pub(super) logs: &'a Logs,
    pub(super) clocks: &'a Clocks,
    pub(super) dejitter: bool,
    pub(super) progress: &'a dyn Progress,
}

impl Joint {
    /// Reads the sensors of a joint, each at its own stamps, and fuses them at the stamps of `rows`.
    pub(super) fn new(
        plan: JointPlan,
        rows: &[LogRows],
        opening: Opening<'_>,
        notes: &mut Vec<String>,
    ) -> Result<Self, Error> {
        let records = (0..plan.sensors.len()).map(|sensor| plan.records(sensor, rows, opening, notes));
        let records: Vec<Vec<LogRows>> = records.collect::<Result<_, _>>()?;
        let runs: Vec<JointRun<'_>> = (0..rows.len())
            .map(|at| JointRun { records: records.iter().map(|logs| record(&logs[at])).collect(), at: &rows[at].times })
            .collect();
        let channel = format!("[joint.{}]", plan.name);
        let episode = if let [rows] = rows { rows.log.display().to_string() } else { "all logs".into() };
        let error = |source| Error::Signal { episode, channel, source };
        let fused = fuse_joint(&runs, &plan.options).map_err(error)?;
        plan.judge(&fused, notes)?;
        Ok(Self { plan, fused, records })
    }

    /// Span of a log, in seconds, in which positions measure the joint.
    pub(super) fn span(&self, at: usize) -> [f64; 2] {
        let positions = self.records.iter().zip(&self.plan.options.sensors);
        let positions =
            positions.filter(|(_, sensor)| sensor.quantity == Quantity::Position).map(|(logs, _)| &logs[at]);
        let (first, last) = (|rows: &LogRows| rows.times.first().copied(), |rows: &LogRows| rows.times.last().copied());
        [
            positions.clone().filter_map(first).fold(f64::INFINITY, f64::min),
            positions.filter_map(last).fold(f64::NEG_INFINITY, f64::max),
        ]
    }

    /// The first row of a log whose state is known: a filter needs some readings to begin.
    pub(super) fn begun(&self, at: usize) -> usize {
        let known = |value: &f64| !value.is_nan();
        self.fused.runs[at].derivatives[0].iter().position(known).unwrap_or(0)
    }

    /// Values and deviations of the rows of a log, in the order of the columns.
    pub(super) fn values(&self, at: usize, rows: &[usize]) -> Vec<Vec<f64>> {
        let JointStates { derivatives, deviations, .. } = &self.fused.runs[at];
        let pick = |(k, of): (usize, &Vec<f64>)| {
            let value = |&row: &usize| if self.plan.angle && k == 0 { wrapped(of[row]) } else { of[row] };
            rows.iter().map(value).collect()
        };
        derivatives.iter().chain(deviations).enumerate().map(pick).collect()
    }

    pub(super) fn report(&self) -> JointReport {
        let (plan, fused) = (&self.plan, &self.fused);
        let sensor = |(at, estimate): (usize, &fleetfoot_signal::joint::JointSensorEstimate)| {
            let logs = fused.runs.iter().zip(&self.records[at]);
            JointSensorReport {
                sensor: plan.sensors[at].0.clone(),
                kind: match plan.options.sensors[at].quantity {
                    Quantity::Position => SensorKind::Position,
                    Quantity::Rate => SensorKind::Rate,
                },
                readings: estimate.readings,
                noise: estimate.noise,
                noise_fitted: plan.options.sensors[at].noise.is_none(),
                delay: estimate.delay.value,
                delay_deviation: estimate.delay.deviation,
                bias: estimate.bias.value,
                bias_deviation: estimate.bias.deviation,
                rejected: logs.map(|(run, rows)| Places::of(&run.rejected[at], &rows.times)).collect(),
            }
        };
        JointReport {
            joint: plan.name.clone(),
            sensors: fused.sensors.iter().enumerate().map(sensor).collect(),
            jerk: fused.jerk,
            jerk_fitted: plan.options.jerk.is_none(),
            correlations: plan.correlations(fused),
            smoothed: fused.smoothed,
            converged: fused.converged,
        }
    }
}

fn record(rows: &LogRows) -> JointRecord<'_> {
    JointRecord { times: &rows.times, values: &rows.columns[0] }
}

impl JointPlan {
    /// The readings of a sensor, log by log in the order of `rows`, in seconds after the first row of each. Empty if a
    /// log lacks it.
    fn records(
        &self,
        sensor: usize,
        rows: &[LogRows],
        opening: Opening<'_>,
        notes: &mut Vec<String>,
    ) -> Result<Vec<LogRows>, Error> {
        let Opening { recipe, logs, clocks, dejitter, progress } = opening;
        let (name, channel) = &self.sensors[sensor];
        let clocks = Clocks { topics: clocks.topics.clone(), ..Clocks::default() };
        let seen = Dataset::for_columns_by(recipe, std::slice::from_ref(channel), clocks, logs, progress)?;
        let mut rows_of_logs = LogRows::all(&seen, Layout { needed: 1, vectors: 0, skipped: 0 })?;
        notes.extend(seen.notes().iter().filter(|note| !notes.contains(note)).cloned().collect::<Vec<_>>());
        let mut records = Vec::new();
        for rows_of_log in rows {
            let place = rows_of_logs.iter().position(|other| other.log == rows_of_log.log);
            let mut record = match place {
                Some(at) => rows_of_logs.swap_remove(at),
                None => {
                    notes.push(format!(
                        "{}: [sensor.{name}] of [joint.{}] has no readings",
                        rows_of_log.log.display(),
                        self.name
                    ));
                    LogRows::silent(rows_of_log)
                }
            };
            if record.missing > 0 {
                notes.push(format!(
                    "{}: {} readings of [sensor.{name}] have missing values and are left out",
                    rows_of_log.log.display(),
                    record.missing
                ));
            }
            if dejitter {
                record.even_out()?;
            }
            let apart = (record.epoch - rows_of_log.epoch) as f64 * 1e-9;
            record.times.iter_mut().for_each(|time| *time += apart);
            if self.angle && self.options.sensors[sensor].quantity == Quantity::Position {
                record.columns[0] = unwrapped(&record.columns[0]);
            }
            records.push(record);
        }
        Ok(records)
    }

    fn correlations(&self, fused: &FusedJoint) -> Vec<CorrelationReport> {
        let name = |at: usize| self.sensors[at].0.clone();
        let of = |pair: &fleetfoot_signal::joint::Correlation| CorrelationReport {
            sensors: [name(pair.first), name(pair.second)],
            correlation: pair.correlation,
            readings: pair.readings,
        };
        fused.correlations.iter().map(of).collect()
    }

    /// Refuses two sensors that are one, and notes doubtful results.
    fn judge(&self, fused: &FusedJoint, notes: &mut Vec<String>) -> Result<(), Error> {
        let place = format!("[joint.{}]", self.name);
        for CorrelationReport { sensors: [first, second], correlation, readings } in self.correlations(fused) {
            let (size, sure) = (correlation.abs(), SURE / (readings as f64).sqrt());
            let note = format!(
                "{place}: errors of `{first}` and `{second}` are correlated ({correlation:.2} over {readings} pairs)"
            );
            if size > ONE.max(sure) && !self.correlated {
                return Err(Error::value(format!(
                    "{note}: one was computed from the other, or both from one sensor, so they are not independent; leave one out, or write correlated = true"
                )));
            }
            if size > TOLD.max(sure) {
                notes.push(format!("{note}: deviations are too small if one was computed from the other"));
            }
        }
        for ((name, _), estimate) in self.sensors.iter().zip(&fused.sensors) {
            if estimate.noise > CONTRADICTED * estimate.alone {
                notes.push(format!(
                    "{place}: `{name}` is {:.1} times as far from the fused motion as from its own spline, so the sensors contradict each other: check units, signs, clocks, delays and biases",
                    estimate.noise / estimate.alone
                ));
            }
        }
        if !fused.converged {
            notes.push(format!("{place}: the fusion did not converge: give noise, jerk or delay, or longer records"));
        }
        Ok(())
    }
}
