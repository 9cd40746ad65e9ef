//! Exact derivatives of right sides: by the chain rule from functions to latents to right sides.

use fleetfoot_library::{Expr, UnknownColumn};
use fleetfoot_model::Prediction;

use crate::{
    code::{Condition, Function, Index, Kind, Outcome, Parameter, Place, Real, Statement, TABLE, Values},
    evaluation::{Group, program},
    lower::{Lowering, excess_name, straight},
    plan::{Plan, Source},
};

/// One entry of the Jacobian of the functions.
struct Entry {
    /// Index among the features.
    function: usize,
    /// States, then inputs.
    variable: usize,
    slope: Expr,
}

impl Lowering<'_> {
    /// `code = name(x, u, past, t, A, B, c)`: the right sides are `A x + B u + c` to first order, in the region of (x, u).
    ///
    /// `kinds`: kinds of the rows. For a next value or a difference the row is that of the next value.
    pub(crate) fn jacobian(&mut self, name: &'static str, kinds: &[Prediction]) -> Result<Function, UnknownColumn> {
        let (rows, states, inputs) = (kinds.len(), self.plan.states.len(), self.plan.inputs.len());
        let mut body = vec![Statement::Array("f".into(), rows)];
        body.extend(self.regions_and_latents());
        body.extend(self.rights("f"));
        let mut end = self.finish("f", rows);
        let last = end.pop();
        body.extend(end);
        body.extend(self.slopes_of_latents()?);
        body.extend(self.slopes_of_rights(rows)?);
        for (i, kind) in kinds.iter().enumerate().filter(|(_, kind)| **kind == Prediction::Difference) {
            debug_assert_eq!(*kind, Prediction::Difference);
            body.push(Statement::add("A", i * states + i, Real::Number(1.0)));
            body.push(Statement::add("f", i, Real::at("x", i)));
        }
        body.push(remainder(rows, states, inputs));
        body.extend(last);
        let mut parameters = self.plan.parameters();
        let matrices = [("A", rows * states), ("B", rows * inputs), ("c", rows)];
        let matrices = matrices.into_iter().filter(|(_, length)| *length > 0);
        parameters.extend(matrices.map(|(name, length)| Parameter { name, kind: Kind::Out(length) }));
        Ok(Function { name, gives: true, parameters, body })
    }

    /// Names of the states and the inputs.
    fn variables(&self) -> Vec<&str> {
        variables(self.plan)
    }

    /// The array `g`: latents x variables.
    fn slopes_of_latents(&mut self) -> Result<Vec<Statement>, UnknownColumn> {
        let (variables, latents) = (self.variables().len(), self.evaluation.latents());
        if latents == 0 || variables == 0 {
            return Ok(Vec::new());
        }
        let entries = self.entries();
        let slopes: Vec<Expr> = entries.iter().map(|entry| entry.slope.clone()).collect();
        let columns: Vec<&str> = self.plan.model.columns.iter().map(|column| column.name.as_str()).collect();
        let code = program(&slopes, &columns)?;
        let (mut body, values) = straight(&code, "d", &|leaf| self.plan.leaf(leaf));
        body.push(Statement::Array("g".into(), latents * variables));
        let tables = self.evaluation.groups.iter().any(|group| group.regions > 1 || group.basis.is_some());
        if tables && !entries.is_empty() {
            body.push(Statement::Array("d".into(), entries.len()));
            body.extend(values.iter().cloned().enumerate().map(|(at, value)| Statement::set("d", at, value)));
        }
        for (index, group) in self.evaluation.groups.iter().enumerate() {
            let is_of_group = |entry: &Entry| (group.first..group.first + group.functions).contains(&entry.function);
            let first = entries.iter().position(is_of_group).unwrap_or(0);
            let count = entries.iter().filter(|entry| is_of_group(entry)).count();
            let entries = &entries[first..first + count];
            if count == 0 {
            } else if group.regions == 1 && group.basis.is_none() {
                body.extend(straight_group(group, entries, &values[first..], variables));
            } else {
                body.extend(self.table_group(index, group, entries, first, variables));
                let local: Vec<(usize, usize)> =
                    entries.iter().map(|entry| (entry.function - group.first, entry.variable)).collect();
                body.extend(self.slopes_of_basis(index, group, (&local, first), variables));
            }
        }
        Ok(body)
    }

    /// Derivatives of the functions that are not zero, function by function.
    fn entries(&self) -> Vec<Entry> {
        let names = self.variables();
        let functions: usize = self.evaluation.groups.iter().map(Group::width).sum();
        let mut entries = Vec::new();
        for (function, expression) in self.evaluation.expressions[..functions].iter().enumerate() {
            let mut columns: Vec<usize> = expression
                .columns()
                .iter()
                .filter_map(|column| names.iter().position(|name| **name == **column))
                .collect();
            columns.sort_unstable();
            for variable in columns {
                let slope = expression.derivative(names[variable]).simplified();
                if slope.as_number() != Some(0.0) {
                    entries.push(Entry { function, variable, slope });
                }
            }
        }
        entries
    }

    fn table_group(
        &mut self,
        index: usize,
        group: &Group,
        entries: &[Entry],
        first: usize,
        variables: usize,
    ) -> Vec<Statement> {
        let latents = group.latents();
        let row = Self::group_region(group).times(latents).plus(Index::local("i"));
        let table_of = |values: Vec<usize>| Values::Indices(values);
        let variable = entries.iter().map(|entry| entry.variable).collect();
        let variable =
            self.table("slope_variable", index, "Variable of each slope of a function.", 12, table_of(variable));
        let target = |entry: Index| {
            let at = Index::local("i").times(variables).plus(group.slot * variables);
            Place::at("g", at.plus(Index::table(&variable, entry)))
        };
        let slope = |entry: Index| Real::at("d", entry.plus(first));
        let inner = if group.is_sparse() {
            let sparse = self.sparse(index, group);
            let begins: Vec<usize> = (group.first..=group.first + group.functions)
                .map(|function| entries.iter().take_while(|entry| entry.function < function).count())
                .collect();
            let longest = begins.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or(0);
            let begin = self.table("slope_start", index, "First slope of each function.", 12, table_of(begins));
            let entry = || Index::local("e");
            let value = Real::at(&sparse.values, Index::local("k")).times(slope(entry()));
            let function = || Index::table(&sparse.functions, Index::local("k"));
            let each = Statement::For {
                index: "e".into(),
                from: Index::table(&begin, function()),
                to: Index::table(&begin, function().plus(1)),
                turns: longest,
                body: vec![Statement::Add(target(entry()), value)],
            };
            sparse.each("k", row, vec![each])
        } else {
            let function = entries.iter().map(|entry| entry.function - group.first).collect();
            let function = self.table("slope_function", index, "Function of each slope.", 12, table_of(function));
            let entry = || Index::local("e");
            let at = row.times(group.width()).plus(Index::table(&function, entry()));
            let value = Real::at(&format!("{TABLE}{}coefficients{index}", self.tag), at).times(slope(entry()));
            let within = Statement::Add(target(entry()), value);
            let each = match &group.beyond {
                None => within,
                Some(_) => {
                    let at = Index::table(&function, entry());
                    let excess = Real::at(&excess_name(index), at.clone());
                    let at = Index::local("i").times(group.width()).plus(at);
                    let slope_beyond = Real::at(&format!("{TABLE}{}slopes_beyond{index}", self.tag), at);
                    let beyond = Statement::Add(target(entry()), slope_beyond.times(slope(entry())));
                    Statement::If(Condition::Equal(excess, Real::Number(0.0)), vec![within], vec![beyond])
                }
            };
            Statement::each("e", entries.len(), vec![each])
        };
        vec![Statement::each("i", latents, vec![inner])]
    }

    /// The matrices `A` and `B`.
    fn slopes_of_rights(&self, rows: usize) -> Result<Vec<Statement>, UnknownColumn> {
        let model = self.plan.model;
        let (states, inputs) = (self.plan.states.len(), self.plan.inputs.len());
        let variables = self.variables();
        let mut body = Vec::new();
        for (matrix, width) in [("A", states), ("B", inputs)] {
            if width > 0 {
                let zero = Statement::set(matrix, Index::local("i"), Real::Number(0.0));
                body.push(Statement::each("i", rows * width, vec![zero]));
            }
        }
        let names: Vec<&str> = model
            .columns
            .iter()
            .map(|c| c.name.as_str())
            .chain(model.latents.iter().map(|l| l.name.as_str()))
            .collect();
        let (mut slopes, mut places) = (Vec::new(), Vec::new());
        for (row, right) in self.evaluation.right_sides.iter().enumerate() {
            for name in right.columns() {
                let latent = model.latents.iter().position(|latent| *latent.name == *name);
                let slot = latent.and_then(|latent| self.evaluation.slots[latent]);
                let variable = variables.iter().position(|variable| **variable == *name);
                let place = match (slot, variable) {
                    (Some(slot), _) => Ok(slot),
                    (None, Some(variable)) => Err(variable),
                    (None, None) => continue,
                };
                let slope = right.derivative(&name).simplified();
                if slope.as_number() != Some(0.0) {
                    slopes.push(slope);
                    places.push((row, place));
                }
            }
        }
        let (lines, values) = straight(&program(&slopes, &names)?, "w", &|leaf| self.leaf(leaf));
        body.extend(lines);
        for ((row, place), value) in places.into_iter().zip(values) {
            match place {
                Ok(slot) => body.extend(through_latent(row, slot, &value, states, inputs)),
                Err(variable) if variable < states => body.push(Statement::add("A", row * states + variable, value)),
                Err(variable) => body.push(Statement::add("B", row * inputs + variable - states, value)),
            }
        }
        Ok(body)
    }
}

fn variables<'a>(plan: &'a Plan<'_>) -> Vec<&'a str> {
    let states = plan.states.iter().map(|state| state.signal.name.as_str());
    states.chain(plan.inputs.iter().map(|input| input.name.as_str())).collect()
}

/// `A[row, :] += weight * g[slot, :]`, and `B`.
fn through_latent(row: usize, slot: usize, weight: &Real, states: usize, inputs: usize) -> Vec<Statement> {
    let mut body = Vec::new();
    for (matrix, from, width) in [("A", 0, states), ("B", states, inputs)] {
        if width > 0 {
            let slope = Real::at("g", Index::local("j").plus(slot * (states + inputs) + from));
            let value = match weight {
                Real::Number(1.0) => slope,
                weight => weight.clone().times(slope),
            };
            let add = Statement::add(matrix, Index::local("j").plus(row * width), value);
            body.push(Statement::each("j", width, vec![add]));
        }
    }
    body
}

/// Slopes of the latents of one region: sums without the zeros.
fn straight_group(group: &Group, entries: &[Entry], values: &[Real], variables: usize) -> Vec<Statement> {
    let mut body = Vec::new();
    for latent in 0..group.latents() {
        let mut sums: Vec<Vec<Real>> = vec![Vec::new(); variables];
        for (j, coefficient) in group.terms(0, latent) {
            for (entry, value) in entries.iter().zip(values).filter(|(entry, _)| entry.function == group.first + j) {
                sums[entry.variable].push(match value {
                    Real::Number(slope) => Real::Number(coefficient * slope),
                    value => Real::Number(coefficient).times(value.clone()),
                });
            }
        }
        for (variable, sum) in sums.into_iter().enumerate().filter(|(_, sum)| !sum.is_empty()) {
            body.push(Statement::set("g", (group.slot + latent) * variables + variable, Real::Sum(sum)));
        }
    }
    body
}

/// `c = f - A x - B u`.
fn remainder(rows: usize, states: usize, inputs: usize) -> Statement {
    let mut body = vec![Statement::Variable("rest".into(), Real::at("f", Index::local("i")))];
    for (matrix, vector, width) in [("A", "x", states), ("B", "u", inputs)] {
        if width > 0 {
            let entry = Real::at(matrix, Index::local("i").times(width).plus(Index::local("j")));
            let product = entry.times(Real::at(vector, Index::local("j")));
            let value = Real::local("rest").minus(product);
            body.push(Statement::each("j", width, vec![Statement::Set(Place::Local("rest".into()), value)]));
        }
    }
    body.push(Statement::set("c", Index::local("i"), Real::local("rest")));
    Statement::each("i", rows, body)
}

impl Plan<'_> {
    /// Present value of a signal.
    pub(crate) fn present(&self, source: Source) -> Real {
        match source {
            Source::State(i) => Real::at("x", i),
            Source::Input(i) => Real::at("u", i),
            Source::Time => Real::local("t"),
        }
    }
}

/// Return statement behind a call: passes on its code if it failed.
pub(crate) fn unless_failed(code: &str) -> Statement {
    Statement::If(
        crate::code::Condition::Failed(code.to_owned()),
        vec![Statement::Return(Outcome::Same(code.to_owned()))],
        Vec::new(),
    )
}
