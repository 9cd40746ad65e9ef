//! Every kind of filter is C that compiles without a warning.

use std::process::Command;

use fleetfoot_codegen::{ExportOptions, Precision, Target, export_filter};
use fleetfoot_control::filter::{FilterColour, FilterTables};

use crate::{
    export::{FLAGS, Folder, present},
    models,
};

/// Some numbers, for each of `regions` regions.
fn numbers(regions: usize, count: usize) -> Vec<Vec<f64>> {
    (0..regions).map(|region| (0..count).map(|i| 0.1 + (31 * region + i) as f64 / 7.0).collect()).collect()
}

/// The tables of a filter of [`models::pwa`], whose fourth state is an angle; the noise is correlated over `rows` rows.
fn tables(regions: usize, switches: bool, rows: usize, driven: bool) -> FilterTables {
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<String>>();
    let (states, inputs) =
        (names(&["px", "vx", "vy", "yaw", "w"]), names(if driven { &["left", "right"] } else { &[] }));
    let (n, m, q) = (states.len(), inputs.len(), 2);
    let one = |count| numbers(1, count).remove(0);
    FilterTables {
        angles: states.iter().map(|name| name == "yaw").collect(),
        states,
        inputs,
        regions: (0..regions).map(|region| region.to_string()).collect(),
        a: numbers(regions, n * n),
        b: numbers(regions, n * m),
        c: numbers(regions, n),
        q: numbers(regions, n * n),
        colour: (rows > 0).then(|| FilterColour {
            s: numbers(regions, n * q),
            coefficients: one(q * q * rows),
            innovation: one(q * q),
            stationary: one((q * rows).pow(2)),
        }),
        sensors: vec![(0, 0.1), (3, 0.2)],
        prior: vec![[0.0, 1.0]; n],
        points: one(2 * n * n),
        transitions: switches.then(|| vec![vec![1.0 / regions as f64; regions]; regions]),
        regions_read_inputs: driven,
        period: 0.05,
    }
}

#[test]
fn every_kind_of_filter_compiles_without_a_warning() {
    if !present("cc") {
        return;
    }
    let folder = Folder::new("filters");
    let model = models::pwa(5, 2);
    let mut sources = Vec::new();
    for (regions, switches) in [(1, false), (1, true), (5, false), (5, true)] {
        for rows in [0, 1, 2] {
            for driven in [true, false] {
                for precision in [Precision::Double, Precision::Float] {
                    let mut options = ExportOptions::new(Target::C);
                    options.precision = precision;
                    options.prefix = format!("robot{}", sources.len());
                    let tables = tables(regions, switches, rows, driven);
                    // A partition that reads inputs has a region for none of them.
                    if regions > 1 && !switches && !driven {
                        continue;
                    }
                    let files = export_filter(&model, &tables, &options).expect("code");
                    let text = String::from_utf8_lossy(&files[1].bytes);
                    assert_eq!(text.contains("_filter_join_("), regions > 1 && !switches, "{}", options.prefix);
                    assert_eq!(text.contains("_filter_lasting["), rows > 0, "{}", options.prefix);
                    for file in files {
                        std::fs::write(folder.0.join(&file.name), &file.bytes).expect("written");
                    }
                    sources.push(format!("{}_filter.c", options.prefix));
                }
            }
        }
    }
    assert_eq!(sources.len(), 42);
    let output = Command::new("cc").current_dir(&folder.0).args(FLAGS).arg("-fsyntax-only").args(&sources).output();
    let output = output.expect("a compiler");
    // A function that a kind does not call is a warning, one that it lacks an error.
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
