//! A filter in C: the switched Kalman filter of a model with affine regions, with the operations of the engine in the engine's order.
//!
//! The C of the model decides the region of a state. One Rust function writes each C function around it: `moments` of
//! distributions, the `crossing` of borders if regions follow from the state, `coloured` noise, and the `step` that
//! calls them. `source` has their order.

mod coloured;
mod crossing;
mod header;
mod moments;
mod sizes;
mod source;
mod step;

use fleetfoot_control::filter::FilterTables;
use fleetfoot_model::Model;

use crate::{
    ExportError, ExportOptions, ExportedFile,
    assemble::closed,
    c_syntax::C,
    code::{Code, Table, Values},
    evaluation::Evaluation,
    lower::Lowering,
    names::check_prefix,
    plan::Plan,
};
use sizes::Filter;

/// The files `PREFIX_filter.h` and `PREFIX_filter.c` of a filter of a model.
///
/// # Errors
/// Those of [`export`](crate::export()).
pub fn export_filter(
    model: &Model,
    tables: &FilterTables,
    options: &ExportOptions,
) -> Result<Vec<ExportedFile>, ExportError> {
    check_prefix(&options.prefix)?;
    let closed = closed(model, options)?;
    let plan = Plan::new(&closed)?;
    let prefix = format!("{}_filter", options.prefix);
    let inputs: Vec<usize> =
        (plan.inputs.iter()).filter_map(|input| tables.inputs.iter().position(|name| *name == input.name)).collect();
    let c = C { precision: options.precision, prefix: &prefix };
    let filter = Filter::new(c, model, tables, inputs);
    let mut code = Code::default();
    let regions = partition_alone(&closed.model, plan.advance.as_ref())?;
    if let Some(evaluation) = regions.as_ref().filter(|_| filter.by_state) {
        let precision = options.precision;
        let mut lowering = Lowering { plan: &plan, evaluation, precision, domain: false, tag: "", tables: Vec::new() };
        code.functions.push(lowering.region_alone("region"));
        code.tables = lowering.tables;
    }
    code.tables.extend(constant_tables(&filter));
    Ok(vec![
        ExportedFile::text(format!("{prefix}.h"), filter.header()),
        ExportedFile::text(format!("{prefix}.c"), filter.source(&code)),
    ])
}

/// An evaluation of the reported partition's columns and nothing else.
fn partition_alone(model: &Model, advance: Option<&Evaluation>) -> Result<Option<Evaluation>, ExportError> {
    let Some((evaluation, reported)) = advance.and_then(|evaluation| Some((evaluation, evaluation.reported?))) else {
        return Ok(None);
    };
    let rule = &evaluation.partitions[reported];
    let columns: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
    let expressions = model.partitions[rule.partition].columns.clone();
    let cells = crate::evaluation::Cells {
        partition: rule.partition,
        first: 0,
        centre: rule.centre.clone(),
        scale: rule.scale.clone(),
        rule: rule.rule.clone(),
    };
    Ok(Some(Evaluation {
        features: crate::evaluation::program(&expressions, &columns)?,
        expressions,
        partitions: vec![cells],
        groups: Vec::new(),
        rights: crate::evaluation::program(&[], &columns)?,
        right_sides: Vec::new(),
        reported: Some(0),
        slots: Vec::new(),
    }))
}

fn constant_tables(filter: &Filter<'_>) -> Vec<Table> {
    let (tables, inputs, n, by_state) = (filter.tables, &filter.inputs, filter.n, filter.by_state);
    let reals = |name: &str, comment: &str, row: usize, values: Vec<f64>| Table {
        name: format!("${name}"),
        comment: comment.to_owned(),
        values: Values::Reals(values),
        row: row.max(1),
    };
    let all = |of: &[Vec<f64>]| of.iter().flatten().copied().collect::<Vec<_>>();
    let driven = |b: &Vec<f64>| -> Vec<f64> {
        let m = tables.inputs.len();
        (0..n).flat_map(|i| inputs.iter().map(move |&input| b[i * m + input])).collect()
    };
    let deviation = |of: &dyn Fn(f64) -> f64| tables.sensors.iter().map(|&(_, sigma)| of(sigma)).collect::<Vec<_>>();
    let mut made = vec![
        reals("a", "Of every region: the next states by the states.", n, all(&tables.a)),
        reals("c", "Of every region: the constant of the step.", n, all(&tables.c)),
        reals("q", "Of every region: the covariance of a step's noise.", n, all(&tables.q)),
        reals("variance", "The variance of every sensor.", 8, deviation(&|value| value * value)),
        // The engine keeps the root of it, and squares that again.
        reals(
            "start_variance",
            "The same, of a state that begins there.",
            8,
            deviation(&|value| (value * value).sqrt().powi(2)),
        ),
        reals(
            "prior_mean",
            "Where states begin that are not measured.",
            8,
            tables.prior.iter().map(|prior| prior[0]).collect(),
        ),
        reals(
            "prior_variance",
            "The variance of that.",
            8,
            tables.prior.iter().map(|prior| prior[1] * prior[1]).collect(),
        ),
        Table {
            name: "$sensor".into(),
            comment: "The state of every sensor.".into(),
            values: Values::Indices(tables.sensors.iter().map(|sensor| sensor.0).collect()),
            row: 16,
        },
    ];
    if !inputs.is_empty() {
        made.push(reals(
            "b",
            "Of every region: the next states by the inputs.",
            inputs.len(),
            tables.b.iter().flat_map(driven).collect(),
        ));
    }
    if by_state {
        made.push(reals("points", "Points of the standard normal distribution.", n, tables.points.clone()));
    }
    if let Some(colour) = &tables.colour {
        let q = colour.innovation.len().isqrt();
        made.push(reals("s", "Of every region: the next states by the residuals of the row.", q, all(&colour.s)));
        let columns = colour.coefficients.len().checked_div(q).unwrap_or(0);
        made.push(reals("phi", "Residuals by those of the rows before.", columns, colour.coefficients.clone()));
        made.push(reals("new", "The covariance of the innovations of the residuals.", q, colour.innovation.clone()));
        made.push(reals("lasting", "The covariance of residuals at any time.", columns, colour.stationary.clone()));
    }
    if let Some(transitions) = tables.transitions.as_ref().filter(|rows| rows.len() > 1) {
        made.push(reals("transition", "Probabilities from region to region.", transitions.len(), all(transitions)));
    }
    made
}
