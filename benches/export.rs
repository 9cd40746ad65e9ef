//! Exported C beside the engine: nanoseconds a step, in Euler steps of 1 ms. One model is piecewise-affine (K = 50, 16
//! states, 2 inputs, the size of a hexapod's), the other a sparse polynomial (8 states, 44 candidate functions, about a
//! quarter in use).
//!
//! Bias: the C program is compiled with `cc -O2`, on one thread, as on a robot. It runs one trajectory at a time, each
//! step needing the one before, with the check of the training range. The engine runs 1,000 trajectories on one thread
//! as a rollout does, with vectors. It need not search the region of a state that stays in its cell; its time is that
//! of a trajectory's step. Both start at the same states, and their last states are compared.

use std::{error::Error, fmt::Write, path::Path, process::Command, time::Instant};

use fleetfoot::{
    Silent,
    codegen::{ExportOptions, StepMethod, Target, export},
    data::{Column as Field, MemorySource, mix},
    dynamics::{Method, RolloutOptions, Simulator, Start, Step},
    library::{Expr, Library},
    model::{AffineMap, Column, Equation, Latent, Model, Partition, Prediction, RegionSummary, Role, Rule, Training},
    with_threads,
};

const DT: f64 = 1e-3;
const STEPS: usize = 200;
const STARTS: usize = 1_000;

fn main() -> Result<(), Box<dyn Error>> {
    println!("{:<28} {:>14} {:>14} {:>12}", "ns a step, one thread", "C (cc -O2)", "engine", "difference");
    for (name, model) in [("affine, K = 50", affine()), ("sparse, degree 2", sparse())] {
        model.validate()?;
        let (engine, last) = engine(&model)?;
        match compiled(&model, &last)? {
            Some((c, difference)) => println!("{name:<28} {c:>14.1} {engine:>14.1} {difference:>12.1e}"),
            None => println!("{name:<28} {:>14} {engine:>14.1}", "no cc"),
        }
    }
    Ok(())
}

/// Uniform in [-1, 1) at an address.
fn uniform(key: u64) -> f64 {
    (mix(mix(7).wrapping_add(key)) >> 11) as f64 * (2.0 / 9_007_199_254_740_992.0) - 1.0
}

fn start(state: usize) -> f64 {
    0.5 * uniform(1_000_000 + state as u64)
}

fn input(input: usize) -> f64 {
    0.3 * uniform(2_000_000 + input as u64)
}

/// A model of damped states: `x' = latent - x`.
fn model(states: usize, inputs: usize, functions: Vec<Expr>, rule: Rule, share: f64) -> Model {
    let column = |name: String, role| Column::new(name, role);
    let mut columns: Vec<Column> = (0..states).map(|i| column(format!("x{i}"), Role::State)).collect();
    columns.extend((0..inputs).map(|i| column(format!("u{i}"), Role::Input)));
    let triangle = |n: usize| n * (n + 1) / 2;
    let training = Training {
        target_mean: vec![0.0; states],
        target_covariance: vec![0.0; triangle(states)],
        target_deviation: vec![0.0; states],
        state_covariance: vec![0.0; triangle(states)],
        ..Training::default()
    };
    let mut model = Model::new("bench", columns, DT, training);
    let (regions, count) = (rule.count(), functions.len());
    let names: Vec<Expr> = (0..states).map(|i| Expr::column(format!("x{i}"))).collect();
    let partition = Partition {
        specification: "bench".into(),
        centre: vec![0.0; if regions > 1 { states } else { 0 }],
        scale: vec![1.0; if regions > 1 { states } else { 0 }],
        columns: if regions > 1 { names } else { Vec::new() },
        rule,
        ..Partition::whole()
    };
    let seen = (0..regions)
        .map(|region| RegionSummary {
            name: region.to_string(),
            rows: 100,
            mean: vec![0.0; count],
            covariance: vec![0.0; triangle(count)],
            range: vec![[-100.0, 100.0]; count],
            residual_covariance: vec![0.0; triangle(states)],
            rank: count,
            condition: 1.0,
            confounded: Vec::new(),
        })
        .collect();
    model.add_partition(partition, seen);
    model.libraries.push(functions);
    for state in 0..states {
        let key = |region: usize, j: usize| ((state * regions + region) * (count + 1) + j) as u64;
        let coefficient = |region: usize, j: usize| {
            let keep = uniform(5_000_000 + key(region, j)).abs() < share;
            if keep { uniform(key(region, j)) } else { 0.0 }
        };
        model.latents.push(Latent {
            beyond: Vec::new(),
            name: format!("f{state}"),
            library: 0,
            partition: 0,
            map: AffineMap {
                constants: (0..regions).map(|region| uniform(key(region, count))).collect(),
                coefficients: (0..regions).map(|region| (0..count).map(|j| coefficient(region, j)).collect()).collect(),
            }
            .into(),
        });
        let name = format!("x{state}");
        model.equations.push(Equation {
            prediction: Prediction::Derivative,
            right: Expr::column(format!("f{state}")),
            target: Some(Expr::column(name.as_str())),
            subject: name,
            unit: None,
        });
    }
    model
}

fn affine() -> Model {
    let functions = (0..16).map(|i| format!("x{i}")).chain((0..2).map(|i| format!("u{i}"))).map(Expr::column).collect();
    let centroids = (0..50).map(|k| (0..16).map(|i| uniform(3_000_000 + k * 16 + i)).collect()).collect();
    model(16, 2, functions, Rule::voronoi(centroids), 1.0)
}

fn sparse() -> Model {
    let variables: Vec<Expr> = (0..8).map(|i| Expr::column(format!("x{i}"))).collect();
    let functions =
        Library::polynomial(&variables, 2).map_or_else(|_| Vec::new(), |library| library.functions().to_vec());
    model(8, 0, functions, Rule::Whole, 0.25)
}

/// Nanoseconds a step, and the last states.
fn engine(model: &Model) -> Result<(f64, Vec<f64>), Box<dyn Error>> {
    let simulator = Simulator::new(model)?;
    let fields = model.columns.iter().map(|column| Field::float(&column.name)).collect();
    let mut source = MemorySource::new(fields);
    let rows = STEPS + 3;
    let states = model.latents.len();
    let value = |column: usize| if column < states { start(column) } else { input(column - states) };
    source.push_uniform("run", DT, (0..model.columns.len()).map(|column| vec![value(column); rows]).collect());
    let starts = vec![Start { episode: 0, row: 1 }; STARTS];
    let mut options = RolloutOptions::new(STEPS);
    options.method = Method::Euler;
    options.step = Step::Seconds(DT);
    let mut best = f64::INFINITY;
    let mut last = Vec::new();
    for _ in 0..5 {
        let clock = Instant::now();
        let done = with_threads(1, || simulator.trajectories(&source, &starts, &options, &Silent))?;
        best = best.min(clock.elapsed().as_secs_f64());
        last = done.into_iter().flatten().next().map_or_else(Vec::new, |trajectory| trajectory.state(STEPS).to_vec());
    }
    Ok((best * 1e9 / (STARTS * STEPS) as f64, last))
}

/// Nanoseconds a step of the compiled code, and its largest difference from `last`; `None` without a compiler.
fn compiled(model: &Model, last: &[f64]) -> Result<Option<(f64, f64)>, Box<dyn Error>> {
    if Command::new("cc").arg("--version").output().is_err() {
        return Ok(None);
    }
    let folder = tempfile::tempdir()?;
    let mut options = ExportOptions::new(Target::C);
    options.method = StepMethod::Euler;
    for file in export(model, &options, &[])?.files {
        std::fs::write(folder.path().join(file.name), file.bytes)?;
    }
    std::fs::write(folder.path().join("bench.c"), program(model))?;
    let arguments = ["-std=c99", "-O2", "-D_POSIX_C_SOURCE=199309L", "model.c", "bench.c", "-o", "bench", "-lm"];
    let built = Command::new("cc").current_dir(folder.path()).args(arguments).output()?;
    if !built.status.success() {
        return Err(String::from_utf8_lossy(&built.stderr).into_owned().into());
    }
    let output = run(&folder.path().join("bench"))?;
    let mut numbers = output.split_whitespace().map(str::parse::<f64>);
    let nanoseconds = numbers.next().ok_or("the program says nothing")??;
    let mut difference = 0.0f64;
    for (value, expected) in numbers.zip(last) {
        difference = difference.max((value? - expected).abs());
    }
    Ok(Some((nanoseconds, difference)))
}

fn run(program: &Path) -> Result<String, Box<dyn Error>> {
    Ok(String::from_utf8(Command::new(program).output()?.stdout)?)
}

/// C that steps the model over and over, and prints nanoseconds a step and the last states.
fn program(model: &Model) -> String {
    let states = model.latents.len();
    let inputs = model.columns.len() - states;
    let list = |count: usize, value: fn(usize) -> f64| {
        (0..count).map(|i| format!("{:?}", value(i))).collect::<Vec<_>>().join(", ")
    };
    let mut text = String::from("#include \"model.h\"\n#include <stdio.h>\n#include <time.h>\n");
    let _ = writeln!(text, "static const double x0[{states}] = {{{}}};", list(states, start));
    if inputs > 0 {
        let _ = writeln!(text, "static const double u[{inputs}] = {{{}}};", list(inputs, input));
    }
    let arguments = if inputs > 0 { "&m, u, " } else { "&m, " };
    let _ = write!(
        text,
        "int main(void)\n{{\n    model_model m;\n    double best = 1e30;\n    for (int run = 0; run < 5; ++run) {{\n        struct timespec a, b;\n        clock_gettime(CLOCK_MONOTONIC, &a);\n        for (int start = 0; start < {STARTS}; ++start) {{\n            model_init(&m, x0);\n            for (int k = 0; k < {STEPS}; ++k) {{\n                if (model_step({arguments}{DT:?}) <= MODEL_NOT_FINITE) {{\n                    return 1;\n                }}\n            }}\n        }}\n        clock_gettime(CLOCK_MONOTONIC, &b);\n        const double s = (double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec);\n        best = s < best ? s : best;\n    }}\n    printf(\"%.3f\\n\", best * 1e9 / {STARTS}.0 / {STEPS}.0);\n    for (int i = 0; i < {states}; ++i) {{\n        printf(\"%.17g\\n\", m.x[i]);\n    }}\n    return 0;\n}}\n"
    );
    text
}
