//! Excitation of a run: information in its rows about a model, before any model is fitted.

use fleetfoot_recipe::{Kind, Recipe};
use fleetfoot_sim::{
    Scenario,
    excitation::{Axis, Histogram},
};
use fleetfoot_stats::{Gram, RowGram};
use serde::{Serialize, Serializer, ser::SerializeSeq};

/// Information in the rows of a run, or of all runs, about an affine model of the robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Excitation {
    /// `ln det((1/n) [1 X]'[1 X])` of the n rows. X are the regressors of the recipe's affine model: the states and
    /// inputs of its library in SI units, angles by cosine and sine. Minus infinity when some of them never move or
    /// move together.
    ///
    /// Half the difference between two logs of a robot, divided by the number of regressors, is a logarithm. It is that
    /// of the ratio of the standard errors that the same number of rows gives, in the geometric mean over the
    /// coefficients (D-optimality). Units do not matter in it.
    pub log_determinant: f64,
    /// The columns of X.
    pub regressors: Vec<String>,
    /// Those that are constant or combinations of the others.
    pub dependent: Vec<String>,
    /// Nonuniformity of the rows over bins of [`Excitation::spread`]: 0 is even, 1 is all in one bin (Towards
    /// Sim-to-Real via Real-to-Sim, section 6.4). NaN without bins.
    pub nonuniformity: f64,
    /// The columns of the bins, with their ranges and numbers of bins.
    #[serde(serialize_with = "axes")]
    pub spread: Vec<(String, Axis)>,
    /// Rows that fell into no bin.
    pub outside: u64,
}

fn axes<S: Serializer>(spread: &[(String, Axis)], to: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct AxisReport<'a> {
        column: &'a str,
        low: f64,
        high: f64,
        bins: usize,
    }
    let mut list = to.serialize_seq(Some(spread.len()))?;
    for (column, Axis { low, high, bins }) in spread {
        list.serialize_element(&AxisReport { column, low: *low, high: *high, bins: *bins })?;
    }
    list.end()
}

/// Quantities that are gathered from rows: their regressors, and the columns that they should spread over.
#[derive(Debug, Clone)]
pub(super) struct Terms {
    regressors: Vec<Term>,
    spread: Vec<(usize, String, Axis)>,
}

/// Gathered sums, which merge.
#[derive(Debug, Clone)]
pub(super) struct Gathered {
    gram: Gram,
    visits: Histogram,
}

#[derive(Debug, Clone)]
struct Term {
    name: String,
    column: usize,
    function: fn(f64) -> f64,
}

impl Terms {
    /// Regressors of a recipe's affine model on rows with these columns; if there are none, all states and inputs as
    /// they are.
    pub(super) fn new(recipe: &Recipe, scenario: &dyn Scenario, spread: &[(&str, Axis)]) -> Self {
        let (columns, regressors) = (scenario.columns(), scenario.regressors());
        let find = |name: &str| columns.iter().position(|column| column.name == name);
        let states = recipe.states.iter().filter(|(_, state)| state.regressor != Some(false));
        let states = states.map(|(name, state)| (name, state.kind));
        let inputs = recipe.inputs.iter().map(|(name, input)| (name, input.table().kind));
        let mut terms = Vec::new();
        for (name, kind) in states.chain(inputs) {
            let Some(column) = find(name) else { continue };
            if kind == Some(Kind::Angle) {
                terms.push(Term { name: format!("cos({name})"), column, function: f64::cos });
                terms.push(Term { name: format!("sin({name})"), column, function: f64::sin });
            } else {
                terms.push(Term { name: name.clone(), column, function: |value| value });
            }
        }
        if terms.is_empty() {
            let all = columns.iter().take(regressors.states + regressors.inputs).enumerate();
            terms.extend(all.map(|(column, c)| Term { name: c.name.clone(), column, function: |value| value }));
        }
        let spread = spread.iter().filter_map(|&(name, axis)| Some((find(name)?, name.to_owned(), axis)));
        Self { regressors: terms, spread: spread.collect() }
    }

    /// Sums of no rows.
    pub(super) fn nothing(&self) -> Gathered {
        let axes = self.spread.iter().map(|&(_, _, axis)| axis);
        Gathered { gram: Gram::new(self.regressors.len()), visits: Histogram::new(axes) }
    }

    /// Excitation of the gathered rows.
    pub(super) fn excitation(&self, gathered: &Gathered) -> Excitation {
        let determinant = gathered.gram.log_determinant();
        let name = |term: &Term| term.name.clone();
        Excitation {
            log_determinant: determinant.value,
            regressors: self.regressors.iter().map(name).collect(),
            dependent: determinant.dependent.iter().map(|&term| name(&self.regressors[term])).collect(),
            nonuniformity: if self.spread.is_empty() { f64::NAN } else { gathered.visits.nonuniformity() },
            spread: self.spread.iter().map(|(_, name, axis)| (name.clone(), *axis)).collect(),
            outside: gathered.visits.outside(),
        }
    }
}

impl Gathered {
    /// Adds the sums of other rows.
    pub(super) fn merge(&mut self, other: &Self) {
        self.gram.merge(&other.gram);
        self.visits.merge(&other.visits);
    }
}

/// Gathers a run's rows.
pub(super) struct Meter<'a> {
    terms: &'a Terms,
    row: Vec<f64>,
    place: Vec<f64>,
    gram: RowGram,
    visits: Histogram,
}

impl<'a> Meter<'a> {
    pub(super) fn new(terms: &'a Terms) -> Self {
        let count = terms.regressors.len();
        Self {
            terms,
            row: vec![0.0; count],
            place: vec![0.0; terms.spread.len()],
            gram: RowGram::new(count),
            visits: terms.nothing().visits,
        }
    }

    /// Adds a row of truth.
    pub(super) fn row(&mut self, values: &[f64]) {
        for (value, term) in self.row.iter_mut().zip(&self.terms.regressors) {
            *value = (term.function)(values[term.column]);
        }
        for (value, (column, ..)) in self.place.iter_mut().zip(&self.terms.spread) {
            *value = values[*column];
        }
        self.gram.push(&self.row);
        self.visits.add(&self.place);
    }

    pub(super) fn finish(self) -> Gathered {
        Gathered { gram: self.gram.finish(), visits: self.visits }
    }
}
