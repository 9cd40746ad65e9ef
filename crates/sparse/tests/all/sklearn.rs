//! Agreement with scikit-learn on the problems of `data/paths_sklearn.py`.

use faer::Mat;
use fleetfoot_sparse::{
    Penalty, Quadratic, Sign, Strength, certificate,
    coordinate::{CoordinateOptions, coordinate_descent},
    lars::{LarsOptions, Method, lars},
};

/// One answer of the peer: coefficients at every alpha.
struct Answer {
    kind: String,
    unique: bool,
    intercept: bool,
    more: Vec<f64>,
    alphas: Vec<f64>,
    coefficients: Vec<Vec<f64>>,
}

struct Case {
    name: String,
    x: Mat<f64>,
    y: Vec<f64>,
    answers: Vec<Answer>,
}

fn numbers<'a>(words: impl Iterator<Item = &'a str>) -> Vec<f64> {
    words.map(|word| word.parse().expect("a number")).collect()
}

fn read() -> Vec<Case> {
    let mut cases: Vec<Case> = Vec::new();
    let mut lines = include_str!("../data/paths_sklearn.txt").lines().skip(1);
    while let Some(line) = lines.next() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("case") => {
                let name = words.next().expect("a name").to_owned();
                let shape = numbers(words);
                let (n, p) = (shape[0] as usize, shape[1] as usize);
                let rows: Vec<Vec<f64>> =
                    (0..n).map(|_| numbers(lines.next().expect("a row").split_whitespace())).collect();
                let x = Mat::from_fn(n, p, |i, j| rows[i][j]);
                cases.push(Case { name, x, y: rows.iter().map(|row| row[p]).collect(), answers: Vec::new() });
            }
            Some("answer") => {
                let kind = words.next().expect("a kind").to_owned();
                let more = numbers(words);
                let alphas = numbers(lines.next().expect("alphas").split_whitespace().skip(2));
                let row = |_| numbers(lines.next().expect("coefficients").split_whitespace());
                let coefficients = alphas.iter().map(row).collect();
                let answer = Answer {
                    kind,
                    unique: more[0] == 1.0,
                    intercept: more[1] == 1.0,
                    more: more[2..].to_vec(),
                    alphas,
                    coefficients,
                };
                cases.last_mut().expect("a case before").answers.push(answer);
            }
            Some("end") => return cases,
            other => panic!("{other:?}"),
        }
    }
    panic!("the fixture is cut off");
}

/// Largest difference of coefficients, relative to what moves the prediction by the target's deviation.
fn difference(problem: &Quadratic, a: &[f64], b: &[f64]) -> f64 {
    let tau = problem.target_deviation();
    let scaled = problem.deviation().into_iter().zip(a.iter().zip(b)).map(|(s, (a, b))| s / tau * (a - b).abs());
    scaled.fold(0.0, f64::max)
}

/// Compares coefficients where the minimiser is unique, else objectives.
fn agree(
    who: &str,
    problem: &Quadratic,
    penalty: &Penalty,
    strength: Strength,
    answer: (&Answer, &[f64]),
    solutions: &[f64],
) {
    let (answer, theirs) = answer;
    if answer.unique {
        let apart = difference(problem, theirs, solutions);
        assert!(apart < 1e-9, "{who}: coefficients are {apart:e} apart");
    }
    let objective = |b: &[f64]| certificate(problem, penalty, strength, b).expect("a certificate").objective;
    let scale = problem.target_deviation().powi(2);
    let apart = (objective(theirs) - objective(solutions)) / scale;
    assert!(apart.abs() < 1e-9, "{who}: objectives are {apart:e} apart");
}

#[test]
fn knots_match_lars_path_gram() {
    let mut compared = 0;
    for case in read() {
        for answer in case.answers.iter().filter(|answer| answer.kind.starts_with("lars_path_gram")) {
            for form in ["root", "gram"] {
                let method = if answer.kind.ends_with("lasso") { Method::Lasso } else { Method::Lars };
                let root = Quadratic::from_rows(case.x.as_ref(), &case.y, None, true).expect("rows");
                let problem = if form == "root" { root } else { products(&case) };
                let options = LarsOptions { method, ..LarsOptions::default() };
                let path = lars(&problem, &Penalty::default(), &options).expect("a path");
                let who = format!("{}, {}, {form}", case.name, answer.kind);
                assert_eq!(path.knots.len(), answer.alphas.len(), "{who}: knots");
                for (k, (&alpha, theirs)) in answer.alphas.iter().zip(&answer.coefficients).enumerate() {
                    let apart = (path.knots[k].l1 - alpha).abs() / answer.alphas[0];
                    assert!(apart < 1e-9, "{who}, knot {k}: lambda is {apart:e} apart");
                    let apart = difference(&problem, theirs, &path.knots[k].dense(case.x.ncols()));
                    assert!(apart < 1e-9, "{who}, knot {k}: coefficients are {apart:e} apart");
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 200, "{compared}");
}

/// The centred products, computed here.
fn products(case: &Case) -> Quadratic {
    let (n, p) = case.x.shape();
    let mean = |value: &dyn Fn(usize) -> f64| (0..n).map(value).sum::<f64>() / n as f64;
    let means: Vec<f64> = (0..p).map(|j| mean(&|i| case.x[(i, j)])).collect();
    let mean_y = mean(&|i| case.y[i]);
    let x = Mat::from_fn(n, p, |i, j| case.x[(i, j)] - means[j]);
    let xy: Vec<f64> = (0..p).map(|j| (0..n).map(|i| x[(i, j)] * (case.y[i] - mean_y)).sum()).collect();
    let yy = case.y.iter().map(|y| (y - mean_y).powi(2)).sum();
    Quadratic::from_products((x.transpose() * &x).as_ref(), &xy, yy, n as f64).expect("moments")
}

#[test]
fn solutions_match_estimators() {
    let mut compared = 0;
    for case in read() {
        for answer in case.answers.iter().filter(|answer| !answer.kind.starts_with("lars_path_gram")) {
            let problem = Quadratic::from_rows(case.x.as_ref(), &case.y, None, answer.intercept).expect("rows");
            let positive = answer.kind == "Lasso" && answer.more[0] == 1.0;
            let signs = if positive { vec![Sign::NonNegative; case.x.ncols()] } else { Vec::new() };
            let penalty = Penalty { signs, ..Penalty::default() };
            let l1_ratio = if answer.kind == "ElasticNet" { answer.more[0] } else { 1.0 };
            let options = CoordinateOptions { l1_ratio, ..CoordinateOptions::default() };
            let solutions = coordinate_descent(&problem, &penalty, &answer.alphas, &options).expect("solutions");
            for ((&alpha, theirs), solution) in answer.alphas.iter().zip(&answer.coefficients).zip(&solutions) {
                let who = format!("{}, {} {:?}, alpha = {alpha}", case.name, answer.kind, answer.more);
                let strength = Strength::elastic_net(alpha, l1_ratio);
                let ours = solution.dense(case.x.ncols());
                agree(&format!("{who}, descent"), &problem, &penalty, strength, (answer, theirs), &ours);
                let options = LarsOptions { l2: strength.l2, ..LarsOptions::default() };
                let path = lars(&problem, &penalty, &options).expect("a path");
                let ours = path.coefficients(strength.l1).expect("on the path");
                agree(&format!("{who}, path"), &problem, &penalty, strength, (answer, theirs), &ours);
                compared += 1;
            }
        }
    }
    assert!(compared > 250, "{compared}");
}
