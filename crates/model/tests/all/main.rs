//! Models in files, and models as code.

mod export;
mod file;
mod models;
