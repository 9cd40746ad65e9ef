//! The derivative of a whole step: the chain rule through the stages of the integrator.

use crate::{
    code::{Argument, Function, Index, Kind, Outcome, Parameter, Place, Real, Statement},
    jacobian::unless_failed,
    options::StepMethod,
    plan::Plan,
};

/// A matrix of a stage: its name, its width, the block of `[A B]` that it is.
struct Block {
    slope: &'static str,
    result: &'static str,
    width: usize,
}

impl Plan<'_> {
    /// `code = next_jacobian(x, u, past, t, dt, A, B, c)`: the next states are `A x + B u + c` to first order, with inputs held
    /// over the step. With slopes `k_i = f(z_i)`, `z_1 = x`, `z_i = x + h_i k_(i-1)`: `dk_i/dx = F_i (I + h_i dk_(i-1)/dx)` and
    /// `dk_i/du = G_i + h_i F_i dk_(i-1)/du`, F and G the derivatives of f at the stage. Angles are not wrapped.
    pub(crate) fn next_jacobian(&self, method: StepMethod, step: Option<f64>) -> Function {
        let (n, m) = (self.states.len(), self.inputs.len());
        let mut parameters = self.parameters();
        if step.is_none() {
            parameters.push(Parameter { name: "dt", kind: Kind::Value });
        }
        for (name, length) in [("A", n * n), ("B", n * m), ("c", n)] {
            if length > 0 {
                parameters.push(Parameter { name, kind: Kind::Out(length) });
            }
        }
        let dt = || step.map_or_else(|| Real::local("dt"), Real::Number);
        let weights: &[f64] = match method {
            StepMethod::Euler => &[1.0],
            StepMethod::Rk4 => &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0],
        };
        let mut blocks = vec![Block { slope: "ka", result: "A", width: n }];
        if m > 0 {
            blocks.push(Block { slope: "kb", result: "B", width: m });
        }
        let mut body = vec![Statement::Array("slope".into(), n), Statement::Array("z".into(), n)];
        body.extend(
            [("F", n * n), ("G", n * m), ("ka", n * n), ("kb", n * m)]
                .into_iter()
                .filter(|(_, length)| *length > 0)
                .map(|(name, length)| Statement::Array(name.into(), length)),
        );
        if weights.len() > 1 {
            body.push(Statement::Array("row".into(), n));
        }
        body.push(Statement::Array("rest".into(), n));
        body.extend(self.identity(&blocks));
        for (stage, weight) in weights.iter().enumerate() {
            let offset = match stage {
                0 => None,
                3 => Some(dt()),
                _ => Some(dt().times(Real::Number(0.5))),
            };
            body.extend(self.stage(stage, offset.as_ref(), &blocks));
            body.extend(accumulate(n, &blocks, &dt().times(Real::Number(*weight))));
        }
        body.push(remainder(n, m));
        body.push(Statement::Return(Outcome::Same("code1".into())));
        Function { name: "next_jacobian", gives: true, parameters, body }
    }

    /// `A = I`, `B = 0`, `c = x`.
    fn identity(&self, blocks: &[Block]) -> Vec<Statement> {
        let n = self.states.len();
        let zero = |block: &Block| {
            Statement::each(
                "i",
                n * block.width,
                vec![Statement::set(block.result, Index::local("i"), Real::Number(0.0))],
            )
        };
        let mut body: Vec<Statement> = blocks.iter().map(zero).collect();
        let i = || Index::local("i");
        body.push(Statement::each(
            "i",
            n,
            vec![
                Statement::set("A", i().times(n + 1), Real::Number(1.0)),
                Statement::set("c", i(), Real::at("x", i())),
            ],
        ));
        body
    }

    /// The slopes of a stage and their derivatives: `slope`, `ka`, `kb`.
    fn stage(&self, stage: usize, offset: Option<&Real>, blocks: &[Block]) -> Vec<Statement> {
        let (n, i) = (self.states.len(), || Index::local("i"));
        let before = Real::at("slope", i());
        let z = match offset {
            Some(offset) => Real::at("x", i()).plus(offset.clone().times(before)),
            None => Real::at("x", i()),
        };
        let time = offset.map_or_else(|| Real::local("t"), |offset| Real::local("t").plus(offset.clone()));
        let mut body = vec![Statement::each("i", n, vec![Statement::set("z", i(), z)])];
        let code = format!("code{}", stage + 1);
        for (function, outputs) in [("right_sides", &["slope"][..]), ("jacobian", &["F", "G", "rest"][..])] {
            let mut arguments = self.stage_arguments(&time);
            let outputs = outputs.iter().filter(|name| **name != "G" || blocks.len() > 1);
            arguments.extend(outputs.map(|name| Argument::Out((*name).to_owned())));
            let result = if function == "jacobian" { format!("slopes{}", stage + 1) } else { code.clone() };
            body.push(Statement::Call { result: result.clone(), function, arguments });
            body.push(unless_failed(&result));
        }
        body.extend(blocks.iter().map(|block| chain(n, offset, block)));
        body
    }

    fn stage_arguments(&self, time: &Real) -> Vec<Argument> {
        self.parameters()
            .iter()
            .map(|parameter| match (parameter.name, parameter.kind) {
                ("x", _) => Argument::In("z".into()),
                (_, Kind::Value) => Argument::Value(time.clone()),
                (name, _) => Argument::In(name.to_owned()),
            })
            .collect()
    }
}

/// `ka = F (I + h ka)`, column by column; or `kb = G + F h kb`.
fn chain(n: usize, offset: Option<&Real>, block: &Block) -> Statement {
    let (i, j, k) = (|| Index::local("i"), || Index::local("j"), || Index::local("k"));
    let direct = if block.slope == "ka" { "F" } else { "G" };
    let entry = |name: &str, row: Index, width: usize| Real::at(name, row.times(width).plus(j()));
    let set = |value: Real| Statement::set(block.slope, i().times(block.width).plus(j()), value);
    let Some(offset) = offset else {
        return Statement::each(
            "j",
            block.width,
            vec![Statement::each("i", n, vec![set(entry(direct, i(), block.width))])],
        );
    };
    let product = Real::at("F", i().times(n).plus(k())).times(Real::at("row", k()));
    Statement::each(
        "j",
        block.width,
        vec![
            // The column before it is overwritten.
            Statement::each(
                "k",
                n,
                vec![Statement::set("row", k(), offset.clone().times(entry(block.slope, k(), block.width)))],
            ),
            Statement::each(
                "i",
                n,
                vec![
                    Statement::Variable("sum".into(), entry(direct, i(), block.width)),
                    Statement::each("k", n, vec![Statement::Add(Place::Local("sum".into()), product)]),
                    set(Real::local("sum")),
                ],
            ),
        ],
    )
}

/// Adds a stage's share to the step and its derivatives.
fn accumulate(n: usize, blocks: &[Block], weight: &Real) -> Vec<Statement> {
    let i = || Index::local("i");
    let mut body: Vec<Statement> = blocks
        .iter()
        .map(|block| {
            let share = weight.clone().times(Real::at(block.slope, i()));
            Statement::each("i", n * block.width, vec![Statement::add(block.result, i(), share)])
        })
        .collect();
    let share = weight.clone().times(Real::at("slope", i()));
    body.push(Statement::each("i", n, vec![Statement::add("c", i(), share)]));
    body
}

/// `c = next - A x - B u`.
fn remainder(n: usize, m: usize) -> Statement {
    let (i, j) = (|| Index::local("i"), || Index::local("j"));
    let mut body = vec![Statement::Variable("left".into(), Real::at("c", i()))];
    for (matrix, vector, width) in [("A", "x", n), ("B", "u", m)] {
        if width > 0 {
            let product = Real::at(matrix, i().times(width).plus(j())).times(Real::at(vector, j()));
            let value = Real::local("left").minus(product);
            body.push(Statement::each("j", width, vec![Statement::Set(Place::Local("left".into()), value)]));
        }
    }
    body.push(Statement::set("c", i(), Real::local("left")));
    Statement::each("i", n, body)
}
