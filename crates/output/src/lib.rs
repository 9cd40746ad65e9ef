//! Results in files, whole or not at all: atomic files and locks; Parquet, CSV and MCAP writers.
//!
//! [`write_atomic`] and [`AtomicFile`] give a file its name when it is complete, [`together`] a set of files.
//! [`ParquetWriter`], [`CsvWriter`] and [`McapWriter`] stream columns and messages into such files. [`TableWriter`]
//! takes the format of the name, and [`Overlay`] writes messages that viewers draw over a recording. [`check_outputs`]
//! refuses targets before any work is done for them.
//!
//! ```
//! use fleetfoot_output::{TableWriter, Values, WriteColumn, WriteKind, WriteOptions};
//!
//! let folder = tempfile::tempdir()?;
//! let file = folder.path().join("speed.csv");
//! let columns = vec![WriteColumn::new("v", WriteKind::Float).with_unit("m/s")];
//! let mut writer = TableWriter::create(&file, columns, &WriteOptions::default())?;
//! writer.write(&[Values::Float(&[0.5, 1.25])])?;
//! assert!(!file.exists());
//! writer.finish()?;
//! assert_eq!(std::fs::read_to_string(&file)?, "v\n0.5\n1.25\n");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod arrow_schema;
mod atomic;
mod csv_writer;
mod destination;
mod error;
mod leftovers;
mod lock;
mod mcap_writer;
mod overlay;
mod table_writer;
mod write_column;
mod writer;

pub use atomic::{AtomicFile, together, write_atomic, written_files};
pub use csv_writer::CsvWriter;
pub use destination::{check_outputs, is_stream};
pub use error::Error;
pub use leftovers::remove_leftovers;
pub use lock::WriteLock;
pub use mcap_writer::{ChannelId, METADATA_RECORD, McapOptions, McapWriter};
pub use overlay::{Overlay, SeriesId};
pub use table_writer::TableWriter;
pub use write_column::{WriteColumn, WriteKind};
pub use writer::{ParquetWriter, Values, WriteOptions};
