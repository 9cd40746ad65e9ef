//! Robots with regulators that were made from logs of them, beside their own controllers.

use fleetfoot_data::Silent;
use fleetfoot_fit::{FitRequest, Pwa, fit};
use fleetfoot_recipe::ControlSection;
use fleetfoot_run::{ControllerFile, control_lqr};

use super::*;

/// Logs of a robot that its own controller moves, or a regulator.
fn made(job: &Job) -> Vec<RunReport> {
    generate(&Job { format: Format::Parquet, ..job.clone() }, &Silent).unwrap().runs
}

/// The files of runs.
fn files(runs: Vec<RunReport>) -> Vec<std::path::PathBuf> {
    runs.into_iter().map(|run| run.file).collect()
}

/// A run that must go to its end: its file.
fn complete(world: &World, folder: &Path, seconds: f64, seed: u64) -> std::path::PathBuf {
    let runs = made(&Job { seconds, seed, ..Job::new(world.clone(), folder) });
    assert_eq!(runs[0].end, End::Complete);
    runs[0].file.clone()
}

/// The rows of columns of one log.
fn read(file: &Path, names: &[&str]) -> Vec<Vec<f64>> {
    let log = open(&[file], &Selection::new(names.iter().copied())).unwrap();
    columns(&log, names)
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

/// A regulator of the model that a recipe finds in logs.
fn regulator(recipe: &str, logs: &[std::path::PathBuf], setting: &ControlSection) -> ControllerFile {
    let recipe = Recipe::parse(recipe, "robot.toml").unwrap();
    let fitted = fit::<Pwa>(&recipe, &FitRequest::default(), logs, &Silent).unwrap();
    control_lqr(&fitted.model, setting).unwrap()
}

fn setting(text: &str) -> Option<String> {
    Some(text.to_owned())
}

#[test]
fn regulator_beats_the_built_in_treadmill_controller() {
    let folder = tempfile::tempdir().unwrap();
    let mut world = World::of("hexapod").unwrap();
    world.set("belt.speed", "0.3").unwrap();
    // Without excitation the robot's own controller makes the commands functions of the states.
    let mut excited = world.clone();
    excited.excite("ornstein-uhlenbeck").unwrap();
    let train = Job::new(excited, folder.path().join("train"));
    let logs = files(made(&Job { runs: 3, seconds: 30.0, speed: Some((0.27, 0.33)), ..train }));
    // Over a stride, how the place moves is affine in the commands, and the same wherever it is.
    let recipe = "[states]\nx = { derivative = { over = 200 }, regressor = false }\ny = { derivative = { over = 200 }, regressor = false }\nyaw = { derivative = { over = 200 } }\n[inputs]\nu_v = \"u_v\"\nu_w = \"u_w\"\nbelt_speed = \"belt_speed\"\n[time]\ncolumn = \"t\"\n[model]\npartition = \"average\"\n";
    let section = ControlSection {
        setpoint: setting("x=0,y=0,belt_speed=0.3"),
        q: setting("x=100,y=400,yaw=80"),
        r: setting("u_v=100,u_w=1"),
        drive: setting("u_v,u_w"),
        integral: setting("x=100"),
        limits: setting("u_v=0:1,u_w=-1.5:1.5"),
        period: Some(0.01),
        ..ControlSection::default()
    };
    let made = regulator(recipe, &logs, &section);
    let mut regulated = world.clone();
    regulated.regulate(&made.law).unwrap();
    // Seeds that did not train; the same for both, so that robot, belt and noise are the same.
    for seed in [7, 8] {
        let error = |world: &World, name: &str| {
            let file = complete(world, &folder.path().join(format!("{name}{seed}")), 20.0, seed);
            let place = read(&file, &["x", "y"]);
            (rms(&place[0]), rms(&place[1]))
        };
        let (built_in, law) = (error(&world, "own"), error(&regulated, "law"));
        println!("seed {seed}: RMS of x and y, own controller {built_in:?}, regulator {law:?}");
        assert!(law.0.hypot(law.1) < 0.5 * built_in.0.hypot(built_in.1), "{seed}: {built_in:?} {law:?}");
    }
}

#[test]
fn a_regulator_keeps_the_wheeled_robot_on_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let mut world = World::of("diffdrive").unwrap();
    let train = Job::new(world.clone(), folder.path().join("train"));
    let logs = files(made(&Job { runs: 3, seconds: 20.0, ..train }));
    let recipe = "[states]\ny = { known = \"v*sin(yaw)\", regressor = false }\nyaw = { known = \"w\", kind = \"angle\", regressor = false }\nv = { derivative = { over = 10 } }\nw = { derivative = { over = 10 } }\n[inputs]\nv_command = \"v_command\"\nw_command = \"w_command\"\n[time]\ncolumn = \"t\"\n[model]\npartition = \"average\"\n";
    let section = ControlSection {
        setpoint: setting("y=0,yaw=0,v=0.3"),
        integral: setting("v=1"),
        limits: setting("v_command=0:1,w_command=-3:3"),
        period: Some(0.05),
        ..ControlSection::default()
    };
    let made = regulator(recipe, &logs, &section);
    world.set("arena.walls", "false").unwrap();
    world.regulate(&made.law).unwrap();
    let file = complete(&world, &folder.path().join("line"), 30.0, 7);
    let [y, yaw, v] = &read(&file, &["y", "yaw", "v"])[..] else { panic!() };
    let late = |values: &[f64]| values[values.len() / 2..].to_vec();
    println!("y {} yaw {} v {}", rms(&late(y)), rms(&late(yaw)), late(v).iter().sum::<f64>() / late(v).len() as f64);
    // A constant torque that the model does not know stays as an offset, as y is not integrated.
    assert!(rms(&late(y)) < 0.05 && rms(&late(yaw)) < 0.02, "{} {}", rms(&late(y)), rms(&late(yaw)));
    let mean = late(v).iter().sum::<f64>() / late(v).len() as f64;
    assert!((mean - 0.3).abs() < 0.01, "{mean}");
}

#[test]
fn unknown_states_and_inputs_are_refused() {
    let mut world = World::of("hexapod").unwrap();
    let mut law = fleetfoot_control::controller::Regulator {
        period: 0.01,
        states: vec![fleetfoot_control::controller::RegulatedState {
            name: "z".into(),
            at: 0.0,
            size: 1.0,
            angle: false,
        }],
        inputs: vec![fleetfoot_control::controller::DrivenInput { name: "u_v".into(), lowest: 0.0, highest: 1.0 }],
        rotations: Vec::new(),
        measured: Vec::new(),
        integrated: Vec::new(),
        partition: None,
        laws: vec![fleetfoot_control::controller::RegionLaw {
            inputs: vec![0.3],
            gain: vec![vec![1.0]],
            integral: Vec::new(),
            measured: Vec::new(),
        }],
        prediction: None,
    };
    let refused = |world: &mut World, law: &_| world.regulate(law).unwrap_err().to_string();
    let text = refused(&mut world, &law);
    assert!(text.contains("reads") && text.contains("yaw"), "{text}");
    law.states[0].name = "x".into();
    law.inputs[0].name = "u_x".into();
    let text = refused(&mut world, &law);
    assert!(text.contains("drives") && text.contains("u_w"), "{text}");
    law.inputs[0].name = "u_v".into();
    world.regulate(&law).unwrap();
    // A robot without a place for it says so.
    let mut aircraft = World::of("aircraft").unwrap();
    let text = refused(&mut aircraft, &law);
    assert!(text.contains("regulator"), "{text}");
}
