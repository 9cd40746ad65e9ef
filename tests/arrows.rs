//! The crate arrows of the design are law: this table is the design's, and any other arrow fails.

mod circles;
mod words;

use std::{collections::BTreeSet, fs, path::Path, process::Command};

/// Crate, and the crates of the workspace that it may use.
const ARROWS: [(&str, &[&str]); 32] = [
    // No code: the features of third-party crates.
    ("fleetfoot-features", &[]),
    ("fleetfoot-data", &["features"]),
    ("fleetfoot-library", &["data"]),
    ("fleetfoot-stats", &["data", "library"]),
    ("fleetfoot-model", &["data", "library"]),
    ("fleetfoot-dynamics", &["data", "library", "stats", "model"]),
    ("fleetfoot-control", &["data", "library", "stats", "model", "dynamics"]),
    // The numbers of a filter are those of `control`.
    ("fleetfoot-codegen", &["data", "library", "stats", "model", "control"]),
    ("fleetfoot-message", &["data"]),
    ("fleetfoot-signal", &["data"]),
    // Networks of numbers: of models it knows nothing.
    ("fleetfoot-learn", &["data"]),
    ("fleetfoot-output", &["message"]),
    // The metadata that a writer puts into a file.
    ("fleetfoot-log", &["data", "message", "output"]),
    ("fleetfoot-sums", &["data", "library", "stats", "model"]),
    ("fleetfoot-sparse", &["data", "library", "stats", "sums"]),
    ("fleetfoot-pwa", &["data", "library", "stats", "model", "sums"]),
    ("fleetfoot-estimate", &["data", "library", "stats", "model", "dynamics"]),
    // Simulated robots run on the laws of `control`.
    ("fleetfoot-sim", &["data", "library", "dynamics", "control"]),
    // Of logs and models it knows nothing.
    ("fleetfoot-report", &["features"]),
    ("fleetfoot-recipe", &["data", "library", "model", "signal", "log"]),
    ("fleetfoot-task", &["data", "library", "stats", "model", "sums", "sparse", "pwa", "estimate", "recipe"]),
    (
        "fleetfoot-dataset",
        &["data", "library", "stats", "model", "signal", "log", "output", "sums", "pwa", "recipe", "task"],
    ),
    ("fleetfoot-check", &["data", "stats", "log", "recipe", "dataset"]),
    ("fleetfoot-prepare", &["data", "library", "model", "signal", "output", "recipe", "task", "dataset"]),
    (
        "fleetfoot-fit",
        &[
            // Of `codegen` the networks of ONNX files, of `codegen` and `control` their errors, of `report` its words.
            "data", "library", "stats", "model", "dynamics", "control", "codegen", "log", "output", "sums", "pwa",
            "sparse", "estimate", "learn", "report", "recipe", "task", "dataset",
        ],
    ),
    (
        "fleetfoot-run",
        &[
            "data", "library", "model", "dynamics", "control", "codegen", "log", "output", "estimate", "recipe",
            "dataset", "fit",
        ],
    ),
    (
        "fleetfoot-page",
        &[
            "data", "library", "stats", "model", "dynamics", "log", "output", "report", "recipe", "dataset", "fit",
            "run",
        ],
    ),
    (
        "fleetfoot-auto",
        &[
            // Of `report` its words for numbers, of `codegen` the options of the export.
            "data", "stats", "model", "dynamics", "codegen", "log", "output", "report", "recipe", "dataset", "check",
            "fit", "run", "page",
        ],
    ),
    (
        "fleetfoot-synth",
        &[
            "data", "library", "stats", "model", "control", "message", "log", "output", "pwa", "sim", "recipe",
            "dataset", "prepare", "fit", "run", "page",
        ],
    ),
    (
        "fleetfoot",
        &[
            "data", "library", "stats", "model", "dynamics", "control", "codegen", "message", "signal", "output",
            "log", "sums", "pwa", "sparse", "estimate", "learn", "sim", "report", "recipe", "task", "dataset", "check",
            "prepare", "fit", "run", "page", "auto", "synth",
        ],
    ),
    ("fleetfoot-cli", &["fleetfoot"]),
    // The wheel has the command, too.
    ("fleetfoot-py", &["fleetfoot", "cli"]),
];

#[test]
fn crates_use_only_allowed_crates() {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo metadata runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).expect("cargo metadata is JSON");
    let mut seen = BTreeSet::new();
    for package in metadata["packages"].as_array().expect("packages") {
        let name = package["name"].as_str().expect("a name");
        if ["fleetfoot-tests", "fleetfoot-benches"].contains(&name) {
            continue;
        }
        let row = ARROWS.iter().find(|(known, _)| *known == name);
        let (_, allowed) = row.unwrap_or_else(|| panic!("{name} is not in the table of crates"));
        seen.insert(name.to_owned());
        for dependency in package["dependencies"].as_array().expect("dependencies") {
            let used = dependency["name"].as_str().expect("a name");
            // A test may use anything: it is not shipped.
            let internal = used == "fleetfoot" || used.starts_with("fleetfoot-");
            if internal && dependency["kind"] != "dev" {
                let short = used.trim_start_matches("fleetfoot-");
                assert!(allowed.contains(&short), "{name} must not use {used}");
            }
        }
    }
    assert_eq!(seen.len(), ARROWS.len(), "crates of the table that are gone: have {seen:?}");
}

#[test]
fn build_scripts_read_only_allowed_crates() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let mut scripts = 0;
    for (name, allowed) in ARROWS {
        let Ok(text) = fs::read_to_string(crates.join(name.trim_start_matches("fleetfoot-")).join("build.rs")) else {
            continue;
        };
        scripts += 1;
        for path in text.split("\"../").skip(1) {
            let used = path.split(['/', '"']).next().unwrap_or_default();
            assert!(allowed.contains(&used), "the build script of {name} must not read {used}");
        }
    }
    assert!(scripts > 0, "no build script was found below {}", crates.display());
}

/// Sources of a folder and of the folders below it.
fn sources(folder: &Path, files: &mut Vec<std::path::PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

#[test]
fn one_file_chooses_the_instruction_set() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the root of the checkout").join("crates");
    let mut files = Vec::new();
    sources(&crates, &mut files);
    files.retain(|path| {
        let text = fs::read_to_string(path).expect("a source");
        ["Arch::new()", "Arch::default()"].iter().any(|call| text.contains(call))
    });
    assert_eq!(files, [crates.join("data/src/simd.rs")], "kernels are dispatched by `fleetfoot_data::arch`");
}
