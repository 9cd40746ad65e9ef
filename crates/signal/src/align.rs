//! The time between two channels that saw one motion, stamped by two clocks.

use fleetfoot_data::{Cancelled, Silent, parallel_map};

use crate::{
    ClockLine, Lambda, SignalError, Spline,
    error::{check, check_stamps},
    means::means,
    outliers::gross_errors,
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

/// Search range of the line between two clocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Within {
    /// The lag about which is searched, s.
    pub about: f64,
    /// Half-width of the range of lags, s.
    pub reach: f64,
    /// The greatest skew to either side, seconds a second; 0 for clocks that run alike.
    pub skew: f64,
}

/// Lag of one channel behind another.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Line between the clocks: the first channel's value at t is the second's at t + offset + skew (t - at).
    pub line: ClockLine,
    /// Standard deviation of the offset at that moment, s. It is computed from residuals summed over batches, which
    /// accounts for their correlation.
    pub deviation: f64,
    /// Standard deviation of the skew, seconds a second.
    pub skew_deviation: f64,
    /// Lag curve, at the estimated skew: lags, s, and the share of the first channel's variance that the second does
    /// not explain at each.
    pub curve: Vec<(f64, f64)>,
    /// Unexplained share of the variance on the line.
    pub unexplained: f64,
    /// True if the minimum lies at an end of the search range: the lag or the skew may be larger.
    pub at_end: bool,
    /// Deviation of the lag from the line in each quarter of the record.
    pub parts: Vec<PartLag>,
    /// Rows of the first and of the second channel that were left out as gross errors, in order.
    pub left_out: [Vec<usize>; 2],
}

/// The lag of a part of the record beside the line through all of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PartLag {
    /// The middle of the part by the first clock, s.
    pub at: f64,
    /// Its lag less that of the line, s.
    pub off: f64,
    /// The deviation of that, s.
    pub deviation: f64,
}

/// Batches over which residuals are summed for the deviation.
const BATCHES: usize = 32;

/// Parts of a record that are compared with the line.
const PARTS: usize = 4;

/// Rows that both must share.
const LEAST: usize = 4 * BATCHES;

/// Both share at least one of so many rows that they can share: of few some are alike by accident.
const FEWEST: usize = 2;

/// Rows of the first channel, at most, that a point of the curve is computed from.
const ROWS: usize = 20_000;

/// Steps of the refinement, at most; it takes some five.
const STEPS: usize = 30;

impl<'a> Record<'a> {
    pub(crate) fn check(self, least: usize) -> Result<Self, SignalError> {
        let (count, expected) = (self.values.len(), self.times.len());
        if count != expected {
            return Err(SignalError::Length { what: "the channel", count, expected });
        }
        check_stamps(self.times)?;
        let measured = || self.values.iter().copied().filter(|value| !value.is_nan());
        if measured().count() < least {
            return Err(SignalError::NotAligned { problem: "a channel has fewer than 128 measured rows" });
        }
        let (low, high) = (measured().fold(f64::INFINITY, f64::min), measured().fold(f64::NEG_INFINITY, f64::max));
        match low < high {
            true => Ok(self),
            false => Err(SignalError::NotAligned { problem: "a channel is constant" }),
        }
    }

    /// The value at `t` by the cubic through the four stamps around it, and its slope; `at` is where the search begins, and stays. `None` outside, and where one of these has none.
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
        Some((value, slope)).filter(|_| !value.is_nan())
    }

    /// The values without their gross errors, and where these were.
    fn without_gross_errors(&self) -> Result<(Vec<f64>, Vec<usize>), SignalError> {
        let (mut values, rows) = (self.values.to_vec(), gross_errors(self.values)?);
        rows.iter().for_each(|&row| values[row] = f64::NAN);
        Ok((values, rows))
    }

    fn duration(&self) -> f64 {
        self.times[self.times.len() - 1] - self.times[0]
    }

    fn period(&self) -> f64 {
        self.duration() / (self.times.len() - 1) as f64
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

    /// Residual of x after the regression on a constant and y.
    fn rest(&self, x: f64, y: f64) -> f64 {
        x - self.x - self.xy / self.yy * (y - self.y)
    }
}

/// Estimates the lag of `second` behind `first` and the skew of its clock. The estimate maximises the squared
/// correlation: the share of one channel that a straight line of the other explains. Units, gains and offsets of the
/// values do not matter, nor their rates.
///
/// The second channel is smoothed first, by a spline with the likeliest penalty, and interpolated by cubics between its
/// stamps. Without smoothing, interpolation between noisy stamps averages, and lags in between would look better than
/// they are. If one channel is at least twice as fast, its means over the other's period are compared: faster motion
/// has no information about the lag. Gross errors of both are left out before, since one of a hundred deviations weighs
/// more than all of the motion.
///
/// Lags are tried at steps of the shorter period. Skews are tried at steps that displace the ends of the record by at
/// most the time over which the channel changes. So no first guess is needed. Gauss and Newton's steps then refine the
/// best lag and skew together.
///
/// # Errors
/// Stamps that do not increase, values that are infinite, and a reach that is not positive. Channels that stand still,
/// have fewer than 128 rows, or share fewer. Channels that share less than half of their possible rows at every lag.
pub fn align(first: Record<'_>, second: Record<'_>, within: Within) -> Result<Alignment, SignalError> {
    let (first, second) = (first.check(LEAST)?, second.check(LEAST)?);
    let Within { about, reach, skew } = within;
    check(reach > 0.0 && reach.is_finite(), "the reach", reach, "a reach must be positive and finite")?;
    check((0.0..0.1).contains(&skew), "the greatest skew", skew, "a skew must be 0 or more, and below 0.1")?;
    check(about.is_finite(), "the lag to search about", about, "a lag must be finite")?;
    let ((first_part, first_out), (other, second_out)) =
        (first.without_gross_errors()?, second.without_gross_errors()?);
    let smoothed = smooth(second.times, &other, None, Spline::Cubic, Lambda::Likelihood)?;
    let other = &smoothed.derivatives[0];
    // Motion that the slower channel does not follow is no common motion: of a gyroscope at 1 kHz beside poses at 100 Hz it would be most of the error.
    let period = first.period().max(second.period());
    let common = |record: Record<'_>, values: &[f64]| match 2.0 * record.period() <= period {
        true => means(record.times, values, period),
        false => values.to_vec(),
    };
    let (first_values, other) = (common(first, &first_part), common(second, other));
    let (first, second) = (Record { values: &first_values, ..first }, Record { values: &other, ..second });
    let left_out = [first_out, second_out];
    let pair =
        Pair { first, second, within, left_out, at: 0.5 * (first.times[0] + first.times[first.times.len() - 1]) };
    let (skew, curve) = pair.search();
    let best = (0..curve.len()).min_by(|&a, &b| curve[a].1.total_cmp(&curve[b].1)).unwrap_or(0);
    if curve[best].1.is_infinite() {
        return Err(SignalError::NotAligned {
            problem: "at every lag the channels share fewer than 128 rows, or fewer than half of the possible rows",
        });
    }
    let start = ClockLine { at: pair.at, offset: curve[best].0, skew };
    if best == 0 || best + 1 == curve.len() {
        return Ok(pair.alignment(start, curve, true));
    }
    let line = pair.refined(start);
    let at_end = skew.abs() > 0.0 && line.skew.abs() >= within.skew || (line.offset - about).abs() >= reach;
    Ok(pair.alignment(line, curve, at_end))
}

/// Two channels, the second one smooth, and the moment at which a line's offset is told.
struct Pair<'a> {
    first: Record<'a>,
    second: Record<'a>,
    within: Within,
    at: f64,
    left_out: [Vec<usize>; 2],
}

/// A row of the first channel, and what the second one is at its time.
struct Row {
    time: f64,
    x: f64,
    y: f64,
    slope: f64,
}

impl Pair<'_> {
    /// Every `every`-th measured row of the first channel, where the second one has a value.
    fn rows(&self, line: ClockLine, every: usize) -> impl Iterator<Item = Row> {
        let mut at = 0;
        let measured = self.first.times.iter().zip(self.first.values).filter(|(_, x)| !x.is_nan()).step_by(every);
        measured.filter_map(move |(&time, &x)| {
            let (y, slope) = self.second.at(line.second(time), &mut at)?;
            Some(Row { time, x, y, slope })
        })
    }

    /// Measured rows of the first channel for which the second one can have a value, wherever it lies.
    fn most_shared(&self) -> f64 {
        let measured = self.first.values.iter().filter(|value| !value.is_nan()).count();
        measured as f64 * (self.second.duration() / self.first.duration()).min(1.0)
    }

    /// The share that the second channel does not explain; infinite where too few rows are shared to compare.
    fn unexplained(&self, line: ClockLine, every: usize) -> f64 {
        let mut sums = Sums::default();
        self.rows(line, every).for_each(|row| sums.add(row.x, row.y));
        let least = (LEAST as f64).max(self.most_shared() / (FEWEST * every) as f64);
        if sums.n < least { f64::INFINITY } else { sums.unexplained() }
    }

    /// The seconds over which the second channel changes: the root of its variance over that of its slope.
    fn scale(&self) -> f64 {
        let (mut values, mut at) = (Sums::default(), 0);
        for &time in self.second.times {
            self.second.at(time, &mut at).into_iter().for_each(|(y, slope)| values.add(y, slope));
        }
        if values.yy > 0.0 { (values.xx / values.yy).sqrt() } else { self.second.period() }
    }

    /// The skew of the deepest lag curve, and that curve.
    fn search(&self) -> (f64, Vec<(f64, f64)>) {
        let Within { about, reach, skew } = self.within;
        let step = self.first.period().min(self.second.period()).min(reach);
        let points = (reach / step).floor() as usize;
        let skews = (skew * 0.5 * self.first.duration() / self.scale()).round() as usize;
        let measured = self.first.values.iter().filter(|value| !value.is_nan()).count();
        let every = (measured / ROWS).max(1);
        let lag = |i: usize| about + step * (i as f64 - points as f64);
        let skew = |i: usize| skew * (i as f64 - skews as f64) / skews.max(1) as f64;
        let lags = 2 * points + 1;
        // Nobody cancels, so that the values are all there.
        let tried = parallel_map(lags * (2 * skews + 1), &Silent, |i| {
            let line = ClockLine { at: self.at, offset: lag(i % lags), skew: skew(i / lags) };
            Ok::<_, Cancelled>(self.unexplained(line, every))
        });
        let tried = tried.unwrap_or_default();
        let best = (0..tried.len()).min_by(|&a, &b| tried[a].total_cmp(&tried[b])).unwrap_or(0) / lags;
        let curve = tried.chunks(lags).nth(best).unwrap_or_default();
        (skew(best), curve.iter().enumerate().map(|(i, &share)| (lag(i), share)).collect())
    }

    /// The line of the least share, by Gauss and Newton's steps, each cut in half until it goes down.
    fn refined(&self, mut line: ClockLine) -> ClockLine {
        let (mut share, duration) = (self.unexplained(line, 1), self.first.duration());
        let enough = 1e-5 * self.first.period().min(self.second.period());
        for _ in 0..STEPS {
            let linear = Linear::new(self, line);
            let [mut lag, mut skew] = linear.step();
            // A step beyond the time over which the channel changes leaves the valley.
            let far = (lag.abs() + 0.5 * duration * skew.abs()) / self.scale();
            (lag, skew) = (lag / far.max(1.0), skew / far.max(1.0));
            let mut went_down = false;
            while lag.abs() + duration * skew.abs() > enough {
                // Beyond what was searched a few rows are left that are alike by accident.
                let Within { about, reach, skew: most } = self.within;
                let offset = (line.offset + lag).clamp(about - reach, about + reach);
                let next = ClockLine { offset, skew: (line.skew + skew).clamp(-most, most), ..line };
                let unexplained = self.unexplained(next, 1);
                if unexplained < share {
                    (line, share, went_down) = (next, unexplained, true);
                    break;
                }
                (lag, skew) = (0.5 * lag, 0.5 * skew);
            }
            if !went_down {
                break;
            }
        }
        line
    }

    fn alignment(&self, line: ClockLine, curve: Vec<(f64, f64)>, at_end: bool) -> Alignment {
        let linear = Linear::new(self, line);
        let [deviation, skew_deviation] = linear.deviations();
        let (unexplained, parts) = (linear.of_x.unexplained(), linear.parts());
        let left_out = self.left_out.clone();
        Alignment { line, deviation, skew_deviation, curve, unexplained, at_end, parts, left_out }
    }
}

/// The model x = a + b y(t + lag + skew (t - at)) + error about a line: of every row its time, its error, and what the lag and the skew alone move of it.
struct Linear {
    of_x: Sums,
    rows: Vec<(f64, f64, [f64; 2])>,
    /// The normal matrix of lag and skew, its inverse; the skew is left out where it is known.
    inverse: [[f64; 2]; 2],
}

impl Linear {
    fn new(pair: &Pair<'_>, line: ClockLine) -> Self {
        let rows: Vec<Row> = pair.rows(line, 1).collect();
        let turned = |row: &Row| row.slope * (row.time - pair.at);
        let (mut of_x, mut of_slope, mut of_turned) = (Sums::default(), Sums::default(), Sums::default());
        for row in &rows {
            of_x.add(row.x, row.y);
            of_slope.add(row.slope, row.y);
            of_turned.add(turned(row), row.y);
        }
        let gain = of_x.xy / of_x.yy;
        let alone = |row: &Row| {
            let moved = [of_slope.rest(row.slope, row.y), of_turned.rest(turned(row), row.y)];
            (row.time, of_x.rest(row.x, row.y), moved.map(|component| gain * component))
        };
        let rows: Vec<_> = rows.iter().map(alone).collect();
        let [mut aa, mut ab, mut bb] = [0.0; 3];
        for (.., [a, b]) in &rows {
            (aa, ab, bb) = (aa + a * a, ab + a * b, bb + b * b);
        }
        let inverse = if pair.within.skew > 0.0 {
            let determinant = aa * bb - ab * ab;
            [[bb / determinant, -ab / determinant], [-ab / determinant, aa / determinant]]
        } else {
            [[1.0 / aa, 0.0], [0.0, 0.0]]
        };
        Self { of_x, rows, inverse }
    }

    fn score(rows: &[(f64, f64, [f64; 2])]) -> [f64; 2] {
        rows.iter().fold([0.0; 2], |sum, (_, error, [a, b])| [sum[0] + a * error, sum[1] + b * error])
    }

    fn solve(&self, score: [f64; 2]) -> [f64; 2] {
        self.inverse.map(|row| row[0] * score[0] + row[1] * score[1])
    }

    /// Newton step of lag and skew.
    fn step(&self) -> [f64; 2] {
        let step = self.solve(Self::score(&self.rows));
        if step.iter().all(|component| component.is_finite()) { step } else { [0.0; 2] }
    }

    /// The deviations of lag and skew: each batch of rows moves them by its own share, and these shares are independent.
    fn deviations(&self) -> [f64; 2] {
        let shares = self.rows.chunks(self.rows.len().div_ceil(BATCHES)).map(|batch| self.solve(Self::score(batch)));
        shares.fold([0.0; 2], |sum, share| [sum[0] + share[0] * share[0], sum[1] + share[1] * share[1]]).map(f64::sqrt)
    }

    /// The lag of every part by itself, beside the line.
    fn parts(&self) -> Vec<PartLag> {
        let part = |rows: &[(f64, f64, [f64; 2])]| {
            let square: f64 = rows.iter().map(|(.., [a, _])| a * a).sum();
            let off = Self::score(rows)[0] / square;
            let rest = |batch: &[(f64, f64, [f64; 2])]| -> f64 {
                batch.iter().map(|(_, error, [a, _])| a * (error - off * a)).sum()
            };
            let batches = rows.chunks(rows.len().div_ceil(BATCHES / PARTS));
            let squares: f64 = batches.map(|batch| rest(batch).powi(2)).sum();
            // The part's own lag is one of what as many batches tell.
            let free = (BATCHES / PARTS) as f64 / (BATCHES / PARTS - 1) as f64;
            let deviation = (free * squares).sqrt() / square;
            PartLag { at: 0.5 * (rows[0].0 + rows[rows.len() - 1].0), off, deviation }
        };
        self.rows.chunks(self.rows.len().div_ceil(PARTS)).map(part).collect()
    }
}
