//! Tensors of more than two dimensions, which stand around a recurrent cell.

use fleetfoot_model::{Cell, Recurrent};

use super::{
    combination::{Combination, Hidden, Window},
    messages::NodeProto,
    tensor::Constant,
    value::{
        Dimension::{self, Columns, Direction, Rows, Steps},
        Sequence, Value,
    },
};

impl Sequence {
    /// All states of a cell, and the last one.
    fn states(value: Combination, steps: usize) -> [Self; 2] {
        let of = |dimensions: &[Dimension]| Self {
            value: value.clone(),
            steps,
            is_state: true,
            dimensions: dimensions.to_vec(),
        };
        [of(&[Steps, Direction, Rows, Columns]), of(&[Direction, Rows, Columns])]
    }

    /// The value itself where rows and columns are left.
    fn simplified(self) -> Value {
        match self.is_state && self.dimensions == [Rows, Columns] {
            true => Value::Computed(self.value),
            false => Value::Sequence(Box::new(self)),
        }
    }

    /// The value of a node that changes dimensions.
    ///
    /// # Errors
    /// The problem, in words.
    pub(super) fn apply(mut self, node: &NodeProto, others: &[Value]) -> Result<Value, String> {
        let constant = || match others {
            [Value::Constant(constant)] => Some(&constant.values),
            _ => None,
        };
        let ints = |name: &str| node.get(name).map(|attribute| attribute.ints.clone());
        let count = self.dimensions.len() as f64;
        match node.op_type.as_str() {
            "Identity" | "Cast" => {}
            "Transpose" => {
                let order = ints("perm").unwrap_or_else(|| (0..count as i64).rev().collect());
                let at = |&place: &i64| self.dimensions.get(usize::try_from(place).ok()?).copied();
                let dimensions: Option<Vec<Dimension>> = order.iter().map(at).collect();
                let is_whole = |order: &Vec<Dimension>| {
                    order.len() == self.dimensions.len() && self.dimensions.iter().all(|d| order.contains(d))
                };
                let dimensions = dimensions.filter(is_whole);
                self.dimensions = dimensions.ok_or_else(|| format!("the order {order:?} of {count} dimensions"))?;
            }
            "Squeeze" => {
                let axes: Option<Vec<f64>> =
                    constant().cloned().or_else(|| Some(ints("axes")?.iter().map(|&axis| axis as f64).collect()));
                let axes = axes.ok_or("its axes are not constant")?;
                let places: Vec<f64> = axes.iter().map(|&axis| if axis < 0.0 { axis + count } else { axis }).collect();
                let is_direction = |(at, dimension): (usize, &Dimension)| {
                    places.contains(&(at as f64)).then_some(*dimension == Direction)
                };
                let squeezed: Vec<bool> = self.dimensions.iter().enumerate().filter_map(is_direction).collect();
                if squeezed.len() != places.len() || squeezed.contains(&false) {
                    return Err(format!("the axes {axes:?}; only the direction of a cell is removed"));
                }
                self.dimensions.retain(|dimension| *dimension != Direction);
            }
            "Gather" => {
                let axis = node.get("axis").map_or(0.0, |attribute| attribute.i as f64);
                let axis = if axis < 0.0 { axis + count } else { axis };
                let last = [-1.0, self.steps as f64 - 1.0];
                let is_last = matches!(others, [Value::Constant(index)] if index.dims.is_empty() && last.contains(&index.values[0]));
                let is_steps = self.dimensions.iter().position(|d| *d == Steps).is_some_and(|at| at as f64 == axis);
                if !(self.is_state && is_last && is_steps) {
                    return Err("it takes something else than the last state of a cell".into());
                }
                self.dimensions.retain(|dimension| *dimension != Steps);
            }
            "Reshape" => {
                let columns = self.value.width() as f64;
                let is_flat = self.dimensions.iter().all(|d| *d != Steps)
                    && self.dimensions.ends_with(&[Rows, Columns])
                    && matches!(constant().map(Vec::as_slice), Some(&[-1.0, width]) if width == columns);
                if !is_flat || !self.is_state {
                    return Err(format!("only a Reshape of the last state of a cell to [-1, {columns}] is read"));
                }
                self.dimensions = vec![Rows, Columns];
            }
            _ => return Err("it reads steps, which only a recurrent cell reads".into()),
        }
        Ok(self.simplified())
    }
}

/// A Reshape of rows to steps of a window, the shape `[rows, steps, columns]`.
pub(super) fn windowed(value: Combination, shape: &Constant, batch: Option<i64>) -> Option<Value> {
    let &[rows, steps, columns] = shape.values.as_slice() else { return None };
    let same_rows = rows == -1.0 || rows == 0.0 || batch.is_some_and(|batch| rows == batch as f64);
    let is_whole = shape.is_integer && steps >= 1.0 && columns >= 1.0 && steps * columns == value.width() as f64;
    let window = || Sequence::window(value, steps as usize, [Rows, Steps, Columns]);
    (same_rows && is_whole).then(|| Value::Sequence(Box::new(window())))
}

/// Some columns of a value, by a constant list.
///
/// # Errors
/// Another axis, or columns that the value does not have; in words.
pub(super) fn gathered(
    node: &NodeProto,
    value: Combination,
    indices: &Value,
    hidden: &mut Hidden,
) -> Result<Value, String> {
    let axis = node.get("axis").map_or(0, |attribute| attribute.i);
    let width = value.width();
    let place = |&index: &f64| {
        let index = if index < 0.0 { index + width as f64 } else { index };
        (index >= 0.0 && index < width as f64).then_some(index as usize)
    };
    let places: Option<Vec<usize>> = match indices {
        Value::Constant(indices)
            if indices.dims.len() == 1 && matches!(axis, 1 | -1) && indices.values.len() <= width =>
        {
            indices.values.iter().map(place).collect()
        }
        _ => None,
    };
    let places = places.ok_or_else(|| format!("only a constant list of at most {width} columns (axis 1) is taken"))?;
    let matrix = (0..width).map(|i| places.iter().map(|&place| f64::from(place == i)).collect()).collect();
    Ok(Value::Computed(value.times(&matrix, hidden)))
}

/// Cell of an operator, and the operator's gate of each of our gates.
pub(super) fn cell_of(operator: &str) -> Option<(Cell, &'static [usize])> {
    match operator {
        "RNN" => Some((Cell::Rnn, &[0])),
        "GRU" => Some((Cell::Gru, &[1, 0, 2])),
        "LSTM" => Some((Cell::Lstm, &[0, 2, 3, 1])),
        _ => None,
    }
}

/// The states of a cell, all and the last one.
///
/// # Errors
/// Another window, options that the cell does not have, weights of another shape, in words.
pub(super) fn states(node: &NodeProto, mut inputs: Vec<Value>, hidden: &mut Hidden) -> Result<[Value; 2], String> {
    let (cell, order) = cell_of(&node.op_type).ok_or("it is no cell")?;
    check(node, cell)?;
    if hidden.cell.is_some() || !hidden.layers.is_empty() {
        return Err("it stands beside or behind another hidden layer; one cell of one layer is read".into());
    }
    if inputs.len() < 3 {
        return Err(format!("{} inputs, where the operator has 3 at least", inputs.len()));
    }
    let Value::Sequence(window) = inputs.remove(0) else {
        return Err("its input has no steps; reshape the columns to [rows, steps, columns]".into());
    };
    if window.is_state || window.dimensions != [Steps, Rows, Columns] {
        return Err("the dimensions of its input are not steps, rows, columns".into());
    }
    let mut constants = Vec::with_capacity(inputs.len());
    for input in inputs {
        match input {
            Value::Constant(constant) if !constant.is_integer => constants.push(constant),
            _ => return Err("all inputs but the first must be constant, without lengths of sequences".into()),
        }
    }
    let (steps, columns) = (window.steps, window.value.width() / window.steps);
    let gates = cell.gates();
    let units = constants[1].dims.last().copied().unwrap_or(0);
    let rows = gates * units;
    let shape = |at: usize, width: usize| constants[at].dims == [1, rows, width];
    if units == 0 || !shape(0, columns) || !shape(1, units) {
        let shapes = [&constants[0].dims, &constants[1].dims];
        return Err(format!("weights of the shapes {shapes:?} for {columns} columns"));
    }
    let mut biases = vec![0.0; 2 * rows];
    for constant in &constants[2..] {
        match constant.dims.as_slice() {
            &[1, count] if count == 2 * rows => biases.clone_from(&constant.values),
            &[1, _, count] if count == units && constant.values.iter().all(|value| *value == 0.0) => {}
            dims => return Err(format!("an input of the shape {dims:?}; biases and states of zero are read")),
        }
    }
    let mut input_weights: Vec<Vec<f64>> = ordered(&constants[0].values, columns, units, order);
    let state_weights = ordered(&constants[1].values, units, units, order);
    let [of_inputs, of_states] = [&biases[..rows], &biases[rows..]].map(|part| ordered(part, 1, units, order).concat());
    let (mut biases, mut state_biases) = (of_inputs, Vec::new());
    let shared = if cell.resets() { rows - units } else { rows };
    biases[..shared].iter_mut().zip(&of_states).for_each(|(sum, bias)| *sum += bias);
    state_biases.extend_from_slice(&of_states[shared..]);
    let Window { inputs, centre, scale, signs } = window.value.window(columns, hidden)?;
    for row in &mut input_weights {
        row.iter_mut().zip(&signs).for_each(|(weight, sign)| *weight *= sign);
    }
    hidden.cell = Some(Recurrent { cell, inputs, centre, scale, input_weights, state_weights, biases, state_biases });
    Ok(Sequence::states(Combination::units(units), steps).map(|sequence| Value::Sequence(Box::new(sequence))))
}

/// Rows of weights, gate by gate in our order.
fn ordered(values: &[f64], width: usize, units: usize, order: &[usize]) -> Vec<Vec<f64>> {
    let rows: Vec<&[f64]> = values.chunks_exact(width).collect();
    let gate = |&gate: &usize| rows[gate * units..(gate + 1) * units].iter().map(|row| row.to_vec());
    order.iter().flat_map(gate).collect()
}

/// Refuses options of a cell other than the usual ones.
fn check(node: &NodeProto, cell: Cell) -> Result<(), String> {
    let usual: &[&str] = match cell {
        Cell::Rnn => &["Tanh"],
        Cell::Gru => &["Sigmoid", "Tanh"],
        Cell::Lstm => &["Sigmoid", "Tanh", "Tanh"],
    };
    if let Some(activations) = node.get("activations") {
        let names: Vec<String> =
            activations.strings.iter().map(|name| String::from_utf8_lossy(name).into_owned()).collect();
        if !names.iter().map(String::as_str).eq(usual.iter().copied()) {
            return Err(format!("the activations {names:?}; only {usual:?} are read"));
        }
    }
    let direction = node.get("direction").map_or(&b"forward"[..], |direction| &direction.s);
    if direction != b"forward" {
        return Err(format!("the direction {}; only `forward` is read", String::from_utf8_lossy(direction)));
    }
    let whole = |name: &str| node.get(name).map_or(0, |attribute| attribute.i);
    if whole("layout") != 0 || whole("input_forget") != 0 {
        return Err("layout or input_forget is set; export the cell without them".into());
    }
    match cell.resets() && whole("linear_before_reset") == 0 {
        true => {
            Err("its reset acts before the product; train a cell with linear_before_reset = 1, as of PyTorch".into())
        }
        false => Ok(()),
    }
}
