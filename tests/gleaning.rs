//! Every k-th of the last rows as regressors: the same as the lags written out, to the bit, in every notation.

use std::fs;

use crate::runner::*;

const RECIPE: &str = "[states]\nv = {}\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (run, phase) in [0.0, 1.3].into_iter().enumerate() {
        fs::write(folder.path().join(format!("run{run}.csv")), robot_csv(700, phase).replace("v [m/s]", "v")).unwrap();
    }
    folder
}

fn model(folder: &Path, name: &str) -> serde_json::Value {
    let text = fs::read_to_string(folder.join(name)).unwrap();
    serde_json::from_str::<serde_json::Value>(&text).unwrap()["model"].take()
}

fn fit(folder: &Path, method: &str, recipe: &str, more: &[&str], output: &str) {
    fs::write(folder.join("lags.toml"), format!("{RECIPE}{recipe}")).unwrap();
    let fixed = ["fit", method, "-c", "lags.toml", "run0.csv", "run1.csv", "-o", output];
    fleetfoot(folder, &[&fixed[..], more].concat()).ok();
}

#[test]
fn every_fifth_row_equals_explicit_lags() {
    let folder = folder();
    let path = folder.path();
    // A table of the recipe and a flag say the same bytes.
    let gleaned = "[model]\npredict = \"next\"\nlags = { last = 12, every = 5 }\npartition = \"average\"\n";
    fit(path, "pwa", gleaned, &[], "gleaned.json");
    let others = "[model]\npredict = \"next\"\nlags = 3\npartition = \"average\"\n";
    fit(path, "pwa", others, &["--lags", "12:5"], "flag.json");
    assert!(fs::read(path.join("gleaned.json")).unwrap() == fs::read(path.join("flag.json")).unwrap());
    // By hand, as inputs of their own.
    let by_hand = "v5 = \"lag(v, 5)\"\nu5 = \"lag(u, 5)\"\nv10 = \"lag(v, 10)\"\nu10 = \"lag(u, 10)\"\n";
    let recipe = RECIPE.replace("u = \"u\"\n", &format!("u = \"u\"\n{by_hand}"));
    fs::write(path.join("hand.toml"), format!("{recipe}[model]\npredict = \"next\"\npartition = \"average\"\n"))
        .unwrap();
    fleetfoot(path, &["fit", "pwa", "-c", "hand.toml", "run0.csv", "run1.csv", "-o", "hand.json"]).ok();
    let (gleaned, hand) = (model(path, "gleaned.json"), model(path, "hand.json"));
    let library = serde_json::json!(["v", "u", "lag(v, 5)", "lag(u, 5)", "lag(v, 10)", "lag(u, 10)"]);
    assert_eq!((&gleaned["libraries"][0], hand["libraries"][0].as_array().unwrap().len()), (&library, 6));
    // Rows whose lags lie beyond the border are incomplete there and left out here: tiles begin at other rows, and sums round another way.
    let numbers = |model: &serde_json::Value| -> Vec<f64> {
        let latent = &model["latents"][0];
        let row = latent["coefficients"][0].as_array().unwrap().iter().chain(latent["constants"].as_array().unwrap());
        row.map(|number| number.as_f64().unwrap()).collect()
    };
    let (by_lags, by_hand) = (numbers(&gleaned), numbers(&hand));
    assert!(
        by_lags.len() == 7 && by_lags.iter().zip(&by_hand).all(|(a, b)| (a - b).abs() < 1e-12),
        "{by_lags:?} {by_hand:?}"
    );
    assert_eq!(gleaned["training"]["rows"], hand["training"]["rows"]);
    // A rollout starts from recorded rows and goes on with its own.
    let rolled = fleetfoot(path, &["rollout", "gleaned.json", "run1.csv", "--horizon", "20", "--json"]).ok().json();
    assert_eq!(rolled["replayed"], serde_json::json!(["u"]));
    let output = fleetfoot(path, &["fit", "pwa", "-c", "hand.toml", "run0.csv", "--lags", "3:5"]);
    assert!(output.code == 2 && output.err.contains("50:5"), "{}", output.err);
}

#[test]
fn equations_range_over_gleaned_rows() {
    let folder = folder();
    let path = folder.path();
    fit(path, "sindy", "[model]\ndegree = 1\nlags = { last = 20, every = 10 }\n", &[], "gleaned.json");
    let written = "[library]\nfunctions = [\"1\", \"v\", \"u\", \"lag(v, 10)\", \"lag(u, 10)\", \"lag(v, 20)\", \"lag(u, 20)\"]\n";
    fit(path, "sindy", written, &[], "hand.json");
    let (gleaned, hand) = (model(path, "gleaned.json"), model(path, "hand.json"));
    for part in ["libraries", "latents", "partitions", "equations"] {
        assert!(!gleaned[part].is_null() && gleaned[part] == hand[part], "{part}");
    }
}

/// An autoregression of all lags of degree one is the affine map of one region. It has the same columns, and the same
/// coefficients, by a flag, by a recipe, and from sums.
#[test]
fn autoregressions_range_over_gleaned_rows() {
    let folder = folder();
    let path = folder.path();
    let affine = "[model]\npredict = \"next\"\nlags = { last = 12, every = 5 }\npartition = \"average\"\n";
    fit(path, "pwa", affine, &[], "affine.json");
    let all = ["--degree", "1", "--terms", "all"];
    // A flag stands above lags of the recipe.
    let narx = "[narx]\nlags_out = 1\nlags_in = 2\n";
    fit(path, "narx", narx, &[&all[..], &["--lags", "12:5"]].concat(), "flag.json");
    let gleaned = "[narx]\nterms = \"all\"\n[model]\ndegree = 1\nlags = { last = 12, every = 5 }\n";
    fit(path, "narx", gleaned, &all, "gleaned.json");
    let [affine, flag, gleaned] = ["affine.json", "flag.json", "gleaned.json"].map(|name| model(path, name));
    for part in ["libraries", "latents", "equations"] {
        assert!(!flag[part].is_null() && flag[part] == gleaned[part], "{part}");
    }
    let of = |model: &serde_json::Value| -> Vec<(String, f64)> {
        let latent = &model["latents"][0];
        let names = model["libraries"][0].as_array().unwrap().iter().map(|name| name.as_str().unwrap().to_owned());
        let row = latent["coefficients"][0].as_array().unwrap().iter().map(|number| number.as_f64().unwrap());
        let mut sorted: Vec<(String, f64)> = names.zip(row).collect();
        sorted.sort_by(|a, b| a.0.cmp(&b.0));
        sorted
    };
    let (map, gleaned_terms) = (of(&affine), of(&gleaned));
    assert_eq!(map.len(), 6);
    assert!(
        map.iter().zip(&gleaned_terms).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-9),
        "{map:?} {gleaned_terms:?}"
    );
    // Sums of these lags are fitted as the logs are; of other lags they are refused.
    fleetfoot(path, &["scan", "-c", "lags.toml", "run0.csv", "run1.csv", "-o", "lags.stats"]).ok();
    fleetfoot(path, &[&["fit", "narx", "lags.stats", "-o", "sums.json"], &all[..]].concat()).ok();
    let sums = model(path, "sums.json");
    assert!(["libraries", "latents", "equations"].iter().all(|part| sums[*part] == gleaned[*part]), "{sums:#}");
    let output = fleetfoot(
        path,
        &[&["fit", "narx", "lags.stats", "-c", "lags.toml", "--lags-out", "3", "--lags-in", "3"], &all[..]].concat(),
    );
    assert!(
        output.code == 1 && output.err.contains("ny 3 nu 3 every 5") && output.err.contains("scan again"),
        "{}",
        output.err
    );
    // Looked for is what --lags does not say: degree, terms, and whether inputs act at once.
    let report = [
        "fit",
        "narx",
        "-c",
        "lags.toml",
        "run0.csv",
        "run1.csv",
        "-o",
        "looked.json",
        "--effort",
        "low",
        "--terms",
        "auto",
        "--json",
    ];
    let fitted = fleetfoot(path, &report).ok().json();
    assert_eq!(fitted["order"]["every"], 5, "{fitted:#}");
    assert_eq!((&fitted["order"]["lags_out"], &fitted["order"]["lags_in"]), (&3.into(), &3.into()), "{fitted:#}");
    let output = fleetfoot(path, &["fit", "narx", "-c", "lags.toml", "run0.csv", "--lags", "12:5", "--lags-out", "1"]);
    assert!(output.code == 2 && output.err.contains("--lags-out"), "{}", output.err);
}
