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
    operator::{Graph, Value, apply, check, name_of, problem_of},
    tensor::Constant,
};

/// First version of the operators in which sums and products spread a row over all rows.
const OLDEST_OPERATORS: i64 = 7;
/// Nodes of a graph; networks of this kind have a few a layer.
const MOST_NODES: usize = 1_000;
/// Numbers that values of the graph may hold together: 256 MiB.
const MOST_NUMBERS: usize = 1 << 25;

/// A feed-forward network: `y = c + A x + B h(x)` with the units h of its last hidden layer.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct OnnxNetwork {
    /// c, one an output.
    pub constants: Vec<f64>,
    /// A, outputs x inputs.
    pub linear: Vec<Vec<f64>>,
    /// The hidden layers, of all inputs in their order; `None` for an affine map.
    pub hidden: Option<Arc<Network>>,
    /// B, outputs x units; empty without hidden layers.
    pub weights: Vec<Vec<f64>>,
}

impl OnnxNetwork {
    /// Bytes of a file that are read at most.
    pub const MOST_BYTES: u64 = 8 << 20;

    /// Reads a file whose network has an input and an output for each of these names, in their order.
    ///
    /// # Errors
    /// [`OnnxError`]: damaged bytes, another operator, a graph that is not a feed-forward network, other sizes.
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
        let (batch, width) = shape(input, "input")?;
        size("inputs", width, inputs)?;
        if let Some(shape) = output.r#type.as_ref().and_then(|of| of.tensor_type.as_ref()?.shape.as_ref())
            && let [_, columns] = shape.dim.as_slice()
            && columns.dim_value > 0
        {
            size("outputs", columns.dim_value as usize, outputs)?;
        }
        let mut graph = Values::new(graph, input, width, batch)?.run()?;
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
                Some(hidden) => {
                    let basis = Basis::Network(hidden.clone());
                    BasisMap { affine, basis, weights: vec![self.weights[output].clone()] }.into()
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

/// Rows, where they are fixed, and columns of the input.
fn shape(value: &ValueProto, what: &str) -> Result<(Option<i64>, usize), OnnxError> {
    let problem = |problem: String| OnnxError::Graph(format!("the {what} `{}` {problem}", value.name));
    let tensor = value.r#type.as_ref().and_then(|of| of.tensor_type.as_ref());
    let Some(tensor) = tensor else { return Err(problem("is not a tensor".into())) };
    if ![FLOAT, DOUBLE].contains(&tensor.elem_type) {
        return Err(problem(format!(
            "has elements of the type {}; networks read 32-bit ({FLOAT}) or 64-bit ({DOUBLE}) floats",
            tensor.elem_type
        )));
    }
    let dims = tensor.shape.as_ref().map_or(&[][..], |shape| &shape.dim);
    let [rows, columns] = dims else {
        return Err(problem(format!("has {} dimensions; networks read rows x columns", dims.len())));
    };
    match usize::try_from(columns.dim_value) {
        Ok(width) if width > 0 => Ok(((rows.dim_value > 0).then_some(rows.dim_value), width)),
        _ => Err(problem(format!(
            "has no fixed number of columns (`{}`); only the number of rows may be open",
            columns.dim_param
        ))),
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
    fn new(graph: &'a GraphProto, input: &'a ValueProto, width: usize, batch: Option<i64>) -> Result<Self, OnnxError> {
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
        values.insert(input.name.as_str(), Value::Computed(Combination::inputs(width)));
        let mut reads: HashMap<&str, usize> = HashMap::new();
        let read = graph.node.iter().flat_map(|node| &node.input).chain(graph.output.iter().map(|value| &value.name));
        read.for_each(|name| *reads.entry(name.as_str()).or_default() += 1);
        let context = Graph { hidden: Hidden::default(), batch };
        Ok(Self { graph, values, reads, numbers: 0, context })
    }

    fn run(mut self) -> Result<Self, OnnxError> {
        for (at, node) in self.graph.node.iter().enumerate() {
            check(node)?;
            let inputs = node.input.iter().filter(|name| !name.is_empty());
            let inputs = inputs.map(|name| self.take(name, at, node)).collect::<Result<Vec<Value>, OnnxError>>()?;
            let value = apply(node, inputs, &mut self.context).map_err(|problem| problem_of(node, problem))?;
            let output = node.output[0].as_str();
            if self.values.contains_key(output) {
                return Err(problem_of(node, format!("its output `{output}` has the name of another value")));
            }
            // A value that nothing reads is not kept.
            if self.reads.contains_key(output) {
                self.keep(output, value, node)?;
            }
        }
        Ok(self)
    }

    fn keep(&mut self, output: &'a str, value: Value, node: &NodeProto) -> Result<(), OnnxError> {
        if let Value::Computed(value) = &value {
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
        if let (0, Some(Value::Computed(value))) = (*left, &value) {
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
    let (centre, scale) = match hidden.frame.take() {
        Some(frame) if hidden.is_framed => frame,
        _ => (vec![0.0; inputs], vec![1.0; inputs]),
    };
    let hidden = hidden.activation.map(|activation| {
        Arc::new(Network { inputs: (0..inputs).collect(), centre, scale, activation, layers: hidden.layers })
    });
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
