//! Recurrent cells in code: a loop over the steps of the window, and its reverse product.

use fleetfoot_library::Unary;
use fleetfoot_model::{Cell, Recurrent};

use crate::{
    code::{Index, Place, Real, Statement, TABLE, Values},
    evaluation::Group,
    lower::Lowering,
};

/// Names of the tables of a cell, and of the arrays that its steps fill.
struct Names {
    inputs: String,
    centre: String,
    inverse: String,
    input_weights: String,
    state_weights: String,
    biases: String,
    /// Empty but for a GRU.
    state_biases: String,
    columns: String,
    gates: String,
    states: String,
    memory: String,
}

/// Places of a step in the arrays: its inputs in their table; gates; state before and behind.
struct Places {
    inputs: Index,
    gates: Index,
    from: Index,
    to: Index,
}

fn i() -> Index {
    Index::local("i")
}

fn j() -> Index {
    Index::local("j")
}

/// Values that a step keeps for every unit: its gates, and for a GRU the product behind them.
fn kept(cell: Cell) -> usize {
    cell.gates() + usize::from(cell.resets())
}

/// The logistic function by tanh, which does not overflow.
fn logistic(sum: Real) -> Real {
    let half = || Real::Number(0.5);
    half().plus(half().times(Real::unary(Unary::Tanh, half().times(sum))))
}

fn tanh(sum: Real) -> Real {
    Real::unary(Unary::Tanh, sum)
}

/// `1 - value`.
fn rest(value: Real) -> Real {
    Real::Number(1.0).minus(value)
}

/// `weights[row, :] * values`, added to the local variable `sum`.
fn product(sum: &str, weights: &str, (row, width): (Index, usize), value: Real) -> Statement {
    let term = Real::at(weights, row.times(width).plus(j())).times(value);
    Statement::each("j", width, vec![Statement::Add(Place::Local(sum.into()), term)])
}

impl Lowering<'_> {
    fn cell_tables(&mut self, index: usize, cell: &Recurrent, inputs: &[usize]) -> Names {
        let (columns, units) = (cell.columns(), cell.count());
        let flat = |rows: &[Vec<f64>]| rows.iter().flatten().copied().collect::<Vec<f64>>();
        let places = Values::Indices(inputs.to_vec());
        let gates = match cell.cell {
            Cell::Rnn => "",
            Cell::Gru => ": reset, update, candidate",
            Cell::Lstm => ": input, forget, candidate, output",
        };
        let text = format!("Weights of the inputs of a recurrent cell, one row a unit and gate{gates}.");
        Names {
            inputs: self.table("cell_inputs", index, "Inputs of the cell, one row a step.", columns, places),
            centre: self.reals("cell_centre", index, "Centre of each input of a step.", 8, cell.centre.clone()),
            inverse: self.reals(
                "cell_inverse_scale",
                index,
                "One over the scale of each.",
                8,
                cell.scale.iter().map(|scale| 1.0 / scale).collect(),
            ),
            input_weights: self.reals("input_weights", index, &text, columns, flat(&cell.input_weights)),
            state_weights: self.reals(
                "state_weights",
                index,
                "Weights of the state before a step, in the same rows.",
                units,
                flat(&cell.state_weights),
            ),
            biases: self.reals("cell_biases", index, "Biases of the same rows.", 8, cell.biases.clone()),
            state_biases: match cell.cell.resets() {
                true => self.reals(
                    "state_biases",
                    index,
                    "Biases of the product with the state that the reset multiplies.",
                    8,
                    cell.state_biases.clone(),
                ),
                false => String::new(),
            },
            columns: format!("columns{index}"),
            gates: format!("gates{index}"),
            states: format!("states{index}"),
            memory: format!("memory{index}"),
        }
    }

    /// Steps, from the last one, whose gates and states are kept: those that read the present row. Its derivatives need them.
    fn steps_kept(&self, group: &Group, cell: &Recurrent, inputs: &[usize]) -> usize {
        let present = |&function: &usize| {
            let reads = self.evaluation.expressions[group.first + function].reads();
            reads.iter().any(|(name, lag)| name.is_some() && *lag == 0)
        };
        let first = inputs.chunks(cell.columns()).position(|step| step.iter().any(present));
        first.map_or(1, |first| cell.steps() - first)
    }

    /// The last state of a cell, behind the functions of the group among the features. The steps before those that are kept share one place.
    pub(crate) fn recurrent(
        &mut self,
        index: usize,
        group: &Group,
        cell: &Recurrent,
        inputs: &[usize],
    ) -> Vec<Statement> {
        let kept_steps = self.steps_kept(group, cell, inputs);
        let names = self.cell_tables(index, cell, inputs);
        let (units, columns, first) = (cell.count(), cell.columns(), cell.steps() - kept_steps);
        let size = kept(cell.cell) * units;
        let mut body = vec![
            Statement::Array(names.columns.clone(), columns),
            Statement::Array(names.gates.clone(), kept_steps * size),
            Statement::Array(names.states.clone(), (kept_steps + 1) * units),
        ];
        if cell.cell == Cell::Lstm {
            body.push(Statement::Array(names.memory.clone(), (kept_steps + 1) * units));
        }
        let k = || Index::local("k");
        if first > 0 {
            let places = Places { inputs: k().times(columns), gates: 0.into(), from: 0.into(), to: 0.into() };
            body.push(Statement::each("k", first, step(cell, &names, group.first, &places)));
        }
        let places = Places {
            inputs: k().plus(first).times(columns),
            gates: k().times(size),
            from: k().times(units),
            to: k().times(units).plus(units),
        };
        body.push(Statement::each("k", kept_steps, step(cell, &names, group.first, &places)));
        let last = Real::at(&names.states, i().plus(kept_steps * units));
        let feature = Statement::set("q", i().plus(group.first + group.functions), last);
        body.push(Statement::each("i", units, vec![feature]));
        body
    }

    /// Adds the derivatives of the latents through a cell to the array `g`, as [`Lowering::slopes_of_basis`].
    pub(crate) fn recurrent_slopes(
        &mut self,
        (index, group): (usize, &Group),
        (cell, inputs): (&Recurrent, &[usize]),
        (entries, first): (&[(usize, usize)], usize),
        variables: usize,
    ) -> Vec<Statement> {
        let (units, columns, last) = (cell.count(), cell.columns(), cell.steps() - 1);
        // A function may be an input of several steps: slope, steps back and column, variable.
        let mut used: Vec<(usize, usize, usize)> = Vec::new();
        for (at, &(function, variable)) in entries.iter().enumerate() {
            let places = inputs.iter().enumerate().filter(|(_, input)| **input == function);
            used.extend(places.map(|(place, _)| {
                let back = last - place / columns;
                (first + at, back * columns + place % columns, variable)
            }));
        }
        let Some(farthest) = used.iter().map(|used| used.1 / columns).max() else { return Vec::new() };
        let kept_steps = self.steps_kept(group, cell, inputs);
        let names = self.cell_tables(index, cell, inputs);
        let mut table = |what: &str, comment: &str, values: Vec<usize>| {
            self.table(what, index, comment, 12, Values::Indices(values))
        };
        let slope = table(
            "cell_slope",
            "Slopes of the inputs of the cell that read the present row.",
            used.iter().map(|used| used.0).collect(),
        );
        let input = table(
            "cell_input",
            "Place of each, step by step from the last one.",
            used.iter().map(|used| used.1).collect(),
        );
        let column =
            table("cell_column", "Column of each in its step.", used.iter().map(|used| used.1 % columns).collect());
        let variable = table("cell_variable", "Variable of each.", used.iter().map(|used| used.2).collect());
        let steps: Vec<usize> = (0..=farthest).map(|back| kept_steps - 1 - back).collect();
        let back = table("cell_back", "Kept steps, from the last one.", steps);
        let row = Self::group_region(group).times(group.latents()).plus(Index::local("n"));
        let coefficients = format!("{TABLE}{}coefficients{index}", self.tag);
        let coefficient = Real::at(&coefficients, row.times(group.width()).plus(i()).plus(group.functions));
        let size = kept(cell.cell) * units;
        let mut body = vec![
            Statement::Array("by_inputs".into(), (farthest + 1) * columns),
            Statement::Array("by_sums".into(), size),
            Statement::Array("by_state".into(), units),
        ];
        if cell.cell == Cell::Lstm {
            body.push(Statement::Array("by_memory".into(), units));
        }
        body.push(Statement::each("i", units, vec![Statement::set("by_state", i(), coefficient)]));
        let slot = || Index::table(&back, Index::local("k"));
        let places = Places {
            inputs: Index::local("k").times(columns),
            gates: slot().times(size),
            from: slot().times(units),
            to: slot().times(units).plus(units),
        };
        let mut reverse = vec![Statement::each("i", units, gate_slopes(cell.cell, &names, units, &places))];
        let weight = Real::at(&names.input_weights, i().times(columns).plus(j()));
        let to = Place::at("by_inputs", places.inputs.plus(j()));
        let add = vec![Statement::Add(to, weight.times(Real::at("by_sums", i())))];
        reverse.push(Statement::each("i", cell.biases.len(), vec![Statement::each("j", columns, add)]));
        if farthest > 0 {
            reverse.extend(state_slopes(cell, &names));
        }
        body.push(Statement::each("k", farthest + 1, reverse));
        let entry = || Index::local("e");
        let value = Real::at("by_inputs", Index::table(&input, entry()))
            .times(Real::at(&names.inverse, Index::table(&column, entry())))
            .times(Real::at("d", Index::table(&slope, entry())));
        let to = Index::local("n").times(variables).plus(group.slot * variables).plus(Index::table(&variable, entry()));
        body.push(Statement::each("e", used.len(), vec![Statement::Add(Place::at("g", to), value)]));
        vec![Statement::each("n", group.latents(), body)]
    }
}

/// One step: columns, gates, state.
fn step(cell: &Recurrent, names: &Names, first: usize, places: &Places) -> Vec<Statement> {
    let (units, columns) = (cell.count(), cell.columns());
    let x = Real::at("q", Index::table(&names.inputs, places.inputs.clone().plus(j())).plus(first));
    let x = x.minus(Real::at(&names.centre, j())).times(Real::at(&names.inverse, j()));
    let mut body = vec![Statement::each("j", columns, vec![Statement::set(&names.columns, j(), x)])];
    let of_inputs = |row: Index| {
        [
            Statement::Variable("sum".into(), Real::at(&names.biases, row.clone())),
            product("sum", &names.input_weights, (row, columns), Real::at(&names.columns, j())),
        ]
    };
    let state = || Real::at(&names.states, places.from.clone().plus(j()));
    let gate = |at: usize| places.gates.clone().plus(at * units).plus(i());
    let mut rows = |first: usize, count: usize, activation: fn(Real) -> Real| {
        let row = i().plus(first * units);
        let mut sums = of_inputs(row.clone()).to_vec();
        sums.push(product("sum", &names.state_weights, (row, units), state()));
        sums.push(Statement::set(&names.gates, gate(first), activation(Real::local("sum"))));
        body.push(Statement::each("i", count * units, sums));
    };
    let value = |at: usize| Real::at(&names.gates, gate(at));
    let at = |array: &str, place: &Index| Real::at(array, place.clone().plus(i()));
    let end = match cell.cell {
        Cell::Rnn => {
            rows(0, 1, tanh);
            vec![Statement::set(&names.states, places.to.clone().plus(i()), value(0))]
        }
        Cell::Gru => {
            rows(0, 2, logistic);
            let row = i().plus(2 * units);
            let mut sums = of_inputs(row.clone()).to_vec();
            sums.push(Statement::Variable("product".into(), Real::at(&names.state_biases, i())));
            sums.push(product("product", &names.state_weights, (row, units), state()));
            sums.push(Statement::set(&names.gates, gate(3), Real::local("product")));
            let candidate = Real::local("sum").plus(value(0).times(Real::local("product")));
            sums.push(Statement::set(&names.gates, gate(2), tanh(candidate)));
            body.push(Statement::each("i", units, sums));
            let state = rest(value(1)).times(value(2)).plus(value(1).times(at(&names.states, &places.from)));
            vec![Statement::set(&names.states, places.to.clone().plus(i()), state)]
        }
        Cell::Lstm => {
            rows(0, 2, logistic);
            rows(2, 1, tanh);
            rows(3, 1, logistic);
            let memory = value(1).times(at(&names.memory, &places.from)).plus(value(0).times(value(2)));
            let state = value(3).times(tanh(at(&names.memory, &places.to)));
            vec![
                Statement::set(&names.memory, places.to.clone().plus(i()), memory),
                Statement::set(&names.states, places.to.clone().plus(i()), state),
            ]
        }
    };
    body.push(Statement::each("i", units, end));
    body
}

/// The array `by_sums` of a unit from `by_state` (and `by_memory`), which become those before the step but for the products with the state.
fn gate_slopes(cell: Cell, names: &Names, units: usize, places: &Places) -> Vec<Statement> {
    let gate = |at: usize| Real::at(&names.gates, places.gates.clone().plus(at * units).plus(i()));
    let at = |array: &str, place: &Index| Real::at(array, place.clone().plus(i()));
    let by_state = || Real::at("by_state", i());
    let set = |at: usize, value: Real| Statement::set("by_sums", i().plus(at * units), value);
    // The derivative of a logistic function and of a tanh, from their values.
    let logistic_slope = |at: usize| gate(at).times(rest(gate(at)));
    let tanh_slope = |value: Real| rest(value.clone().times(value));
    match cell {
        Cell::Rnn => {
            vec![set(0, by_state().times(tanh_slope(gate(0)))), Statement::set("by_state", i(), Real::Number(0.0))]
        }
        Cell::Gru => {
            let candidate = || Real::local("candidate");
            let change = at(&names.states, &places.from).minus(gate(2));
            vec![
                Statement::Let("candidate".into(), by_state().times(rest(gate(1))).times(tanh_slope(gate(2)))),
                set(0, candidate().times(gate(3)).times(logistic_slope(0))),
                set(1, by_state().times(change).times(logistic_slope(1))),
                set(2, candidate()),
                set(3, candidate().times(gate(0))),
                Statement::set("by_state", i(), by_state().times(gate(1))),
            ]
        }
        Cell::Lstm => {
            let squashed = || Real::local("squashed");
            let by_new = || Real::local("by_new");
            let through = by_state().times(gate(3)).times(tanh_slope(squashed()));
            vec![
                Statement::Let("squashed".into(), tanh(at(&names.memory, &places.to))),
                Statement::Let("by_new".into(), Real::at("by_memory", i()).plus(through)),
                set(0, by_new().times(gate(2)).times(logistic_slope(0))),
                set(1, by_new().times(at(&names.memory, &places.from)).times(logistic_slope(1))),
                set(2, by_new().times(gate(0)).times(tanh_slope(gate(2)))),
                set(3, by_state().times(squashed()).times(logistic_slope(3))),
                Statement::set("by_memory", i(), by_new().times(gate(1))),
                Statement::set("by_state", i(), Real::Number(0.0)),
            ]
        }
    }
}

/// Adds the products with the state before a step to `by_state`.
fn state_slopes(cell: &Recurrent, names: &Names) -> Vec<Statement> {
    let units = cell.count();
    let rows = |first: usize, count: usize, sums: usize| {
        let weight = Real::at(&names.state_weights, i().plus(first * units).times(units).plus(j()));
        let term = weight.times(Real::at("by_sums", i().plus(sums * units)));
        Statement::each(
            "i",
            count * units,
            vec![Statement::each("j", units, vec![Statement::add("by_state", j(), term)])],
        )
    };
    match cell.cell {
        Cell::Rnn | Cell::Lstm => vec![rows(0, cell.cell.gates(), 0)],
        Cell::Gru => vec![rows(0, 2, 0), rows(2, 1, 3)],
    }
}
