//! Bounds that a fit keeps, and their cost: maps that contract or are passive, coefficients, functions and parameters
//! with limits. They come from the report of the fit.

use fleetfoot_fit::{BoundedCandidate, BoundedMaps, LimitReport, TextTable, unexplained};
use fleetfoot_model::Model;
use fleetfoot_recipe::{Objective, Recipe};
use fleetfoot_report::{Cell, Part, Table};
use serde::Deserialize;
use serde_json::Value;

use crate::{
    Judged,
    fitting::{Fit, Priced},
};

/// Rows of a table of prices, at most.
const ROWS: usize = 24;

/// A partition that was compared, where maps are bounded.
#[derive(Deserialize)]
struct Partition {
    partition: String,
    #[serde(deserialize_with = "fleetfoot_dataset::json::number")]
    loss: f64,
    #[serde(deserialize_with = "fleetfoot_dataset::json::numbers")]
    r2: Vec<f64>,
    #[serde(deserialize_with = "fleetfoot_dataset::json::number")]
    free_loss: f64,
    stability: BoundedMaps,
}

/// Reason why intervals of least squares do not apply to a model's coefficients; `None` if they do. It comes from the
/// model's recipe, and from the report of its fit if that is known.
pub(crate) fn not_least_squares(model: &Model, fit: Option<&Fit>) -> Option<&'static str> {
    let recipe = Recipe::parse(&model.training.recipe, "the recipe of the model").ok()?;
    let objective = match model.method.split_whitespace().next() {
        Some("pwa") => recipe.pwa.objective,
        Some("sindy") => recipe.sindy.objective,
        Some("narx") => recipe.narx.objective,
        _ => None,
    };
    let simulated = objective.is_some_and(|objective| objective != Objective::OneStep);
    if simulated && fit.is_none_or(Fit::is_simulated) {
        return Some(
            "Its coefficients were fitted to simulations: intervals of least squares do not apply, and none are shown.",
        );
    }
    if model.latents.iter().any(|latent| latent.map.basis().is_some_and(|basis| basis.is_summed_up())) {
        return Some(
            "Its linear terms stand beside a network: intervals of their coefficients alone are not valid, and none are shown.",
        );
    }
    let bounded = model.method.starts_with("pwa") && (recipe.pwa.stable.is_some() || recipe.pwa.passive.is_some());
    if bounded && fit.is_none_or(Fit::is_moved) {
        return Some(
            "Its maps are kept within bounds, which moves coefficients: intervals of least squares do not apply, and none are shown.",
        );
    }
    None
}

/// Parts of all models; empty if no fit kept a bound.
pub(crate) fn parts(judged: &[Judged<'_>], fits: &[Fit]) -> Vec<Part> {
    let mut parts = Vec::new();
    for one in judged {
        let bounds = Fit::of(fits, one.model).map(Fit::kept).unwrap_or_default();
        if bounds.is_empty() {
            continue;
        }
        let name = if judged.len() > 1 { format!(": {}", one.name) } else { String::new() };
        parts.push(Part::Heading(format!("Bounds of the fit{name}")));
        parts.extend(bounds);
    }
    parts
}

impl Fit {
    /// Returns true if the bounds of the chosen partition moved the map of a region.
    fn is_moved(&self) -> bool {
        let candidates = self.candidates.as_array().into_iter().flatten();
        let chosen = candidates.filter(|candidate| candidate.get("chosen").and_then(Value::as_bool).unwrap_or(true));
        chosen
            .filter_map(|candidate| Partition::deserialize(candidate).ok())
            .any(|partition| partition.stability.moved > 0)
    }

    fn kept(&self) -> Vec<Part> {
        let tables = BoundedCandidate::tables(&self.bounded());
        let mut parts: Vec<Part> = tables.into_iter().map(|table| set(sentence(&table.caption), table)).collect();
        parts.extend(self.bound_of_simulations().map(|bound| {
            Part::Paragraph(format!(
                "These numbers are of the fit to one step; the regions of the model that was fitted to simulations {}",
                bound.in_words()
            ))
        }));
        if !self.limits.is_empty() {
            let caption = "How near the fit comes to each bound, and where; without cuts a bound costs nothing.";
            parts.push(set(caption.into(), LimitReport::table(&self.limits)));
            parts.extend(self.prices().map(Part::Table));
        }
        parts
    }

    /// The partitions of a piecewise-affine fit whose maps are bounded.
    fn bounded(&self) -> Vec<BoundedCandidate> {
        let candidates = self.candidates.as_array().into_iter().flatten();
        let held_out = self.held_out.as_ref().and_then(Value::as_bool).unwrap_or(false);
        let of = |candidate: &Value| {
            let candidate = Partition::deserialize(candidate).ok()?;
            let loss = if held_out { candidate.loss } else { unexplained(&candidate.r2) };
            Some(BoundedCandidate {
                partition: candidate.partition,
                maps: candidate.stability,
                free_loss: candidate.free_loss,
                loss,
            })
        };
        candidates.filter_map(of).collect()
    }

    /// Errors with limits beside those without, where both are known.
    fn prices(&self) -> Option<Table> {
        let caption = "Errors within the bounds and without them: the cost of the bounds.";
        let head = ["of", "error (rms)", "held out", "without bounds", "held out"];
        let value = |value: Option<f64>| Cell::of(value.unwrap_or(f64::NAN));
        let row = |name: String, priced: &Priced| {
            let values = [priced.rms, priced.held_out_rms, priced.free_rms, priced.free_held_out_rms];
            std::iter::once(Cell::Text(name)).chain(values.map(value)).collect::<Vec<Cell>>()
        };
        let several = self.regions.len() > 1;
        let equations = self.regions.iter().flat_map(|region| {
            region.equations.iter().map(move |equation| {
                let (label, priced) = (&equation.label, &equation.priced);
                (if several { format!("{label}, region {}", region.name) } else { label.clone() }, priced)
            })
        });
        let tasks = self.tasks.iter().map(|task| (task.name.clone(), &task.priced)).chain(equations);
        let rows: Vec<Vec<Cell>> = tasks
            .filter(|(_, priced)| priced.free_rms.is_some() || priced.free_held_out_rms.is_some())
            .take(ROWS)
            .map(|(name, priced)| row(name, priced))
            .collect();
        if !rows.is_empty() {
            return Some(rows.into_iter().fold(Table::new(caption, head), Table::row));
        }
        let noise = self.noise.iter().filter(|noise| noise.free_deviation.is_some()).take(ROWS);
        let rows: Vec<Vec<Cell>> = noise
            .map(|noise| vec![Cell::Text(noise.of.clone()), value(noise.deviation), value(noise.free_deviation)])
            .collect();
        let caption =
            "Standard deviation of the residuals, within the bounds and without them: the cost of the bounds.";
        (!rows.is_empty())
            .then(|| rows.into_iter().fold(Table::new(caption, ["of", "deviation", "without bounds"]), Table::row))
    }
}

/// A terminal table as a table of the page.
fn set(caption: String, table: TextTable) -> Part {
    let row = |cells: Vec<String>| {
        let mut cells = cells.into_iter();
        let first = cells.next().map(Cell::Text);
        first.into_iter().chain(cells.map(Cell::Number)).collect::<Vec<Cell>>()
    };
    Part::Table(table.rows.into_iter().map(row).fold(Table::new(caption, table.header), Table::row))
}

/// Caption of a terminal table, as a sentence.
fn sentence(caption: &str) -> String {
    let mut letters = caption.chars();
    letters.next().map_or_else(String::new, |first| format!("{}{}.", first.to_uppercase(), letters.as_str()))
}
