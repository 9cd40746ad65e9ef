//! One-sided differences over the actual time stamps.
//!
//! The derivative of a sampled signal, as an expression over neighbouring rows: the slope to the next row, from the last one, or to a row further ahead. An
//! angle's difference is wrapped to (-pi, pi] step by step, so that a jump between -pi and pi is a small rotation; it is right as long as the angle turns less
//! than half a turn a row.

use crate::Expr;

/// `(x[k+1] - x[k]) / (t[k+1] - t[k])`; `angle` wraps the difference.
pub fn forward_difference(x: &Expr, angle: bool) -> Expr {
    step(x, angle).shifted(-1) / step(&Expr::time(), false).shifted(-1)
}

/// `(x[k] - x[k-1]) / (t[k] - t[k-1])`; `angle` wraps the difference.
pub fn backward_difference(x: &Expr, angle: bool) -> Expr {
    step(x, angle) / step(&Expr::time(), false)
}

/// The mean slope to the row `rows` ahead, `(x[k+rows] - x[k]) / (t[k+rows] - t[k])`; `angle` wraps the steps and adds them. `rows` is at least 1.
///
/// Noise of x makes an error in it that falls with the span, where that of a difference over one row does not depend on how long the log is.
pub fn mean_slope(x: &Expr, rows: u32, angle: bool) -> Expr {
    let (rows, time) = (rows.max(1) as i32, Expr::time());
    rise(x, 0, rows, angle) / (time.shifted(-rows) - time)
}

/// Over how many rows an expression is the [`mean_slope`] of `x`, where it is one over more than one row.
pub fn mean_slope_rows(expression: &Expr, x: &Expr) -> Option<u32> {
    let rows = expression.reach().1;
    let is_slope = |angle| *expression == mean_slope(x, rows, angle);
    (rows > 1 && (is_slope(false) || is_slope(true))).then_some(rows)
}

/// The rise of `x` from the row `from` ahead to the row `to` ahead; `angle` wraps the steps and adds them.
pub(crate) fn rise(x: &Expr, from: i32, to: i32, angle: bool) -> Expr {
    if !angle {
        return x.shifted(-to) - x.shifted(-from);
    }
    let (low, high) = (from.min(to), from.max(to));
    let steps = (low + 1..=high).rev().map(|ahead| step(x, true).shifted(-ahead));
    let sum = steps.reduce(|sum, next| sum + next).unwrap_or(Expr::number(0.0));
    if from <= to { sum } else { -sum }
}

/// `x[k] - x[k-1]`.
fn step(x: &Expr, angle: bool) -> Expr {
    let rise = x - x.shifted(1);
    if angle { rise.wrap() } else { rise }
}
