//! Interpolating splines: piecewise cubics through every measurement, over stamps however uneven.
//!
//! | symbol | here |
//! |---|---|
//! | h_i = t_(i+1) - t_i | step |
//! | delta_i = (y_(i+1) - y_i) / h_i | slope of the chord |
//! | s_i | slope of the curve at t_i: all that the two kinds differ in |

use crate::{
    SignalError,
    error::{check_infinite, check_stamps, length},
};

/// Kind of curve through the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// The cubic spline with two continuous derivatives, the third continuous too at the second and at the last but one point (de Boor, "A Practical Guide to Splines",
    /// 1978, chapter IV). It reproduces cubics.
    #[default]
    NotAKnot,
    /// The cubic that rises where the points rise and falls where they fall (Fritsch and Butland, "A method for constructing local monotone piecewise cubic
    /// interpolants", SIAM J. Sci. Stat. Comput. 5, 1984, with weights for uneven steps and ends that keep the shape, as `scipy.interpolate.PchipInterpolator`
    /// has them). One derivative is continuous.
    ShapePreserving,
}

/// A curve through points.
#[derive(Debug, Clone, PartialEq)]
pub struct Interpolant {
    times: Vec<f64>,
    values: Vec<f64>,
    slopes: Vec<f64>,
}

impl Interpolant {
    /// The curve through the measured `values` (NaN: nothing was measured) at `times` in s, which increase. O(n).
    ///
    /// ```
    /// use fleetfoot_signal::{Interpolant, Interpolation};
    ///
    /// let times = [0.0, 0.7, 1.0, 2.5, 3.0];
    /// let cubic = times.map(|t: f64| t.powi(3) - 2.0 * t);
    /// let curve = Interpolant::new(&times, &cubic, Interpolation::NotAKnot)?;
    /// let [value, rate, acceleration] = curve.at(2.0);
    /// assert!((value - 4.0).abs() < 1e-12 && (rate - 10.0).abs() < 1e-12 && (acceleration - 12.0).abs() < 1e-12);
    /// # Ok::<(), fleetfoot_signal::SignalError>(())
    /// ```
    ///
    /// # Errors
    /// Arrays of different lengths, stamps that do not increase, values that are infinite, fewer than two measurements.
    pub fn new(times: &[f64], values: &[f64], kind: Interpolation) -> Result<Self, SignalError> {
        length("the channel", values.len(), times.len())?;
        check_stamps(times)?;
        check_infinite(values)?;
        let measured = || times.iter().zip(values).filter(|(_, value)| !value.is_nan());
        let times: Vec<f64> = measured().map(|(time, _)| *time).collect();
        let values: Vec<f64> = measured().map(|(_, value)| *value).collect();
        if times.len() < 2 {
            return Err(SignalError::TooFew { count: times.len(), needed: 2 });
        }
        let chords = Chords::new(&times, &values);
        let slopes = match kind {
            Interpolation::NotAKnot => chords.not_a_knot(),
            Interpolation::ShapePreserving => chords.shape_preserving(),
        };
        Ok(Self { times, values, slopes })
    }

    /// Value, first and second derivative at a time; before the first and beyond the last point those of the first and the last piece. At a point the second
    /// derivative is that of the piece that begins there.
    pub fn at(&self, time: f64) -> [f64; 3] {
        let after = self.times.partition_point(|&stamp| stamp <= time);
        self.on_piece(after.clamp(1, self.times.len() - 1) - 1, time)
    }

    /// Value, first and second derivative at times that rise, in three lists.
    pub fn all(&self, times: &[f64]) -> [Vec<f64>; 3] {
        let mut lists = [(); 3].map(|()| Vec::with_capacity(times.len()));
        let mut piece = 0;
        for &time in times {
            while piece + 2 < self.times.len() && self.times[piece + 1] <= time {
                piece += 1;
            }
            for (list, value) in lists.iter_mut().zip(self.on_piece(piece, time)) {
                list.push(value);
            }
        }
        lists
    }

    /// On the piece after the i-th point.
    fn on_piece(&self, i: usize, time: f64) -> [f64; 3] {
        let h = self.times[i + 1] - self.times[i];
        let chord = (self.values[i + 1] - self.values[i]) / h;
        let (start, end) = (self.slopes[i], self.slopes[i + 1]);
        let square = (3.0 * chord - 2.0 * start - end) / h;
        let cube = (start + end - 2.0 * chord) / (h * h);
        let t = time - self.times[i];
        let value = if time == self.times[i + 1] {
            self.values[i + 1]
        } else {
            self.values[i] + t * (start + t * (square + t * cube))
        };
        [value, start + t * (2.0 * square + 3.0 * t * cube), 2.0 * square + 6.0 * t * cube]
    }
}

/// Steps and chords of points, of which there are two or more.
struct Chords {
    h: Vec<f64>,
    delta: Vec<f64>,
}

impl Chords {
    fn new(times: &[f64], values: &[f64]) -> Self {
        let h: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let delta = values.windows(2).zip(&h).map(|(pair, h)| (pair[1] - pair[0]) / h).collect();
        Self { h, delta }
    }

    /// Slopes for which the second derivative is continuous at every inner point,
    ///
    /// ```text
    /// h_i s_(i-1) + 2 (h_(i-1) + h_i) s_i + h_(i-1) s_(i+1) = 3 (h_i delta_(i-1) + h_(i-1) delta_i)
    /// ```
    ///
    /// and the third at the second and the last but one. These two conditions,
    ///
    /// ```text
    /// h_1 s_0 + (h_0 + h_1) s_1 = ((3 h_0 + 2 h_1) h_1 delta_0 + h_0^2 delta_1) / (h_0 + h_1)
    /// ```
    ///
    /// and its mirror image, are taken out of the first and the last equation: what is left is dominated by its diagonal, and elimination without pivots is stable.
    fn not_a_knot(&self) -> Vec<f64> {
        let (h, delta) = (&self.h, &self.delta);
        let n = h.len() + 1;
        if n == 2 {
            return vec![delta[0]; 2];
        }
        if n == 3 {
            // One parabola.
            let second = (delta[1] - delta[0]) / (h[0] + h[1]);
            return vec![delta[0] - second * h[0], delta[0] + second * h[0], delta[1] + second * h[1]];
        }
        let end = |near: usize, far: usize| {
            let (h0, h1) = (h[near], h[far]);
            ((3.0 * h0 + 2.0 * h1) * h1 * delta[near] + h0 * h0 * delta[far]) / (h0 + h1)
        };
        let (first, last) = (end(0, 1), end(n - 2, n - 3));
        // Forward: s_i = right_i - upper_i s_(i+1).
        let (mut upper, mut right) = (vec![0.0; n], vec![0.0; n]);
        for i in 1..n - 1 {
            let (before, after) = (h[i - 1], h[i]);
            let (mut lower, mut diagonal, mut next) = (after, 2.0 * (before + after), before);
            let mut slope = 3.0 * (after * delta[i - 1] + before * delta[i]);
            if i == 1 {
                (lower, diagonal, slope) = (0.0, diagonal - (before + after), slope - first);
            }
            if i == n - 2 {
                (next, diagonal, slope) = (0.0, diagonal - (before + after), slope - last);
            }
            let pivot = diagonal - lower * upper[i - 1];
            upper[i] = next / pivot;
            right[i] = (slope - lower * right[i - 1]) / pivot;
        }
        let mut slopes = right;
        for i in (1..n - 2).rev() {
            slopes[i] -= upper[i] * slopes[i + 1];
        }
        slopes[0] = (first - (h[0] + h[1]) * slopes[1]) / h[1];
        slopes[n - 1] = (last - (h[n - 2] + h[n - 3]) * slopes[n - 2]) / h[n - 3];
        slopes
    }

    /// The weighted harmonic mean of the two chords where both go one way, else level.
    fn shape_preserving(&self) -> Vec<f64> {
        let (h, delta) = (&self.h, &self.delta);
        if h.len() == 1 {
            return vec![delta[0]; 2];
        }
        let inner = |i: usize| {
            let (before, after) = (delta[i - 1], delta[i]);
            if before.signum() != after.signum() || before == 0.0 || after == 0.0 {
                return 0.0;
            }
            let (v, w) = (2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]);
            (v + w) / (v / before + w / after)
        };
        let end = |near: usize, far: usize| {
            let (h0, h1) = (h[near], h[far]);
            let slope = ((2.0 * h0 + h1) * delta[near] - h0 * delta[far]) / (h0 + h1);
            if slope * delta[near] <= 0.0 {
                0.0
            } else if delta[near].signum() != delta[far].signum() && slope.abs() > 3.0 * delta[near].abs() {
                3.0 * delta[near]
            } else {
                slope
            }
        };
        let n = h.len() + 1;
        std::iter::once(end(0, 1)).chain((1..n - 1).map(inner)).chain([end(n - 2, n - 3)]).collect()
    }
}

/// Lists of a value and its derivatives at `times`, at other stamps; both rise, and there are two points or more.
///
/// Each list but the last by the cubics that have its values and the next list's as slopes; the last one, and all where the curve is of straight pieces, on straight lines. Beyond the
/// points as on the first and the last piece.
pub fn resampled(times: &[f64], lists: &[Vec<f64>], at: &[f64], straight: bool) -> Vec<Vec<f64>> {
    let list = |k: usize| {
        let cubic = (!straight && k + 1 < lists.len()).then(|| Interpolant {
            times: times.to_vec(),
            values: lists[k].clone(),
            slopes: lists[k + 1].clone(),
        });
        let mut piece = 0;
        let value = |&time: &f64| {
            while piece + 2 < times.len() && times[piece + 1] <= time {
                piece += 1;
            }
            let (from, to) = (lists[k][piece], lists[k][piece + 1]);
            match &cubic {
                _ if time == times[piece] => from,
                _ if time == times[piece + 1] => to,
                Some(cubic) => cubic.on_piece(piece, time)[0],
                None => from + (to - from) * ((time - times[piece]) / (times[piece + 1] - times[piece])),
            }
        };
        at.iter().map(value).collect()
    };
    (0..lists.len()).map(list).collect()
}
