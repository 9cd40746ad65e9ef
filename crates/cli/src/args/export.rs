//! Arguments of `export`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

#[derive(Debug, Args)]
pub(crate) struct Export {
    /// Model, or controller of `control lqr`.
    #[arg(value_name = "MODEL")]
    pub(crate) model: PathBuf,
    /// Language or format to write.
    #[arg(long, value_enum)]
    pub(crate) to: ExportTo,
    /// Floating-point numbers of C, Rust and ONNX: 32 or 64 bits.
    #[arg(long, value_enum, default_value_t = ExportPrecision::Double)]
    pub(crate) precision: ExportPrecision,
    /// Prefix of all names, and name of the files: lower-case letters, digits and _.
    #[arg(long, value_name = "NAME", default_value = "model")]
    pub(crate) prefix: String,
    /// Fixed step length of the code, for a model of derivatives (default: an argument of each call).
    #[arg(long, value_name = "SECONDS")]
    pub(crate) discretize: Option<f64>,
    /// Integration of derivatives.
    #[arg(long, value_enum, default_value_t = ExportMethod::Rk4)]
    pub(crate) method: ExportMethod,
    /// Code without the check of the training range.
    #[arg(long)]
    pub(crate) no_domain: bool,
    /// Code of the model's filter instead of the model.
    #[arg(long)]
    pub(crate) filter: bool,
    /// Recipe whose `[filter]` overrides the model's (default: none).
    #[arg(short = 'c', long = "recipe", value_name = "RECIPE", requires = "filter")]
    pub(crate) recipe: Option<PathBuf>,
    /// Folder to write to.
    #[arg(short, long, value_name = "DIR", default_value = ".")]
    pub(crate) output: PathBuf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportTo {
    /// C99 without heap, with a test.
    C,
    /// A Rust module without the standard library.
    Rust,
    /// A Python module without dependencies.
    Python,
    /// Equations in LaTeX.
    Latex,
    /// Arrays for NumPy.
    Npz,
    /// A network for runtimes of ONNX, of a model that is one.
    Onnx,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportPrecision {
    /// 32 bits.
    Float,
    /// 64 bits.
    Double,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportMethod {
    /// x + h f(x).
    Euler,
    /// Fourth-order Runge-Kutta.
    Rk4,
}
