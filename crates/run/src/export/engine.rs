//! The engine's values at test vectors: each is a separate episode.

use fleetfoot_codegen::{ExportOptions, Signals, StepMethod, TestResult, TestVector, signals};
use fleetfoot_data::{Column, MemorySource, Silent, Source};
use fleetfoot_dynamics::{
    End, Method, Predicted, Predictor, PredictorWorkspace, RolloutOptions, Simulator, Start, Step, Trajectory,
};
use fleetfoot_fit::Error;
use fleetfoot_model::{Model, Prediction};

/// Code of a label that was not seen in training.
const NO_REGION: i64 = -32767;

/// Replaces the next states and the outputs by the engine's.
pub(super) fn replace(model: &Model, options: &ExportOptions, vectors: &mut [TestVector]) -> Result<(), Error> {
    if vectors.is_empty() {
        return Ok(());
    }
    let names = signals(model, options)?;
    // The code's columns are those of the model with everything computed.
    let step = options.discretize.unwrap_or(model.step);
    let model = &model.closed(step, &[]).map_err(fleetfoot_dynamics::Error::from)?.model;
    if !names.states.is_empty() {
        next_states(model, options, &names, vectors)?;
    }
    let fitted = |name: &String| model.fitted().any(|e| e.prediction == Prediction::Value && e.subject == *name);
    if names.outputs.iter().any(fitted) {
        outputs(model, &names, vectors)?;
    }
    Ok(())
}

/// The recording of a vector: its earlier rows, the present one, the next. Also the present row.
fn recording(model: &Model, names: &Signals, vector: &TestVector, needed: usize) -> (MemorySource, usize) {
    let depth = names.past.iter().map(|past| past.1).max().unwrap_or(0).max(needed).max(1);
    // Time is counted from the first row.
    let present = depth.max((vector.t / vector.dt).round() as usize);
    let rows = present + 2;
    let mut columns = Vec::new();
    let mut values = Vec::new();
    for column in &model.columns {
        let now = [(&names.states, &vector.x), (&names.inputs, &vector.u)]
            .into_iter()
            .find_map(|(names, values)| Some(values[names.iter().position(|name| *name == column.name)?]));
        let mut series = vec![now.unwrap_or(0.0); rows];
        let input = names.inputs.iter().position(|name| *name == column.name);
        if let Some(next) = input.and_then(|input| vector.u_next.get(input)) {
            series[present + 1] = *next;
        }
        let mut offset = 0;
        for (name, depth) in &names.past {
            if name.as_ref() == Some(&column.name) {
                series[present - depth..present].copy_from_slice(&vector.past[offset..offset + depth]);
            }
            offset += depth;
        }
        columns.push(Column::float(&column.name));
        values.push(series);
    }
    let mut source = MemorySource::new(columns);
    source.push_uniform("vector", vector.dt, values);
    (source, present)
}

fn next_states(
    model: &Model,
    options: &ExportOptions,
    names: &Signals,
    vectors: &mut [TestVector],
) -> Result<(), Error> {
    let simulator = Simulator::new(model)?;
    for vector in vectors {
        let (source, row) = recording(model, names, vector, simulator.needed_rows(1).before);
        let mut rollout = RolloutOptions::new(1);
        rollout.step = Step::Seconds(vector.dt);
        rollout.divergence = f64::INFINITY;
        rollout.method = match options.method {
            StepMethod::Euler => Method::Euler,
            StepMethod::Rk4 => Method::Rk4,
        };
        let start = Start { episode: 0, row };
        let trajectory = simulator.trajectories(&source, &[start], &rollout, &Silent)?.pop().flatten();
        let Some(trajectory) = trajectory else { continue };
        if let Some(result) = vector.results.iter_mut().find(|result| result.function == "next") {
            let (code, values) = step(&trajectory, options.domain, result);
            take("next", result, code, &values)?;
        }
    }
    Ok(())
}

/// Code and next states of a rollout of one step.
fn step(trajectory: &Trajectory, domain: bool, result: &TestResult) -> (i64, Vec<f64>) {
    match (trajectory.end, trajectory.regions.first()) {
        (End::NoRegion, _) => (NO_REGION, Vec::new()),
        (_, Some(&region)) => {
            let left = domain && trajectory.left_domain == Some(0);
            let code = if left { -1 - i64::from(region) } else { i64::from(region) };
            (code, trajectory.state(1).to_vec())
        }
        // A diverging model gives nothing to compare.
        (_, None) => (result.code, result.values.clone()),
    }
}

fn outputs(model: &Model, names: &Signals, vectors: &mut [TestVector]) -> Result<(), Error> {
    let columns: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
    let predictor = Predictor::new(model, &columns)?;
    let (mut workspace, mut predicted) = (PredictorWorkspace::default(), Predicted::default());
    for vector in vectors {
        let (source, row) = recording(model, names, vector, predictor.halo().before);
        let block = source.read(0, row..row + 1, predictor.halo())?;
        predictor.predict(&block, 0..1, &mut workspace, &mut predicted);
        let Some(result) = vector.results.iter_mut().find(|result| result.function == "predict") else { continue };
        if result.code <= NO_REGION + 1 {
            continue;
        }
        // Only what was fitted is predicted; given outputs keep the values that they have.
        let mut values = result.values.clone();
        for (equation, name) in predictor.names().iter().enumerate() {
            let output = names.outputs.iter().position(|output| output == name);
            let value = Predicted::equation(&predicted.predicted, 1, equation)[0];
            if let (Some(output), true) = (output, value.is_finite()) {
                values[output] = value;
            }
        }
        take("predict", result, result.code, &values)?;
    }
    Ok(())
}

/// Takes the engine's values where they are the code's up to rounding.
fn take(function: &str, result: &mut TestResult, code: i64, values: &[f64]) -> Result<(), Error> {
    if code != result.code {
        return Err(Error::internal(format!(
            "the exported `{function}` gives the code {} where the engine gives {code}; please report this model",
            result.code
        )));
    }
    for (index, (computed, (value, room))) in
        result.values.iter_mut().zip(values.iter().zip(&result.tolerances)).enumerate()
    {
        let error = (*value - *computed).abs();
        if error > *room || error.is_nan() {
            return Err(Error::internal(format!(
                "value {index} of the exported `{function}` is {computed:e} where the engine gives {value:e}, more than rounding explains ({room:e}); please report this model"
            )));
        }
        *computed = *value;
    }
    Ok(())
}
