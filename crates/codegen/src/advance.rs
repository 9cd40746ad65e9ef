//! One step of time as code, in the engine's order: slopes, a step of Euler or Runge-Kutta, angles wrapped, rotations brought back.

use fleetfoot_library::{Binary, Unary};
use fleetfoot_model::{Prediction, RotationKind};

use crate::{
    code::{Argument, Function, Index, Kind, Outcome, Parameter, Place, Real, Statement},
    jacobian::unless_failed,
    options::StepMethod,
    plan::{Advance, Plan, Source},
};

impl Plan<'_> {
    /// `code = next(x, u, past, t, dt, n)`: the states one step later. `step` is the step's length where it is fixed.
    pub(crate) fn next(&self, method: StepMethod, step: Option<f64>) -> Function {
        let count = self.states.len();
        let mut parameters = self.parameters();
        if self.continuous() && step.is_none() {
            parameters.push(Parameter { name: "dt", kind: Kind::Value });
        }
        parameters.push(Parameter { name: "n", kind: Kind::Out(count) });
        let dt = || step.map_or_else(|| Real::local("dt"), Real::Number);
        let mut body = vec![Statement::Array("k1".into(), count)];
        body.extend(self.slopes("code", "x", Real::local("t"), "k1"));
        if self.continuous() && method == StepMethod::Rk4 {
            body.extend(self.stages(&dt));
        }
        let i = || Index::local("i");
        for run in self.runs() {
            let (x, f) = (Real::at("x", i()), Real::at("k1", i()));
            let value = match self.states[run.start].advance {
                Advance::Lag(constant) => {
                    let gain = match step {
                        Some(step) => Real::Number(-(-step / constant).exp_m1()),
                        None => lag_gain(Real::local("dt"), constant),
                    };
                    x.clone().plus(gain.times(f.minus(x)))
                }
                Advance::Equation(Prediction::Derivative) if method == StepMethod::Rk4 => {
                    // (k1 + 2 k2 + 2 k3 + k4) / 6
                    let twice = |name: &str| Real::Number(2.0).times(Real::at(name, i()));
                    let mean = f.plus(twice("k2")).plus(twice("k3").plus(Real::at("k4", i())));
                    x.plus(dt().times(mean).times(Real::Number(1.0 / 6.0)))
                }
                Advance::Equation(Prediction::Derivative) => x.plus(dt().times(f)),
                Advance::Equation(Prediction::Difference) => x.plus(f),
                Advance::Equation(Prediction::Next | Prediction::Value) => f,
            };
            let value = if self.states[run.start].signal.angle { Real::unary(Unary::Wrap, value) } else { value };
            body.push(range("i", run, vec![Statement::set("n", i(), value)]));
        }
        body.extend(self.retractions());
        body.push(Statement::Return(Outcome::Same("code".into())));
        Function { name: "next", gives: true, parameters, body }
    }

    /// Brings the rotations in `n` back: quaternions to unit length, rotation vectors to half a turn at most, `n wrap(|n|)/|n|`.
    fn retractions(&self) -> Vec<Statement> {
        let mut body = Vec::new();
        for (number, (rotation, places)) in self.rotations().into_iter().enumerate() {
            let length = format!("length{number}");
            let square = |&place: &usize| Real::at("n", place).times(Real::at("n", place));
            let sum = Real::Sum(places.iter().map(square).collect());
            body.push(Statement::Let(length.clone(), Real::unary(Unary::Sqrt, sum)));
            let length = || Real::local(&length);
            match rotation.kind {
                RotationKind::Quaternion => body.extend(places.iter().map(|&place| {
                    Statement::set("n", place, Real::binary(Binary::Div, Real::at("n", place), length()))
                })),
                RotationKind::Vector => {
                    // A length of zero divides nothing.
                    let divisor = Real::binary(Binary::Max, length(), Real::Number(1e-30));
                    let factor = format!("factor{number}");
                    let share = Real::binary(Binary::Div, Real::unary(Unary::Wrap, length()), divisor);
                    body.push(Statement::Let(factor.clone(), share));
                    let shortened =
                        |&place: &usize| Statement::set("n", place, Real::at("n", place).times(Real::local(&factor)));
                    body.extend(places.iter().map(shortened));
                }
            }
        }
        body
    }

    /// `result = right_sides(at, u, past, t, to)`, and back if it failed.
    fn slopes(&self, result: &str, at: &str, time: Real, to: &str) -> Vec<Statement> {
        let mut arguments = self.arguments(at, time);
        arguments.push(Argument::Out(to.to_owned()));
        vec![Statement::Call { result: result.to_owned(), function: "right_sides", arguments }, unless_failed(result)]
    }

    fn arguments(&self, at: &str, time: Real) -> Vec<Argument> {
        self.parameters()
            .iter()
            .map(|parameter| match (parameter.name, parameter.kind) {
                ("x", _) => Argument::In(at.to_owned()),
                (_, Kind::Value) => Argument::Value(time.clone()),
                (name, _) => Argument::In(name.to_owned()),
            })
            .collect()
    }

    /// The later stages of the classical Runge-Kutta method.
    fn stages(&self, dt: &dyn Fn() -> Real) -> Vec<Statement> {
        let count = self.states.len();
        let mut body = vec![Statement::Array("z".into(), count)];
        for (stage, (before, slope)) in [("k1", "k2"), ("k2", "k3"), ("k3", "k4")].into_iter().enumerate() {
            let offset = || if stage == 2 { dt() } else { dt().times(Real::Number(0.5)) };
            let i = || Index::local("i");
            for run in self.runs() {
                let x = Real::at("x", i());
                let value = match self.states[run.start].advance {
                    Advance::Equation(Prediction::Derivative) => x.plus(offset().times(Real::at(before, i()))),
                    // Values that advance once a step are held within it.
                    _ => x,
                };
                body.push(range("i", run, vec![Statement::set("z", i(), value)]));
            }
            body.push(Statement::Array(slope.into(), count));
            let time = Real::local("t").plus(offset());
            body.extend(self.slopes(&format!("code{}", stage + 2), "z", time, slope));
        }
        body
    }

    /// Consecutive states that advance in the same way.
    fn runs(&self) -> Vec<std::ops::Range<usize>> {
        let kind = |i: usize| (self.states[i].advance, self.states[i].signal.angle);
        let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
        for i in 0..self.states.len() {
            match runs.last_mut() {
                Some(run) if kind(run.start) == kind(i) => run.end = i + 1,
                _ => runs.push(i..i + 1),
            }
        }
        runs
    }

    /// `remember(x, u, past, dt)`: the present row becomes the past. `step` is the step's length where it is fixed.
    pub(crate) fn remember(&self, step: Option<f64>) -> Option<Function> {
        if self.memory() == 0 {
            return None;
        }
        let reads = |source: &dyn Fn(Source) -> bool| self.delays.iter().any(|delay| source(delay.source));
        let ages = reads(&|source| source == Source::Time);
        let mut parameters = Vec::new();
        if reads(&|source| matches!(source, Source::State(_))) {
            parameters.push(Parameter { name: "x", kind: Kind::In(self.states.len()) });
        }
        if reads(&|source| matches!(source, Source::Input(_))) {
            parameters.push(Parameter { name: "u", kind: Kind::In(self.inputs.len()) });
        }
        if ages && step.is_none() {
            parameters.push(Parameter { name: "dt", kind: Kind::Value });
        }
        parameters.push(Parameter { name: "past", kind: Kind::Out(self.memory()) });
        let dt = || step.map_or_else(|| Real::local("dt"), Real::Number);
        let mut body = Vec::new();
        for delay in &self.delays {
            let older = Real::at("past", Index::local("i").plus(delay.offset + 1));
            let (older, newest) = match delay.source {
                Source::Time => (older.plus(dt()), dt()),
                source => (older, self.present(source)),
            };
            if delay.depth > 1 {
                let shift = Statement::Set(Place::at("past", Index::local("i").plus(delay.offset)), older);
                body.push(Statement::each("i", delay.depth - 1, vec![shift]));
            }
            body.push(Statement::set("past", delay.offset + delay.depth - 1, newest));
        }
        Some(Function { name: "remember", gives: false, parameters, body })
    }
}

/// `1 - exp(-dt/c)` as `2 t/(1 + t)` with `t = tanh(dt/(2 c))`: without loss of digits for short steps.
fn lag_gain(dt: Real, constant: f64) -> Real {
    let half = || Real::unary(Unary::Tanh, dt.clone().times(Real::Number(0.5 / constant)));
    let whole = Real::Number(1.0).plus(half());
    Real::binary(Binary::Div, Real::Number(2.0).times(half()), whole)
}

fn range(index: &str, run: std::ops::Range<usize>, body: Vec<Statement>) -> Statement {
    let turns = run.len();
    Statement::For { index: index.to_owned(), from: run.start.into(), to: run.end.into(), turns, body }
}
