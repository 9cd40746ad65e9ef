//! Least squares over a chain of nodes with a border: unknowns x_0 ... x_(n-1) of which each row of the problem sees two neighbours at most, and a few theta that every row may see.
//!
//! A node is eliminated by reflectors from the rows that see it, so that R x_i + U x_(i+1) + V theta = z is left of it, and rows on x_(i+1) and theta are carried on (a square-root information
//! filter: Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, chapter VI). The rows on theta that the last node leaves are the square root of the Schur complement of the
//! whole chain: those of several chains are stacked. No normal matrix is formed. The way back keeps the carried rows of every 1024th node and eliminates again between them, so that memory is some
//! hundred bytes a node; of short chains what is left of every node is kept.

use fleetfoot_data::checkpoint;
use nalgebra::SMatrix;
use pulp::{Simd, WithSimd};

use super::state::{BORDER, BorderError, STATE, StateError};

/// First columns of a row's parts: a node, the next node, the right side, theta.
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

/// A chain: its number of nodes, and a function that pushes the rows whose first node is `node`.
pub(super) struct Chain<'a> {
    pub(super) nodes: usize,
    pub(super) rows: &'a (dyn Fn(usize, &mut Vec<Row>) + Sync),
    /// Levenberg and Marquardt's damping, in squares of the columns' norms.
    pub(super) damping: f64,
    /// Columns of a row up to which they hold anything, a multiple of eight: fewer than all where theta is given.
    pub(super) width: usize,
    /// True if the eliminated rows of every node are kept for the backward pass.
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
    /// Remaining rows of every node, if they are kept: [`STATE`] rows each.
    heads: Vec<Row>,
    /// Remaining rows on theta.
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
    pub(super) node: SMatrix<f64, STATE, STATE>,
    pub(super) with_border: SMatrix<f64, STATE, BORDER>,
    /// With the next node; zero of the last one.
    pub(super) with_next: SMatrix<f64, STATE, STATE>,
}

/// Reflects the rows from `first` on, so that each of these columns is zero below a row of its own; the row after the last of these is handed back. A column without entries gets no row.
///
/// The greatest entry of a column is its pivot, and rows that have none in it are left alone, which spares most of the work on rows that are triangular already.
fn reduce(rows: &mut [Row], columns: std::ops::Range<usize>, first: usize, width: usize) -> usize {
    fleetfoot_data::arch().dispatch(Reduction { rows, columns, first, width })
}

struct Reduction<'a> {
    rows: &'a mut [Row],
    columns: std::ops::Range<usize>,
    first: usize,
    width: usize,
}

impl WithSimd for Reduction<'_> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> usize {
        let Self { rows, columns, mut first, width } = self;
        let mut places = vec![0; rows.len()];
        for c in columns {
            if first >= rows.len() {
                return first;
            }
            // The rows that have an entry, counted from the first, and the greatest: the first of equals.
            let (mut count, mut pivot, mut size) = (0, 0, 0.0);
            for (at, row) in rows[first..].iter().enumerate() {
                let entry = row[c].abs();
                places[count] = at;
                count += usize::from(entry != 0.0);
                if entry > size {
                    (pivot, size) = (at, entry);
                }
            }
            if count == 0 {
                continue;
            }
            // The rest of theta sees its right side, which comes before it. Loops begin at a multiple of eight columns: lower ones are zero already.
            let from = c.min(RIGHT) / LANES;
            let (done, below) = rows.split_at_mut(first + 1);
            let head = &mut done[first];
            let mut blocks = &mut places[..count];
            if blocks[0] == 0 {
                blocks = &mut blocks[1..];
            } else if let Some(at) = blocks.iter().position(|&at| at == pivot) {
                // There the row without an entry goes.
                blocks.copy_within(at + 1.., at);
                blocks = &mut blocks[..count - 1];
            }
            if pivot > 0 {
                head[from * LANES..width].swap_with_slice(&mut below[pivot - 1][from * LANES..width]);
            }
            first += 1;
            match width / LANES - from {
                1 => reflect::<S, 1>(simd, head, below, blocks, c, from),
                2 => reflect::<S, 2>(simd, head, below, blocks, c, from),
                3 => reflect::<S, 3>(simd, head, below, blocks, c, from),
                4 => reflect::<S, 4>(simd, head, below, blocks, c, from),
                _ => reflect::<S, 5>(simd, head, below, blocks, c, from),
            }
        }
        first
    }
}

/// Reflects a row and those below it at these places, one more than where they are, in the last N times [`LANES`] columns, so that this column is zero in the latter. Products are not fused with sums: on every machine the bits are the same.
#[inline(always)]
fn reflect<S: Simd, const N: usize>(
    simd: S,
    head: &mut Row,
    below: &mut [Row],
    places: &[usize],
    c: usize,
    from: usize,
) {
    let tail: f64 = places.iter().map(|at| below[at - 1][c] * below[at - 1][c]).sum();
    if tail == 0.0 {
        return;
    }
    let norm = (head[c] * head[c] + tail).sqrt();
    let diagonal = if head[c] > 0.0 { -norm } else { norm };
    let (pivot, beta) = (head[c] - diagonal, 1.0 / (norm * (norm + head[c].abs())));
    let mut dots = Columns::<S, N>::zero(simd);
    dots.add(pivot, head, from);
    for at in places {
        dots.add(below[at - 1][c], &below[at - 1], from);
    }
    dots.scale(-beta);
    dots.add_to(pivot, head, from);
    for at in places {
        let row = &mut below[at - 1];
        dots.add_to(row[c], row, from);
        row[c] = 0.0;
    }
    head[c] = diagonal;
}

/// Columns that are worked on at a time, whatever a register holds.
const LANES: usize = 8;

/// N times [`LANES`] columns of a row in registers; of each list the first registers are in use.
struct Columns<S: Simd, const N: usize> {
    simd: S,
    values: [[S::f64s; LANES]; N],
}

impl<S: Simd, const N: usize> Columns<S, N> {
    const REGISTERS: usize = LANES / S::F64_LANES;

    #[inline(always)]
    fn zero(simd: S) -> Self {
        Self { simd, values: [[simd.splat_f64s(0.0); LANES]; N] }
    }

    /// Adds a multiple of a row.
    #[inline(always)]
    fn add(&mut self, factor: f64, row: &Row, from: usize) {
        let (row, factor) = (S::as_simd_f64s(row).0, self.simd.splat_f64s(factor));
        let row = &row[from * Self::REGISTERS..(from + N) * Self::REGISTERS];
        for n in 0..N {
            for k in 0..Self::REGISTERS {
                let product = self.simd.mul_f64s(factor, row[n * Self::REGISTERS + k]);
                self.values[n][k] = self.simd.add_f64s(self.values[n][k], product);
            }
        }
    }

    #[inline(always)]
    fn scale(&mut self, factor: f64) {
        let factor = self.simd.splat_f64s(factor);
        for n in 0..N {
            for k in 0..Self::REGISTERS {
                self.values[n][k] = self.simd.mul_f64s(self.values[n][k], factor);
            }
        }
    }

    /// Adds a multiple of these to a row.
    #[inline(always)]
    fn add_to(&self, factor: f64, row: &mut Row, from: usize) {
        let (row, factor) = (S::as_mut_simd_f64s(row).0, self.simd.splat_f64s(factor));
        let row = &mut row[from * Self::REGISTERS..(from + N) * Self::REGISTERS];
        for n in 0..N {
            for k in 0..Self::REGISTERS {
                let product = self.simd.mul_f64s(factor, self.values[n][k]);
                row[n * Self::REGISTERS + k] = self.simd.add_f64s(row[n * Self::REGISTERS + k], product);
            }
        }
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
        let node = std::mem::replace(&mut squares.node, next);
        if self.damping > 0.0 {
            damp(rows, 0..STATE, self.damping);
        }
        // No number is greater than what is not a number, which is told as undetermined, too.
        if reduce(rows, 0..STATE, 0, self.width) < STATE
            || !(0..STATE).all(|c| rows[c][c].abs() > REST * node[c].sqrt())
        {
            return Err(Undetermined);
        }
        let left = reduce(rows, NEXT_AT..RIGHT, STATE, self.width);
        Ok(reduce(rows, BORDER_AT..self.width, left, self.width))
    }

    /// Eliminates all nodes.
    pub(super) fn eliminated(&self) -> Result<Eliminated, Undetermined> {
        let (mut kept, mut rows, mut squares) = (Vec::new(), Vec::new(), Squares::default());
        let mut heads = Vec::with_capacity(if self.keeps_all { STATE * self.nodes } else { 0 });
        for node in 0..self.nodes {
            if node % KEPT == 0 {
                kept.push(rows.clone());
            }
            let left = self.eliminate(node, &mut rows, &mut squares)?;
            if self.keeps_all {
                heads.extend_from_slice(&rows[..STATE]);
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
        let mut visit = |first: usize, heads: &[Row]| {
            for (at, head) in heads.chunks_exact(STATE).map(Head).enumerate().rev() {
                let error = head.error(next.as_ref().map(|(error, _)| error), theta);
                let joint =
                    covariance.map(|theta| head.joint(next.as_ref().and_then(|(_, joint)| joint.as_ref()), theta));
                each(first + at, &error, joint.as_ref());
                next = Some((error, joint));
            }
        };
        if !eliminated.heads.is_empty() {
            visit(0, &eliminated.heads);
            return Ok(());
        }
        let mut heads = Vec::with_capacity(STATE * KEPT);
        for (at, start) in eliminated.kept.iter().enumerate().rev() {
            let first = at * KEPT;
            let (mut rows, mut squares) = (start.clone(), Squares::default());
            heads.clear();
            for node in first..(first + KEPT).min(self.nodes) {
                let left = self.eliminate(node, &mut rows, &mut squares)?;
                heads.extend_from_slice(&rows[..STATE]);
                carry(&mut rows, left);
            }
            visit(first, &heads);
        }
        Ok(())
    }
}

impl Chain<'_> {
    /// The nodes' errors given theta and the rows up to each node, and their covariances, where theta has this one; from the first node that these determine on.
    pub(super) fn filtered(
        &self,
        covariance: &SMatrix<f64, BORDER, BORDER>,
        each: &mut dyn FnMut(usize, &StateError, &Joint),
    ) -> Result<(), Undetermined> {
        let (mut rows, mut squares, mut seen) = (Vec::new(), Squares::default(), Vec::new());
        for node in 0..self.nodes {
            seen.clear();
            (self.rows)(node, &mut seen);
            seen.retain(|row| row[NEXT_AT..RIGHT].iter().all(|slope| *slope == 0.0));
            let mut diagonal = squares.node;
            for row in &seen {
                (0..STATE).for_each(|j| diagonal[j] += row[j] * row[j]);
            }
            seen.extend_from_slice(&rows);
            let known = reduce(&mut seen, 0..STATE, 0, self.width) == STATE;
            if known && (0..STATE).all(|c| seen[c][c].abs() > REST * diagonal[c].sqrt()) {
                let head = Head(&seen[..STATE]);
                each(node, &head.error(None, &BorderError::zeros()), &head.joint(None, covariance));
            }
            if node + 1 < self.nodes {
                let left = self.eliminate(node, &mut rows, &mut squares)?;
                carry(&mut rows, left);
            }
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

/// R x + U x_next + V theta = z, as the rows have it.
struct Head<'a>(&'a [Row]);

impl Head<'_> {
    fn error(&self, next: Option<&StateError>, theta: &BorderError) -> StateError {
        let dot = |row: &[f64], of: &[f64]| row.iter().zip(of).map(|(slope, error)| slope * error).sum::<f64>();
        let mut x = [0.0; STATE];
        for (i, row) in self.0.iter().enumerate().rev() {
            let known = dot(&row[BORDER_AT..], theta.as_slice())
                + next.map_or(0.0, |next| dot(&row[NEXT_AT..RIGHT], next.as_slice()))
                + dot(&row[i + 1..STATE], &x[i + 1..]);
            x[i] = (row[RIGHT] - known) / row[i];
        }
        x.into()
    }

    /// x = A x_next + B theta + C e, e of variance one and independent of all that comes later.
    fn joint(&self, next: Option<&Joint>, theta: &SMatrix<f64, BORDER, BORDER>) -> Joint {
        fleetfoot_data::arch().dispatch(Spread { head: self.0, next, theta })
    }
}

struct Spread<'a> {
    head: &'a [Row],
    next: Option<&'a Joint>,
    theta: &'a SMatrix<f64, BORDER, BORDER>,
}

impl WithSimd for Spread<'_> {
    type Output = Joint;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Joint {
        // R^-1 [U, z, V] in their own columns, and R^-1 in those of the node.
        let mut solved = [[0.0; WIDTH]; STATE];
        for i in (0..STATE).rev() {
            let mut row = self.head[i];
            row[..STATE].fill(0.0);
            row[i] = 1.0;
            for k in i + 1..STATE {
                let factor = self.head[i][k];
                for j in 0..WIDTH {
                    row[j] -= factor * solved[k][j];
                }
            }
            let inverse = 1.0 / self.head[i][i];
            for j in 0..WIDTH {
                row[j] *= inverse;
            }
            solved[i] = row;
        }
        let (mut b, mut c) = (SMatrix::<f64, STATE, BORDER>::zeros(), SMatrix::<f64, STATE, STATE>::zeros());
        for i in 0..STATE {
            for j in 0..BORDER {
                b.data.0[j][i] = -solved[i][BORDER_AT + j];
            }
            for j in 0..STATE {
                c.data.0[j][i] = solved[i][j];
            }
        }
        let by_theta = product(&b, self.theta);
        let mut node = product(&by_theta, &b.transpose()) + product(&c, &c.transpose());
        let (mut with_border, mut with_next) = (by_theta, SMatrix::zeros());
        if let Some(next) = self.next {
            let mut a = SMatrix::<f64, STATE, STATE>::zeros();
            for i in 0..STATE {
                for j in 0..STATE {
                    a.data.0[j][i] = -solved[i][NEXT_AT + j];
                }
            }
            let (by_border, by_next) = (product(&a, &next.with_border), product(&a, &next.node));
            let crossed = product(&by_border, &b.transpose());
            node += product(&by_next, &a.transpose()) + crossed + crossed.transpose();
            with_border += by_border;
            with_next = by_next + product(&b, &next.with_border.transpose());
        }
        Joint { node: 0.5 * (node + node.transpose()), with_border, with_next }
    }
}

/// A B, column by column: nalgebra's own product of this size is a call for every column of every column.
#[inline(always)]
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
