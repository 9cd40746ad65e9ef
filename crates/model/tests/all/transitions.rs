//! Tables of transitions in exported code hold the model's numbers to the bit.

use std::process::Command;

use fleetfoot_model::{ExportOptions, Model, Precision, Target, Transitions, export};

use crate::{
    export::{FLAGS, Folder, present},
    models,
};

/// Three regions that are left and come back, one that is never left, one whose rows are followed by none.
fn counts(most: u64) -> Vec<Vec<u64>> {
    vec![vec![70, 3, 0, 7, 1], vec![1, most, 2, 0, 0], vec![0, 0, 11, 0, 0], vec![2, 1, 0, 30, 0], vec![0, 0, 0, 0, 0]]
}

fn model(most: u64) -> Model {
    let mut model = models::pwa(5, 2);
    model.partitions[0].transitions = Some(Transitions { counts: counts(most) });
    model
}

/// What a program prints, one number a line: counts, shares, dwells.
fn printed(program: &mut Command) -> Vec<String> {
    let output = program.output().expect("a program");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text").lines().map(str::to_owned).collect()
}

fn build(compiler: &mut Command) {
    let output = compiler.output().expect("a compiler");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// The printed numbers are the model's, rounded to the code's precision.
fn compare(what: &str, printed: &[String], most: u64, precision: Precision) {
    let counts = counts(most);
    let transitions = Transitions { counts: counts.clone() };
    assert_eq!(printed.len(), 25 + 25 + 5, "{what}: {printed:?}");
    let expected: Vec<String> = counts.iter().flatten().map(u64::to_string).collect();
    assert_eq!(printed[..25], expected, "{what}");
    let shares = (0..25).map(|at| transitions.probability(at / 5, at % 5));
    let expected: Vec<f64> = shares.chain((0..5).map(|region| transitions.dwell(region))).collect();
    assert!(expected[20].is_nan() && expected[25 + 2] == f64::INFINITY && expected[25 + 4].is_nan(), "no hard case");
    for (text, expected) in printed[25..].iter().zip(expected) {
        // C may print a sign of what is no number.
        let value: f64 = text.trim_start_matches("-nan").parse().unwrap_or(f64::NAN);
        let expected = if precision == Precision::Float { f64::from(expected as f32) } else { expected };
        let same = value.to_bits() == expected.to_bits() || (value.is_nan() && expected.is_nan());
        assert!(same, "{what}: {text} is not {expected:?}");
    }
}

/// A count that fits 32 bits, and one that does not.
const MOST: [u64; 2] = [4_000_000_000, 5_000_000_000_000];

#[test]
fn c_has_them_in_a_source_of_its_own() {
    if !present("cc") {
        return;
    }
    let folder = Folder::new("transitions-c");
    let main = "#include \"robot.h\"\n#include <inttypes.h>\n#include <stdio.h>\nint main(void) {\n    enum { N = ROBOT_REGION_COUNT };\n    for (int i = 0; i < N * N; i++) printf(\"%\" PRIu64 \"\\n\", (uint64_t)robot_transition_count[i / N][i % N]);\n    for (int i = 0; i < N * N; i++) printf(\"%.17g\\n\", (double)robot_transition_probability[i / N][i % N]);\n    for (int i = 0; i < N; i++) printf(\"%.17g\\n\", (double)robot_dwell[i]);\n    return 0;\n}\n";
    std::fs::write(folder.0.join("main.c"), main).expect("written");
    for most in MOST {
        for precision in [Precision::Double, Precision::Float] {
            let mut options = ExportOptions::new(Target::C);
            (options.prefix, options.precision) = ("robot".into(), precision);
            let files = export(&model(most), &options, &[]).expect("code").files;
            let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
            assert_eq!(names, ["robot.h", "robot.c", "robot_transitions.c", "robot_test.c"]);
            for file in &files {
                std::fs::write(folder.0.join(&file.name), &file.bytes).expect("written");
            }
            // The model's own code does without them.
            let mut compiler = Command::new("cc");
            build(compiler.current_dir(&folder.0).args(FLAGS).args(["robot.c", "robot_test.c", "-o", "test", "-lm"]));
            let mut compiler = Command::new("cc");
            let sources = ["main.c", "robot_transitions.c", "-o", "main"];
            build(compiler.current_dir(&folder.0).args(FLAGS).args(sources));
            let what = format!("{precision:?}, {most}");
            compare(&what, &printed(&mut Command::new(folder.0.join("main"))), most, precision);
        }
    }
}

#[test]
fn rust_has_them_as_constants() {
    if !present("rustc") {
        return;
    }
    let folder = Folder::new("transitions-rust");
    let main = "#![allow(dead_code)]\nmod robot;\nfn main() {\n    for n in robot::TRANSITION_COUNT.iter().flatten() { println!(\"{n}\"); }\n    for v in robot::TRANSITION_PROBABILITY.iter().flatten().chain(&robot::DWELL) { println!(\"{:?}\", *v as f64); }\n}\n";
    std::fs::write(folder.0.join("main.rs"), main).expect("written");
    for (most, precision) in [(MOST[0], Precision::Double), (MOST[1], Precision::Float)] {
        let mut options = ExportOptions::new(Target::Rust);
        (options.prefix, options.precision) = ("robot".into(), precision);
        let files = export(&model(most), &options, &[]).expect("code").files;
        let code = String::from_utf8(files[0].bytes.clone()).expect("text");
        let tables = code.split("pub const TRANSITION_COUNT").nth(1).and_then(|rest| rest.split("\n\n/// ").nth(2));
        assert!(tables.is_some_and(|dwell| dwell.contains("pub const DWELL")), "{code}");
        std::fs::write(folder.0.join("robot.rs"), code).expect("written");
        std::fs::write(folder.0.join("libm.rs"), crate::export::LIBM).expect("written");
        let mut compiler = Command::new("rustc");
        let library = ["--edition=2024", "--crate-type=rlib", "libm.rs"];
        build(compiler.current_dir(&folder.0).args(library));
        let mut compiler = Command::new("rustc");
        let program = ["--edition=2024", "-D", "warnings", "-L", ".", "--extern", "libm", "main.rs"];
        build(compiler.current_dir(&folder.0).args(program));
        compare("Rust", &printed(&mut Command::new(folder.0.join("main"))), most, precision);
    }
}

#[test]
fn python_has_them_as_tuples() {
    if !present("python3") {
        return;
    }
    let folder = Folder::new("transitions-python");
    let mut options = ExportOptions::new(Target::Python);
    options.prefix = "robot".into();
    let files = export(&model(MOST[1]), &options, &[]).expect("code").files;
    std::fs::write(folder.0.join("robot.py"), &files[0].bytes).expect("written");
    let program = "import robot\nfor row in robot.TRANSITION_COUNT + robot.TRANSITION_PROBABILITY + (robot.DWELL,):\n    for value in row: print(repr(value))\n";
    let mut python = Command::new("python3");
    let printed = printed(python.current_dir(&folder.0).args(["-W", "error", "-B", "-c", program]));
    compare("Python", &printed, MOST[1], Precision::Double);
}

#[test]
fn numpy_reads_them() {
    let Some(python) = crate::outside::python("numpy") else { return };
    let folder = Folder::new("transitions-npz");
    let mut options = ExportOptions::new(Target::Npz);
    options.prefix = "robot".into();
    let files = export(&model(MOST[1]), &options, &[]).expect("arrays").files;
    std::fs::write(folder.0.join("robot.npz"), &files[0].bytes).expect("written");
    let program = "import numpy as np\na = np.load('robot.npz')\nt = 'partition/0/transitions/'\nassert a[t + 'count'].shape == a[t + 'probability'].shape == (5, 5) and a[t + 'dwell'].shape == (5,)\nfor name in ('count', 'probability', 'dwell'):\n    for value in a[t + name].ravel().tolist(): print(repr(value))\n";
    let printed = printed(Command::new(python).current_dir(&folder.0).args(["-c", program]));
    compare("NumPy", &printed, MOST[1], Precision::Double);
}

/// Without counts nothing changes, and neither does anything but the tables with them.
#[test]
fn a_model_without_counts_has_no_tables() {
    let without = models::pwa(5, 2);
    for target in [Target::C, Target::Rust, Target::Python] {
        let text = |model: &Model, name: usize| {
            let files = export(model, &ExportOptions::new(target), &[]).expect("code").files;
            String::from_utf8(files[name].bytes.clone()).expect("text")
        };
        assert!(!text(&without, 0).to_lowercase().contains("transition_count"));
        if target == Target::C {
            assert_eq!(export(&without, &ExportOptions::new(target), &[]).expect("code").files.len(), 3);
            let functions = |text: String| text.split("#include <float.h>").nth(1).map(str::to_owned);
            assert_eq!(functions(text(&without, 1)), functions(text(&model(9), 1)));
        }
    }
}
