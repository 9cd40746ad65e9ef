//! Autoregressions from logs, from their statistic, from that of two halves, and from parts that were scanned apart: the same bytes.

use std::fmt::Write as _;

use super::*;
use crate::{
    FitRequest,
    narx::{GivenOrder, Narx, NarxReport, OrderRule},
};

/// Logs of `y(k) = 0.6 y(k-1) - 0.2 y(k-2) + 0.5 u(k-1) + 0.1 y(k-1) u(k-2) + noise`, with a hard stop where `stop`.
fn logs(folder: &Path, count: usize, rows: usize, stop: bool) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for log in 0..count {
        let u = |k: usize| (0.37 * k as f64 + log as f64).sin() + 0.6 * (0.11 * (k * k) as f64).cos();
        let noise = |k: usize| 1e-3 * (1.7 * (k * k) as f64 + 3.0 * log as f64).sin();
        let (mut y, mut text) = (vec![0.1, 0.2], String::from("t,y,u\n"));
        for k in 0..rows + 7 * log {
            if k > 1 {
                let linear = 0.6 * y[k - 1] - 0.2 * y[k - 2] + 0.5 * u(k - 1) + 0.1 * y[k - 1] * u(k - 2);
                y.push(noise(k) + if stop { linear.min(0.4) } else { linear });
            }
            writeln!(text, "{},{},{}", 0.01 * k as f64, y[k], u(k)).unwrap();
        }
        let path = folder.join(format!("log_{log}.csv"));
        fs::write(&path, text).unwrap();
        files.push(path);
    }
    files
}

fn recipe(more: &str) -> Recipe {
    let text = format!("[states]\ny = {{}}\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n{more}");
    Recipe::parse(&text, "test").unwrap()
}

fn fit(recipe: &Recipe, logs: impl Into<fleetfoot_dataset::Logs>) -> Result<(String, NarxReport), crate::Error> {
    let fitted = crate::fit::<Narx>(recipe, &FitRequest::default(), logs, &Silent)?;
    Ok((fitted.model.to_json(), fitted.report))
}

fn of(file: StatisticFile) -> fleetfoot_dataset::Logs {
    fleetfoot_dataset::Logs::of_statistic(std::sync::Arc::new(file))
}

fn scanned(recipe: &Recipe, files: &[PathBuf]) -> StatisticFile {
    scan(recipe, &ScanOptions::default(), None, files, &Silent).unwrap().0
}

#[test]
fn logs_and_their_statistics_give_the_same_autoregression() {
    let lags = "lags_out = 2\nlags_in = 2\n";
    for (what, more) in [
        ("terms that are counted", format!("[narx]\n{lags}terms = 4\n[model]\ndegree = 2\n")),
        ("all terms", format!("[narx]\n{lags}terms = \"all\"\n[model]\ndegree = 1\n")),
        ("a criterion", format!("[narx]\n{lags}select = \"bic\"\norder = \"auto\"\n[model]\ndegree = 2\n")),
        ("a library", format!("[narx]\n{lags}select = \"bic\"\n[library]\nfunctions = [\"y\", \"u\", \"abs(u)\"]\n")),
        (
            "regions",
            format!("[narx]\n{lags}terms = \"all\"\nseed = 2\n[model]\ndegree = 1\npartition = \"kmeans:3\"\n"),
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let (recipe, files) = (recipe(&more), logs(folder.path(), 4, 240, true));
        let (wanted, report) = fit(&recipe, &files).unwrap();
        let options = ScanOptions::default();
        let all = scanned(&recipe, &files);
        assert!(serves(&all).iter().any(|method| method.starts_with("fit narx")), "{what}: {:?}", serves(&all));
        let read = StatisticFile::from_bytes(&bytes(&all), Path::new("run.stats")).unwrap().0;
        assert_eq!(read, all, "{what}");
        let plan = all.without_rows();
        let part = |files: &[PathBuf]| scan(&recipe, &options, Some(plan.clone()), files, &Silent).unwrap().0;
        let mut merged = part(&files[2..]);
        merged.merge("one", part(&files[..2]), "other").unwrap();
        let (frozen, _) = freeze(&recipe, &options, &files, &Silent).unwrap();
        let mut apart = frozen.clone();
        for file in &files {
            apart.append(scan_part(&frozen, &options, std::slice::from_ref(file), &Silent).unwrap().0).unwrap();
        }
        for statistic in [read, merged, apart] {
            let (model, from_statistic) = fit(&recipe, of(statistic)).unwrap();
            assert!(model == wanted, "{what}:\n{model}\n{wanted}");
            assert_eq!(
                (from_statistic.rows, from_statistic.summary.left_out.clone(), from_statistic.order),
                (report.rows, report.summary.left_out.clone(), report.order),
                "{what}"
            );
            assert!(report.train.is_some() && from_statistic.train.is_none(), "{what}");
        }
        // Without a recipe it is that of the scan.
        assert_eq!(fit(&Recipe::default(), of(all)).unwrap().0, wanted, "{what}");
    }
}

#[test]
fn held_out_errors_choose_defaults() {
    let folder = tempfile::tempdir().unwrap();
    let files = logs(folder.path(), 10, 400, false);
    let recipe = recipe("[narx]\nlags_out = 3\nlags_in = 3\n[model]\ndegree = 2\n");
    let file = scanned(&recipe, &files);
    let (_, report) = fit(&Recipe::default(), of(file.clone())).unwrap();
    // The four terms that made the logs, among 28.
    let mut terms: Vec<(&str, f64)> =
        report.regions[0].equations[0].terms.iter().map(|term| (term.function.as_str(), term.coefficient)).collect();
    terms.sort_by(|a, b| a.0.cmp(b.0));
    let truth = [("lag(y, 1)", -0.2), ("u", 0.5), ("y", 0.6), ("y*lag(u, 1)", 0.1)];
    assert!(
        terms.iter().zip(truth).all(|(term, truth)| term.0 == truth.0 && (term.1 - truth.1).abs() < 2e-3),
        "{terms:?}"
    );
    assert_eq!(terms.len(), 4, "{terms:?}");
    let search = report.orders.as_ref().unwrap();
    assert!(search.scores.iter().all(|score| score.standard_error.is_some()), "orders are compared by folds");
    assert!(report.summary.notes.iter().any(|note| note.contains("one-step errors")), "{:?}", report.summary.notes);
    // Runs of logs are told: they are rows.
    let request = FitRequest { free_run: (&files[..1]).into(), ..FitRequest::default() };
    let fitted = crate::fit::<Narx>(&Recipe::default(), &request, of(file), &Silent).unwrap();
    assert!(fitted.report.files.unwrap().mean[0].fit > 0.98);
    assert!(fitted.report.summary.notes.iter().any(|note| note.contains("trained the model")));
}

#[test]
fn row_options_are_refused_with_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let files = logs(folder.path(), 2, 120, false);
    let narx = "[narx]\nlags_out = 2\nlags_in = 1\n";
    let file = scanned(&recipe(narx), &files);
    for (more, parts) in [
        (format!("{narx}select = \"free-run\"\n"), ["free-run", "give the logs"]),
        (format!("{narx}decimate = 2\n"), ["decimate = 2", "give the logs"]),
        (format!("{narx}test_share = 0.2\n"), ["test_share = 0.2", "give the logs"]),
        (format!("{narx}terms = 3\nobjective = \"steps:5\"\n"), ["steps", "logs"]),
        ("[narx]\nlags_out = 3\nlags_in = 1\nterms = 3\n[model]\ndegree = 2\n".to_owned(), ["ny 3 nu 1", "scan again"]),
        (format!("{narx}terms = 3\n[model]\npartition = \"kmeans:2\"\n"), ["no sums for `fit narx`", "scan again"]),
    ] {
        let error = fit(&recipe(&more), of(file.clone())).expect_err(&more).to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{more}: {error}");
    }
    let none = scanned(&recipe(""), &files);
    assert!(!serves(&none).iter().any(|method| method.starts_with("fit narx")), "nothing is summed unasked");
    let error = fit(&recipe(narx), of(none)).unwrap_err().to_string();
    assert!(error.contains("no sums for `fit narx`"), "{error}");
    // Of a recipe that picks rows, the other sums are made all the same.
    let report = scan(&recipe("[narx]\ndecimate = 3\n"), &ScanOptions::default(), None, &files, &Silent).unwrap().1;
    assert!(report.notes.iter().any(|note| note.contains("`fit narx` will need the logs")), "{:?}", report.notes);
}

#[test]
fn fewer_lags_than_were_summed_are_columns_of_the_sums() {
    let folder = tempfile::tempdir().unwrap();
    let files = logs(folder.path(), 3, 300, false);
    let wide = scanned(&recipe("[narx]\nlags_out = 4\nlags_in = 3\n[model]\ndegree = 2\n"), &files);
    let recipe = recipe("[narx]\nlags_out = 2\nlags_in = 2\nterms = 4\n[model]\ndegree = 2\n");
    let given = crate::NarxOptions::new(&recipe).unwrap().order;
    assert!(matches!(given, OrderRule::Fixed(_)) && given != OrderRule::Look(GivenOrder::default()));
    let (of_sums, of_logs) = (fit(&recipe, of(wide)).unwrap().1, fit(&recipe, &files).unwrap().1);
    // Rows that lack the longer lags, two of every log, train the one and not the other.
    assert_eq!(of_logs.rows - of_sums.rows, 2 * 3);
    for (a, b) in of_sums.regions[0].equations[0].terms.iter().zip(&of_logs.regions[0].equations[0].terms) {
        assert!(a.function == b.function && (a.coefficient - b.coefficient).abs() < 1e-3, "{a:?} {b:?}");
    }
}
