//! Tests of the crate, one program.

mod identify;
mod refined;
