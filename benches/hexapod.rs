//! The hexapod: physics steps a second beside MuJoCo, and logged rows a second of `generate`.
//!
//! Physics: the robot walks on firm ground at constant voltage, on one core, with impulse joints and as a multibody.
//! MuJoCo gets the same bodies, joints, springs and feet (`peers/hexapod.py`), and the same step. It also gets the leg
//! commands of our linkage at every step, recorded beforehand. Answer: both walk as far and stand as high, up to their
//! different contact models.
//!
//! Bias: ours also simulates cranks, gearboxes and motors, and goes through its public `step`; MuJoCo runs its own loop in C++ and stores its state at
//! every step. Both run the same number of steps from the same pose; each keeps its own default solver.
//!
//! Generation: treadmill runs into a sink that drops everything (physics, controllers and sensors alone), into Parquet
//! and into MCAP, on all threads. A physics step has no meaningful floor in flops; the limit of a row is printed as its
//! parts.

use std::{error::Error, path::Path};

use fleetfoot::{
    generate::{Format, Job, World, generate},
    sim::{
        Hexapod, HexapodTreadmill, HexapodWorld, JointMethod, Reading, Run, Scenario, Sink, SinkError, Stamps,
        hexapod::{LEGS, side},
    },
};
use fleetfoot_benches::{best_of, peak_rss_mib, peer, write_f64};
use fleetfoot_data::{Silent, thread_count};
use serde_json::json;

/// Steps of a physics run.
const STEPS: usize = 40_000;
/// Both motors, V: a steady alternating tripod. Faster ones are chaotic, and two engines then agree about nothing but means over many walks.
const VOLTAGE: f64 = 0.5;
/// Runs that are generated, and their length in s.
const RUNS: u64 = 4;
const SECONDS: f64 = 30.0;

fn main() -> Result<(), Box<dyn Error>> {
    physics()?;
    rows()
}

/// Result of a walk.
struct Walk {
    distance: f64,
    height: f64,
}

fn walk(robot: &Hexapod, method: JointMethod, mut each: impl FnMut(&HexapodWorld)) -> Walk {
    let mut world = HexapodWorld::with_joints(robot, method);
    world.place(0.0, 0.0, 0.0, START);
    let mut walk = Walk { distance: 0.0, height: 0.0 };
    for step in 0..STEPS {
        each(&world);
        world.step([VOLTAGE; 2]);
        let state = world.state();
        let (sine, cosine) = state.yaw_pitch_roll()[0].sin_cos();
        // Along its heading: the path may bend.
        walk.distance += robot.step * (cosine * state.linear_velocity.x + sine * state.linear_velocity.y);
        if step >= STEPS / 2 {
            walk.height += state.position.z / (STEPS - STEPS / 2) as f64;
        }
    }
    walk
}

/// An alternating tripod.
const START: [f64; 2] = [0.0, std::f64::consts::PI];

fn physics() -> Result<(), Box<dyn Error>> {
    let robot = Hexapod::default();
    println!(
        "hexapod, 7 bodies, 18 degrees of freedom, steps of {} ms, {:.0} s of walking, one core",
        1e3 * robot.step,
        STEPS as f64 * robot.step
    );
    println!(
        "{:<22} {:>10} {:>8} {:>11} {:>10} {:>9}",
        "", "steps/s", "ratio", "walked [m]", "height [mm]", "peak MiB"
    );
    let row = |label: &str, seconds: f64, ratio: f64, walk: &Walk, peak: f64| {
        let rate = STEPS as f64 / seconds;
        println!(
            "{label:<22} {rate:>10.0} {ratio:>8.2} {:>11.4} {:>10.3} {peak:>9.0}",
            walk.distance,
            1e3 * walk.height
        );
    };
    let mut fastest = f64::INFINITY;
    let mut default = None;
    for (name, method) in [("impulse joints", JointMethod::Impulse), ("multibody", JointMethod::Multibody)] {
        let (seconds, done) = best_of(5, || walk(&robot, method, |_| ()));
        fastest = fastest.min(seconds);
        row(name, seconds, seconds / fastest, &done, peak_rss_mib());
        if method == JointMethod::default() {
            default = Some(done);
        }
    }
    let ours = default.ok_or("the default is one of both")?;
    let folder = tempfile::tempdir()?;
    write_problem(folder.path(), &robot)?;
    match peer("hexapod.py", &[folder.path(), Path::new(&STEPS.to_string())]) {
        Err(reason) => println!("MuJoCo                 absent: {reason}"),
        Ok(answer) => {
            let number = |key: &str| answer[key].as_f64().ok_or_else(|| format!("hexapod.py said no {key}"));
            let theirs = Walk { distance: number("distance")?, height: number("height")? };
            let seconds = number("seconds")?;
            let name = format!("MuJoCo {}", answer["version"].as_str().unwrap_or("?"));
            row(&name, seconds, seconds / fastest, &theirs, number("peak_mib")?);
            let (far, high) = (theirs.distance / ours.distance - 1.0, theirs.height / ours.height - 1.0);
            println!("MuJoCo walks {:+.1} % as far and stands {:+.1} % as high", 100.0 * far, 100.0 * high);
            assert!(far.abs() < 0.25 && high.abs() < 0.05, "the two engines disagree about the walk");
        }
    }
    Ok(())
}

/// The robot's dimensions, its start, and the leg commands of the linkage at every step.
fn write_problem(folder: &Path, robot: &Hexapod) -> Result<(), Box<dyn Error>> {
    let mut controls = Vec::with_capacity(STEPS * 4 * LEGS);
    let mut start = Vec::new();
    walk(robot, JointMethod::default(), |world| {
        let state = world.state();
        let targets: [_; LEGS] = std::array::from_fn(|leg| robot.target(leg, state.crank_angle[side(leg)]));
        if start.is_empty() {
            start.extend(state.position.to_array());
            start.extend(targets.iter().flat_map(|target| [target.lift, target.swing]));
        }
        controls.extend(targets.iter().flat_map(|target| [target.lift, target.swing]));
        controls.extend(targets.iter().enumerate().flat_map(|(leg, target)| {
            let rate = state.crank_rate[side(leg)];
            [target.lift_gain * rate, target.swing_gain * rate]
        }));
    });
    write_f64(&folder.join("controls.f64"), &controls)?;
    write_f64(&folder.join("start.f64"), &start)?;
    let (trunk, leg) = (&robot.trunk, &robot.leg);
    let squares = [trunk.length, trunk.width, trunk.height].map(|side| side * side);
    let inertia =
        [squares[1] + squares[2], squares[0] + squares[2], squares[0] + squares[1]].map(|sum| trunk.mass * sum / 12.0);
    let thickness = 4.0 * leg.foot_radius * leg.foot_radius;
    let hips: Vec<[f64; 3]> = (0..LEGS).map(|leg| robot.hip(leg).to_array()).collect();
    let problem = json!({
        "step": robot.step, "gravity": robot.gravity, "friction": robot.contact.friction, "hips": hips,
        "trunk": { "mass": trunk.mass, "length": trunk.length, "width": trunk.width, "height": trunk.height, "inertia": inertia },
        "leg": {
            "mass": leg.mass, "length": leg.length, "foot_radius": leg.foot_radius,
            "across": leg.mass * (leg.length * leg.length + thickness) / 12.0, "along": leg.mass * thickness / 6.0,
            "swing_stiffness": leg.swing_stiffness, "swing_damping": leg.swing_damping,
            "lift_stiffness": leg.lift_stiffness, "lift_damping": leg.lift_damping,
        },
    });
    std::fs::write(folder.join("robot.json"), problem.to_string())?;
    Ok(())
}

/// Keeps nothing.
struct Nowhere(u64);

impl Sink for Nowhere {
    fn message(&mut self, _: usize, _: Stamps, _: Reading<'_>) -> Result<(), SinkError> {
        Ok(())
    }

    fn row(&mut self, _: i64, _: &[f64]) -> Result<(), SinkError> {
        self.0 += 1;
        Ok(())
    }
}

fn rows() -> Result<(), Box<dyn Error>> {
    let threads = thread_count();
    println!("\ngenerate hexapod, {RUNS} runs of {SECONDS} s, {threads} threads");
    println!("{:<34} {:>9} {:>15} {:>9}", "", "rows/s", "us/row a thread", "peak MiB");
    let row = |label: &str, rows: u64, seconds: f64| {
        let each = 1e6 * seconds * threads as f64 / rows as f64;
        println!("{label:<34} {:>9.0} {each:>15.2} {:>9.0}", rows as f64 / seconds, peak_rss_mib());
    };
    let scenario = HexapodTreadmill::default();
    let (seconds, counted) = best_of(2, || {
        fleetfoot_data::parallel_map(RUNS as usize, &Silent, |run| {
            let mut sink = Nowhere(0);
            scenario.run(Run { seconds: SECONDS, seed: run as u64 }, &mut sink)?;
            Ok::<_, SinkError>(sink.0)
        })
    });
    row("physics, control and sensors alone", counted.map_err(|e| e.to_string())?.iter().sum(), seconds);
    for (name, format) in [("logged as Parquet", Format::Parquet), ("logged as MCAP", Format::Mcap)] {
        let folder = tempfile::tempdir()?;
        let mut job = Job::new(World::of("hexapod")?, folder.path().join("runs"));
        (job.runs, job.seconds, job.format, job.force) = (RUNS, SECONDS, format, true);
        let (seconds, done) = best_of(2, || generate(&job, &Silent));
        let done = done?;
        row(name, done.runs.iter().map(|run| run.rows).sum(), seconds);
        let bytes: u64 = done.runs.iter().map(|run| run.bytes).sum();
        let messages: u64 = done.runs.iter().map(|run| run.messages).sum();
        println!("    {:.1} MB, {messages} messages", bytes as f64 * 1e-6);
    }
    Ok(())
}
