//! `fit narx`.

use fleetfoot::{FitReport, FitRequest, Fitted, Narx, NarxReport, Recipe, Silent};

use super::{
    book::{Entry, check},
    logs::logs,
    recipe, refits,
};

/// A configuration: its name and its recipe, beside outputs and inputs.
type Case = (&'static str, &'static str);

/// Between them: orders given, compared and looked for, numbers of terms, criteria, folds, regions and clusterings to choose from, functions of one row, every n-th row
/// and rows kept back.
const CASES: [Case; 7] = [
    ("a given order and number of terms", "[narx]\nlags_out = 2\nlags_in = 1\nterms = 5\n[model]\ndegree = 2\n"),
    (
        "the order by BIC",
        "[narx]\nlags_out = 3\nlags_in = 2\norder = \"auto\"\nselect = \"bic\"\nmax_terms = 8\n[model]\ndegree = 2\n",
    ),
    (
        "the order by one standard error",
        "[narx]\nlags_out = 2\norder = \"auto\"\nselect = \"one-se\"\nfolds = 4\nmax_terms = 6\n",
    ),
    ("looked for, with little effort", "[narx]\neffort = \"low\"\nmax_terms = 6\n"),
    (
        "regions by free runs",
        "[narx]\nlags_in = 1\norder = \"fixed\"\nmax_terms = 6\ntest_share = 0.2\nstarts = 2\nseed = 4\n\
         [model]\ndegree = 1\npartition = \"average,kmeans:2,3\"\npartition_on = [\"y\"]\n",
    ),
    (
        "every other row, all terms",
        "[narx]\nlags_out = 2\nlags_in = 2\nterms = \"all\"\ndecimate = 2\n[model]\ndegree = 1\n",
    ),
    (
        "functions of one row",
        "[narx]\nlags_out = 2\nlags_in = 1\nmax_terms = 5\ndirect = true\n[library]\nfunctions = [\"y\", \"u\", \"y^2\", \"abs(y)\"]\n",
    ),
];

fn fit(name: &str, recipe: &Recipe) -> Fitted<NarxReport> {
    let request = FitRequest { free_run: (&logs("machine", 2..3)).into(), ..FitRequest::default() };
    fleetfoot::fit::<Narx>(recipe, &request, &logs("machine", 0..2), &Silent)
        .unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn entry(case: &Case) -> Entry {
    let (name, text) = *case;
    let fitted = fit(name, &recipe(&format!("[states]\ny = {{}}\n[inputs]\nu = \"u\"\n{text}")));
    refits(name, &fitted.model, |recipe| fit(name, recipe).model);
    let report = fitted.report.to_json();
    let mut entry = Entry::new(case.0);
    entry.model(&fitted.model);
    entry.report("report", &report);
    entry.field("order", &report, "order/lags_out");
    entry.field("order of the inputs", &report, "order/lags_in");
    entry.field("error reduction ratios", &report, "regions/*/equations/*/terms/*/err");
    if report["held_out"].is_object() {
        entry.field("held out", &report, "held_out/folds/*");
    }
    entry.field("one step", &report, "train/one_step/*/rmse");
    entry.field("free run", &report, "train/free_run/*/rrse");
    entry.field("free run of another file", &report, "files/mean/*/rrse");
    if !case.1.contains("decimate") {
        entry.run(&fitted.model, &logs("machine", 2..3));
    }
    entry
}

#[test]
fn autoregressions_equal_goldens() {
    check("narx.txt", "fit narx", CASES.iter().map(entry).collect());
}
