//! The recursions and interpolations, over rows in memory.

use std::ops::Range;

/// Gain of a first-order lag over a step, and its derivative with respect to the time constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gain {
    /// `1 - exp(-dt/tau)`.
    pub(super) gain: f64,
    /// `-exp(-dt/tau) dt/tau^2`.
    pub(super) slope: f64,
}

impl Gain {
    fn of(seconds: f64, tau: f64) -> Self {
        let share = seconds / tau;
        let gain = -(-share).exp_m1();
        Self { gain, slope: (gain - 1.0) * share / tau }
    }
}

/// The gains from every row to the next.
pub(super) fn gains(stamps: &[i64], tau: f64) -> Vec<Gain> {
    let mut last = (0, Gain::of(0.0, tau));
    let gain = |pair: &[i64]| {
        let step = pair[1] - pair[0];
        if step != last.0 {
            last = (step, Gain::of(step as f64 * 1e-9, tau));
        }
        last.1
    };
    stamps.windows(2).map(gain).collect()
}

/// A lag's output and its derivative with respect to the time constant; NaN where the input is missing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct State {
    pub(super) value: f64,
    pub(super) slope: f64,
}

impl State {
    /// State at the start of the lag.
    pub(super) fn starting(x: f64) -> Self {
        if x.is_finite() { Self { value: x, slope: 0.0 } } else { Self { value: f64::NAN, slope: f64::NAN } }
    }

    /// The state at the next row, whose input is `next`.
    #[inline(always)]
    fn after(self, x: f64, gain: Gain, next: f64) -> Self {
        if !next.is_finite() || !x.is_finite() {
            return Self::starting(next);
        }
        let lead = x - self.value;
        Self { value: self.value + gain.gain * lead, slope: self.slope - gain.gain * self.slope + gain.slope * lead }
    }
}

/// Runs a lag over the rows of `x` (n), from its state at the first; `gains` has n - 1.
pub(super) fn lag(x: &[f64], gains: &[Gain], first: State, mut each: impl FnMut(State)) {
    let mut state = first;
    if !x.is_empty() {
        each(state);
    }
    for (pair, &gain) in x.windows(2).zip(gains) {
        state = state.after(pair[0], gain, pair[1]);
        each(state);
    }
}

/// Stamps and delays that differ by less, in nanoseconds, are equal: seconds as floats do not hit whole nanoseconds.
const SAME: f64 = 1e-3;

/// Place of `stamp[row] - delay`: the row at or before it, and the nanoseconds from that row (0 at a row; negative
/// before the first row).
///
/// `at` is that of an earlier row, or 0.
fn bracket(stamps: &[i64], row: usize, delay: f64, mut at: usize) -> (usize, f64) {
    let beyond = |k: usize| (stamps[row] - stamps[k]) as f64 - delay;
    while at < row && beyond(at + 1) >= -SAME {
        at += 1;
    }
    let rest = beyond(at);
    (at, if rest.abs() <= SAME { 0.0 } else { rest })
}

/// Interpolation of `x` at the stamps of `rows` less `delay` seconds: value and derivative with respect to the delay.
///
/// `stamps` and `x` reach back far enough, or to the episode's first row. Missing before that, and where a row that is needed is missing.
pub(super) fn delayed(stamps: &[i64], x: &[f64], rows: Range<usize>, delay: f64, mut each: impl FnMut(f64, f64)) {
    let mut at = 0;
    for row in rows {
        let rest;
        (at, rest) = bracket(stamps, row, 1e9 * delay, at);
        // A delay is not negative: there is a row behind one that it does not meet.
        let last = if rest > 0.0 { at + 1 } else { at };
        if rest < 0.0 || !x[at..=last].iter().all(|x| x.is_finite()) {
            each(f64::NAN, f64::NAN);
            continue;
        }
        let slope = |k: usize| (x[k + 1] - x[k]) / ((stamps[k + 1] - stamps[k]) as f64 * 1e-9);
        if rest > 0.0 {
            each(x[at] + slope(at) * (1e-9 * rest), -slope(at));
            continue;
        }
        let before = if at > 0 { slope(at - 1) } else { f64::NAN };
        let after = if at < row { slope(at) } else { f64::NAN };
        let mean = match (before.is_finite(), after.is_finite()) {
            (true, true) => 0.5 * (before + after),
            (true, false) => before,
            (false, true) => after,
            // Nothing says how a single row moves.
            (false, false) => 0.0,
        };
        each(x[at], -mean);
    }
}

/// 0 at the rows before which `x` is there at every row for `span` seconds, with a row at or before the beginning; else NaN.
pub(super) fn present(stamps: &[i64], x: &[f64], rows: Range<usize>, span: f64, mut each: impl FnMut(f64)) {
    let (mut at, mut missing) = (0, None);
    for row in 0..rows.end {
        if !x[row].is_finite() {
            missing = Some(row);
        }
        if row >= rows.start {
            let rest;
            (at, rest) = bracket(stamps, row, 1e9 * span, at);
            let whole = rest >= 0.0 && missing.is_none_or(|missing| missing < at);
            each(if whole { 0.0 } else { f64::NAN });
        }
    }
}
