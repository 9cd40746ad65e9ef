//! The first rows, up to the M-th measured one, while some direction of the state is still unknown.
//!
//! There the filter has no covariance. The state is held as rows of a least-squares problem, R s = z with errors of
//! variance one (a square-root information filter: Dyer and McReynolds, "Extension of square-root filtering to include
//! process noise", JOTA 3, 1969). No large number stands for "unknown", so that the spline is that of the penalty
//! alone.

use super::{
    chain::{Matrix, Step, transposed},
    filter::{Belief, Posterior},
    link::{sandwich, squared},
};

/// The share of the greatest coefficient below which a direction of the state counts as unseen.
const SEEN: f64 = 1e-4;

/// A row of a least-squares problem: coefficients, and the right side at the end.
type Equation = Vec<f64>;

/// A row's state given the next, s = F^-1 (s+ - L e): `error e + next s+ = right`, with errors of variance one.
///
/// The unknown is e, what the noise added over the step in its own units, and not s itself: under a strong penalty e is nearly nothing, and s has the digits of s+.
#[derive(Debug, Clone)]
pub(super) struct Eliminated<const M: usize> {
    step: Step<M>,
    error: Matrix<M>,
    next: Matrix<M>,
    right: [f64; M],
}

/// Linear equations of a state that is not fully determined.
#[derive(Debug, Clone, Default)]
pub(crate) struct Information<const M: usize> {
    equations: Vec<Equation>,
    /// Sum of squares by which measurements contradict each other, beyond those that determine the state.
    pub(super) squares: f64,
}

/// Reduces equations by reflectors until the first `columns` columns are upper triangular. Heavy rows go first, which keeps the digits of the light ones (Cox and Higham,
/// "Stability of Householder QR factorization for weighted least squares problems", 1998).
fn reduce(equations: &mut [Equation], columns: usize) {
    let size = |row: &Equation| row[..row.len() - 1].iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    equations.sort_by(|a, b| size(b).total_cmp(&size(a)));
    for c in 0..columns.min(equations.len()) {
        let v: Vec<f64> = equations[c..].iter().map(|row| row[c]).collect();
        let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        if norm == 0.0 {
            continue;
        }
        let diagonal = if v[0] > 0.0 { -norm } else { norm };
        let beta = 1.0 / (norm * (norm + v[0].abs()));
        let v: Vec<f64> = std::iter::once(v[0] - diagonal).chain(v[1..].iter().copied()).collect();
        for j in c + 1..equations[c].len() {
            let dot: f64 = beta * v.iter().zip(&equations[c..]).map(|(v, row)| v * row[j]).sum::<f64>();
            for (v, row) in v.iter().zip(&mut equations[c..]) {
                row[j] -= dot * v;
            }
        }
        for row in &mut equations[c + 1..] {
            row[c] = 0.0;
        }
        equations[c][c] = diagonal;
    }
}

/// Solves U x = b, U upper triangular.
fn solve<const M: usize>(u: &Matrix<M>, b: &[f64; M]) -> [f64; M] {
    let mut x = *b;
    for i in (0..M).rev() {
        for j in i + 1..M {
            x[i] -= u[i][j] * x[j];
        }
        x[i] /= u[i][i];
    }
    x
}

/// U^-1 B.
fn solve_matrix<const M: usize>(u: &Matrix<M>, b: &Matrix<M>) -> Matrix<M> {
    let mut solved = [[0.0; M]; M];
    for j in 0..M {
        let column = solve(u, &std::array::from_fn(|i| b[i][j]));
        for i in 0..M {
            solved[i][j] = column[i];
        }
    }
    solved
}

fn identity<const M: usize>() -> Matrix<M> {
    std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)))
}

impl<const M: usize> Information<M> {
    /// Learns of a measurement of `slopes` times the state.
    pub(crate) fn measure(&mut self, slopes: &[f64; M], value: f64, weight: f64) {
        let root = weight.sqrt();
        let mut equation: Equation = slopes.iter().map(|slope| slope * root).collect();
        equation.push(root * value);
        self.equations.push(equation);
        reduce(&mut self.equations, M);
        self.squares += self.equations.iter().skip(M).map(|row| row[M] * row[M]).sum::<f64>();
        self.equations.truncate(M);
    }

    /// Returns true if all directions of the state are seen, in units in which steps and weights are near one.
    pub(crate) fn is_determined(&self) -> bool {
        let size = self.equations.iter().flat_map(|row| &row[..M]).fold(0.0_f64, |most, x| most.max(x.abs()));
        self.equations.len() == M && (0..M).all(|i| self.equations[i][i].abs() > SEEN * size)
    }

    /// Goes a step on: the state is eliminated, and what it is, given the next, is handed back.
    ///
    /// The equations of the step are e = 0; those of the state, R s = z, become R F^-1 s+ - R F^-1 L e = z.
    pub(super) fn step(&mut self, step: &Step<M>) -> Eliminated<M> {
        let mut equations: Vec<Equation> = Vec::with_capacity(2 * M);
        for i in 0..M {
            let mut equation = vec![0.0; 2 * M + 1];
            equation[i] = 1.0;
            equations.push(equation);
        }
        let back = step.backward_matrix(&identity::<M>());
        let root = step.root();
        for known in &self.equations {
            let mut equation = vec![0.0; 2 * M + 1];
            for j in 0..M {
                equation[M + j] = (0..M).map(|k| known[k] * back[k][j]).sum();
            }
            for j in 0..M {
                equation[j] = -(0..M).map(|k| equation[M + k] * root[k][j]).sum::<f64>();
            }
            equation[2 * M] = known[M];
            equations.push(equation);
        }
        reduce(&mut equations, 2 * M);
        let part = |from: usize| std::array::from_fn(|i| std::array::from_fn(|j| equations[i][from + j]));
        let right = std::array::from_fn(|i| equations[i][2 * M]);
        let eliminated = Eliminated { step: *step, error: part(0), next: part(M), right };
        self.equations = equations[M..].iter().map(|row| row[M..].to_vec()).collect();
        eliminated
    }

    /// The belief, once M measurements at different times determine the state.
    pub(super) fn belief(&self) -> Belief<M> {
        let r: Matrix<M> = std::array::from_fn(|i| std::array::from_fn(|j| self.equations[i][j]));
        let z: [f64; M] = std::array::from_fn(|i| self.equations[i][M]);
        Belief::new(solve(&r, &z), solve_matrix(&r, &identity()))
    }
}

impl<const M: usize> Eliminated<M> {
    /// The state of the row from that of the next.
    pub(super) fn smoothed(&self, next: &Posterior<M>) -> Posterior<M> {
        let mut right = self.right;
        for i in 0..M {
            for j in 0..M {
                right[i] -= self.next[i][j] * next.mean[j];
            }
        }
        let root = self.step.root();
        let noise = product(&root, &[solve(&self.error, &right)]);
        let end = std::array::from_fn(|i| next.mean[i] - noise[0][i]);
        // s = F^-1 (K s+ - Z times errors of variance one), K = I + L own^-1 next, Z = L own^-1.
        let columns = |of: &Matrix<M>| product(&root, &transposed(&solve_matrix(&self.error, of)));
        let (kept, spread) = (transposed(&columns(&self.next)), transposed(&columns(&identity())));
        let kept = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j) + kept[i][j]));
        let covariance = self.step.backward_both(&sandwich(&kept, &next.covariance, &squared(&spread)));
        Posterior { mean: self.step.backward(&end), covariance }
    }
}

/// L x of every vector x.
fn product<const M: usize, const N: usize>(l: &Matrix<M>, vectors: &[[f64; M]; N]) -> [[f64; M]; N] {
    vectors.map(|x| std::array::from_fn(|i| (0..M).map(|k| l[i][k] * x[k]).sum()))
}
