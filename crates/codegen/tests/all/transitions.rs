//! Tables of transitions in exported code hold the model's numbers to the bit.

use std::process::Command;

use fleetfoot_codegen::{ExportOptions, Precision, Target, export};
use fleetfoot_model::{Model, Transitions};

use crate::{
    counted::{counts, model, phases},
    export::{FLAGS, Folder, present},
    models,
};

/// All whole numbers of the tables in their order, then all others.
fn expected(most: u64) -> (Vec<u64>, Vec<f64>) {
    let (transitions, phases) = (Transitions { counts: counts(most) }, phases(most));
    let mut passages = vec![0; 50];
    for passage in &phases.passages {
        passages[(passage.bin * 25 + passage.from * 5 + passage.to) as usize] = passage.rows;
    }
    let mut counts: Vec<u64> = transitions.counts.iter().chain(&phases.rows).flatten().copied().collect();
    counts.extend(passages);
    counts.extend(phases.strides.iter().flatten());
    let mut reals: Vec<f64> = (0..25).map(|at| transitions.probability(at / 5, at % 5)).collect();
    reals.extend((0..5).map(|region| transitions.dwell(region)));
    reals.extend((0..10).map(|at| phases.share(at / 5, at % 5)));
    reals.extend((0..25).map(|at| phases.stride_probability(at / 5, at % 5)));
    let p = |at: usize| match (at / 5, at % 5) {
        (0, 1) | (1, 0) => 0.25,
        (0, 4) | (4, 0) => 1e-12,
        _ => f64::NAN,
    };
    reals.extend((0..25).map(p));
    (counts, reals)
}

/// Output of a program, one number a line: counts, shares, dwells.
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
    let (counts, reals) = expected(most);
    assert_eq!(printed.len(), counts.len() + reals.len(), "{what}: {printed:?}");
    let (whole, others) = printed.split_at(counts.len());
    assert_eq!(whole, counts.iter().map(u64::to_string).collect::<Vec<String>>(), "{what}");
    assert!(reals[20].is_nan() && reals[25 + 2] == f64::INFINITY && reals[35].is_nan(), "no hard case");
    for (text, expected) in others.iter().zip(reals) {
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
fn transitions_have_a_separate_c_source() {
    if !present("cc") {
        return;
    }
    let folder = Folder::new("transitions-c");
    let main = "#include \"robot.h\"\n#include <inttypes.h>\n#include <stdio.h>\n\
        #define COUNTS(table, type) for (size_t i = 0; i < sizeof(table) / sizeof(type); i++) printf(\"%\" PRIu64 \"\\n\", (uint64_t)((const type *)table)[i])\n\
        #define REALS(table, type) for (size_t i = 0; i < sizeof(table) / sizeof(type); i++) printf(\"%.17g\\n\", (double)((const type *)table)[i])\n\
        int main(void) {\n    COUNTS(robot_transition_count, WIDE);\n    COUNTS(robot_phase_rows, WIDE);\n    COUNTS(robot_phase_transition_count, WIDE);\n\
            COUNTS(robot_stride_count, uint32_t);\n    REALS(robot_transition_probability, REAL);\n    REALS(robot_dwell, REAL);\n    REALS(robot_phase_share, REAL);\n\
            REALS(robot_stride_probability, REAL);\n    REALS(robot_difference_p, REAL);\n    return ROBOT_PHASE_BIN_COUNT - 2;\n}\n";
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
            let wide = if most > u64::from(u32::MAX) { "-DWIDE=uint64_t" } else { "-DWIDE=uint32_t" };
            let real = if precision == Precision::Double { "-DREAL=double" } else { "-DREAL=float" };
            build(compiler.current_dir(&folder.0).args(FLAGS).args([wide, real]).args(sources));
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
    let main = "#![allow(dead_code)]\nmod robot;\nuse robot::*;\nfn main() {\n    for n in TRANSITION_COUNT.iter().flatten().chain(PHASE_ROWS.iter().flatten()) { println!(\"{n}\"); }\n\
        for n in PHASE_TRANSITION_COUNT.iter().flatten().flatten() { println!(\"{n}\"); }\n    for n in STRIDE_COUNT.iter().flatten() { println!(\"{n}\"); }\n\
        for v in TRANSITION_PROBABILITY.iter().flatten().chain(&DWELL).chain(PHASE_SHARE.iter().flatten()).chain(STRIDE_PROBABILITY.iter().flatten()).chain(DIFFERENCE_P.iter().flatten()) { println!(\"{:?}\", *v as f64); }\n}\n";
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
    let program = "import robot as r\ncounts = r.TRANSITION_COUNT + r.PHASE_ROWS + sum(r.PHASE_TRANSITION_COUNT, ()) + r.STRIDE_COUNT\n\
        reals = r.TRANSITION_PROBABILITY + (r.DWELL,) + r.PHASE_SHARE + r.STRIDE_PROBABILITY + r.DIFFERENCE_P\nfor row in counts + reals:\n    for value in row: print(repr(value))\n";
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
    let program = "import numpy as np\na = np.load('robot.npz')\nt = 'partition/0/'\n\
        assert a[t + 'phase/transition_count'].shape == (2, 5, 5) and a[t + 'phase/share'].shape == (2, 5) and a[t + 'transitions/dwell'].shape == (5,)\n\
        assert a[t + 'phase/bins'].tolist() == ['0.00..0.50', '0.50..1.00']\n\
        for name in ('transitions/count', 'phase/rows', 'phase/transition_count', 'stride/count', 'transitions/probability', 'transitions/dwell', 'phase/share', 'stride/probability', 'pairs/p'):\n    for value in a[t + name].ravel().tolist(): print(repr(value))\n";
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
