//! Equations: the predicted quantity, and its right side.

use fleetfoot_library::{CentralDifference, Expr, REACHES, Spacing, mean_slope_rows};

/// Quantity that an equation predicts for its subject.
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
    /// The column of the left side; for [`Prediction::Value`] the predicted column.
    pub subject: String,
    /// Predicted quantity of the subject.
    pub prediction: Prediction,
    /// The right side, over the model's columns and the latents' names.
    pub right: Expr,
    /// Measured left side on a recording, over the model's columns (with leads and `time()`). `None` for an equation
    /// that was given, not fitted.
    pub target: Option<Expr>,
    /// The unit of the left side, when known.
    pub unit: Option<String>,
}

impl Equation {
    /// The left side, for people: `d(vx)/dt`, `d(vx)/dt over 20 rows` where it is measured as the mean slope to 20 rows ahead, `next(y)`, `delta(y)`, `force`.
    pub fn label(&self) -> String {
        let subject = &self.subject;
        match self.prediction {
            Prediction::Derivative => match self.span() {
                None => format!("d({subject})/dt"),
                Some(rows) => format!("d({subject})/dt over {rows} rows"),
            },
            Prediction::Next => format!("next({subject})"),
            Prediction::Difference => format!("delta({subject})"),
            Prediction::Value => subject.clone(),
        }
    }

    /// Rows ahead over which the subject's mean slope measures the derivative; `None` if it is measured at the row
    /// itself.
    pub fn span(&self) -> Option<u32> {
        let target = self.target.as_ref().filter(|_| self.prediction == Prediction::Derivative)?;
        mean_slope_rows(target, &Expr::column(self.subject.as_str()))
    }

    /// The measured left side, as text. A difference of higher order of the subject stands by its name, `central6(vx)`,
    /// which is far shorter than its formula.
    pub fn target_text(&self) -> Option<String> {
        let target = self.target.as_ref()?;
        let of = Expr::column(self.subject.as_str());
        let named = REACHES.into_iter().skip(1).map(|reach| {
            let difference = CentralDifference { of: of.clone(), angle: false, reach, spacing: Spacing::Stamps };
            (difference.order(), difference.expression())
        });
        let mut same = named.filter(|(_, expression)| expression == target);
        Some(same.next().map_or_else(|| target.to_string(), |(order, _)| format!("central{order}({of})")))
    }
}
