//! Agreement of thresholding and greedy selection with pysindy on the problems of `data/thresholds.py`.

use faer::Mat;
use fleetfoot_sparse::threshold::{
    Frols, FrolsChoice, Optimizer, Regularizer, Removal, Scaling, Sr3, Ssr, Stlsq, Terms, optimize,
};
use fleetfoot_stats::{Compressed, svd};

use crate::thresholds::compressed;

/// One answer of the peer.
struct Answer {
    kind: String,
    more: Vec<f64>,
    coefficients: Vec<f64>,
    err: Vec<f64>,
}

/// Rows `[x y]`, and a column of ones before them or not.
struct Case {
    name: String,
    rows: Mat<f64>,
    constant: bool,
    answers: Vec<Answer>,
}

fn numbers<'a>(words: impl Iterator<Item = &'a str>) -> Vec<f64> {
    words.map(|word| word.parse().expect("a number")).collect()
}

fn read() -> Vec<Case> {
    let mut cases: Vec<Case> = Vec::new();
    let mut lines = include_str!("../data/thresholds.txt").lines().skip(1);
    while let Some(line) = lines.next() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("case") => {
                let name = words.next().expect("a name").to_owned();
                let shape = numbers(words);
                let (n, p) = (shape[0] as usize, shape[1] as usize);
                let rows: Vec<Vec<f64>> =
                    (0..n).map(|_| numbers(lines.next().expect("a row").split_whitespace())).collect();
                let rows = Mat::from_fn(n, p + 1, |i, j| rows[i][j]);
                cases.push(Case { name, rows, constant: shape[2] == 1.0, answers: Vec::new() });
            }
            Some("answer") => {
                let kind = words.next().expect("a kind").to_owned();
                let more = numbers(words);
                let coefficients = numbers(lines.next().expect("coefficients").split_whitespace());
                let answer = Answer { kind, more, coefficients, err: Vec::new() };
                cases.last_mut().expect("a case before").answers.push(answer);
            }
            Some("err") => {
                let answer = cases.last_mut().and_then(|case| case.answers.last_mut());
                answer.expect("an answer before").err = numbers(words);
            }
            Some("end") => return cases,
            other => panic!("{other:?}"),
        }
    }
    panic!("the fixture is cut off");
}

fn length(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|value| value * value).sum::<f64>().sqrt()
}

/// Lengths of the columns over that of the target: what coefficients move the fit by.
fn shares(problem: &Compressed, target: usize) -> Vec<f64> {
    let z = problem.z.col_as_slice(target).iter().copied();
    let size = length(z.chain([problem.residual[target].sqrt()]));
    let column = |j: usize| length(problem.r.col_as_slice(j).iter().copied());
    (0..problem.columns()).map(|j| column(j) / size).collect()
}

/// Condition number of the columns at unit length.
fn condition(problem: &Compressed) -> f64 {
    let p = problem.columns();
    let size = |j: usize| length(problem.r.col_as_slice(j).iter().copied());
    let unit = Mat::from_fn(p, p, |i, j| problem.r[(i, j)] / size(j));
    let s = svd(unit.as_ref()).expect("singular values").s;
    s[0] / s[p - 1]
}

/// Returns true if the answer's coefficients are those of a last refit.
fn refitted(answer: &Answer) -> bool {
    let flag = match answer.kind.as_str() {
        "stlsq" | "ssr" | "frols" => 3,
        "sr3" => 5,
        _ => return false,
    };
    answer.more[flag] == 1.0
}

fn optimizer(answer: &Answer) -> (Optimizer, Terms) {
    let more = &answer.more;
    let flag = |k: usize| more[k] == 1.0;
    let scaling = |k: usize| if flag(k) { Scaling::Length } else { Scaling::Physical };
    let kappa = |k: usize| Some(more[k]).filter(|&kappa| kappa >= 0.0);
    let base = Stlsq { threshold: more[0], alpha: more[1], ..Stlsq::default() };
    match answer.kind.as_str() {
        "stlsq" => {
            let rest = Stlsq { scaling: scaling(2), unbias: flag(3), max_iterations: more[4] as usize, ..base };
            (Optimizer::Stlsq(rest), Terms::all())
        }
        "guess" => {
            let initial = Some(more[2..].to_vec());
            (Optimizer::Stlsq(Stlsq { unbias: false, initial, ..base }), Terms::all())
        }
        "fixed" => {
            let fixed = more[2..].iter().map(|&j| j as usize).collect();
            (Optimizer::Stlsq(Stlsq { unbias: false, ..base }), Terms { fixed, ..Terms::all() })
        }
        "sr3" => {
            let regularizer = [Regularizer::L0, Regularizer::L1, Regularizer::L2][more[1] as usize];
            let (lambda, nu, max_iterations) = (more[0], more[2], more[3] as usize);
            let shape = Sr3 { lambda, regularizer, nu, max_iterations, ..Sr3::default() };
            (Optimizer::Sr3(Sr3 { scaling: scaling(4), unbias: flag(5), ..shape }), Terms::all())
        }
        "ssr" => {
            let removal = if flag(1) { Removal::Residual } else { Removal::Coefficient };
            let shape = Ssr { alpha: more[0], removal, kappa: kappa(2), ..Ssr::default() };
            (Optimizer::Ssr(Ssr { unbias: flag(3), scaling: scaling(4), ..shape }), Terms::all())
        }
        "frols" => {
            let choice = FrolsChoice::LeastRatio { kappa: kappa(1).unwrap_or(0.0) };
            let shape = Frols { alpha: more[0], max_terms: more[2] as usize, choice, ..Frols::default() };
            (Optimizer::Frols(Frols { unbias: flag(3), scaling: scaling(4), ..shape }), Terms::all())
        }
        other => panic!("{other}"),
    }
}

/// Compares all answers of some kinds; returns how many there were.
fn agree(kinds: &[&str]) -> usize {
    let (mut count, mut wrong) = (0, Vec::new());
    for case in read() {
        let problem = compressed(&case.rows, 1, case.constant);
        let (shares, condition) = (shares(&problem, 0), condition(&problem));
        // The peer's ridge and SR3 solve normal equations, its last refit a least-squares problem by SVD.
        let normal = 1e-12 + 10.0 * f64::EPSILON * condition * condition;
        let orthogonal = 1e-12 + 100.0 * f64::EPSILON * condition;
        for answer in case.answers.iter().filter(|answer| kinds.contains(&answer.kind.as_str())) {
            let (optimizer, terms) = optimizer(answer);
            let trail = optimize(&problem, 0, &optimizer, &terms).expect("a model");
            let step = trail.choice();
            // Without noise, terms beyond the true ones are rounding, and nobody's choice of them is another's.
            let seen = |j: &usize| case.name != "lorenz0" || shares[*j] * answer.coefficients[*j].abs() > 1e-9;
            let theirs: Vec<usize> = (0..shares.len()).filter(|&j| answer.coefficients[j].abs() > 1e-14).collect();
            let theirs: Vec<usize> = theirs.into_iter().filter(seen).collect();
            let support: Vec<usize> = step.support.iter().copied().filter(seen).collect();
            let moves = |j: usize| shares[j] * (step.coefficients[j] - answer.coefficients[j]).abs();
            let largest = (0..shares.len()).map(|j| shares[j] * answer.coefficients[j].abs()).fold(1.0, f64::max);
            let apart = (0..shares.len()).map(moves).fold(0.0, f64::max) / largest;
            let tolerance = if refitted(answer) { orthogonal } else { normal };
            let ratios = trail.steps.last().and_then(|step| step.err.clone()).unwrap_or_default();
            let ratio = ratios.iter().zip(&answer.err).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            if support != theirs || apart.is_nan() || apart.max(ratio) > tolerance {
                let who = format!("{} {} {:?}", case.name, answer.kind, answer.more);
                wrong.push(format!("{who}: {support:?} {theirs:?} {apart:e} {ratio:e}"));
            }
            count += 1;
        }
    }
    assert!(wrong.is_empty(), "{} of {count}:\n{}", wrong.len(), wrong.join("\n"));
    count
}

#[test]
fn stlsq_matches_pysindy() {
    assert_eq!(agree(&["stlsq", "guess", "fixed"]), 360);
}

#[test]
fn sr3_matches_pysindy() {
    assert_eq!(agree(&["sr3"]), 168);
}

#[test]
fn ssr_matches_pysindy() {
    assert_eq!(agree(&["ssr"]), 274);
}

#[test]
fn frols_matches_pysindy() {
    assert_eq!(agree(&["frols"]), 46);
}
