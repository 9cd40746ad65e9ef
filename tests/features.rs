//! Every selection of packages has the same features of third-party crates, so that tests, command, wheel and benches
//! share compiled crates.

use std::{collections::BTreeSet, process::Command};

/// Third-party packages with their features, as Cargo resolves them for a selection of the workspace's packages.
fn resolved(selection: &[&str]) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--edges", "normal,build,dev", "--prefix", "none", "--format", "{p} {f}"])
        .args(selection)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo tree runs");
    assert!(output.status.success(), "{selection:?}: {}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("names are UTF-8");
    // Cargo marks a package that it printed before, with its features, by a star.
    let packages = text.lines().map(|line| line.strip_suffix(" (*)").unwrap_or(line));
    packages.filter(|line| !line.is_empty() && !line.contains("(/")).map(str::to_owned).collect()
}

#[test]
fn every_package_is_compiled_once() {
    let all = resolved(&["--workspace"]);
    assert!(
        all.len() > 200 && all.iter().any(|line| line.starts_with("serde v1") && line.contains("derive")),
        "{all:?}"
    );
    for name in [
        "data", "library", "stats", "model", "dynamics", "control", "codegen", "message", "signal", "output", "log",
        "sums", "sparse", "pwa", "estimate", "sim", "report", "cli", "py",
    ] {
        let alone = resolved(&["--package", &format!("fleetfoot-{name}")]);
        let others: Vec<_> = alone.difference(&all).collect();
        assert!(
            others.is_empty(),
            "with `-p fleetfoot-{name}` these are compiled anew; crates/features/Cargo.toml is to ask for the features that the workspace has: {others:#?}"
        );
    }
}
