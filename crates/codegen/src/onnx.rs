//! Feed-forward networks and recurrent cells as ONNX files: written from a model, and read into the maps of one.
//!
//! The format is that of <https://onnx.ai/onnx/repo-docs/IR.html>, its operators those of
//! <https://onnx.ai/onnx/operators/>. Of both only the part that these networks need is here.

mod cell;
mod combination;
mod error;
mod messages;
mod operator;
mod read;
mod sequence;
mod tensor;
#[cfg(test)]
mod tests;
mod value;
mod write;

pub use error::OnnxError;
pub use read::OnnxNetwork;
pub(crate) use write::file;
