//! Finite differences over the actual time stamps.
//!
//! The derivative of a sampled signal, as an expression over neighbouring rows: first order one-sided, and the central
//! difference, second order where the stamps are even. An angle's difference is wrapped to (-pi, pi] step by step, so that
//! a jump between -pi and pi is a small rotation; it is right as long as the angle turns less than half a turn a row.

use crate::Expr;

/// `(x[k+1] - x[k]) / (t[k+1] - t[k])`; `angle` wraps the difference.
pub fn forward_difference(x: &Expr, angle: bool) -> Expr {
    step(x, angle).shifted(-1) / step(&Expr::time(), false).shifted(-1)
}

/// `(x[k] - x[k-1]) / (t[k] - t[k-1])`; `angle` wraps the difference.
pub fn backward_difference(x: &Expr, angle: bool) -> Expr {
    step(x, angle) / step(&Expr::time(), false)
}

/// `(x[k+1] - x[k-1]) / (t[k+1] - t[k-1])`; `angle` wraps the two steps and adds them.
pub fn central_difference(x: &Expr, angle: bool) -> Expr {
    let time = Expr::time();
    let rise = if angle { step(x, true).shifted(-1) + step(x, true) } else { x.shifted(-1) - x.shifted(1) };
    rise / (time.shifted(-1) - time.shifted(1))
}

/// An estimate of the error of [`central_difference`]: a third of its difference from the one over twice the rows, `(D1 - D2) / 3` (Richardson). The error of
/// even stamps is `h^2 x'''/6` and this is it up to h^4; noise of the signal makes it 0.37 times as large as the error that it makes in the difference.
pub fn central_difference_error(x: &Expr, angle: bool) -> Expr {
    let time = Expr::time();
    let rise = if angle {
        (-2..2).map(|lag| step(x, true).shifted(lag)).reduce(|sum, next| sum + next).unwrap_or(Expr::number(0.0))
    } else {
        x.shifted(-2) - x.shifted(2)
    };
    (central_difference(x, angle) - rise / (time.shifted(-2) - time.shifted(2))) / Expr::number(3.0)
}

/// `x[k] - x[k-1]`.
fn step(x: &Expr, angle: bool) -> Expr {
    let rise = x - x.shifted(1);
    if angle { rise.wrap() } else { rise }
}
