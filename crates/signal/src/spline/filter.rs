//! The Kalman filter and the smoother of a chain, on covariances as products of triangles.
//!
//! A covariance is P = L D L' with L lower triangular, of ones on its diagonal, and D diagonal. A measurement of the first state scales the first entry of D and nothing else; a step orthogonalises the rows of [F L, N] under the weights
//! [D, q dt] (modified weighted Gram and Schmidt: Thornton and Bierman, "Gram-Schmidt algorithms for covariance propagation", International Journal of Control 25, 1977). Neither subtracts, so that D stays positive and the
//! smallest directions keep their digits, as in a filter on square roots; of these none is needed. Of two states all of it is a closed form, whose every term is positive.

use pulp::{Simd, WithSimd};

use super::{
    chain::{Chain, Matrix, Step, transposed},
    number::{Abreast, Lanes, Number},
};

/// What is known of the state from the measurements up to a row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Belief<const M: usize, T = f64> {
    /// Mean.
    pub(crate) mean: [T; M],
    /// D on the diagonal, L below.
    pub(crate) factor: Matrix<M, T>,
}

/// What is known of the state from all measurements.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Posterior<const M: usize> {
    /// Mean.
    pub(crate) mean: [f64; M],
    /// P.
    pub(crate) covariance: Matrix<M>,
}

/// A measurement beside what was expected of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Innovation<T = f64> {
    /// Measured less expected.
    pub(crate) error: T,
    /// Its variance.
    pub(crate) variance: T,
    /// One over its variance.
    pub(crate) weight: T,
}

impl<T: Number> Innovation<T> {
    #[inline(always)]
    fn new(error: T, variance: T) -> Self {
        Self { error, variance, weight: variance.inverse() }
    }

    /// e^2 / v.
    #[inline(always)]
    pub(crate) fn square(self) -> T {
        self.error * self.error * self.weight
    }
}

/// A row of the array [A, N] that a step orthogonalises.
#[derive(Debug, Clone, Copy)]
struct Row<const M: usize, T> {
    own: [T; M],
    noise: [T; M],
}

/// How the columns of the array count: D, and q dt.
#[derive(Debug, Clone, Copy)]
struct Weights<const M: usize, T> {
    own: [T; M],
    noise: T,
}

impl<const M: usize, T: Number> Row<M, T> {
    /// The row times the weights, of the first so many columns of noise.
    #[inline(always)]
    fn weighted(&self, weights: &Weights<M, T>, noises: usize) -> Self {
        let mut weighted = *self;
        for j in 0..M {
            weighted.own[j] = weighted.own[j] * weights.own[j];
        }
        for j in 0..noises {
            weighted.noise[j] = weighted.noise[j] * weights.noise;
        }
        weighted
    }

    #[inline(always)]
    fn dot(&self, other: &Self, noises: usize) -> T {
        let (mut sum, mut noise) = (self.own[0] * other.own[0], self.noise[0] * other.noise[0]);
        for j in 1..M {
            sum = self.own[j].fused(other.own[j], sum);
        }
        for j in 1..noises {
            noise = self.noise[j].fused(other.noise[j], noise);
        }
        sum + noise
    }

    #[inline(always)]
    fn subtract(&mut self, share: T, other: &Self, noises: usize) {
        for j in 0..M {
            self.own[j] = self.own[j] - share * other.own[j];
        }
        for j in 0..noises {
            self.noise[j] = self.noise[j] - share * other.noise[j];
        }
    }
}

/// Makes the rows of `head` orthogonal, each to those before it, N of which is lower triangular on entry. D on the diagonal and L below it; the rows `carried` are made orthogonal to all of them, and have their shares in them handed back.
#[inline(always)]
fn orthogonalise<const M: usize, const N: usize, T: Number>(
    head: &mut [Row<M, T>; M],
    carried: &mut [Row<M, T>; N],
    weights: &Weights<M, T>,
) -> (Matrix<M, T>, [[T; M]; N]) {
    let zero = weights.noise.like(0.0);
    let (mut factor, mut shares) = ([[zero; M]; M], [[zero; M]; N]);
    for i in 0..M {
        let (v, noises) = (head[i], i + 1);
        let weighted = v.weighted(weights, noises);
        let square = v.dot(&weighted, noises);
        let inverse = square.inverse();
        factor[i][i] = square;
        for j in i + 1..M {
            let share = head[j].dot(&weighted, noises) * inverse;
            head[j].subtract(share, &v, noises);
            factor[j][i] = share;
        }
        for j in 0..N {
            let share = carried[j].dot(&weighted, noises) * inverse;
            carried[j].subtract(share, &v, noises);
            shares[j][i] = share;
        }
    }
    (factor, shares)
}

/// The diagonal D, and L.
#[inline(always)]
fn parted<const M: usize, T: Number>(factor: &Matrix<M, T>) -> ([T; M], Matrix<M, T>) {
    let (mut diagonal, mut lower) = (factor[0], *factor);
    for i in 0..M {
        diagonal[i] = factor[i][i];
        for j in i..M {
            lower[i][j] = diagonal[i].like(if i == j { 1.0 } else { 0.0 });
        }
    }
    (diagonal, lower)
}

/// The covariance of a chain of two over a step, to which what there was adds `a` and `det_a` of its own determinant.
struct Two<T> {
    /// F P F'.
    a: Matrix<2, T>,
    /// Its determinant, and that of F P F' + Q.
    determinants: [T; 2],
    /// F L's first column.
    first: [T; 2],
    /// First column of F P F' + Q.
    column: [T; 2],
}

impl<T: Number> Two<T> {
    /// Determinants are sums of the squares of all minors under their weights (Cauchy and Binet): no term is negative.
    #[inline(always)]
    fn new([a, l, d]: [T; 3], h: T::Shared, q: T) -> Self {
        let square = h * h;
        let u = l.by(h);
        let p = u.plus(1.0);
        let (ap, al) = (a * p, a * l);
        let first = ap.fused(p, d.by(square));
        let crossed = ap.fused(l, d.by(h));
        let middle = u.times(0.5).plus(1.0);
        let turned = middle.fused(middle, (u * u).times(1.0 / 12.0));
        let grown = q.fused_by(square.times(1.0 / 12.0), a.fused(turned, d.by(square.times(1.0 / 3.0))));
        let own = a * d;
        let whole = q.fused(grown, own);
        Self {
            a: [[first, crossed], [crossed, al.fused(l, d)]],
            determinants: [own, whole],
            first: [p, l],
            column: [q.fused_by(square.times(1.0 / 3.0), first), q.fused_by(h.times(0.5), crossed)],
        }
    }
}

impl<const M: usize> Belief<M> {
    /// A belief with this mean, and any square root of its covariance.
    pub(crate) fn new(mean: [f64; M], square_root: Matrix<M>) -> Self {
        Self::stepped(mean, &square_root, &[1.0; M], &[[0.0; M]; M], 0.0)
    }

    /// With this mean and the covariance A D A' + v N N', N lower triangular.
    #[inline]
    pub(crate) fn stepped(mean: [f64; M], a: &Matrix<M>, d: &[f64; M], noise: &Matrix<M>, variance: f64) -> Self {
        let mut head: [Row<M, f64>; M] = std::array::from_fn(|i| Row { own: a[i], noise: noise[i] });
        Self { mean, factor: orthogonalise(&mut head, &mut [], &Weights { own: *d, noise: variance }).0 }
    }

    /// D, and L.
    pub(crate) fn parted(&self) -> ([f64; M], Matrix<M>) {
        parted(&self.factor)
    }

    /// How D and L grow with a covariance: of X = L^-1 P' L^-T, P' its slope, D has the diagonal, and L^-1 L' is what lies below over D.
    pub(super) fn grown(&self, slope: &Matrix<M>) -> Matrix<M> {
        let (d, lower) = self.parted();
        let solved = |mut rows: Matrix<M>| {
            for i in 0..M {
                for j in 0..i {
                    for k in 0..M {
                        rows[i][k] -= lower[i][j] * rows[j][k];
                    }
                }
            }
            rows
        };
        let x = solved(transposed(&solved(*slope)));
        let mut grown = [[0.0; M]; M];
        for i in 0..M {
            grown[i][i] = x[i][i];
            for j in 0..i {
                grown[i][j] = (j + 1..=i).map(|k| lower[i][k] * x[k][j] / d[j]).sum();
            }
        }
        grown
    }

    /// Learns of a measurement of `slopes` times the state with an error of this variance (Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, chapter V, from the last state to the first).
    pub(crate) fn measure_along(&mut self, slopes: &[f64; M], value: f64, variance: f64) -> Innovation {
        let expected: f64 = slopes.iter().zip(&self.mean).map(|(slope, state)| slope * state).sum();
        let (d, lower) = self.parted();
        let (mut known, mut gain) = (variance, [0.0; M]);
        for j in (0..M).rev() {
            let seen: f64 = (j..M).map(|i| slopes[i] * lower[i][j]).sum();
            let moved = d[j] * seen;
            let next = known + moved * seen;
            self.factor[j][j] = d[j] * (known / next);
            for i in j + 1..M {
                self.factor[i][j] = lower[i][j] - gain[i] * (seen / known);
                gain[i] += lower[i][j] * moved;
            }
            gain[j] = moved;
            known = next;
        }
        let innovation = Innovation::new(value - expected, known);
        for i in 0..M {
            self.mean[i] += gain[i] * innovation.weight * innovation.error;
        }
        innovation
    }

    /// At the last row nothing more will be known.
    pub(super) fn posterior(&self) -> Posterior<M> {
        let (d, lower) = self.parted();
        let entry = |i: usize, j: usize| (0..M).map(|k| lower[i][k] * d[k] * lower[j][k]).sum();
        let mut covariance = [[0.0; M]; M];
        for i in 0..M {
            for j in 0..=i {
                covariance[i][j] = entry(i, j);
                covariance[j][i] = covariance[i][j];
            }
        }
        Posterior { mean: self.mean, covariance }
    }
}

impl<const M: usize, T: Number> Belief<M, T> {
    /// After a step.
    #[inline(always)]
    pub(super) fn predicted(&self, step: &Step<M, T>) -> Self {
        let mean = step.forward(&self.mean);
        let mut factor = self.factor;
        if M == 2 {
            let h = step.powers[1];
            let Two { determinants, column, .. } =
                Two::new([factor[0][0], factor[1][0], factor[1][1]], h, step.variance);
            let inverse = column[0].inverse();
            factor[0][0] = column[0];
            factor[1][0] = column[1] * inverse;
            factor[1][1] = determinants[1] * inverse;
        } else {
            let (weights, mut head) = self.array(step);
            factor = orthogonalise(&mut head, &mut [], &weights).0;
        }
        Self { mean, factor }
    }

    /// [F L, N] and its weights.
    #[inline(always)]
    fn array(&self, step: &Step<M, T>) -> (Weights<M, T>, [Row<M, T>; M]) {
        let (own, lower) = parted(&self.factor);
        let moved = step.forward_matrix(&lower);
        let mut head = [Row { own, noise: own }; M];
        for i in 0..M {
            head[i].own = moved[i];
            for j in 0..M {
                head[i].noise[j] = step.variance.of(step.noise[i][j]);
            }
        }
        (Weights { own, noise: step.variance }, head)
    }

    /// Learns of a measurement of the first state with an error of this variance.
    #[inline(always)]
    pub(crate) fn measure(&mut self, value: f64, variance: T) -> Innovation<T> {
        let first = self.factor[0][0];
        let innovation = Innovation::new(first.like(value) - self.mean[0], first + variance);
        let share = first * innovation.weight;
        let moved = share * innovation.error;
        self.mean[0] = self.mean[0] + moved;
        for i in 1..M {
            self.mean[i] = self.factor[i][0].fused(moved, self.mean[i]);
        }
        self.factor[0][0] = share * variance;
        innovation
    }
}

/// How the state of a row follows from that of the next.
///
/// The state is F^-1 (s - w), s the next state and w what the noise added. Given s, w has the mean J (s - F mean) with J = Q (F P F' + Q)^-1 and a covariance C, neither of which is a difference of covariances.
/// Under a strong penalty w is nearly nothing and its share of s keeps its digits, which the textbook's gain P F' (F P F' + Q)^-1 would not.
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
        let Two { a, determinants: [own, whole], first: [p, l], .. } = Two::new([f[0][0], f[1][0], f[1][1]], h, q);
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
        let (mut spread, part) = (share, own * scaled);
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
            row.own = [step.variance.like(0.0); M];
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
        pulp::Arch::new().dispatch(Made { links: self, chain, blocks, steps });
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
