//! Baselines of a model: predictions that need no model.

use std::ops::Range;

use fleetfoot_data::{Block, Halo};
use fleetfoot_library::{Expr, Program, Scratch};
use fleetfoot_model::{Equation, Model, Prediction};

use crate::{
    Error,
    angle::wrap,
    predict::{overlap, wraps},
};

/// A prediction that needs no model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Baseline {
    /// The mean of the training rows; in a rollout every fitted right side is its training mean, and the given equations stand.
    Null,
    /// No change: the present value for a next value, 0 for a difference, and for a derivative the one measured one
    /// sample before.
    Persistence,
    /// The last change again: `x + (x - x_previous)` for a next value, the previous difference for a difference. For a
    /// derivative it is 0 (the state of which it is the rate keeps its value).
    ConstantVelocity,
    /// In a rollout, states that follow their references at once ([`RolloutOptions::references`](crate::RolloutOptions::references)).
    Reference,
}

impl Baseline {
    /// Its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            Baseline::Null => "null",
            Baseline::Persistence => "persistence",
            Baseline::ConstantVelocity => "constant velocity",
            Baseline::Reference => "reference",
        }
    }
}

/// Persistence and constant velocity, for one step: the measured targets of earlier rows.
pub(crate) struct OneStepBaselines {
    /// The targets one sample before.
    previous: Program,
    /// The targets two samples before, of those that are extrapolated. Separate, so that the others lose no row at a
    /// border for it.
    before: Program,
    forms: Vec<[Form; 2]>,
    wrapped: Vec<bool>,
}

/// Form of a baseline, by the targets one (`t1`) and two (`t2`) samples before.
#[derive(Clone, Copy, PartialEq)]
enum Form {
    Zero,
    Previous,
    Extrapolated,
}

/// The two baselines, in the order in which [`OneStepBaselines::predict`] gives them.
pub(crate) const ONE_STEP: [Baseline; 2] = [Baseline::Persistence, Baseline::ConstantVelocity];

/// Memory of [`OneStepBaselines::predict`].
#[derive(Default)]
pub(crate) struct BaselineWorkspace {
    previous: Vec<f64>,
    before: Vec<f64>,
    scratch: Scratch,
}

impl OneStepBaselines {
    /// Compiles the baselines of the fitted equations.
    pub(crate) fn new(model: &Model, columns: &[&str]) -> Result<Self, Error> {
        let equations: Vec<&Equation> = model.fitted().collect();
        let targets: Vec<Expr> = equations.iter().filter_map(|equation| equation.target.clone()).collect();
        let forms: Vec<[Form; 2]> = equations
            .iter()
            .map(|equation| match equation.prediction {
                Prediction::Derivative => [Form::Previous, Form::Zero],
                Prediction::Difference => [Form::Zero, Form::Previous],
                Prediction::Next | Prediction::Value => [Form::Previous, Form::Extrapolated],
            })
            .collect();
        // The measured target may look ahead by some rows: the last known target is as many rows back.
        let known = |target: &Expr| target.shifted(target.reach().1.max(1) as i32);
        let previous: Vec<Expr> = targets.iter().map(known).collect();
        let extrapolated = targets.iter().zip(&forms).filter(|(_, form)| form[1] == Form::Extrapolated);
        let before: Vec<Expr> = extrapolated.map(|(target, _)| target.shifted(2)).collect();
        Ok(Self {
            previous: Program::compile(&previous, columns)?,
            before: Program::compile(&before, columns)?,
            wrapped: equations.iter().map(|equation| wraps(model, equation)).collect(),
            forms,
        })
    }

    pub(crate) fn halo(&self) -> Halo {
        let (a, b) = (self.previous.halo(), self.before.halo());
        Halo { before: a.before.max(b.before), after: a.after.max(b.after) }
    }

    /// Predicts the core rows `rows`: per equation persistence, then constant velocity, `rows.len()` values each; NaN where unknown.
    pub(crate) fn predict(
        &self,
        block: &Block,
        rows: Range<usize>,
        workspace: &mut BaselineWorkspace,
        out: &mut Vec<f64>,
    ) {
        let BaselineWorkspace { previous, before, scratch } = workspace;
        evaluate(&self.previous, block, &rows, previous, scratch);
        evaluate(&self.before, block, &rows, before, scratch);
        let count = rows.len();
        out.clear();
        out.resize(count * self.forms.len() * 2, 0.0);
        let mut second = 0;
        for (equation, forms) in self.forms.iter().enumerate() {
            let t1 = &previous[equation * count..][..count];
            for (form, out) in forms.iter().zip(out[2 * equation * count..].chunks_exact_mut(count.max(1))) {
                match form {
                    Form::Zero => {}
                    Form::Previous => out.copy_from_slice(t1),
                    Form::Extrapolated => {
                        let t2 = &before[second * count..][..count];
                        second += 1;
                        for (value, (&t1, &t2)) in out.iter_mut().zip(t1.iter().zip(t2)) {
                            *value = t1 + if self.wrapped[equation] { wrap(t1 - t2) } else { t1 - t2 };
                        }
                    }
                }
            }
        }
    }
}

/// Evaluates a program on the core rows `rows`, outputs x rows; NaN where a lag or lead leaves the block.
pub(crate) fn evaluate(
    program: &Program,
    block: &Block,
    rows: &Range<usize>,
    out: &mut Vec<f64>,
    scratch: &mut Scratch,
) {
    out.clear();
    out.resize(program.outputs() * rows.len(), f64::NAN);
    let valid = overlap(rows, &program.valid_rows(block));
    if !valid.is_empty() && program.outputs() > 0 {
        let offset = valid.start - rows.start;
        program.evaluate_block(block, valid, &mut out[offset..], rows.len(), scratch);
    }
}
