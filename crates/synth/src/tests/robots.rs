//! Every robot's recipe is true of its logs, in both formats.

use std::collections::BTreeMap;

use fleetfoot_data::{Halo, MemorySource, Silent, Source};
use fleetfoot_dataset::Dataset;
use fleetfoot_library::{Expr, Scope, View, central_difference};
use fleetfoot_recipe::Recipe;
use fleetfoot_sim::{End, Run, Scenario};

use super::Rows;
use crate::{Format, Job, World, generate, recipes::Details, robots::ROBOTS, run_seed};

/// The world of a robot, without the seconds before the log begins, and the length of a short run.
fn short(robot: &str) -> (World, f64) {
    let mut world = World::of(robot).unwrap();
    if robot == "hexapod" {
        world.set("settle", "0.1").unwrap();
    }
    let seconds = if robot == "aircraft" { 200.0 } else { 2.0 };
    (world, seconds)
}

/// The rows of a short run as a source.
fn rows(scenario: &dyn Scenario, seconds: f64) -> MemorySource {
    let mut rows = Rows::default();
    scenario.run(Run { seconds, seed: run_seed(1, 0) }, &mut rows).unwrap();
    let columns = scenario.columns();
    let values = (0..columns.len()).map(|column| rows.0.iter().map(|row| row.1[column]).collect()).collect();
    let mut source = MemorySource::new(columns);
    source.push_uniform("run", scenario.row_period(), values);
    source
}

#[test]
fn known_derivatives_match_rows() {
    for robot in ROBOTS {
        let (world, seconds) = short(robot.name());
        let source = rows(world.scenario().unwrap().as_ref(), seconds);
        let count = source.episodes()[0].rows;
        for (name, details) in robot.recipe().states {
            let (known, angle) = match details {
                Details::Known(known) | Details::Integrated(known) => (known, false),
                Details::KnownAngle(known) | Details::IntegratedAngle(known) => (known, true),
                Details::Equation(column, _) => (column, false),
                Details::Fitted => continue,
            };
            let column = source.columns().iter().find(|column| column.name == *name).unwrap().clone();
            let measured = central_difference(&Expr::column(*name), angle);
            let scope = Scope::new(source.columns().iter().map(|column| column.name.clone()));
            let aliases = [(column.clone(), measured), (column, Expr::parse(known, &scope).unwrap())];
            let view = View::new(&source, &aliases).unwrap();
            let block = view.read(0, 1..count - 1, Halo::default()).unwrap();
            let (measured, known) = (block.core(0), block.core(1));
            let size = measured.iter().map(|value| value.abs()).sum::<f64>();
            let error = measured.iter().zip(known).map(|(a, b)| (a - b).abs()).sum::<f64>();
            // Changes within a row (contacts, turbulence) are lost to the difference; a wrong sign or term would be of the size itself.
            assert!(error < 0.2 * size, "{} {name}: {}", robot.name(), error / size);
        }
    }
}

/// Rows of some logs through the recipe beside them: times of the recording, ns, and columns by their names.
fn seen(job: &Job) -> (Vec<i64>, BTreeMap<String, Vec<f64>>) {
    let made = generate(job, &Silent).unwrap();
    let recipe = Recipe::read(&made.recipe).unwrap();
    let files = [made.runs[0].file.clone()];
    let (dataset, _) = Dataset::for_recipe(&recipe, &[], &files, &Silent).unwrap();
    let view = dataset.view().unwrap();
    let count = view.episodes()[0].rows;
    // Before the first message and after the last one of another topic there are no rows.
    assert!(count as u64 + 20 >= made.runs[0].rows, "{}: {count} rows of {}", job.world.robot(), made.runs[0].rows);
    let block = view.read(0, 0..count, Halo::default()).unwrap();
    let times = block.stamps().iter().map(|stamp| stamp + dataset.log_offset(0)).collect();
    let columns = view.columns().iter().enumerate();
    (times, columns.map(|(i, column)| (column.name.clone(), block.core(i).to_vec())).collect())
}

#[test]
fn both_formats_hold_the_same_rows() {
    for robot in ROBOTS {
        let folder = tempfile::tempdir().unwrap();
        let (world, seconds) = short(robot.name());
        let [(times, messages), (row_times, rows)] = [Format::Mcap, Format::Parquet].map(|format| {
            let name = format.extension();
            seen(&Job { seconds, format, ..Job::new(world.clone(), folder.path().join(name)) })
        });
        let row_of: Vec<usize> = times.iter().map(|time| row_times.binary_search(time).unwrap()).collect();
        // All that a model of the robot is made of.
        let parts = robot.recipe();
        let names = parts.states.iter().map(|(name, _)| name).chain(parts.inputs);
        for &name in names {
            // Angles went through a quaternion.
            let error = |(&row, value): (&usize, &f64)| (rows[name][row] - value).abs();
            let worst = row_of.iter().zip(&messages[name]).map(error).fold(0.0, f64::max);
            assert!(worst < 1e-9, "{} {name}: {worst}", robot.name());
        }
    }
}

#[test]
fn worlds_excite_and_set_speeds() {
    for robot in ROBOTS {
        let world = World::of(robot.name()).unwrap();
        if let Some(speed) = world.speed_parameter() {
            let mut faster = world.clone();
            faster.set(speed, "0.37").unwrap();
            assert!(faster.to_toml().contains("0.37"));
        }
        for kind in fleetfoot_sim::Excitation::KINDS.iter().filter(|_| world.excitable()) {
            let mut excited = world.clone();
            excited.excite(kind).unwrap();
            // The stage leaves out the excitation that is none.
            let is_written = excited.to_toml().contains(&format!("kind = \"{kind}\""));
            assert!(is_written || *kind == "none", "{}", excited.to_toml());
            assert_eq!(world.parse(&excited.to_toml(), "again").unwrap().to_toml(), excited.to_toml());
        }
        let columns: Vec<String> = world.scenario().unwrap().columns().into_iter().map(|column| column.name).collect();
        for (name, axis) in robot.spread() {
            assert!(columns.contains(&(*name).to_owned()) && axis.low < axis.high, "{name}");
        }
    }
}

#[test]
fn climb_ends_at_its_top() {
    let folder = tempfile::tempdir().unwrap();
    let made = generate(&Job::new(World::of("aircraft").unwrap(), folder.path()), &Silent).unwrap();
    let run = &made.runs[0];
    let End::Early { seconds, reason } = &run.end else { panic!("{:?}", run.end) };
    assert!((400.0..3000.0).contains(seconds) && !reason.is_empty(), "{seconds}: {reason}");
    assert_eq!((run.seconds, run.rows), (*seconds, *seconds as u64));
}
