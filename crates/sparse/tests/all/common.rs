//! Problems for every solver: random ones, degenerate ones, and their rows, for checks that use no statistic.

#![allow(dead_code, reason = "every test binary uses its own part")]

use faer::Mat;
use fleetfoot_sparse::{Penalty, Quadratic, Sign, Solution};
use fleetfoot_stats::Gram;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

pub(crate) mod aircraft;
pub(crate) mod tasks;

/// Rows, with a name.
#[derive(Debug, Clone)]
pub(crate) struct Rows {
    pub(crate) name: String,
    pub(crate) x: Mat<f64>,
    pub(crate) y: Vec<f64>,
    /// True if the minimiser is unique at every lambda > 0.
    pub(crate) unique: bool,
}

/// Statistic that a problem is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    Root,
    Gram,
}

pub(crate) const FORMS: [Form; 2] = [Form::Root, Form::Gram];

impl Rows {
    pub(crate) fn n(&self) -> usize {
        self.x.nrows()
    }

    pub(crate) fn p(&self) -> usize {
        self.x.ncols()
    }

    /// Returns true if there are no ties.
    pub(crate) fn ordinary(&self) -> bool {
        ["random", "leaves"].iter().any(|word| self.name.starts_with(word))
    }

    /// The problem with a free intercept.
    pub(crate) fn problem(&self, form: Form) -> Quadratic {
        match form {
            Form::Root => Quadratic::from_rows(self.x.as_ref(), &self.y, None, true).expect("rows"),
            Form::Gram => {
                let p = self.p();
                let z = Mat::from_fn(self.n(), p + 1, |i, j| if j < p { self.x[(i, j)] } else { self.y[i] });
                let columns: Vec<usize> = (0..p).collect();
                Quadratic::from_gram(&Gram::of_rows(z.as_ref(), None), &columns, p).expect("a Gram matrix")
            }
        }
    }

    /// The duality gap that a solution may have. Two columns that differ by 1e-7, and powers up to the seventh, have Gram matrices of condition
    /// 1e14: rounding of the products alone, 1e-16 of coefficients of 1e6, is a gap of 1e-6 there. The square-root form has no such exception.
    pub(crate) fn most_gap(&self, form: Form) -> f64 {
        let squared = ["nearly the same", "polynomials"].contains(&self.name.as_str());
        if form == Form::Gram && squared { 1e-4 } else { 1e-8 }
    }

    /// Gradient `x'(y - x b - b0)/n` and residual mean square, from the rows.
    pub(crate) fn gradient(&self, solution: &Solution) -> (Vec<f64>, f64) {
        let n = self.n() as f64;
        let mut left: Vec<f64> = self.y.iter().map(|y| y - solution.intercept).collect();
        for (&j, &value) in solution.support.iter().zip(&solution.coefficients) {
            left.iter_mut().enumerate().for_each(|(i, left)| *left -= self.x[(i, j)] * value);
        }
        let mean = |j: usize| (0..self.n()).map(|i| self.x[(i, j)]).sum::<f64>() / n;
        let gradient = (0..self.p()).map(|j| {
            let mean = mean(j);
            (0..self.n()).map(|i| (self.x[(i, j)] - mean) * left[i]).sum::<f64>() / n
        });
        (gradient.collect(), left.iter().map(|r| r * r).sum::<f64>() / n)
    }

    /// The largest violation of the optimality conditions, as a correlation, from the rows: nothing of the crate is used.
    pub(crate) fn violation(&self, penalty: &Penalty, solution: &Solution) -> f64 {
        let n = self.n() as f64;
        let (gradient, _) = self.gradient(solution);
        let deviation = |value: &dyn Fn(usize) -> f64| {
            let mean = (0..self.n()).map(value).sum::<f64>() / n;
            ((0..self.n()).map(|i| (value(i) - mean).powi(2)).sum::<f64>() / n).sqrt()
        };
        let tau = deviation(&|i| self.y[i]);
        let mut worst = 0.0_f64;
        for j in 0..self.p() {
            let size = deviation(&|i| self.x[(i, j)]);
            let unit = if penalty.standardise { size } else { 1.0 };
            let factor = penalty.factors.get(j).copied().unwrap_or(1.0);
            let sign = penalty.signs.get(j).copied().unwrap_or_default();
            let value = solution.coefficient(j);
            if size <= 1e-13 * (0..self.n()).map(|i| self.x[(i, j)].abs()).fold(0.0, f64::max) || factor.is_infinite() {
                assert_eq!(value, 0.0, "{}: column {j} takes no part", self.name);
                continue;
            }
            let (limit, ridge) = (solution.l1 * factor * unit, solution.l2 * factor * unit * unit);
            let g = gradient[j] - ridge * value;
            assert!(sign.allows(value), "{}: column {j} has {value}", self.name);
            let push = match sign {
                Sign::Free => g.abs(),
                Sign::NonNegative => g,
                Sign::NonPositive => -g,
            };
            let violation = if value != 0.0 { (g - limit * value.signum()).abs() } else { (push - limit).max(0.0) };
            worst = worst.max(violation / (size * tau));
        }
        worst
    }
}

pub(crate) fn gaussian(random: &mut Pcg64) -> f64 {
    let (u, v): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Correlated Gaussian columns with offsets, a sparse truth and noise.
pub(crate) fn random(seed: u64, n: usize, p: usize) -> Rows {
    let mut rng = Pcg64::seed_from_u64(seed);
    let share = [0.0, 0.5, 0.9][seed as usize % 3];
    let common: Vec<f64> = (0..n).map(|_| gaussian(&mut rng)).collect();
    let scale: Vec<f64> = (0..p).map(|_| 10.0_f64.powf(rng.random_range(-1.0..1.0))).collect();
    let x = Mat::from_fn(n, p, |i, j| scale[j] * (share * common[i] + gaussian(&mut rng)) + 3.0 * scale[j]);
    let truth: Vec<f64> =
        (0..p).map(|j| if j.is_multiple_of(3) { gaussian(&mut rng) / scale[j] } else { 0.0 }).collect();
    let y = (0..n).map(|i| (0..p).map(|j| x[(i, j)] * truth[j]).sum::<f64>() + gaussian(&mut rng) + 5.0).collect();
    Rows { name: format!("random {seed} {n} x {p}"), x, y, unique: true }
}

/// Rows with few distinct values: ties everywhere.
pub(crate) fn integers(seed: u64, n: usize, p: usize) -> Rows {
    let mut rng = Pcg64::seed_from_u64(seed);
    let x = Mat::from_fn(n, p, |_, _| rng.random_range(-1..=1) as f64);
    let y = (0..n).map(|_| rng.random_range(-2..=2) as f64).collect();
    Rows { name: format!("integers {seed} {n} x {p}"), x, y, unique: false }
}

/// Orthogonal columns of signs (a Hadamard matrix of order 8) with equal correlations.
fn orthogonal(name: &str, correlations: [f64; 7]) -> Rows {
    let sign = |i: usize, j: usize| if (i & j).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 };
    let x = Mat::from_fn(8, 7, |i, j| sign(i, j + 1));
    let y = (0..8).map(|i| (0..7).map(|j| correlations[j] * sign(i, j + 1)).sum()).collect();
    Rows { name: name.into(), x, y, unique: true }
}

fn changed(base: &Rows, name: &str, change: impl Fn(&mut Mat<f64>, &mut Vec<f64>)) -> Rows {
    let mut rows = Rows { name: name.into(), unique: false, ..base.clone() };
    change(&mut rows.x, &mut rows.y);
    rows
}

/// Degenerate problems, by name.
pub(crate) fn degenerate() -> Vec<Rows> {
    let base = random(5, 40, 8);
    let (n, _) = (40, 8);
    let set = |x: &mut Mat<f64>, j: usize, value: &dyn Fn(&Mat<f64>, usize) -> f64| {
        let column: Vec<f64> = (0..n).map(|i| value(x, i)).collect();
        (0..n).for_each(|i| x[(i, j)] = column[i]);
    };
    let mut all = vec![
        orthogonal("equal correlations", [1.0; 7]),
        orthogonal("equal correlations of either sign", [1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0]),
        orthogonal("pairs of equal correlations", [3.0, 3.0, 2.0, -2.0, 1.0, 1.0, 0.0]),
        changed(&base, "duplicated", |x, _| set(x, 3, &|x, i| x[(i, 0)])),
        changed(&base, "negated", |x, _| set(x, 3, &|x, i| -x[(i, 0)])),
        changed(&base, "scaled copy", |x, _| set(x, 6, &|x, i| 100.0 * x[(i, 0)] + 7.0)),
        changed(&base, "three copies", |x, _| (1..4).for_each(|j| set(x, j, &|x, i| x[(i, 0)]))),
        changed(&base, "sum of two", |x, _| set(x, 7, &|x, i| x[(i, 0)] + x[(i, 3)])),
        changed(&base, "mean of all", |x, _| set(x, 7, &|x, i| (0..7).map(|j| x[(i, j)]).sum::<f64>() / 7.0)),
        changed(&base, "constant column", |x, _| set(x, 2, &|_, _| 0.1)),
        changed(&base, "zero column", |x, _| set(x, 2, &|_, _| 0.0)),
        changed(&base, "no noise", |x, y| (0..n).for_each(|i| y[i] = 2.0 * x[(i, 0)] - x[(i, 4)] + 1.0)),
        changed(&base, "one column is the target", |x, y| (0..n).for_each(|i| y[i] = x[(i, 3)])),
        changed(&base, "constant target", |_, y| y.fill(3.3)),
        changed(&base, "large offsets", |x, y| {
            (0..n).for_each(|i| (0..8).for_each(|j| x[(i, j)] += 1e6));
            y.iter_mut().for_each(|y| *y -= 1e6);
        }),
        changed(&base, "huge and tiny columns", |x, _| {
            (0..n).for_each(|i| (0..8).for_each(|j| x[(i, j)] *= 10.0_f64.powi(20 * (j as i32 - 4))));
        }),
        changed(&base, "tiny target", |_, y| y.iter_mut().for_each(|y| *y *= 1e-100)),
        changed(&base, "huge target", |_, y| y.iter_mut().for_each(|y| *y *= 1e100)),
        changed(&base, "nearly the same", |x, _| set(x, 3, &|x, i| x[(i, 0)] * (1.0 + 1e-7 * (i as f64).sin()))),
    ];
    all.extend([random(6, 1, 3), random(7, 2, 3), random(8, 3, 2)].map(|rows| Rows { unique: false, ..rows }));
    all.extend((0..4).map(|seed| Rows { unique: false, ..random(20 + seed, 12, 30) }));
    all.extend((0..12).map(|seed| integers(40 + seed, 12 + seed as usize, 3 + seed as usize)));
    all.extend((0..4).map(|seed| integers(60 + seed, 8, 14)));
    all.push(polynomials());
    all.push(leaves_and_returns());
    all
}

/// Powers of one variable: ill conditioned.
pub(crate) fn polynomials() -> Rows {
    let n = 200;
    let t = |i: usize| 1.0 + i as f64 / n as f64;
    let x = Mat::from_fn(n, 7, |i, j| t(i).powi(j as i32 + 1));
    let y = (0..n).map(|i| t(i).powi(2) - 0.3 * t(i).powi(5) + 0.01 * (17.0 * t(i)).sin()).collect();
    Rows { name: "polynomials".into(), x, y, unique: false }
}

/// Features of an aircraft's latents: one variable times a polynomial in two others, degree 4 and 3, all slowly varying
/// (25 columns).
pub(crate) fn features(seed: u64, spread: f64) -> Rows {
    let n = 400;
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut noisy = |value: f64| spread * (value + 0.1 * gaussian(&mut rng));
    let state = |i: usize| {
        let t = i as f64 / n as f64;
        [1.0 + noisy(t), 2.0 + noisy((3.0 * t).sin()), 0.5 + noisy(t * t)]
    };
    let states: Vec<[f64; 3]> = (0..n).map(state).collect();
    let power = |i: usize, [a, b, c]: [usize; 3], d: usize, k: usize| {
        let z = states[i];
        z[a] * z[b].powi(k as i32) * z[c].powi((d - k) as i32)
    };
    let mut columns: Vec<([usize; 3], usize, usize)> = Vec::new();
    for (variables, degree) in [([0, 1, 2], 4), ([2, 1, 0], 3)] {
        columns.extend((0..=degree).flat_map(|d| (0..=d).map(move |k| (variables, d, k))));
    }
    let x = Mat::from_fn(n, columns.len(), |i, j| power(i, columns[j].0, columns[j].1, columns[j].2));
    let y = (0..n).map(|i| x[(i, 1)] - 2.0 * x[(i, 7)] + 0.5 * x[(i, 20)] + 0.01 * gaussian(&mut rng)).collect();
    Rows { name: format!("features {seed} {spread}"), x, y, unique: false }
}

/// Hardly more rows than strongly correlated columns: many leave again.
pub(crate) fn leaves_and_returns() -> Rows {
    Rows { name: "leaves and returns".into(), ..random(11, 27, 24) }
}

/// Penalties for p columns: plain, factors with zeros and infinities, signs, and all together.
pub(crate) fn penalties(p: usize) -> Vec<(&'static str, Penalty)> {
    let factors: Vec<f64> = (0..p).map(|j| [1.0, 0.5, 2.0, 1.0, 0.0][j % 5]).collect();
    let left_out: Vec<f64> = (0..p).map(|j| if j % 4 == 1 { f64::INFINITY } else { 1.0 + j as f64 }).collect();
    let signs: Vec<Sign> =
        (0..p).map(|j| [Sign::NonNegative, Sign::Free, Sign::NonPositive, Sign::NonNegative][j % 4]).collect();
    let non_negative = vec![Sign::NonNegative; p];
    let plain = Penalty::default();
    vec![
        ("standardised", Penalty::standardised()),
        ("raw", plain.clone()),
        ("factors", Penalty { factors: factors.clone(), ..Penalty::standardised() }),
        ("left out", Penalty { factors: left_out, ..plain.clone() }),
        ("non-negative", Penalty { signs: non_negative, ..Penalty::standardised() }),
        ("signs and factors", Penalty { signs, factors, ..plain }),
    ]
}

/// Ordinary problems: random ones of many shapes.
pub(crate) fn ordinary() -> Vec<Rows> {
    (0..40).map(|seed| random(100 + seed, 20 + 3 * seed as usize % 50, 1 + (7 * seed as usize) % 16)).collect()
}
