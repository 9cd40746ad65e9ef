//! The operators of a network's nodes.

use std::rc::Rc;

use fleetfoot_model::Activation;

use super::{
    combination::{Combination, Elementwise, Hidden},
    error::OnnxError,
    messages::{DOUBLE, FLOAT, NodeProto},
    sequence,
    tensor::Constant,
    value::Value,
};

/// Context of a node.
pub(super) struct Graph {
    pub(super) hidden: Hidden,
    /// Rows of the input, where the file fixes them.
    pub(super) batch: Option<i64>,
}

/// The name of a node for messages, else its output.
pub(super) fn name_of(node: &NodeProto) -> String {
    match (node.name.as_str(), node.output.first()) {
        ("", Some(output)) => output.clone(),
        (name, _) => name.to_owned(),
    }
}

/// The error of a node, from its problem in words.
pub(super) fn problem_of(node: &NodeProto, problem: impl Into<String>) -> OnnxError {
    OnnxError::Node { node: name_of(node), operator: node.op_type.clone(), problem: problem.into() }
}

/// Attributes that an operator has; `None` for an operator that is not read.
fn attributes_of(operator: &str) -> Option<&'static [&'static str]> {
    Some(match operator {
        "Gemm" => &["alpha", "beta", "transA", "transB"],
        "Constant" => &["value", "value_float", "value_floats", "value_int", "value_ints"],
        "Cast" => &["to", "saturate"],
        "Flatten" => &["axis"],
        "Reshape" => &["allowzero"],
        "Gather" => &["axis"],
        "Transpose" => &["perm"],
        "Squeeze" => &["axes"],
        "RNN" | "GRU" | "LSTM" => {
            &["hidden_size", "direction", "activations", "layout", "linear_before_reset", "input_forget"]
        }
        "MatMul" | "Add" | "Sub" | "Mul" | "Div" | "Relu" | "Tanh" | "Sigmoid" | "Softplus" | "Identity" => &[],
        _ => return None,
    })
}

/// Checks that a node has an operator, attributes and an output that are read.
///
/// # Errors
/// [`OnnxError::Operator`], [`OnnxError::Node`].
pub(super) fn check(node: &NodeProto) -> Result<(), OnnxError> {
    let is_standard = matches!(node.domain.as_str(), "" | "ai.onnx");
    let Some(attributes) = attributes_of(&node.op_type).filter(|_| is_standard) else {
        let operator = if is_standard { node.op_type.clone() } else { format!("{}.{}", node.domain, node.op_type) };
        return Err(OnnxError::Operator { node: name_of(node), operator });
    };
    if let Some(unknown) = node.attribute.iter().find(|attribute| !attributes.contains(&attribute.name.as_str())) {
        return Err(problem_of(node, format!("the attribute `{}` is not supported", unknown.name)));
    }
    match node.output.as_slice() {
        _ if sequence::cell_of(&node.op_type).is_some() => Ok(()),
        [output] if !output.is_empty() => Ok(()),
        outputs => Err(problem_of(node, format!("{} outputs, where the operator has one", outputs.len()))),
    }
}

/// The value of a node, whose operator was checked, from those of its inputs.
///
/// # Errors
/// The problem, in words.
pub(super) fn apply(node: &NodeProto, mut inputs: Vec<Value>, graph: &mut Graph) -> Result<Value, String> {
    let integer = |name: &str, default: i64| node.get(name).map_or(default, |attribute| attribute.i);
    let expected = match node.op_type.as_str() {
        "Constant" => 0..=0,
        "Gemm" => 2..=3,
        "MatMul" | "Add" | "Sub" | "Mul" | "Div" | "Reshape" | "Gather" => 2..=2,
        "Squeeze" => 1..=2,
        _ => 1..=1,
    };
    if !expected.contains(&inputs.len()) {
        return Err(format!("{} inputs, where the operator has {}", inputs.len(), expected.end()));
    }
    if node.op_type == "Constant" {
        return constant(node).map(|constant| Value::Constant(Rc::new(constant)));
    }
    let first = match inputs.remove(0) {
        Value::Sequence(sequence) => return sequence.apply(node, &inputs),
        first => first,
    };
    match node.op_type.as_str() {
        "Gemm" => gemm(node, first, inputs, graph),
        "MatMul" => match (first, inputs.remove(0)) {
            (Value::Computed(left), Value::Constant(right)) => times(left, &right, false, graph).map(Value::Computed),
            (Value::Computed(_), Value::Computed(_)) => Err("it multiplies two computed values".into()),
            (_, Value::Sequence(_)) => Err("it multiplies steps".into()),
            (_, _) => Err("a constant stands on the left; weights stand on the right".into()),
        },
        "Add" => elementwise(Elementwise::Add, first, inputs.remove(0), graph),
        "Sub" => elementwise(Elementwise::Sub, first, inputs.remove(0), graph),
        "Mul" => elementwise(Elementwise::Mul, first, inputs.remove(0), graph),
        "Div" => elementwise(Elementwise::Div, first, inputs.remove(0), graph),
        "Relu" => activated(first, Activation::Relu, false, graph),
        "Tanh" => activated(first, Activation::Tanh, false, graph),
        "Sigmoid" => activated(first, Activation::Tanh, true, graph),
        "Softplus" => activated(first, Activation::Softplus, false, graph),
        "Cast" if ![FLOAT, DOUBLE].map(i64::from).contains(&integer("to", 0)) => Err(format!(
            "it converts to the type {}; only 32-bit ({FLOAT}) and 64-bit ({DOUBLE}) floats are read",
            integer("to", 0)
        )),
        "Flatten" => match (integer("axis", 1), first) {
            (1 | -1, Value::Computed(value)) => Ok(Value::Computed(value)),
            (axis, _) => Err(format!("axis {axis} changes the shape; only a Flatten that changes nothing is read")),
        },
        "Gather" => match first {
            Value::Computed(value) => sequence::gathered(node, value, &inputs.remove(0), &mut graph.hidden),
            _ => Err("it reads a constant; export the network with constants folded".into()),
        },
        "Transpose" | "Squeeze" => Err("it changes the dimensions of rows; only those of steps are changed".into()),
        "Reshape" => reshaped(first, &inputs.remove(0), integer("allowzero", 0) == 0, graph.batch),
        // Identity, and a Cast from float to float.
        _ => Ok(first),
    }
}

fn constant(node: &NodeProto) -> Result<Constant, String> {
    let scalar = |values: Vec<f64>, dims: Vec<usize>, is_integer| Constant { dims, values, is_integer };
    let [attribute] = node.attribute.as_slice() else {
        return Err(format!("{} attributes, where a constant has one", node.attribute.len()));
    };
    let constant = match (attribute.name.as_str(), &attribute.t) {
        ("value", Some(tensor)) => Constant::read(tensor)?,
        ("value", None) => return Err("its value is missing".into()),
        ("value_float", _) => scalar(vec![attribute.f.into()], Vec::new(), false),
        ("value_int", _) => scalar(vec![attribute.i as f64], Vec::new(), true),
        ("value_floats", _) => {
            scalar(attribute.floats.iter().copied().map(f64::from).collect(), vec![attribute.floats.len()], false)
        }
        _ => scalar(attribute.ints.iter().map(|&i| i as f64).collect(), vec![attribute.ints.len()], true),
    };
    match constant.values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(format!("a value is {value}; train the network again")),
        None => Ok(constant),
    }
}

/// `alpha A B + beta C`, where B and C are constants.
fn gemm(node: &NodeProto, left: Value, mut others: Vec<Value>, graph: &mut Graph) -> Result<Value, String> {
    let integer = |name: &str| node.get(name).map_or(0, |attribute| attribute.i);
    let float = |name: &str| node.get(name).map_or(1.0, |attribute| f64::from(attribute.f));
    let (alpha, beta) = (float("alpha"), float("beta"));
    if !(alpha.is_finite() && beta.is_finite()) {
        return Err(format!("alpha {alpha}, beta {beta}; both must be finite"));
    }
    if integer("transA") != 0 {
        return Err("transA is set; rows of the input must stay rows".into());
    }
    let (Value::Computed(left), Value::Constant(weights)) = (left, others.remove(0)) else {
        return Err("the first factor must be computed, the second constant".into());
    };
    let mut value = times(left, &weights, integer("transB") != 0, graph)?;
    if alpha != 1.0 {
        let row = vec![alpha; value.width()];
        value = value.with_row(Elementwise::Mul, &row);
    }
    match others.pop() {
        None => Ok(Value::Computed(value)),
        Some(Value::Computed(_) | Value::Sequence(_)) => {
            Err("its third input is computed; only constant biases are read".into())
        }
        Some(Value::Constant(biases)) => {
            let row = row_of(&biases, value.width())?.into_iter().map(|bias| beta * bias).collect::<Vec<f64>>();
            Ok(Value::Computed(value.with_row(Elementwise::Add, &row)))
        }
    }
}

fn times(left: Combination, right: &Constant, transposed: bool, graph: &mut Graph) -> Result<Combination, String> {
    let matrix = right.matrix(transposed, left.width()).filter(|_| !right.is_integer).ok_or_else(|| {
        let (rows, columns) = if transposed { ("columns", "rows") } else { ("rows", "columns") };
        format!(
            "weights of the shape {:?} for {} values; they need as many {rows}, and {columns}",
            right.dims,
            left.width()
        )
    })?;
    Ok(left.times(&matrix, &mut graph.hidden))
}

fn row_of(constant: &Constant, width: usize) -> Result<Vec<f64>, String> {
    constant.row(width).filter(|_| !constant.is_integer).ok_or_else(|| {
        format!("a constant of the shape {:?} for {width} values; it needs one number a value", constant.dims)
    })
}

fn elementwise(operation: Elementwise, left: Value, right: Value, graph: &Graph) -> Result<Value, String> {
    let value = match (left, right) {
        (Value::Computed(left), Value::Constant(right)) => {
            let row = row_of(&right, left.width())?;
            if operation == Elementwise::Div && row.contains(&0.0) {
                return Err("it divides by zero".into());
            }
            left.with_row(operation, &row)
        }
        (Value::Constant(left), Value::Computed(right)) => {
            let row = row_of(&left, right.width())?;
            match operation {
                Elementwise::Add | Elementwise::Mul => right.with_row(operation, &row),
                Elementwise::Sub => {
                    let minus = vec![-1.0; row.len()];
                    right.with_row(Elementwise::Mul, &minus).with_row(Elementwise::Add, &row)
                }
                Elementwise::Div => return Err("it divides by a computed value".into()),
            }
        }
        (Value::Computed(left), Value::Computed(right)) => {
            let sign = match operation {
                Elementwise::Add => 1.0,
                Elementwise::Sub => -1.0,
                Elementwise::Mul | Elementwise::Div => {
                    return Err("it multiplies or divides two computed values; only constants may scale".into());
                }
            };
            if left.width() != right.width() {
                return Err(format!("{} and {} values; both must have the same number", left.width(), right.width()));
            }
            left.plus(sign, right, &graph.hidden)?
        }
        (_, Value::Sequence(_)) | (Value::Sequence(_), _) => {
            return Err("it computes with steps, which only a recurrent cell reads".into());
        }
        (Value::Constant(_), Value::Constant(_)) => {
            return Err("it computes with constants alone; export the network with constants folded".into());
        }
    };
    Ok(Value::Computed(value))
}

fn activated(value: Value, activation: Activation, is_sigmoid: bool, graph: &mut Graph) -> Result<Value, String> {
    match value {
        Value::Computed(sums) => sums.activated(activation, is_sigmoid, &mut graph.hidden).map(Value::Computed),
        _ => Err("it reads a constant".into()),
    }
}

/// A Reshape to the shape that there is.
fn reshaped(value: Value, shape: &Value, copies_zero: bool, batch: Option<i64>) -> Result<Value, String> {
    let (Value::Computed(value), Value::Constant(shape)) = (value, shape) else {
        return Err("only a computed value of a constant shape is read".into());
    };
    if shape.dims == [3] {
        let text = format!("the shape {:?} for rows of {} values", shape.values, value.width());
        return sequence::windowed(value, shape, batch).ok_or(text);
    }
    let kept = |dim: f64| dim == 0.0 && copies_zero;
    let is_same = match shape.values.as_slice() {
        &[rows, columns] => {
            let same_rows = kept(rows) || batch.is_some_and(|batch| rows == batch as f64);
            let same_columns = kept(columns) || columns == value.width() as f64;
            (same_rows && (same_columns || columns == -1.0)) || (rows == -1.0 && same_columns)
        }
        _ => false,
    };
    match is_same {
        true => Ok(Value::Computed(value)),
        false => Err(format!(
            "the shape {:?} for rows of {} values; only a Reshape that changes nothing is read",
            shape.values,
            value.width()
        )),
    }
}
