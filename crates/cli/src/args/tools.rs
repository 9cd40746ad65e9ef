//! Arguments of `completions`, `man` and `schema`.

use std::path::PathBuf;

use clap::Args;

#[derive(Debug, Args)]
pub(crate) struct Completions {
    /// Shell to complete for.
    #[arg(value_enum, value_name = "SHELL")]
    pub(crate) shell: clap_complete::Shell,
}

#[derive(Debug, Args)]
pub(crate) struct Man {
    /// Folder of the pages, such as fleetfoot-fit-pwa.1.
    #[arg(short, long, value_name = "DIR", default_value = "man")]
    pub(crate) output: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct Schema {
    /// Schema to write (default: standard output).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
}
