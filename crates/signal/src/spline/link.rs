//! Backward pass: the state of a row from that of the next. Its matrices are made for several rows in a register.

use pulp::{Simd, WithSimd};

use super::{
    chain::{Chain, Matrix, Step, transposed},
    filter::{Belief, Posterior, Two, orthogonalise},
    number::{Abreast, Lanes, Number},
};

/// Dependence of a row's state on that of the next.
///
/// The state is F^-1 (s - w), with s the next state and w the noise of the step. Given s, w has the mean J (s - F mean)
/// with J = Q (F P F' + Q)^-1, and a covariance C. Neither is a difference of covariances. Under a strong penalty w is
/// nearly zero and its share of s keeps its digits. The textbook's gain P F' (F P F' + Q)^-1 would lose them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link<const M: usize, T = f64> {
    /// J.
    share: Matrix<M, T>,
    /// F^-1 (1 - J).
    kept: Matrix<M, T>,
    /// F^-1 C F^-T.
    spread: Matrix<M, T>,
}

impl<const M: usize, T: Number> Link<M, T> {
    #[inline(always)]
    pub(super) fn new(belief: &Belief<M, T>, step: &Step<M, T>) -> Self {
        let (share, spread) = if M == 2 { Self::of_two(belief, step) } else { Self::of_more(belief, step) };
        let mut rest = share;
        for i in 0..M {
            for j in 0..M {
                rest[i][j] = share[i][j].like(if i == j { 1.0 } else { 0.0 }) - share[i][j];
            }
        }
        Self { share, kept: step.backward_matrix(&rest), spread: step.backward_both(&spread) }
    }

    /// With A = F P F': J = Q adj(A + Q) / det(A + Q), and C = (A^-1 + Q^-1)^-1 = (det A Q + det Q A) / det(A + Q).
    #[inline(always)]
    fn of_two(belief: &Belief<M, T>, step: &Step<M, T>) -> (Matrix<M, T>, Matrix<M, T>) {
        let (f, h, q) = (&belief.factor, step.powers[1], step.variance);
        let Two { a, determinants: [determinant, whole], first: [p, l], .. } =
            Two::new([f[0][0], f[1][0], f[1][1]], h, q);
        let inverse = whole.inverse();
        let square = h * h;
        let (noise, scaled) = ((q * q).by(square.times(1.0 / 12.0)) * inverse, q * inverse);
        let u = l.by(h);
        // Q times what is perpendicular to the columns of F L.
        let (x, y) = (scaled * f[0][0], scaled * f[1][1]);
        let (top, bottom) = (x * u.times(1.0 / 6.0).plus(0.5).by(h), x * u.times(0.5).plus(1.0));
        let half = square.times(0.5);
        let mut share = belief.factor;
        share[0][0] = noise - top * l - y.by(square.times(1.0 / 6.0));
        share[0][1] = top * p + y.by((square * h).times(1.0 / 6.0));
        share[1][0] = q.like(0.0) - bottom * l - y.by(h.times(0.5));
        share[1][1] = noise + bottom * p + y.by(half);
        let (mut spread, part) = (share, determinant * scaled);
        spread[0][0] = part.by(square.times(1.0 / 3.0)) + noise * a[0][0];
        spread[0][1] = part.by(h.times(0.5)) + noise * a[0][1];
        spread[1][0] = spread[0][1];
        spread[1][1] = part + noise * a[1][1];
        (share, spread)
    }

    /// Both from the orthogonal rows of the step, [0, N] carried along.
    #[inline(always)]
    fn of_more(belief: &Belief<M, T>, step: &Step<M, T>) -> (Matrix<M, T>, Matrix<M, T>) {
        let (weights, mut head) = belief.array(step);
        let mut carried = head;
        for row in &mut carried {
            row.state = [step.variance.like(0.0); M];
        }
        let (factor, mut share) = orthogonalise(&mut head, &mut carried, &weights);
        // J L is what was found.
        for row in &mut share {
            for k in (0..M).rev() {
                for l in k + 1..M {
                    row[k] = row[k] - row[l] * factor[l][k];
                }
            }
        }
        let mut spread = share;
        for i in 0..M {
            let weighted = carried[i].weighted(&weights, M);
            for j in 0..=i {
                spread[i][j] = weighted.dot(&carried[j], M);
                spread[j][i] = spread[i][j];
            }
        }
        (share, spread)
    }
}

/// Rows that stand side by side: a multiple of what any register holds.
const BESIDE: usize = 8;

/// Beliefs of rows in a row; those of a few stand side by side, number by number.
#[derive(Debug, Clone, Default)]
pub(super) struct Beliefs<const M: usize> {
    blocks: Vec<Belief<M, [f64; BESIDE]>>,
    rows: usize,
}

impl<const M: usize> Beliefs<M> {
    /// Room for so many.
    pub(super) fn new(rows: usize) -> Self {
        Self { blocks: Vec::with_capacity(rows.div_ceil(BESIDE)), rows: 0 }
    }

    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    pub(super) fn clear(&mut self) {
        self.blocks.clear();
        self.rows = 0;
    }

    #[inline(always)]
    pub(super) fn push(&mut self, belief: &Belief<M>) {
        let at = self.rows % BESIDE;
        self.rows += 1;
        if at == 0 {
            self.blocks.push(Belief { mean: [[1.0; BESIDE]; M], factor: [[[1.0; BESIDE]; M]; M] });
        }
        if let Some(block) = self.blocks.last_mut() {
            for i in 0..M {
                block.mean[i][at] = belief.mean[i];
                for j in 0..=i {
                    block.factor[i][j][at] = belief.factor[i][j];
                }
            }
        }
    }

    #[inline(always)]
    pub(super) fn mean(&self, row: usize) -> [f64; M] {
        let block = &self.blocks[row / BESIDE];
        std::array::from_fn(|i| block.mean[i][row % BESIDE])
    }

    pub(super) fn get(&self, row: usize) -> Belief<M> {
        let factor = &self.blocks[row / BESIDE].factor;
        let entry = |i: usize, j: usize| factor[i][j][row % BESIDE];
        Belief { mean: self.mean(row), factor: std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))) }
    }
}

/// Rows whose links are made at a time, a multiple of those that stand side by side: they stay in the first-level cache.
pub(super) const PIECE: usize = 64;

/// The links of rows in a row, number by number.
pub(super) struct Links<const M: usize> {
    share: Matrix<M, [f64; PIECE]>,
    kept: Matrix<M, [f64; PIECE]>,
    spread: Matrix<M, [f64; PIECE]>,
}

impl<const M: usize> Links<M> {
    pub(super) fn new() -> Self {
        let none = [[[0.0; PIECE]; M]; M];
        Self { share: none, kept: none, spread: none }
    }

    /// Makes the links of the rows from `first` on, the first of a piece, whose steps to the next these are: a register holds a number of several rows.
    pub(super) fn make(&mut self, chain: &Chain<M>, beliefs: &Beliefs<M>, first: usize, steps: &[f64; PIECE]) {
        let blocks = &beliefs.blocks[first / BESIDE..];
        let blocks = &blocks[..blocks.len().min(PIECE / BESIDE)];
        fleetfoot_data::arch().dispatch(Made { links: self, chain, blocks, steps });
    }

    /// That of a row.
    #[inline(always)]
    pub(super) fn get(&self, at: usize) -> Link<M> {
        let mut link = Link { share: [[0.0; M]; M], kept: [[0.0; M]; M], spread: [[0.0; M]; M] };
        for i in 0..M {
            for j in 0..M {
                link.share[i][j] = self.share[i][j][at];
                link.kept[i][j] = self.kept[i][j][at];
                link.spread[i][j] = self.spread[i.max(j)][i.min(j)][at];
            }
        }
        link
    }
}

struct Made<'a, const M: usize> {
    links: &'a mut Links<M>,
    chain: &'a Chain<M>,
    blocks: &'a [Belief<M, [f64; BESIDE]>],
    steps: &'a [f64; PIECE],
}

impl<const M: usize> WithSimd for Made<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Made { links, chain, blocks, steps } = self;
        let chain = chain.with(Abreast(Lanes::load(simd, &[chain.density])));
        let one = Abreast(Lanes::load(simd, &[1.0]));
        for (at, block) in blocks.iter().enumerate() {
            for part in (0..BESIDE).step_by(S::F64_LANES) {
                let mut belief = Belief { mean: [one; M], factor: [[one; M]; M] };
                for i in 0..M {
                    for j in 0..=i {
                        belief.factor[i][j] = Abreast(Lanes::read(simd, &block.factor[i][j], part));
                    }
                }
                let from = at * BESIDE + part;
                let link = Link::new(&belief, &chain.step(Lanes::read(simd, steps, from)));
                for i in 0..M {
                    for j in 0..M {
                        link.share[i][j].0.write(&mut links.share[i][j], from);
                        link.kept[i][j].0.write(&mut links.kept[i][j], from);
                        if j <= i {
                            link.spread[i][j].0.write(&mut links.spread[i][j], from);
                        }
                    }
                }
            }
        }
    }
}

impl<const M: usize> Link<M> {
    /// The state of a row, of which the filter expects `expected` (F mean) of the next.
    #[inline(always)]
    pub(super) fn smoothed(&self, expected: &[f64; M], step: &Step<M>, next: &Posterior<M>) -> Posterior<M> {
        let mut end = next.mean;
        for i in 0..M {
            for k in 0..M {
                end[i] -= self.share[i][k] * (next.mean[k] - expected[k]);
            }
        }
        Posterior { mean: step.backward(&end), covariance: sandwich(&self.kept, &next.covariance, &self.spread) }
    }
}

/// K P K' + C, symmetric to the last bit.
#[inline(always)]
pub(super) fn sandwich<const M: usize>(k: &Matrix<M>, p: &Matrix<M>, c: &Matrix<M>) -> Matrix<M> {
    let mut half = [[0.0; M]; M];
    for i in 0..M {
        for l in 0..M {
            for j in 0..M {
                half[i][j] += k[i][l] * p[l][j];
            }
        }
    }
    let mut sum = *c;
    for i in 0..M {
        for j in 0..=i {
            for l in 0..M {
                sum[i][j] += half[i][l] * k[j][l];
            }
            sum[j][i] = sum[i][j];
        }
    }
    sum
}

/// A A'.
pub(super) fn squared<const M: usize>(a: &Matrix<M>) -> Matrix<M> {
    let rows = transposed(a);
    std::array::from_fn(|i| std::array::from_fn(|j| rows.iter().map(|column| column[i] * column[j]).sum()))
}
