//! Exported code gives the engine's values: next states of rollouts, predictions, regions, the training domain.

#[path = "../../../model/tests/all/models.rs"]
pub(crate) mod models;

use std::process::Command;

use fleetfoot::{
    codegen::{ExportOptions, Precision, StepMethod, Target},
    engine_vectors, export,
    model::Prediction,
};

#[test]
fn code_and_engine_agree_on_every_kind_of_model() {
    let (mut left, mut unseen, mut vectors) = (0, 0, 0);
    for (name, model) in models::all() {
        let continuous = model.equations.iter().any(|equation| equation.prediction == Prediction::Derivative);
        for (method, step) in [(StepMethod::Rk4, None), (StepMethod::Euler, None), (StepMethod::Rk4, Some(0.05))] {
            let mut options = ExportOptions::new(Target::C);
            options.method = method;
            options.discretize = step.filter(|_| continuous);
            // The values are refused where they differ by more than 64-bit rounding.
            let compared = engine_vectors(&model, &options, 48, 11).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert!(compared.len() > 24, "{name}: {} vectors", compared.len());
            vectors += compared.len();
            for result in compared.iter().flat_map(|vector| &vector.results) {
                left += usize::from(result.code < 0 && result.code > -32766);
                unseen += usize::from(result.code == -32767);
                let relative = result.values.iter().zip(&result.tolerances).map(|(v, t)| t / v.abs().max(1.0));
                // Cancellation costs some: 1e-12 is what stays of 1.1e-16 for values of order one.
                let worst = relative.fold(0.0, f64::max);
                assert!(worst < 1e-10, "{name} {}: a tolerance of {worst:e}", result.function);
            }
        }
    }
    assert!(vectors > 1500 && left > 100, "{vectors} vectors, {left} outside");
    assert_eq!(unseen, 0, "labels are drawn among those seen");
}

#[test]
fn the_test_of_exported_c_compares_with_the_engine() {
    if Command::new("cc").arg("--version").output().is_err() {
        eprintln!("no `cc` on this machine: exported code is not compiled");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let mut options = ExportOptions::new(Target::C);
    options.prefix = "robot".into();
    options.precision = Precision::Float;
    let exported = export(&models::pwa(50, 3), &options, folder.path(), &[]).expect("code");
    assert_eq!(exported.files.len(), 3);
    assert!(exported.compared >= 24);
    let cc = Command::new("cc")
        .current_dir(folder.path())
        .args(["-std=c99", "-Wall", "-Wextra", "-Wdouble-promotion", "-Wfloat-equal", "-Wshadow", "-Wconversion"])
        .args(["-Werror", "robot.c", "robot_test.c", "-o", "robot", "-lm"])
        .output()
        .expect("cc");
    assert!(cc.status.success(), "{}", String::from_utf8_lossy(&cc.stderr));
    let run = Command::new(folder.path().join("robot")).output().expect("the test");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stdout));
    // A wrong constant does not go unnoticed: yaw' = 3 w.
    let source = std::fs::read_to_string(folder.path().join("robot.c")).expect("the source");
    let wrong = source.replace("3.0f * ", "3.1f * ");
    assert_ne!(wrong, source);
    std::fs::write(folder.path().join("robot.c"), wrong).expect("written");
    let cc = Command::new("cc")
        .current_dir(folder.path())
        .args(["-std=c99", "robot.c", "robot_test.c", "-o", "robot", "-lm"])
        .status();
    assert!(cc.expect("cc").success());
    assert!(!Command::new(folder.path().join("robot")).output().expect("the test").status.success());
}
