//! Predictive controllers in C compile without a warning and give the engine's commands.

use std::process::Command;

use fleetfoot_codegen::{ExportOptions, Precision, Target, export_predictive};
use fleetfoot_control::{
    controller::Regulator,
    design::{LqrOptions, MpcOptions, Schedule, mpc},
};

use crate::{
    export::{FLAGS, Folder, present},
    models,
};

/// Controllers of [`models::pwa`], whose regions are decided by states, an angle and an input.
fn controllers() -> Vec<(&'static str, Regulator)> {
    let named = |values: &[(&str, f64)]| values.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
    let ranges = |values: &[(&str, f64, f64)]| {
        values.iter().map(|&(name, low, high)| (name.to_owned(), low, high)).collect::<Vec<_>>()
    };
    let design = |schedule: Schedule, integral: &[(&str, f64)], drive: &[&str], horizon: usize, bounded: bool| {
        let lqr = LqrOptions {
            integral: named(integral),
            limits: ranges(if drive.len() == 1 {
                &[("left", -0.4, 0.5)]
            } else {
                &[("left", -0.4, 0.5), ("right", -0.6, 0.6)]
            }),
            drive: drive.iter().map(|&name| name.to_owned()).collect(),
            free: vec!["px".to_owned()],
            schedule,
            ..LqrOptions::default()
        };
        let free = MpcOptions { lqr, horizon, bounds: Vec::new() };
        let at = mpc(&models::pwa(5, 1), &free).expect("a controller").setpoint.states;
        let near = |name: &str| at.iter().find(|(state, _)| state == name).map_or(0.0, |state| state.1);
        let bounds = if bounded {
            ranges(&[("vx", near("vx") - 0.1, near("vx") + 0.2), ("w", near("w") - 0.3, f64::INFINITY)])
        } else {
            Vec::new()
        };
        mpc(&models::pwa(5, 1), &MpcOptions { bounds, ..free }).expect("a controller").regulator
    };
    let both = ["left", "right"];
    vec![
        ("plain", design(Schedule::Mean, &[], &both, 20, false)),
        ("bounded", design(Schedule::Mean, &[("yaw", 3.0), ("vx", 1.0)], &both, 20, true)),
        ("measured", design(Schedule::Mean, &[], &["left"], 1, true)),
        ("regions", design(Schedule::Region, &[], &both, 10, false)),
        ("all", design(Schedule::Region, &[("yaw", 3.0)], &["left"], 10, true)),
    ]
}

#[test]
fn predictive_c_agrees_with_the_engine() {
    if !present("cc") {
        return;
    }
    let folder = Folder::new("predictive");
    for (name, law) in controllers() {
        for precision in [Precision::Double, Precision::Float] {
            let mut options = ExportOptions::new(Target::C);
            options.precision = precision;
            options.prefix = format!("{name}_{}", if precision == Precision::Float { "float" } else { "double" });
            options.domain = false;
            let files = export_predictive(&law, &options).expect("code");
            for file in &files {
                std::fs::write(folder.0.join(&file.name), &file.bytes).expect("written");
            }
            let prefix = &options.prefix;
            let sources = [format!("{prefix}.c"), format!("{prefix}_test.c")];
            let compiled = Command::new("cc")
                .current_dir(&folder.0)
                .args(FLAGS)
                .args(&sources)
                .args(["-o", prefix, "-lm"])
                .output()
                .expect("a compiler");
            assert!(compiled.status.success(), "{prefix}: {}", String::from_utf8_lossy(&compiled.stderr));
            let run = Command::new(folder.0.join(prefix)).output().expect("a program");
            let text = String::from_utf8_lossy(&run.stdout).into_owned();
            println!("{prefix}: {text}");
            assert!(run.status.success() && text.contains("48 samples"), "{prefix}: {text}");
        }
    }
}
