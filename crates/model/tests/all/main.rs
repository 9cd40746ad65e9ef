//! Models in files, and models as text.

mod counted;
mod file;
mod models;
mod network;
mod radial;
mod recurrent;
mod transitions;
