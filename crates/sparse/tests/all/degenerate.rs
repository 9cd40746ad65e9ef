//! Hundreds of small, mostly degenerate problems (`data/many_sklearn.py`): certificates at every knot first, then agreement with scikit-learn's answers.

use faer::Mat;
use fleetfoot_sparse::{
    Penalty, Quadratic, Strength, certificate,
    coordinate::{CoordinateOptions, coordinate_descent},
    lars::{LarsOptions, lars},
};
use fleetfoot_stats::Gram;

struct Answer {
    kind: String,
    unique: bool,
    alpha: f64,
    l1_ratio: f64,
    coefficients: Vec<f64>,
}

struct Case {
    name: String,
    x: Mat<f64>,
    y: Vec<f64>,
    intercept: bool,
    answers: Vec<Answer>,
}

fn numbers<'a>(words: impl Iterator<Item = &'a str>) -> Vec<f64> {
    words.map(|word| word.parse().expect("a number")).collect()
}

fn cases() -> Vec<Case> {
    let mut cases: Vec<Case> = Vec::new();
    let mut lines = include_str!("../data/many_sklearn.txt").lines().skip(1);
    while let Some(line) = lines.next() {
        let words: Vec<&str> = line.split(' ').collect();
        match words[0] {
            "case" => {
                let [n, p] = [2, 3].map(|at| words[at].parse::<usize>().expect("a size"));
                let rows: Vec<Vec<f64>> = (0..n).map(|_| numbers(lines.next().expect("a row").split(' '))).collect();
                let x = Mat::from_fn(n, p, |i, j| rows[i][j]);
                let y = rows.iter().map(|row| row[p]).collect();
                cases.push(Case { name: words[1].into(), x, y, intercept: words[4] == "1", answers: Vec::new() });
            }
            "answer" => cases.last_mut().expect("a case").answers.push(Answer {
                kind: words[1].into(),
                unique: words[2] == "1",
                alpha: words[3].parse().expect("a number"),
                l1_ratio: words[4].parse().expect("a number"),
                coefficients: numbers(lines.next().expect("coefficients").split(' ')),
            }),
            "path" => {
                for _ in 0..words[1].parse().expect("a count") {
                    let line = numbers(lines.next().expect("a knot").split(' '));
                    cases.last_mut().expect("a case").answers.push(Answer {
                        kind: "lars_path_gram".into(),
                        unique: line[1] == 1.0,
                        alpha: line[0],
                        l1_ratio: 1.0,
                        coefficients: line[2..].to_vec(),
                    });
                }
            }
            "end" => return cases,
            other => panic!("{other}"),
        }
    }
    panic!("the fixture is cut off");
}

impl Case {
    fn root(&self) -> Quadratic {
        Quadratic::from_rows(self.x.as_ref(), &self.y, None, self.intercept).expect("rows")
    }

    fn gram(&self) -> Quadratic {
        let (n, p) = self.x.shape();
        let z = Mat::from_fn(n, p + 1, |i, j| if j < p { self.x[(i, j)] } else { self.y[i] });
        if self.intercept {
            return Quadratic::from_gram(&Gram::of_rows(z.as_ref(), None), &(0..p).collect::<Vec<_>>(), p)
                .expect("a Gram matrix");
        }
        let products = z.transpose() * &z;
        let xy: Vec<f64> = (0..p).map(|j| products[(j, p)]).collect();
        Quadratic::from_products(products.submatrix(0, 0, p, p), &xy, products[(p, p)], n as f64).expect("products")
    }

    /// The fit of coefficients (about its mean where there is an intercept) minus that of others, relative to the target.
    fn fits_apart(&self, a: &[f64], b: &[f64]) -> f64 {
        let n = self.y.len();
        let fit = |i: usize| (0..a.len()).map(|j| self.x[(i, j)] * (a[j] - b[j])).sum::<f64>();
        let fits: Vec<f64> = (0..n).map(fit).collect();
        let mean = |values: &[f64]| if self.intercept { values.iter().sum::<f64>() / n as f64 } else { 0.0 };
        let length = |values: &[f64]| {
            let mean = mean(values);
            values.iter().map(|value| (value - mean).powi(2)).sum::<f64>().sqrt()
        };
        let size = length(&self.y);
        if size > 0.0 { length(&fits) / size } else { length(&fits) }
    }
}

#[test]
fn every_knot_of_every_problem_is_certified() {
    let (mut problems, mut knots) = (0, 0);
    for case in cases() {
        for (form, problem) in [("root", case.root()), ("gram", case.gram())] {
            for penalty in [Penalty::default(), Penalty::standardised()] {
                let path = lars(&problem, &penalty, &LarsOptions::default()).expect("a path");
                for knot in &path.knots {
                    let certified = knot.certificate;
                    assert!(certified.kkt < 1e-8, "{}, {form}: kkt {:e} at {}", case.name, certified.kkt, knot.l1);
                    assert!(certified.gap < 1e-8, "{}, {form}: gap {:e} at {}", case.name, certified.gap, knot.l1);
                    // Not by the path's own bookkeeping: from the statistic, with the coefficients in raw units.
                    let dense = knot.dense(case.x.ncols());
                    let again =
                        certificate(&problem, &penalty, Strength::lasso(knot.l1), &dense).expect("a certificate");
                    assert!(again.kkt < 1e-8, "{}, {form}: kkt {:e}", case.name, again.kkt);
                    knots += 1;
                }
                assert!(path.knots.windows(2).all(|pair| pair[0].l1 > pair[1].l1), "{}", case.name);
                problems += 1;
            }
        }
    }
    assert!(problems > 1_300 && knots > 5_000, "{problems} {knots}");
}

#[test]
fn answers_match_scikit_learn() {
    let (mut unique, mut others) = (0, 0);
    let mut worst = [0.0_f64; 3];
    for case in cases() {
        let problem = case.root();
        let (tau, deviation) = (problem.target_deviation(), problem.deviation());
        let tau = if tau > 0.0 { tau } else { 1.0 };
        for answer in &case.answers {
            let strength = Strength::elastic_net(answer.alpha, answer.l1_ratio);
            let options = LarsOptions { l2: strength.l2, ..LarsOptions::default() };
            let path = lars(&problem, &Penalty::default(), &options).expect("a path");
            let by_path = path.coefficients(strength.l1).expect("on the path");
            let options = CoordinateOptions { l1_ratio: answer.l1_ratio, ..CoordinateOptions::default() };
            let descent = coordinate_descent(&problem, &Penalty::default(), &[answer.alpha], &options).expect("a fit");
            // Uncentred columns with offsets of a thousand deviations: descent says that it did not arrive, and the path does.
            let arrived = descent[0].converged;
            assert!(arrived || (case.name.starts_with("offsets") && !case.intercept), "{}: no convergence", case.name);
            let fits = [("path", Some(by_path)), ("descent", arrived.then(|| descent[0].dense(case.x.ncols())))];
            for (who, ours) in fits.into_iter().filter_map(|(who, ours)| Some((who, ours?))) {
                let who = format!("{}, {}, alpha {}, {who}", case.name, answer.kind, answer.alpha);
                let theirs = &answer.coefficients;
                let judged =
                    |b: &[f64]| certificate(&problem, &Penalty::default(), strength, b).expect("a certificate");
                let (a, b) = (judged(&ours), judged(theirs));
                let objectives = (a.objective - b.objective).abs() / (tau * tau);
                let fits = case.fits_apart(&ours, theirs);
                let apart = (0..theirs.len()).map(|j| deviation[j] / tau * (theirs[j] - ours[j]).abs());
                let (spread, apart) = (apart.clone().sum::<f64>(), apart.fold(0.0, f64::max));
                // Gradients are monotone: |A(d - d')|^2 = (d - d')'(g' - g), at most |d - d'|_1 times the violations of both.
                let limit = f64::max(1e-9, 1.1 * (spread * (a.kkt + b.kkt)).sqrt());
                assert!(objectives < 1e-9, "{who}: objectives are {objectives:e} apart");
                assert!(fits < limit, "{who}: fits are {fits:e} apart, {limit:e} can be");
                worst = [worst[0].max(objectives), worst[1].max(fits), worst[2]];
                if answer.unique {
                    worst[2] = worst[2].max(apart);
                    assert!(apart < 1e-9, "{who}: coefficients are {apart:e} apart\n{ours:?}\n{theirs:?}");
                    unique += 1;
                } else {
                    others += 1;
                }
            }
        }
    }
    println!("{unique} unique, {others} others; objectives, fits, coefficients at most {worst:?} apart");
    assert!(unique > 4_000 && others > 500, "{unique} {others}");
}

/// A column that must enter and leave at one knot (the peer needs a jitter of the target for it), and designs that are singular to the last digit.
#[test]
fn degenerate_cases_of_the_peer_have_their_known_answers() {
    let solve = |x: Mat<f64>, y: &[f64]| {
        let problem = Quadratic::from_rows(x.as_ref(), y, None, false).expect("rows");
        lars(&problem, &Penalty::default(), &LarsOptions::default()).expect("a path")
    };
    let rows = [[0.0, 0.0, 0.0, -1.0, 0.0], [0.0, -1.0, 0.0, 0.0, 0.0]];
    let path = solve(Mat::from_fn(2, 5, |i, j| rows[i][j]), &[-2.5, -2.5]);
    let last = path.knots.last().expect("a knot").dense(5);
    assert!([0.0, 2.5, 0.0, 2.5, 0.0].iter().zip(&last).all(|(a, b)| (a - b).abs() < 1e-14), "{last:?}");
    let path = solve(Mat::from_fn(2, 2, |_, _| 1.0), &[1.0, 1.0]);
    let last = path.knots.last().expect("a knot").dense(2);
    assert!((last[0] - 1.0).abs() < 1e-15 && last[1] == 0.0, "{last:?}");
    assert_eq!(path.collinear, [1]);
    let rows = [[1e20, 1e20, 0.0], [-1e-32, 0.0, 0.0], [1.0, 1.0, 1.0]];
    let path = solve(Mat::from_fn(3, 3, |i, j| rows[i][j]), &[10.0, 10.0, 1.0]);
    assert!(path.knots.iter().all(|knot| knot.certificate.kkt < 1e-12));
}
