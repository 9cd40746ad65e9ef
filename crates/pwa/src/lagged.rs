//! Correlation of residuals from row to row: their autocovariances, whitened by region, over the rows in their order.

use std::collections::{BTreeMap, VecDeque};

use faer::{Mat, Side, linalg::solvers::Solve};
use fleetfoot_data::packed;
use fleetfoot_model::{Equation, Prediction, ResidualCorrelation};
use fleetfoot_stats::{
    Autoregression, Gram, Preconditioner,
    kernel::{LANES, padded},
};
use pulp::NullaryFnOnce;

/// Residuals that a filter carries at most: rows of them times targets. On a hexapod at 1 kHz (13 targets) the first row gains 0.89 nats a row, the second 0.02, the third and fourth 0.004 together.
const MOST_CARRIED: usize = 40;
/// Limits of the lags of an autoregression: at least, of many targets, and at most, of few.
const LAGS: [usize; 2] = [2, 8];

/// Share of a target's variance that counts as rounding: differences of neighbouring values have lost some seven digits
/// of sixteen.
const ROUNDED: f64 = 1e-18;

/// The longest autoregression of so many targets.
fn most_lags(targets: usize) -> usize {
    (MOST_CARRIED / targets.max(1)).clamp(LAGS[0], LAGS[1])
}

/// Rows that derivatives may be measured over: two are those of a central difference. Over more rows, neighbouring
/// residuals are correlated because they share rows.
const MOST_SPAN: usize = 2;

/// Rows over which the fitted equations' targets are measured, the most of them; `None` of targets whose residuals say nothing of a step's noise.
pub(crate) fn span<'e>(fitted: impl Iterator<Item = &'e Equation>) -> Option<usize> {
    let rows = |equation: &Equation| {
        let (before, after) = equation.target.as_ref().map_or((0, 0), |target| target.reach());
        let is_advanced =
            matches!(equation.prediction, Prediction::Derivative | Prediction::Next | Prediction::Difference);
        let rows = equation.span().unwrap_or((before + after).max(1)) as usize;
        (is_advanced && rows <= MOST_SPAN).then_some(rows)
    };
    fitted.map(rows).try_fold(1, |most, rows| Some(most.max(rows?)))
}

/// Whitening of the residuals of each region: the inverse of the lower Cholesky factor of their covariance, column by
/// column of padded length. `None` if they are no more than rounding.
pub(crate) struct Whitening {
    regions: Vec<Option<Vec<f64>>>,
}

impl Whitening {
    /// Whitening by the residuals of least squares in every region, of `count` regions; `variances` are those of the
    /// targets.
    pub(crate) fn new(
        grams: &BTreeMap<u32, Gram>,
        count: usize,
        preconditioner: &Preconditioner,
        variances: &[f64],
    ) -> Self {
        let targets = preconditioner.targets();
        let of = |region: u32| {
            let left = preconditioner.leftover(grams.get(&region)?);
            let covariance = left.covariance(preconditioner)?;
            if (0..targets).any(|t| covariance[packed(t, t)] <= ROUNDED * variances[t]) {
                return None;
            }
            let factor = Mat::from_fn(targets, targets, |i, j| covariance[packed(i.max(j), i.min(j))]);
            let lower = factor.llt(Side::Lower).ok()?.L().to_owned();
            let inverse = lower.partial_piv_lu().solve(Mat::<f64>::identity(targets, targets));
            let width = padded(targets);
            let mut columns = vec![0.0; targets * width];
            for j in 0..targets {
                (j..targets).for_each(|i| columns[j * width + i] = inverse[(i, j)]);
            }
            columns.iter().all(|value| value.is_finite()).then_some(columns)
        };
        Self { regions: (0..count as u32).map(of).collect() }
    }
}

/// Sums of products of whitened residuals, some rows apart. Parts of an episode are merged in their order, by their
/// first and last rows.
#[derive(Debug, Clone)]
pub(crate) struct Lagged {
    targets: usize,
    weight: f64,
    /// Of lag 0 to the most: `sum rho_k rho_(k-h)'`, rows of padded length, target of the row behind by that of the row before.
    products: Vec<Vec<f64>>,
    episode: usize,
    /// Rows without a gap from the first one on, as many as there are lags at most; and whether they are all that there are.
    head: Vec<Row>,
    whole: bool,
    /// The last rows, without a gap.
    tail: VecDeque<Row>,
}

/// A row and its whitened residuals, padded.
#[derive(Debug, Clone)]
struct Row {
    at: usize,
    values: Vec<f64>,
}

impl Lagged {
    pub(crate) fn new(targets: usize) -> Self {
        let products = vec![vec![0.0; targets * padded(targets)]; most_lags(targets) + 1];
        let (head, tail) = (Vec::new(), VecDeque::new());
        Self { targets, weight: 0.0, products, episode: 0, head, whole: true, tail }
    }

    fn lags(&self) -> usize {
        self.products.len() - 1
    }

    /// Appends rows of an episode: row numbers, ascending, their regions, residuals (padded) and weights.
    pub(crate) fn extend(
        &mut self,
        whitening: &Whitening,
        episode: usize,
        rows: impl Iterator<Item = usize>,
        (regions, residuals, weights): (&[u32], &[f64], Option<&[f64]>),
    ) {
        self.episode = episode;
        let (mut places, mut white) = (Vec::with_capacity(regions.len()), Vec::with_capacity(residuals.len()));
        fleetfoot_data::arch().dispatch(Whiten {
            whitening,
            width: padded(self.targets),
            rows,
            given: (regions, residuals, weights),
            places: &mut places,
            white: &mut white,
        });
        let mut rest = white.as_slice();
        for run in places.chunk_by(|before, at| before + 1 == *at) {
            let residual;
            (residual, rest) = rest.split_at(run.len() * padded(self.targets));
            self.follow(run, residual);
        }
    }

    /// Appends whitened rows without a gap.
    fn follow(&mut self, places: &[usize], residual: &[f64]) {
        let (width, lags) = (padded(self.targets), self.lags());
        if self.tail.back().is_some_and(|last| last.at + 1 != places[0]) {
            self.tail.clear();
            self.whole = false;
        }
        let carried = self.tail.len();
        let mut rows = Vec::with_capacity((carried + places.len()) * width);
        self.tail.iter().for_each(|row| rows.extend_from_slice(&row.values));
        rows.extend_from_slice(residual);
        let (targets, products) = (self.targets, &mut self.products);
        fleetfoot_data::arch().dispatch(Products { rows: &rows, width, targets, carried, products });
        for row in residual.chunks_exact(width) {
            self.weight += row.iter().map(|value| value * value).sum::<f64>();
        }
        let row = |(&at, values): (&usize, &[f64])| Row { at, values: values.to_vec() };
        if self.whole {
            let open = lags - self.head.len();
            self.head.extend(places.iter().zip(residual.chunks_exact(width)).take(open).map(row));
        }
        let late = places.len().saturating_sub(lags);
        for row in places[late..].iter().zip(residual[late * width..].chunks_exact(width)).map(row) {
            self.keep(row);
        }
    }

    fn keep(&mut self, row: Row) {
        if self.tail.len() == self.lags() {
            self.tail.pop_front();
        }
        self.tail.push_back(row);
    }

    fn pair(&mut self, lag: usize, row: &Row, before: &[f64]) {
        fleetfoot_data::arch().dispatch(Outer { products: &mut self.products[lag], row: &row.values, before });
    }

    /// Adds the rows that follow.
    pub(crate) fn merge(&mut self, next: &Self) {
        self.weight += next.weight;
        for (all, product) in self.products.iter_mut().zip(&next.products) {
            all.iter_mut().zip(product).for_each(|(all, sum)| *all += sum);
        }
        let Some(first) = next.head.first() else { return };
        let goes_on = self.episode == next.episode && self.tail.back().is_some_and(|last| last.at + 1 == first.at);
        if !goes_on {
            self.tail.clear();
            self.whole = self.head.is_empty();
        }
        // Pairs over the seam: products within what follows are known.
        let before = self.tail.clone();
        for (place, row) in next.head.iter().enumerate() {
            for lag in place + 1..=self.lags() {
                let Some(at) = (before.len() + place).checked_sub(lag) else { break };
                self.pair(lag, row, &before[at].values);
            }
            if self.whole && self.head.len() < self.lags() {
                self.head.push(row.clone());
            }
        }
        if !next.whole {
            self.tail.clear();
        }
        self.whole &= next.whole;
        next.tail.iter().for_each(|row| self.keep(row.clone()));
        self.episode = next.episode;
    }

    /// Correlation of the residuals of targets that are measured over `span` rows: the order of least BIC. `None`
    /// unless they are correlated over more rows than they share.
    pub(crate) fn correlation(&self, span: usize) -> Option<ResidualCorrelation> {
        let (q, width) = (self.targets, padded(self.targets));
        let rows = self.weight / q as f64;
        if rows <= (self.lags() * q + 1) as f64 {
            return None;
        }
        let raw = |lag: usize| Mat::from_fn(q, q, |a, b| self.products[lag][a * width + b] / rows);
        let root = raw(0).llt(Side::Lower).ok()?.L().to_owned().partial_piv_lu();
        let inverse = root.solve(Mat::<f64>::identity(q, q));
        let scaled = |lag: usize| -> Vec<f64> {
            let correlation = &inverse * raw(lag) * inverse.transpose();
            (0..q * q).map(|at| correlation[(at / q, at % q)]).collect()
        };
        let lags: Vec<Vec<f64>> = (1..=self.lags()).map(scaled).collect();
        let all = ResidualCorrelation { lags };
        // Squares of q^2 correlations that are 0 are 1/n each, somewhat more where neighbours share rows: twice the price of the BIC is beyond either.
        let free = |lag: usize| (q as f64 * all.size(lag).powi(2)) - 2.0 * (q * q) as f64 * rows.ln() / rows;
        let mut all_free = 0.0;
        let beyond = (span..=self.lags()).any(|lag| {
            all_free += free(lag);
            all_free > 0.0
        });
        if !beyond {
            return None;
        }
        let order = Autoregression::of_least_bic(&all.autocovariances(), q, rows)?.order();
        (order > 0).then(|| ResidualCorrelation { lags: all.lags[..order].to_vec() })
    }
}

/// `root L^-1 residual` of every row whose region has a factor, and the places of these rows.
struct Whiten<'a, I> {
    whitening: &'a Whitening,
    width: usize,
    rows: I,
    given: (&'a [u32], &'a [f64], Option<&'a [f64]>),
    places: &'a mut Vec<usize>,
    white: &'a mut Vec<f64>,
}

impl<I: Iterator<Item = usize>> NullaryFnOnce for Whiten<'_, I> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (regions, residuals, weights) = self.given;
        let last = self.whitening.regions.len().saturating_sub(1);
        for (row, (at, &region)) in self.rows.zip(regions).enumerate() {
            let Some(columns) = &self.whitening.regions[(region as usize).min(last)] else { continue };
            // Weights are shared by the rows of a product, so that the sums stay those of a series.
            let root = weights.map_or(1.0, |weights| weights[row].sqrt());
            let from = self.white.len();
            self.white.resize(from + self.width, 0.0);
            let (out, residual) = (&mut self.white[from..], &residuals[row * self.width..][..self.width]);
            for (column, &value) in columns.chunks_exact(self.width).zip(residual) {
                add_scaled(out, column, root * value);
            }
            self.places.push(at);
        }
    }
}

/// `products_h += sum rho_k rho_(k-h)'` over rows of padded length, of which the first were carried and paired before. Each sum is a chain over the rows in their order, however they are cut.
struct Products<'a> {
    rows: &'a [f64],
    width: usize,
    targets: usize,
    carried: usize,
    products: &'a mut [Vec<f64>],
}

/// Targets whose sums are made side by side.
const ABREAST: usize = 4;

impl NullaryFnOnce for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (count, width) = (self.rows.len() / self.width, self.width);
        for (lag, products) in self.products.iter_mut().enumerate() {
            let from = self.carried.max(lag);
            if from >= count {
                continue;
            }
            let (now, before) = (&self.rows[from * width..], &self.rows[(from - lag) * width..]);
            for lane in (0..width).step_by(LANES) {
                let mut target = 0;
                while target + ABREAST <= self.targets {
                    sums::<ABREAST>(products, (now, before), (width, target, lane));
                    target += ABREAST;
                }
                while target < self.targets {
                    sums::<1>(products, (now, before), (width, target, lane));
                    target += 1;
                }
            }
        }
    }
}

/// The sums of `G` targets with a vector of those before.
#[inline(always)]
fn sums<const G: usize>(
    products: &mut [f64],
    (now, before): (&[f64], &[f64]),
    (width, target, lane): (usize, usize, usize),
) {
    let mut sums = [[0.0; LANES]; G];
    for g in 0..G {
        sums[g].copy_from_slice(&products[(target + g) * width + lane..][..LANES]);
    }
    for (now, before) in now.chunks_exact(width).zip(before.chunks_exact(width)) {
        let (now, before) = (&now[target..target + G], &before[lane..lane + LANES]);
        for g in 0..G {
            for i in 0..LANES {
                sums[g][i] = now[g].mul_add(before[i], sums[g][i]);
            }
        }
    }
    for g in 0..G {
        products[(target + g) * width + lane..][..LANES].copy_from_slice(&sums[g]);
    }
}

/// `products += row before'`.
struct Outer<'a> {
    products: &'a mut [f64],
    row: &'a [f64],
    before: &'a [f64],
}

impl NullaryFnOnce for Outer<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (sums, &value) in self.products.chunks_exact_mut(self.before.len()).zip(self.row) {
            add_scaled(sums, self.before, value);
        }
    }
}

#[inline(always)]
fn add_scaled(sums: &mut [f64], values: &[f64], factor: f64) {
    for lane in (0..sums.len()).step_by(LANES) {
        let (sums, values) = (&mut sums[lane..lane + LANES], &values[lane..lane + LANES]);
        for i in 0..LANES {
            sums[i] = factor.mul_add(values[i], sums[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn whitening(targets: usize) -> Whitening {
        let width = padded(targets);
        let covariances = |region: usize| {
            let mut columns = vec![0.0; targets * width];
            for j in 0..targets {
                (j..targets).for_each(|i| columns[j * width + i] = 1.0 / (1.0 + (region + i + j) as f64));
            }
            // The last region has residuals that are rounding.
            (region < 2).then_some(columns)
        };
        Whitening { regions: (0..3).map(covariances).collect() }
    }

    proptest! {
        #[test]
        fn parts_sum_as_the_whole(
            rows in prop::collection::vec((0u32..3, -1.0..1.0f64, -1.0..1.0f64, prop::bool::weighted(0.1)), 1..40), cuts in prop::collection::vec(0usize..40, 0..12)
        ) {
            let (q, width) = (2, padded(2));
            let whitening = whitening(q);
            let mut at = 0;
            let places: Vec<usize> = rows.iter().map(|row| { at += 1 + usize::from(row.3); at }).collect();
            let regions: Vec<u32> = rows.iter().map(|row| row.0).collect();
            let mut residuals = vec![0.0; rows.len() * width];
            rows.iter().zip(residuals.chunks_exact_mut(width)).for_each(|(row, residual)| (residual[0], residual[1]) = (row.1, row.2));
            let of = |from: usize, to: usize| {
                let mut lagged = Lagged::new(q);
                let part = (&regions[from..to], &residuals[from * width..to * width], None);
                lagged.extend(&whitening, 4, places[from..to].iter().copied(), part);
                lagged
            };
            let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(rows.len())).collect();
            cuts.extend([0, rows.len()]);
            cuts.sort_unstable();
            let mut total = Lagged::new(q);
            cuts.windows(2).for_each(|cut| total.merge(&of(cut[0], cut[1])));
            // By the definition, over all pairs of rows.
            let white: Vec<Option<[f64; 2]>> = rows.iter().map(|row| {
                let columns = whitening.regions[row.0 as usize].as_ref()?;
                Some([columns[0] * row.1, columns[1] * row.1 + columns[width + 1] * row.2])
            }).collect();
            for lag in 0..=most_lags(q) {
                for (a, b) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let mut sum = 0.0;
                    for (k, now) in places.iter().enumerate().filter_map(|(k, place)| Some((*place, white[k]?))) {
                        // All rows between are there.
                        let chain = (0..=lag).map(|h| {
                            let there = places.iter().position(|place| h <= k && *place == k - h)?;
                            white[there]
                        }).collect::<Option<Vec<_>>>();
                        if let Some(chain) = chain { sum += now[a] * chain[lag][b]; }
                    }
                    prop_assert!((total.products[lag][a * width + b] - sum).abs() < 1e-12, "{lag} {a} {b}: {} {sum}", total.products[lag][a * width + b]);
                }
            }
            // Another episode begins anew.
            let mut other = of(0, rows.len());
            other.episode = 5;
            let within = other.products.clone();
            let before = total.products.clone();
            total.merge(&other);
            for (all, (a, b)) in total.products.iter().zip(before.iter().zip(&within)) {
                prop_assert!(all.iter().zip(a.iter().zip(b)).all(|(all, (a, b))| (all - a - b).abs() < 1e-12));
            }
        }
    }

    /// Residuals of an autoregression of two targets are recognised as one; independent residuals are not, and neither
    /// is a series that is averaged over two rows.
    #[test]
    fn significant_residual_correlation_is_reported() {
        let uniform = |key: u64| fleetfoot_data::mix(key + 1) as f64 / u64::MAX as f64 - 0.5;
        let width = padded(2);
        /// The residuals of a row, from its number, those before and separate noise.
        type Series<'s> = &'s dyn Fn(usize, &[[f64; 2]], [f64; 2]) -> [f64; 2];
        let correlated = |series: Series<'_>, span: usize| {
            let mut rows: Vec<[f64; 2]> = Vec::new();
            for k in 0..20_000 {
                let next = series(k, &rows, [uniform(2 * k as u64), uniform(2 * k as u64 + 1)]);
                rows.push(next);
            }
            let mut residuals = vec![0.0; rows.len() * width];
            rows.iter()
                .zip(residuals.chunks_exact_mut(width))
                .for_each(|(row, residual)| residual[..2].copy_from_slice(row));
            let mut lagged = Lagged::new(2);
            let regions = vec![0; rows.len()];
            lagged.extend(&whitening(2), 0, 0..rows.len(), (&regions, &residuals, None));
            lagged.correlation(span)
        };
        assert_eq!(correlated(&|_, _, noise| noise, 1), None);
        let before = |rows: &[[f64; 2]], lag: usize| rows.len().checked_sub(lag).map_or([0.0; 2], |at| rows[at]);
        let first = |_: usize, rows: &[[f64; 2]], noise: [f64; 2]| {
            let values = before(rows, 1);
            [0.7 * values[0] + noise[0], 0.3 * values[0] + noise[1]]
        };
        let correlation = correlated(&first, 1).expect("correlated");
        assert_eq!((correlation.lags.len(), correlation.targets()), (1, 2));
        let second = |_: usize, rows: &[[f64; 2]], noise: [f64; 2]| {
            let (values, past) = (before(rows, 1), before(rows, 2));
            [1.1 * values[0] - 0.5 * past[0] + noise[0], noise[1]]
        };
        assert_eq!(correlated(&second, 2).expect("correlated").lags.len(), 2);
        let mean = |k: usize, _: &[[f64; 2]], noise: [f64; 2]| {
            let last = [uniform(2 * k.saturating_sub(1) as u64), uniform(2 * k.saturating_sub(1) as u64 + 1)];
            [noise[0] + last[0], noise[1] + last[1]]
        };
        assert!(correlated(&mean, 1).is_some() && correlated(&mean, 2).is_none());
    }
}
