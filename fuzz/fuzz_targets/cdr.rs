//! Schemas, field names and messages of all encodings, none of them to be trusted.
//!
//! The checks stand in `body/cdr.rs`, which the tests share.

#![no_main]

#[path = "body/cdr.rs"]
mod body;

libfuzzer_sys::fuzz_target!(|data: &[u8]| body::run(data));
