//! Test vectors: points within the training range, the model's values there, and tolerances for rounding.

use fleetfoot_data::mix;
use fleetfoot_library::{Binary, Expr, Node, Unary};
use fleetfoot_model::Model;

use crate::{
    ExportError, ExportOptions,
    assemble::{Assembled, assemble, closed},
    code::Kind,
    interpret::{Interpreter, NOT_FINITE, Run},
    lower::NEXT_INPUTS,
    options::Precision,
};

/// A point of the model's variables, and the results of the code's functions there.
#[derive(Debug, Clone, PartialEq)]
pub struct TestVector {
    /// The states.
    pub x: Vec<f64>,
    /// The inputs.
    pub u: Vec<f64>,
    /// The inputs of the next row, where the model reads them; else empty.
    pub u_next: Vec<f64>,
    /// Earlier values, as the code keeps them.
    pub past: Vec<f64>,
    /// Seconds since the start.
    pub t: f64,
    /// Length of a step, seconds.
    pub dt: f64,
    /// Results of each function.
    pub results: Vec<TestResult>,
}

/// Result of a function of the code at a point.
#[derive(Debug, Clone, PartialEq)]
pub struct TestResult {
    /// The public name of the function: `derivative`, `next`, `predict`, `jacobian`, ...
    pub function: &'static str,
    /// The code.
    pub code: i64,
    /// The numbers, output by output.
    pub values: Vec<f64>,
    /// Tolerance of each number for code in the chosen precision.
    pub tolerances: Vec<f64>,
}

/// Names of the signals in the vectors.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Signals {
    /// Names of the states, in the order of the code.
    pub states: Vec<String>,
    /// Names of the inputs, in the order of the code.
    pub inputs: Vec<String>,
    /// True if the code takes the inputs of the next row too.
    pub next_inputs: bool,
    /// Names of the outputs.
    pub outputs: Vec<String>,
    /// Numbers of earlier rows: signal name (`None` for time), how many, oldest first.
    pub past: Vec<(Option<String>, usize)>,
}

/// Roundings, beyond the bound's first order, that a tolerance allows.
const ROOM: f64 = 8.0;

/// Names of a code's inputs and results.
///
/// # Errors
/// [`ExportError`].
pub fn signals(model: &Model, options: &ExportOptions) -> Result<Signals, ExportError> {
    let closed = closed(model, options)?;
    let assembled = assemble(model, &closed, options, options.precision)?;
    let plan = &assembled.plan;
    let name = |source| match source {
        crate::plan::Source::State(i) => plan.states.get(i).map(|state| state.signal.name.clone()),
        crate::plan::Source::Input(i) => plan.inputs.get(i).map(|input| input.name.clone()),
        crate::plan::Source::Time => None,
    };
    Ok(Signals {
        states: plan.states.iter().map(|state| state.signal.name.clone()).collect(),
        inputs: plan.inputs.iter().map(|input| input.name.clone()).collect(),
        next_inputs: plan.next_inputs,
        outputs: plan.outputs.iter().map(|output| output.name.clone()).collect(),
        past: plan.delays.iter().map(|delay| (name(delay.source), delay.depth)).collect(),
    })
}

/// Up to `count` points, drawn region by region within the training ranges, none so near to a border that rounding
/// could carry it across. The values are those of the code, interpreted in 64 bits; the tolerances are running error
/// bounds in the chosen precision.
///
/// # Errors
/// [`ExportError`].
pub fn test_vectors(
    model: &Model,
    options: &ExportOptions,
    count: usize,
    seed: u64,
) -> Result<Vec<TestVector>, ExportError> {
    let closed = closed(model, options)?;
    let assembled = assemble(model, &closed, options, options.precision)?;
    let mut vectors = Vec::with_capacity(count);
    let mut interpreter = Interpreter::new(&assembled.code, options.precision.roundoff());
    for attempt in 0..(40 * count as u64) {
        if vectors.len() == count {
            break;
        }
        let mut point = draw(&assembled, mix(mix(seed).wrapping_add(attempt)), attempt, options.precision);
        if evaluate(&assembled, &mut interpreter, &mut point, options.precision.roundoff()) {
            vectors.push(point);
        }
    }
    Ok(vectors)
}

/// Results of the code at the caller's points, near a border or not; replaces their `results`.
///
/// # Errors
/// [`ExportError`].
pub fn evaluate_at(
    model: &Model,
    options: &ExportOptions,
    mut points: Vec<TestVector>,
) -> Result<Vec<TestVector>, ExportError> {
    let closed = closed(model, options)?;
    let assembled = assemble(model, &closed, options, options.precision)?;
    let mut interpreter = Interpreter::new(&assembled.code, options.precision.roundoff());
    for point in &mut points {
        point.results.clear();
        for public in assembled.public() {
            if let Some(run) = call(&mut interpreter, public.inner.name, point) {
                point.results.push(result(public.name, &run, options.precision.roundoff()));
            }
        }
    }
    Ok(points)
}

/// Runs the public functions at a point; whether it is good as a test.
fn evaluate(assembled: &Assembled<'_>, interpreter: &mut Interpreter<'_>, point: &mut TestVector, unit: f64) -> bool {
    for public in assembled.public() {
        let Some(run) = call(interpreter, public.inner.name, point) else { return false };
        if run.ambiguous || run.code == NOT_FINITE {
            return false;
        }
        let result = result(public.name, &run, unit);
        if run.code > NOT_FINITE && result.tolerances.iter().chain(&result.values).any(|value| !value.is_finite()) {
            return false;
        }
        point.results.push(result);
    }
    true
}

/// Runs a function at a point.
fn call(interpreter: &mut Interpreter<'_>, function: &str, point: &TestVector) -> Option<Run> {
    let arrays = [
        ("x", point.x.as_slice()),
        ("u", point.u.as_slice()),
        (NEXT_INPUTS, point.u_next.as_slice()),
        ("past", point.past.as_slice()),
    ];
    interpreter.call(function, &arrays, &[("t", point.t), ("dt", point.dt)])
}

fn result(function: &'static str, run: &Run, unit: f64) -> TestResult {
    let all = || run.outputs.iter().flat_map(|(_, values)| values);
    TestResult {
        function,
        code: run.code,
        values: all().map(|bounded| bounded.value).collect(),
        tolerances: all().map(|bounded| ROOM * unit * bounded.error + f64::from(f32::MIN_POSITIVE) * unit).collect(),
    }
}

/// A number in [0, 1) at an address.
fn uniform(seed: u64, key: u64) -> f64 {
    (mix(seed.wrapping_add(mix(key))) >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
}

/// A point: every column within its range in a region.
fn draw(assembled: &Assembled<'_>, seed: u64, attempt: u64, precision: Precision) -> TestVector {
    let plan = &assembled.plan;
    let model = plan.model;
    let mut key = 0;
    let mut value = |name: &str| {
        key += 1;
        let label = label(model, name);
        let uniform = uniform(seed, key);
        let value = match label {
            Some(values) => values[((uniform * values.len() as f64) as usize).min(values.len() - 1)],
            None => {
                let [low, high] = range(model, name, attempt as usize);
                low + uniform * (high - low)
            }
        };
        precision.rounded(value)
    };
    let x = plan.states.iter().map(|state| value(&state.signal.name)).collect();
    let u = plan.inputs.iter().map(|input| value(&input.name)).collect();
    let next = plan.inputs.iter().filter(|_| plan.next_inputs);
    let u_next = next.map(|input| value(&input.name)).collect();
    let deepest = plan.delays.iter().map(|delay| delay.depth).max().unwrap_or(0);
    let dt = assembled.step.unwrap_or(if model.step > 0.0 { model.step } else { 0.01 });
    let mut past = Vec::with_capacity(plan.memory());
    for delay in &plan.delays {
        for row in 0..delay.depth {
            past.push(match delay.source {
                crate::plan::Source::State(i) => value(&plan.states[i].signal.name),
                crate::plan::Source::Input(i) => value(&plan.inputs[i].name),
                crate::plan::Source::Time => precision.rounded((delay.depth - row) as f64 * dt),
            });
        }
    }
    // As far from the start as the earlier rows need.
    let t = precision.rounded((attempt as usize + deepest) as f64 * dt);
    TestVector { x, u, u_next, past, t, dt: precision.rounded(dt), results: Vec::new() }
}

/// The values of a column that is a partition's label.
fn label<'a>(model: &'a Model, name: &str) -> Option<&'a [f64]> {
    model.partitions.iter().find_map(|partition| match &partition.rule {
        fleetfoot_model::Rule::Labels { values, .. } => {
            let is_label = partition.columns.last().and_then(|column| column.as_column()) == Some(name);
            (is_label && !values.is_empty()).then_some(values.as_slice())
        }
        _ => None,
    })
}

/// The range of a column that a region saw, from the statistics of the functions; without any, [-1, 1].
fn range(model: &Model, name: &str, region: usize) -> [f64; 2] {
    let mut range: Option<[f64; 2]> = None;
    for latent in &model.latents {
        let seen = &model.summaries[latent.partition].regions;
        let owner = model.latents.iter().find(|other| other.partition == latent.partition);
        let described = owner.is_some_and(|owner| owner.library == latent.library);
        let library = &model.libraries[latent.library];
        let function = library.iter().enumerate().find_map(|(at, function)| Some((at, origin(function, name)?)));
        if let (Some((function, origin)), true, false) = (function, described, seen.is_empty()) {
            let [low, high] = seen[region % seen.len()].range[function].map(|v| v + origin);
            if low.is_finite() && high.is_finite() && low <= high {
                let [l, h] = range.unwrap_or([low, high]);
                range = Some([l.max(low), h.min(high)]);
            }
        }
    }
    match range {
        Some([low, high]) if low <= high => [low, high],
        _ if model.column(name).is_some_and(|column| model.columns[column].angle) => {
            [-std::f64::consts::PI, std::f64::consts::PI]
        }
        _ => [-1.0, 1.0],
    }
}

/// The number c where a function is a column, `column - c`, or the latter as an angle.
fn origin(function: &Expr, name: &str) -> Option<f64> {
    match function.node() {
        Node::Column { .. } => (function.as_column() == Some(name)).then_some(0.0),
        Node::Binary(Binary::Sub, column, number) if column.as_column() == Some(name) => number.as_number(),
        Node::Unary(Unary::Wrap, inner) => origin(inner, name),
        _ => None,
    }
}

/// Names and lengths of a function's results, in the order of [`TestResult::values`].
pub(crate) fn parts(function: &crate::code::Function) -> Vec<(&'static str, usize)> {
    function
        .parameters
        .iter()
        .filter_map(|parameter| match parameter.kind {
            Kind::Out(length) => Some((parameter.name, length)),
            Kind::In(_) | Kind::Value => None,
        })
        .collect()
}
