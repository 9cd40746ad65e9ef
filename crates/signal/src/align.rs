//! The time between two channels that saw one motion.

use fleetfoot_data::{Cancelled, Silent, parallel_map};

use crate::{
    Lambda, SignalError, Spline,
    error::{check, check_stamps},
    smooth,
};

/// A channel with its stamps, s.
#[derive(Debug, Clone, Copy)]
pub struct Record<'a> {
    /// Increasing stamps.
    pub times: &'a [f64],
    /// A value a stamp, NaN where nothing was measured.
    pub values: &'a [f64],
}

/// How much later one channel is than another.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Seconds: what the first channel shows at t, the second shows at t + lag.
    pub lag: f64,
    /// Its standard deviation, s, from residuals summed over batches, so that correlated ones count as what they are.
    pub deviation: f64,
    /// Lags, s, and the share of the first channel's variance that the second does not explain at each: the lag curve.
    pub curve: Vec<(f64, f64)>,
    /// That share at the lag.
    pub unexplained: f64,
    /// Whether the least lies at an end of the curve: the lag may be longer than what was searched.
    pub at_end: bool,
}

/// Batches over which residuals are summed for the deviation.
const BATCHES: usize = 32;

/// Rows that both must share.
const LEAST: usize = 4 * BATCHES;

impl<'a> Record<'a> {
    fn check(self) -> Result<Self, SignalError> {
        let (found, expected) = (self.values.len(), self.times.len());
        if found != expected {
            return Err(SignalError::Length { what: "the channel", found, expected });
        }
        check_stamps(self.times)?;
        let measured = || self.values.iter().copied().filter(|value| !value.is_nan());
        if measured().count() < LEAST {
            return Err(SignalError::NotAligned { problem: "a channel has fewer than 128 measured rows" });
        }
        let (low, high) = (measured().fold(f64::INFINITY, f64::min), measured().fold(f64::NEG_INFINITY, f64::max));
        match low < high {
            true => Ok(self),
            false => Err(SignalError::NotAligned { problem: "a channel stands still" }),
        }
    }

    /// The value at `t` by the cubic through the four stamps around it, and its slope; `at` is where the search begins, and stays. `None` outside.
    fn at(&self, t: f64, at: &mut usize) -> Option<(f64, f64)> {
        let n = self.times.len();
        while *at + 1 < n && self.times[*at + 1] <= t {
            *at += 1;
        }
        if *at == 0 || *at + 2 >= n || self.times[*at] > t {
            return None;
        }
        let (x, y) = (&self.times[*at - 1..*at + 3], &self.values[*at - 1..*at + 3]);
        let (mut value, mut slope) = (0.0, 0.0);
        for i in 0..4 {
            let (mut product, mut derivative) = (1.0, 0.0);
            for j in (0..4).filter(|&j| j != i) {
                let width = x[i] - x[j];
                derivative = (derivative * (t - x[j]) + product) / width;
                product *= (t - x[j]) / width;
            }
            value += y[i] * product;
            slope += y[i] * derivative;
        }
        Some((value, slope))
    }

    fn period(&self) -> f64 {
        (self.times[self.times.len() - 1] - self.times[0]) / (self.times.len() - 1) as f64
    }
}

/// Sums of the first channel x and the second y over the rows that both have.
#[derive(Default)]
struct Sums {
    n: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Sums {
    fn add(&mut self, x: f64, y: f64) {
        self.n += 1.0;
        let (from_x, from_y) = (x - self.x, y - self.y);
        self.x += from_x / self.n;
        self.y += from_y / self.n;
        self.xx += from_x * (x - self.x);
        self.xy += from_x * (y - self.y);
        self.yy += from_y * (y - self.y);
    }

    /// 1 - correlation^2; 1 where a channel stands still meanwhile.
    fn unexplained(&self) -> f64 {
        let scale = self.xx * self.yy;
        if scale > 0.0 { (1.0 - self.xy / scale * self.xy).max(0.0) } else { 1.0 }
    }
}

/// Sums at a lag.
fn sums(first: Record<'_>, second: Record<'_>, lag: f64) -> Sums {
    let (mut sums, mut at) = (Sums::default(), 0);
    for (&time, &x) in first.times.iter().zip(first.values).filter(|(_, x)| !x.is_nan()) {
        if let Some((y, _)) = second.at(time + lag, &mut at) {
            sums.add(x, y);
        }
    }
    sums
}

/// The share at a lag; infinite where too few rows are shared to compare.
fn unexplained(first: Record<'_>, second: Record<'_>, lag: f64, least: f64) -> f64 {
    let sums = sums(first, second, lag);
    if sums.n < least { f64::INFINITY } else { sums.unexplained() }
}

/// How much later `second` is than `first`, between `-most` and `most` seconds: where a straight line of the one explains most of the other (the greatest squared correlation). Units, gains and offsets of the
/// values do not matter, nor their rates.
///
/// The second channel is smoothed first, by a spline whose penalty is the likeliest, and interpolated by cubics between its stamps: between noisy stamps interpolation averages, so that
/// lags which fall there would look better than they are. Lags are tried at steps of the shorter period, then golden sections go on between the neighbours of the best. Every lag takes a pass over both.
///
/// # Errors
/// Stamps that do not increase, values that are infinite, a reach that is not positive, channels of fewer than 128 rows, that share fewer at every lag, or that stand still.
pub fn align(first: Record<'_>, second: Record<'_>, most: f64) -> Result<Alignment, SignalError> {
    let (first, second) = (first.check()?, second.check()?);
    check(most > 0.0 && most.is_finite(), "the greatest lag", most, "a lag is positive and finite")?;
    let smoothed = smooth(second.times, second.values, None, Spline::Cubic, Lambda::Likelihood)?;
    let second = Record { times: second.times, values: &smoothed.derivatives[0] };
    let step = first.period().min(second.period()).min(most);
    let least = LEAST as f64;
    let points = (most / step).floor() as usize;
    let lag = |i: usize| step * (i as f64 - points as f64);
    // Nobody cancels, so that the values are all there.
    let tried =
        parallel_map(2 * points + 1, &Silent, |i| Ok::<_, Cancelled>(unexplained(first, second, lag(i), least)));
    let curve: Vec<(f64, f64)> =
        tried.unwrap_or_default().into_iter().enumerate().map(|(i, share)| (lag(i), share)).collect();
    let best = (0..curve.len()).min_by(|&a, &b| curve[a].1.total_cmp(&curve[b].1)).unwrap_or(0);
    match curve[best].1 {
        share if share.is_infinite() => {
            Err(SignalError::NotAligned { problem: "the channels share fewer than 128 rows at every lag" })
        }
        _ => Ok(refined(first, second, curve, best, least)),
    }
}

/// The alignment from the best point of the curve.
fn refined(first: Record<'_>, second: Record<'_>, curve: Vec<(f64, f64)>, best: usize, least: f64) -> Alignment {
    let at_end = best == 0 || best + 1 == curve.len();
    let lag = match at_end {
        true => curve[best].0,
        false => crate::least::golden(
            curve[best - 1].0,
            curve[best + 1].0,
            1e-5 * (curve[best + 1].0 - curve[best].0),
            |lag| unexplained(first, second, lag, least),
        ),
    };
    let (unexplained, deviation) = deviation(first, second, lag);
    Alignment { lag, deviation, curve, unexplained, at_end }
}

/// The share at the lag, and the lag's deviation: x = a + b y(t + lag) + error, linearised in a, b and the lag. With s the part of the slope b y' that neither y nor the constant explains, the
/// deviation is sqrt(sum over batches of (sum of s error)^2) / sum of s^2.
fn deviation(first: Record<'_>, second: Record<'_>, lag: f64) -> (f64, f64) {
    let mut at = 0;
    let rows: Vec<[f64; 3]> = first
        .times
        .iter()
        .zip(first.values)
        .filter(|(_, x)| !x.is_nan())
        .filter_map(|(&time, &x)| second.at(time + lag, &mut at).map(|(y, slope)| [x, y, slope]))
        .collect();
    let (mut of_x, mut of_slope) = (Sums::default(), Sums::default());
    for &[x, y, slope] in &rows {
        of_x.add(x, y);
        of_slope.add(slope, y);
    }
    let (gain, share) = (of_x.xy / of_x.yy, of_slope.xy / of_slope.yy);
    let (mut square, mut spread) = (0.0, 0.0);
    for batch in rows.chunks(rows.len().div_ceil(BATCHES)) {
        let mut sum = 0.0;
        for &[x, y, slope] in batch {
            let error = x - of_x.x - gain * (y - of_x.y);
            let own = gain * (slope - of_slope.x - share * (y - of_slope.y));
            sum += own * error;
            square += own * own;
        }
        spread += sum * sum;
    }
    (of_x.unexplained(), spread.sqrt() / square)
}
