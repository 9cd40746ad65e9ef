//! Whole log files, none of their bytes to be trusted.
//!
//! What is done with them stands in `body/reader.rs`, which the tests share.

#![no_main]

#[path = "body/reader.rs"]
mod body;

libfuzzer_sys::fuzz_target!(|data: &[u8]| body::run(data));
