//! A model whose maps are one network, as an ONNX file.

use fleetfoot_library::{Expr, Node};
use fleetfoot_model::{Activation, Basis, Latent, Model, Network};
use prost::Message;

use super::messages::{
    ATTRIBUTE_INT, AttributeProto, DOUBLE, DimensionProto, FLOAT, GraphProto, ModelProto, NodeProto, OperatorSetProto,
    PropertyProto, ShapeProto, TensorProto, TensorTypeProto, TypeProto, ValueProto,
};
use crate::{ExportError, ExportOptions, ExportedFile, Precision};

/// Version of the format, and of its operators, that every runtime of the last years reads.
const FORMAT: i64 = 8;
const OPERATORS: i64 = 13;

/// The file `prefix.onnx`: one input `x` (rows x functions of the library), one output `y` (rows x fitted equations).
///
/// Properties `inputs` and `outputs` of the file name the columns of both, one a line; `step` is the model's step in
/// seconds, `model` its hash.
///
/// # Errors
/// [`ExportError::Unwritable`], with the part that a network does not have; [`ExportError::TooLarge`].
pub(crate) fn file(model: &Model, options: &ExportOptions) -> Result<ExportedFile, ExportError> {
    let latents = latents(model)?;
    let library = library(model, &latents)?;
    let basis = basis(&latents)?;
    let mut graph = Writer { graph: GraphProto::default(), precision: options.precision };
    let (inputs, outputs) = (library.len(), latents.len());
    let linear = latents.iter().flat_map(|latent| (0..inputs).map(|j| latent.map.coefficient(0, j)));
    graph.tensor("linear_weights", &[outputs, inputs], linear.collect())?;
    graph.tensor("constants", &[outputs], latents.iter().map(|latent| latent.map.constant(0)).collect())?;
    graph.gemm(["x", "linear_weights", "constants"], if basis.is_some() { "linear" } else { "y" });
    if let Some(basis) = basis {
        let layers = graph.basis(&basis, inputs)?;
        let units = basis.count();
        let weights = latents.iter().flat_map(|latent| (0..units).map(|k| latent.map.coefficient(0, inputs + k)));
        graph.tensor("output_weights", &[outputs, units], weights.collect())?;
        graph.gemm([&format!("units{layers}"), "output_weights"], "corrections");
        graph.node("Add", ["linear", "corrections"], "y");
    }
    let mut graph = graph.graph;
    graph.name.clone_from(&options.prefix);
    graph.input.push(value("x", inputs, options.precision));
    graph.output.push(value("y", outputs, options.precision));
    let texts = |texts: Vec<String>| texts.join("\n");
    let properties = [
        ("inputs", texts(library.iter().map(ToString::to_string).collect())),
        ("outputs", texts(model.outputs())),
        ("step", model.step.to_string()),
        ("model", model.hash()),
    ];
    let file = ModelProto {
        ir_version: FORMAT,
        producer_name: "fleetfoot".into(),
        producer_version: env!("CARGO_PKG_VERSION").into(),
        graph: Some(graph),
        opset_import: vec![OperatorSetProto { domain: String::new(), version: OPERATORS }],
        metadata_props: properties.map(|(key, value)| PropertyProto { key: key.into(), value }).to_vec(),
    };
    Ok(ExportedFile { name: format!("{}.onnx", options.prefix), bytes: file.encode_to_vec() })
}

fn unwritable(part: impl Into<String>, remedy: &'static str) -> ExportError {
    ExportError::Unwritable { part: part.into(), remedy }
}

/// The latent of every equation, in their order.
fn latents(model: &Model) -> Result<Vec<&Latent>, ExportError> {
    let latent = |equation: &fleetfoot_model::Equation| {
        let name = equation.right.as_column().filter(|_| equation.target.is_some());
        let latent = name.and_then(|name| model.latents.iter().find(|latent| latent.name == name));
        latent.ok_or_else(|| {
            let text = format!("the equation {} = {}", equation.label(), equation.right);
            unwritable(text, "fit a model whose states are all fitted, or export the model as C")
        })
    };
    let latents: Vec<&Latent> = model.equations.iter().map(latent).collect::<Result<_, _>>()?;
    let Some(first) = latents.first() else { return Err(ExportError::NoEquations) };
    for latent in &latents {
        let partition = &model.partitions[latent.partition];
        if partition.rule.count() != 1 || latent.map.regions() != 1 || latent.partition != first.partition {
            let text = format!("the partition {} of {}", partition.specification, latent.name);
            return Err(unwritable(text, "fit one region (`average`), or export the model as C"));
        }
        if !latent.beyond.is_empty() {
            let text = format!("the slopes of {} outside of the training range", latent.name);
            return Err(unwritable(text, "export the model as C"));
        }
        if latent.library != first.library {
            let text = format!("the library of {}, which is not that of {}", latent.name, first.name);
            return Err(unwritable(text, "fit the equations together"));
        }
    }
    Ok(latents)
}

/// The functions of the library, which are columns of the present or a past row.
fn library<'a>(model: &'a Model, latents: &[&Latent]) -> Result<&'a [Expr], ExportError> {
    let library = &model.libraries[latents[0].library];
    let is_column = |function: &&Expr| matches!(function.node(), Node::Column { lag: 0.., .. });
    match library.iter().find(|function| !is_column(function)) {
        None => Ok(library),
        Some(function) => {
            let text = format!("the function {function}");
            Err(unwritable(
                text,
                "give the expression a name in [columns] and use its column, or export the model as C",
            ))
        }
    }
}

/// The hidden layers or the cell that the latents share; `None` if all are affine.
fn basis(latents: &[&Latent]) -> Result<Option<Basis>, ExportError> {
    let mut shared: Option<(&Latent, Basis)> = None;
    for latent in latents {
        let Some(basis) = latent.map.basis() else { continue };
        match &shared {
            None => shared = Some((latent, basis)),
            Some((_, known)) if *known == basis => {}
            Some((first, _)) => {
                let text = format!("the network of {}, which is not that of {}", latent.name, first.name);
                return Err(unwritable(text, "fit the equations together"));
            }
        }
    }
    Ok(shared.map(|(_, basis)| basis))
}

pub(super) struct Writer {
    pub(super) graph: GraphProto,
    precision: Precision,
}

impl Writer {
    pub(super) fn tensor(&mut self, name: &str, dims: &[usize], values: Vec<f64>) -> Result<(), ExportError> {
        let mut raw_data = Vec::with_capacity(values.len() * self.precision.bytes());
        for value in values {
            if !value.is_finite() {
                return Err(ExportError::NotFinite { value, place: name.into() });
            }
            match self.precision {
                Precision::Double => raw_data.extend(value.to_le_bytes()),
                Precision::Float if value.abs() > self.precision.largest() => {
                    return Err(ExportError::TooLarge { value, place: name.into() });
                }
                Precision::Float => raw_data.extend((value as f32).to_le_bytes()),
            }
        }
        let dims = dims.iter().map(|&dim| dim as i64).collect();
        let data_type = element(self.precision);
        self.graph.initializer.push(TensorProto {
            dims,
            data_type,
            name: name.into(),
            raw_data,
            ..TensorProto::default()
        });
        Ok(())
    }

    pub(super) fn node<const N: usize>(&mut self, operator: &str, inputs: [&str; N], output: &str) {
        self.graph.node.push(NodeProto {
            input: inputs.map(str::to_owned).to_vec(),
            output: vec![output.into()],
            name: output.into(),
            op_type: operator.into(),
            ..NodeProto::default()
        });
    }

    /// `a B' + c` of the inputs a, B and c.
    fn gemm<const N: usize>(&mut self, inputs: [&str; N], output: &str) {
        self.node("Gemm", inputs, output);
        self.attribute(AttributeProto { name: "transB".into(), i: 1, kind: ATTRIBUTE_INT, ..Default::default() });
    }

    /// Gives the last node an attribute.
    pub(super) fn attribute(&mut self, attribute: AttributeProto) {
        if let Some(node) = self.graph.node.last_mut() {
            node.attribute.push(attribute);
        }
    }

    /// The nodes of a basis; gives the number N of the layer whose units are `unitsN`.
    fn basis(&mut self, basis: &Basis, inputs: usize) -> Result<usize, ExportError> {
        match basis {
            Basis::Network(network) => {
                self.hidden(network, inputs)?;
                Ok(network.layers.len())
            }
            Basis::Recurrent(cell) => {
                self.cell(cell)?;
                Ok(1)
            }
            Basis::Gaussian(_) => Err(unwritable("radial functions", "fit a network, or export the model as C")),
        }
    }

    /// Standardised inputs and all hidden layers, whose last units are `unitsN`.
    fn hidden(&mut self, network: &Network, inputs: usize) -> Result<(), ExportError> {
        let (mut centre, mut scale) = (vec![0.0; inputs], vec![1.0; inputs]);
        for (at, &input) in network.inputs.iter().enumerate() {
            (centre[input], scale[input]) = (network.centre[at], network.scale[at]);
        }
        self.tensor("centre", &[inputs], centre)?;
        self.tensor("scale", &[inputs], scale)?;
        self.node("Sub", ["x", "centre"], "centred");
        self.node("Div", ["centred", "scale"], "units0");
        for (at, layer) in network.layers.iter().enumerate() {
            let (units, number) = (layer.biases.len(), at + 1);
            // A function that the network does not read has zeros in the first layer.
            let places: Vec<usize> =
                if at == 0 { network.inputs.clone() } else { (0..layer.weights[0].len()).collect() };
            let width = if at == 0 { inputs } else { places.len() };
            let mut weights = vec![0.0; units * width];
            for (row, from) in weights.chunks_exact_mut(width).zip(&layer.weights) {
                places.iter().zip(from).for_each(|(&place, weight)| row[place] += weight);
            }
            let [weights_name, biases_name] = ["weights", "biases"].map(|what| format!("layer{number}_{what}"));
            self.tensor(&weights_name, &[units, width], weights)?;
            self.tensor(&biases_name, &[units], layer.biases.clone())?;
            let sums = format!("sums{number}");
            self.gemm([&format!("units{at}"), &weights_name, &biases_name], &sums);
            let operator = match network.activation {
                Activation::Tanh => "Tanh",
                Activation::Relu => "Relu",
                Activation::Softplus => "Softplus",
            };
            self.node(operator, [&sums], &format!("units{number}"));
        }
        Ok(())
    }
}

fn element(precision: Precision) -> i32 {
    match precision {
        Precision::Float => FLOAT,
        Precision::Double => DOUBLE,
    }
}

/// A tensor of any number of rows.
fn value(name: &str, columns: usize, precision: Precision) -> ValueProto {
    let rows = DimensionProto { dim_param: "rows".into(), ..DimensionProto::default() };
    let columns = DimensionProto { dim_value: columns as i64, ..DimensionProto::default() };
    let shape = Some(ShapeProto { dim: vec![rows, columns] });
    let tensor_type = Some(TensorTypeProto { elem_type: element(precision), shape });
    ValueProto { name: name.into(), r#type: Some(TypeProto { tensor_type }) }
}
