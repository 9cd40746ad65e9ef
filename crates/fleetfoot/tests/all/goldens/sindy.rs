//! `fit sindy`.

use fleetfoot::{
    FitReport, FitRequest, Fitted, Logs, Recipe, Rival, Silent, Sindy, SindyReport,
    statistic::{ScanOptions, StatisticFile, scan, scan_part},
};

use super::{
    book::{Entry, check},
    logs::logs,
    recipe,
    record::{bare, bytes_of},
    refits,
};

/// A configuration: its name, the plant, and its recipe.
type Case = (&'static str, &'static str, &'static str);

/// Between them: every optimiser, ways to choose the number of terms, folds, ensembles, regions, what derivatives are measured by, what is given of an equation,
/// filters with a time constant that is looked for, next values and plain regression.
const CASES: [Case; 16] = [
    ("terms by one standard error", "lorenz", "[library]\nfunctions = [\"poly(3)\"]\n"),
    ("by BIC, of central differences", "lorenz", "[sindy]\nselect = \"bic\"\n"),
    (
        "a threshold, and an ensemble of chunks",
        "lorenz",
        "[sindy]\nthreshold = 0.5\nensemble = \"chunks:20\"\nseed = 3\n",
    ),
    (
        "an ensemble of libraries, chosen by cv",
        "lorenz",
        "[sindy]\nensemble = \"library:20\"\ninclusion = 0.5\nselect = \"cv\"\nfolds = \"4\"\n",
    ),
    (
        "stlsq with thresholds on lengths",
        "lorenz",
        "[sindy]\noptimizer = \"stlsq\"\nthreshold = 20.0\nnormalize = \"length\"\nmax_iterations = 8\n",
    ),
    ("sr3", "lorenz", "[sindy]\noptimizer = \"sr3\"\nthreshold = 0.5\nfolds = \"episodes\"\n"),
    ("ssr by the extended criterion", "lorenz", "[sindy]\noptimizer = \"ssr\"\nselect = \"ebic\"\n"),
    ("three terms of forward regression", "lorenz", "[sindy]\noptimizer = \"frols\"\nterms = 3\n"),
    ("forward regression by its ratios", "lorenz", "[sindy]\noptimizer = \"frols\"\nkappa = 1e-6\n"),
    ("the lasso over random splits", "lorenz", "[sindy]\noptimizer = \"lasso\"\nfolds = \"splits:6\"\nseed = 5\n"),
    ("least squares", "lorenz", "[sindy]\noptimizer = \"ols\"\n"),
    (
        "equations in labelled regions",
        "robot",
        "[states]\nv = { derivative = \"dv\" }\nw = { derivative = \"dw\" }\n[inputs]\nu = \"u\"\nr = \"r\"\n[model]\npartition = \"labels:mode\"\n",
    ),
    (
        "weighted equations in clusters",
        "robot",
        "[states]\nv = { derivative = \"dv\" }\n[inputs]\nu = \"u\"\n\
         [model]\nweight = \"load\"\npartition = \"kmeans:2\"\npartition_on = [\"v\"]\n[sindy]\nridge = 0.01\nthreshold = 0.3\n",
    ),
    (
        "what is given, fixed and looked for",
        "driven",
        "[states]\nv = { derivative = \"dv\", nominal = \"u - 0.5*v\", library = [\"poly(1)\", \"v*abs(v)\"], fixed = [\"1\"] }\n\
         w = { derivative = \"dw\", library = [\"identity\", \"lag1(u, tau)\"] }\n[inputs]\nu = \"u\"\n\
         [parameters]\ntau = { initial = 0.03, bounds = [0.01, 0.3] }\n[sindy]\nthreshold = 0.05\n",
    ),
    (
        "next values",
        "machine",
        "[states]\ny = {}\n[inputs]\nu = \"u\"\n[model]\npredict = \"next\"\n[library]\nfunctions = [\"poly(2)\", \"past(2)\"]\n",
    ),
    ("a column", "flight", "[inputs]\nx = \"x\"\nv = \"v\"\n[model]\npredict = \"a\"\n[sindy]\nselect = \"aic\"\n"),
];

/// Equations of Lorenz's system are fitted to measured derivatives, but where differences are what is looked at.
const LORENZ: &str =
    "[states]\nx = { derivative = \"dx\" }\ny = { derivative = \"dy\" }\nz = { derivative = \"dz\" }\n";
const DIFFERENCES: &str = "[states]\nx = {}\ny = {}\nz = { derivative = \"central4\" }\n";

fn text((name, plant, text): &Case) -> String {
    match *plant {
        "lorenz" if name.contains("differences") => format!("{DIFFERENCES}{text}"),
        "lorenz" => format!("{LORENZ}{text}"),
        _ => (*text).to_owned(),
    }
}

fn trained(plant: &str) -> u64 {
    if plant == "lorenz" { 3 } else { 2 }
}

fn fit(name: &str, recipe: &Recipe, logs: impl Into<Logs>) -> Fitted<SindyReport> {
    let fitted = fleetfoot::fit::<Sindy>(recipe, &FitRequest { rivals: true, ..FitRequest::default() }, logs, &Silent);
    fitted.unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The model and what is told of it.
/// Terms of an equation at most, of a model of the front.
fn terms(rival: &Rival) -> f64 {
    rival.name.trim_start_matches("terms").parse().expect("a number of terms")
}

fn entry(name: &str, fitted: &Fitted<SindyReport>) -> Entry {
    let report = fitted.report.to_json();
    let mut entry = Entry::new(name);
    entry.model(&fitted.model);
    entry.report("report", &report);
    entry.field("folds", &report, "fold_rule");
    entry.field("rms", &report, "regions/*/equations/*/rms");
    entry.field("held out", &report, "regions/*/equations/*/held_out_rms");
    entry.field("standard errors", &report, "regions/*/equations/*/terms/*/standard_error");
    if !report["parameters"].as_array().is_none_or(Vec::is_empty) {
        entry.field("parameters", &report, "parameters/*/value");
    }
    if !fitted.rivals.is_empty() {
        let front: String = fitted.rivals.iter().map(|rival| bare(&rival.model)).collect();
        entry.numbers("front", fitted.rivals.iter().map(terms));
        entry.hash("models of the front", front.as_bytes());
    }
    entry
}

fn from_logs(case: &Case) -> Entry {
    let (name, plant, _) = *case;
    let trained_by = logs(plant, 0..trained(plant));
    let fitted = fit(name, &recipe(&text(case)), &trained_by);
    refits(name, &fitted.model, |recipe| fit(name, recipe, &trained_by).model);
    let mut entry = entry(name, &fitted);
    let held_out = logs(plant, trained(plant)..trained(plant) + 1);
    if ["terms by one standard error", "equations in labelled regions", "next values"].contains(&name) {
        entry.run(&fitted.model, &held_out);
    } else {
        entry.score(&fitted.model, &held_out);
    }
    entry
}

/// A scan of all logs, and the one of its halves, merged.
pub(super) fn scanned(text: &str, logs: &[std::path::PathBuf]) -> StatisticFile {
    let (recipe, options) = (recipe(text), ScanOptions::default());
    let (whole, _) = scan(&recipe, &options, None, logs, &Silent).unwrap();
    let (first, second) = logs.split_at(logs.len() / 2);
    let part = |logs: &[std::path::PathBuf]| scan_part(&whole, &options, logs, &Silent).unwrap().0;
    let mut merged = part(second);
    merged.merge("the second half", part(first), "the first half").unwrap();
    assert!(bytes_of(&merged) == bytes_of(&whole), "two halves are not the whole");
    merged
}

/// From the statistic, which is that of two merged halves.
fn from_statistic() -> Vec<Entry> {
    let case = ("from a statistic", "lorenz", "[model]\ndegree = 3\n[sindy]\nselect = \"bic\"\n");
    let file = scanned(&text(&case), &logs("lorenz", 0..3));
    let mut statistic = Entry::new("the statistic");
    statistic.statistic(&file);
    let file = Logs::of_statistic(file.into());
    let fitted = fit(case.0, &recipe(&text(&case)), &file);
    refits(case.0, &fitted.model, |recipe| fit(case.0, recipe, &file).model);
    // The scan's recipe supplies entries that a recipe lacks.
    let silent = fit(case.0, &Recipe::default(), &file);
    assert!(
        bare(&silent.model) == bare(&fitted.model),
        "{} is not that of the scan's recipe",
        silent.model.training.recipe
    );
    vec![statistic, entry(case.0, &fitted)]
}

#[test]
fn equations_equal_goldens() {
    check("sindy.txt", "fit sindy", CASES.iter().map(from_logs).chain(from_statistic()).collect());
}
