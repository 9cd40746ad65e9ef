//! Recurrent cells as operators of ONNX.

use fleetfoot_model::{Cell, Recurrent};

use super::{
    messages::{ATTRIBUTE_INT, ATTRIBUTE_INTS, AttributeProto, INT64, TensorProto},
    write::Writer,
};
use crate::ExportError;

/// Name, and our gate of each gate of the operator: ONNX has z, r, n of a GRU and i, o, f, g of an LSTM.
fn operator(cell: Cell) -> (&'static str, &'static [usize]) {
    match cell {
        Cell::Rnn => ("RNN", &[0]),
        Cell::Gru => ("GRU", &[1, 0, 2]),
        Cell::Lstm => ("LSTM", &[0, 3, 1, 2]),
    }
}

impl Writer {
    /// The window of the inputs as steps x rows x columns, and the cell, whose last state is `units1`.
    pub(super) fn cell(&mut self, cell: &Recurrent) -> Result<(), ExportError> {
        let (units, columns, steps) = (cell.count(), cell.columns(), cell.steps());
        self.indices("window_inputs", cell.inputs.iter().map(|&input| input as i64).collect());
        self.node("Gather", ["x", "window_inputs"], "window");
        self.attribute(AttributeProto { name: "axis".into(), i: 1, kind: ATTRIBUTE_INT, ..Default::default() });
        self.tensor("centre", &[steps * columns], cell.centre.repeat(steps))?;
        self.tensor("scale", &[steps * columns], cell.scale.repeat(steps))?;
        self.node("Sub", ["window", "centre"], "centred");
        self.node("Div", ["centred", "scale"], "standardised");
        self.indices("window_shape", vec![-1, steps as i64, columns as i64]);
        self.node("Reshape", ["standardised", "window_shape"], "rows_by_steps");
        self.node("Transpose", ["rows_by_steps"], "steps_by_rows");
        let order = vec![1, 0, 2];
        self.attribute(AttributeProto { name: "perm".into(), ints: order, kind: ATTRIBUTE_INTS, ..Default::default() });
        let (name, gates) = operator(cell.cell);
        let rows = |rows: &[Vec<f64>]| {
            let gate = |&gate: &usize| rows[gate * units..(gate + 1) * units].concat();
            gates.iter().flat_map(gate).collect::<Vec<f64>>()
        };
        self.tensor("input_weights", &[1, gates.len() * units, columns], rows(&cell.input_weights))?;
        self.tensor("state_weights", &[1, gates.len() * units, units], rows(&cell.state_weights))?;
        // Behind the biases of the inputs those of the state, which only the candidate of a GRU has.
        let mut biases: Vec<f64> =
            gates.iter().flat_map(|gate| &cell.biases[gate * units..(gate + 1) * units]).copied().collect();
        let of_state = gates.len() * units - cell.state_biases.len();
        biases.extend(std::iter::repeat_n(0.0, of_state).chain(cell.state_biases.iter().copied()));
        self.tensor("biases", &[1, biases.len()], biases)?;
        self.node(name, ["steps_by_rows", "input_weights", "state_weights", "biases"], "state");
        // The first output has the states of all steps.
        if let Some(node) = self.graph.node.last_mut() {
            node.output.insert(0, String::new());
        }
        let whole = |name: &str, i| AttributeProto { name: name.into(), i, kind: ATTRIBUTE_INT, ..Default::default() };
        self.attribute(whole("hidden_size", units as i64));
        if cell.cell.resets() {
            self.attribute(whole("linear_before_reset", 1));
        }
        self.indices("state_shape", vec![-1, units as i64]);
        self.node("Reshape", ["state", "state_shape"], "units1");
        Ok(())
    }

    /// A list of whole numbers.
    fn indices(&mut self, name: &str, values: Vec<i64>) {
        let raw_data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let dims = vec![values.len() as i64];
        let tensor = TensorProto { dims, data_type: INT64, name: name.into(), raw_data, ..TensorProto::default() };
        self.graph.initializer.push(tensor);
    }
}
