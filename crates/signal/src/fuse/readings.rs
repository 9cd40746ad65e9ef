//! Noise of the readings, estimated from the readings alone.
//!
//! Each window of a record is modelled as the sum of three parts. The first is a polynomial. The second is a motion:
//! white noise of an individual density, integrated [`SMOOTH`] times. The third is white noise of one variance, which
//! all windows share.
//!
//! Differences of order [`ORDER`] remove the polynomial. A generalised eigenproblem gives coordinates in which the
//! covariances of motion and noise are both diagonal. In them a window is [`LEFT`] independent numbers of variances q
//! lambda_i + sigma^2. The distribution of q over the windows is free (Laird, "Nonparametric maximum likelihood
//! estimation of a mixing distribution", Journal of the American Statistical Association 73, 1978). Its weights on a
//! grid follow by expectation and maximisation, the variance by scoring under the same expectations. Windows at rest
//! determine the variance; those of an impact hardly count.
//!
//! Noise that is not white, and a motion that is never smoother, look alike. In quiet windows all coordinates must be
//! as large as their variances imply, and no window much larger than another. Otherwise no noise is estimated: the
//! sensor may filter, or the body may be hit all the time.

use std::sync::LazyLock;

use nalgebra::{SMatrix, SVector, SymmetricEigen};

use super::{ImuRecord, Prior};

/// Readings of a window.
const WINDOW: usize = 16;

/// The order of the differences: no polynomial below that degree is left in a window.
const ORDER: usize = 6;

/// Number of integrations from white noise to a window's motion.
const SMOOTH: usize = 4;

/// Numbers of a window that no polynomial makes.
const LEFT: usize = WINDOW - ORDER;

/// Windows, at most, evenly over all records.
const MOST: usize = 4096;

/// Windows without motion from which on noise is told: the mean square of a coordinate is known to a fifth then.
const FEWEST: f64 = 50.0;

/// By how much the mean square of a coordinate in quiet windows may be off what its variance says, either way.
const EVEN: f64 = 1.5;

/// Largest ratio of the variance of quiet windows' mean squares to that of white noise.
const ALIKE: f64 = 2.0;

/// Mean steps that are a gap.
const GAP: f64 = 1.5;

/// Rounds of expectation and maximisation, at most, and the change of a variance that is none any more.
const ROUNDS: usize = 200;
const SAME: f64 = 1e-5;

/// The share by which an estimate may be off as motions are others than those that windows are taken for, a deviation beside that of chance: ringing after blows makes some 4 %, the trunk of a running robot 3 %.
const MISTAKEN: f64 = 0.05;

/// The ratio of neighbouring densities of motion on the grid.
const FINE: f64 = 4.0;

type Numbers = SVector<f64, LEFT>;

/// The coordinates of a window: what is made of its differences, and the variances that motion of density one has there.
struct Coordinates {
    of_differences: SMatrix<f64, LEFT, LEFT>,
    motion: Numbers,
}

/// The covariances of white noise and of motion in the differences are those of differences of white noise, of order [`ORDER`] and [`ORDER`] less [`SMOOTH`].
static COORDINATES: LazyLock<Option<Coordinates>> = LazyLock::new(|| {
    let root = differences(ORDER).cholesky()?.l();
    let back = root.try_inverse()?;
    let SymmetricEigen { eigenvectors, eigenvalues } =
        SymmetricEigen::new(back * differences(ORDER - SMOOTH) * back.transpose());
    Some(Coordinates { of_differences: eigenvectors.transpose() * back, motion: eigenvalues })
});

/// The covariance of neighbouring differences of white noise: binomials of twice the order, with changing signs.
fn differences(order: usize) -> SMatrix<f64, LEFT, LEFT> {
    SMatrix::from_fn(|i, j| {
        let apart = i.abs_diff(j);
        if apart > order { 0.0 } else { sign(apart) * binomial(2 * order, order + apart) }
    })
}

fn sign(at: usize) -> f64 {
    if at.is_multiple_of(2) { 1.0 } else { -1.0 }
}

fn binomial(n: usize, k: usize) -> f64 {
    (0..k).fold(1.0, |product, i| product * (n - i) as f64 / (i + 1) as f64).round()
}

/// The deviation of the white noise of single readings of rate (0) or force (1) along an axis, and that of its estimate, chance and what windows are mistaken for together; `None` where these readings do not tell it.
pub(super) fn noise(records: &[ImuRecord<'_>], which: usize, axis: usize) -> Option<Prior<f64>> {
    let coordinates = COORDINATES.as_ref()?;
    Mixture::new(squares(records, which, axis, coordinates), coordinates)?.solved()
}

/// The squares of the coordinates of windows without gaps.
fn squares(records: &[ImuRecord<'_>], which: usize, axis: usize, coordinates: &Coordinates) -> Vec<Numbers> {
    let all: usize = records.iter().map(|record| record.times.len() / WINDOW).sum();
    let stride = all.div_ceil(MOST).max(1);
    let weights: [f64; ORDER + 1] = std::array::from_fn(|i| sign(ORDER - i) * binomial(ORDER, i));
    let mut list = Vec::with_capacity(all / stride + 1);
    for record in records {
        let values = if which == 0 { record.rates } else { record.forces };
        if values.is_empty() {
            continue;
        }
        let longest = GAP * (record.times[record.times.len() - 1] - record.times[0]) / (record.times.len() - 1) as f64;
        for window in (0..record.times.len() / WINDOW).step_by(stride) {
            let rows = window * WINDOW..(window + 1) * WINDOW;
            if record.times[rows.clone()].windows(2).any(|pair| pair[1] - pair[0] > longest) {
                continue;
            }
            // The common part of all readings of a window does not change its differences, and would cost digits.
            let window = &values[rows];
            let difference =
                |at: usize| (0..=ORDER).map(|i| weights[i] * (window[at + i][axis] - window[0][axis])).sum();
            let differences = Numbers::from_fn(|at, _| difference(at));
            let left = coordinates.of_differences * differences;
            list.push(left.component_mul(&left));
        }
    }
    list
}

/// The mixture and where its estimates are.
struct Mixture {
    squares: Vec<Numbers>,
    /// The variances that motion makes, a point of the grid each, and the share of the windows that is of it.
    motion: Vec<Numbers>,
    weights: Vec<f64>,
    /// The variance of the white noise.
    white: f64,
}

/// Expectations over all windows under the present estimates.
struct Expected {
    /// Number of windows at every point of the grid, and the sums of their squares.
    windows: Vec<f64>,
    squares: Vec<Numbers>,
    /// The sums of how far the mean of a window's squares, in units of their variances, is off one, squared.
    spread: Vec<f64>,
}

impl Mixture {
    fn new(squares: Vec<Numbers>, coordinates: &Coordinates) -> Option<Self> {
        if (squares.len() as f64) < FEWEST {
            return None;
        }
        let mut means: Vec<f64> = squares.iter().map(|window| window.mean()).collect();
        means.sort_unstable_by(f64::total_cmp);
        let (white, most) = (means[means.len() / 20], means[means.len() - 1]);
        // Readings of which many never change, as of a converter whose steps are greater than the noise, tell nothing.
        if !(white > 0.0 && most.is_finite()) {
            return None;
        }
        let (least, greatest) = (0.01 * white / coordinates.motion.max(), 10.0 * most / coordinates.motion.min());
        let densities = std::iter::successors(Some(least), |density| Some(density * FINE));
        let moved = densities.take_while(|density| *density < greatest).map(|density| coordinates.motion * density);
        let motion: Vec<Numbers> = std::iter::once(Numbers::zeros()).chain(moved).collect();
        let weights = vec![1.0 / motion.len() as f64; motion.len()];
        Some(Self { squares, motion, weights, white })
    }

    fn expected(&self) -> Expected {
        let points = self.motion.len();
        let mut expected =
            Expected { windows: vec![0.0; points], squares: vec![Numbers::zeros(); points], spread: vec![0.0; points] };
        let of_point = |point: usize| {
            let variances = self.motion[point].add_scalar(self.white);
            let logs: f64 = variances.iter().map(|variance| variance.ln()).sum();
            (variances.map(f64::recip), self.weights[point].max(f64::MIN_POSITIVE).ln() - 0.5 * logs)
        };
        let known: Vec<(Numbers, f64)> = (0..points).map(of_point).collect();
        let mut shares = vec![0.0; points];
        for window in &self.squares {
            let mut most = f64::NEG_INFINITY;
            for (share, (weights, log)) in shares.iter_mut().zip(&known) {
                *share = log - 0.5 * weights.dot(window);
                most = most.max(*share);
            }
            let mut all = 0.0;
            for share in &mut shares {
                *share = (*share - most).exp();
                all += *share;
            }
            for (point, share) in shares.iter().enumerate() {
                expected.windows[point] += share / all;
                expected.squares[point] += window * (share / all);
                expected.spread[point] += share / all * (known[point].0.dot(window) / LEFT as f64 - 1.0).powi(2);
            }
        }
        expected
    }

    /// The parts that white noise makes of the variances at a point of the grid.
    fn parts(&self, point: usize) -> Numbers {
        self.motion[point].map(|motion| self.white / (self.white + motion))
    }

    /// A round: the weights by expectation, the variance by a step of scoring, whose share and what all windows tell of the logarithm of the variance are handed back.
    fn round(&mut self) -> (f64, f64) {
        let expected = self.expected();
        let (mut information, mut left) = (0.0, 0.0);
        for (point, windows) in expected.windows.iter().enumerate() {
            let parts = self.parts(point);
            let squares = parts.component_mul(&parts);
            information += windows * squares.sum();
            left += squares.dot(&expected.squares[point]) / self.white - windows * parts.sum();
        }
        let count = self.squares.len() as f64;
        self.weights.iter_mut().zip(&expected.windows).for_each(|(weight, windows)| *weight = windows / count);
        let step = (left / information).clamp(-0.5, 1.0);
        self.white *= 1.0 + step;
        (step, 0.5 * information)
    }

    fn solved(mut self) -> Option<Prior<f64>> {
        let mut information = 0.0;
        for _ in 0..ROUNDS {
            let (step, weight) = self.round();
            information = weight;
            if step.abs() < SAME {
                break;
            }
            // Nothing is quiet enough any more.
            if !(self.white > 0.0 && step.is_finite()) {
                return None;
            }
        }
        let value = self.white.sqrt();
        self.is_white().then(|| Prior { value, deviation: value * (0.5 * information.sqrt().recip()).hypot(MISTAKEN) })
    }

    /// Returns true if the noise is white. In windows without motion, all coordinates must be as large as white noise
    /// makes them. The windows must also be alike, unlike windows with an occasional blow.
    fn is_white(&self) -> bool {
        let expected = self.expected();
        let (mut windows, mut sums, mut spread) = (0.0, Numbers::zeros(), 0.0);
        for point in (0..self.motion.len()).filter(|&point| self.parts(point).mean() > 0.5) {
            windows += expected.windows[point];
            spread += expected.spread[point];
            sums += expected.squares[point].component_div(&self.motion[point].add_scalar(self.white));
        }
        let is_even = |ratio: f64| (EVEN.recip()..=EVEN).contains(&ratio);
        // The mean of so many squares of standard normal numbers has the variance of 2 by their number.
        let is_alike = spread / windows * 0.5 * LEFT as f64 <= ALIKE;
        windows >= FEWEST && is_alike && sums.iter().all(|sum| is_even(sum / windows))
    }
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::mix;

    use super::*;

    /// A standard normal number (Box and Muller).
    fn normal(at: u64) -> f64 {
        let uniform = |at: u64| (mix(mix(11).wrapping_add(at)) >> 11) as f64 / (1u64 << 53) as f64;
        (-2.0 * (1.0 - uniform(2 * at)).ln()).sqrt() * (std::f64::consts::TAU * uniform(2 * at + 1)).cos()
    }

    /// Noise of deviation 0.01 at 1 kHz on this rate about the first axis.
    fn prior_of(rows: usize, noise: impl Fn(u64) -> f64, rate: impl Fn(f64) -> f64) -> Option<Prior<f64>> {
        let times: Vec<f64> = (0..rows).map(|row| 1e-3 * row as f64).collect();
        let value = |(row, t): (usize, &f64)| [rate(*t) + 0.01 * noise(row as u64), 0.0, 0.0];
        let rates: Vec<[f64; 3]> = times.iter().enumerate().map(value).collect();
        self::noise(&[ImuRecord { times: &times, rates: &rates, forces: &[], averages: [0.0; 2] }], 0, 0)
    }

    /// The coordinates are independent and of variance one under white noise, and independent under motion: the covariances by the matrices of differences themselves.
    #[test]
    fn coordinates_are_independent() {
        let coordinates = COORDINATES.as_ref().unwrap();
        let of = |rows: usize, order: usize| {
            nalgebra::DMatrix::from_fn(rows - order, rows, |i, j| {
                if (i..=i + order).contains(&j) { sign(order - (j - i)) * binomial(order, j - i) } else { 0.0 }
            })
        };
        let (white, motion) = (of(WINDOW, ORDER), of(WINDOW - SMOOTH, ORDER - SMOOTH));
        for (covariance, expected) in
            [(&white * white.transpose(), Numbers::repeat(1.0)), (&motion * motion.transpose(), coordinates.motion)]
        {
            let fixed = SMatrix::<f64, LEFT, LEFT>::from_iterator(covariance.iter().copied());
            let product = coordinates.of_differences * fixed * coordinates.of_differences.transpose();
            let apart = (product - SMatrix::from_diagonal(&expected)).amax();
            assert!(apart < 1e-7 * expected.amax(), "{apart}");
        }
        // Nothing is left of a polynomial of the fifth degree, which is some thousand noises tall.
        let smooth = prior_of(32_000, normal, |t| 1e4 * ((t - 10.0) / 10.0).powi(5)).unwrap();
        let still = prior_of(32_000, normal, |_| 0.0).unwrap();
        assert!((smooth.value / still.value - 1.0).abs() < 1e-3);
    }

    /// Of a body that is kicked now and then, and swings, noise is told to 5 %: a window's ringing is none of the motions that it is taken for. Kicks in every window leave nothing to tell.
    #[test]
    fn noise_is_estimated_despite_kicks() {
        let kicked = |every: f64| {
            move |t: f64| {
                let since = t % every;
                (7.0 * t).sin() + 2.0 * (-since / 0.004).exp() * (900.0 * since).cos() + (t / every).floor() % 3.0
            }
        };
        for every in [0.2, 0.05] {
            let prior = prior_of(60_000, normal, kicked(every)).unwrap();
            assert!((prior.value / 0.01 - 1.0).abs() < 0.05, "{every} {prior:?}");
            assert!((MISTAKEN..1.1 * MISTAKEN).contains(&(prior.deviation / prior.value)), "{every} {prior:?}");
        }
        assert_eq!(prior_of(60_000, normal, kicked(0.006)), None);
    }

    /// Noise that is filtered, noise that is rounded away, and few readings tell nothing.
    #[test]
    fn coloured_noise_gives_no_estimate() {
        let filtered = |row: u64| 0.5 * normal(row) + 0.5 * normal(row + 1);
        assert_eq!(prior_of(60_000, filtered, |_| 0.0), None);
        let slow = |row: u64| (0..8).map(|i| 0.3 * normal(row + i)).sum();
        assert_eq!(prior_of(60_000, slow, |_| 0.0), None);
        assert_eq!(prior_of(60_000, |row| (0.1 * normal(row)).round(), |_| 0.0), None);
        assert_eq!(prior_of(700, normal, |_| 0.0), None);
        // Blows of one reading are white; they are not alike.
        assert_eq!(
            prior_of(60_000, |row| normal(row) + if row % 15 == 3 { 30.0 * normal(row + 1) } else { 0.0 }, |_| 0.0),
            None
        );
    }
}
