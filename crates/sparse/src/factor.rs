//! The factor of the active columns, with rank-one appends and deletions.

use crate::{
    ahead::Ahead,
    kernel::{Slab, add_scaled, dot, padded, substitute_back},
    penalty::Weights,
    quadratic::{Form, Quadratic},
};

/// Appends after which the correlations are computed anew, so that rounding does not add up along a path.
const REFRESH: usize = 32;

/// Ridge, relative to a column's squared length, whose rows would bury the column's own: then the products are the better form.
const BURIED: f64 = 1e6;

/// Length of a column beyond the active ones, relative to its own, below which it counts as dependent on them (square-root form): its correlation with
/// a residual cannot be larger, and coefficients of the size of its inverse would round to as much.
const LEAST_REMAINDER: f64 = 1e-9;

/// Rounding of products with a basis vector, relative to that of one product, from which on they are formed anew.
const MAGNIFIED: f64 = 16.0;

/// An orthogonal basis Q of the active columns A_S, never formed in Gram form: `A_S = Q U`, U upper triangular.
///
/// With a ridge the columns carry the rows `sqrt(rho_j)` below them. The solution of the active problem is `U^-1 (q - lambda t)` with
/// q = Q'z and t = U^-T (omega s), and the correlations of all columns with the residual are `e + lambda a`, e = c - W q, a = W t, W = A'Q:
/// everything along a segment of the path follows from these vectors, without accumulation from knot to knot.
///
/// In square-root form a new column is orthogonalised by Gram and Schmidt, twice where needed (Daniel, Gragg, Kaufman, Stewart 1976); in
/// Gram form the same recurrence is a Cholesky factorisation in the order of entry. Deletions rotate (Golub and Van Loan 2013, section 6.5.2).
pub(crate) struct Factor<'a> {
    problem: &'a Quadratic,
    weights: &'a Weights,
    /// Columns and target with the rows of the ridge below them, compressed: where the form is square root and there is a ridge.
    root: Option<(Slab, Vec<f64>)>,
    basis: Option<Slab>,
    ahead: Ahead,
    /// Rounding of every column of W, relative to that of a product of two columns.
    magnified: Vec<f64>,
    /// Active columns in the order of U.
    pub(crate) order: Vec<usize>,
    active: Vec<bool>,
    /// omega s of the active columns.
    signed: Vec<f64>,
    /// Columns of U, each of its own length.
    u: Vec<Vec<f64>>,
    /// W = A'Q (p x k), its rows permuted: those of the active columns first, in no particular order. Only the others take part in a step.
    w: Slab,
    /// Column of every row of W, and of every entry of c, e and a.
    column_at: Vec<usize>,
    /// Row of every column.
    row_of: Vec<usize>,
    c: Vec<f64>,
    /// Squared lengths of the columns, ridge included (p).
    square: Vec<f64>,
    q: Vec<f64>,
    t: Vec<f64>,
    /// c - W q (padded).
    e: Vec<f64>,
    /// W t (padded).
    a: Vec<f64>,
    appended: usize,
}

impl<'a> Factor<'a> {
    /// No active columns; `l2` is the ridge strength.
    pub(crate) fn new(problem: &'a Quadratic, weights: &'a Weights, l2: f64) -> Self {
        let p = problem.columns();
        let ridge: Vec<f64> = weights.rho.iter().map(|rho| l2 * rho).collect();
        let largest = ridge.iter().copied().fold(0.0, f64::max);
        let (root, basis) = match &problem.form {
            Form::Root { a, z, .. } if largest > 0.0 && largest <= BURIED => {
                let stacked = stack(a, z, &ridge);
                let basis = Slab::zeros(stacked.0.rows(), 0);
                (Some(stacked), Some(basis))
            }
            Form::Root { a, .. } if largest == 0.0 => (None, Some(Slab::zeros(a.rows(), 0))),
            _ => (None, None),
        };
        let c = problem.target_correlations();
        let square = (0..p).map(|j| if weights.used(j) { 1.0 + ridge[j] } else { 0.0 }).collect();
        Self {
            problem,
            weights,
            root,
            basis,
            ahead: Ahead::default(),
            magnified: Vec::new(),
            order: Vec::new(),
            active: vec![false; p],
            signed: Vec::new(),
            u: Vec::new(),
            w: Slab::zeros(p, 0),
            column_at: (0..p).collect(),
            row_of: (0..p).collect(),
            e: c.clone(),
            a: vec![0.0; padded(p).max(8)],
            c,
            square,
            q: Vec::new(),
            t: Vec::new(),
            appended: 0,
        }
    }

    pub(crate) fn is_active(&self, j: usize) -> bool {
        self.active[j]
    }

    /// e_j: the correlation of column j with what the least squares of the active columns leave.
    pub(crate) fn left(&self, j: usize) -> f64 {
        self.e[self.row_of[j]]
    }

    /// a_j: how fast the correlation of column j falls with lambda.
    pub(crate) fn rate(&self, j: usize) -> f64 {
        self.a[self.row_of[j]]
    }

    /// Exchanges the rows of W, c, e and a of column j with the one at `row`.
    fn move_to(&mut self, j: usize, row: usize) {
        let (from, other) = (self.row_of[j], self.column_at[row]);
        self.w.swap_rows(from, row);
        for values in [&mut self.c, &mut self.e, &mut self.a] {
            values.swap(from, row);
        }
        self.column_at.swap(from, row);
        (self.row_of[j], self.row_of[other]) = (row, from);
    }

    /// Rounding of a correlation with the residual of the active columns, relative to a unit target: in Gram form what a short pivot magnifies.
    pub(crate) fn noise(&self) -> f64 {
        let level = 8.0 * f64::EPSILON * ((self.problem.columns() + 1) as f64).sqrt();
        if self.basis.is_some() {
            return level;
        }
        let pivot = |(place, column): (usize, &Vec<f64>)| column[place] / self.square[self.order[place]].sqrt();
        level / self.u.iter().enumerate().map(pivot).fold(1.0, f64::min)
    }

    /// Share of column j's squared length that the active columns leave.
    pub(crate) fn remainder(&self, j: usize) -> f64 {
        let row = self.row_of[j];
        let explained: f64 = (0..self.order.len()).map(|k| self.w.column(k)[row].powi(2)).sum();
        if self.square[j] > 0.0 { ((self.square[j] - explained) / self.square[j]).max(0.0) } else { 0.0 }
    }

    /// Share below which a squared remainder is rounding.
    pub(crate) fn least_remainder(&self) -> f64 {
        8.0 * f64::EPSILON * (self.problem.columns() + 1) as f64
    }

    /// Makes column j active with the sign s; false, and nothing done, when its remainder beyond the active columns is rounding.
    pub(crate) fn append(&mut self, j: usize, sign: f64) -> bool {
        let signed = if self.weights.omega[j] > 0.0 { self.weights.omega[j] * sign } else { 0.0 };
        let k = self.order.len();
        let row = self.row_of[j];
        let mut u: Vec<f64> = (0..k).map(|i| self.w.column(i)[row]).collect();
        let Some((pivot, mut column, known)) = (match self.basis {
            Some(_) => self.orthogonalise(j, &mut u),
            None => self.eliminate(j, &u),
        }) else {
            return false;
        };
        // Active columns are orthogonal to the new direction, by construction.
        column[..k].fill(0.0);
        column[row] = pivot;
        let against: f64 = u.iter().zip(&self.t).map(|(u, t)| u * t).sum();
        let step = (signed - against) / pivot;
        add_scaled(-known, &column, &mut self.e);
        add_scaled(step, &column, &mut self.a);
        u.push(pivot);
        self.u.push(u);
        self.w.push(&column);
        self.q.push(known);
        self.t.push(step);
        self.order.push(j);
        self.signed.push(signed);
        self.active[j] = true;
        self.move_to(j, k);
        self.appended += 1;
        if self.appended.is_multiple_of(REFRESH) {
            self.refresh();
        }
        true
    }

    /// Cholesky step: pivot, new column of W, and its product with the target.
    fn eliminate(&self, j: usize, u: &[f64]) -> Option<(f64, Vec<f64>, f64)> {
        let square = self.square[j] - u.iter().map(|u| u * u).sum::<f64>();
        if square <= self.least_remainder() * self.square[j] {
            return None;
        }
        let pivot = square.sqrt();
        let (mut natural, mut column) = (vec![0.0; self.w.stride()], vec![0.0; self.w.stride()]);
        self.problem.correlations_of(j, &mut natural);
        let first = self.order.len();
        for (value, &i) in column.iter_mut().zip(&self.column_at).skip(first) {
            *value = natural[i];
        }
        self.w.subtract_below(first, u, &mut column);
        column[first..].iter_mut().for_each(|value| *value /= pivot);
        Some((pivot, column, self.left(j) / pivot))
    }

    /// Gram-Schmidt step: as [`Factor::eliminate`], from the columns themselves; `u` is corrected by the second pass.
    fn orthogonalise(&mut self, j: usize, u: &mut [f64]) -> Option<(f64, Vec<f64>, f64)> {
        let (a, z) = match (&self.root, &self.problem.form) {
            (Some((a, z)), _) => (a, z),
            (None, Form::Root { a, z, .. }) => (a, z),
            (None, Form::Gram { .. }) => return self.eliminate(j, u),
        };
        let basis = self.basis.as_mut()?;
        let mut v = a.column(j).to_vec();
        basis.subtract(u, &mut v);
        let mut pivot = dot(&v, &v).sqrt();
        let whole = self.square[j].sqrt();
        if pivot < 0.7 * whole {
            let mut again = vec![0.0; u.len()];
            basis.products(&v, &mut again);
            basis.subtract(&again, &mut v);
            u.iter_mut().zip(&again).for_each(|(u, again)| *u += again);
            pivot = dot(&v, &v).sqrt();
        }
        let known = self.order.iter().map(|&i| self.problem.noise[i]).fold(self.problem.noise[j], f64::max);
        if pivot <= known.max(LEAST_REMAINDER) * whole {
            return None;
        }
        v.iter_mut().for_each(|value| *value /= pivot);
        let target = dot(&v, z);
        basis.push(&v);
        // Errors of the products before, as independent ones add.
        let before = u.iter().zip(&self.magnified).map(|(u, magnified)| (u * magnified).powi(2)).sum::<f64>();
        let magnified = (1.0 + before).sqrt() * whole / pivot;
        let first = self.order.len();
        let mut column = vec![0.0; self.w.stride()];
        if magnified <= MAGNIFIED && Ahead::pays(a) {
            let next = |most| nearest((&self.e, &self.a), (&self.column_at[first..], first), self.weights, most);
            let product = self.ahead.of(a, j, next);
            column.iter_mut().zip(&self.column_at).skip(first).for_each(|(value, &i)| *value = product(i));
            self.w.subtract_below(first, u, &mut column);
            column[first..].iter_mut().for_each(|value| *value /= pivot);
            self.magnified.push(magnified);
        } else {
            let mut natural = vec![0.0; a.columns()];
            a.products(&v, &mut natural);
            column.iter_mut().zip(&self.column_at).skip(first).for_each(|(value, &i)| *value = natural[i]);
            self.magnified.push(1.0);
        }
        Some((pivot, column, target))
    }

    /// Takes the active column at `place` out.
    pub(crate) fn remove(&mut self, place: usize) {
        let j = self.order.remove(place);
        self.active[j] = false;
        self.signed.remove(place);
        self.u.remove(place);
        for i in place..self.order.len() {
            // Columns behind the gap have one entry below the diagonal: rotated away.
            let (top, bottom) = (self.u[i][i], self.u[i][i + 1]);
            let length = top.hypot(bottom);
            let (cos, sin) = (top / length, bottom / length);
            for column in &mut self.u[i..] {
                (column[i], column[i + 1]) = rotated(cos, sin, column[i], column[i + 1]);
            }
            self.u[i].truncate(i + 1);
            (self.q[i], self.q[i + 1]) = rotated(cos, sin, self.q[i], self.q[i + 1]);
            (self.t[i], self.t[i + 1]) = rotated(cos, sin, self.t[i], self.t[i + 1]);
            for slab in [Some(&mut self.w), self.basis.as_mut()].into_iter().flatten() {
                let (x, y) = slab.pair_mut(i);
                for (x, y) in x.iter_mut().zip(y) {
                    (*x, *y) = rotated(cos, sin, *x, *y);
                }
            }
        }
        let last = self.order.len();
        self.move_to(j, last);
        if let (Some(q), Some(t)) = (self.q.pop(), self.t.pop()) {
            add_scaled(q, self.w.column(last), &mut self.e);
            add_scaled(-t, self.w.column(last), &mut self.a);
        }
        self.w.pop();
        if let Some(basis) = &mut self.basis {
            basis.pop();
            // Rotations mix neighbours.
            let worst = self.magnified.iter().skip(place).copied().fold(1.0, f64::max);
            self.magnified.iter_mut().skip(place).for_each(|magnified| *magnified = worst);
            self.magnified.pop();
        }
    }

    /// Computes e and a anew from W.
    pub(crate) fn refresh(&mut self) {
        self.e.copy_from_slice(&self.c);
        self.w.subtract(&self.q, &mut self.e);
        self.a.fill(0.0);
        let minus: Vec<f64> = self.t.iter().map(|t| -t).collect();
        self.w.subtract(&minus, &mut self.a);
    }

    /// `U^-1 q` and `U^-1 t`: the least-squares coefficients of the active columns, and how they fall with lambda.
    pub(crate) fn solutions(&self) -> (Vec<f64>, Vec<f64>) {
        let (mut x, mut y) = (self.q.clone(), self.t.clone());
        substitute_back(&self.u, &mut x, &mut y);
        (x, y)
    }

    /// The last entry of `U^-1 q` or of `U^-1 t`, up to a positive factor; 0 when nothing is active.
    pub(crate) fn last(&self, target: bool) -> f64 {
        *(if target { &self.q } else { &self.t }).last().unwrap_or(&0.0)
    }

    /// Diagonal of `(U'U)^-1`.
    pub(crate) fn inverse_diagonal(&self) -> Vec<f64> {
        let k = self.order.len();
        let entry = |place: usize| {
            // U^-T of a unit vector, from its one on.
            let mut x = vec![0.0; k];
            for i in place..k {
                let known: f64 = (place..i).map(|l| self.u[i][l] * x[l]).sum();
                x[i] = (f64::from(i == place) - known) / self.u[i][i];
            }
            x.iter().map(|x| x * x).sum()
        };
        (0..k).map(entry).collect()
    }
}

/// Inactive columns that enter next along the present direction: those whose correlations, `e + lambda a`, meet their bounds at the largest lambdas. Entries of
/// the columns `column_at` begin at `first`.
fn nearest(
    (e, a): (&[f64], &[f64]),
    (column_at, first): (&[usize], usize),
    weights: &Weights,
    most: usize,
) -> Vec<usize> {
    let meets = |(at, &j): (usize, &usize)| {
        let side = |side: &f64| {
            let (push, rate) = (side * e[first + at], weights.omega[j] - side * a[first + at]);
            if push > 0.0 && rate > 0.0 { push / rate } else { 0.0 }
        };
        let lambda = weights.signs[j].sides().iter().map(side).fold(0.0, f64::max);
        (weights.used(j) && lambda > 0.0).then_some((lambda, j))
    };
    let mut next: Vec<(f64, usize)> = column_at.iter().enumerate().filter_map(meets).collect();
    next.sort_unstable_by(|x, y| y.0.total_cmp(&x.0).then(x.1.cmp(&y.1)));
    next.truncate(most);
    next.into_iter().map(|(_, j)| j).collect()
}

fn rotated(cos: f64, sin: f64, x: f64, y: f64) -> (f64, f64) {
    (cos * x + sin * y, cos * y - sin * x)
}

/// Rows `sqrt(ridge)` below A, compressed to a triangle when that is smaller; their target is zero.
fn stack(a: &Slab, z: &[f64], ridge: &[f64]) -> (Slab, Vec<f64>) {
    let (m, p) = (a.rows(), a.columns());
    let entry = |i: usize, j: usize| match i.checked_sub(m) {
        None => a.column(j)[i],
        Some(below) => {
            if below == j {
                ridge[j].sqrt()
            } else {
                0.0
            }
        }
    };
    let mut rows = Slab::from_fn(m + p, p, entry);
    let mut target = z[..m].to_vec();
    target.resize(rows.stride(), 0.0);
    crate::rows::compress(&mut rows, &mut target);
    (rows, target)
}
