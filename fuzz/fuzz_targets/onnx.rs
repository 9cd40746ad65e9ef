//! Networks as ONNX files, none of their bytes to be trusted.
//!
//! The checks stand in `body/onnx.rs`, which the tests share.

#![no_main]

#[path = "body/onnx.rs"]
mod body;

libfuzzer_sys::fuzz_target!(|data: &[u8]| _ = body::run(data));
