//! Predictions and trajectories as files: tables (Parquet, CSV), or messages that viewers draw over the recording (MCAP).

mod layout;
mod plane;
mod predictions;
mod trajectories;

use std::{collections::BTreeMap, path::Path};

use fleetfoot_dataset::Logs;
use fleetfoot_fit::Error;
use fleetfoot_log::{Compression, Format};
use fleetfoot_model::Model;
use fleetfoot_output::{McapOptions, WriteOptions, is_stream};
pub use layout::layout_files;
pub(crate) use layout::{Line, Plot, finish_with_layouts};
pub(crate) use plane::write_plane;
pub(crate) use predictions::{Place, PredictionsWriter};
pub(crate) use trajectories::write_trajectories;

/// Format of the output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Table,
    Mcap,
}

/// The kind that a file's name promises: another one would mislead whoever opens the file. A device or a pipe gets a table as text.
pub(crate) fn kind(output: &Path) -> Result<Kind, Error> {
    match Format::of(output) {
        Some(Format::Parquet | Format::Csv(Compression::None)) => Ok(Kind::Table),
        Some(Format::Mcap(Compression::None)) => Ok(Kind::Mcap),
        None if is_stream(output) => Ok(Kind::Table),
        _ => Err(Error::output(format!(
            "{}: results are written as Parquet, CSV or MCAP; name the file *.parquet, *.csv, *.tsv or *.mcap",
            output.display()
        ))),
    }
}

pub(crate) fn metadata(model: &Model) -> BTreeMap<String, String> {
    let pairs = [
        ("fleetfoot.model".to_owned(), model.hash()),
        ("fleetfoot.version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
    ];
    pairs.into()
}

pub(crate) fn table_options(model: &Model, logs: &Logs) -> WriteOptions {
    WriteOptions { metadata: metadata(model), inputs: logs.files(), ..WriteOptions::default() }
}

pub(crate) fn mcap_options(model: &Model, logs: &Logs) -> McapOptions {
    McapOptions { metadata: metadata(model), inputs: logs.files(), ..McapOptions::default() }
}
