//! Precedence of settings: flags above the recipe, the recipe above the defaults; the recipe in a model has all of
//! them.

use std::fs;

use crate::runner::*;

/// A method, flags of each kind, and a recipe with other values.
const METHODS: [(&str, &[&str], &str); 8] = [
    (
        "pwa",
        &[
            "--partition",
            "average,kmeans:2,3",
            "--select=bic",
            "--folds=4",
            "--purge=0.05",
            "--shrinkage=5",
            "--unseen-labels=pool",
            "--outside=hold",
            "--seed=3",
            "--restarts=2",
            "--iterations=20",
            "--memory=0.02",
            "--tsqr=false",
            "--objective=one-step",
            "--phase=wrap(3*v):5",
        ],
        "[model]\npartition = \"null\"\n[pwa]\nselect = \"cv\"\nfolds = 8\npurge = 0.2\nshrinkage = \"auto\"\nunseen_labels = \"refuse\"\noutside = \"extrapolate\"\nseed = 1\n\
         restarts = 1\niterations = 2\nmemory = 64.0\ntsqr = true\nobjective = \"steps:3\"\nphase = \"wrap(v):8\"\n",
    ),
    ("pwa", &["--partition=kmeans:3", "--stable=0.9"], "[pwa]\nstable = 0.5\n"),
    ("pwa", &["--partition=kmeans:3", "--passive=u:v:0.1"], "[pwa]\npassive = \"u:v:0.3\"\n"),
    (
        "sparse",
        &["--degree=2", "--lambda=auto", "--select=cv", "--folds=4", "--l1-ratio=0.9", "--adaptive=false", "--seed=2"],
        "[model]\ndegree = 1\n[sparse]\nlambda = \"1\"\nselect = \"aic\"\nfolds = \"8\"\nl1_ratio = 0.1\nadaptive = true\nseed = 7\n",
    ),
    (
        "sparse",
        &["--degree=2", "--groups=speed=v,force=u", "--l1-ratio=0.2", "--select=bic"],
        "[sparse]\ngroups = \"term\"\nl1_ratio = 0.7\nselect = \"aic\"\n",
    ),
    (
        "sindy",
        &["--groups=signal", "--l1-ratio=0.3", "--select=bic"],
        "[sindy]\ngroups = { speed = [\"v\"] }\nl1_ratio = 0.9\n",
    ),
    (
        "sindy",
        &[
            "--threshold=0.2",
            "--ridge=0.01",
            "--normalize=false",
            "--folds=4",
            "--ensemble=chunks:8",
            "--inclusion=0.5",
            "--seed=2",
        ],
        "[sindy]\nterms = 1\nridge = 3.0\nnormalize = true\nfolds = \"8\"\nensemble = \"library:4\"\ninclusion = 0.9\nseed = 7\n",
    ),
    (
        "narx",
        &[
            "--degree=1",
            "--lags-out=2",
            "--lags-in=1",
            "--direct=false",
            "--terms=3",
            "--folds=4",
            "--decimate=2",
            "--test-share=0.1",
            "--seed=2",
        ],
        "[model]\ndegree = 3\n[narx]\nlags_out = 5\nlags_in = 4\ndirect = true\nterms = \"all\"\nfolds = 8\ndecimate = 1\ntest_share = 0.5\nseed = 7\n",
    ),
];

/// Columns, states and inputs of every recipe and command line here.
const COLUMNS: &str =
    "columns = { v = \"`v [m/s]`\" }\nstates = { v = {} }\ninputs = { u = \"u\" }\ntime = { column = \"t\" }\n";

fn recipe_of(folder: &Path, model: &str) -> String {
    let text = fs::read_to_string(folder.join(model)).expect("a model");
    let model: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    model["model"]["training"]["recipe"].as_str().expect("a recipe").to_owned()
}

#[test]
fn flags_override_recipes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    for run in 0..2 {
        fs::write(path.join(format!("run_{run}.csv")), robot_csv(700, f64::from(run))).expect("a file");
    }
    fs::write(path.join("columns.toml"), COLUMNS).expect("a file");
    for (method, flags, otherwise) in METHODS {
        let fit = |recipe: &str, flags: &[&str], output: &str| {
            let fixed = ["fit", method, "-c", recipe, "run_0.csv", "run_1.csv", "-o", output];
            fleetfoot(path, &[&fixed[..], flags].concat()).ok();
            fs::read(path.join(output)).expect("a model")
        };
        fs::write(path.join("other.toml"), format!("{COLUMNS}{otherwise}")).expect("a file");
        let flagged = fit("columns.toml", flags, "flagged.json");
        assert!(flagged == fit("other.toml", flags, "above.json"), "{method}: {}", recipe_of(path, "above.json"));
        assert!(flagged != fit("other.toml", &[], "other.json"), "{method}: the recipe says nothing");
        for model in ["flagged.json", "other.json"] {
            fs::write(path.join("saved.toml"), recipe_of(path, model)).expect("a file");
            let again = fit("saved.toml", &[], "again.json");
            assert!(again == fs::read(path.join(model)).expect("a model"), "{method}: {}", recipe_of(path, model));
        }
    }
}
