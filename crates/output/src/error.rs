//! Errors of writing: each names the file, the reason, and the mend.

use std::path::PathBuf;

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The attempted action, as an infinitive.
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// An output that is also an input.
    #[error("{} is one of the inputs of this command: choose another output file", path.display())]
    OverwritesInput {
        /// The file.
        path: PathBuf,
    },
    /// Two outputs that are one file.
    #[error("{} and {} are one file: two outputs cannot both be written to it; name another for one of them", first.display(), second.display())]
    SameOutput {
        /// An output.
        first: PathBuf,
        /// The other one.
        second: PathBuf,
    },
    /// Another process writes the same.
    #[error("{}: another command is writing it at this moment: wait for its end, or name another output", path.display())]
    Busy {
        /// The file or folder.
        path: PathBuf,
    },
    /// Columns that do not fit those of the writer.
    #[error("{}: {problem}", path.display())]
    BadBatch {
        /// The file being written.
        path: PathBuf,
        /// The mismatch, in words.
        problem: String,
    },
}
