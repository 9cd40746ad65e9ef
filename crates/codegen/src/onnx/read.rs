//! A network from the graph of an ONNX file.

use std::{
    collections::{HashMap, HashSet},
    rc::Rc,
    sync::Arc,
};

use fleetfoot_model::{AffineMap, Basis, BasisMap, Map, Network};
use prost::Message;

use super::{
    combination::{Combination, Hidden},
    error::OnnxError,
    messages::{DOUBLE, FLOAT, GraphProto, ModelProto, NodeProto, ValueProto},
    operator::{Graph, apply, check, name_of, problem_of},
    sequence,
    tensor::Constant,
    value::{Dimension, Sequence, Value},
};

/// First version of the operators in which sums and products spread a row over all rows.
const OLDEST_OPERATORS: i64 = 7;
/// Nodes of a graph; networks of this kind have a few a layer.
const MOST_NODES: usize = 1_000;
/// Numbers that values of the graph may hold together: 256 MiB.
const MOST_NUMBERS: usize = 1 << 25;

/// A network: `y = c + A x + B h(x)` with the units h of its last hidden layer, or the last state h of a recurrent cell.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct OnnxNetwork {
    /// c, one an output.
    pub constants: Vec<f64>,
    /// A, outputs x inputs.
    pub linear: Vec<Vec<f64>>,
    /// The hidden layers, of all inputs in their order, or the recurrent cell; `None` for an affine map.
    pub hidden: Option<Basis>,
    /// B, outputs x units; empty without hidden layers.
    pub weights: Vec<Vec<f64>>,
}

impl OnnxNetwork {
    /// Bytes of a file that are read at most.
    pub const MOST_BYTES: u64 = 8 << 20;

    /// Reads a file whose network has an input and an output for each of these names, in their order.
    ///
    /// # Errors
    /// [`OnnxError`]: damaged bytes, another operator, a graph that is no such network, other sizes.
    pub fn read(bytes: &[u8], inputs: &[String], outputs: &[String]) -> Result<Self, OnnxError> {
        if bytes.len() as u64 > Self::MOST_BYTES {
            return Err(OnnxError::TooLarge { bytes: bytes.len() as u64, most: Self::MOST_BYTES });
        }
        let model = ModelProto::decode(bytes)?;
        let Some(graph) = &model.graph else {
            return Err(OnnxError::Graph("the file has no graph; export the network again".into()));
        };
        if graph.node.len() > MOST_NODES {
            return Err(OnnxError::Graph(format!(
                "{} nodes, and networks of at most {MOST_NODES} are read; export a smaller network",
                graph.node.len()
            )));
        }
        let standard = model.opset_import.iter().find(|set| matches!(set.domain.as_str(), "" | "ai.onnx"));
        let version = standard.map_or(1, |set| set.version);
        if version < OLDEST_OPERATORS {
            return Err(OnnxError::Graph(format!(
                "operators of version {version}; export the network with version {OLDEST_OPERATORS} or later"
            )));
        }
        let (input, output) = interface(graph)?;
        let shape = Shape::of(input)?;
        let width = shape.steps.saturating_mul(shape.columns);
        size("inputs", width, inputs)?;
        if let Some(shape) = output.r#type.as_ref().and_then(|of| of.tensor_type.as_ref()?.shape.as_ref())
            && let [_, columns] = shape.dim.as_slice()
            && columns.dim_value > 0
        {
            size("outputs", columns.dim_value as usize, outputs)?;
        }
        let mut graph = Values::new(graph, input, &shape)?.run()?;
        let Some(Value::Computed(value)) = graph.values.remove(output.name.as_str()) else {
            return Err(OnnxError::Graph(format!("the output `{}` is not computed from the input", output.name)));
        };
        size("outputs", value.width(), outputs)?;
        network(value, width, graph.context.hidden)
    }

    /// The map of each output, from functions in the order of the inputs.
    pub fn maps(&self) -> Vec<Map> {
        let map = |(output, constant): (usize, &f64)| {
            let affine = AffineMap { constants: vec![*constant], coefficients: vec![self.linear[output].clone()] };
            match &self.hidden {
                None => affine.into(),
                Some(basis) => {
                    BasisMap { affine, basis: basis.clone(), weights: vec![self.weights[output].clone()] }.into()
                }
            }
        };
        self.constants.iter().enumerate().map(map).collect()
    }
}

/// The only input and the only output of the graph.
fn interface(graph: &GraphProto) -> Result<(&ValueProto, &ValueProto), OnnxError> {
    // Old files list the weights among the inputs.
    let constants: HashSet<&str> = graph.initializer.iter().map(|tensor| tensor.name.as_str()).collect();
    let given: Vec<&ValueProto> = graph.input.iter().filter(|input| !constants.contains(input.name.as_str())).collect();
    let named = |values: &[&ValueProto]| {
        let names: Vec<String> = values.iter().take(8).map(|value| format!("`{}`", value.name)).collect();
        if names.is_empty() { "none".to_owned() } else { names.join(", ") }
    };
    let outputs: Vec<&ValueProto> = graph.output.iter().collect();
    match (given.as_slice(), outputs.as_slice()) {
        (&[input], &[output]) => Ok((input, output)),
        (&[_], outputs) => Err(OnnxError::Graph(format!(
            "{} outputs ({}); export a network with one output tensor",
            outputs.len(),
            named(outputs)
        ))),
        (inputs, _) => Err(OnnxError::Graph(format!(
            "{} inputs ({}); export a network with one input tensor",
            inputs.len(),
            named(inputs)
        ))),
    }
}

/// Shape of the input.
struct Shape {
    /// Rows, where the file fixes them.
    batch: Option<i64>,
    /// 1 for rows of columns.
    steps: usize,
    columns: usize,
    /// Order of the dimensions of an input of steps.
    dimensions: Option<[Dimension; 3]>,
}

impl Shape {
    /// That of rows x columns, or of steps x rows x columns in either order of the first two: the one that is fixed has the steps.
    fn of(value: &ValueProto) -> Result<Self, OnnxError> {
        let problem = |problem: String| OnnxError::Graph(format!("the input `{}` {problem}", value.name));
        let tensor = value.r#type.as_ref().and_then(|of| of.tensor_type.as_ref());
        let Some(tensor) = tensor else { return Err(problem("is not a tensor".into())) };
        if ![FLOAT, DOUBLE].contains(&tensor.elem_type) {
            return Err(problem(format!(
                "has elements of the type {}; networks read 32-bit ({FLOAT}) or 64-bit ({DOUBLE}) floats",
                tensor.elem_type
            )));
        }
        let dims = tensor.shape.as_ref().map_or(&[][..], |shape| &shape.dim);
        let fixed = |at: usize| usize::try_from(dims[at].dim_value).ok().filter(|&size| size > 0);
        let columns = |at: usize| {
            fixed(at).ok_or_else(|| {
                problem(format!(
                    "has no fixed number of columns (`{}`); only the number of rows may be open",
                    dims[at].dim_param
                ))
            })
        };
        match dims.len() {
            2 => {
                let batch = (dims[0].dim_value > 0).then_some(dims[0].dim_value);
                Ok(Self { batch, steps: 1, columns: columns(1)?, dimensions: None })
            }
            3 => {
                let columns = columns(2)?;
                let (steps, dimensions) = match (fixed(0), fixed(1)) {
                    (Some(steps), None | Some(1)) => (steps, [Dimension::Steps, Dimension::Rows, Dimension::Columns]),
                    (None | Some(1), Some(steps)) => (steps, [Dimension::Rows, Dimension::Steps, Dimension::Columns]),
                    _ => {
                        return Err(problem(
                            "has three dimensions; one of the first two must be the fixed number of steps, the other open or 1".into(),
                        ));
                    }
                };
                Ok(Self { batch: None, steps, columns, dimensions: Some(dimensions) })
            }
            count => Err(problem(format!(
                "has {count} dimensions; networks read rows x columns, cells steps x rows x columns"
            ))),
        }
    }

    /// The input: columns are the regressors of a recipe, whose lags are step by step from the latest.
    fn value(&self) -> Value {
        let width = self.steps * self.columns;
        let inputs = Combination::inputs(width);
        let Some(dimensions) = self.dimensions else { return Value::Computed(inputs) };
        let latest_last = |place: usize| (self.steps - 1 - place / self.columns) * self.columns + place % self.columns;
        let row = |input: usize| (0..width).map(|place| f64::from(latest_last(place) == input)).collect();
        let matrix = (0..width).map(row).collect();
        let window = inputs.times(&matrix, &mut Hidden::default());
        Value::Sequence(Box::new(Sequence::window(window, self.steps, dimensions)))
    }
}

fn size(what: &'static str, actual: usize, names: &[String]) -> Result<(), OnnxError> {
    match actual == names.len() {
        true => Ok(()),
        false => Err(OnnxError::Size { what, actual, names: names.to_vec() }),
    }
}

/// The values of a graph while its nodes run.
struct Values<'a> {
    graph: &'a GraphProto,
    values: HashMap<&'a str, Value>,
    /// Number of nodes that still read each value.
    reads: HashMap<&'a str, usize>,
    /// Numbers that the computed values hold.
    numbers: usize,
    context: Graph,
}

impl<'a> Values<'a> {
    fn new(graph: &'a GraphProto, input: &'a ValueProto, shape: &Shape) -> Result<Self, OnnxError> {
        if !graph.sparse_initializer.is_empty() {
            return Err(OnnxError::Graph("it has sparse tensors; export the network with dense weights".into()));
        }
        let mut values = HashMap::new();
        for tensor in &graph.initializer {
            let constant =
                Constant::read(tensor).map_err(|problem| OnnxError::Tensor { tensor: tensor.name.clone(), problem })?;
            if values.insert(tensor.name.as_str(), Value::Constant(Rc::new(constant))).is_some() {
                return Err(OnnxError::Graph(format!("two tensors have the name `{}`", tensor.name)));
            }
        }
        values.insert(input.name.as_str(), shape.value());
        let mut reads: HashMap<&str, usize> = HashMap::new();
        let read = graph.node.iter().flat_map(|node| &node.input).chain(graph.output.iter().map(|value| &value.name));
        read.for_each(|name| *reads.entry(name.as_str()).or_default() += 1);
        let context = Graph { hidden: Hidden::default(), batch: shape.batch };
        Ok(Self { graph, values, reads, numbers: 0, context })
    }

    fn run(mut self) -> Result<Self, OnnxError> {
        for (at, node) in self.graph.node.iter().enumerate() {
            check(node)?;
            let inputs = node.input.iter().filter(|name| !name.is_empty());
            let inputs = inputs.map(|name| self.take(name, at, node)).collect::<Result<Vec<Value>, OnnxError>>()?;
            let problem = |problem| problem_of(node, problem);
            let values = match sequence::cell_of(&node.op_type) {
                Some(_) => sequence::states(node, inputs, &mut self.context.hidden).map_err(problem)?.to_vec(),
                None => vec![apply(node, inputs, &mut self.context).map_err(problem)?],
            };
            for (output, value) in
                node.output.iter().map(String::as_str).zip(values).filter(|(output, _)| !output.is_empty())
            {
                if self.values.contains_key(output) {
                    return Err(problem_of(node, format!("its output `{output}` has the name of another value")));
                }
                // A value that nothing reads is not kept.
                if self.reads.contains_key(output) {
                    self.keep(output, value, node)?;
                }
            }
        }
        Ok(self)
    }

    fn keep(&mut self, output: &'a str, value: Value, node: &NodeProto) -> Result<(), OnnxError> {
        if let Some(value) = value.combination() {
            self.numbers += value.numbers();
            if self.numbers > MOST_NUMBERS {
                return Err(problem_of(node, "the values of the network take more than 256 MiB"));
            }
        }
        self.values.insert(output, value);
        Ok(())
    }

    /// A value that a node reads; it is kept only if others read it too.
    fn take(&mut self, name: &'a str, at: usize, node: &NodeProto) -> Result<Value, OnnxError> {
        let left = self.reads.entry(name).or_default();
        *left = left.saturating_sub(1);
        let value = match left {
            0 => self.values.remove(name),
            _ => self.values.get(name).cloned(),
        };
        if let (0, Some(value)) = (*left, value.as_ref().and_then(Value::combination)) {
            self.numbers = self.numbers.saturating_sub(value.numbers());
        }
        value.ok_or_else(|| {
            let later = self.graph.node[at..].iter().find(|other| other.output.iter().any(|output| output == name));
            problem_of(
                node,
                match later {
                    Some(other) => format!(
                        "it reads `{name}`, which node `{}` computes later: a cycle, or nodes out of order",
                        name_of(other)
                    ),
                    None => format!("it reads `{name}`, which nothing computes"),
                },
            )
        })
    }
}

/// The network of an output.
fn network(output: Combination, inputs: usize, mut hidden: Hidden) -> Result<OnnxNetwork, OnnxError> {
    let (constants, linear, weights) = output.parts(inputs, &hidden).map_err(OnnxError::Graph)?;
    let frame = hidden.frame.take().filter(|_| hidden.is_framed);
    let (centre, scale) = frame.unwrap_or_else(|| (vec![0.0; inputs], vec![1.0; inputs]));
    let layers = hidden.layers;
    let dense = hidden.activation.map(|activation| {
        Basis::Network(Arc::new(Network { inputs: (0..inputs).collect(), centre, scale, activation, layers }))
    });
    let hidden = hidden.cell.map(|cell| Basis::Recurrent(Arc::new(cell))).or(dense);
    let network = OnnxNetwork { constants, linear, hidden, weights };
    let outside = network.constants.iter().chain(network.linear.iter().chain(&network.weights).flatten());
    let problem = match &network.hidden {
        Some(hidden) => hidden.check(inputs).err(),
        None => None,
    };
    match (problem, outside.copied().find(|value| !value.is_finite())) {
        (None, None) => Ok(network),
        (Some(problem), _) => Err(OnnxError::Graph(format!("{problem}; train the network again"))),
        (None, Some(value)) => Err(OnnxError::Graph(format!("a weight is {value}; train the network again"))),
    }
}
