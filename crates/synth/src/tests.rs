//! A small scenario through the whole pipeline: bytes, metadata, reading back, and refusals.

mod regulated;
mod robots;

use std::{f64::consts::PI, fs, path::Path, sync::Mutex};

use fleetfoot_data::{Column, Halo, Silent, Source, with_threads};
use fleetfoot_log::{Recording, Selection, open};
use fleetfoot_recipe::Recipe;
use fleetfoot_sim::{
    End, Kind as Reads, ParameterError, Reading, Regressors, Run, Scenario, Sink, SinkError, Stamps, Topic,
    excitation::Axis, parameter_error::positive,
};
use serde::{Deserialize, Serialize};

use super::{robot::Kind, *};

/// A driven pendulum that faults beyond an angle: `angle' = rate`, `rate' = -gravity/length sin(angle) - damping rate + torque`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Pendulum {
    length: f64,
    damping: f64,
    fault_angle: f64,
    drive: Drive,
    shape: Shape,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Drive {
    amplitude: f64,
    frequency: f64,
}

/// As the excitations of `sim` are written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum Shape {
    Sine,
    Held {
        #[serde(default = "one")]
        seconds: f64,
    },
}

fn one() -> f64 {
    1.0
}

impl Default for Pendulum {
    fn default() -> Self {
        Self { length: 0.5, damping: 0.1, fault_angle: 10.0, drive: Drive::default(), shape: Shape::Sine }
    }
}

impl Default for Drive {
    fn default() -> Self {
        Self { amplitude: 3.0, frequency: 0.7 }
    }
}

const STEP: f64 = 0.005;
/// The clock of the log.
const EPOCH: i64 = 1_700_000_000_000_000_000;

static PENDULUM: Kind<Pendulum> = Kind {
    name: "pendulum",
    speed: Some("drive.frequency"),
    excite: Some(|pendulum, kind| {
        pendulum.shape = match kind {
            "sine" => Shape::Sine,
            "held" => Shape::Held { seconds: 0.5 },
            _ => return Err(ParameterError::new("shape", kind, "sine or held")),
        };
        Ok(())
    }),
    spread: &[("angle", Axis { low: -PI, high: PI, bins: 8 })],
    tables: false,
    recipe: recipes::RecipeParts {
        about: "A driven pendulum.",
        fields: &[
            ("angle", "/truth/joint.position[hinge]"),
            ("rate", "/truth/joint.velocity[hinge]"),
            ("torque", "/truth/torque.data"),
        ],
        aliases: &[],
        states: &[("angle", recipes::Details::KnownAngle("rate")), ("rate", recipes::Details::Fitted)],
        inputs: &["torque"],
        base: "/truth/joint",
        stamp: "log",
        partition_on: &[],
        sparse: "",
    },
    seconds: 60.0,
    scenario: |pendulum| {
        positive("length", pendulum.length)?;
        Ok(Box::new(pendulum))
    },
};

impl Pendulum {
    fn torque(&self, time: f64, phase: f64) -> f64 {
        let Drive { amplitude, frequency } = self.drive;
        match self.shape {
            Shape::Sine => amplitude * (2.0 * PI * frequency * time + phase).sin(),
            Shape::Held { seconds } => amplitude * ((time / seconds).floor() * 2.4 + phase).sin(),
        }
    }
}

impl Scenario for Pendulum {
    fn topics(&self) -> Vec<Topic> {
        let topic = |name: &str, kind| Topic { name: name.into(), kind, frame: "hinge".into() };
        let hinge = || vec!["hinge".to_owned()];
        let imu = Reads::Imu { angular_velocity_deviation: 0.1, linear_acceleration_deviation: 0.2 };
        vec![
            topic("/joint_states", Reads::Joints(hinge())),
            topic("/imu/data", imu),
            topic("/mocap/pose", Reads::Pose),
            topic("/odom", Reads::Odometry { child_frame: "bob".into() }),
            topic("/cmd_vel", Reads::Twist),
            topic("/force", Reads::Vector),
            topic("/swinging", Reads::Flag),
            topic("/pair", Reads::Numbers(vec!["a".into(), "b".into()])),
            topic("/truth/joint", Reads::Joints(hinge())),
            topic("/truth/torque", Reads::Number),
        ]
    }

    fn columns(&self) -> Vec<Column> {
        let column = |name: &str, unit: &str| Column { unit: Some(unit.into()), ..Column::float(name) };
        vec![column("angle", "rad"), column("rate", "rad/s"), column("torque", "1/s^2")]
    }

    fn regressors(&self) -> Regressors {
        Regressors { states: 2, inputs: 1 }
    }

    fn row_period(&self) -> f64 {
        STEP
    }

    fn run(&self, run: Run, sink: &mut dyn Sink) -> Result<End, SinkError> {
        let phase = (run.seed % 1000) as f64;
        let (mut angle, mut rate) = (0.1, 0.0);
        for step in 0..(run.seconds / STEP).round() as i64 {
            let (time, torque) = (step as f64 * STEP, self.torque(step as f64 * STEP, phase));
            let header = EPOCH + step * 5_000_000;
            let stamps = Stamps { header, log: header + 1_000 };
            let joint = Reading::Joints { position: &[angle], velocity: &[rate], effort: &[] };
            let (position, orientation) =
                ([angle.sin(), 0.0, -angle.cos()].into(), glam::DQuat::from_rotation_y(angle));
            let velocity = [0.0, rate, 0.0].into();
            let linear = [rate * self.length, 0.0, 0.0].into();
            sink.message(0, stamps, joint)?;
            sink.message(1, stamps, Reading::Imu { angular_velocity: velocity, linear_acceleration: linear })?;
            sink.message(2, stamps, Reading::Pose { position, orientation })?;
            let odometry =
                Reading::Odometry { position, orientation, linear_velocity: linear, angular_velocity: velocity };
            sink.message(3, stamps, odometry)?;
            sink.message(4, stamps, Reading::Twist { linear, angular: velocity })?;
            sink.message(5, stamps, Reading::Vector([torque, 0.0, time].into()))?;
            sink.message(6, stamps, Reading::Flag(rate > 0.0))?;
            sink.message(7, stamps, Reading::Numbers(&[time, torque]))?;
            sink.message(8, stamps, joint)?;
            sink.message(9, stamps, Reading::Number(torque))?;
            sink.row(header, &[angle, rate, torque])?;
            if f64::abs(angle) > self.fault_angle {
                return Ok(End::Fault { seconds: time, reason: "the pendulum went over".into() });
            }
            rate += STEP * (-9.81 / self.length * angle.sin() - self.damping * rate + torque);
            angle += STEP * rate;
        }
        Ok(End::Complete)
    }
}

fn world() -> World {
    World::default_of(&PENDULUM).unwrap()
}

fn job(folder: &Path) -> Job {
    Job { runs: 3, seconds: 6.0, ..Job::new(world(), folder) }
}

/// The files of a job, by name.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), fs::read(&path).unwrap()))
        .collect();
    files.sort();
    files
}

/// Files that a job writes.
fn written(change: impl FnOnce(&mut Job)) -> Vec<(String, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let mut job = job(folder.path());
    change(&mut job);
    generate(&job, &Silent).unwrap();
    files(folder.path())
}

/// Keeps the rows.
#[derive(Default)]
struct Rows(Vec<(i64, Vec<f64>)>);

impl Sink for Rows {
    fn row(&mut self, stamp: i64, values: &[f64]) -> Result<(), SinkError> {
        self.0.push((stamp, values.to_vec()));
        Ok(())
    }
}

fn truth(world: &World, run: u64, seconds: f64) -> Rows {
    let mut rows = Rows::default();
    world.scenario().unwrap().run(Run { seconds, seed: run_seed(1, run) }, &mut rows).unwrap();
    rows
}

fn columns(recording: &Recording, columns: &[&str]) -> Vec<Vec<f64>> {
    let block = recording.read(0, 0..recording.episodes()[0].rows, Halo::default()).unwrap();
    columns.iter().map(|name| block.core(recording.column_index(name).unwrap()).to_vec()).collect()
}

#[test]
fn bytes_depend_on_seed_only() {
    for format in [Format::Mcap, Format::Parquet] {
        let on = |threads| with_threads(threads, || written(|job| job.format = format));
        let one = on(1);
        let names: Vec<&str> = one.iter().map(|(name, _)| name.as_str()).collect();
        let extension = format.extension();
        assert_eq!(names[0], format!("pendulum_00.{extension}"));
        assert_eq!(names[3], "robot.toml");
        assert!(one == on(2) && one == on(7));
        assert!(one[0].1 != one[1].1, "runs differ");
        let other = written(|job| (job.format, job.seed) = (format, 2));
        assert!(one[0].1 != other[0].1, "seeds differ");
    }
}

#[test]
fn run_does_not_depend_on_run_count() {
    let many = written(|job| job.runs = 5);
    let few = written(|job| job.runs = 2);
    assert!(many[1] == few[1]);
    let late = written(|job| (job.first_run, job.runs) = (3, 1));
    assert_eq!(late[0].0, "pendulum_03.mcap");
    assert!(late[0] == many[3]);
}

#[test]
fn messages_and_rows_hold_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let rows = truth(&world(), 1, 6.0).0;
    let expected: Vec<Vec<f64>> = (0..3).map(|j| rows.iter().map(|row| row.1[j]).collect()).collect();
    generate(&job(&folder.path().join("mcap")), &Silent).unwrap();
    let fields = ["/truth/joint.position[hinge]", "/truth/joint.velocity[hinge]", "/truth/torque.data"];
    let mut selection = Selection::new(fields);
    selection.join.base = Some(fleetfoot_log::Base::Channel("/truth/joint".into()));
    let log = open(&[folder.path().join("mcap/pendulum_01.mcap")], &selection).unwrap();
    assert!(columns(&log, &fields) == expected);

    generate(&Job { format: Format::Parquet, ..job(&folder.path().join("parquet")) }, &Silent).unwrap();
    let table = folder.path().join("parquet/pendulum_01.parquet");
    let info = fleetfoot_log::inspect(&table).unwrap();
    assert_eq!(info.columns[2].unit.as_deref(), Some("rad/s"));
    let table = open(&[table], &Selection::new(["angle", "rate", "torque"])).unwrap();
    assert!(columns(&table, &["angle", "rate", "torque"]) == expected);
}

#[test]
fn recipe_fits_the_generated_logs() {
    for format in [Format::Mcap, Format::Parquet] {
        let folder = tempfile::tempdir().unwrap();
        let made = generate(&Job { format, ..job(folder.path()) }, &Silent).unwrap();
        let recipe = Recipe::read(&made.recipe).unwrap();
        let paths = fleetfoot_log::paths([folder.path()]).unwrap();
        assert_eq!(paths.len(), 3);
        let fitted =
            fleetfoot_fit::fit::<fleetfoot_fit::Pwa>(&recipe, &fleetfoot_fit::FitRequest::default(), &paths, &Silent)
                .unwrap();
        assert_eq!(fitted.report.identification.targets, ["d(rate)/dt"]);
        assert!(fitted.report.identification.candidates[1].over_null[0] < 0.5);
    }
}

#[test]
fn excitations_are_compared_by_determinants() {
    let folder = tempfile::tempdir().unwrap();
    let report = |name: &str, settings: &[(&str, &str)]| {
        let mut job = job(&folder.path().join(name));
        settings.iter().for_each(|(key, value)| job.world.set(key, value).unwrap());
        generate(&job, &Silent).unwrap()
    };
    let weak = report("weak", &[("drive.amplitude", "0.3")]);
    let strong = report("strong", &[]);
    assert_eq!(strong.excitation.regressors, ["cos(angle)", "sin(angle)", "rate", "torque"]);
    assert!(strong.excitation.log_determinant > weak.excitation.log_determinant + 3.0);
    // Small swings stay in the two bins around the bottom.
    let spreads = [&weak, &strong].map(|made| made.excitation.nonuniformity);
    assert!(spreads[0] > spreads[1] + 0.1 && (0.0..=1.0).contains(&spreads[1]), "{spreads:?}");
    let none = report("none", &[("drive.amplitude", "0")]);
    assert_eq!(none.excitation.log_determinant, f64::NEG_INFINITY);
    assert_eq!(none.runs[0].excitation.dependent, ["torque"]);
}

#[test]
fn fault_leaves_a_complete_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut job = job(folder.path());
    job.world.set("fault_angle", "0.2").unwrap();
    let made = generate(&job, &Silent).unwrap();
    let End::Fault { seconds, reason } = &made.runs[0].end else { panic!("{:?}", made.runs[0].end) };
    assert!(reason.contains("went over") && *seconds < 5.9 && made.runs[0].seconds == *seconds);
    assert!(made.runs[0].rows < 1180);
    assert_eq!(made.runs[0].messages, 10 * made.runs[0].rows);
    let info = fleetfoot_log::inspect_values(&made.runs[0].file, &Silent).unwrap();
    assert!(info.notes.iter().all(|note| !note.contains("damaged")), "{:?}", info.notes);
    assert_eq!(info.topics.iter().find(|topic| topic.name == "/odom").unwrap().messages, Some(made.runs[0].rows));
}

#[test]
fn truth_may_be_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let made = generate(&Job { truth: false, ..job(folder.path()) }, &Silent).unwrap();
    let info = fleetfoot_log::inspect(&made.runs[0].file).unwrap();
    assert_eq!(info.topics.len(), 8);
    assert_eq!(made.runs[0].messages, 8 * made.runs[0].rows);
    let recipe = fs::read_to_string(&made.recipe).unwrap();
    assert!(!recipe.contains("/truth") && recipe.contains("/joint_states"), "{recipe}");
    let refused = Job { truth: false, format: Format::Parquet, ..job(&folder.path().join("b")) };
    assert!(generate(&refused, &Silent).is_err());
    assert!(!folder.path().join("b").exists());
}

#[test]
fn speeds_are_spread_over_the_runs() {
    let folder = tempfile::tempdir().unwrap();
    let job = Job { speed: Some((0.1, 0.5)), ..job(folder.path()) };
    let made = generate(&job, &Silent).unwrap();
    assert_eq!(made.runs.iter().map(|run| run.speed.unwrap()).collect::<Vec<_>>(), [0.1, 0.3, 0.5]);
    let world = job.world_of(2).unwrap();
    assert!(world.to_toml().contains("frequency = 0.5"), "{}", world.to_toml());
    // A log has the world that makes it again.
    let log = folder.path().join("pendulum_02.mcap");
    assert_eq!(job.world.read(&log).unwrap().to_toml(), world.to_toml());
    let other = World::of("hexapod").unwrap().read(&log).unwrap_err().to_string();
    assert!(other.contains("pendulum, not of a hexapod"), "{other}");
    let again = written(|job| {
        job.world = job.world.read(&log).unwrap();
        (job.first_run, job.runs) = (2, 1);
    });
    assert!(again[0] == files(folder.path())[2]);
}

#[test]
fn printed_worlds_read_back_equal() {
    let world = world();
    for text in [world.to_toml(), world.to_commented_toml(), String::new()] {
        assert_eq!(world.parse(&text, "again").unwrap().to_toml(), world.to_toml());
    }
    let message = |text: &str| world.parse(text, "my.toml").unwrap_err().to_string();
    let unknown = message("length = 0.4\n[drive]\nampliude = 2.0\n");
    for part in ["my.toml", "line 3", "ampliude", "did you mean `amplitude`?"] {
        assert!(unknown.contains(part), "{unknown}");
    }
    assert!(message("length = -1.0").contains("above 0"));
    assert!(message("length = ").contains("line 1"));

    let mut changed = world.clone();
    changed.set("drive.amplitude", "2").unwrap();
    assert!(changed.to_toml().contains("amplitude = 2.0"), "{}", changed.to_toml());
    changed.excite("held").unwrap();
    assert!(changed.to_toml().contains("seconds = 0.5"), "{}", changed.to_toml());
    assert!(changed.excite("hold").unwrap_err().to_string().contains("sine or held"));
    changed.set("shape.seconds", "0.25").unwrap();
    changed.set("shape.kind", "\"sine\"").unwrap();
    assert_eq!(changed.to_toml().matches("0.25").count(), 0);
    for (key, part) in [("drive.ampliude", "`amplitude`"), ("drve.amplitude", "`drive`"), ("shape.kind", "`sine`")] {
        let message = changed.set(key, "sinee").unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn plan_matches_the_generated_runs() {
    let folder = tempfile::tempdir().unwrap();
    let job = Job { seconds: 60.0, ..job(&folder.path().join("runs")) };
    let plan = plan(&job, &Silent).unwrap();
    assert!(!folder.path().join("runs").exists());
    let made = generate(&job, &Silent).unwrap();
    assert_eq!(plan.rows, made.runs.iter().map(|run| run.rows).sum::<u64>());
    assert_eq!(plan.messages, made.runs.iter().map(|run| run.messages).sum::<u64>());
    let ratio = plan.bytes as f64 / made.runs.iter().map(|run| run.bytes).sum::<u64>() as f64;
    assert!((0.8..1.25).contains(&ratio), "{ratio}");
    assert_eq!(plan.topics[1].message_type, "sensor_msgs/msg/Imu");
}

#[test]
fn cancelling_leaves_nothing_and_progress_counts_seconds() {
    /// Stops at a second.
    struct Until(usize, Mutex<usize>);
    impl Progress for Until {
        fn advance(&self, units: usize, total: usize) {
            assert_eq!(total, 18);
            *self.1.lock().unwrap() += units;
        }
        fn cancelled(&self) -> bool {
            *self.1.lock().unwrap() >= self.0
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let whole = Until(1000, Mutex::default());
    generate(&job(&folder.path().join("whole")), &whole).unwrap();
    assert_eq!(whole.1.into_inner().unwrap(), 18);
    let target = folder.path().join("stopped");
    let error = generate(&job(&target), &Until(4, Mutex::default())).unwrap_err();
    assert!(matches!(error, Error::Cancelled(_)), "{error}");
    assert!(!target.exists());
}
