//! Errors of `.stats` files and of requests to them.

use fleetfoot_data::setting::{APPEND, EPISODES, FORCE, KEY, SCAN, STATS_DROP};

use std::path::PathBuf;

/// 2: the sums of equations. 3: the marks of episodes.
pub(crate) const VERSION: u32 = 4;

/// The oldest format that is read. Files of format 3 say the hash of their plan by another rule, and nothing else differently.
pub(crate) const OLDEST: u32 = 3;

/// Errors of a `.stats` file, or of a request to it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StatisticError {
    /// The system cannot read it.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Something else.
    #[error("{}: this is not a statistic of fleetfoot; {SCAN} writes them", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// A format of the future.
    #[error("{}: its format is {version} and this fleetfoot reads {VERSION}; use a newer fleetfoot, or scan the logs again", path.display())]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its format.
        version: u32,
    },
    /// A format of the past.
    #[error(
        "{}: its format is {version} and this fleetfoot reads {VERSION}: it lacks sums of the newer format; scan the logs again, or use the fleetfoot that wrote it",
        path.display()
    )]
    Older {
        /// The file.
        path: PathBuf,
        /// Its format.
        version: u32,
    },
    /// Bytes that differ from those written.
    #[error("{}: damaged: {place}: {problem}; take another copy of the file, or scan the logs again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Place in the file.
        place: String,
        /// Description of the damage.
        problem: String,
    },
    /// A plan that cannot be kept in a file.
    #[error("the plan cannot be kept in a file: `{text}` does not read back as it was; write it in another form")]
    Unprintable {
        /// The expression.
        text: String,
    },
    /// Two plans.
    #[error("{left} and {right} have different plans and cannot be joined:\n{difference}\n{mend}")]
    OtherPlan {
        /// One file or recipe.
        left: String,
        /// The other.
        right: String,
        /// Lines of the one (`-`) and the other (`+`).
        difference: String,
        /// Remedy.
        mend: String,
    },
    /// The same rows on both sides.
    #[error("{left} and {right} hold the same log: {}; drop it from one of them ({STATS_DROP})", some(.names))]
    SameLog {
        /// One file.
        left: String,
        /// The other.
        right: String,
        /// Names of the episodes.
        names: Vec<String>,
    },
    /// A request that matches no episode.
    #[error("{asked} matches no episode; the statistic has {}", some(.there))]
    NoMatch {
        /// Request that matched no episode.
        asked: String,
        /// Existing values.
        there: Vec<String>,
    },
    /// Nothing would be left.
    #[error("that drops all {0} episodes; delete the file instead")]
    NothingLeft(usize),
    /// The output exists.
    #[error("{} exists already; {APPEND} adds to it, {FORCE} replaces it", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Progress of another command.
    #[error(
        "{} was left by another command (other files, recipe or options): give that command again to go on, rename it to a .stats file and \
         {APPEND} to it, or begin anew with {FORCE}",
        path.display()
    )]
    OtherCommand {
        /// The file.
        path: PathBuf,
    },
    /// A label that cannot be made.
    #[error("{given_key}: {problem}", given_key = KEY.to(key))]
    Key {
        /// The argument.
        key: String,
        /// Description of the problem, and the remedy.
        problem: String,
    },
    /// Labels of a partition that are text.
    #[error(
        "`{column}` holds text, and a statistic numbers its labels by the files that are scanned together; use a column of numbers, or {KEY} and the labels of {EPISODES} to \
         tell episodes apart"
    )]
    Text {
        /// The column.
        column: String,
    },
}

/// The first names.
fn some(names: &[String]) -> String {
    const SHOWN: usize = 8;
    let mut text = names.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN {
        text.push_str(&format!(" and {} more", names.len() - SHOWN));
    }
    text
}
