//! Tests of the crate, one program.

mod identify;
mod lattice;
mod refined;
