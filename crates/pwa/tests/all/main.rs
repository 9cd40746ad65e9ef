//! Tests of the crate, one program.

mod bounded;
mod continuous;
mod identify;
mod lattice;
mod passive;
mod refined;
mod stable;
mod transitions;
mod tree;
mod weights;
