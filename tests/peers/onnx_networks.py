"""Networks written by `onnx` in the styles of several exporters, and run by `onnxruntime`.

    onnx_networks.py write FOLDER    networks NAME.onnx, and rows with their outputs NAME.json
    onnx_networks.py cells FOLDER    the same of recurrent cells; rows have the latest step first
    onnx_networks.py run FILE        outputs of a network for the rows on standard input (JSON), in its own precision
    onnx_networks.py reference FILE  the same by the reference implementation of the format, in 64 bits
"""

import json
import pathlib
import sys

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, checker, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

ROWS = 64
INPUTS, OUTPUTS = 4, 2
KINDS = {TensorProto.FLOAT: np.float32, TensorProto.DOUBLE: np.float64}


def run(bytes_of_file, rows):
    session = onnxruntime.InferenceSession(bytes_of_file, providers=["CPUExecutionProvider"])
    (given,) = session.get_inputs()
    kind = np.float64 if given.type == "tensor(double)" else np.float32
    (outputs,) = session.run(None, {given.name: np.asarray(rows, dtype=kind)})
    return np.asarray(outputs, dtype=float)


class Net:
    """A graph while it is written."""

    def __init__(self, element, seed):
        self.element, self.kind = element, KINDS[element]
        self.random = np.random.default_rng(seed)
        self.nodes, self.tensors = [], []

    def tensor(self, name, shape, typed=False, positive=False):
        values = self.random.uniform(0.5 if positive else -1, 1, shape).astype(self.kind)
        if typed:
            self.tensors.append(helper.make_tensor(name, self.element, shape, values.ravel().tolist()))
        else:
            self.tensors.append(numpy_helper.from_array(values, name))
        return name

    def node(self, operator, inputs, output, **attributes):
        self.nodes.append(helper.make_node(operator, inputs, [output], **attributes))
        return output

    def file(self):
        value = lambda name, columns: helper.make_tensor_value_info(name, self.element, ["rows", columns])
        graph = helper.make_graph(self.nodes, "net", [value("x", INPUTS)], [value("y", OUTPUTS)], self.tensors)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)])
        model.ir_version = 8
        checker.check_model(model, full_check=True)
        return model.SerializeToString()


def linear_layers(element, activation, seed):
    """Gemm with transposed weights, as PyTorch exports `Linear`."""
    net = Net(element, seed)
    before, width = "x", INPUTS
    for at, units in enumerate([8, 5]):
        net.node("Gemm", [before, net.tensor(f"w{at}", [units, width]), net.tensor(f"b{at}", [units])], f"s{at}", transB=1)
        before, width = net.node(activation, [f"s{at}"], f"h{at}"), units
    net.node("Gemm", [before, net.tensor("w", [OUTPUTS, width]), net.tensor("b", [OUTPUTS])], "y", transB=1, alpha=0.5, beta=2.0)
    return net.file()


def dense_layers(element, activation, seed):
    """MatMul and Add of typed tensors, between a Reshape, an Identity and a Flatten that change nothing, as of Keras."""
    net = Net(element, seed)
    shape = helper.make_tensor("shape", TensorProto.INT64, [2], [-1, INPUTS])
    net.nodes.append(helper.make_node("Constant", [], ["shape"], value=shape))
    net.node("Reshape", ["x", "shape"], "r")
    net.node("Flatten", ["r"], "f", axis=1)
    net.node("MatMul", ["f", net.tensor("w0", [INPUTS, 6], typed=True)], "p0")
    net.node("Add", ["p0", net.tensor("b0", [6], typed=True)], "s0")
    net.node(activation, ["s0"], "h0")
    net.node("MatMul", ["h0", net.tensor("w1", [6, OUTPUTS], typed=True)], "p1")
    net.node("Add", [net.tensor("b1", [1, OUTPUTS], typed=True), "p1"], "s1")
    net.node("Identity", ["s1"], "y")
    return net.file()


def scaled(element, activation, seed):
    """Standardised inputs, a linear map beside the network, scaled outputs, as of pipelines."""
    net = Net(element, seed)
    net.node("Cast", ["x"], "c", to=element)
    net.node("Sub", ["c", net.tensor("mean", [INPUTS])], "a")
    net.node("Div", ["a", net.tensor("deviation", [INPUTS], positive=True)], "z")
    net.node("Gemm", ["z", net.tensor("w0", [INPUTS, 7]), net.tensor("b0", [7])], "s0")
    net.node(activation, ["s0"], "h0")
    net.node("MatMul", ["h0", net.tensor("w1", [7, OUTPUTS])], "n")
    net.node("MatMul", ["z", net.tensor("l", [INPUTS, OUTPUTS])], "m")
    net.node("Add", ["m", "n"], "t")
    net.node("Mul", ["t", net.tensor("unit", [OUTPUTS])], "u")
    net.node("Sub", [net.tensor("offset", [OUTPUTS]), "u"], "y")
    return net.file()


STEPS, COLUMNS, UNITS = 3, 2, 5


def cell(operator, gates, seed):
    """A cell over steps, rows and columns and the last of its states, as PyTorch exports one with a layer behind it."""
    net = Net(TensorProto.FLOAT, seed)
    weights = [net.tensor("w", [1, gates * UNITS, COLUMNS]), net.tensor("r", [1, gates * UNITS, UNITS])]
    weights.append(net.tensor("b", [1, 2 * gates * UNITS]))
    zero = numpy_helper.from_array(np.zeros([1, 1, UNITS], np.float32), "zero")
    net.tensors += [zero, numpy_helper.from_array(np.array([1]), "axes"), numpy_helper.from_array(np.array(-1), "last")]
    states = ["zero", "zero"] if operator == "LSTM" else ["zero"]
    options = {"linear_before_reset": 1} if operator == "GRU" else {}
    net.node(operator, ["x", *weights, "", *states], "all", hidden_size=UNITS, **options)
    net.node("Squeeze", ["all", "axes"], "states")
    net.node("Gather", ["states", "last"], "state", axis=0)
    net.node("Gemm", ["state", net.tensor("v", [OUTPUTS, UNITS]), net.tensor("c", [OUTPUTS])], "y", transB=1)
    value = lambda name, *dims: helper.make_tensor_value_info(name, TensorProto.FLOAT, dims)
    given, computed = value("x", STEPS, 1, COLUMNS), value("y", 1, OUTPUTS)
    model = helper.make_model(
        helper.make_graph(net.nodes, "cell", [given], [computed], net.tensors), opset_imports=[helper.make_opsetid("", 13)]
    )
    model.ir_version = 8
    checker.check_model(model, full_check=True)
    return model.SerializeToString()


def write_cells(folder):
    for seed, (operator, gates) in enumerate({"RNN": 1, "GRU": 3, "LSTM": 4}.items()):
        file = cell(operator, gates, 50 + seed)
        windows = np.random.default_rng(2000 + seed).normal(0, 1, (ROWS, STEPS, 1, COLUMNS)).astype(np.float32)
        outputs = [run(file, window)[0].tolist() for window in windows]
        name = folder / operator.lower()
        name.with_suffix(".onnx").write_bytes(file)
        rows = windows[:, ::-1].reshape(ROWS, -1).tolist()
        name.with_suffix(".json").write_text(json.dumps({"rows": rows, "outputs": outputs}))


def write(folder):
    styles = {"linear_layers": linear_layers, "dense_layers": dense_layers, "scaled": scaled}
    for seed, (style, activation, element) in enumerate(
        (style, activation, element)
        for style in styles
        for activation in ("Tanh", "Relu", "Sigmoid", "Softplus")
        for element in KINDS
        # This runtime has no Softplus of 64 bits.
        if (activation, element) != ("Softplus", TensorProto.DOUBLE)
    ):
        file = styles[style](element, activation, seed)
        rows = np.random.default_rng(1000 + seed).normal(0, 1, (ROWS, INPUTS)).astype(KINDS[element])
        name = folder / f"{style}_{activation.lower()}_{KINDS[element].__name__}"
        name.with_suffix(".onnx").write_bytes(file)
        name.with_suffix(".json").write_text(json.dumps({"rows": rows.tolist(), "outputs": run(file, rows).tolist()}))


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["write", folder]:
            write(pathlib.Path(folder))
        case ["cells", folder]:
            write_cells(pathlib.Path(folder))
        case ["run", file]:
            onnx.checker.check_model(file, full_check=True)
            print(json.dumps(run(pathlib.Path(file).read_bytes(), json.load(sys.stdin)).tolist()))
        case ["reference", file]:
            onnx.checker.check_model(file, full_check=True)
            (outputs,) = ReferenceEvaluator(file).run(None, {"x": np.asarray(json.load(sys.stdin), dtype=float)})
            print(json.dumps(outputs.tolist()))
        case _:
            sys.exit(__doc__)
