//! Equations from logs, from their statistic, from that of two halves, and from parts that were scanned apart: the same bytes.

use super::*;
use crate::{FitRequest, Pwa, PwaReport, sindy::Sindy};

/// Logs of a driven pendulum with a delayed input and an unevenly or evenly stamped clock: `x' = v`, `v' = -9 sin x - 0.3 v + 2 u(t - 0.05)`.
fn pendulum(folder: &Path, logs: usize, rows: usize, jitter: f64) -> Vec<PathBuf> {
    let drive = |t: f64| (2.3 * t).sin() + 0.5 * (5.1 * t).cos();
    let mut files = Vec::new();
    for log in 0..logs {
        let (mut x, mut v, mut text) = (0.4 + 0.5 * log as f64, 0.0, String::from("t,x,v,u,m,dv\n"));
        let mut t = 0.0;
        for row in 0..rows + 13 * log {
            let a = -9.0 * f64::sin(x) - 0.3 * v + 2.0 * drive(t - 0.05);
            let noise = |k: f64| 1e-3 * (k * row as f64 + log as f64).sin();
            let columns = [t, x + noise(7.3), v + noise(11.9), drive(t), 1.0 + 0.1 * log as f64, a + noise(3.1)];
            text.push_str(&format!("{}\n", columns.map(|value| value.to_string()).join(",")));
            let step = 0.01 * (1.0 + jitter * (row as f64 * 1.7).sin());
            (x, v, t) = (x + step * v, v + step * a, t + step);
        }
        let path = folder.join(format!("log_{log}.csv"));
        fs::write(&path, text).unwrap();
        files.push(path);
    }
    files
}

const STATES: &str = "[states]\nx = {}\nv = {}\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n";

/// Recipes, and the setting of each that a statistic must keep.
fn recipes() -> Vec<(&'static str, String)> {
    let with = |more: &str| format!("{STATES}{more}");
    let nominal = "[states]\nx = { known = \"v\" }\nv = { derivative = \"dv\", nominal = \"-9*sin(x)/m\" }\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n\
                   [library]\nfunctions = [\"poly(1)\", \"delay(u, 0.05)\", \"lag1(u, 0.1)\"]\n[model]\nweight = \"1 + x^2\"\n";
    vec![
        ("moments", with("[model]\ndegree = 3\n")),
        ("products", with("[library]\nfunctions = [\"poly(1)\", \"sin(x)\", \"abs(v)\"]\n[sindy]\nfolds = \"4\"\n")),
        ("an ensemble", with("[sindy]\nensemble = \"chunks:20\"\nselect = \"bic\"\n")),
        ("nominal parts and delays", nominal.to_owned()),
        ("regions", with("[model]\ndegree = 1\npartition = \"kmeans:3\"\n[sindy]\nseed = 3\n")),
    ]
}

fn model(recipe: &Recipe, logs: impl Into<fleetfoot_dataset::Logs>) -> (String, crate::SindyReport) {
    let fitted = crate::fit::<Sindy>(recipe, &FitRequest::default(), logs, &Silent).unwrap();
    (fitted.model.to_json(), fitted.report)
}

fn of(file: StatisticFile) -> fleetfoot_dataset::Logs {
    fleetfoot_dataset::Logs::of_statistic(std::sync::Arc::new(file))
}

/// Small statistics with equations: moments, and products in regions.
pub(super) fn small(folder: &Path) -> Vec<Vec<u8>> {
    let files = pendulum(folder, 2, 60, 0.1);
    let of = |place: usize| {
        let recipe = Recipe::parse(&recipes()[place].1, "test").unwrap();
        bytes(&scan(&recipe, &ScanOptions::default(), None, &files, &Silent).unwrap().0)
    };
    vec![of(0), of(4)]
}

#[test]
fn logs_and_their_statistics_give_the_same_equations() {
    for jitter in [0.0, 0.2] {
        let folder = tempfile::tempdir().unwrap();
        let files = pendulum(folder.path(), 4, 260, jitter);
        for (what, text) in recipes() {
            let recipe = Recipe::parse(&text, "test").unwrap();
            let options = ScanOptions::default();
            let (wanted, report) = model(&recipe, &files);
            let (all, outcome) = scan(&recipe, &options, None, &files, &Silent).unwrap();
            assert!(all.equations.is_some() && serves(&all).len() >= 2, "{what}: {:?}", outcome.notes);
            let read = StatisticFile::from_bytes(&bytes(&all), Path::new("run.stats")).unwrap().0;
            assert_eq!(read, all, "{what}");
            let plan = all.without_rows();
            let part = |files: &[PathBuf]| scan(&recipe, &options, Some(plan.clone()), files, &Silent).unwrap().0;
            let mut merged = part(&files[2..]);
            merged.merge("one", part(&files[..2]), "other").unwrap();
            assert_eq!(bytes(&merged), bytes(&all), "{what}");
            let (frozen, _) = freeze(&recipe, &options, &files, &Silent).unwrap();
            let mut apart = frozen.clone();
            for file in &files {
                apart.append(scan_part(&frozen, &options, std::slice::from_ref(file), &Silent).unwrap().0).unwrap();
            }
            for statistic in [read, merged, apart] {
                let (text, from_statistic) = model(&recipe, of(statistic));
                assert!(text == wanted, "{what}, jitter {jitter}:\n{text}\n{wanted}");
                let scores = |report: &crate::SindyReport| format!("{:?} {:?}", report.regions, report.fold_rule);
                assert_eq!(scores(&from_statistic), scores(&report), "{what}");
            }
            // Without a recipe it is that of the scan.
            assert_eq!(model(&Recipe::default(), of(all.clone())).0, wanted, "{what}");
            let mut dropped = all;
            dropped.drop_episodes(&[Unwanted::File("log_1.csv".into())]).unwrap();
            let others = [files[0].clone(), files[2].clone(), files[3].clone()];
            assert_eq!(bytes(&dropped), bytes(&part(&others)), "{what}");
        }
    }
}

#[test]
fn residuals_of_two_equations_covary() {
    let folder = tempfile::tempdir().unwrap();
    let files = pendulum(folder.path(), 2, 300, 0.0);
    let recipe = Recipe::parse(&recipes()[0].1, "test").unwrap();
    let file = scan(&recipe, &ScanOptions::default(), None, &files, &Silent).unwrap().0;
    let fitted = crate::fit::<Sindy>(&recipe, &FitRequest::default(), of(file), &Silent).unwrap();
    let covariance = &fitted.model.summaries[0].regions[0].residual_covariance;
    assert!(covariance.len() == 3 && covariance.iter().all(|entry| entry.is_finite()), "{covariance:?}");
}

#[test]
fn partitions_are_frozen_side_by_side() {
    let folder = tempfile::tempdir().unwrap();
    let files = pendulum(folder.path(), 3, 260, 0.0);
    let recipe = |partition: &str| {
        let more = format!("[model]\ndegree = 1\npartition = \"{partition}\"\n");
        Recipe::parse(&format!("{STATES}{more}"), "test").unwrap()
    };
    let all = scan(&recipe("average,kmeans:2,3,zscore:1.0"), &ScanOptions::default(), None, &files, &Silent).unwrap().0;
    let text = all.plan_text();
    for line in ["partition kmeans:2 over : x", "partition zscore:1 over : v", "candidate of the equations : u"] {
        assert!(text.contains(line), "{text}");
    }
    for partition in ["average", "kmeans:2", "kmeans:3", "zscore:1.0"] {
        let recipe = recipe(partition);
        assert_eq!(model(&recipe, of(all.clone())).0, model(&recipe, &files).0, "{partition}");
    }
    let message = |partition: &str| {
        let fitted = crate::fit::<Sindy>(&recipe(partition), &FitRequest::default(), of(all.clone()), &Silent);
        fitted.unwrap_err().to_string()
    };
    let other = message("kmeans:4");
    assert!(
        other.contains("average, kmeans:2 over x, v, kmeans:3 over x, v, zscore:1 over")
            && other.contains("scan again"),
        "{other}"
    );
    let mut elsewhere = recipe("kmeans:2");
    elsewhere.model.partition_on = Some(vec!["x".into()]);
    let other =
        crate::fit::<Sindy>(&elsewhere, &FitRequest::default(), of(all.clone()), &Silent).unwrap_err().to_string();
    assert!(other.contains("kmeans:2 over x: ") && other.contains("kmeans:2 over x, v"), "{other}");
    assert!(message("kmeans:2,3").contains("name one"));
}

#[test]
fn missing_sums_are_refused_with_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let files = pendulum(folder.path(), 2, 260, 0.0);
    let parse = |text: &str| Recipe::parse(text, "test").unwrap();
    let degree = |degree: u32| format!("{STATES}[model]\ndegree = {degree}\n");
    let options = ScanOptions::default();
    let file = scan(&parse(&degree(2)), &options, None, &files[..1], &Silent).unwrap().0;
    let message = |text: &str| {
        crate::fit::<Sindy>(&parse(text), &FitRequest::default(), of(file.clone()), &Silent).unwrap_err().to_string()
    };
    assert!(message(&degree(3)).contains("the statistic has no candidate `x^3`"), "{}", message(&degree(3)));
    let other = message(&STATES.replace("v = {}", "v = { derivative = \"dv\" }"));
    assert!(other.contains("other equations") && other.contains("give the logs"), "{other}");
    // A smaller library is a choice among the candidates.
    assert!(crate::fit::<Sindy>(&parse(&degree(1)), &FitRequest::default(), of(file.clone()), &Silent).is_ok());
    // Other logs go on with the same equations only.
    let more = |text: &str| scan(&parse(text), &options, Some(file.clone()), &files[1..], &Silent);
    assert!(more(&degree(2)).is_ok());
    let refused = more(
        &STATES.replace("v = {}", "v = { nominal = \"-9*sin(x)\" }").replace("[time]", "[model]\ndegree = 2\n[time]"),
    );
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("  - left side of the equations") && refused.contains("  + left side"), "{refused}");

    let latents =
        scan(&parse(&RECIPE.replace("\"a\"", "\"dv\"").replace("\"b\"", "\"m\"")), &options, None, &files, &Silent);
    let latents = latents.unwrap();
    assert!(latents.0.equations.is_none() && latents.1.notes.iter().any(|note| note.contains("`fit sindy` will need")));
    let error = crate::fit::<Sindy>(&parse(&degree(2)), &FitRequest::default(), of(latents.0), &Silent)
        .unwrap_err()
        .to_string();
    assert!(error.contains("no sums of equations") && error.contains("[latents]"), "{error}");
}

#[test]
fn threads_and_groups_give_equal_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let files = pendulum(folder.path(), 3, 260, 0.1);
    let recipe = Recipe::parse(&recipes()[4].1, "test").unwrap();
    let whole = || bytes(&scan(&recipe, &ScanOptions::default(), None, &files, &Silent).unwrap().0);
    let one = fleetfoot_data::with_threads(1, whole);
    assert_eq!(fleetfoot_data::with_threads(5, whole), one);
}

#[test]
fn other_formats_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let files = pendulum(folder.path(), 1, 60, 0.0);
    let recipe = Recipe::parse(&recipes()[0].1, "test").unwrap();
    let whole = bytes(&scan(&recipe, &ScanOptions::default(), None, &files, &Silent).unwrap().0);
    for (version, word) in [(1_u32, "lacks sums"), (2, "lacks sums"), (5, "newer fleetfoot")] {
        let mut other = whole.clone();
        other[8..12].copy_from_slice(&version.to_le_bytes());
        let body = other.len() - 32;
        let hash = blake3::hash(&other[..body]);
        other[body..].copy_from_slice(hash.as_bytes());
        let message = StatisticFile::from_bytes(&other, Path::new("run.stats")).unwrap_err().to_string();
        assert!(message.contains(word) && message.contains(&format!("format is {version}")), "{message}");
    }
}

/// A piecewise-affine fit with folds, of partitions to choose from.
fn piecewise(recipe: &Recipe, logs: impl Into<fleetfoot_dataset::Logs>) -> crate::Fitted<PwaReport> {
    let mut recipe = recipe.clone();
    recipe.pwa.folds = Some(5);
    crate::fit::<Pwa>(&recipe, &FitRequest { rivals: true, ..FitRequest::default() }, logs, &Silent).unwrap()
}

/// Recipe of a plant with a kink: `v' = -4 x - 0.3 v + 2 u` for x > 0, ten times as stiff below; in partitions to choose from.
fn kinked(folder: &Path, more: &str) -> (Recipe, Vec<PathBuf>) {
    let mut files = Vec::new();
    for log in 0..4 {
        let (mut x, mut v, mut text) = (0.2 * log as f64, 0.0, String::from("t,x,v,u,a\n"));
        for row in 0..400 + 7 * log {
            let t = 0.01 * row as f64;
            let u = (2.3 * t + log as f64).sin() + 0.5 * (5.1 * t).cos();
            let a = -if x > 0.0 { 4.0 } else { 40.0 } * x - 0.3 * v + 2.0 * u;
            let noise = 1e-3 * (7.3 * row as f64 + log as f64).sin();
            text.push_str(&format!("{t},{x},{v},{u},{}\n", a + noise));
            (x, v) = (x + 0.01 * v, v + 0.01 * a);
        }
        let path = folder.join(format!("kink_{log}.csv"));
        fs::write(&path, text).unwrap();
        files.push(path);
    }
    let text = format!(
        "[states]\nx = {{ known = \"v\" }}\nv = {{ derivative = \"a\" }}\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n[model]\npartition_on = [\"x\"]\n{more}"
    );
    (Recipe::parse(&text, "test").unwrap(), files)
}

#[test]
fn piecewise_models_are_fitted_and_chosen_without_the_logs() {
    let folder = tempfile::tempdir().unwrap();
    // Without a degree the equations have the monomials of degree 2, and `fit pwa` takes those of degree 1 among them.
    let (recipe, files) = kinked(folder.path(), "partition = \"null,average,kmeans:2,4,zscore:1.0\"\n");
    let options = ScanOptions::default();
    let all = scan(&recipe, &options, None, &files, &Silent).unwrap().0;
    assert!(
        serves(&all)[2].starts_with("fit pwa (--partition average | kmeans:2 | kmeans:4 | zscore:1"),
        "{:?}",
        serves(&all)
    );
    let (summed, wanted) = (piecewise(&recipe, of(all.clone())), piecewise(&recipe, &files));
    let (identification, logs) = (&summed.report.identification, &wanted.report.identification);
    assert_eq!(
        (identification.rows, identification.candidates.len(), identification.chosen),
        (logs.rows, 5, logs.chosen)
    );
    assert!((identification.effective_rows / logs.effective_rows - 1.0).abs() < 0.2, "chunks differ a little");
    for (a, b) in identification.candidates.iter().zip(&logs.candidates) {
        assert_eq!((&a.specification, a.regions), (&b.specification, b.regions));
        assert!(a.over_null.iter().all(|value| value.is_nan()) && a.mahalanobis.is_nan(), "rows are needed");
        // Chunks are cut otherwise, and clusters are made anew for every fold there.
        assert!(
            (a.loss / b.loss - 1.0).abs() < 1.0 && (a.r2[0] - b.r2[0]).abs() < 0.05,
            "{} {} {}",
            a.specification,
            a.loss,
            b.loss
        );
    }
    // All rows, the same regions: the same models up to rounding.
    for (a, b) in identification.models.iter().zip(&logs.models) {
        assert_eq!((&a.method, &a.equations, &a.columns), (&b.method, &b.equations, &b.columns));
        let (a_regions, b_regions) = (&a.summaries[0].regions, &b.summaries[0].regions);
        for (region, (one, other)) in a_regions.iter().zip(b_regions).enumerate() {
            assert_eq!((one.rows, &one.range, &one.name), (other.rows, &other.range, &other.name), "{}", a.method);
            let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-7 * b.abs().max(1e-3));
            assert!(close(&one.covariance, &other.covariance) && close(&one.mean, &other.mean));
            assert!(close(&one.residual_covariance, &other.residual_covariance), "{} {region}", a.method);
            let of = |model: &fleetfoot_model::Model| model.latents[0].affine().unwrap().coefficients[region].clone();
            assert!(close(&of(a), &of(b)), "{} {region}: {:?} {:?}", a.method, of(a), of(b));
        }
        assert_eq!((&a.training.recipe, a.training.rows), (&b.training.recipe, b.training.rows));
    }
    for word in ["absolute errors", "clustered on all rows"] {
        assert!(
            summed.report.summary.notes.iter().any(|note| note.contains(word)),
            "{word}: {:?}",
            summed.report.summary.notes
        );
    }
    // Halves that are merged, and parts that were scanned apart, file by file.
    let plan = all.without_rows();
    let part = |files: &[PathBuf]| scan(&recipe, &options, Some(plan.clone()), files, &Silent).unwrap().0;
    let mut merged = part(&files[2..]);
    merged.merge("one", part(&files[..2]), "other").unwrap();
    let mut apart = freeze(&recipe, &options, &files, &Silent).unwrap().0;
    let frozen = apart.clone();
    for file in &files {
        apart.append(scan_part(&frozen, &options, std::slice::from_ref(file), &Silent).unwrap().0).unwrap();
    }
    let read = StatisticFile::from_bytes(&bytes(&all), Path::new("run.stats")).unwrap().0;
    for statistic in [merged, apart, read] {
        assert_eq!(piecewise(&recipe, of(statistic)).model.to_json(), identification.model.to_json());
    }
    assert_eq!(piecewise(&Recipe::default(), of(all)).model.to_json(), identification.model.to_json());
}

#[test]
fn other_derivatives_have_separate_sums() {
    let folder = tempfile::tempdir().unwrap();
    let files = pendulum(folder.path(), 2, 260, 0.0);
    let parse = |text: &str| Recipe::parse(text, "test").unwrap();
    let recipe = parse(&STATES.replace("v = {}", "v = { derivative = \"dv\", nominal = \"-9*sin(x)\" }"));
    let file = scan(&recipe, &ScanOptions::default(), None, &files, &Silent).unwrap().0;
    // `fit pwa` knows no nominal part.
    assert_eq!(file.equations.as_ref().unwrap().groups.len(), 2);
    let fitted = piecewise(&recipe, of(file.clone()));
    let logs = piecewise(&recipe, &files);
    let coefficients =
        |fitted: &crate::Fitted<PwaReport>| fitted.model.latents[1].affine().unwrap().coefficients[0].clone();
    for (a, b) in coefficients(&fitted).iter().zip(coefficients(&logs)) {
        assert!((a - b).abs() < 1e-8 * b.abs().max(1.0), "{a} {b}");
    }
    let refused = |change: &dyn Fn(&mut Recipe)| {
        let mut recipe = recipe.clone();
        change(&mut recipe);
        crate::fit::<Pwa>(&recipe, &FitRequest::default(), of(file.clone()), &Silent).unwrap_err().to_string()
    };
    type Change = fn(&mut Recipe);
    let changes: [(Change, &str); 5] = [
        (|recipe| recipe.pwa.phase = Some("labels:x".parse().unwrap()), "--phase"),
        (|recipe| recipe.pwa.continuous = Some(true), "--continuous"),
        (|recipe| recipe.pwa.tsqr = Some(true), "--tsqr"),
        (|recipe| recipe.pwa.unseen_labels = Some(fleetfoot_recipe::UnseenLabels::Pool), "--unseen-labels"),
        (|recipe| recipe.pwa.select = Some(fleetfoot_recipe::PartitionChoice::Rollout), "--select rollout"),
    ];
    for (change, word) in changes {
        let message = refused(&change);
        assert!(message.contains(word) && message.contains("give the logs"), "{message}");
    }
    let message = refused(&|recipe| recipe.model.partition = Some("kmeans:7".into()));
    assert!(message.contains("scan again") && message.contains("--partition kmeans:7"), "{message}");
}
