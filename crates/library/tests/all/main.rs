//! The crate from outside: text, derivatives, programs, rotations.

mod derivative;
mod program;
mod rotation;
mod strategy;
mod text;
