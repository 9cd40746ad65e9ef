//! Recordings out of files: MCAP, rosbag2, ROS 1 bags, ULog, ArduPilot DataFlash, WPILOG, Parquet, CSV, arrays of NumPy
//! and MATLAB.
//!
//! [`paths`] turns arguments (files, globs, folders) into files; [`inspect`] tells what one file holds; [`open`] makes a
//! [`Recording`], a [`fleetfoot_data::Source`] whose episodes are found from the time stamps and whose rows are read when
//! they are asked for. What writes files is in [`fleetfoot_output`].
//!
//! Parquet is read in place. Text is decoded once into columns, in memory up to a budget and in an unnamed temporary file
//! beyond it, so that memory stays flat however long the files are. A format is a `Table`: rows, stamps and values by
//! range of rows; everything else (episodes, identities, categories over several files) is common to all formats, and to
//! tables in memory ([`MemoryTable`]). A robot's log is a `Container`: topics with messages, in pieces, whichever format it is in; its channels
//! are joined into such a table.
//!
//! ```
//! use fleetfoot_data::{Halo, Source};
//! use fleetfoot_log::{Selection, open};
//!
//! let folder = tempfile::tempdir()?;
//! let file = folder.path().join("log.csv");
//! std::fs::write(&file, "t,v,u\n0.0,1.0,5\n0.1,1.5,5\n0.2,2.0,5\n9.0,0.0,0\n9.1,0.5,0\n9.2,0.8,0\n")?;
//! let recording = open(&[file], &Selection::new(["v"]))?;
//! // The gap of nine seconds ends an episode.
//! assert_eq!(recording.episodes().len(), 2);
//! assert_eq!(recording.read(1, 0..3, Halo::default())?.core(0), [0.0, 0.5, 0.8]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod agreement;
mod arrays;
mod breaks;
mod by_name;
mod channels;
mod clock_info;
mod column_info;
mod column_set;
mod container;
mod containers;
mod cost;
mod csv;
mod cycles;
mod dataflash;
mod dates;
mod detected_runs;
mod error;
mod estimate;
mod file_io;
mod format;
mod index;
mod inspect;
mod join;
mod join_spec;
mod max_gap;
mod mcap;
mod memory;
mod metadata;
mod naming;
mod notes;
mod opened;
mod parquet;
mod parts;
mod paths;
mod recording;
mod resample;
mod rosbag1;
mod rosbag2;
mod row_mask;
mod run;
mod selection;
mod splits;
mod sqlite;
mod stamp;
mod steps;
mod store;
mod table;
mod time_column;
mod topic_info;
mod ulog;
mod wpilog;

pub use channels::{MessageColumns, MessageField, MessageRow, Messages};
pub use clock_info::ClockInfo;
pub use column_info::{ArrayInfo, ColumnInfo, ColumnStatistics};
pub use cost::Estimate;
pub use detected_runs::DetectedRuns;
pub use error::{Error, shell_word};
pub use estimate::estimate;
pub use format::{Compression, Format};
pub use index::ClockSummary;
pub use inspect::{FileInfo, inspect, inspect_run, inspect_together, inspect_values, path_in_words};
pub use join::JoinKind;
pub use join_spec::{Base, Cache, ColumnJoin, JoinSpec, Stamp, TopicClock};
pub use max_gap::MaxGap;
pub use memory::{Log, MemoryTable};
pub use metadata::metadata;
pub use paths::paths;
pub use recording::{Recording, open, open_logs, open_with_progress};
pub use run::RunFiles;
pub use selection::{LabelRule, Selection, TimeSpec, TimeUnit};
pub use time_column::Reading;
pub use topic_info::{HeaderOffset, TopicInfo};
