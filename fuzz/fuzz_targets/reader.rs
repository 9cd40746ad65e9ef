//! Whole log files, none of their bytes to be trusted.
//!
//! The checks stand in `body/reader.rs`, which the tests share.

#![no_main]

#[path = "body/reader.rs"]
mod body;

libfuzzer_sys::fuzz_target!(|data: &[u8]| body::run(data));
