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
    /// Candidate functions of the equations, with form and default of `fit sindy`.
    #[arg(long, value_name = "ITEMS")]
    pub(crate) library: Option<List>,
    /// Partitions whose regions are summed beside all rows: `kmeans:2,5,10`, zscore:1.5, labels:COLUMN (default: those
    /// of the recipe).
    #[arg(short, long, value_name = "PARTITIONS")]
    pub(crate) partition: Option<String>,
    /// Columns that define the regions, separated by commas (default: the states).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) partition_on: Option<List>,
    /// Statistic to write.
    #[arg(short, long, value_name = "STATS", default_value = "run.stats")]
    pub(crate) output: PathBuf,
    /// Label of the episodes from the path of their file: `aircraft={dir1}` is its folder, {dir2} the one above, also
    /// {name}, {stem}; may be repeated.
    #[arg(long, value_name = "NAME=TEXT")]
    pub(crate) key: Vec<String>,
    /// Add to the output, with its plan, if it exists; logs that it holds are skipped.
    #[arg(long, conflicts_with_all = ["force", "plan"])]
    pub(crate) append: bool,
    /// Statistic whose plan is used, so that the two can be merged (default: a new plan).
    #[arg(long, value_name = "STATS")]
    pub(crate) plan: Option<PathBuf>,
    /// Rows of a chunk, the smallest stored part of an episode (default: by the number of rows).
    #[arg(long, value_name = "N")]
    pub(crate) chunk_rows: Option<NonZeroUsize>,
    /// Replace an existing output, and the unfinished output of another command.
    #[arg(long)]
    pub(crate) force: bool,
    /// Print files, rows and memory of the job, then stop.
    #[arg(long)]
    pub(crate) dry_run: bool,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Stats {
    /// Summarise a statistic: tasks, latents, episodes, condition numbers, sizes.
    #[command(after_help = super::examples::STATS_INFO)]
    Info(StatsInfo),
    /// Merge statistics of one plan.
    #[command(after_help = super::examples::STATS_MERGE)]
    Merge(StatsMerge),
    /// Drop episodes from a statistic.
    #[command(after_help = super::examples::STATS_DROP)]
    Drop(StatsDrop),
    /// Merge the chunks of every episode: a smaller file, without detail within episodes.
    #[command(after_help = super::examples::STATS_COMPACT)]
    Compact(StatsCompact),
}

#[derive(Debug, Args)]
pub(crate) struct StatsInfo {
    /// Statistic file.
    #[arg(value_name = "STATS")]
    pub(crate) file: PathBuf,
    /// List of all episodes.
    #[arg(long)]
    pub(crate) episodes: bool,
    /// Plan and recipe.
    #[arg(long)]
    pub(crate) recipe: bool,
}

#[derive(Debug, Args)]
pub(crate) struct StatsMerge {
    /// Statistics to merge.
    #[arg(required = true, num_args = 2.., value_name = "STATS")]
    pub(crate) files: Vec<PathBuf>,
    /// Statistic to write.
    #[arg(short, long, value_name = "STATS")]
    pub(crate) output: PathBuf,
    /// Replace an existing output.
    #[arg(long)]
    pub(crate) force: bool,
}

#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("what").required(true).multiple(true))]
pub(crate) struct StatsDrop {
    /// Statistic file.
    #[arg(value_name = "STATS")]
    pub(crate) input: PathBuf,
    /// Episode by name or identity; may be repeated.
    #[arg(long, value_name = "NAME|ID", group = "what")]
    pub(crate) episode: Vec<String>,
    /// All episodes with this value of a label; may be repeated.
    #[arg(long = "where", value_name = "LABEL=VALUE", group = "what")]
    pub(crate) label: Vec<String>,
    /// All episodes of a file; may be repeated.
    #[arg(long, value_name = "NAME", group = "what")]
    pub(crate) file: Vec<String>,
    /// Statistic to write.
    #[arg(short, long, value_name = "STATS")]
    pub(crate) output: PathBuf,
    /// Replace an existing output.
    #[arg(long)]
    pub(crate) force: bool,
}

#[derive(Debug, Args)]
pub(crate) struct StatsCompact {
    /// Statistic file.
    #[arg(value_name = "STATS")]
    pub(crate) file: PathBuf,
    /// Rows that become one chunk.
    #[arg(long, value_name = "WHAT", default_value = "episode", value_parser = ["episode"])]
    pub(crate) by: String,
    /// Statistic to write.
    #[arg(short, long, value_name = "STATS")]
    pub(crate) output: PathBuf,
    /// Replace an existing output.
    #[arg(long)]
    pub(crate) force: bool,
}
