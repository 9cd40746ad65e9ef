//! Equations from a `.stats` file: no pass.

use fleetfoot_library::Expr;
use fleetfoot_sparse::system::SystemScan;

use super::{EquationTask, Evidence, evidence::specification};
use crate::{Error, Logs, Recipe, StructuredTask};

impl Evidence {
    /// Reads the statistic of logs, scanned for plain equations, and tells the recipe with that of the scan beneath. A recipe that names no states and nothing to
    /// predict is that of the scan.
    ///
    /// # Errors
    /// Those of reading; a question that needs rows; candidates or targets that were not summed.
    pub(super) fn of_statistic(recipe: &Recipe, logs: &Logs) -> Result<(Self, Recipe), Error> {
        refuse_rows(recipe)?;
        let file = logs.statistic()?;
        let (mut own, scanned) = file.task()?;
        let mut recipe = recipe.clone();
        if recipe.states.is_empty() && recipe.model.predict.is_none() {
            own.say(recipe.sindy);
            own.model.degree = own.model.degree.or(Some(1));
            recipe = Recipe { library: recipe.library, ..own };
        }
        let task = EquationTask::resolve(&recipe.expand(&file.fields)?, &file.fields)?;
        let task = task.over(&scanned)?;
        let scan = SystemScan::of_tasks(&file.scanned, &scanned.regression)?;
        let used: std::collections::BTreeSet<_> = scan.units().iter().map(|unit| unit.episode).collect();
        let episodes = used
            .iter()
            .map(|id| (id.to_string(), file.episode(*id).map_or_else(String::new, |episode| episode.name.clone())));
        let equations = task.fitted.len();
        let differences = task.fitted.iter().any(|equation| equation.difference.is_some());
        let notes = if differences {
            vec![
                "derivatives by differences: a statistic does not tell how large their error is, so that terms may be kept that explain it; the logs tell".into(),
            ]
        } else {
            Vec::new()
        };
        let found = Self {
            episodes: episodes.collect(),
            step: file.step(),
            task,
            partition: None,
            scan,
            resolution: vec![0.0; equations],
            resolution_by_unit: Vec::new(),
            parameters: Vec::new(),
            notes,
        };
        found.check()?;
        Ok((found, recipe))
    }
}

/// What a statistic cannot answer.
fn refuse_rows(recipe: &Recipe) -> Result<(), Error> {
    let problem = if let Some(name) = recipe.parameters.keys().next() {
        format!("[parameters] {name}: an estimate inside expressions needs the rows, which a statistic has not")
    } else if let Some((name, _)) = recipe.states.iter().find(|(_, state)| state.nominal.is_some()) {
        format!(
            "[states] {name} nominal: what is left of a derivative is another target, which the statistic has not summed"
        )
    } else if specification(recipe)?.is_some() {
        "--partition: regions need the rows, which a statistic has not".to_owned()
    } else {
        return Ok(());
    };
    Err(Error::needs_rows(format!("{problem}; give the logs instead")))
}

impl EquationTask {
    /// The same equations over the candidates of a scan, of which they may have those that they had before.
    fn over(self, scanned: &StructuredTask) -> Result<Self, Error> {
        let regression = &scanned.regression;
        let found: Vec<&Expr> = regression.tasks.iter().map(|task| &task.target).collect();
        let wanted: Vec<&Expr> = self.fitted.iter().map(|equation| &equation.target).collect();
        if found != wanted || regression.weight != self.weight {
            let names: Vec<&str> = regression.tasks.iter().map(|task| task.name.as_str()).collect();
            return Err(Error::other_statistic(format!(
                "the statistic is of other equations or weights: it has {}; fit with the recipe of its scan, or give the logs",
                names.join(", ")
            )));
        }
        let all = regression.latents.first().map_or(&[][..], |latent| latent.functions.as_slice());
        let functions: Vec<Expr> = all.iter().filter(|function| function.as_number() != Some(1.0)).cloned().collect();
        let first = usize::from(self.constant);
        let mut places: Vec<usize> = (0..first).collect();
        for function in &self.functions {
            let place = functions.iter().position(|known| known == function).ok_or_else(|| {
                Error::other_statistic(format!(
                    "the statistic has no candidate `{function}`; name candidates that were scanned (there are {}), or give the logs",
                    functions.len()
                ))
            })?;
            places.push(first + place);
        }
        let mut task = self;
        for equation in &mut task.fitted {
            let mut allowed = vec![false; first + functions.len()];
            equation.allowed.iter().zip(&places).filter(|(own, _)| **own).for_each(|(_, &place)| allowed[place] = true);
            equation.allowed = allowed;
            equation.fixed = equation.fixed.iter().map(|&j| places[j]).collect();
            equation.fixed.sort_unstable();
        }
        task.functions = functions;
        Ok(task)
    }
}
