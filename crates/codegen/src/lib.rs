//! Models and filters as C, Rust, Python, LaTeX, NumPy arrays and ONNX networks; networks read from ONNX.
//!
//! A model is first written as a small imperative program ([`Target::C`], [`Target::Rust`] and [`Target::Python`] print
//! the same one), with the engine's operations in the engine's order. Candidate functions are straight-line code with
//! shared parts computed once; the region follows the partition's rule. Latents are sums without zeros (one region), or
//! dense tables or tables without zeros (many regions). Right sides come last. Derivatives are exact. No heap, no
//! global state, no loop of unknown length.
//!
//! ```
//! use fleetfoot_codegen::{ExportOptions, Target, export, test_vectors};
//! use fleetfoot_library::{Expr, Scope};
//! use fleetfoot_model::{Column, Equation, Model, Prediction, Role, Training};
//!
//! // x' = -x, as C whose `decay_next` advances it by 0.01 s.
//! let training = Training { state_covariance: vec![1.0], ..Training::default() };
//! let mut decay = Model::new("given", vec![Column::new("x", Role::State)], 0.01, training);
//! let right = Expr::parse("-x", &Scope::new(["x"]))?;
//! let prediction = Prediction::Derivative;
//! decay.equations.push(Equation { subject: "x".into(), prediction, right, target: None, unit: None });
//! let mut options = ExportOptions::new(Target::C);
//! options.prefix = "decay".into();
//! let vectors = test_vectors(&decay, &options, 8, 0)?;
//! let exported = export(&decay, &options, &vectors)?;
//! let names: Vec<&str> = exported.files.iter().map(|file| file.name.as_str()).collect();
//! assert_eq!(names, ["decay.h", "decay.c", "decay_test.c"]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod advance;
mod assemble;
mod basis;
mod c;
mod c_syntax;
mod c_test;
mod code;
mod cost;
mod error;
mod evaluation;
mod filter;
mod interpret;
mod jacobian;
mod latex;
mod layout;
mod lower;
mod names;
mod npz;
mod onnx;
mod options;
mod plan;
mod predictive;
mod print;
mod public;
mod python;
mod recurrent;
mod rust;
mod rust_syntax;
mod step_jacobian;
mod transitions;
mod vectors;
mod walk;
mod writer;
mod zip;

pub use cost::{Cost, Operations};
pub use error::ExportError;
pub use filter::export_filter;
pub use onnx::{OnnxError, OnnxNetwork};
pub use options::{ExportOptions, Precision, StepMethod, Target};
pub use predictive::export_predictive;
pub use vectors::{Signals, TestResult, TestVector, evaluate_at, signals, test_vectors};

use fleetfoot_model::Model;

/// A file to be written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportedFile {
    /// Its name.
    pub name: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

impl ExportedFile {
    fn text(name: String, text: String) -> Self {
        Self { name, bytes: text.into_bytes() }
    }
}

/// A model in another language.
#[derive(Debug, Clone, PartialEq)]
pub struct Export {
    /// The files.
    pub files: Vec<ExportedFile>,
    /// Cost of the code; `None` without code (LaTeX, npz, ONNX).
    pub cost: Option<Cost>,
}

/// Writes a model in another language.
///
/// `vectors` are the expected values in the test of [`Target::C`]: [`test_vectors`], or the same points with another
/// engine's values.
///
/// # Errors
/// [`ExportError`]: a model that contradicts itself or reads later rows; numbers that are not finite or do not fit; a
/// prefix that cannot begin an identifier.
pub fn export(model: &Model, options: &ExportOptions, vectors: &[TestVector]) -> Result<Export, ExportError> {
    options.validate()?;
    model.validate().map_err(ExportError::Inconsistent)?;
    match options.target {
        Target::Latex => return Ok(Export { files: vec![latex::file(model, options)], cost: None }),
        Target::Npz => return Ok(Export { files: vec![npz::file(model, options)], cost: None }),
        Target::Onnx => return Ok(Export { files: vec![onnx::file(model, options)?], cost: None }),
        Target::C | Target::Rust | Target::Python => {}
    }
    let precision = if options.target == Target::Python { Precision::Double } else { options.precision };
    let closed = assemble::closed(model, options)?;
    let assembled = assemble::assemble(model, &closed, options, precision)?;
    let cost = Cost::of(&assembled.code, precision, assembled.kept());
    let files = match options.target {
        Target::Rust => vec![rust::file(&assembled, options, &cost)],
        Target::Python => vec![python::file(&assembled, options)],
        Target::C | Target::Latex | Target::Npz | Target::Onnx => {
            let mut files = c::files(&assembled, options, &cost);
            files.push(c_test::file(&assembled, options, vectors));
            files
        }
    };
    Ok(Export { files, cost: Some(cost) })
}
