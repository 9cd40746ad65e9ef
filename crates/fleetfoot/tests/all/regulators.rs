//! Regulators as C: every command of a run is the engine's.

use std::process::Command;

use fleetfoot::{
    ControlSchedule, ControlSection,
    codegen::{ExportOptions, Precision, Target},
    control::controller::{Controller, Regulator},
    control_lqr, export,
};

use crate::export::models;

/// Samples of a run.
const SAMPLES: usize = 500;

/// Pseudo-random numbers in [-1, 1), from a key.
fn noise(key: usize) -> f64 {
    let mut z = (key as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ (z >> 31)) as i64 as f64 / i64::MAX as f64
}

/// Measurements at a sample: all over the regions, now and then with a gap.
fn shown(law: &Regulator, sample: usize) -> Vec<f64> {
    let known: Vec<[f64; 2]> = (law.states.iter().map(|state| [state.at, state.size]))
        .chain(law.measured.iter().map(|column| [column.at, column.size]))
        .collect();
    let value = |i: usize| {
        let [at, size] = known.get(i).copied().unwrap_or([0.0, 1.0]);
        if sample % 37 == 11 && i == 0 { f64::NAN } else { at + 2.0 * size * noise(sample * 97 + i) }
    };
    (0..law.reads().len()).map(value).collect()
}

/// A program that runs the law on the same samples and prints the commands.
fn program(law: &Regulator, order: &[usize], start: &[f64]) -> String {
    let list = |values: &[f64]| {
        let texts = values.iter().map(|v| if v.is_nan() { "NAN".to_owned() } else { format!("{v:?}") });
        texts.collect::<Vec<_>>().join(", ")
    };
    let rows = (0..SAMPLES).map(|sample| {
        let columns = shown(law, sample);
        format!("    {{{}}}", list(&order.iter().map(|&i| columns[i]).collect::<Vec<_>>()))
    });
    format!(
        "#include \"law.h\"\n#include <math.h>\n#include <stdio.h>\n\nstatic const double shown[{SAMPLES}][LAW_INPUT_COUNT] = {{\n{}\n}};\n\nint main(void) {{\n    law_model m;\n    const double start[LAW_STATE_COUNT] = {{{}}};\n    law_init(&m, start);\n    for (int i = 0; i < {SAMPLES}; i++) {{\n        law_step(&m, shown[i]);\n        for (int j = 0; j < {}; j++) printf(\"%.17g \", m.x[j]);\n        printf(\"\\n\");\n    }}\n    return 0;\n}}\n",
        rows.collect::<Vec<_>>().join(",\n"),
        list(start),
        law.inputs.len()
    )
}

#[test]
fn c_gives_the_commands_of_the_engine() {
    if Command::new("cc").arg("--version").output().is_err() {
        eprintln!("no `cc` on this machine: exported code is not compiled");
        return;
    }
    // Five regions, decided by states, an angle and an input; two inputs; with integral action and limits, and without.
    let control_section = |integral: Option<&str>, limits: Option<&str>| ControlSection {
        integral: integral.map(str::to_owned),
        limits: limits.map(str::to_owned),
        free: Some("px".to_owned()),
        schedule: Some(ControlSchedule::Region),
        ..ControlSection::default()
    };
    for section in
        [control_section(None, None), control_section(Some("yaw=3,vx=1"), Some("left=-0.4:0.5,right=-0.6:0.6"))]
    {
        let made = control_lqr(&models::pwa(5, 1), &section).expect("a law");
        let law = &made.law;
        assert!(law.laws.len() > 1, "a law for every region");
        let folder = tempfile::tempdir().expect("a folder");
        let mut options = ExportOptions::new(Target::C);
        options.prefix = "law".into();
        options.domain = false;
        options.precision = Precision::Double;
        let model = made.law_model().expect("a model");
        let exported = export(&model, &options, folder.path(), &[]).expect("code");
        assert!(exported.compared >= 24, "{}", exported.compared);
        let signals = fleetfoot::codegen::signals(&model, &options).expect("signals");
        let reads = law.reads();
        let order: Vec<usize> = (signals.inputs.iter())
            .map(|name| reads.iter().position(|read| read == name).expect("what the law reads"))
            .collect();
        let mut start = vec![0.1; law.inputs.len()];
        start.resize(signals.states.len(), 0.0);
        std::fs::write(folder.path().join("main.c"), program(law, &order, &start)).expect("written");
        let cc = Command::new("cc")
            .current_dir(folder.path())
            .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", "law.c", "main.c", "-o", "run", "-lm"])
            .output()
            .expect("cc");
        assert!(cc.status.success(), "{}", String::from_utf8_lossy(&cc.stderr));
        let run = Command::new(folder.path().join("run")).output().expect("a run");
        let printed = String::from_utf8(run.stdout).expect("numbers");
        let (mut state, mut inputs) = (law.start(), vec![0.1; law.inputs.len()]);
        let (mut worst, mut lines) = (0.0f64, 0);
        for (sample, line) in printed.lines().enumerate() {
            state.control(sample as f64 * law.period, &shown(law, sample), &mut inputs);
            let commands: Vec<f64> = line.split_whitespace().map(|text| text.parse().expect("a number")).collect();
            assert_eq!(commands.len(), inputs.len());
            for (a, b) in commands.iter().zip(&inputs) {
                worst = worst.max((a - b).abs() / b.abs().max(1.0));
            }
            lines += 1;
        }
        assert_eq!(lines, SAMPLES);
        // Sums of the same few terms in another order, with integrals over 500 samples.
        assert!(worst < 1e-12, "{worst:e}");
    }
}
