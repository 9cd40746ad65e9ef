//! Why a file of a network cannot be read.

/// Operators that are read.
pub(super) const OPERATORS: &str =
    "Gemm, MatMul, Add, Sub, Mul, Div, Relu, Tanh, Sigmoid, Softplus, Identity, Constant, Cast, Flatten, Reshape";

/// Why an ONNX file cannot be read as a network.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OnnxError {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Unreadable(#[from] std::io::Error),
    /// The bytes are not those of the format.
    #[error("no ONNX file, or a damaged one ({0}); export the network again")]
    Format(#[from] prost::DecodeError),
    /// More bytes than small networks have.
    #[error("{bytes} bytes, and networks of at most {most} bytes are read; export a smaller network")]
    TooLarge {
        /// Bytes of the file.
        bytes: u64,
        /// The most that are read.
        most: u64,
    },
    /// The graph as a whole has a part that these networks do not have.
    #[error("{0}")]
    Graph(String),
    /// An operator that is not read.
    #[error("node `{node}`: the operator {operator} is not supported; export a network of {OPERATORS}")]
    Operator {
        /// The node's name, else its output.
        node: String,
        /// The operator.
        operator: String,
    },
    /// A node that is not a part of such a network.
    #[error("node `{node}` ({operator}): {problem}")]
    Node {
        /// The node's name, else its output.
        node: String,
        /// The operator.
        operator: String,
        /// The problem, in words.
        problem: String,
    },
    /// Numbers of the network that cannot be read.
    #[error("tensor `{tensor}`: {problem}")]
    Tensor {
        /// The tensor's name.
        tensor: String,
        /// The problem, in words.
        problem: String,
    },
    /// The network has another number of inputs or outputs.
    #[error(
        "the network has {actual} {what}, and the recipe has {}: {}; name in the recipe what the network reads and predicts, in its order",
        names.len(),
        listed(names)
    )]
    Size {
        /// `inputs` or `outputs`.
        what: &'static str,
        /// Their number in the network.
        actual: usize,
        /// Their names in the recipe.
        names: Vec<String>,
    },
}

/// The first names of a list.
fn listed(names: &[String]) -> String {
    match names.len() {
        0..=12 => names.join(", "),
        _ => format!("{}, ...", names[..12].join(", ")),
    }
}
