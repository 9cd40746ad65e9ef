//! The model of recordings: sources, episodes, columns with units, blocks, ordered parallel work.
//!
//! A [`Source`] holds [`Episode`]s: uninterrupted stretches of rows with time stamps and columns of `f64`.
//! [`Source::read`] reads a range of an episode's rows on demand. The answer is a [`Block`], which brings along a
//! [`Halo`] of neighbouring rows, so that lags and differences at the border of the range have their values. A halo
//! never crosses an episode's border.
//!
//! Missing values are NaN everywhere. Time is nanoseconds as `i64`; computation uses seconds from the start of the
//! episode ([`Block::seconds`]).
//!
//! ```
//! use fleetfoot_data::{Column, Halo, MemorySource, Source};
//!
//! let mut log = MemorySource::new(vec![Column::float("v")]);
//! log.push_uniform("run", 0.01, vec![vec![1.0, 2.0, 3.0, 4.0]]);
//! // Two rows, with a neighbour on each side for differences.
//! let block = log.read(0, 1..3, Halo { before: 1, after: 1 })?;
//! assert_eq!(block.core(0), [2.0, 3.0]);
//! assert_eq!(block.column(0), [1.0, 2.0, 3.0, 4.0]);
//! # Ok::<(), fleetfoot_data::Error>(())
//! ```

pub mod setting;

mod available;
mod block;
mod canonical;
mod column;
mod episode;
mod error;
mod mark;
mod memory;
mod nearest;
mod packed;
mod parallel;
mod random;
mod simd;
mod source;
mod stop;
mod watch;

pub use arrow_buffer::ScalarBuffer;
pub use available::{OutOfMemory, ensure_memory, reserve};
pub use block::{Block, Halo};
pub use canonical::Canonical;
pub use column::{Column, ColumnKind};
pub use episode::{Episode, EpisodeId, Fingerprint};
pub use error::Error;
pub use mark::Mark;
pub use memory::MemorySource;
pub use nearest::{did_you_mean, nearest, nearest_one};
pub use packed::{packed, packed_row};
pub use parallel::{
    Progress, Silent, Stages, Threads, Work, parallel_all, parallel_fold, parallel_map, parallel_pieces, thread_count,
    with_threads,
};
pub use random::mix;
pub use simd::{SWITCH as SIMD_SWITCH, UnknownInstructionSet, arch, check_instruction_set, instruction_set};
pub use source::{Source, sample_ranges};
pub use stop::{Cancelled, Stop, checkpoint, stoppable, unstoppable, until_stopped};
pub use watch::{Known, Watch, Watched};
