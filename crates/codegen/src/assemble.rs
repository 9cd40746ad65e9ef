//! The whole code of a model: tables and functions.

use fleetfoot_model::{Closed, Model, Prediction};

use crate::{
    ExportError, ExportOptions,
    code::Code,
    evaluation::Evaluation,
    lower::Lowering,
    options::Precision,
    plan::{Advance, Plan},
    walk,
};

/// Most regions: a region and the codes of failures are numbers of 16 bits.
const MOST_REGIONS: usize = 30_000;

/// A model, its plan and its code, ready for printing in a language.
pub(crate) struct Assembled<'a> {
    /// The model as it was given.
    pub(crate) model: &'a Model,
    pub(crate) plan: Plan<'a>,
    pub(crate) code: Code,
    /// The step's length where it is not the caller's.
    pub(crate) step: Option<f64>,
}

/// The closed model, which the code evaluates: all columns that can be computed are.
pub(crate) fn closed(model: &Model, options: &ExportOptions) -> Result<Closed, ExportError> {
    options.validate()?;
    model.validate().map_err(ExportError::Inconsistent)?;
    Ok(model.closed(options.discretize.unwrap_or(model.step), &[])?)
}

/// Writes the code of a model, [`closed`].
pub(crate) fn assemble<'a>(
    source: &'a Model,
    closed: &'a Closed,
    options: &ExportOptions,
    precision: Precision,
) -> Result<Assembled<'a>, ExportError> {
    let model = &closed.model;
    let plan = Plan::new(closed)?;
    if options.discretize.is_some() && !plan.continuous() {
        return Err(ExportError::AlreadyDiscrete);
    }
    let most = model.partitions.iter().map(|partition| partition.rule.count()).max().unwrap_or(1);
    if most > MOST_REGIONS {
        return Err(ExportError::TooManyRegions { regions: most, most: MOST_REGIONS });
    }
    let step = options.discretize.or_else(|| (!plan.continuous()).then_some(model.step));
    let mut code = Code::default();
    if let Some(evaluation) = &plan.advance {
        let mut lowering = lowering(&plan, evaluation, options, precision, "");
        code.functions.push(lowering.right_sides("right_sides"));
        // The row of a lag is that of what it follows.
        let kind = |advance| if let Advance::Equation(kind) = advance { kind } else { Prediction::Next };
        let kinds: Vec<Prediction> = plan.states.iter().map(|state| kind(state.advance)).collect();
        code.functions.push(lowering.jacobian("jacobian", &kinds)?);
        code.tables.append(&mut lowering.tables);
        code.functions.push(plan.next(options.method, step));
        if plan.states.iter().all(|state| state.advance == Advance::Equation(Prediction::Derivative)) {
            code.functions.push(plan.next_jacobian(options.method, step));
        }
    }
    if let Some(evaluation) = &plan.predict {
        let mut lowering = lowering(&plan, evaluation, options, precision, "output_");
        code.functions.push(lowering.right_sides("outputs"));
        let kinds = vec![Prediction::Value; plan.outputs.len()];
        if !plan.states.is_empty() || !plan.inputs.is_empty() {
            code.functions.push(lowering.jacobian("outputs_jacobian", &kinds)?);
        }
        code.tables.append(&mut lowering.tables);
    }
    code.functions.extend(plan.remember(step));
    check_numbers(&code, precision)?;
    drop_unused_tables(&mut code);
    Ok(Assembled { model: source, plan, code, step })
}

fn lowering<'a>(
    plan: &'a Plan<'a>,
    evaluation: &'a Evaluation,
    options: &ExportOptions,
    precision: Precision,
    tag: &'static str,
) -> Lowering<'a> {
    Lowering { plan, evaluation, precision, domain: options.domain, tag, tables: Vec::new() }
}

/// Checks that every number is finite in the chosen precision.
fn check_numbers(code: &Code, precision: Precision) -> Result<(), ExportError> {
    let mut bad = None;
    walk::numbers(code, &mut |value, place| {
        if bad.is_none() && !(value.is_finite() && value.abs() <= precision.largest()) {
            bad = Some((value, place.to_owned()));
        }
    });
    match bad {
        Some((value, place)) if value.is_finite() => Err(ExportError::TooLarge { value, place }),
        Some((value, place)) => Err(ExportError::NotFinite { value, place }),
        None => Ok(()),
    }
}

/// Tables that no function reads would be warned about.
fn drop_unused_tables(code: &mut Code) {
    let mut used = std::collections::HashSet::new();
    for function in &code.functions {
        walk::names(&function.body, &mut |name| {
            used.insert(name.to_owned());
        });
    }
    code.tables.retain(|table| used.contains(&table.name));
}
