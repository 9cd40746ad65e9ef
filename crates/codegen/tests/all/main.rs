//! Models as code.

#[path = "../../../../tests/outside.rs"]
mod outside;

#[path = "../../../model/tests/all/counted.rs"]
mod counted;
mod export;
mod filter;
#[path = "../../../model/tests/all/models.rs"]
mod models;
mod onnx;
mod predictive;
mod recurrent;
mod transitions;
