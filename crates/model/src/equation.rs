//! Equations: what is predicted, and how it follows.

use fleetfoot_library::Expr;

/// What an equation predicts of its subject.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Prediction {
    /// The time derivative, per second.
    Derivative,
    /// The value one sample later.
    Next,
    /// The change over one sample.
    Difference,
    /// The value of the same row: plain regression y = f(x).
    Value,
}

/// One equation: `d(subject)/dt = right`, `next(subject) = right`, ...
#[derive(Debug, Clone, PartialEq)]
pub struct Equation {
    /// The column that it speaks of; for [`Prediction::Value`] the column predicted.
    pub subject: String,
    /// What of the subject is predicted.
    pub prediction: Prediction,
    /// The right side, over the model's columns and the latents' names.
    pub right: Expr,
    /// How the left side is measured on a recording, over the model's columns (with leads and `time()`).
    /// `None` for an equation that was given, not fitted.
    pub target: Option<Expr>,
    /// The unit of the left side, when known.
    pub unit: Option<String>,
}

impl Equation {
    /// The left side, for people: `d(vx)/dt`, `next(y)`, `delta(y)`, `force`.
    pub fn label(&self) -> String {
        let subject = &self.subject;
        match self.prediction {
            Prediction::Derivative => format!("d({subject})/dt"),
            Prediction::Next => format!("next({subject})"),
            Prediction::Difference => format!("delta({subject})"),
            Prediction::Value => subject.clone(),
        }
    }
}
