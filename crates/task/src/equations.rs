//! A recipe resolved to a system of equations over one library, for `fit sindy`.

use std::collections::{BTreeMap, HashMap};

use fleetfoot_data::Column as DataColumn;
use fleetfoot_data::setting::{
    CONSTRAINTS, DEGREE, FIT_PARAMETERS, FIT_SINDY, FIT_SPARSE, LATENTS, LIBRARY, LIBRARY_SECTION, PARAMETERS,
    PARTITION, STATES_SECTION, TASKS,
};
use fleetfoot_library::{Expr, Library, TermsError, Vocabulary};
use fleetfoot_model::{Column, Equation, Gaussian, Prediction, RadialFunctions, Role};
use fleetfoot_recipe::{Aliases, Derivative, Error, Kind, Recipe};

use crate::{
    coefficients::{CoefficientLimit, Owner, coefficient_limits, consistent, same},
    difference::Difference,
    leak::refuse_target_in_partition,
    parameter::{Parameter, names},
    partition::specification,
    task::{equations, partition_columns, variables},
    windows::Windows,
};

/// A recipe resolved for a recording: a system of equations, each `target = sum_j c_j function_j + error`, over one
/// library of candidates.
///
/// Candidates are numbered with the constant first where there is one ([`EquationTask::constant`]), then the functions in their order.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct EquationTask {
    /// The model's columns.
    pub columns: Vec<Column>,
    /// The columns of the view, and the expressions over the recording's fields that give them.
    pub aliases: Vec<(DataColumn, Expr)>,
    /// The model's equations, over its columns and the names of the latents: fitted ones and given ones.
    pub equations: Vec<Equation>,
    /// The fitted equations, in the order of [`EquationTask::equations`].
    pub fitted: Vec<FittedEquation>,
    /// True if 1 is a candidate of any equation.
    pub constant: bool,
    /// All candidate functions, the constant left out.
    pub functions: Vec<Expr>,
    /// Non-negative row weights.
    pub weight: Option<Expr>,
    /// Numbers inside the expressions that are not known; none once they are estimated.
    pub parameters: Vec<Parameter>,
    /// Partition columns.
    pub partition_columns: Vec<Expr>,
    /// True if the default library is `poly(1)`, because `poly(2)` would have more than 500 functions.
    pub narrowed: bool,
    /// The windows of the weak form, where equations are fitted on windows in the place of rows.
    pub windows: Option<Windows>,
    /// Bounds of coefficients; the owners are the fitted equations.
    pub limits: Vec<CoefficientLimit>,
    /// Variables of the libraries: states and inputs, angles as cosine and sine, and their past.
    pub variables: Vec<Expr>,
    /// The radial functions among the candidates, the last of them, once their centres are known.
    pub radial: Option<RadialFunctions>,
}

/// A fitted equation.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FittedEquation {
    /// The left side, for people: `d(x)/dt`.
    pub label: String,
    /// Name of the latent that is learnt.
    pub latent: String,
    /// Measured left side, over the columns.
    pub measured: Expr,
    /// Known part of the right side, if there is one.
    pub nominal: Option<Expr>,
    /// Target of the candidates: the measured left side minus the nominal part.
    pub target: Expr,
    /// True for each candidate that the equation may have (candidates).
    pub allowed: Vec<bool>,
    /// Candidates of every model, ascending.
    pub fixed: Vec<usize>,
    /// Estimate, without noise, of the error of the left side, if that is a central difference.
    pub difference: Option<Expr>,
    /// That central difference, and its estimated error.
    pub central: Option<Difference>,
    /// Unit of the left side, when known.
    pub unit: Option<String>,
}

impl FittedEquation {
    /// Measures the left side by another expression.
    pub fn measure(&mut self, measured: Expr) {
        self.target = match &self.nominal {
            Some(nominal) => (&measured - nominal).simplified(),
            None => measured.clone(),
        };
        self.measured = measured;
    }
}

/// Candidates beyond which a library is refused: the matrix of their products alone would take 0.4 GB, in each of several chunks.
const MOST_CANDIDATES: usize = 10_000;

/// Functions of a default library, at most. Beyond it the products of many signals would be most of the work, and are
/// rarely useful.
const MOST_UNASKED: usize = 500;

/// The candidates of one equation, while the union is not known.
struct EquationLibrary {
    constant: bool,
    functions: Vec<Expr>,
    fixed: Vec<Expr>,
}

impl EquationTask {
    /// Resolves a recipe against the fields of a recording.
    ///
    /// The candidates are those of `[library]` (or of a state's `library`), else all monomials of states and inputs up
    /// to the degree of `[model]`, with the constant. The default degree is 2, or 1 if there would be more than 500
    /// monomials.
    ///
    /// # Errors
    /// A recipe that names something that does not exist, or contradicts itself.
    pub fn resolve(recipe: &Recipe, fields: &[DataColumn]) -> Result<Self, Error> {
        refuse_other_sections(recipe)?;
        let mut aliases = Aliases::of_recipe(recipe, fields)?;
        let parameters = Parameter::all(recipe, &aliases)?;
        if let Some(fixed) = parameters.iter().find(|parameter| parameter.fixed) {
            return Err(Error::conflict(format!(
                "{} fixed = true: only {FIT_PARAMETERS} can fix a parameter; write its number into the expressions",
                PARAMETERS.entry(&fixed.name)
            )));
        }
        let names: Vec<String> = parameters.iter().map(|parameter| parameter.name.clone()).collect();
        aliases.hide(&names);
        let labels: Vec<String> =
            specification(recipe)?.iter().filter_map(|partition| partition.label().map(str::to_owned)).collect();
        for label in &labels {
            aliases.add(label, None, None, Role::Auxiliary, false, &PARTITION.to("labels").to_string())?;
        }
        let mut equations = equations(recipe, &mut aliases)?;
        let mut reader = Reader { recipe, names: &names, general: None, narrowed: false };
        let mut fitted = Vec::new();
        let mut libraries = Vec::new();
        for equation in equations.iter_mut() {
            let Some(measured) = equation.target.clone() else { continue };
            let latent = equation.right.as_column().unwrap_or_default().to_owned();
            let state = recipe.states.get(&equation.subject).filter(|_| equation.prediction != Prediction::Value);
            let place = format!("{} nominal", STATES_SECTION.entry(&equation.subject));
            let nominal = state.and_then(|state| state.nominal.as_deref());
            let nominal = nominal.map(|text| aliases.over_aliases(text, &place)).transpose()?;
            let mut target = measured.clone();
            if let Some(nominal) = &nominal {
                target = (&measured - nominal).simplified();
                equation.right = nominal + &equation.right;
            }
            let subject = Expr::column(equation.subject.as_str());
            let angle = state.is_some_and(|state| state.kind == Some(Kind::Angle));
            let choice = state.and_then(|state| state.derivative.as_ref());
            let derivative = equation.prediction == Prediction::Derivative;
            let central = Derivative::central(choice, &subject, angle).filter(|_| derivative);
            let central = Difference::of(central, derivative && Derivative::is_any_order(choice), &measured);
            let central = central.filter(|_| derivative);
            fitted.push(FittedEquation {
                label: equation.label(),
                latent,
                measured,
                nominal,
                target,
                allowed: Vec::new(),
                fixed: Vec::new(),
                difference: central.as_ref().map(|central| central.form.truncation()),
                central,
                unit: equation.unit.clone(),
            });
        }
        for equation in equations.iter().filter(|equation| equation.target.is_some()) {
            libraries.push(reader.library_of(equation, &equations, &mut aliases)?);
        }
        let narrowed = reader.narrowed;
        let weight = recipe.model.weight.as_deref();
        let weight = weight.map(|text| aliases.over_latents(text, &names, "weight")).transpose()?;
        let partition_columns = partition_columns(recipe, &equations, &mut aliases)?;
        let labels: Vec<Expr> = labels.iter().map(|label| Expr::column(label.as_str())).collect();
        refuse_target_in_partition(&equations, &aliases, &labels)?;
        let constant = libraries.iter().any(|library| library.constant);
        let functions = union(&libraries);
        for (equation, library) in fitted.iter_mut().zip(&libraries) {
            library.mark(equation, constant, &functions);
        }
        let limits = limits(recipe, (&equations, &fitted), (constant, &functions), &names, &mut aliases)?;
        let variables =
            if recipe.library.radial.is_some() { variables(recipe, &aliases, &equations)? } else { Vec::new() };
        let columns = aliases.columns;
        let task = Self {
            columns,
            aliases: aliases.expressions,
            equations,
            fitted,
            constant,
            functions,
            weight,
            parameters,
            partition_columns,
            narrowed,
            windows: None,
            limits,
            variables,
            radial: None,
        };
        task.refuse_unused_parameters()?;
        // Filters of numbers alone are known from the beginning.
        Ok(if task.parameters.is_empty() { task.settled(&BTreeMap::new()) } else { task })
    }

    /// Returns true if a fitted equation gives a rate of change.
    pub fn is_rate(&self, fitted: usize) -> bool {
        let mut targets = self.equations.iter().filter(|equation| equation.target.is_some());
        targets.nth(fitted).is_some_and(|equation| equation.prediction == Prediction::Derivative)
    }

    /// Number of candidates, p.
    pub fn candidates(&self) -> usize {
        usize::from(self.constant) + self.functions.len()
    }

    /// Note that the default library is the smaller one.
    pub fn narrowed_note(&self) -> Option<String> {
        self.narrowed.then(|| {
            format!(
                "no library is named, and degree 2 would give more than {MOST_UNASKED} functions: the equations have degree 1; {given_degree} or a library gives more", given_degree = DEGREE.to("2,")
            )
        })
    }

    /// Candidates of the equation that has the most.
    pub fn most_allowed(&self) -> usize {
        let allowed = |equation: &FittedEquation| equation.allowed.iter().filter(|allowed| **allowed).count();
        self.fitted.iter().map(allowed).max().unwrap_or(0)
    }

    /// A candidate, for people.
    pub fn candidate(&self, index: usize) -> String {
        match index.checked_sub(usize::from(self.constant)) {
            None => "1".to_owned(),
            Some(function) => match self.radial_function(function) {
                Some(radial_function) => Gaussian::name(radial_function),
                None => self.functions[function].to_string(),
            },
        }
    }

    /// Number of the radial function that a candidate is; `None` for other candidates.
    pub(crate) fn radial_function(&self, function: usize) -> Option<usize> {
        let first = self.functions.len() - self.radial.as_ref()?.centres.len();
        function.checked_sub(first)
    }

    /// The task with radial functions behind its candidates, and with the variables of these functions. It applies to
    /// all equations without a library in the recipe.
    #[must_use]
    pub fn with_radial(mut self, radial: RadialFunctions, recipe: &Recipe) -> Self {
        let more = radial.inputs.iter().filter(|input| !self.functions.contains(input));
        let more: Vec<Expr> = more.cloned().chain(radial.expressions()).collect();
        self.functions.extend(more);
        let count = self.candidates();
        let subjects: Vec<String> = (self.equations.iter())
            .filter(|equation| equation.target.is_some())
            .map(|equation| equation.subject.clone())
            .collect();
        for (equation, subject) in self.fitted.iter_mut().zip(subjects) {
            let has_library = recipe.states.get(&subject).is_some_and(|state| state.library.is_some());
            equation.allowed.resize(count, !has_library);
        }
        self.radial = Some(radial);
        self
    }

    /// Columns whose moments the model needs: the measured left sides of the fitted equations, then the states.
    pub fn also(&self) -> Vec<Expr> {
        let measured = self.fitted.iter().map(|equation| equation.measured.clone());
        let states = self.columns.iter().filter(|column| column.role == Role::State);
        measured.chain(states.map(|column| Expr::column(column.name.as_str()))).collect()
    }

    /// All expressions over the columns that a row of the regression needs.
    pub fn row_functions(&self) -> Vec<Expr> {
        let targets = self.fitted.iter().map(|equation| &equation.target);
        self.functions.iter().chain(targets).chain(&self.weight).chain(&self.partition_columns).cloned().collect()
    }

    /// All expressions that rows are evaluated for or that the model has.
    pub fn expressions(&self) -> impl Iterator<Item = &Expr> {
        let fitted = self.fitted.iter().flat_map(|equation| [&equation.measured, &equation.target]);
        let sides = self.equations.iter().flat_map(|equation| std::iter::once(&equation.right).chain(&equation.target));
        self.functions.iter().chain(fitted).chain(sides).chain(&self.weight).chain(&self.partition_columns)
    }

    /// The task with every expression changed; the changed candidates must stay distinct.
    #[must_use]
    pub fn map(&self, change: impl Fn(&Expr) -> Expr) -> Self {
        let mut task = self.clone();
        task.functions.iter_mut().for_each(|function| *function = change(function));
        for equation in &mut task.fitted {
            equation.measured = change(&equation.measured);
            equation.nominal = equation.nominal.as_ref().map(&change);
            equation.target = change(&equation.target);
        }
        for equation in &mut task.equations {
            equation.right = change(&equation.right);
            equation.target = equation.target.as_ref().map(&change);
        }
        task.weight = task.weight.as_ref().map(&change);
        task.partition_columns.iter_mut().for_each(|column| *column = change(column));
        task.variables.iter_mut().for_each(|variable| *variable = change(variable));
        if let Some(radial) = &mut task.radial {
            radial.inputs.iter_mut().for_each(|input| *input = change(input));
        }
        task
    }

    fn refuse_unused_parameters(&self) -> Result<(), Error> {
        let used = names(self.expressions());
        match self.parameters.iter().find(|parameter| !used.contains(&parameter.name)) {
            None => Ok(()),
            Some(parameter) => Err(Error::conflict(format!(
                "{entry}: no library item, nominal part or target has it; use it, for example `lag1(u, {0})`, or remove it",
                parameter.name,
                entry = PARAMETERS.entry(&parameter.name)
            ))),
        }
    }
}

/// Reads libraries.
struct Reader<'a> {
    recipe: &'a Recipe,
    names: &'a [String],
    /// The library of the equations without one in the recipe.
    general: Option<(bool, Vec<Expr>)>,
    narrowed: bool,
}

impl Reader<'_> {
    fn library_of(
        &mut self,
        equation: &Equation,
        all: &[Equation],
        aliases: &mut Aliases<'_>,
    ) -> Result<EquationLibrary, Error> {
        let state = self.recipe.states.get(&equation.subject).filter(|_| equation.prediction != Prediction::Value);
        let place = STATES_SECTION.entry(&equation.subject).to_string();
        let (constant, functions) = match state.and_then(|state| state.library.as_ref()) {
            Some(items) => self.parse(items, all, Some(&format!("{place} library")), aliases)?,
            None => match &self.general {
                Some(general) => general.clone(),
                None => {
                    let items = match self.recipe.library.functions.as_slice() {
                        [] => vec![format!("poly({})", self.degree(all, aliases))],
                        items => items.to_vec(),
                    };
                    self.general.insert(self.parse(&items, all, None, aliases)?).clone()
                }
            },
        };
        let mut library = EquationLibrary { constant, functions, fixed: Vec::new() };
        if let Some(fixed) = state.map(|state| &state.fixed).filter(|fixed| !fixed.is_empty()) {
            library.fix(self.parse(fixed, all, Some(&format!("{place} fixed")), aliases)?, &place)?;
        }
        if !library.constant && library.functions.is_empty() {
            return Err(Error::missing(format!(
                "{place}: its library has no candidate functions; write for example `library = [\"poly(2)\", \"sin\"]`, or `known` for what is given and not fitted"
            )));
        }
        Ok(library)
    }

    /// The degree of the monomials where no library is named.
    fn degree(&mut self, equations: &[Equation], aliases: &Aliases<'_>) -> u32 {
        if let Some(degree) = self.recipe.model.degree {
            return degree.max(1);
        }
        if self.recipe.library.radial.is_some() {
            return 1;
        }
        let variables = variables(self.recipe, aliases, equations).map_or(0, |names| names.len());
        self.narrowed = (variables + 1) * (variables + 2) / 2 > MOST_UNASKED;
        if self.narrowed { 1 } else { 2 }
    }

    /// The functions of an entry of a state, or of `[library]`.
    fn parse(
        &self,
        items: &[String],
        equations: &[Equation],
        state: Option<&str>,
        aliases: &mut Aliases<'_>,
    ) -> Result<(bool, Vec<Expr>), Error> {
        // A library of free expressions alone needs no variables.
        let variables = match variables(self.recipe, aliases, equations) {
            Ok(variables) => variables,
            Err(error) if self.recipe.library.functions.is_empty() && state.is_none() => return Err(error),
            Err(_) => Vec::new(),
        };
        let scope = aliases.alias_scope(self.names);
        let vocabulary = Vocabulary { variables: &variables, scope: &scope };
        let place = &state.map_or_else(|| LIBRARY_SECTION.entry("functions").to_string(), str::to_owned);
        let library =
            Library::parse(items, &vocabulary).map_err(|error| explained(error, items, &vocabulary, place))?;
        let count = library.functions.len() + usize::from(library.constant);
        if count > MOST_CANDIDATES {
            return Err(Error::value(format!(
                "{place}: it has {count} candidates, at most {MOST_CANDIDATES} can be fitted together; name fewer candidates ({LIBRARY}, {DEGREE})"
            )));
        }
        for function in &library.functions {
            aliases.add_used(function, self.names, place)?;
        }
        Ok((library.constant, library.functions))
    }
}

/// The error, with the item that it is about.
fn explained(error: TermsError, items: &[String], vocabulary: &Vocabulary<'_>, place: &str) -> Error {
    let alone = |item: &&String| Library::parse(std::slice::from_ref(*item), vocabulary).is_err();
    match (error, items.iter().find(alone)) {
        (TermsError::Item(source), Some(item)) => {
            Error::Expression { place: place.to_owned(), text: item.clone(), source }
        }
        (error, _) => Error::value(format!("{place}: {error}")),
    }
}

impl EquationLibrary {
    /// Terms that stay: those of the library that they are, in whatever form, else more of them.
    fn fix(&mut self, (constant, fixed): (bool, Vec<Expr>), place: &str) -> Result<(), Error> {
        if constant {
            self.constant = true;
            self.fixed.push(Expr::number(1.0));
        }
        for function in fixed {
            let known = self.functions.iter().find(|known| same(known, &function)).cloned();
            self.fixed.push(known.clone().unwrap_or_else(|| function.clone()));
            if known.is_none() {
                self.functions.push(function);
            }
        }
        if self.fixed.is_empty() {
            return Err(Error::value(format!("{place} fixed: it names no term")));
        }
        Ok(())
    }

    /// Marks the candidates that the equation may have, and those of every model.
    fn mark(&self, equation: &mut FittedEquation, constant: bool, functions: &[Expr]) {
        let first = usize::from(constant);
        let places: HashMap<&Expr, usize> = functions.iter().zip(first..).collect();
        let place = |function: &Expr| match function.as_number() {
            Some(_) => constant.then_some(0),
            None => places.get(function).copied(),
        };
        equation.allowed = vec![false; first + functions.len()];
        let functions = self.functions.iter().cloned().chain(self.constant.then(|| Expr::number(1.0)));
        functions.filter_map(|function| place(&function)).for_each(|at| equation.allowed[at] = true);
        equation.fixed = self.fixed.iter().filter_map(place).collect();
        equation.fixed.sort_unstable();
        equation.fixed.dedup();
    }
}

/// The distinct functions of all equations: those of the first, then the additional ones of the others.
fn union(libraries: &[EquationLibrary]) -> Vec<Expr> {
    let mut seen = std::collections::HashSet::new();
    libraries
        .iter()
        .flat_map(|library| &library.functions)
        .filter(|function| seen.insert((*function).clone()))
        .cloned()
        .collect()
}

/// `[constraints]`: of coefficients; an equation is learnt as one sum, whose parts have no names.
fn limits(
    recipe: &Recipe,
    (equations, fitted): (&[Equation], &[FittedEquation]),
    (constant, functions): (bool, &[Expr]),
    names: &[String],
    aliases: &mut Aliases<'_>,
) -> Result<Vec<CoefficientLimit>, Error> {
    let one = Expr::number(1.0);
    let candidates: Vec<&Expr> = constant.then_some(&one).into_iter().chain(functions).collect();
    let subjects = equations.iter().filter(|equation| equation.target.is_some());
    let owner = |(equation, fitted): (&Equation, &FittedEquation)| Owner {
        names: vec![fitted.label.clone(), fitted.latent.clone(), equation.subject.clone()],
        functions: candidates
            .iter()
            .zip(&fitted.allowed)
            .map(|(&one, is_allowed)| is_allowed.then(|| one.clone()))
            .collect(),
    };
    let owners: Vec<Owner> = subjects.zip(fitted).map(owner).collect();
    let mut limits = Vec::new();
    for (name, section) in &recipe.constraints {
        if section.coefficients.is_empty() {
            return Err(Error::conflict(format!(
                "{entry}: `of` and `matrix` bound the functions of {LATENTS}, which {FIT_SPARSE} fits; {FIT_SINDY} bounds the coefficients of an \
                 equation: `{name} = {{ coefficients = {{ {} = [\"{}\"] }}, at_most = 0.0 }}`",
                equations.first().map_or("v", |equation| &equation.subject),
                functions.first().map_or_else(|| "v".into(), Expr::to_string),
                entry = CONSTRAINTS.entry(name)
            )));
        }
        limits.extend(coefficient_limits(name, section, &owners, names, aliases)?);
    }
    consistent(limits)
}

/// Sections that other commands read.
fn refuse_other_sections(recipe: &Recipe) -> Result<(), Error> {
    if !recipe.latents.is_empty() || !recipe.tasks.is_empty() {
        return Err(Error::conflict(format!(
            "the recipe has {LATENTS} and {TASKS}, which {FIT_SPARSE} fits; remove them for {FIT_SINDY}, or run {FIT_SPARSE}"
        )));
    }
    for (name, state) in &recipe.states {
        let place = STATES_SECTION.entry(name).to_string();
        if state.equation.is_some() {
            return Err(Error::conflict(format!(
                "{place} equation: it contains latents, which {FIT_SPARSE} fits; write the known part of the right side as `nominal`, or all of it as `known`"
            )));
        }
        let fitted = state.nominal.is_some() || state.library.is_some() || !state.fixed.is_empty();
        if state.known.is_some() && fitted {
            return Err(Error::conflict(format!(
                "{place}: it has `known`, so nothing is learnt; remove `nominal`, `library` and `fixed`, or write `nominal` instead of `known`"
            )));
        }
    }
    Ok(())
}
