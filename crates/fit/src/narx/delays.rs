//! Delays of inputs, found before orders are looked for: those that look for a few lags never see an input that acts later.
//!
//! One scan has a few lags of the outputs and many of every input. Forward regression takes the terms that explain the
//! outputs. An input acts late if all its terms lie beyond the usual lags, and the first of them explains some of what
//! least squares on the usual lags leave.

use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::Logs;
use fleetfoot_model::Role;
use fleetfoot_recipe::{Criterion, ModelSection, NarxSection, Recipe, State};
use fleetfoot_task::seen;

use super::{
    Narx, OrderRule, TermRule,
    summed::Evidence,
    terms::{Problems, Support, Trails, choice, coefficients},
    training::Fit,
};
use crate::{
    error::Error,
    method::{FitRequest, Method},
};

/// Lags of every output beside the inputs'.
const OUTPUTS: usize = 3;
/// Lags of every input at most in a search for orders, and fewer where products of all rows would be more than so many.
const MOST: usize = 200;
const PRODUCTS: f64 = 2e10;
/// Rows that every lag needs.
const ROWS_PER_LAG: usize = 10;
/// Terms that are taken at most. A term counts if it explains such a share of the variance that the outputs' past
/// leaves, and of the variance that the input's best term explains.
const TERMS: usize = 12;
const LEAST: f64 = 0.05;
const SHARE: f64 = 0.1;
/// Share of the variance that sums of squares do not resolve.
const ROUNDING: f64 = 1e-12;
/// Lags added before the first that counts: with an input that is held for some rows, the first lag is uncertain by so
/// many.
const MARGIN: usize = 3;

/// Inputs of a recipe that act late, by name, with the row at which each begins to act: 1 is the next row. Inputs whose
/// first `near` rows explain the states are left out; delays are at most `most` rows.
///
/// # Errors
/// Those of opening the logs and of reading them.
pub fn late_inputs(
    recipe: &Recipe,
    logs: &Logs,
    [near, most]: [usize; 2],
    progress: &dyn Progress,
) -> Result<Vec<(String, usize)>, Error> {
    let recipe = columns_alone(recipe);
    if recipe.states.is_empty() || recipe.inputs.is_empty() {
        return Ok(Vec::new());
    }
    let mut method = Narx::new(&recipe, &FitRequest::default())?;
    let (dataset, base) = method.open(&recipe, logs, progress)?;
    let view = dataset.view()?;
    let rows = view.episodes().iter().map(|episode| episode.rows).sum();
    let fit = Fit {
        recipe: &recipe,
        options: &method.options,
        base: &base,
        evidence: Evidence::Rows(&view),
        step: dataset.step(),
        rivals: false,
    };
    let mut first = fit.first_lags(rows, near, most, progress)?.into_iter();
    let columns = base.task.columns.iter().filter(|column| column.role == Role::Input);
    let mut late = Vec::new();
    for column in columns {
        // An angle is seen as its cosine and its sine: it acts when the first of them does.
        let lag = first.by_ref().take(seen(column, &base.task.columns).len()).flatten().min();
        late.extend(lag.map(|lag| (column.name.clone(), lag)));
    }
    Ok(late)
}

/// The states and inputs of a recipe as columns, without equations, libraries and settings of fits.
fn columns_alone(recipe: &Recipe) -> Recipe {
    let mut bare = Recipe { model: ModelSection::default(), narx: NarxSection::default(), ..recipe.clone() };
    bare.library = Default::default();
    bare.parameters.clear();
    bare.constraints = Default::default();
    bare.states.retain(|_, state| state.known.is_none() && state.columns.is_none() && state.part.is_none());
    for state in bare.states.values_mut() {
        let State { column, kind, unit, .. } = std::mem::take(state);
        *state = State { column, kind, unit, ..State::default() };
    }
    bare
}

impl Fit<'_> {
    /// Rows by which every input is late, 0 where the lags that the search has reach it.
    pub(crate) fn delays(&self, rows: usize, progress: &dyn Progress) -> Result<Vec<usize>, Error> {
        let OrderRule::Look(given) = self.options.order else { return Ok(vec![0; self.base.inputs()]) };
        if given.inputs.is_some() || given.every.is_some_and(|every| every > 1) {
            return Ok(vec![0; self.base.inputs()]);
        }
        let near = self.options.effort.lags().iter().copied().max().unwrap_or(1);
        let first = self.first_lags(rows, near, MOST, progress)?;
        Ok(first.into_iter().map(|lag| lag.map_or(0, |lag| lag - 1 - MARGIN)).collect())
    }

    /// The first lag of every input that explains the outputs, where it is beyond `near`; `None` of other inputs. Lags
    /// are at most `most`.
    fn first_lags(
        &self,
        rows: usize,
        near: usize,
        most: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<Option<usize>>, Error> {
        let inputs = self.base.inputs();
        let outputs = OUTPUTS * self.base.seen_outputs();
        let columns = (PRODUCTS / rows.max(1) as f64).sqrt().min((rows / ROWS_PER_LAG) as f64) as usize;
        let reach = (most + 1).min(columns.saturating_sub(outputs) / inputs.max(1));
        if inputs == 0 || reach <= near {
            return Ok(vec![None; inputs]);
        }
        // The first lag of an input is that of one that acts at once.
        let task = self.base.lags(OUTPUTS, reach);
        let scan = self.scan(&task, None, progress)?;
        let columns = (0..=outputs + inputs * reach).collect();
        let problems = Problems::all(&scan, None);
        let trails = Trails::new(&problems, columns, TermRule::Auto(TERMS), choice(Criterion::Ebic))?;
        let terms = trails.terms(None);
        // Input, lag, and the share of what the outputs' past leaves that it explains; the constant comes first, then the outputs.
        let mut of_inputs: Vec<(usize, usize, f64)> = Vec::new();
        for equation in terms.iter().flatten() {
            let past: f64 = equation.terms.iter().filter(|(column, ..)| *column <= outputs).map(|term| term.2).sum();
            let left = (1.0 - past).max(f64::EPSILON);
            of_inputs.extend(equation.terms.iter().filter_map(|(column, _, reduction)| {
                let at = column.checked_sub(1 + outputs)?;
                Some((at / reach, at % reach, reduction / left))
            }));
        }
        let first = |input: usize| {
            let delays = || of_inputs.iter().filter(|(of, ..)| *of == input);
            let most = delays().map(|(.., reduction)| *reduction).fold(0.0, f64::max);
            let counts = |reduction: f64| reduction >= SHARE * most && reduction >= LEAST;
            let first = delays().filter(|(.., reduction)| counts(*reduction)).map(|(_, lag, _)| *lag).min();
            first.filter(|first| *first > near)
        };
        // A slow input is like itself some rows later: a late lag has to explain what the usual lags do not.
        let column = |input: usize, lag: usize| 1 + outputs + input * reach + lag;
        let usual: Vec<usize> =
            (0..=outputs).chain((0..inputs).flat_map(|input| (1..=near).map(move |lag| column(input, lag)))).collect();
        let targets = problems.whole.targets();
        let errors = |columns: &[usize]| {
            let support = vec![vec![Support { columns: columns.to_vec(), shared: false }; targets]];
            let fitted = problems.refitted(&support)?;
            Ok::<_, Error>(problems.error(&coefficients(&fitted, 1 + outputs + inputs * reach)).0)
        };
        let [spread, before] = [errors(&[0])?, errors(&usual)?];
        let late = |input: usize| -> Result<Option<usize>, Error> {
            let Some(lag) = first(input) else { return Ok(None) };
            let after = errors(&[&usual[..], &[column(input, lag)]].concat())?;
            let explains = |(target, (before, after)): (usize, (&f64, &f64))| {
                *before > ROUNDING * spread[target] && before - after >= LEAST * before
            };
            Ok(before.iter().zip(&after).enumerate().any(explains).then_some(lag))
        };
        (0..inputs).map(late).collect()
    }
}
