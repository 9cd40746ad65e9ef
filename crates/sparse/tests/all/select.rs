//! Choosing lambda: agreement with scikit-learn, and with brute force on the rows.

use crate::common::{aircraft, gaussian, tasks::Tasks};
use faer::Mat;
use fleetfoot_data::{Column, EpisodeId, MemorySource, Silent, Source, with_threads};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_sparse::{
    Penalty, Quadratic,
    estimator::{ElasticNet, Estimator},
    group::{GroupLasso, Groups},
    lars::{LarsOptions, lars},
    select::{
        CriteriaOptions, CrossValidation, Folds, Lambdas, NoiseVariance, RandomSplits, SelectError, SelectOptions,
        cross_validate, cross_validate_task, effective_rows, information_criteria, task_criteria,
    },
    structured::{Assembly, assemble},
};
use fleetfoot_sums::structured::{Banks, Candidates, Plan, Regression, Task, Term};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn expr(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).expect("an expression")
}

fn latent(name: &str, functions: &[&str]) -> Candidates {
    Candidates { name: name.into(), functions: functions.iter().map(|text| expr(text)).collect() }
}

fn task(target: &str, terms: &[(usize, &str)], prior: bool) -> Task {
    let terms = terms.iter().map(|&(latent, text)| Term { latent, coefficient: expr(text) }).collect();
    Task { name: target.into(), target: expr(target), terms, prior }
}

fn banks(regression: &Regression, chunk_rows: usize, source: &MemorySource) -> Banks {
    let plan = Plan::new(regression.clone(), Vec::new(), chunk_rows, source).expect("a plan");
    Banks::new(&plan.scan(source, &Silent).expect("a scan"), |_| true)
}

/// A problem of the fixture as a recording: one episode, a task y = f(x0, x1, ...).
fn recording(x: &Mat<f64>, y: &[f64]) -> (MemorySource, Regression) {
    let names: Vec<String> = (0..x.ncols()).map(|j| format!("x{j}")).collect();
    let columns = names.iter().map(Column::float).chain([Column::float("y")]).collect();
    let mut source = MemorySource::new(columns);
    let values = (0..x.ncols()).map(|j| x.col_as_slice(j).to_vec()).chain([y.to_vec()]).collect();
    source.push_uniform("rows", 0.1, values);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let regression =
        Regression { latents: vec![latent("f", &names)], tasks: vec![task("y", &[(0, "1")], false)], weight: None };
    (source, regression)
}

fn numbers<'a>(words: impl Iterator<Item = &'a str>) -> Vec<f64> {
    words.map(|word| word.parse().expect("a number")).collect()
}

/// `(word after "cv" or "ic", its numbers, its lines)`.
type Answer = (String, Vec<f64>, Vec<Vec<f64>>);

struct Case {
    name: String,
    folds: usize,
    x: Mat<f64>,
    y: Vec<f64>,
    answers: Vec<Answer>,
}

fn cases() -> Vec<Case> {
    let mut cases: Vec<Case> = Vec::new();
    let mut lines = include_str!("../data/select_sklearn.txt").lines().skip(1);
    while let Some(line) = lines.next() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let mut block = |count: usize| -> Vec<Vec<f64>> {
            (0..count).map(|_| numbers(lines.next().expect("a line").split_whitespace())).collect()
        };
        match words[0] {
            "case" => {
                let shape = numbers(words[2..].iter().copied());
                let (n, p) = (shape[0] as usize, shape[1] as usize);
                let rows = block(n);
                let x = Mat::from_fn(n, p, |i, j| rows[i][j]);
                let y = rows.iter().map(|row| row[p]).collect();
                cases.push(Case { name: words[1].into(), folds: shape[2] as usize, x, y, answers: Vec::new() });
            }
            "end" => return cases,
            _ => {
                let parameters = numbers(words[2..].iter().copied());
                let lines = block(parameters[2] as usize);
                cases.last_mut().expect("a case").answers.push((words[1].into(), parameters, lines));
            }
        }
    }
    panic!("the fixture is cut off");
}

fn relative(a: f64, b: f64) -> f64 {
    (a - b).abs() / a.abs().max(b.abs()).max(f64::MIN_POSITIVE)
}

#[test]
fn cross_validation_matches_scikit_learn() {
    let mut compared = 0;
    for case in cases() {
        let (source, regression) = recording(&case.x, &case.y);
        let banks = banks(&regression, case.x.nrows() / case.folds, &source);
        let folds = Folds::by(banks.keys(), |key| Some(key.chunk)).expect("folds");
        for (kind, parameters, lines) in case.answers.iter().filter(|(kind, ..)| kind.ends_with("CV")) {
            let who = format!("{}, {kind} {}", case.name, parameters[0]);
            let run = |lambdas: Lambdas, most_for_lars: usize| {
                let net = ElasticNet { l1_ratio: parameters[0], most_for_lars, ..ElasticNet::default() };
                let options = SelectOptions { lambdas, estimator: net.into() };
                cross_validate_task(&banks, 0, &Penalty::default(), &folds, &options, &Silent).expect("errors")
            };
            let mut alphas: Vec<f64> = lines.iter().map(|line| line[0]).collect();
            alphas.sort_by(|a, b| b.total_cmp(a));
            for most_for_lars in [400, 0] {
                let validation = run(Lambdas::List(alphas.clone()), most_for_lars);
                assert_eq!(validation.lambdas, alphas, "{who}");
                assert!(validation.inexact.is_empty(), "{who}");
                assert_eq!(validation.best_lambda(), parameters[1], "{who}");
                for line in lines {
                    let at = alphas.iter().position(|alpha| *alpha == line[0]).expect("an alpha");
                    // Coordinate descent stops at a violation of 1e-9; the path is exact.
                    let tolerance = if most_for_lars > 0 && parameters[0] == 1.0 { 1e-9 } else { 1e-7 };
                    for (fold, theirs) in line[1..].iter().enumerate() {
                        let apart = relative(*theirs, validation.errors[(at, fold)]);
                        assert!(apart < tolerance, "{who}, alpha {}, fold {fold}: {apart:e}", line[0]);
                    }
                    let mean = line[1..].iter().sum::<f64>() / case.folds as f64;
                    assert!(relative(mean, validation.mean[at]) < tolerance, "{who}: mean");
                    let variance = line[1..].iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (case.folds - 1) as f64;
                    let error = (variance / case.folds as f64).sqrt();
                    assert!(
                        relative(error, validation.standard_error[at]) < 100.0 * tolerance,
                        "{who}: standard error"
                    );
                    compared += 1;
                }
            }
            if kind == "LassoLarsCV" {
                let validation = run(Lambdas::Knots, 400);
                assert!(
                    relative(validation.best_lambda(), parameters[1]) < 1e-9,
                    "{who}: {} {}",
                    validation.best_lambda(),
                    parameters[1]
                );
                // Every alpha of theirs that some fold has a knot at is one of ours.
                let apart =
                    |alpha: f64| validation.lambdas.iter().map(|l| (l - alpha).abs()).fold(f64::INFINITY, f64::min);
                let most = alphas.iter().map(|alpha| apart(*alpha)).fold(0.0, f64::max);
                assert!(most < 1e-9 * alphas[0], "{who}: {most:e}");
            }
        }
    }
    assert!(compared > 300, "{compared}");
}

#[test]
fn criteria_match_scikit_learn() {
    for case in cases() {
        let problem = Quadratic::from_rows(case.x.as_ref(), &case.y, None, true).expect("rows");
        let path = lars(&problem, &Penalty::default(), &LarsOptions::default()).expect("a path");
        for (kind, parameters, lines) in case.answers.iter().filter(|(kind, ..)| kind.ends_with("ic")) {
            for variance in [NoiseVariance::LeastSquares, NoiseVariance::Known(parameters[0])] {
                let options = CriteriaOptions { variance, ..CriteriaOptions::default() };
                let criteria = information_criteria(&problem, &Penalty::default(), &path, &options).expect("criteria");
                let (values, best) =
                    if kind == "aic" { (&criteria.aic, criteria.best[0]) } else { (&criteria.bic, criteria.best[1]) };
                // They do not count the intercept.
                let intercept = if kind == "aic" { 2.0 } else { (case.x.nrows() as f64).ln() };
                assert_eq!(values.len(), lines.len(), "{}", case.name);
                for ((value, lambda), line) in values.iter().zip(&criteria.lambdas).zip(lines) {
                    assert!((lambda - line[0]).abs() < 1e-9 * lines[0][0], "{}: {lambda} {}", case.name, line[0]);
                    assert!(
                        (value - intercept - line[1]).abs() < 1e-9 * line[1].abs(),
                        "{} {kind}: {value} {}",
                        case.name,
                        line[1]
                    );
                }
                assert!((criteria.lambdas[best] - parameters[1]).abs() < 1e-9 * lines[0][0], "{} {kind}", case.name);
            }
            // EBIC charges for the number of models: it is BIC at gamma = 0, and never larger a model.
            let options = CriteriaOptions { gamma: 0.0, ..CriteriaOptions::default() };
            let plain = information_criteria(&problem, &Penalty::default(), &path, &options).expect("criteria");
            assert_eq!(plain.bic, plain.ebic);
            let options = CriteriaOptions { gamma: 1.0, ..CriteriaOptions::default() };
            let criteria = information_criteria(&problem, &Penalty::default(), &path, &options).expect("criteria");
            assert!(criteria.degrees_of_freedom[criteria.best[2]] <= criteria.degrees_of_freedom[criteria.best[1]]);
        }
    }
}

/// Two latents in two tasks and a prior, episodes of different lengths: a constant, shared coefficients, correlated rows.
struct Study {
    source: MemorySource,
    regression: Regression,
    assembly: Assembly,
    /// Columns x, z, u, v, y, w, believed of every episode.
    episodes: Vec<Vec<Vec<f64>>>,
}

fn study() -> Study {
    let mut rng = Pcg64::seed_from_u64(2);
    let names = ["x", "z", "u", "v", "y", "w", "believed"];
    let mut source = MemorySource::new(names.iter().map(|name| Column::float(*name)).collect());
    let mut episodes = Vec::new();
    for rows in [40_usize, 75, 50, 61, 90] {
        let mut columns = vec![Vec::new(); names.len()];
        let mut state = [0.0_f64; 4];
        for _ in 0..rows {
            state.iter_mut().for_each(|value| *value = 0.8 * *value + 0.6 * gaussian(&mut rng));
            let [x, z, u, v] = state;
            let (f, g) = (1.0 + 2.0 * x - 0.5 * x * x, 1.5 * z);
            let y = f + u * g + 0.3 * gaussian(&mut rng);
            let w = v * f - g + 0.5 * gaussian(&mut rng);
            let row = [x, z, u, v, y, 100.0 * w, g + 0.2 * rng.random_range(-1.0..1.0)];
            columns.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
        }
        source.push_uniform(format!("episode {rows}"), 0.1, columns.clone());
        episodes.push(columns);
    }
    let regression = Regression {
        latents: vec![latent("f", &["1", "x", "x^2", "x^3"]), latent("g", &["z", "z^2", "x*z"])],
        tasks: vec![
            task("y", &[(0, "1"), (1, "u")], false),
            task("w", &[(0, "100*v"), (1, "-100")], false),
            task("believed", &[(1, "1")], true),
        ],
        weight: None,
    };
    let assembly = Assembly { weights: vec![1.0, 1e-4, 0.5], latents: vec![1.0, 0.7], ..Assembly::default() };
    Study { source, regression, assembly, episodes }
}

impl Study {
    /// The rows of some episodes as the block matrix knows them.
    fn rows(&self, wanted: impl Fn(usize) -> bool) -> Tasks {
        let all: Vec<&Vec<Vec<f64>>> =
            self.episodes.iter().enumerate().filter(|(e, _)| wanted(*e)).map(|(_, rows)| rows).collect();
        let column = |c: usize| all.iter().flat_map(|episode| episode[c].iter().copied()).collect::<Vec<f64>>();
        let [x, z, u, v, y, w, believed] = std::array::from_fn(column);
        let f = |i: usize| [1.0, x[i], x[i].powi(2), x[i].powi(3)];
        let g = |i: usize| [z[i], z[i].powi(2), x[i] * z[i]];
        let n = x.len();
        let first = Mat::from_fn(n, 8, |i, c| {
            if c < 4 {
                f(i)[c]
            } else if c < 7 {
                u[i] * g(i)[c - 4]
            } else {
                y[i]
            }
        });
        let second = Mat::from_fn(n, 8, |i, c| {
            if c < 4 {
                100.0 * v[i] * f(i)[c]
            } else if c < 7 {
                -100.0 * g(i)[c - 4]
            } else {
                w[i]
            }
        });
        let third = Mat::from_fn(n, 4, |i, c| if c < 3 { g(i)[c] } else { believed[i] });
        let structure = self.regression.structure();
        Tasks { structure, rows: vec![first, second, third], weights: vec![1.0; n], assembly: self.assembly.clone() }
    }
}

#[test]
fn held_out_errors_match_rows() {
    let study = study();
    let structure = study.regression.structure();
    let banks = banks(&study.regression, 16, &study.source);
    let folds = Folds::by(banks.keys(), |key| Some(key.episode)).expect("folds");
    let lambdas = vec![1.0, 0.3, 0.1, 0.03, 0.01, 0.001];
    let options = SelectOptions { lambdas: Lambdas::List(lambdas.clone()), ..SelectOptions::default() };
    let validation = cross_validate(&structure, &banks, &study.assembly, &folds, &options, &Silent).expect("errors");
    assert_eq!((validation.tasks.len(), validation.errors.ncols()), (2, 5));

    // Folds come in the order of the episodes' ids.
    let mut order: Vec<(EpisodeId, usize)> =
        study.source.episodes().iter().enumerate().map(|(e, info)| (info.id, e)).collect();
    order.sort();
    for (fold, &(_, episode)) in order.iter().enumerate() {
        let (train, test) = (study.rows(|e| e != episode), study.rows(|e| e == episode));
        let (b, y) = train.stacked();
        let scale = train.scale();
        let problem = train.explicit(&b, &y, &scale);
        let factors = structure.latent_of().iter().map(|&latent| study.assembly.latents[latent]).collect();
        let penalty = Penalty { factors, ..Penalty::default() };
        let path = lars(&problem, &penalty, &LarsOptions::default()).expect("a path");
        for (l, &lambda) in lambdas.iter().enumerate() {
            let theta = path.coefficients(lambda).expect("on the path");
            let mse = |task: usize| {
                let (rows, columns) = (&test.rows[task], structure.columns(task));
                let error = |i: usize| {
                    let predicted: f64 =
                        columns.iter().enumerate().map(|(c, &j)| rows[(i, c)] * theta[j] / scale[j]).sum();
                    rows[(i, columns.len())] - predicted
                };
                (0..rows.nrows()).map(|i| error(i).powi(2)).sum::<f64>() / rows.nrows() as f64
            };
            let (first, second) = (mse(0), mse(1));
            for (expected, value) in [
                (first, validation.tasks[0][(l, fold)]),
                (second, validation.tasks[1][(l, fold)]),
                (first + 1e-4 * second, validation.errors[(l, fold)]),
            ] {
                assert!(relative(expected, value) < 1e-9, "fold {fold}, lambda {lambda}: {expected} {value}");
            }
        }
        assert_eq!(validation.rows[fold], test.rows[0].nrows() as f64);
    }
    for l in 0..lambdas.len() {
        let mean = (0..5).map(|fold| validation.rows[fold] * validation.errors[(l, fold)]).sum::<f64>() / 316.0;
        assert!(relative(mean, validation.mean[l]) < 1e-12);
    }
    assert_eq!(
        validation.best,
        (0..6).min_by(|&a, &b| validation.mean[a].total_cmp(&validation.mean[b])).expect("six")
    );
    assert!(validation.one_standard_error <= validation.best);
    let limit = validation.mean[validation.best] + validation.standard_error[validation.best];
    assert!(validation.mean[validation.one_standard_error] <= limit);
    assert!((0..validation.one_standard_error).all(|l| validation.mean[l] > limit));
}

/// Nothing predicts turbulence: the best model errs on flights that it has not seen by hardly more than the true one.
#[test]
fn other_flights_identify_an_aircraft() {
    let climbs = aircraft::climbs(30, true);
    let banks = climbs.banks(4096);
    let folds = Folds::by(banks.keys(), |key| Some(key.episode)).expect("folds");
    assert_eq!(folds.len(), 30);
    let options = SelectOptions { lambdas: Lambdas::Grid { count: 60, ratio: 1e-7 }, ..SelectOptions::default() };
    let validation =
        cross_validate(&climbs.structure, &banks, &climbs.assembly, &folds, &options, &Silent).expect("errors");
    assert!(validation.inexact.is_empty());
    let ratio = validation.mean[validation.best] / climbs.unexplained;
    assert!((0.99..1.1).contains(&ratio), "{ratio}");
    // The one-standard-error model is smaller, and by the rule no worse than that error.
    assert!(validation.features[validation.one_standard_error] < validation.features[validation.best]);
    assert!(validation.mean[0] > 10.0 * validation.mean[validation.best]);
}

fn bits(cross_validation: &CrossValidation) -> Vec<u64> {
    let errors =
        (0..cross_validation.errors.ncols()).flat_map(|fold| cross_validation.errors.col_as_slice(fold).to_vec());
    errors.chain(cross_validation.mean.clone()).chain(cross_validation.lambdas.clone()).map(f64::to_bits).collect()
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let study = study();
    let structure = study.regression.structure();
    let run = |lambdas: Lambdas| {
        let banks = banks(&study.regression, 16, &study.source);
        let splits = RandomSplits { repeats: 7, ..RandomSplits::default() };
        let folds = Folds::random_splits(banks.keys(), banks.rows(), &splits).expect("folds");
        let options = SelectOptions { lambdas, ..SelectOptions::default() };
        cross_validate(&structure, &banks, &study.assembly, &folds, &options, &Silent).expect("errors")
    };
    for lambdas in [Lambdas::Knots, SelectOptions::default().lambdas] {
        let [one, seven] = [1, 7].map(|threads| with_threads(threads, || run(lambdas.clone())));
        assert_eq!(bits(&one), bits(&seven));
        assert_eq!(one, seven);
    }
}

/// Between knots the errors are quadratic in lambda, so that a fine grid finds nothing far below the best knot, and the grid's errors lie on the same curve.
/// Groups are chosen by the same folds and rule as single columns, with the same bits on any number of threads.
#[test]
fn groups_are_cross_validated_like_columns() {
    let study = study();
    let structure = study.regression.structure();
    let banks = banks(&study.regression, 16, &study.source);
    let folds = Folds::by(banks.keys(), |key| Some(key.episode)).expect("folds");
    let run = |threads: usize, estimator: Estimator| {
        let options = SelectOptions { lambdas: Lambdas::Grid { count: 30, ratio: 1e-4 }, estimator };
        let find = || cross_validate(&structure, &banks, &study.assembly, &folds, &options, &Silent).expect("errors");
        with_threads(threads, find)
    };
    let lasso = |of: &[usize], l1_ratio: f64| {
        Estimator::from(GroupLasso { l1_ratio, ..GroupLasso::new(Groups::new(of.to_vec())) })
    };
    // The constant, the powers of x, those of z, and the product.
    let signals = [0, 1, 1, 1, 2, 2, 3];
    for l1_ratio in [0.0, 0.5] {
        let validation = run(1, lasso(&signals, l1_ratio));
        assert_eq!(validation, run(3, lasso(&signals, l1_ratio)));
        assert!(validation.inexact.is_empty() && validation.one_standard_error <= validation.best);
        assert!(validation.mean[validation.best] < 0.2 * validation.mean[0]);
    }
    let (ones, plain) = (run(2, lasso(&[0, 1, 2, 3, 4, 5, 6], 0.0)), run(2, Estimator::default()));
    assert!(ones.mean.iter().zip(&plain.mean).all(|(a, b)| relative(*a, *b) < 1e-8));
    assert_eq!((ones.best, ones.one_standard_error), (plain.best, plain.one_standard_error));
    // An error of a fold is that of the rows of its episode.
    let lambda = 0.05 * run(1, lasso(&signals, 0.0)).lambdas[0];
    let options = SelectOptions { lambdas: Lambdas::List(vec![lambda]), estimator: lasso(&signals, 0.0) };
    let validation = cross_validate(&structure, &banks, &study.assembly, &folds, &options, &Silent).expect("errors");
    let mut of_episode: Vec<f64> = Vec::new();
    for episode in 0..study.episodes.len() {
        let train = study.rows(|e| e != episode);
        let assembled = assemble(&structure, &train.roots(), &study.assembly).expect("a problem");
        let solution = options.estimator.solutions(&assembled.problem, &assembled.penalty, &[lambda]);
        let theta = assembled.coefficients(&solution.expect("a solution")[0]);
        let test = study.rows(|e| e == episode);
        let error = |task: usize| {
            let (rows, columns) = (&test.rows[task], structure.columns(task));
            let left = |i: usize| {
                rows[(i, columns.len())]
                    - columns.iter().enumerate().map(|(k, &j)| rows[(i, k)] * theta[j]).sum::<f64>()
            };
            (0..rows.nrows()).map(|i| left(i).powi(2)).sum::<f64>() / rows.nrows() as f64
        };
        of_episode.push(error(0) + 1e-4 * error(1));
    }
    let mut of_fold: Vec<f64> = (0..5).map(|fold| validation.errors[(0, fold)]).collect();
    of_fold.sort_by(f64::total_cmp);
    of_episode.sort_by(f64::total_cmp);
    assert!(of_fold.iter().zip(&of_episode).all(|(a, b)| relative(*a, *b) < 1e-9), "{of_fold:?} {of_episode:?}");
}

#[test]
fn knots_and_grids_agree() {
    let study = study();
    let structure = study.regression.structure();
    let banks = banks(&study.regression, 16, &study.source);
    let folds = Folds::by(banks.keys(), |key| Some(key.episode)).expect("folds");
    let run = |lambdas: Lambdas, most_for_lars: usize| {
        let net = ElasticNet { most_for_lars, ..ElasticNet::default() };
        let options = SelectOptions { lambdas, estimator: net.into() };
        cross_validate(&structure, &banks, &study.assembly, &folds, &options, &Silent).expect("errors")
    };
    let knots = run(Lambdas::Knots, 400);
    let grid = run(Lambdas::List(knots.lambdas.clone()), 0);
    assert!(grid.inexact.is_empty());
    for (l, lambda) in knots.lambdas.iter().enumerate() {
        assert!(relative(knots.mean[l], grid.mean[l]) < 1e-6, "{lambda}: {} {}", knots.mean[l], grid.mean[l]);
    }
    assert_eq!(knots.lambdas.last(), Some(&0.0));
    assert!(knots.features.windows(2).any(|pair| pair[0] < pair[1]));
}

#[test]
fn correlated_rows_count_for_less() {
    let study = study();
    let structure = study.regression.structure();
    let banks = banks(&study.regression, 16, &study.source);
    let total = banks.total();
    let assembled = assemble(&structure, &total, &study.assembly).expect("a problem");
    let path = lars(&assembled.problem, &assembled.penalty, &LarsOptions::default()).expect("a path");
    let best = assembled.coefficients(path.knots.last().expect("a knot"));
    // The noise is white, the model is true: nearly all rows count. Without a model, what the slow states explain is left over.
    let white = effective_rows(&structure, &banks, &best).expect("rows");
    let correlated = effective_rows(&structure, &banks, &[0.0; 7]).expect("rows");
    assert!(white > 150.0 && white <= 316.0, "{white}");
    assert!(correlated < 0.5 * white, "{correlated} {white}");
    // From the rows: chunks of 16, every episode begins anew.
    let rows = study.rows(|_| true);
    let tau = [0, 1].map(|task| {
        let columns = structure.columns(task);
        let error = |i: usize| {
            let predicted: f64 = columns.iter().enumerate().map(|(c, &j)| rows.rows[task][(i, c)] * best[j]).sum();
            rows.rows[task][(i, columns.len())] - predicted
        };
        let (mut first, mut spread, mut square) = (0, 0.0, 0.0);
        for episode in &study.episodes {
            let length = episode[0].len();
            for chunk in (0..length).collect::<Vec<_>>().chunks(16) {
                spread += chunk.iter().map(|i| error(first + i)).sum::<f64>().powi(2);
                square += chunk.iter().map(|i| error(first + i).powi(2)).sum::<f64>();
            }
            first += length;
        }
        spread / square
    });
    let expected = 316.0 / tau[0].max(tau[1]).max(1.0);
    assert!(relative(expected, white) < 1e-9, "{expected} {white}");

    // Fewer observations, a smaller model; the true one is among them: 1, x, x^2 and z of seven.
    let options =
        |observations: f64| CriteriaOptions { observations: Some(observations), ..CriteriaOptions::default() };
    let choose = |observations: f64| {
        let criteria = task_criteria(&structure, &total, &study.assembly, &assembled, &path, &options(observations))
            .expect("criteria");
        criteria.degrees_of_freedom[criteria.best[1]]
    };
    assert!(choose(8.0) <= choose(2.0 * white));
    assert!(choose(2.0 * white) >= 4.0);
    // The measured tasks are scored, not the prior: from the rows, at the last knot.
    let criteria = task_criteria(&structure, &total, &study.assembly, &assembled, &path, &CriteriaOptions::default())
        .expect("criteria");
    let sum = |task: usize| {
        let (matrix, columns) = (&rows.rows[task], structure.columns(task));
        let predicted = |i: usize| columns.iter().enumerate().map(|(c, &j)| matrix[(i, c)] * best[j]).sum::<f64>();
        (0..316).map(|i| (matrix[(i, columns.len())] - predicted(i)).powi(2)).sum::<f64>() / 316.0
    };
    let expected = (sum(0) + 1e-4 * sum(1)) / 2.0;
    assert!(relative(expected, *criteria.mse.last().expect("a knot")) < 1e-9);
    assert_eq!(criteria.observations, 632.0);
}

#[test]
fn choices_that_are_not_possible_are_refused() {
    let study = study();
    let structure = study.regression.structure();
    let banks = banks(&study.regression, 16, &study.source);
    let folds = Folds::by(banks.keys(), |key| Some(key.episode)).expect("folds");
    let run = |folds: &Folds, lambdas: Vec<f64>| {
        let options = SelectOptions { lambdas: Lambdas::List(lambdas), ..SelectOptions::default() };
        cross_validate(&structure, &banks, &study.assembly, folds, &options, &Silent)
    };
    assert_eq!(run(&folds, Vec::new()), Err(SelectError::NoLambdas));
    assert!(run(&folds, vec![-1.0]).is_err_and(|error| error.to_string().contains("-1")));
    let fewer = Folds::by(&banks.keys()[1..], |key| Some(key.episode)).expect("folds");
    assert!(matches!(run(&fewer, vec![1.0]), Err(SelectError::Members { .. })));
    let options = SelectOptions::default();
    let missing = cross_validate_task(&banks, 3, &Penalty::default(), &folds, &options, &Silent);
    assert_eq!(missing, Err(SelectError::NoSuchTask { task: 3, tasks: 3 }));
    let rows =
        Quadratic::from_rows(Mat::<f64>::identity(4, 4).as_ref(), &[1.0, 2.0, 3.0, 5.0], None, true).expect("rows");
    let path = lars(&rows, &Penalty::default(), &LarsOptions::default()).expect("a path");
    let options = CriteriaOptions { variance: NoiseVariance::LeastSquares, ..CriteriaOptions::default() };
    let criteria = information_criteria(&rows, &Penalty::default(), &path, &options);
    assert!(matches!(criteria, Err(SelectError::NoVariance { .. })), "{criteria:?}");
}
