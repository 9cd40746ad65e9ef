//! Least squares over a chain of states with a border of coefficients, by reflectors.
//!
//! The states z_k of a trajectory are eliminated one after the other from their rows (a square-root information filter:
//! Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, chapter VI). Each leaves
//! `R z_k + U z_k+1 + V c + rho = 0`. Rows on z_k+1 and c are carried on, and rows on c alone are handed out. No normal
//! matrix is formed, and work and memory grow with the rows.

use faer::Mat;
use fleetfoot_stats::{
    householder::fold_rows,
    kernel::{Slab, add_scaled, padded},
};

/// Rows of a least-squares problem, one behind the other: a state, the next state, the coefficients, the right side.
pub(super) struct Rows {
    states: usize,
    border: usize,
    stride: usize,
    values: Vec<f64>,
}

impl Rows {
    pub(super) fn new(states: usize, border: usize) -> Self {
        Self { states, border, stride: padded(2 * states + border + 1), values: Vec::new() }
    }

    /// Another row of zeros, to be filled.
    pub(super) fn push(&mut self) -> Row<'_> {
        let at = self.values.len();
        self.values.resize(at + self.stride, 0.0);
        Row { states: self.states, border: self.border, values: &mut self.values[at..] }
    }

    fn count(&self) -> usize {
        self.values.len() / self.stride
    }

    fn right(&self) -> usize {
        2 * self.states + self.border
    }

    /// Reflects the rows so that each of the first columns is zero below one row. Returns the number of these rows; a
    /// next state with too few measurements has fewer. `None` if a column of the state itself has no row.
    fn reduce(&mut self, columns: usize) -> Option<usize> {
        let (stride, count) = (self.stride, self.count());
        let mut dots = vec![0.0; stride];
        let mut first = 0;
        for c in 0..columns {
            let entry = |values: &[f64], row: usize| values[row * stride + c];
            let below: f64 = (first + 1..count).map(|row| entry(&self.values, row).powi(2)).sum();
            let head = if first < count { entry(&self.values, first) } else { 0.0 };
            let length = (head * head + below).sqrt();
            if !length.is_finite() || (length <= 0.0 && c < self.states) {
                return None;
            }
            if below > 0.0 {
                let diagonal = if head > 0.0 { -length } else { length };
                let pivot = head - diagonal;
                let beta = 1.0 / (length * (length + head.abs()));
                dots.fill(0.0);
                for (row, values) in self.values.chunks_exact(stride).enumerate().skip(first) {
                    let factor = if row == first { pivot } else { values[c] };
                    if factor != 0.0 {
                        add(factor * beta, values, &mut dots);
                    }
                }
                for (row, values) in self.values.chunks_exact_mut(stride).enumerate().skip(first) {
                    let factor = if row == first { pivot } else { values[c] };
                    if factor != 0.0 {
                        add(-factor, &dots, values);
                        values[c] = if row == first { diagonal } else { 0.0 };
                    }
                }
            }
            first += usize::from(length > 0.0);
        }
        Some(first)
    }
}

/// Columns from which on vector instructions are looked up.
const WIDE: usize = 48;

/// `y += factor x`.
fn add(factor: f64, x: &[f64], y: &mut [f64]) {
    if x.len() >= WIDE {
        return add_scaled(factor, x, y);
    }
    for (y, x) in y.iter_mut().zip(x) {
        *y += factor * x;
    }
}

/// A row that is filled.
pub(super) struct Row<'a> {
    states: usize,
    border: usize,
    values: &'a mut [f64],
}

impl Row<'_> {
    pub(super) fn state(&mut self) -> &mut [f64] {
        &mut self.values[..self.states]
    }

    pub(super) fn next(&mut self) -> &mut [f64] {
        &mut self.values[self.states..2 * self.states]
    }

    pub(super) fn border(&mut self) -> &mut [f64] {
        &mut self.values[2 * self.states..2 * self.states + self.border]
    }

    pub(super) fn right(&mut self) -> &mut f64 {
        &mut self.values[2 * self.states + self.border]
    }
}

/// Objective of the coefficients, from the rows: `|R dc + rho|^2 + residual`.
#[derive(Debug, Clone)]
pub(super) struct Border {
    /// R, then rho (p x (p + 1)).
    pub(super) factor: Mat<f64>,
    pub(super) residual: f64,
    /// Squares of the columns before the states were eliminated (p).
    pub(super) squares: Vec<f64>,
}

/// Rows that are folded at once, at least; four a column, so that many columns are folded by blocks of reflectors.
const FOLDED: usize = 64;

impl Border {
    pub(super) fn new(border: usize) -> Self {
        Self { factor: Mat::zeros(border, border + 1), residual: 0.0, squares: vec![0.0; border] }
    }

    /// Adds rows (each the coefficients, then the right side).
    fn fold(&mut self, rows: &[f64]) {
        let width = self.squares.len() + 1;
        let count = rows.len() / width;
        if count == 0 {
            return;
        }
        let mut slab = Slab::from_fn(count, width, |i, j| rows[i * width + j]);
        if width > 1 {
            fold_rows(&mut self.factor, &mut slab);
        }
        self.residual += slab.column(width - 1)[..count].iter().map(|value| value * value).sum::<f64>();
    }

    /// Adds another trajectory's.
    pub(super) fn merge(&mut self, other: &Self) {
        let p = self.squares.len();
        let rows: Vec<f64> = (0..p).flat_map(|i| (0..=p).map(move |j| other.factor[(i, j)])).collect();
        self.fold(&rows);
        self.residual += other.residual;
        self.squares.iter_mut().zip(&other.squares).for_each(|(sum, square)| *sum += square);
    }
}

/// A chain whose states are eliminated.
pub(super) struct Eliminated {
    states: usize,
    border: usize,
    /// Eliminated equations of every state: n rows of two states, the border and the right side; empty if not kept.
    heads: Vec<f64>,
    pub(super) on_border: Border,
    /// Of the matrix of the squares by the states alone.
    pub(super) log_determinant: f64,
}

/// Eliminates the states of a chain. `fill` pushes the rows of an interval, or of the last state, whose own state is the first that they see. `None` where some state
/// is seen by nothing.
pub(super) fn eliminate(
    (nodes, states, border): (usize, usize, usize),
    keep: bool,
    mut fill: impl FnMut(usize, &mut Rows),
) -> Option<Eliminated> {
    let mut rows = Rows::new(states, border);
    let (stride, right) = (rows.stride, rows.right());
    let width = right + 1;
    let mut on_border = Border::new(border);
    let mut heads = Vec::with_capacity(if keep { nodes * states * width } else { 0 });
    let mut waiting: Vec<f64> = Vec::new();
    let mut log_determinant = 0.0;
    for node in 0..nodes {
        fleetfoot_data::checkpoint();
        let carried = rows.values.len();
        fill(node, &mut rows);
        for row in rows.values[carried..].chunks_exact(stride) {
            let of_border = &row[2 * states..right];
            on_border.squares.iter_mut().zip(of_border).for_each(|(sum, value)| *sum += value * value);
        }
        let last = node + 1 == nodes;
        let columns = if last { states } else { 2 * states };
        let led = rows.reduce(columns)?;
        for (s, row) in rows.values.chunks_exact(stride).take(states).enumerate() {
            log_determinant += 2.0 * row[s].abs().ln();
            if keep {
                heads.extend_from_slice(&row[..width]);
            }
        }
        for row in rows.values.chunks_exact(stride).skip(led) {
            waiting.extend_from_slice(&row[2 * states..width]);
        }
        if waiting.len() >= FOLDED.max(4 * border) * (border + 1) {
            on_border.fold(&waiting);
            waiting.clear();
        }
        if !last {
            rows.values.copy_within(states * stride..led * stride, 0);
            rows.values.truncate((led - states) * stride);
            for row in rows.values.chunks_exact_mut(stride) {
                row.copy_within(states..2 * states, 0);
                row[states..2 * states].fill(0.0);
            }
        }
    }
    on_border.fold(&waiting);
    Some(Eliminated { states, border, heads, on_border, log_determinant })
}

impl Eliminated {
    /// The steps of the states (nodes x n) that go with a step of the coefficients.
    pub(super) fn back(&self, coefficients: &[f64]) -> Vec<f64> {
        let n = self.states;
        let width = 2 * n + self.border + 1;
        let nodes = self.heads.len() / (n * width);
        let mut steps = vec![0.0; nodes * n];
        for node in (0..nodes).rev() {
            let rows = &self.heads[node * n * width..(node + 1) * n * width];
            let (step, behind) = steps[node * n..].split_at_mut(n);
            for s in (0..n).rev() {
                let row = &rows[s * width..(s + 1) * width];
                let mut sum = row[width - 1];
                sum += row[s + 1..n].iter().zip(&step[s + 1..]).map(|(r, x)| r * x).sum::<f64>();
                if node + 1 < nodes {
                    sum += row[n..2 * n].iter().zip(&behind[..n]).map(|(r, x)| r * x).sum::<f64>();
                }
                sum += row[2 * n..width - 1].iter().zip(coefficients).map(|(r, x)| r * x).sum::<f64>();
                step[s] = -sum / row[s];
            }
        }
        steps
    }
}
