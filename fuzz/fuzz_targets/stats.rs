//! Statistics as files, none of their bytes to be trusted.
//!
//! The checks stand in `body/stats.rs`, which the tests share.

#![no_main]

#[path = "body/stats.rs"]
mod body;

libfuzzer_sys::fuzz_target!(|data: &[u8]| _ = body::run(data));
