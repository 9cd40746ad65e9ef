//! The models: their columns, equations and regions.

use fleetfoot_model::{Column, Definition, Equation as ModelEquation, Latent, Model, Prediction, Role, SetEquation};
use fleetfoot_report::{Cell, Equation, Math, Part, Section, Table};

use crate::{Judged, excitation, fitting, fitting::Fit, intervals, limits, regions, transitions, verdict};

/// Columns that stand unfolded.
const COLUMNS: usize = 8;
/// Regions whose equations stand unfolded; the others are a click away.
const UNFOLDED: usize = 1;
/// Regions whose equations are written of each of several models; of one alone [`regions::SHOWN`].
const OF_SEVERAL: usize = 2;
/// Terms of an equation that are set, and equations: more cannot be read.
const TERMS: usize = 60;
const EQUATIONS: usize = 24;

pub(crate) fn section(judged: &[Judged<'_>], fits: &[Fit]) -> Section {
    let one = judged.len() == 1;
    let mut known = Vec::new();
    let parts = judged.iter().enumerate().flat_map(|(place, judged)| {
        let shown = if one { regions::SHOWN } else { OF_SEVERAL };
        let mut parts = parts(judged.model, place + 1, shown, Fit::of(fits, judged.model));
        parts.extend(excitation_parts(judged, place + 1, &mut known));
        parts.push(columns(judged.model));
        if one {
            return parts;
        }
        let findings = std::iter::once(verdict::fitted(judged)).chain(verdict::of_model(judged)).collect();
        let heading = Part::Heading(judged.name.to_owned());
        vec![heading, Part::Findings(findings), Part::Fold("Equations and regions".into(), parts)]
    });
    let parts: Vec<Part> = parts.chain(limits::parts(judged, fits)).chain(fitting::parts(judged, fits)).collect();
    Section::new("model", if one { "Model" } else { "Models" }, parts)
}

/// Parts about the excitation of a model's training rows; a reference if they equal those of a model before. `known`:
/// names of models, with their parts.
fn excitation_parts<'a>(judged: &Judged<'a>, number: usize, known: &mut Vec<(&'a str, Vec<Part>)>) -> Vec<Part> {
    let parts = excitation::parts(judged.model, number);
    // Figures have addresses of their own, and their numbers may differ by rounding; captions have what matters of them.
    let same = |(a, b): (&Part, &Part)| match (a, b) {
        (Part::Figure(a), Part::Figure(b)) => a.caption == b.caption,
        (a, b) => a == b,
    };
    let twin = known.iter().find(|(_, other)| other.len() == parts.len() && other.iter().zip(&parts).all(same));
    match twin {
        Some((name, _)) if !parts.is_empty() => {
            vec![Part::Paragraph(format!("Its training rows separate the same functions as those of {name}."))]
        }
        _ => {
            known.push((judged.name, parts.clone()));
            parts
        }
    }
}

/// A model; `number` distinguishes its figures from those of the others, and the equations of `shown` regions appear.
/// `fit` is the report of its fit.
fn parts(model: &Model, number: usize, shown: usize, fit: Option<&Fit>) -> Vec<Part> {
    let mut parts = vec![Part::Paragraph(about(model))];
    let given: Vec<Equation> = (model.equations.iter())
        .filter(|equation| !is_by_region(model, equation))
        .map(|equation| set(model.set_equation(equation, 0), origin(equation)))
        .collect();
    parts.extend(capped(given));
    let shared: Vec<Equation> = (model.latents.iter())
        .filter(|latent| is_shared(model, latent) && latent.map.regions() == 1)
        .map(|latent| set(model.set_latent(latent, 0), String::new()))
        .collect();
    parts.extend(capped(shared));
    parts.extend(model.definitions().iter().map(basis));
    parts.extend(intervals::parameters(model));
    let mut printed = None;
    for partition in 0..model.partitions.len() {
        parts.extend(by_region(model, partition, shown, fit, &mut printed));
        let name = format!("{number}-{}", partition + 1);
        let (rules, seen) = (&model.partitions[partition], &model.summaries[partition]);
        let walked = rules.transitions.as_ref();
        let walked = walked
            .and_then(|counted| transitions::figure((rules, seen), counted, model.step, &name, "the training rows"));
        parts.extend(walked.map(Part::Figure));
        let along =
            rules.phases.as_ref().and_then(|phases| transitions::along((rules, seen), phases, model.step, &name));
        parts.extend(along.map(Part::Figure));
    }
    parts
}

/// Functions that latents have beside those of their library, with the numbers of each.
fn basis(definition: &Definition) -> Part {
    let head = std::iter::once("function".to_owned()).chain(definition.head.iter().cloned());
    let mut table = Table::new(format!("{}.", definition.text), head);
    for (name, values) in &definition.rows {
        let numbers = values.iter().map(|&value| Cell::of(value));
        table = table.row(std::iter::once(Cell::Text(name.clone())).chain(numbers));
    }
    Part::Fold(format!("{} basis functions", definition.rows.len()), vec![Part::Table(table)])
}

fn about(model: &Model) -> String {
    let continuous = model.equations.iter().any(|equation| equation.prediction == Prediction::Derivative);
    let kind = match (model.is_discrete(), continuous) {
        (true, _) => "It goes from row to row",
        (false, true) => "It is continuous in time",
        (false, false) => "It predicts values of the same row, and advances no state",
    };
    let step = if model.step > 0.0 {
        format!("; its training rows are {} apart", fleetfoot_report::words::seconds(model.step))
    } else {
        String::new()
    };
    let coefficients = if model.latents.is_empty() {
        ""
    } else {
        " Coefficients are written with four digits; the model file has all of them."
    };
    format!("{kind}{step}.{coefficients}")
}

/// Returns true if an equation is a fitted function that differs from region to region.
fn is_by_region(model: &Model, equation: &ModelEquation) -> bool {
    model.latent_of(equation).is_some_and(|latent| latent.map.regions() > 1)
}

/// Returns true if a fitted function stands in equations by its name.
fn is_shared(model: &Model, latent: &Latent) -> bool {
    !model.equations.iter().any(|equation| model.latent_of(equation).is_some_and(|other| other.name == latent.name))
}

/// An equation as it is set; of very many terms the first ones.
fn set(equation: SetEquation, mut note: String) -> Equation {
    let terms = equation.terms.len();
    if terms > TERMS {
        note.push_str(&format!("and {} more terms, which are in the model file", terms - TERMS));
    }
    let pieces = std::iter::once(equation.left).chain(equation.terms.into_iter().take(TERMS)).map(Math::new).collect();
    Equation { pieces, note }
}

/// The first of some equations, and how many there are more.
fn capped(mut equations: Vec<Equation>) -> Vec<Part> {
    let more = equations.len().saturating_sub(EQUATIONS);
    equations.truncate(EQUATIONS);
    let shown = (!equations.is_empty()).then_some(Part::Equations(equations));
    let rest = (more > 0).then(|| Part::Paragraph(format!("{more} more equations are in the model file.")));
    shown.into_iter().chain(rest).collect()
}

/// Origin of an equation that is not fitted: `given`; empty for a fitted one.
fn origin(equation: &ModelEquation) -> String {
    if equation.target.is_none() { "given".into() } else { String::new() }
}

/// The equations of the regions of a partition, and the table of regions.
fn by_region(
    model: &Model,
    partition: usize,
    shown: usize,
    fit: Option<&Fit>,
    printed: &mut Option<String>,
) -> Vec<Part> {
    let summary = &model.summaries[partition];
    if !model.latents.iter().any(|latent| latent.partition == partition) || summary.regions.is_empty() {
        return Vec::new();
    }
    if summary.regions.len() < 2 {
        let known = intervals::parts(model, partition, 0, fit, printed);
        return std::iter::once(Part::Paragraph(regions::alone(model, partition))).chain(known).collect();
    }
    let mut parts = regions::tables(model, partition);
    let order = summary.by_size();
    for (rank, &region) in order.iter().take(shown).enumerate() {
        let mut equations = capped(in_region(model, partition, region));
        equations.extend(intervals::parts(model, partition, region, fit, printed));
        let name = format!("Region {}", summary.regions[region].name);
        if rank < UNFOLDED {
            parts.push(Part::Heading(format!("{name}, the largest")));
            parts.extend(equations);
        } else {
            parts.push(Part::Fold(format!("{name}: its equations"), equations));
        }
    }
    if order.len() > shown {
        let rest = order.len() - shown;
        parts.push(Part::Paragraph(format!("The equations of {rest} smaller regions are in the model file.")));
    }
    parts
}

fn in_region(model: &Model, partition: usize, region: usize) -> Vec<Equation> {
    let here = |latent: &Latent| latent.partition == partition;
    let equations = model.equations.iter().filter(|equation| model.latent_of(equation).is_some_and(here));
    let equations = equations.map(|equation| set(model.set_equation(equation, region), String::new()));
    let shared = model.latents.iter().filter(|latent| here(latent) && is_shared(model, latent));
    let shared = shared.map(|latent| set(model.set_latent(latent, region), String::new()));
    equations.chain(shared).collect()
}

fn columns(model: &Model) -> Part {
    let mut table =
        Table::new("Columns that the model reads, and their fields in the log.", ["column", "part", "unit", "field"]);
    for column in &model.columns {
        table = table.row(row(column));
    }
    if model.columns.len() > COLUMNS {
        Part::Fold(format!("Its {} columns", model.columns.len()), vec![Part::Table(table)])
    } else {
        Part::Table(table)
    }
}

fn row(column: &Column) -> Vec<Cell> {
    let part = match column.role {
        Role::State => "state",
        Role::Input => "input",
        Role::Auxiliary => "read beside",
    };
    let part = if column.angle { format!("{part}, angle") } else { part.to_owned() };
    let unit = fleetfoot_report::words::unit(column.unit.as_deref().unwrap_or_default());
    let source = if column.source == column.name { String::new() } else { column.source.clone() };
    [column.name.clone(), part, unit, source].map(Cell::Text).to_vec()
}
