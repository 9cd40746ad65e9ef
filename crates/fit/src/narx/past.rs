//! Lags for models of other methods: those with which linear autoregressions simulate spans that did not train. Inputs that act late are found first.

use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::Dataset;
use fleetfoot_library::Expr;
use fleetfoot_recipe::{Effort, ModelSection, NarxSection, NarxTerms, Recipe};
use fleetfoot_sparse::narx::NarxOrder;
use fleetfoot_task::EquationTask;
use serde::Serialize;

use super::{
    NarxOptions,
    summed::Evidence,
    task::{NarxBase, one_row_ahead},
    training::Fit,
};
use crate::error::Error;

/// Past rows that were found for the states and inputs of a recipe.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct PastRows {
    /// Rows of every state, the present one among them.
    pub states: usize,
    /// Rows of every input.
    pub inputs: usize,
    /// Inputs that act late: the row at which their lags begin.
    pub late: Vec<(String, usize)>,
    /// Orders that were compared.
    pub compared: usize,
    /// States, then inputs, lag by lag; angles as cosine and sine.
    #[serde(skip)]
    pub(crate) variables: Vec<Expr>,
}

impl PastRows {
    /// Finds the lags on the rows of an opened recording.
    ///
    /// # Errors
    /// Rows that are too few to compare simulations, or linear models that all diverge; those of reading.
    pub(crate) fn find(
        recipe: &Recipe,
        dataset: &Dataset,
        (effort, folds, seed): (Effort, usize, u64),
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let recipe = linear(recipe, (effort, folds, seed));
        let mut options = NarxOptions::new(&recipe)?;
        let ahead = one_row_ahead(&recipe.expand(dataset.fields())?, &options)?;
        let base = NarxBase::new(EquationTask::resolve(&ahead, dataset.fields())?, &recipe)?;
        options.order = base.simulated(options.order, dataset.step())?;
        let view = dataset.view()?;
        let rows = view.episodes().iter().map(|episode| episode.rows).sum();
        let fit = |base| Fit {
            recipe: &recipe,
            options: &options,
            base,
            evidence: Evidence::Rows(&view),
            step: dataset.step(),
            rivals: false,
        };
        let delays = fit(&base).delays(rows, progress)?;
        let late = delays.iter().enumerate().filter(|(_, rows)| **rows > 0);
        let late = late.map(|(input, &rows)| (base.input(input), rows)).collect();
        let base = base.delayed(&delays);
        let (order, compared) = fit(&base).order(progress)?;
        // The present row stays: a model of the next row that does not read it predicts nothing of a state that stays.
        let (states, inputs) = (order.outputs.max(1), order.inputs.max(1));
        Ok(Self { states, inputs, late, compared, variables: base.past(states, inputs) })
    }

    /// The lags, for people.
    pub(crate) fn in_words(&self) -> String {
        let late: Vec<String> =
            self.late.iter().map(|(name, rows)| format!("{name} begins {rows} rows back")).collect();
        let late = if late.is_empty() { String::new() } else { format!("; {}", late.join(", ")) };
        format!(
            "{} rows of states, {} of inputs{late}, the best of {} linear models",
            self.states, self.inputs, self.compared
        )
    }
}

/// The recipe of a linear autoregression with all terms, whose lags are searched.
fn linear(recipe: &Recipe, (effort, folds, seed): (Effort, usize, u64)) -> Recipe {
    let mut linear = recipe.clone();
    linear.library = fleetfoot_recipe::LibrarySection::default();
    linear.model = ModelSection { degree: Some(1), ..ModelSection::default() };
    linear.narx = NarxSection {
        direct: Some(false),
        effort: Some(effort),
        folds: Some(folds),
        seed: Some(seed),
        terms: Some(NarxTerms::Word("all".into())),
        ..NarxSection::default()
    };
    linear
}

impl Fit<'_> {
    /// The order of the chosen model, and how many were compared.
    fn order(&self, progress: &dyn Progress) -> Result<(NarxOrder, usize), Error> {
        let partitions = self.partitions(&mut Vec::new(), progress)?;
        let chosen = self.choose(&partitions, progress)?;
        Ok((chosen.order, chosen.record.tried.len()))
    }
}
