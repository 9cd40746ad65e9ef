//! Arguments of `scan` and `stats`.

use std::{num::NonZeroUsize, path::PathBuf};

use clap::{Args, Subcommand};

use super::{List, RecipeArgs};

#[derive(Debug, Args)]
pub(crate) struct Scan {
    /// Files, globs or folders.
    #[arg(required = true, value_name = "DATA")]
    pub(crate) data: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
    /// Candidate functions of the equations, separated by commas, as those of `fit sindy` (default: the monomials up to --degree, else poly(2), or poly(1)
    /// where that would be more than 500).
    #[arg(long, value_name = "ITEMS")]
    pub(crate) library: Option<List>,
    /// Partitions whose regions are summed beside all rows: `kmeans:2,5,10`, zscore:1.5, labels:COLUMN. They are clustered before the pass and frozen
    /// with the plan (default: those of the recipe).
    #[arg(short, long, value_name = "PARTITIONS")]
    pub(crate) partition: Option<String>,
    /// What partitions look at, separated by commas (default: the states).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) partition_on: Option<List>,
    /// The statistic to write.
    #[arg(short, long, value_name = "STATS", default_value = "run.stats")]
    pub(crate) output: PathBuf,
    /// A label of the episodes from their file's path: `aircraft={dir1}`, with {dir1} the folder that holds the file, {dir2} the one above,
    /// {name} and {stem}; may be repeated.
    #[arg(long, value_name = "NAME=TEXT")]
    pub(crate) key: Vec<String>,
    /// Add to the output if it exists, with its plan; logs that it has are skipped.
    #[arg(long, conflicts_with_all = ["force", "plan"])]
    pub(crate) append: bool,
    /// Use the plan of another statistic, so that the two can be merged (default: a plan of its own).
    #[arg(long, value_name = "STATS")]
    pub(crate) plan: Option<PathBuf>,
    /// Rows of a chunk, the smallest part of an episode that is kept apart (default: by the number of rows).
    #[arg(long, value_name = "N")]
    pub(crate) chunk_rows: Option<NonZeroUsize>,
    /// Replace an existing output, and what another command has left unfinished.
    #[arg(long)]
    pub(crate) force: bool,
    /// Tell what the job would read and keep, and stop.
    #[arg(long)]
    pub(crate) dry_run: bool,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Stats {
    /// Tell what a statistic holds: tasks, latents, episodes, conditions, sizes.
    #[command(after_help = super::examples::STATS_INFO)]
    Info(StatsInfo),
    /// Join statistics of one plan.
    #[command(after_help = super::examples::STATS_MERGE)]
    Merge(StatsMerge),
    /// Take episodes out of a statistic.
    #[command(after_help = super::examples::STATS_DROP)]
    Drop(StatsDrop),
    /// Join the chunks of every episode: a smaller file, without what lies within episodes.
    #[command(after_help = super::examples::STATS_COMPACT)]
    Compact(StatsCompact),
}

#[derive(Debug, Args)]
pub(crate) struct StatsInfo {
    /// The statistic.
    #[arg(value_name = "STATS")]
    pub(crate) file: PathBuf,
    /// List every episode.
    #[arg(long)]
    pub(crate) episodes: bool,
    /// Show the plan and the recipe.
    #[arg(long)]
    pub(crate) recipe: bool,
}

#[derive(Debug, Args)]
pub(crate) struct StatsMerge {
    /// The statistics.
    #[arg(required = true, num_args = 2.., value_name = "STATS")]
    pub(crate) files: Vec<PathBuf>,
    /// The statistic to write.
    #[arg(short, long, value_name = "STATS")]
    pub(crate) output: PathBuf,
    /// Replace an existing output.
    #[arg(long)]
    pub(crate) force: bool,
}

#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("what").required(true).multiple(true))]
pub(crate) struct StatsDrop {
    /// The statistic.
    #[arg(value_name = "STATS")]
    pub(crate) input: PathBuf,
    /// An episode, by name or identity; may be repeated.
    #[arg(long, value_name = "NAME|ID", group = "what")]
    pub(crate) episode: Vec<String>,
    /// All episodes with this value of a label; may be repeated.
    #[arg(long = "where", value_name = "LABEL=VALUE", group = "what")]
    pub(crate) label: Vec<String>,
    /// All episodes of a file; may be repeated.
    #[arg(long, value_name = "NAME", group = "what")]
    pub(crate) file: Vec<String>,
    /// The statistic to write.
    #[arg(short, long, value_name = "STATS")]
    pub(crate) output: PathBuf,
    /// Replace an existing output.
    #[arg(long)]
    pub(crate) force: bool,
}

#[derive(Debug, Args)]
pub(crate) struct StatsCompact {
    /// The statistic.
    #[arg(value_name = "STATS")]
    pub(crate) file: PathBuf,
    /// What becomes one chunk.
    #[arg(long, value_name = "WHAT", default_value = "episode", value_parser = ["episode"])]
    pub(crate) by: String,
    /// The statistic to write.
    #[arg(short, long, value_name = "STATS")]
    pub(crate) output: PathBuf,
    /// Replace an existing output.
    #[arg(long)]
    pub(crate) force: bool,
}
