//! Exported code compiles without a warning and gives the model's values.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use fleetfoot_codegen::{
    ExportOptions, Precision, StepMethod, Target, TestVector, evaluate_at, export, signals, test_vectors,
};
use fleetfoot_library::Expr;
use fleetfoot_model::{Model, Prediction, Role};

use crate::models;

/// Strict C, as in a certified project's build.
pub(crate) const FLAGS: [&str; 10] = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wdouble-promotion",
    "-Wfloat-equal",
    "-Wshadow",
    "-Wconversion",
    "-pedantic",
    "-Werror",
    "-O0",
];

/// A folder of a test, removed when it is done.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    pub(crate) fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("fleetfoot-export-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a folder for the test");
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if std::env::var_os("FLEETFOOT_KEEP").is_none() {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }
}

/// Returns true if a program is there; prints a line if it is not.
pub(crate) fn present(program: &str) -> bool {
    let is_installed = Command::new(program).arg("--version").output().is_ok();
    if !is_installed {
        eprintln!("no `{program}` on this machine: exported code is not compiled");
    }
    is_installed
}

/// Runs a program; returns its output if it fails.
fn run(command: &mut Command, what: &str) -> Result<(), String> {
    let output = command.output().map_err(|error| format!("{what}: {error}"))?;
    let text = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    if output.status.success() {
        Ok(())
    } else {
        Err(format!("{what}\n{}", text.chars().take(2500).collect::<String>()))
    }
}

fn write(model: &Model, options: &ExportOptions, folder: &Path) {
    let vectors = test_vectors(model, options, 24, 7).expect("vectors");
    assert!(vectors.len() >= 12, "{}: only {} vectors", options.prefix, vectors.len());
    for file in export(model, options, &vectors).expect("code").files {
        std::fs::write(folder.join(&file.name), &file.bytes).expect("written");
    }
}

#[test]
fn c_compiles_without_a_warning_and_agrees() {
    if !present("cc") {
        return;
    }
    let folder = Folder::new("c");
    let mut failures = Vec::new();
    for (index, (name, model)) in models::all().into_iter().enumerate() {
        let float = [(Precision::Float, StepMethod::Euler, None), (Precision::Float, StepMethod::Rk4, Some(0.02))];
        for (precision, method, step) in [(Precision::Double, StepMethod::Rk4, None), float[index % 2]] {
            let continuous = model.equations.iter().any(|e| e.prediction == Prediction::Derivative);
            let mut options = ExportOptions::new(Target::C);
            options.prefix = name.to_owned();
            (options.precision, options.method) = (precision, method);
            options.discretize = step.filter(|_| continuous);
            write(&model, &options, &folder.0);
            let (source, test) = (format!("{name}.c"), format!("{name}_test.c"));
            let mut compiler = Command::new("cc");
            compiler.current_dir(&folder.0).args(FLAGS).args([&source, &test, "-o", "program", "-lm"]);
            let what = format!("{name} {precision:?} {method:?}");
            let done = run(&mut compiler, &what).and_then(|()| run(&mut Command::new(folder.0.join("program")), &what));
            failures.extend(done.err());
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}

/// A crate `libm` over the standard library, so that nothing is fetched.
pub(crate) const LIBM: &str = "
macro_rules! unary { ($($name:ident $float:ident $method:ident,)*) => { $(
    pub fn $name(x: f64) -> f64 { x.$method() }
    pub fn $float(x: f32) -> f32 { x.$method() }
)* } }
unary! { sin sinf sin, cos cosf cos, tan tanf tan, asin asinf asin, acos acosf acos, atan atanf atan, sinh sinhf sinh,
    cosh coshf cosh, tanh tanhf tanh, exp expf exp, log logf ln, sqrt sqrtf sqrt, ceil ceilf ceil, }
pub fn pow(x: f64, y: f64) -> f64 { x.powf(y) }
pub fn powf(x: f32, y: f32) -> f32 { x.powf(y) }
pub fn atan2(x: f64, y: f64) -> f64 { x.atan2(y) }
pub fn atan2f(x: f32, y: f32) -> f32 { x.atan2(y) }
";

#[test]
fn rust_compiles_without_a_warning_and_agrees() {
    if !present("rustc") {
        return;
    }
    let folder = Folder::new("rust");
    let compile = |arguments: &[&str], what: &str| {
        let mut compiler = Command::new("rustc");
        compiler.current_dir(&folder.0).args(["--edition=2024", "-D", "warnings", "-L", "."]).args(arguments);
        run(&mut compiler, what)
    };
    std::fs::write(folder.0.join("libm.rs"), LIBM).expect("written");
    compile(&["--crate-type=rlib", "libm.rs"], "libm").expect("libm");
    // One crate of all modules in each precision, without the standard library, and one program.
    for (precision, real) in [(Precision::Double, "f64"), (Precision::Float, "f32")] {
        let (mut crate_text, mut main) = (String::from("#![no_std]\n"), String::new());
        for (name, model) in models::all() {
            let mut options = ExportOptions::new(Target::Rust);
            options.prefix = name.to_owned();
            options.precision = precision;
            write(&model, &options, &folder.0);
            crate_text += &format!("pub mod {name};\n");
            main += &rust_checks(name, &model, &options, real);
        }
        std::fs::write(folder.0.join("all.rs"), crate_text).expect("written");
        let program = format!(
            "fn close(what: &str, got: &[{real}], expected: &[{real}], room: &[{real}]) {{\n    for i in 0..got.len() {{\n        assert!((got[i] - expected[i]).abs() <= room[i], \"{{what}} {{i}}: {{}} is not {{}}\", got[i], expected[i]);\n    }}\n}}\nfn main() {{\n{main}}}\n"
        );
        std::fs::write(folder.0.join("main.rs"), program).expect("written");
        compile(&["--crate-type=rlib", "--extern", "libm", "all.rs"], real).unwrap_or_else(|error| panic!("{error}"));
        compile(&["--extern", "all", "main.rs"], real).unwrap_or_else(|error| panic!("{error}"));
        run(&mut Command::new(folder.0.join("main")), real).unwrap_or_else(|error| panic!("{error}"));
    }
}

fn list(values: &[f64], real: &str) -> String {
    let texts: Vec<String> = values
        .iter()
        .map(|&value| if real == "f32" { format!("{:?}", value as f32) } else { format!("{value:?}") })
        .collect();
    format!("[{}]", texts.join(", "))
}

/// Rust that compares the first vectors with their expected values.
fn rust_checks(name: &str, model: &Model, options: &ExportOptions, real: &str) -> String {
    let names = signals(model, options).expect("signals");
    let mut out = String::new();
    for vector in test_vectors(model, options, 4, 7).expect("vectors") {
        let find = |function: &str| vector.results.iter().find(|result| result.function == function);
        let (function, result) = match (find("next"), find("predict")) {
            (Some(result), _) => ("next", result),
            (None, Some(result)) => ("predict", result),
            (None, None) => panic!("{name}: nothing to compare"),
        };
        let remembers = !vector.past.is_empty() || name == "timed";
        let continuous = model.equations.iter().any(|e| e.prediction == Prediction::Derivative);
        out += &format!("    {{\n        let mut y = [0.0; {}];\n", result.values.len());
        let mut arguments = Vec::new();
        if remembers {
            let fields = [("x", &vector.x, names.states.len()), ("past", &vector.past, vector.past.len())];
            let mut fields: Vec<String> = fields
                .iter()
                .filter(|field| field.2 > 0)
                .map(|(field, values, _)| format!("{field}: {}", list(values, real)))
                .collect();
            if name == "timed" {
                fields.push(format!("t: {:?}", vector.t as f32));
            }
            out += &format!("        let m = all::{name}::Model {{ {} }};\n", fields.join(", "));
        } else if !vector.x.is_empty() {
            arguments.push(format!("&{}", list(&vector.x, real)));
        }
        if !vector.u.is_empty() {
            arguments.push(format!("&{}", list(&vector.u, real)));
        }
        if names.next_inputs {
            arguments.push(format!("&{}", list(&vector.u_next, real)));
        }
        if function == "next" && continuous {
            arguments.push(list(&[vector.dt], real).trim_matches(['[', ']']).to_owned());
        }
        arguments.push("&mut y".into());
        let callee = if remembers { format!("m.{function}") } else { format!("all::{name}::{function}") };
        out += &format!("        assert_eq!({callee}({}), {}, \"{name}\");\n", arguments.join(", "), result.code);
        if result.code > -32766 {
            out += &format!(
                "        close(\"{name}\", &y, &{}, &{});\n",
                list(&result.values, real),
                list(&result.tolerances, real)
            );
        }
        out += "    }\n";
    }
    out
}

#[test]
fn python_agrees() {
    if !present("python3") {
        return;
    }
    let folder = Folder::new("python");
    let mut program = String::from("import math\n");
    for (name, model) in models::all() {
        let mut options = ExportOptions::new(Target::Python);
        options.prefix = name.to_owned();
        write(&model, &options, &folder.0);
        program += &format!("import {name}\n");
        let class: String = name.split('_').map(|part| part[..1].to_uppercase() + &part[1..]).collect();
        for vector in test_vectors(&model, &options, 6, 7).expect("vectors") {
            let start = if vector.x.is_empty() { String::new() } else { list(&vector.x, "f64") };
            program += &format!("m = {name}.{class}({start})\n");
            if !vector.past.is_empty() {
                program += &format!("m.past = {}\n", list(&vector.past, "f64"));
            }
            program += &format!("m.t = {:?}\n", vector.t);
            for result in &vector.results {
                let continuous = model.equations.iter().any(|e| e.prediction == Prediction::Derivative);
                let mut arguments = Vec::new();
                if !vector.u.is_empty() {
                    arguments.push(list(&vector.u, "f64"));
                }
                if !vector.u_next.is_empty() {
                    arguments.push(list(&vector.u_next, "f64"));
                }
                if result.function.starts_with("next") && continuous {
                    arguments.push(format!("{:?}", vector.dt));
                }
                let call = format!("m.{}({})", result.function, arguments.join(", "));
                program += &format!("code, *out = {call}\nassert code == {}, ('{name}', code)\n", result.code);
                if result.code > -32766 {
                    program += &format!(
                        "out = [v for part in out for v in part]\nfor v, e, r in zip(out, {}, {}, strict=True):\n    assert abs(v - e) <= r, ('{name} {}', v, e, r)\n",
                        list(&result.values, "f64"),
                        list(&result.tolerances, "f64"),
                        result.function
                    );
                }
            }
        }
    }
    std::fs::write(folder.0.join("check.py"), program).expect("written");
    let mut python = Command::new("python3");
    python.current_dir(&folder.0).args(["-W", "error", "-B", "check.py"]);
    run(&mut python, "python").unwrap_or_else(|error| panic!("{error}"));
}

/// 200 regions of 30 columns: tables, not a program that grows with them.
#[test]
fn large_models_are_tables() {
    let names: Vec<String> = (0..30).map(|i| format!("c{i}")).collect();
    let columns: Vec<(&str, Role)> = names.iter().map(|name| (name.as_str(), Role::State)).collect();
    let mut maker = models::Maker::new(20, "pwa kmeans:200", &columns);
    let functions: Vec<&str> = names.iter().map(String::as_str).collect();
    let library = maker.library(&functions);
    let rule = maker.voronoi(200, 30);
    let partition = maker.partition("kmeans:200", &functions, rule);
    for name in &names[..12] {
        let latent = format!("f_{name}");
        maker.latent(&latent, library, partition, 1.0);
        maker.equation(name, Prediction::Derivative, &latent);
    }
    let model = maker.finish();
    let mut options = ExportOptions::new(Target::C);
    options.precision = Precision::Float;
    let exported = export(&model, &options, &[]).expect("code");
    let cost = exported.cost.expect("a cost");
    // Weights, offsets, centre, scale; constants, coefficients; low and high; function and variable of each slope.
    let expected = 4 * (200 * 30 + 200 + 60 + 200 * 12 + 200 * 12 * 30 + 2 * 200 * 30) + 60;
    assert_eq!(cost.tables, expected);
    assert_eq!(cost.model, 4 * 12);
    let right_sides = cost.calls.iter().find(|call| call.0 == "right_sides").expect("right sides").1;
    // The search, the standardisation, the map.
    assert_eq!(right_sides.multiplications, 200 * 30 + 30 + 12 * 30);
    let source = exported.files.iter().find(|file| file.name == "model.c").expect("a source");
    let code = String::from_utf8_lossy(&source.bytes);
    assert!(code.lines().filter(|line| line.contains(" = ")).count() < 400);
}

#[test]
fn unexportable_models_are_refused_with_reason() {
    let refused = |model: &Model, options: &ExportOptions| {
        export(model, options, &[]).expect_err("it cannot be exported").to_string()
    };
    let with = |change: &dyn Fn(&mut ExportOptions)| {
        let mut options = ExportOptions::new(Target::C);
        change(&mut options);
        options
    };
    let options = with(&|_| ());
    let sindy = |change: &dyn Fn(&mut Model)| {
        let mut model = models::sindy();
        change(&mut model);
        model
    };
    // A function that is in use, whatever was drawn.
    let used =
        models::sindy().latents[0].affine().unwrap().coefficients[0].iter().position(|v| *v != 0.0).expect("a term");
    assert!(refused(&sindy(&|m| m.latents[0].map.set(0, Some(used), f64::NAN)), &options).contains("NaN"));
    let large = sindy(&|m| m.latents[0].map.set(0, None, 1e60));
    assert!(refused(&large, &with(&|o| o.precision = Precision::Float)).contains("32 bits"));
    assert!(export(&large, &options, &[]).is_ok());
    let ahead = sindy(&|m| m.libraries[0][used] = Expr::lagged("u", -1));
    assert!(refused(&ahead, &options).contains("`u` 1 rows ahead"));
    let lagged = sindy(&|m| m.equations[0].right = Expr::lagged("f_x", 1));
    assert!(refused(&lagged, &options).contains("`f_x` 1 rows earlier"));
    let twice = sindy(&|m| {
        let mut given = m.equations[0].clone();
        given.target = None;
        m.equations.push(given);
    });
    assert!(refused(&twice, &options).contains("two equations advance `x`"));
    let empty = sindy(&|m| {
        m.equations.clear();
        m.training.target_mean.clear();
        m.training.target_covariance.clear();
        m.training.target_deviation.clear();
        m.summaries[0].regions[0].residual_covariance.clear();
    });
    assert!(refused(&empty, &options).contains("no equation"));
    assert!(refused(&models::sindy(), &with(&|o| o.prefix = "while".into())).contains("reserved"));
    assert!(refused(&models::sindy(), &with(&|o| o.discretize = Some(-1.0))).contains("step of -1"));
    let (_, narx) = models::all().into_iter().find(|(name, _)| *name == "narx").expect("a NARX model");
    assert!(refused(&narx, &with(&|o| o.discretize = Some(0.1))).contains("has a step already"));
}

/// The exact derivatives beside central differences of the same code's values, far from borders.
#[test]
fn derivatives_match_values() {
    let mut compared = 0;
    for (name, model) in models::all() {
        let mut options = ExportOptions::new(Target::Python);
        options.domain = false;
        for vector in test_vectors(&model, &options, 6, 3).expect("vectors") {
            for (slopes, value) in [("next_jacobian", "next"), ("predict_jacobian", "predict")] {
                compared += compare_slopes(name, &model, &options, &vector, slopes, value);
            }
        }
    }
    assert!(compared > 300, "{compared} derivatives");
}

fn compare_slopes(
    name: &str,
    model: &Model,
    options: &ExportOptions,
    vector: &TestVector,
    slopes: &str,
    value: &str,
) -> usize {
    let find = |vector: &TestVector, function: &str| {
        vector.results.iter().find(|result| result.function == function && result.code > -32766).cloned()
    };
    let Some(matrix) = find(vector, slopes) else { return 0 };
    let (n, m) = (vector.x.len(), vector.u.len());
    let rows = matrix.values.len() / (n + m + 1);
    let step = 1e-5;
    let mut compared = 0;
    for variable in 0..n + m {
        let at = |sign: f64| {
            let mut moved = vector.clone();
            *moved.x.iter_mut().chain(&mut moved.u).nth(variable).expect("a variable") += sign * step;
            find(&evaluate_at(model, options, vec![moved]).expect("values")[0], value)
        };
        // Nothing is compared across the border of a region.
        let (Some(low), Some(high)) = (at(-1.0), at(1.0)) else { continue };
        if low.code != high.code || low.code != matrix.code {
            continue;
        }
        for row in 0..rows {
            let exact = match variable.checked_sub(n) {
                None => matrix.values[row * n + variable],
                Some(input) => matrix.values[rows * n + row * m + input],
            };
            let rise = high.values[row] - low.values[row];
            // A turn of a wrapped angle is no slope.
            if rise.abs() > 1.0 {
                continue;
            }
            let difference = rise / (2.0 * step);
            // Truncation is step^2/6 times the third derivative, rounding about 1e-16/step: both below 1e-9 here.
            let room = 1e-6 * (1.0 + exact.abs());
            assert!((difference - exact).abs() < room, "{name} {slopes} {row},{variable}: {exact} is not {difference}");
            compared += 1;
        }
    }
    compared
}

#[test]
fn numpy_reads_the_arrays() {
    let Some(python) = crate::outside::python("numpy") else { return };
    let folder = Folder::new("npz");
    let model = models::pwa(5, 2);
    let mut options = ExportOptions::new(Target::Npz);
    options.prefix = "robot".into();
    write(&model, &options, &folder.0);
    let sum: f64 = model.latents[1].affine().unwrap().coefficients.iter().flatten().sum();
    let program = format!(
        "import numpy as np\na = np.load('robot.npz')\nc = a['latent/1/coefficients']\nassert c.shape == (5, 7) and abs(c.sum() - {sum:?}) < 1e-12\nassert list(a['columns/names'])[3] == 'yaw' and a['columns/units'][0] == 'm/s\\u00b2'\nassert a['partition/0/rule/weights'].shape == (5, 4) and a['step'] == 0.02\nassert a['partition/0/ranges'].shape == (5, 7, 2)\n"
    );
    run(Command::new(python).current_dir(&folder.0).args(["-c", &program]), "numpy").unwrap_or_else(|e| panic!("{e}"));
}

/// Braces and environments that are opened are closed, and no name is a command.
#[test]
fn latex_is_balanced() {
    for (name, model) in models::all() {
        let exported = export(&model, &ExportOptions::new(Target::Latex), &[]).expect("equations");
        let text = String::from_utf8_lossy(&exported.files[0].bytes).into_owned();
        let (mut depth, mut escaped) = (0i32, false);
        for c in text.chars() {
            depth += match c {
                '{' if !escaped => 1,
                '}' if !escaped => -1,
                _ => 0,
            };
            assert!(depth >= 0, "{name}\n{text}");
            escaped = c == '\\' && !escaped;
        }
        assert_eq!(depth, 0, "{name}\n{text}");
        for environment in ["align*", "cases", "array"] {
            let count = |word: &str| text.matches(&format!("\\{word}{{{environment}}}")).count();
            assert_eq!(count("begin"), count("end"), "{name}\n{text}");
        }
        assert_eq!(text.matches("\\left").count(), text.matches("\\right").count(), "{name}\n{text}");
        assert!(text.matches("&=").count() >= model.equations.len() + model.latents.len(), "{name}\n{text}");
    }
}
