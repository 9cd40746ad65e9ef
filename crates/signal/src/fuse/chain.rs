//! Least squares over a chain of nodes with a border: unknowns x_0 ... x_(n-1) of which each row of the problem sees two neighbours at most, and a few theta that every row may see.
//!
//! A node is eliminated by reflectors from the rows that see it, so that R x_i + U x_(i+1) + V theta = z is left of it, and rows on x_(i+1) and theta are carried on (a square-root information
//! filter: Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, chapter VI). The rows on theta that the last node leaves are the square root of the Schur complement of the
//! whole chain: those of several chains are stacked. No normal matrix is formed. The way back keeps the carried rows of every 1024th node and eliminates again between them, so that memory is some
//! hundred bytes a node; of short chains what is left of every node is kept.

use fleetfoot_data::checkpoint;
use nalgebra::SMatrix;

use super::state::{BORDER, BorderError, STATE, StateError};

/// Where the columns of a row begin: a node, the next node, the right side, theta.
pub(super) const NEXT_AT: usize = STATE;
pub(super) const RIGHT: usize = 2 * STATE;
pub(super) const BORDER_AT: usize = RIGHT + 1;
pub(super) const WIDTH: usize = BORDER_AT + BORDER;
/// Columns of a row that is without theta.
pub(super) const NARROW: usize = BORDER_AT.next_multiple_of(LANES);

/// The share of a constant's column that is left when the others have explained what they can, below which rounding is all that is left.
const DETERMINED: f64 = 1e-9;

/// The share of a node's column that is left when all before has explained what it can, below which rounding is all that is left.
const REST: f64 = 1e-13;

/// A row of the problem.
pub(super) type Row = [f64; WIDTH];

/// Nodes between two that are kept.
pub(super) const KEPT: usize = 1024;

/// A chain: how many nodes it has, and what pushes the rows whose first node is `node`.
pub(super) struct Chain<'a> {
    pub(super) nodes: usize,
    pub(super) rows: &'a (dyn Fn(usize, &mut Vec<Row>) + Sync),
    /// Levenberg and Marquardt's damping, in squares of the columns' norms.
    pub(super) damping: f64,
    /// Columns of a row up to which they hold anything, a multiple of four: fewer than all where theta is given.
    pub(super) width: usize,
    /// Whether what is left of every node is kept for the way back.
    pub(super) keeps_all: bool,
}

/// Squares of columns before elimination.
#[derive(Default)]
struct Squares {
    /// Of the node that is eliminated next: rows that came before it see it, too.
    node: StateError,
    border: BorderError,
}

/// A chain whose nodes are eliminated.
pub(super) struct Eliminated {
    /// The carried rows at every 1024th node.
    kept: Vec<Vec<Row>>,
    /// What is left of every node, where that is kept.
    heads: Vec<Head>,
    /// What is left on theta.
    pub(super) border: Vec<Row>,
    /// Squares of the columns of theta before elimination.
    pub(super) squares: BorderError,
}

/// Some direction of the unknowns is seen by no row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Undetermined;

/// Covariances of a node with all else.
#[derive(Debug, Clone)]
pub(super) struct Joint {
    pub(super) own: SMatrix<f64, STATE, STATE>,
    pub(super) with_border: SMatrix<f64, STATE, BORDER>,
    /// With the next node; zero of the last one.
    pub(super) with_next: SMatrix<f64, STATE, STATE>,
}

/// Reflects the rows from `first` on, so that each of these columns is zero below a row of its own; the row after the last of these is handed back. A column without entries gets no row.
///
/// The greatest entry of a column is its pivot, and rows that have none in it are left alone, which spares most of the work on rows that are triangular already.
fn reduce(rows: &mut [Row], columns: std::ops::Range<usize>, mut first: usize, width: usize) -> usize {
    for c in columns {
        let size = |row: &Row| row[c].abs();
        let Some(pivot) = (first..rows.len()).reduce(|a, b| if size(&rows[b]) > size(&rows[a]) { b } else { a }) else {
            return first;
        };
        if rows[pivot][c] == 0.0 {
            continue;
        }
        // What is left of theta sees its right side, which comes before it. Loops begin at a multiple of four columns: what lies before is zero already.
        let from = c.min(RIGHT) / LANES * LANES;
        let (done, below) = rows.split_at_mut(first + 1);
        let head = &mut done[first];
        if pivot > first {
            head[from..width].swap_with_slice(&mut below[pivot - first - 1][from..width]);
        }
        let tail: f64 = below.iter().map(|row| row[c] * row[c]).sum();
        first += 1;
        if tail == 0.0 {
            continue;
        }
        let norm = (head[c] * head[c] + tail).sqrt();
        let diagonal = if head[c] > 0.0 { -norm } else { norm };
        let (own, beta) = (head[c] - diagonal, 1.0 / (norm * (norm + head[c].abs())));
        let mut dots = [0.0; WIDTH];
        add(&mut dots, own, head, from..width);
        for row in below.iter().filter(|row| row[c] != 0.0) {
            add(&mut dots, row[c], row, from..width);
        }
        for dot in &mut dots {
            *dot *= -beta;
        }
        add(head, own, &dots, from..width);
        for row in below.iter_mut().filter(|row| row[c] != 0.0) {
            add(row, row[c], &dots, from..width);
            row[c] = 0.0;
        }
        head[c] = diagonal;
    }
    first
}

/// Columns that are worked on at a time.
const LANES: usize = 4;

/// Adds a multiple of these columns of one row to another, `columns` from a multiple of [`LANES`] to one.
#[inline]
fn add(to: &mut Row, factor: f64, from: &Row, columns: std::ops::Range<usize>) {
    let (to, from) = (to.as_chunks_mut::<LANES>().0, from.as_chunks::<LANES>().0);
    for at in columns.start / LANES..columns.end / LANES {
        let ([a, b, c, d], own) = (to[at], from[at]);
        to[at] = [a + factor * own[0], b + factor * own[1], c + factor * own[2], d + factor * own[3]];
    }
}

/// Moves the rows that the next node sees, and theta, to the front.
fn carry(rows: &mut Vec<Row>, left: usize) {
    for at in STATE..left {
        let (before, row) = rows.split_at_mut(at);
        let (to, row) = (&mut before[at - STATE], &row[0]);
        to[..STATE].copy_from_slice(&row[NEXT_AT..RIGHT]);
        to[NEXT_AT..RIGHT].fill(0.0);
        to[RIGHT..].copy_from_slice(&row[RIGHT..]);
    }
    rows.truncate(left - STATE);
}

impl Chain<'_> {
    /// Eliminates a node: `rows` are those that were carried to it; the node's own come first afterwards, and then those that are carried on, up to the row that is handed back.
    fn eliminate(&self, node: usize, rows: &mut Vec<Row>, squares: &mut Squares) -> Result<usize, Undetermined> {
        if node.is_multiple_of(KEPT) {
            checkpoint();
        }
        let carried = rows.len();
        (self.rows)(node, rows);
        let mut next = StateError::zeros();
        for row in &rows[carried..] {
            for j in 0..STATE {
                squares.node[j] += row[j] * row[j];
                next[j] += row[NEXT_AT + j] * row[NEXT_AT + j];
            }
            for j in 0..BORDER {
                squares.border[j] += row[BORDER_AT + j] * row[BORDER_AT + j];
            }
        }
        let own = std::mem::replace(&mut squares.node, next);
        if self.damping > 0.0 {
            damp(rows, 0..STATE, self.damping);
        }
        // No number is greater than what is not a number, which is told as undetermined, too.
        if reduce(rows, 0..STATE, 0, self.width) < STATE || !(0..STATE).all(|c| rows[c][c].abs() > REST * own[c].sqrt())
        {
            return Err(Undetermined);
        }
        let left = reduce(rows, NEXT_AT..RIGHT, STATE, self.width);
        Ok(reduce(rows, BORDER_AT..self.width, left, self.width))
    }

    /// Eliminates all nodes.
    pub(super) fn eliminated(&self) -> Result<Eliminated, Undetermined> {
        let (mut kept, mut heads, mut rows, mut squares) = (Vec::new(), Vec::new(), Vec::new(), Squares::default());
        for node in 0..self.nodes {
            if node % KEPT == 0 {
                kept.push(rows.clone());
            }
            let left = self.eliminate(node, &mut rows, &mut squares)?;
            if self.keeps_all {
                heads.push(Head::new(&rows));
            }
            carry(&mut rows, left);
        }
        Ok(Eliminated { kept, heads, border: rows, squares: squares.border })
    }

    /// The nodes' errors from the last to the first, given those of theta; with `covariance`, that of theta, also theirs.
    pub(super) fn back(
        &self,
        eliminated: &Eliminated,
        theta: &BorderError,
        covariance: Option<&SMatrix<f64, BORDER, BORDER>>,
        each: &mut dyn FnMut(usize, &StateError, Option<&Joint>),
    ) -> Result<(), Undetermined> {
        let mut next: Option<(StateError, Option<Joint>)> = None;
        let mut visit = |first: usize, heads: &[Head]| {
            for (at, head) in heads.iter().enumerate().rev() {
                let error = head.error(next.as_ref().map(|(error, _)| error), theta);
                let joint = covariance.map(|own| head.joint(next.as_ref().and_then(|(_, joint)| joint.as_ref()), own));
                each(first + at, &error, joint.as_ref());
                next = Some((error, joint));
            }
        };
        if !eliminated.heads.is_empty() {
            visit(0, &eliminated.heads);
            return Ok(());
        }
        let mut heads = Vec::with_capacity(KEPT);
        for (at, start) in eliminated.kept.iter().enumerate().rev() {
            let first = at * KEPT;
            let (mut rows, mut squares) = (start.clone(), Squares::default());
            heads.clear();
            for node in first..(first + KEPT).min(self.nodes) {
                let left = self.eliminate(node, &mut rows, &mut squares)?;
                heads.push(Head::new(&rows));
                carry(&mut rows, left);
            }
            visit(first, &heads);
        }
        Ok(())
    }
}

/// Adds rows that hold back the unknowns of these columns, each by its norm.
fn damp(rows: &mut Vec<Row>, columns: std::ops::Range<usize>, damping: f64) {
    for c in columns {
        let norm = (damping * rows.iter().map(|row| row[c] * row[c]).sum::<f64>()).sqrt();
        let mut row = [0.0; WIDTH];
        row[c] = norm;
        rows.push(row);
    }
}

/// R x + U x_next + V theta = z.
struct Head {
    r: SMatrix<f64, STATE, STATE>,
    u: SMatrix<f64, STATE, STATE>,
    v: SMatrix<f64, STATE, BORDER>,
    z: StateError,
}

impl Head {
    fn new(rows: &[Row]) -> Self {
        let mut own = Self { r: SMatrix::zeros(), u: SMatrix::zeros(), v: SMatrix::zeros(), z: StateError::zeros() };
        for (i, row) in rows[..STATE].iter().enumerate() {
            for j in 0..STATE {
                own.r.data.0[j][i] = row[j];
                own.u.data.0[j][i] = row[NEXT_AT + j];
            }
            for j in 0..BORDER {
                own.v.data.0[j][i] = row[BORDER_AT + j];
            }
            own.z.data.0[0][i] = row[RIGHT];
        }
        own
    }

    /// R^-1 B.
    fn solve<const N: usize>(&self, b: &SMatrix<f64, STATE, N>) -> SMatrix<f64, STATE, N> {
        let mut x = *b;
        for column in &mut x.data.0 {
            for i in (0..STATE).rev() {
                column[i] /= self.r[(i, i)];
                let (above, own) = (&self.r.data.0[i], column[i]);
                for k in 0..i {
                    column[k] -= above[k] * own;
                }
            }
        }
        x
    }

    fn error(&self, next: Option<&StateError>, theta: &BorderError) -> StateError {
        let mut right = self.z - self.v * theta;
        if let Some(next) = next {
            right -= self.u * next;
        }
        self.solve(&right)
    }

    /// x = A x_next + B theta + C e, e of variance one and independent of all that comes later.
    fn joint(&self, next: Option<&Joint>, theta: &SMatrix<f64, BORDER, BORDER>) -> Joint {
        let b = -self.solve(&self.v);
        let c = self.solve(&SMatrix::<f64, STATE, STATE>::identity());
        let by_theta = product(&b, theta);
        let mut own = product(&by_theta, &b.transpose()) + product(&c, &c.transpose());
        let (mut with_border, mut with_next) = (by_theta, SMatrix::zeros());
        if let Some(next) = next {
            let a = -self.solve(&self.u);
            let (by_border, by_next) = (product(&a, &next.with_border), product(&a, &next.own));
            let crossed = product(&by_border, &b.transpose());
            own += product(&by_next, &a.transpose()) + crossed + crossed.transpose();
            with_border += by_border;
            with_next = by_next + product(&b, &next.with_border.transpose());
        }
        Joint { own: 0.5 * (own + own.transpose()), with_border, with_next }
    }
}

/// A B, column by column: nalgebra's own product of this size is a call for every column of every column.
pub(super) fn product<const R: usize, const K: usize, const C: usize>(
    a: &SMatrix<f64, R, K>,
    b: &SMatrix<f64, K, C>,
) -> SMatrix<f64, R, C> {
    let mut sum = SMatrix::<f64, R, C>::zeros();
    for (sum, factors) in sum.data.0.iter_mut().zip(&b.data.0) {
        for (column, factor) in a.data.0.iter().zip(factors) {
            for i in 0..R {
                sum[i] += column[i] * factor;
            }
        }
    }
    sum
}

/// Theta and its covariance from rows on it alone, those of several chains and of what is known beforehand; `squares` are those of its columns before elimination.
pub(super) fn solve_border(
    mut rows: Vec<Row>,
    squares: &BorderError,
    damping: f64,
) -> Result<(BorderError, SMatrix<f64, BORDER, BORDER>), Undetermined> {
    if damping > 0.0 {
        damp(&mut rows, BORDER_AT..WIDTH, damping);
    }
    if reduce(&mut rows, BORDER_AT..WIDTH, 0, WIDTH) < BORDER {
        return Err(Undetermined);
    }
    let r = SMatrix::<f64, BORDER, BORDER>::from_fn(|i, j| rows[i][BORDER_AT + j]);
    let z = BorderError::from_fn(|i, _| rows[i][RIGHT]);
    if !(0..BORDER).all(|i| r[(i, i)].abs() >= DETERMINED * squares[i].sqrt()) {
        return Err(Undetermined);
    }
    let theta = r.solve_upper_triangular(&z).ok_or(Undetermined)?;
    let one = SMatrix::<f64, BORDER, BORDER>::identity();
    let inverse = r.solve_upper_triangular(&one).ok_or(Undetermined)?;
    Ok((theta, inverse * inverse.transpose()))
}
