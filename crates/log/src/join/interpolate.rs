//! Values between samples.

use std::f64::consts::{PI, TAU};

use crate::breaks::Breaks;

/// Position of a wanted stamp among samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// The last sample at or before.
    pub before: usize,
    /// Fraction of the way to the next sample: 0 at the sample, NaN without an answer.
    pub fraction: f64,
}

/// Reach of a sample in time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach<'a> {
    /// Nanoseconds; `None` is no limit.
    pub limit: Option<u64>,
    /// Breaks at which samples were lost, and the median step that confirms them.
    pub breaks: Option<(&'a Breaks, Option<u64>)>,
}

impl Reach<'_> {
    fn bridges(&self, from: i64, to: i64) -> bool {
        self.limit.is_none_or(|limit| to.abs_diff(from) <= limit)
            && self.breaks.is_none_or(|(breaks, period)| !breaks.lost(from, to, period))
    }
}

/// Finds the places of `wanted` stamps among the stamps of samples; both rise, and no wanted stamp lies before the first sample.
///
/// Between two samples of which one does not reach the other, and beyond the last sample, there is no answer.
pub(super) fn places_between(time: &[i64], wanted: &[i64], reach: Reach<'_>, places: &mut Vec<Place>) {
    walk(time, wanted, places, |before, stamp| match (time.get(before), time.get(before + 1)) {
        (Some(&sample), _) if sample == stamp => 0.0,
        (Some(&sample), Some(&next)) if reach.bridges(sample, next) => {
            stamp.abs_diff(sample) as f64 / next.abs_diff(sample) as f64
        }
        _ => f64::NAN,
    });
}

/// Finds the samples that hold at `wanted` stamps: the last at or before, where it reaches them.
///
/// Beyond `end`, the last stamp of the series' run, only what holds without limit goes on.
pub(super) fn places_held(time: &[i64], wanted: &[i64], reach: Reach<'_>, end: i64, places: &mut Vec<Place>) {
    walk(time, wanted, places, |before, stamp| {
        let good = || stamp <= end && time.get(before).is_some_and(|&sample| reach.bridges(sample, stamp));
        if reach.limit.is_none() || good() { 0.0 } else { f64::NAN }
    });
}

fn walk(time: &[i64], wanted: &[i64], places: &mut Vec<Place>, fraction: impl Fn(usize, i64) -> f64) {
    places.clear();
    let mut before = 0;
    places.extend(wanted.iter().map(|&stamp| {
        while time.get(before + 1).is_some_and(|&next| next <= stamp) {
            before += 1;
        }
        Place { before, fraction: fraction(before, stamp) }
    }));
}

/// The samples themselves, where the fraction is 0, and what lies on the straight line between two.
pub(super) fn linear(places: &[Place], samples: &[f64], out: &mut [f64]) {
    for (out, place) in out.iter_mut().zip(places) {
        *out = match neighbours(place, samples) {
            (from, None) => from,
            (from, Some(to)) => from + place.fraction * (to - from),
        };
    }
}

/// Like [`linear`] for radians, on the shorter arc; half a turn goes upwards. The result is in (-pi, pi].
pub(super) fn angle(places: &[Place], samples: &[f64], out: &mut [f64]) {
    for (out, place) in out.iter_mut().zip(places) {
        *out = wrap(match neighbours(place, samples) {
            (from, None) => from,
            (from, Some(to)) => from + place.fraction * wrap(to - from),
        });
    }
}

/// The sample and, where the answer is not the sample itself, its successor; NaN where there is no answer.
fn neighbours(place: &Place, samples: &[f64]) -> (f64, Option<f64>) {
    if place.fraction.is_nan() {
        (f64::NAN, None)
    } else if place.fraction == 0.0 {
        (samples[place.before], None)
    } else {
        (samples[place.before], Some(samples[place.before + 1]))
    }
}

/// An angle in (-pi, pi]; one that lies there already keeps its bits.
pub(super) fn wrap(angle: f64) -> f64 {
    if angle > -PI && angle <= PI {
        return angle;
    }
    let positive = angle.rem_euclid(TAU);
    if positive > PI { positive - TAU } else { positive }
}

/// The samples themselves, where the fraction is 0, and what lies on the great arc between two; signs as they come.
pub(super) fn slerp(places: &[Place], samples: [&[f64]; 4], out: [&mut [f64]; 4]) {
    let sample = |row: usize| samples.map(|column| column[row]);
    let [x, y, z, w] = out;
    for ((((x, y), z), w), place) in x.iter_mut().zip(y).zip(z).zip(w).zip(places) {
        let q = if place.fraction.is_nan() {
            [f64::NAN; 4]
        } else if place.fraction == 0.0 {
            let q = sample(place.before);
            if unit(q).is_some() { q } else { [f64::NAN; 4] }
        } else {
            between(sample(place.before), sample(place.before + 1), place.fraction)
        };
        [*x, *y, *z, *w] = q;
    }
}

/// The quaternion at `fraction` of the shorter great arc from `from` to `to`; NaN when one of them is zero or not finite.
///
/// The angle comes from the chord and its complement (Kahan), which is accurate where the arc cosine is not.
fn between(from: [f64; 4], to: [f64; 4], fraction: f64) -> [f64; 4] {
    let (Some(p), Some(mut q)) = (unit(from), unit(to)) else {
        return [f64::NAN; 4];
    };
    if dot(p, q) < 0.0 {
        q = q.map(|c| -c);
    }
    let chord = norm(std::array::from_fn(|c| q[c] - p[c]));
    let theta = 2.0 * chord.atan2(norm(std::array::from_fn(|c| q[c] + p[c])));
    // Below this angle the sines are their arguments to the last bit.
    let (a, b) = if theta < 1e-8 {
        (1.0 - fraction, fraction)
    } else {
        (((1.0 - fraction) * theta).sin(), (fraction * theta).sin())
    };
    let mixed: [f64; 4] = std::array::from_fn(|c| a * p[c] + b * q[c]);
    unit(mixed).unwrap_or([f64::NAN; 4])
}

/// The quaternion at unit length; `None` when it is zero or not finite.
fn unit(q: [f64; 4]) -> Option<[f64; 4]> {
    // Scaled first: squares of tiny or huge components would leave the range.
    let largest = q.iter().fold(0.0, |largest: f64, c| largest.max(c.abs()));
    if largest == 0.0 || !q.iter().all(|c| c.is_finite()) {
        return None;
    }
    let scaled = q.map(|c| c / largest);
    let length = norm(scaled);
    Some(scaled.map(|c| c / length))
}

fn norm(q: [f64; 4]) -> f64 {
    dot(q, q).sqrt()
}

pub(super) fn dot(p: [f64; 4], q: [f64; 4]) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]
}

/// Gives each row the sign nearer to the row before, from block to block of a run.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SignCarry {
    last: Option<[f64; 4]>,
}

impl SignCarry {
    /// Turns the signs of consecutive rows. Rows of NaN are passed over.
    pub(super) fn apply(&mut self, rows: &mut [Vec<f64>; 4]) {
        let [x, y, z, w] = rows;
        for (((x, y), z), w) in x.iter_mut().zip(y).zip(z).zip(w) {
            let mut q = [*x, *y, *z, *w];
            if q[3].is_nan() {
                continue;
            }
            let turned = self.last.map_or(q[3] < 0.0, |last| dot(last, q) < 0.0);
            if turned {
                q = q.map(|c| -c);
                [*x, *y, *z, *w] = q;
            }
            self.last = Some(q);
        }
    }
}
