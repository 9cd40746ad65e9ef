//! Filters as C: every estimate of a recording is the engine's.

use std::{path::Path, process::Command};

use fleetfoot::{
    FilterNoise, FilterSection, FilterSwitching, Tunable,
    codegen::{ExportOptions, Precision, Target},
    control::filter::{SwitchedFilter, Track},
    export_filter, filter_of,
    library::Expr,
    model::{
        AffineMap, Column, Equation, Latent, Model, Partition, Prediction, RegionSummary, ResidualCorrelation, Role,
        Rule, Training, Transitions,
    },
};

use crate::export::models;

/// Rows of a recording.
const ROWS: usize = 500;

/// Pseudo-random numbers in [-1, 1), from a key.
fn noise(key: usize) -> f64 {
    let mut z = (key as u64).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ (z >> 31)) as i64 as f64 / i64::MAX as f64
}

/// A recording: inputs and measurements of every row, with gaps in both. What is measured wanders over all regions.
fn recording(filter: &SwitchedFilter) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let sized = |row: usize, i: usize| {
        let slow = (0.03 * row as f64 + 2.0 * i as f64).sin() + 0.5 * (0.011 * row as f64 + i as f64).cos();
        slow + 0.1 * noise(97 * row + i)
    };
    let inputs = |row: usize| -> Vec<f64> {
        (0..filter.inputs().len()).map(|i| if row % 41 == 7 { f64::NAN } else { sized(row, 10 + i) }).collect()
    };
    let measured = |row: usize| -> Vec<f64> {
        let sensors = filter.measured().enumerate();
        sensors
            .map(|(k, s)| {
                if (row + 5 * k) % 13 == 4 { f64::NAN } else { filter.prior(s)[0] + filter.prior(s)[1] * sized(row, k) }
            })
            .collect()
    };
    ((0..ROWS).map(inputs).collect(), (0..ROWS).map(measured).collect())
}

/// A program that filters the recording and prints states, covariances, probabilities and likelihood.
fn program(inputs: &[Vec<f64>], measured: &[Vec<f64>], order: &[usize]) -> String {
    let list = |values: &mut dyn Iterator<Item = f64>| -> String {
        let text = |v: f64| if v.is_nan() { "NAN".to_owned() } else { format!("{v:?}") };
        values.map(text).collect::<Vec<_>>().join(", ")
    };
    let rows =
        |of: &dyn Fn(usize) -> String| (0..ROWS).map(|row| format!("{{{}}}", of(row))).collect::<Vec<_>>().join(",\n");
    let u = if order.is_empty() {
        String::new()
    } else {
        format!(
            "static const double u[{ROWS}][ROBOT_FILTER_INPUT_COUNT] = {{\n{}\n}};\n",
            rows(&|row| list(&mut order.iter().map(|&i| inputs[row][i])))
        )
    };
    let z = rows(&|row| list(&mut measured[row].iter().copied()));
    format!(
        "#include \"robot_filter.h\"\n#include <math.h>\n#include <stdio.h>\n\n{u}static const double z[{ROWS}][ROBOT_FILTER_SENSOR_COUNT] = {{\n{z}\n}};\nstatic robot_filter_state f;\n\nint main(void) {{\n    robot_filter_start(&f, z[0]);\n    for (int row = 1; row < {ROWS}; row++) {{\n        robot_filter_step(&f{}, z[row]);\n        for (int i = 0; i < ROBOT_FILTER_STATE_COUNT; i++) printf(\"%.17g \", f.x[i]);\n        for (int i = 0; i < ROBOT_FILTER_STATE_COUNT * ROBOT_FILTER_STATE_COUNT; i++) printf(\"%.17g \", f.cov[i]);\n        for (int i = 0; i < ROBOT_FILTER_REGION_COUNT; i++) printf(\"%.17g \", f.w[i]);\n        printf(\"%.17g\\n\", f.log_likelihood);\n    }}\n    return 0;\n}}\n",
        if order.is_empty() { "" } else { ", u[row - 1]" }
    )
}

fn compiled(folder: &Path, flags: &[&str]) {
    let cc = Command::new("cc")
        .current_dir(folder)
        .args(["-std=c99", "-Wall", "-Wextra", "-Wdouble-promotion", "-Wfloat-equal", "-Wshadow", "-Werror", "-O2"])
        .args(flags)
        .output()
        .expect("cc");
    assert!(cc.status.success(), "{}", String::from_utf8_lossy(&cc.stderr));
}

/// The order of the code's inputs among the engine's, by the header.
fn order(folder: &Path, filter: &SwitchedFilter) -> Vec<usize> {
    let header = std::fs::read_to_string(folder.join("robot_filter.h")).expect("a header");
    let inputs = header.lines().filter(|line| line.trim().starts_with("ROBOT_FILTER_INPUT_") && line.contains("/*"));
    let name =
        |line: &str| line.split("/* ").nth(1).and_then(|rest| rest.split(" */").next()).unwrap_or_default().to_owned();
    inputs.map(|line| filter.inputs().iter().position(|input| *input == name(line)).expect("an input")).collect()
}

/// Numbers of the engine at the row of a track.
fn track_numbers(track: &Track) -> Vec<f64> {
    let estimate = track.estimate();
    let numbers = estimate.mean.iter().chain(&estimate.covariance).chain(track.probabilities());
    numbers.copied().chain([track.log_likelihood()]).collect()
}

/// The largest difference between code and engine, relative to numbers above one, and how many regions led.
fn compared(model: &Model, section: &FilterSection) -> (f64, usize) {
    let filter = filter_of(model, section).expect("a filter");
    let folder = tempfile::tempdir().expect("a folder");
    let mut options = ExportOptions::new(Target::C);
    options.prefix = "robot".into();
    let files = export_filter(model, section, &options, folder.path(), &[]).expect("code");
    assert_eq!(files.len(), 2);
    let (inputs, measured) = recording(&filter);
    let order = order(folder.path(), &filter);
    std::fs::write(folder.path().join("main.c"), program(&inputs, &measured, &order)).expect("written");
    compiled(folder.path(), &["robot_filter.c", "main.c", "-o", "run", "-lm"]);
    let run = Command::new(folder.path().join("run")).output().expect("a run");
    let printed = String::from_utf8(run.stdout).expect("numbers");
    let no_deviations = vec![f64::NAN; measured[0].len()];
    let mut track = filter.start(&measured[0], &no_deviations);
    let (mut worst, mut led) = (0.0f64, std::collections::BTreeSet::new());
    let mut lines = printed.lines();
    for row in 1..ROWS {
        filter.step(&mut track, &inputs[row - 1], filter.period(), &measured[row], &no_deviations);
        let exported: Vec<f64> =
            lines.next().expect("a line").split_whitespace().map(|text| text.parse().expect("a number")).collect();
        let engine = track_numbers(&track);
        assert!(
            exported.len() == engine.len() && engine.iter().chain(&exported).all(|value| value.is_finite()),
            "{engine:?}"
        );
        for (a, b) in exported.iter().zip(&engine) {
            worst = worst.max((a - b).abs() / b.abs().max(1.0));
        }
        let likely =
            (0..filter.regions()).max_by(|&a, &b| track.probabilities()[a].total_cmp(&track.probabilities()[b]));
        led.extend(likely);
    }
    // 32 bits compile as cleanly.
    options.precision = Precision::Float;
    export_filter(model, section, &options, folder.path(), &[]).expect("code");
    compiled(folder.path(), &["-Wconversion", "-c", "robot_filter.c"]);
    (worst, led.len())
}

/// A model of three states, the last one an angle, and two inputs, of which one decides regions too: affine in each of four regions.
fn piecewise(prediction: Prediction) -> Model {
    let names = ["x", "v", "yaw", "u", "w"];
    let role = |i: usize| if i < 3 { Role::State } else { Role::Input };
    let column = |i: usize| Column { angle: i == 2, ..Column::new(names[i], role(i)) };
    let training = Training {
        state_covariance: vec![1.0, 0.0, 1.0, 0.0, 0.0, 1.0],
        rows: 4000,
        target_mean: vec![0.0; 2],
        target_covariance: vec![1.0, 0.0, 1.0],
        target_deviation: vec![1.0; 2],
        ..Training::default()
    };
    let mut model = Model::new("pwa kmeans:4", (0..5).map(column).collect(), 0.05, training);
    model.libraries = vec![["x", "v", "u", "w"].map(Expr::column).to_vec()];
    let centroids = vec![vec![-0.8, 0.0, 0.3], vec![0.2, -0.9, -0.2], vec![0.5, 0.8, 0.1], vec![1.0, 0.1, -0.9]];
    let region = |name: usize| RegionSummary {
        name: name.to_string(),
        rows: 1000,
        mean: vec![0.1, -0.1, 0.0, 0.0],
        covariance: vec![1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        range: vec![[-3.0, 3.0]; 4],
        residual_covariance: vec![0.02 + 0.01 * name as f64, 0.003, 0.03],
        rank: 4,
        condition: 2.0,
        confounded: Vec::new(),
    };
    model.partitions = vec![Partition {
        specification: "kmeans:4".into(),
        columns: ["x", "v", "u"].map(Expr::column).to_vec(),
        centre: vec![0.1, 0.0, -0.1],
        scale: vec![0.9, 1.1, 1.2],
        rule: Rule::voronoi(centroids),
        ..Partition::whole()
    }];
    model.summaries = vec![(0..4).map(region).collect::<Vec<_>>().into()];
    let next = prediction == Prediction::Next;
    for (i, subject) in ["x", "v"].into_iter().enumerate() {
        let name = format!("latent_{subject}");
        let coefficient = |region: usize, j: usize| {
            0.4 * noise(region * 100 + i * 10 + j) + if i == j { if next { 0.7 } else { -1.0 } } else { 0.0 }
        };
        model.latents.push(Latent {
            beyond: Vec::new(),
            name: name.clone(),
            library: 0,
            partition: 0,
            map: AffineMap {
                constants: (0..4).map(|region| 0.3 * noise(5000 + region * 10 + i)).collect(),
                coefficients: (0..4).map(|region| (0..4).map(|j| coefficient(region, j)).collect()).collect(),
            }
            .into(),
        });
        let right = Expr::column(name.as_str());
        model.equations.push(Equation {
            subject: subject.into(),
            prediction,
            right,
            target: Some(Expr::number(1.0)),
            unit: None,
        });
    }
    let turned = Expr::column("v") + Expr::column("w");
    let right = if next { Expr::column("yaw") + Expr::number(0.05) * turned } else { turned };
    model.equations.push(Equation { subject: "yaw".into(), prediction, right, target: None, unit: None });
    model
}

#[test]
fn c_gives_the_estimates_of_the_engine() {
    if Command::new("cc").arg("--version").output().is_err() {
        eprintln!("no `cc` on this machine: exported code is not compiled");
        return;
    }
    for prediction in [Prediction::Next, Prediction::Derivative] {
        let model = piecewise(prediction);
        model.validate().expect("a model");
        let asked = |measured: &str, switching| FilterSection {
            measured: Some(measured.to_owned()),
            switching: Some(switching),
            process: Some(Tunable::Number(0.7)),
            ..FilterSection::default()
        };
        for measured in ["x=0.2,yaw=0.1", "v=0.5", "x=0.1,v=0.1,yaw=0.05"] {
            let (worst, led) = compared(&model, &asked(measured, FilterSwitching::State));
            println!("{prediction:?} {measured}: {worst:e}, {led} regions led");
            // The same operations in the same order, but for the standardisation of the partition's columns.
            assert!(worst < 1e-12 && led >= 3, "{prediction:?} {measured}: {worst:e}, {led} regions");
        }
        let mut counted = model.clone();
        counted.partitions[0].transitions = Some(Transitions { counts: vec![vec![3; 4]; 4] });
        let (worst, _) = compared(&counted, &asked("x=0.2,yaw=0.1", FilterSwitching::Transitions));
        assert!(worst < 1e-12, "{prediction:?} by transitions: {worst:e}");
        // Noise that hangs on that of two rows before.
        let lags = vec![vec![0.8, 0.1, -0.05, 0.6], vec![0.5, 0.12, -0.08, 0.3]];
        for coloured in [&model, &counted] {
            let mut coloured = coloured.clone();
            coloured.partitions[0].correlation = Some(ResidualCorrelation { lags: lags.clone() });
            let by = if coloured.partitions[0].transitions.is_some() {
                FilterSwitching::Transitions
            } else {
                FilterSwitching::State
            };
            let coloured_of = FilterSection { noise: Some(FilterNoise::Coloured), ..asked("x=0.2,yaw=0.1", by) };
            let (worst, led) = compared(&coloured, &coloured_of);
            println!("{prediction:?} coloured, {by:?}: {worst:e}, {led} regions led");
            assert!(worst < 1e-12 && led >= 3, "{prediction:?} coloured, {by:?}: {worst:e}, {led} regions");
        }
        // One region.
        let mut whole = model;
        let regions = vec![whole.summaries[0].regions[0].clone()];
        (whole.partitions[0], whole.summaries[0]) = (Partition::whole(), regions.into());
        for latent in &mut whole.latents {
            latent.map.keep_region(0);
        }
        let (worst, _) = compared(&whole, &asked("x=0.2,yaw=0.1", FilterSwitching::State));
        assert!(worst < 1e-12, "{prediction:?}, one region: {worst:e}");
    }
}

#[test]
fn unexportable_filters_are_refused() {
    let model = piecewise(Prediction::Next);
    let folder = tempfile::tempdir().expect("a folder");
    let section = |measured: &str| FilterSection { measured: Some(measured.to_owned()), ..FilterSection::default() };
    let refused = |model: &Model, section: &FilterSection, target| {
        let error =
            export_filter(model, section, &ExportOptions::new(target), folder.path(), &[]).expect_err("refused");
        error.to_string()
    };
    assert!(refused(&model, &section("x"), Target::C).contains("no standard deviation"));
    assert!(refused(&model, &section("x=0.1"), Target::Rust).contains("--to c"));
    let curved = models::pwa(5, 1);
    let message = refused(&curved, &section("vx=0.1"), Target::C);
    assert!(message.contains("not affine"), "{message}");
}
