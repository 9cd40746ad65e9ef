//! Graphs built by hand, against the formulas that they compute.

use std::sync::Arc;

use fleetfoot_model::{Activation, Basis, Network};
use proptest::prelude::*;
use prost::Message;

use super::{OnnxError, OnnxNetwork, messages::*};

/// A graph of one input `x` and one output `y`.
struct Net {
    file: ModelProto,
    sizes: [usize; 2],
}

impl Net {
    fn new(inputs: usize, outputs: usize) -> Self {
        let value = |name: &str, columns: usize| {
            let dim = |dim_value: i64| DimensionProto { dim_value, ..DimensionProto::default() };
            let shape = Some(ShapeProto { dim: vec![dim(0), dim(columns as i64)] });
            let tensor_type = Some(TensorTypeProto { elem_type: FLOAT, shape });
            ValueProto { name: name.into(), r#type: Some(TypeProto { tensor_type }) }
        };
        let graph =
            GraphProto { input: vec![value("x", inputs)], output: vec![value("y", outputs)], ..GraphProto::default() };
        let opset_import = vec![OperatorSetProto { domain: String::new(), version: 17 }];
        Self {
            file: ModelProto { graph: Some(graph), opset_import, ..ModelProto::default() },
            sizes: [inputs, outputs],
        }
    }

    fn graph(&mut self) -> &mut GraphProto {
        self.file.graph.as_mut().expect("a graph")
    }

    /// 64-bit weights in raw form.
    fn weight(mut self, name: &str, dims: &[i64], values: &[f64]) -> Self {
        let raw_data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let tensor =
            TensorProto { name: name.into(), dims: dims.to_vec(), data_type: DOUBLE, raw_data, ..Default::default() };
        self.graph().initializer.push(tensor);
        self
    }

    /// Whole numbers.
    fn integers(mut self, name: &str, values: &[i64]) -> Self {
        let (dims, int64_data) = (vec![values.len() as i64], values.to_vec());
        let tensor = TensorProto { name: name.into(), dims, data_type: INT64, int64_data, ..Default::default() };
        self.graph().initializer.push(tensor);
        self
    }

    fn node(mut self, operator: &str, inputs: &[&str], output: &str) -> Self {
        self.graph().node.push(NodeProto {
            op_type: operator.into(),
            input: inputs.iter().map(|&name| name.to_owned()).collect(),
            output: vec![output.into()],
            name: format!("the_{output}"),
            ..NodeProto::default()
        });
        self
    }

    /// Attributes of the last node.
    fn with(mut self, attribute: AttributeProto) -> Self {
        self.graph().node.last_mut().expect("a node").attribute.push(attribute);
        self
    }

    fn integer(self, name: &str, i: i64) -> Self {
        self.with(AttributeProto { name: name.into(), i, kind: 2, ..Default::default() })
    }

    fn read(&self) -> Result<OnnxNetwork, OnnxError> {
        let [inputs, outputs] = self.sizes.map(|count| (0..count).map(|i| format!("c{i}")).collect::<Vec<_>>());
        OnnxNetwork::read(&self.file.encode_to_vec(), &inputs, &outputs)
    }

    /// The outputs at x.
    fn at(&self, x: &[f64]) -> Vec<f64> {
        let network = self.read().unwrap_or_else(|error| panic!("{error}"));
        network.maps().iter().map(|map| map.value(0, x)).collect()
    }

    #[track_caller]
    fn refused(&self, words: &[&str]) {
        let error = self.read().expect_err("a refusal").to_string();
        words.iter().for_each(|word| assert!(error.contains(word), "`{word}` is missing from: {error}"));
    }
}

/// Rounding of a few sums of numbers of size one.
#[track_caller]
fn close(actual: &[f64], expected: &[f64]) {
    assert_eq!(actual.len(), expected.len());
    for (actual, expected) in actual.iter().zip(expected) {
        assert!((actual - expected).abs() <= 1e-14 * expected.abs().max(1.0), "{actual} {expected}");
    }
}

/// The hidden layers of a graph.
fn dense(net: &Net) -> Arc<Network> {
    match net.read().unwrap().hidden {
        Some(Basis::Network(network)) => network,
        other => panic!("{other:?}"),
    }
}

const X: [f64; 2] = [0.3, -1.7];

/// Weights 2 x 3, by rows, of networks below; biases and output weights.
const W: [f64; 6] = [0.5, -1.0, 2.0, 0.25, 1.5, -0.75];
const B: [f64; 3] = [0.1, -0.2, 0.3];
const V: [f64; 3] = [1.0, -2.0, 0.5];

fn sums(x: [f64; 2]) -> [f64; 3] {
    [0, 1, 2].map(|k| x[0] * W[k] + x[1] * W[3 + k] + B[k])
}

/// The output of the units, plus 4.
fn output(units: [f64; 3]) -> f64 {
    4.0 + units.iter().zip(V).map(|(unit, weight)| unit * weight).sum::<f64>()
}

/// A network of one layer after the nodes that give `z`.
fn layer(net: Net, operator: &str) -> Net {
    net.weight("W", &[2, 3], &W)
        .weight("b", &[3], &B)
        .weight("V", &[3, 1], &V)
        .weight("c", &[1], &[4.0])
        .node("MatMul", &["z", "W"], "p")
        .node("Add", &["p", "b"], "s")
        .node(operator, &["s"], "h")
        .node("Gemm", &["h", "V", "c"], "y")
}

#[test]
fn activations_match_their_formulas() {
    type Formula = fn(f64) -> f64;
    let formulas: [(&str, Formula); 4] = [
        ("Tanh", f64::tanh),
        ("Relu", |z| z.max(0.0)),
        ("Softplus", |z| z.exp().ln_1p()),
        ("Sigmoid", |z| 1.0 / (1.0 + (-z).exp())),
    ];
    for (operator, formula) in formulas {
        let net = layer(Net::new(2, 1).node("Identity", &["x"], "z"), operator);
        close(&net.at(&X), &[output(sums(X).map(formula))]);
        assert_eq!(dense(&net).sizes(), "3");
    }
}

#[test]
fn standardisation_is_kept_apart() {
    let (centre, scale) = ([1.0, -2.0], [0.5, 4.0]);
    let net = Net::new(2, 1)
        .weight("m", &[2], &centre)
        .weight("d", &[1, 2], &scale)
        .node("Sub", &["x", "m"], "a")
        .node("Div", &["a", "d"], "z");
    let net = layer(net, "Tanh");
    let z = [0, 1].map(|i| (X[i] - centre[i]) / scale[i]);
    close(&net.at(&X), &[output(sums(z).map(f64::tanh))]);
    let hidden = dense(&net);
    assert_eq!((hidden.centre.clone(), hidden.scale.clone()), (centre.to_vec(), scale.to_vec()));
    assert_eq!(hidden.layers[0].weights[1], [W[1], W[4]]);
}

/// Every way of scaling is a formula, with the constant on both sides and signs of both kinds.
#[test]
fn elementwise_constants_match_their_formulas() {
    type Formula = fn([f64; 2]) -> [f64; 2];
    let ways: [(&str, bool, Formula); 6] = [
        ("Add", true, |x| [x[0] + 2.0, x[1] - 3.0]),
        ("Sub", false, |x| [x[0] - 2.0, x[1] + 3.0]),
        ("Sub", true, |x| [2.0 - x[0], -3.0 - x[1]]),
        ("Mul", true, |x| [x[0] * 2.0, x[1] * -3.0]),
        ("Mul", false, |x| [x[0] * 2.0, x[1] * -3.0]),
        ("Div", false, |x| [x[0] / 2.0, x[1] / -3.0]),
    ];
    for (operator, first, formula) in ways {
        let inputs = if first { ["k", "x"] } else { ["x", "k"] };
        let net = Net::new(2, 1).weight("k", &[2], &[2.0, -3.0]).node(operator, &inputs, "z");
        close(&layer(net, "Tanh").at(&X), &[output(sums(formula(X)).map(f64::tanh))]);
        // The same behind a layer.
        let net = Net::new(2, 2).weight("k", &[2], &[2.0, -3.0]).node("Tanh", &["x"], "h").node(
            operator,
            &if first { ["k", "h"] } else { ["h", "k"] },
            "y",
        );
        close(&net.at(&X), &formula(X.map(f64::tanh)));
    }
}

#[test]
fn products_follow_alpha_beta_and_transposition() {
    let transposed = [W[0], W[3], W[1], W[4], W[2], W[5]];
    let net = Net::new(2, 3)
        .weight("W", &[3, 2], &transposed)
        .weight("b", &[1, 3], &B)
        .node("Gemm", &["x", "W", "b"], "y")
        .integer("transB", 1)
        .with(AttributeProto { name: "alpha".into(), f: 0.5, kind: 1, ..Default::default() })
        .with(AttributeProto { name: "beta".into(), f: -2.0, kind: 1, ..Default::default() });
    let expected = [0, 1, 2].map(|k| 0.5 * (X[0] * W[k] + X[1] * W[3 + k]) - 2.0 * B[k]);
    close(&net.at(&X), &expected);
    assert!(net.read().unwrap().hidden.is_none(), "an affine map has no hidden layer");
}

#[test]
fn outputs_may_add_the_inputs() {
    for subtracted in [false, true] {
        let net = Net::new(2, 2)
            .weight("m", &[2], &[1.0, 2.0])
            .weight("d", &[], &[4.0])
            .node("Sub", &["x", "m"], "a")
            .node("Div", &["a", "d"], "z")
            .weight("A", &[2, 2], &[1.0, 2.0, 3.0, 4.0])
            .node("MatMul", &["z", "A"], "l")
            .node("MatMul", &["x", "A"], "s")
            .node("Tanh", &["s"], "h")
            .node(if subtracted { "Sub" } else { "Add" }, &["l", "h"], "y");
        let z = [(X[0] - 1.0) / 4.0, (X[1] - 2.0) / 4.0];
        let times = |x: [f64; 2]| [x[0] + 3.0 * x[1], 2.0 * x[0] + 4.0 * x[1]];
        let sign = if subtracted { -1.0 } else { 1.0 };
        let (linear, sums) = (times(z), times(X));
        close(&net.at(&X), &[0, 1].map(|k| linear[k] + sign * sums[k].tanh()));
    }
}

#[test]
fn nodes_that_change_nothing_are_read() {
    let shape = TensorProto { dims: vec![2], data_type: INT64, int64_data: vec![-1, 2], ..Default::default() };
    let offset = TensorProto { dims: vec![2], data_type: FLOAT, float_data: vec![0.5, 0.25], ..Default::default() };
    let constant = |t| AttributeProto { name: "value".into(), t: Some(Box::new(t)), kind: 4, ..Default::default() };
    let net = Net::new(2, 2)
        .node("Cast", &["x"], "a")
        .integer("to", 11)
        .node("Flatten", &["a"], "b")
        .integer("axis", 1)
        .node("Constant", &[], "shape")
        .with(constant(shape))
        .node("Reshape", &["b", "shape"], "c")
        .node("Constant", &[], "k")
        .with(constant(offset))
        .node("Add", &["c", "k"], "y");
    close(&net.at(&X), &[X[0] + 0.5, X[1] + 0.25]);
}

#[test]
fn other_graphs_are_refused_by_name() {
    let net = || Net::new(2, 2);
    net().node("Conv", &["x"], "y").refused(&["node `the_y`", "operator Conv", "Gemm, MatMul"]);
    net().node("Relu", &["a"], "y").refused(&["node `the_y` (Relu)", "`a`, which nothing computes"]);
    net().node("Relu", &["y"], "y").refused(&["node `the_y`", "a cycle"]);
    net().node("Relu", &["b"], "a").node("Relu", &["a"], "b").refused(&["`the_a`", "`the_b` computes later", "cycle"]);
    net().node("Mul", &["x", "x"], "y").refused(&["node `the_y` (Mul)", "two computed values"]);
    net().node("MatMul", &["x", "x"], "y").refused(&["node `the_y` (MatMul)", "two computed values"]);
    net().node("Cast", &["x"], "y").integer("to", 10).refused(&["the type 10"]);
    net().node("Flatten", &["x"], "y").integer("axis", 0).refused(&["axis 0"]);
    net().node("Relu", &["x"], "y").integer("axis", 0).refused(&["the attribute `axis`"]);
    net().node("Relu", &["x", "x"], "y").refused(&["2 inputs"]);
    net().weight("k", &[2], &[1.0, 0.0]).node("Div", &["x", "k"], "y").refused(&["divides by zero"]);
    net().weight("k", &[3], &[1.0; 3]).node("Add", &["x", "k"], "y").refused(&["[3]", "2 values"]);
    net().weight("k", &[3, 1], &[1.0; 3]).node("MatMul", &["x", "k"], "y").refused(&["[3, 1]", "2 values"]);
    net().weight("k", &[2, 2], &[1.0; 3]).refused(&["tensor `k`", "3 values for the shape [2, 2]"]);
    net().weight("k", &[1], &[f64::NAN]).refused(&["tensor `k`", "NaN"]);
    net().node("Tanh", &["x"], "h").node("Relu", &["h"], "y").refused(&["`the_y`", "activation differs"]);
    net().node("Tanh", &["x"], "h").node("Tanh", &["x"], "y").refused(&["`the_y`", "beside another hidden layer"]);
    net()
        .node("Tanh", &["x"], "h")
        .node("Add", &["x", "h"], "a")
        .node("Tanh", &["a"], "y")
        .refused(&["`the_y`", "the inputs and a hidden layer"]);
    net()
        .node("Tanh", &["x"], "h")
        .node("Tanh", &["h"], "g")
        .node("Add", &["g", "h"], "y")
        .refused(&["`the_y`", "two hidden layers"]);
    net().weight("y", &[2], &X).refused(&["`y` is not computed"]);
    net().node("Tanh", &["x"], "h").node("Identity", &["x"], "y").refused(&["last hidden layer"]);
}

#[test]
fn files_beyond_one_network_are_refused() {
    let net = || Net::new(2, 2).node("Tanh", &["x"], "y");
    let changed = |change: fn(&mut Net)| {
        let mut net = net();
        change(&mut net);
        net
    };
    changed(|net| net.sizes = [3, 2]).refused(&["2 inputs", "recipe has 3: c0, c1, c2"]);
    changed(|net| net.sizes = [2, 1]).refused(&["2 outputs", "recipe has 1: c0"]);
    changed(|net| net.graph().output.push(ValueProto::default())).refused(&["2 outputs (`y`, ``)"]);
    changed(|net| net.graph().input.clear()).refused(&["0 inputs (none)"]);
    changed(|net| net.file.graph = None).refused(&["no graph"]);
    changed(|net| net.file.opset_import[0].version = 6).refused(&["version 6", "version 7"]);
    changed(|net| net.graph().sparse_initializer.push(vec![])).refused(&["sparse"]);
    changed(|net| net.graph().node[0].domain = "com.microsoft".into()).refused(&["com.microsoft.Tanh"]);
    changed(|net| net.graph().node[0].output.push("mask".into())).refused(&["2 outputs, where"]);
    let shaped = |change: fn(&mut TensorTypeProto)| {
        let mut net = net();
        let of = net.graph().input[0].r#type.as_mut().and_then(|of| of.tensor_type.as_mut());
        change(of.expect("a tensor"));
        net
    };
    shaped(|of| of.elem_type = 10).refused(&["input `x`", "the type 10"]);
    shaped(|of| _ = of.shape.as_mut().map(|shape| shape.dim.pop())).refused(&["1 dimensions"]);
    shaped(|of| of.shape.as_mut().expect("a shape").dim[1] = DimensionProto { dim_value: 0, dim_param: "n".into() })
        .refused(&["no fixed number of columns (`n`)"]);
    changed(|net| net.graph().node = vec![NodeProto::default(); 1_001]).refused(&["1001 nodes", "at most 1000"]);
    let mut outside = Net::new(2, 2).weight("k", &[2], &X).node("Add", &["x", "k"], "y");
    outside.graph().initializer[0].data_location = 1;
    outside.refused(&["tensor `k`", "another file"]);
    let long = vec![0; OnnxNetwork::MOST_BYTES as usize + 1];
    let error = OnnxNetwork::read(&long, &[], &[]).expect_err("a refusal").to_string();
    assert!(error.contains("8388609 bytes"), "{error}");
}

/// A value that many nodes read is not copied without limit.
#[test]
fn memory_of_values_is_bounded() {
    let units = 1_000;
    let wide = vec![0.001; units * units];
    let mut net = Net::new(units, units).weight("W", &[units as i64, units as i64], &wide).weight("k", &[], &[1.0]);
    net = net.node("MatMul", &["x", "W"], "a");
    for copy in 0..40 {
        net = net.node("Add", &["a", "k"], &format!("copy{copy}"));
    }
    for copy in 0..40 {
        let before = if copy == 0 { "a".to_owned() } else { format!("sum{copy}") };
        net = net.node("Add", &[&before, &format!("copy{copy}")], &format!("sum{}", copy + 1));
    }
    net.node("Identity", &["sum40"], "y").refused(&["more than 256 MiB"]);
}

fn layers() -> impl Strategy<Value = (Vec<usize>, u64, usize)> {
    (prop::collection::vec(1usize..6, 2..5), any::<u64>(), 0usize..3)
}

proptest! {
    /// Networks of any size, against the formula layer by layer.
    #[test]
    fn networks_of_any_size_match_their_formula((sizes, seed, activation) in layers()) {
        let mut key = seed;
        let mut draw = || {
            key = key.wrapping_add(1);
            (fleetfoot_data::mix(key) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let activation = Activation::ALL[activation];
        let operator = ["Tanh", "Relu", "Softplus"][Activation::ALL.iter().position(|of| *of == activation).unwrap()];
        let x: Vec<f64> = (0..sizes[0]).map(|_| 2.0 * draw()).collect();
        let mut net = Net::new(sizes[0], sizes[sizes.len() - 1]);
        let (mut values, mut before) = (x.clone(), "x".to_owned());
        for (at, pair) in sizes.windows(2).enumerate() {
            let weights: Vec<f64> = (0..pair[0] * pair[1]).map(|_| draw()).collect();
            let biases: Vec<f64> = (0..pair[1]).map(|_| draw()).collect();
            let names = ["W", "b", "s", "h"].map(|name| format!("{name}{at}"));
            let is_last = at + 2 == sizes.len();
            let sum = if is_last { "y" } else { &names[2] };
            net = net
                .weight(&names[0], &[pair[0] as i64, pair[1] as i64], &weights)
                .weight(&names[1], &[pair[1] as i64], &biases)
                .node("Gemm", &[&before, &names[0], &names[1]], sum);
            let unit = |k: usize| biases[k] + values.iter().enumerate().map(|(i, v)| v * weights[i * pair[1] + k]).sum::<f64>();
            let sums: Vec<f64> = (0..pair[1]).map(unit).collect();
            values = if is_last { sums } else { sums.iter().map(|&sum| activation.value(sum)).collect() };
            if !is_last {
                net = net.node(operator, &[&names[2]], &names[3]);
            }
            before = names[3].clone();
        }
        // Sums of at most five terms a layer, of numbers below ten.
        for (actual, expected) in net.at(&x).iter().zip(&values) {
            prop_assert!((actual - expected).abs() < 1e-12, "{actual} {expected}");
        }
    }
}

/// A GRU of one unit over two rows of one column, whose state is the output; `change` alters it.
fn gru(change: impl Fn(Net) -> Net) -> Net {
    let net = Net::new(2, 1)
        .weight("W", &[1, 3, 1], &[0.5, -1.0, 2.0])
        .weight("R", &[1, 3, 1], &[0.25, 1.5, -0.75])
        .weight("B", &[1, 6], &[0.1, -0.2, 0.3, 0.4, 0.0, -0.5])
        .integers("steps", &[-1, 2, 1])
        .integers("flat", &[-1, 1])
        .node("Reshape", &["x", "steps"], "rows")
        .node("Transpose", &["rows"], "window")
        .with(AttributeProto { name: "perm".into(), ints: vec![1, 0, 2], kind: ATTRIBUTE_INTS, ..Default::default() })
        .node("GRU", &["window", "W", "R", "B"], "all");
    let mut net = change(net.integer("linear_before_reset", 1));
    if let Some(node) = net.graph().node.last_mut() {
        node.output.push("state".into());
    }
    net.node("Reshape", &["state", "flat"], "y")
}

#[test]
fn state_of_a_cell_is_the_output() {
    // Gates of ONNX: update, reset, candidate. The columns of x are the steps, the first of which is the oldest here.
    let logistic = |z: f64| 1.0 / (1.0 + (-z).exp());
    let state = X.iter().fold(0.0, |h, x| {
        let [update, reset] = [logistic(0.5 * x + 0.25 * h + 0.5), logistic(-x + 1.5 * h - 0.2)];
        (1.0 - update) * (2.0 * x + 0.3 + reset * (-0.75 * h - 0.5)).tanh() + update * h
    });
    close(&gru(|net| net).at(&X), &[state]);
}

#[test]
fn other_cells_are_refused_by_node() {
    let text = |name: &str, s: &str| AttributeProto { name: name.into(), s: s.into(), kind: 3, ..Default::default() };
    gru(|net| net.with(text("direction", "reverse"))).refused(&["`the_all`", "reverse", "forward"]);
    gru(|net| net.integer("layout", 1)).refused(&["`the_all`", "layout"]);
    let strings = vec![b"Relu".to_vec(), b"Tanh".to_vec()];
    let relu = AttributeProto { name: "activations".into(), strings, kind: 8, ..Default::default() };
    gru(|net| net.with(relu.clone())).refused(&["`the_all`", "Relu", "Sigmoid"]);
    let before = |mut net: Net| {
        net.graph().node.last_mut().expect("a node").attribute.clear();
        net
    };
    gru(before).refused(&["`the_all`", "before the product", "linear_before_reset = 1"]);
    let replace = |at: usize, name: &'static str| {
        move |mut net: Net| {
            net.graph().node.last_mut().expect("a node").input[at] = name.into();
            net
        }
    };
    gru(replace(0, "x")).refused(&["`the_all`", "no steps"]);
    gru(replace(0, "rows")).refused(&["`the_all`", "steps, rows, columns"]);
    gru(replace(1, "B")).refused(&["`the_all`", "weights of the shapes"]);
    gru(replace(3, "steps")).refused(&["`the_all`", "lengths of sequences"]);
    gru(|net| net.weight("h0", &[1, 1, 1], &[0.5])).at(&X);
    let begun = |mut net: Net| {
        net = net.weight("h0", &[1, 1, 1], &[0.5]);
        net.graph().node.last_mut().expect("a node").input.push("h0".into());
        net
    };
    gru(begun).refused(&["`the_all`", "states of zero"]);
    // Steps that are scaled by different numbers, and a column that mixes inputs.
    let scaled = |values: [f64; 2]| {
        move |mut net: Net| {
            net = net.weight("unit", &[2], &values);
            let mut mul = net.graph().node[0].clone();
            (mul.op_type, mul.input, mul.output) = ("Mul".into(), vec!["x".into(), "unit".into()], vec!["z".into()]);
            net.graph().node[0].input[0] = "z".into();
            net.graph().node.insert(0, mul);
            net
        }
    };
    gru(scaled([-2.0, -2.0])).at(&X);
    gru(scaled([1.0, 3.0])).refused(&["`the_all`", "standardised differently"]);
    // Behind a cell only the outputs stand.
    gru(|net| net).node("Tanh", &["y"], "z").refused(&["`the_z`", "recurrent cell"]);
}
