//! The smoothing spline by dense algebra: the representer of the penalty's kernel (Wahba, "Spline Models for Observational Data", 1990, chapter 1), in O(n^3).

/// Solves A X = B by elimination with row pivots; B has a row a row of A.
pub(crate) fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let n = a.len();
    for c in 0..n {
        let pivot = (c..n).max_by(|&i, &j| a[i][c].abs().total_cmp(&a[j][c].abs())).unwrap();
        a.swap(c, pivot);
        b.swap(c, pivot);
        for i in c + 1..n {
            let factor = a[i][c] / a[c][c];
            for j in c..n {
                a[i][j] -= factor * a[c][j];
            }
            for j in 0..b[i].len() {
                b[i][j] -= factor * b[c][j];
            }
        }
    }
    for c in (0..n).rev() {
        for j in 0..b[c].len() {
            let known: f64 = (c + 1..n).map(|k| a[c][k] * b[k][j]).sum();
            b[c][j] = (b[c][j] - known) / a[c][c];
        }
    }
    b
}

fn factorial(k: usize) -> f64 {
    (1..=k).map(|i| i as f64).product()
}

/// The covariance of the `a`-th derivative at `s` and the `b`-th at `t` of the m-fold integrated Wiener process from 0 on.
fn kernel(m: usize, s: f64, a: usize, t: f64, b: usize) -> f64 {
    if t > s {
        return kernel(m, t, b, s, a);
    }
    let (p, q, beyond) = (m - 1 - a, m - 1 - b, s - t);
    let choose = |k: usize| factorial(p) / (factorial(k) * factorial(p - k));
    let term = |k: usize| choose(k) * beyond.powi((p - k) as i32) * t.powi((k + q + 1) as i32) / (k + q + 1) as f64;
    (0..=p).map(term).sum::<f64>() / (factorial(p) * factorial(q))
}

/// The `k`-th derivative of t^j / j!.
fn monomial(t: f64, j: usize, k: usize) -> f64 {
    if k > j { 0.0 } else { t.powi((j - k) as i32) / factorial(j - k) }
}

/// Measurements and a penalty.
pub(crate) struct Dense<'a> {
    pub(crate) m: usize,
    pub(crate) times: &'a [f64],
    pub(crate) values: &'a [f64],
    pub(crate) weights: &'a [f64],
    pub(crate) lambda: f64,
}

impl Dense<'_> {
    fn covariance(&self) -> Vec<Vec<f64>> {
        let n = self.times.len();
        let entry = |i: usize, j: usize| {
            kernel(self.m, self.times[i], 0, self.times[j], 0) / self.lambda
                + if i == j { 1.0 / self.weights[i] } else { 0.0 }
        };
        (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
    }

    /// [Sigma, T; T', 0].
    fn saddle(&self) -> Vec<Vec<f64>> {
        let n = self.times.len();
        let mut rows = self.covariance();
        for (row, &t) in rows.iter_mut().zip(self.times) {
            row.extend((0..self.m).map(|j| monomial(t, j, 0)));
        }
        for j in 0..self.m {
            let mut row: Vec<f64> = self.times.iter().map(|&t| monomial(t, j, 0)).collect();
            row.resize(n + self.m, 0.0);
            rows.push(row);
        }
        rows
    }

    /// Value and variance of the `k`-th derivative at each of `at`, the variance in units of that of a measurement of weight one.
    pub(crate) fn posterior(&self, at: &[f64], k: usize) -> Vec<(f64, f64)> {
        let n = self.times.len();
        let of = |t: f64| -> Vec<f64> {
            let process = self.times.iter().map(|&s| kernel(self.m, t, k, s, 0) / self.lambda);
            process.chain((0..self.m).map(|j| monomial(t, j, k))).collect()
        };
        let rows: Vec<Vec<f64>> = at.iter().map(|&t| of(t)).collect();
        let right = (0..n + self.m).map(|i| {
            let value = if i < n { self.values[i] } else { 0.0 };
            std::iter::once(value).chain(rows.iter().map(|row| row[i])).collect()
        });
        let solved = solve(self.saddle(), right.collect());
        let dot = |row: &[f64], column: usize| row.iter().zip(&solved).map(|(x, y)| x * y[column]).sum::<f64>();
        let one = |(i, &t): (usize, &f64)| {
            let variance = kernel(self.m, t, k, t, k) / self.lambda - dot(&rows[i], i + 1);
            (dot(&rows[i], 0), variance)
        };
        at.iter().enumerate().map(one).collect()
    }

    /// Weighted sum of squared residuals, and trace of the hat matrix.
    pub(crate) fn residuals(&self) -> (f64, f64) {
        let posterior = self.posterior(self.times, 0);
        let rows = posterior.iter().zip(self.values).zip(self.weights);
        rows.fold((0.0, 0.0), |(squares, trace), (((mean, variance), y), w)| {
            (squares + w * (y - mean) * (y - mean), trace + w * variance)
        })
    }

    /// Minus twice the restricted log-likelihood up to a constant: (n - m) log y'Py + log |Sigma| + log |T' Sigma^-1 T|, the determinants by that of the saddle matrix.
    pub(crate) fn deviance(&self) -> f64 {
        let n = self.times.len();
        let right = (0..n + self.m).map(|i| vec![if i < n { self.values[i] } else { 0.0 }]).collect();
        let solved = solve(self.saddle(), right);
        let quadratic: f64 = self.values.iter().zip(&solved).map(|(y, c)| y * c[0]).sum();
        (n - self.m) as f64 * quadratic.ln() + log_determinant(self.saddle())
    }
}

/// log |det A|.
fn log_determinant(mut a: Vec<Vec<f64>>) -> f64 {
    let n = a.len();
    let mut sum = 0.0;
    for c in 0..n {
        let pivot = (c..n).max_by(|&i, &j| a[i][c].abs().total_cmp(&a[j][c].abs())).unwrap();
        a.swap(c, pivot);
        sum += a[c][c].abs().ln();
        for i in c + 1..n {
            let factor = a[i][c] / a[c][c];
            for j in c..n {
                a[i][j] -= factor * a[c][j];
            }
        }
    }
    sum
}
