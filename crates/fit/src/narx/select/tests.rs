//! Held-out errors of autoregressions, against those computed by hand.

use fleetfoot_data::{Column, MemorySource, Source, mix, with_threads};
use fleetfoot_recipe::Recipe;
use fleetfoot_task::EquationTask;

use super::*;
use crate::narx::{NarxOptions, task::one_row_ahead};

fn noise(seed: u64, row: u64) -> f64 {
    mix(mix(seed).wrapping_add(row)) as f64 / u64::MAX as f64 * 2.0 - 1.0
}

/// `y(k) = 0.7 y(k-1) + 0.5 u(k-1) + noise`.
fn recording(rows: usize) -> (Vec<f64>, Vec<f64>) {
    let u: Vec<f64> = (0..rows as u64).map(|row| noise(1, row)).collect();
    let mut y = vec![0.2];
    for k in 1..rows {
        y.push(0.7 * y[k - 1] + 0.5 * u[k - 1] + 0.1 * noise(2, k as u64));
    }
    (y, u)
}

/// Least squares of two terms by the normal equations, on the rows of every span but one, and the free run through that one.
fn by_hand(y: &[f64], u: &[f64], spans: &[std::ops::Range<usize>], held: usize) -> f64 {
    let (mut g, mut c) = ([0.0; 3], [0.0; 2]);
    for span in spans.iter().enumerate().filter(|(s, _)| *s != held).map(|(_, span)| span.clone()) {
        for k in span.start..span.end - 1 {
            g = [g[0] + y[k] * y[k], g[1] + y[k] * u[k], g[2] + u[k] * u[k]];
            c = [c[0] + y[k] * y[k + 1], c[1] + u[k] * y[k + 1]];
        }
    }
    let size = g[0] * g[2] - g[1] * g[1];
    let (a, b) = ((g[2] * c[0] - g[1] * c[1]) / size, (g[0] * c[1] - g[1] * c[0]) / size);
    let span = spans[held].clone();
    let measured = &y[span.start + 1..span.end];
    let mean = measured.iter().sum::<f64>() / measured.len() as f64;
    let (mut run, mut error) = (y[span.start], 0.0);
    for k in span.start..span.end - 1 {
        run = a * run + b * u[k];
        error += (y[k + 1] - run).powi(2);
    }
    (error / measured.iter().map(|y| (y - mean).powi(2)).sum::<f64>()).sqrt()
}

/// The rows of the three folds.
const SPANS: [Range<usize>; 3] = [0..90, 90..200, 200..300];

/// y and u, one row ahead.
fn base(source: &MemorySource) -> NarxBase {
    let recipe = Recipe::parse("[states]\ny = {}\n[inputs]\nu = \"u\"\n", "test").unwrap();
    let options = NarxOptions::new(&recipe).unwrap();
    let task = EquationTask::resolve(&one_row_ahead(&recipe, &options).unwrap(), source.columns()).unwrap();
    NarxBase::new(task, &recipe).unwrap()
}

/// A fold a span: all of them, each alone, and which is which.
fn folds(source: &MemorySource) -> (Spans<'_>, Vec<Spans<'_>>, BTreeMap<EpisodeId, usize>) {
    let cut = Spans::new(source, SPANS.iter().map(|span| (0, span.clone())).collect(), 1).unwrap();
    let held = SPANS.iter().map(|span| Spans::new(source, vec![(0, span.clone())], 1).unwrap()).collect();
    let fold_of = cut.episodes().iter().enumerate().map(|(fold, episode)| (episode.id, fold)).collect();
    (cut, held, fold_of)
}

#[test]
fn held_out_error_matches_refits() {
    let (y, u) = recording(300);
    let mut source = MemorySource::new(vec![Column::float("y"), Column::float("u")]);
    source.push_uniform("run", 1.0, vec![y.clone(), u.clone()]);
    let base = base(&source);
    let (cut, held, fold_of) = folds(&source);
    let partitions = [Choice::whole(0)];
    let selection = Selection {
        base: &base,
        partitions: &partitions,
        anew: &[],
        cut: &cut,
        held: &held,
        fold_of: &fold_of,
        first: 0,
        step: 1.0,
        by: By::Simulations,
    };
    let job = Job {
        order: NarxOrder { outputs: 1, inputs: 1, degree: 2, direct: false, every: 1 },
        terms: TermRule::Auto(4),
    };
    let tried = with_threads(1, || selection.run(&[job], &Silent)).unwrap();
    let of = |tried: &[Tried]| tried.iter().map(|tried| tried.candidate.clone()).collect::<Vec<_>>();
    assert_eq!(of(&tried), of(&with_threads(3, || selection.run(&[job], &Silent)).unwrap()));
    // Forward regression takes y and u on all rows; what is held out is their error, whatever it would take on a part of them.
    let two = &tried[1];
    let mut columns = two.supports[0][0].columns.clone();
    columns.sort_unstable();
    assert_eq!(columns, [1, 2]);
    for (fold, error) in two.candidate.folds.iter().enumerate() {
        let exact = by_hand(&y, &u, &SPANS, fold);
        assert!((error - exact).abs() < 1e-10, "{fold}: {error} {exact}");
    }
    assert!((two.candidate.rrse - two.candidate.folds.iter().sum::<f64>() / 3.0).abs() < 1e-15);
}

#[test]
fn one_step_errors_and_criteria_match_rows() {
    let (y, u) = recording(300);
    let mut source = MemorySource::new(vec![Column::float("y"), Column::float("u")]);
    source.push_uniform("run", 1.0, vec![y.clone(), u.clone()]);
    let base = base(&source);
    let (cut, held, fold_of) = folds(&source);
    let cells = Partition {
        columns: vec![fleetfoot_library::Expr::column("u")],
        centre: vec![0.0],
        scale: vec![1.0],
        rule: fleetfoot_model::Rule::voronoi(vec![vec![-0.5], vec![0.5]]),
        ..Partition::whole()
    };
    let specification = fleetfoot_pwa::Specification::KMeans(2);
    let partitions = [Choice::whole(0), Choice { specification, partition: Some(cells), seed: 0 }];
    let selection = Selection {
        base: &base,
        partitions: &partitions,
        anew: &[],
        cut: &cut,
        held: &held,
        fold_of: &fold_of,
        first: 0,
        step: 1.0,
        by: By::OneStep,
    };
    let job =
        Job { order: NarxOrder { outputs: 1, inputs: 1, degree: 1, direct: false, every: 1 }, terms: TermRule::All };
    let tried = selection.run(&[job], &Silent).unwrap();
    assert_eq!(tried.len(), 2);
    // Rows of a span whose successor is in it, too: 1, y, u and what follows.
    let rows =
        |span: &Range<usize>| (span.start..span.end - 1).map(|k| [1.0, y[k], u[k], y[k + 1]]).collect::<Vec<_>>();
    let spans: Vec<Vec<[f64; 4]>> = SPANS.iter().map(rows).collect();
    let solved = |rows: &[[f64; 4]]| {
        use faer::linalg::solvers::SolveLstsq;
        let x = Mat::from_fn(rows.len(), 3, |i, j| rows[i][j]);
        x.qr().solve_lstsq(Mat::from_fn(rows.len(), 1, |i, _| rows[i][3]))
    };
    let squares = |rows: &[[f64; 4]], beta: &Mat<f64>| {
        rows.iter().map(|row| (row[3] - (0..3).map(|j| row[j] * beta[(j, 0)]).sum::<f64>()).powi(2)).sum::<f64>()
    };
    let all = spans.concat();
    let mean = all.iter().map(|row| row[3]).sum::<f64>() / all.len() as f64;
    let variance = all.iter().map(|row| (row[3] - mean).powi(2)).sum::<f64>() / all.len() as f64;
    type Region = fn(&[f64; 4]) -> bool;
    let regions: [&[Region]; 2] = [&[|_| true], &[|row| row[2] <= 0.0, |row| row[2] > 0.0]];
    for (tried, regions) in tried.iter().zip(regions) {
        let of = |rows: &[[f64; 4]], region: &Region| rows.iter().copied().filter(region).collect::<Vec<_>>();
        for (fold, loss) in tried.candidate.losses.iter().enumerate() {
            let others: Vec<[f64; 4]> = (0..3).filter(|&s| s != fold).flat_map(|s| spans[s].clone()).collect();
            let error: f64 =
                regions.iter().map(|one| squares(&of(&spans[fold], one), &solved(&of(&others, one)))).sum();
            let exact = error / spans[fold].len() as f64 / variance;
            assert!((loss / exact - 1.0).abs() < 1e-9, "{loss} {exact}");
        }
        assert!((tried.candidate.loss.unwrap() - tried.candidate.losses.iter().sum::<f64>() / 3.0).abs() < 1e-15);
        assert!(tried.candidate.rrse.is_nan() && tried.candidate.folds.is_empty(), "nothing is simulated");
        assert_eq!(tried.candidate.coefficients, 3 * regions.len());
        let error: f64 = regions.iter().map(|one| squares(&of(&all, one), &solved(&of(&all, one)))).sum();
        // Both criteria have the same first part: (BIC - AIC) / k = ln n - 2 tells the rows that count, and BIC the rest.
        let (k, n) = ((3 * regions.len()) as f64, all.len() as f64);
        let [bic, aic] = [tried.candidate.bic, tried.candidate.aic].map(Option::unwrap);
        let independent = ((bic - aic) / k + 2.0).exp();
        assert!(independent > 1.0 && independent <= n * (1.0 + 1e-9), "{independent}");
        let exact = independent * (error / n).ln() + k * independent.ln();
        assert!((bic / exact - 1.0).abs() < 1e-8, "{bic} {exact}");
    }
}

#[test]
fn folds_are_simulated_in_training_regions() {
    let (y, u) = recording(300);
    let mut source = MemorySource::new(vec![Column::float("y"), Column::float("u")]);
    source.push_uniform("run", 1.0, vec![y, u]);
    let base = base(&source);
    let (cut, held, fold_of) = folds(&source);
    // Cut in two, in three, and not at all: that of all rows is another again.
    let on = |centroids: &[f64]| Partition {
        columns: vec![fleetfoot_library::Expr::column("u")],
        centre: vec![0.0],
        scale: vec![1.0],
        rule: fleetfoot_model::Rule::voronoi(centroids.iter().map(|&c| vec![c]).collect()),
        ..Partition::whole()
    };
    let anew = [on(&[-0.4, 0.3]), on(&[-0.5, 0.0, 0.6]), on(&[0.1])];
    let of_all = on(&[-0.9, 0.9]);
    let run = |partition: &Partition, anew: &[Vec<Partition>], terms: TermRule| {
        let specification = fleetfoot_pwa::Specification::Refined(2);
        let partitions = [Choice { specification, partition: Some(partition.clone()), seed: 0 }];
        let selection = Selection {
            base: &base,
            partitions: &partitions,
            anew,
            cut: &cut,
            held: &held,
            fold_of: &fold_of,
            first: 0,
            step: 1.0,
            by: By::Simulations,
        };
        let job = Job { order: NarxOrder { outputs: 1, inputs: 1, degree: 1, direct: false, every: 1 }, terms };
        let tried = selection.run(&[job], &Silent).unwrap();
        tried.into_iter().map(|tried| tried.candidate).collect::<Vec<_>>()
    };
    let candidates = run(&of_all, &[anew.to_vec()], TermRule::All);
    for (fold, assignment) in anew.iter().enumerate() {
        let alone = run(assignment, &[], TermRule::All);
        assert_eq!(candidates[0].folds[fold], alone[0].folds[fold], "{fold}");
    }
    assert_eq!(candidates[0].regions, 2, "what is written has the regions of all rows");
    assert!(candidates[0].folds != run(&of_all, &[], TermRule::All)[0].folds);
    // If terms are chosen, every region of a fold has that number of terms.
    let candidates = run(&of_all, &[anew.to_vec()], TermRule::Auto(3));
    assert_eq!(candidates.iter().map(|candidate| candidate.terms).collect::<Vec<_>>(), [1, 2, 3]);
    assert!(candidates.iter().all(|candidate| candidate.rrse.is_finite()), "{candidates:?}");
}
