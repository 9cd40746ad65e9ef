//! `fit sparse`.

use fleetfoot::{FitReport, FitRequest, Fitted, Logs, Recipe, Silent, Sparse, SparseReport};

use super::{
    book::{Entry, check},
    logs::logs,
    recipe, refits,
    sindy::scanned,
};

/// Two equations that share a function, the second known to a factor of two; what is believed of the other; labels of the episodes.
const STRUCTURE: &str = r#"
    [latents]
    T = { of = ["x"], degree = 3 }
    D = { functions = ["v", "v^2", "v^3"], prior = "0.5*v", prior_strength = 0.1 }
    [tasks]
    along = { target = "a", right = "T - D" }
    normal = { target = "b", right = "2*T", scale = 0.5 }
    [inputs]
    x = "x"
    v = "v"
    [[episodes]]
    match = "flight_[012]*"
    weather = "wind"
    [[episodes]]
    match = "flight_[345]*"
    weather = "calm"
"#;

/// The same plant as plain equations over one library.
const PLAIN: &str = r#"
    inputs = { x = "x", v = "v" }
    model = { predict = "a,b", degree = 3, weight = "1 + x^2" }
"#;

/// A configuration: its name, its recipe, and how it goes.
type Case = (&'static str, &'static str, &'static str);

/// Between them: rules and criteria for lambda, folds, elastic net and adaptive lasso, bolassos of every unit, stability selection, priors, signs, bounds at every row,
/// raw units, weights.
const CASES: [Case; 12] = [
    ("lambda by one standard error", STRUCTURE, ""),
    ("lambda by cv over episodes", STRUCTURE, "[sparse]\nselect = \"cv\"\nfolds = \"episodes\"\n"),
    ("lambda by BIC, adaptive", STRUCTURE, "[sparse]\nselect = \"bic\"\nadaptive = true\n"),
    ("an elastic net", STRUCTURE, "[sparse]\nl1_ratio = 0.5\nfolds = \"4\"\n"),
    (
        "a bolasso of episodes",
        STRUCTURE,
        "[sparse]\nlambda = \"0.2/sqrt(n)\"\nbolasso = \"episodes:24\"\nthreshold = 0.7\nseed = 2\n",
    ),
    ("a bolasso of chunks", STRUCTURE, "[sparse]\nlambda = \"1e-3\"\nbolasso = \"chunks:16\"\n"),
    ("a bolasso of rows", STRUCTURE, "[sparse]\nlambda = \"1e-3\"\nbolasso = \"rows:8\"\nthreshold = 0.9\n"),
    ("stability selection", STRUCTURE, "[sparse]\nstability = true\nlambda = \"1e-2\"\nseed = 3\n"),
    ("raw units and a strong prior", STRUCTURE, "[sparse]\nunscaled = true\nlambda = \"0.02\"\nprior_strength = 5.0\n"),
    ("plain equations", PLAIN, "[sparse]\nfolds = \"splits:6\"\nseed = 4\n"),
    ("plain equations by AIC", PLAIN, "[sparse]\nselect = \"aic\"\n"),
    ("plain equations by the extended criterion", PLAIN, "[sparse]\nselect = \"ebic\"\n"),
];

fn fit(name: &str, text: &str, request: &FitRequest, logs: impl Into<Logs>) -> Vec<Fitted<SparseReport>> {
    let logs = logs.into();
    let of = |recipe: &Recipe| {
        let fitted = fleetfoot::fit_all::<Sparse>(recipe, request, &logs, &Silent);
        fitted.unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    let fitted = of(&recipe(text));
    refits(name, &fitted[0].model, |recipe| of(recipe).swap_remove(0).model);
    fitted
}

fn entry(name: &str, fitted: &Fitted<SparseReport>) -> Entry {
    let report = fitted.report.to_json();
    let mut entry = Entry::new(name);
    entry.model(&fitted.model);
    entry.report("report", &report);
    entry.field("lambda", &report, "lambda/value");
    entry.field("rms", &report, "tasks/*/rms");
    entry.field("held out", &report, "tasks/*/held_out_rms");
    entry.field("standard errors", &report, "latents/*/functions/*/standard_error");
    entry.field("lasso", &report, "latents/*/functions/*/lasso");
    entry.field("frequencies", &report, "latents/*/functions/*/frequency");
    entry
}

fn from_logs((name, structure, text): &Case) -> Entry {
    let all = format!("{structure}\n{text}");
    let fitted = fit(name, &all, &FitRequest::default(), &logs("flight", 0..6));
    let mut entry = entry(name, &fitted[0]);
    if *structure == PLAIN {
        entry.score(&fitted[0].model, &logs("flight", 6..7));
        entry.predictions(&fitted[0].model, &logs("flight", 6..7));
    }
    entry
}

/// Bounds at every row, a sign, and no penalty on a latent.
fn within_limits() -> Entry {
    let text = STRUCTURE
        .replace("degree = 3 }", "degree = 3, at_most = 3.3, penalty = 0.0 }")
        .replace("\"v^3\"],", "\"v^3\"], signs = \"+\",");
    assert!(text.contains("at_most") && text.contains("signs"));
    let text = format!("{text}\n[sparse]\nlambda = \"1e-3\"\n");
    let fitted = fit("limits", &text, &FitRequest::default(), &logs("flight", 0..6));
    entry("limits at every row", &fitted[0])
}

/// A model a label, and what each episode does to it.
fn by_label() -> Vec<Entry> {
    let request = FitRequest { by: Some("weather".to_owned()), influence: true, ..FitRequest::default() };
    let fitted = fit("labels", &format!("{STRUCTURE}\n[sparse]\nlambda = \"1e-3\"\n"), &request, &logs("flight", 0..6));
    let of = |label_fit: &Fitted<SparseReport>| {
        let report = label_fit.report.to_json();
        let mut entry = entry(&format!("weather {}", label_fit.value.as_deref().unwrap_or_default()), label_fit);
        entry.field("Cook's distances", &report, "influence/episodes/*/cooks_distance");
        entry
    };
    fitted.iter().map(of).collect()
}

/// From the statistic, which is that of two merged halves: the bytes of the logs.
fn from_statistic() -> Vec<Entry> {
    let file = scanned(STRUCTURE, &logs("flight", 0..6));
    let mut statistic = Entry::new("the statistic");
    statistic.statistic(&file);
    let fitted = fit("statistic", STRUCTURE, &FitRequest::default(), Logs::of_statistic(file.into()));
    let rows = fit("logs", STRUCTURE, &FitRequest::default(), &logs("flight", 0..6));
    assert!(fitted[0].model.to_json() == rows[0].model.to_json(), "the statistic gives another model than the logs");
    vec![statistic, entry("from a statistic", &fitted[0])]
}

#[test]
fn sparse_models_equal_goldens() {
    let cases = CASES.iter().map(from_logs).chain([within_limits()]).chain(by_label()).chain(from_statistic());
    check("sparse.txt", "fit sparse", cases.collect());
}
