//! Arguments.

mod auto;
mod check;
mod control;
mod examples;
mod export;
mod filter;
mod frequency;
mod generate;
mod import;
mod narx;
mod parameters;
mod prepare;
mod report;
mod resimulate;
mod rollout;
mod sindy;
mod sparse;
mod statistic;
mod tools;

use std::path::PathBuf;

pub(crate) use auto::Auto;
pub(crate) use check::Check;
use clap::{Args, Parser, Subcommand, ValueEnum};
pub(crate) use control::{Control, ControlDesign};
pub(crate) use export::{Export, ExportMethod, ExportPrecision, ExportTo};
pub(crate) use filter::Filter;
use fleetfoot::{Lags, NetworkSection, PwaSection, whole};
pub(crate) use frequency::Frequency;
pub(crate) use generate::{Generate, LogFormat, Speed};
pub(crate) use import::Import;
pub(crate) use narx::FitNarx;
pub(crate) use parameters::FitParameters;
pub(crate) use prepare::Prepare;
pub(crate) use report::Report;
pub(crate) use resimulate::Resimulate;
pub(crate) use rollout::{ControllerArgs, Method, OutsideArg, PathArgs, Rollout};
pub(crate) use sindy::{EquationArgs, FitSindy};
pub(crate) use sparse::FitSparse;
pub(crate) use statistic::{Scan, Stats, StatsCompact, StatsDrop, StatsInfo, StatsMerge};
pub(crate) use tools::{Completions, Man, Schema};

/// Turns robot logs into equations.
#[derive(Debug, Parser)]
#[command(
    name = "fleetfoot",
    version,
    about = "Turns robot logs into equations",
    propagate_version = true,
    max_term_width = 110,
    after_help = examples::OVERVIEW
)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Number of threads, at most four per core; results do not depend on it (default: all cores).
    #[arg(long, global = true, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub(crate) threads: usize,
    /// Print the result as JSON.
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// Print results and errors only, without progress and notes.
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    /// Explain the columns of the printed tables.
    #[arg(long, global = true)]
    pub(crate) explain: bool,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Simulate a positioning stage, find a model of its log, and compile the model's C code.
    #[command(after_help = examples::DEMO)]
    Demo(Demo),
    /// Summarise files: columns, rows, rates, gaps.
    #[command(after_help = examples::INFO)]
    Info(Info),
    /// Find a model of logs: fit by all methods, compare simulations of held-out rows.
    #[command(after_help = examples::AUTO)]
    Auto(Box<Auto>),
    /// List the faults of logs, each with its remedy: stamps, dead channels, units, delays.
    #[command(after_help = examples::CHECK)]
    Check(Check),
    /// Write a commented recipe for a log, to be edited.
    #[command(after_help = examples::INIT)]
    Init(Init),
    /// Print the JSON schema of recipes, for editors: completion and errors while typing.
    #[command(after_help = examples::SCHEMA)]
    Schema(Schema),
    /// Smooth the states of logs: episodes with derivatives, and the recipe to fit them.
    #[command(after_help = examples::PREPARE)]
    Prepare(Box<Prepare>),
    /// Sum logs into a statistic that is fitted later, without the logs.
    #[command(after_help = examples::SCAN, mut_arg("radial", |arg| arg.hide(true)))]
    Scan(Box<Scan>),
    /// Inspect statistics, merge them, drop episodes.
    #[command(subcommand)]
    Stats(Stats),
    /// Fit a model to logs.
    #[command(subcommand)]
    Fit(Fit),
    /// Make a controller from a model.
    #[command(subcommand)]
    Control(Control),
    /// Score a model's one-step predictions on logs.
    #[command(after_help = examples::SCORE)]
    Score(Score),
    /// Write a model's prediction, residual and region for every row.
    #[command(after_help = examples::PREDICT)]
    Predict(Predict),
    /// Simulate a model from measured states and compare with the recording.
    #[command(after_help = examples::ROLLOUT)]
    Rollout(Rollout),
    /// Estimate states from noisy measurements, with a Kalman filter for every region.
    #[command(after_help = examples::FILTER)]
    Filter(Box<Filter>),
    /// Estimate a frequency response with coherence and intervals, of logs and of a model.
    #[command(after_help = examples::FREQUENCY)]
    Frequency(Box<Frequency>),
    /// Find states and inputs that obey a model and its bounds and follow a recording.
    #[command(after_help = examples::RESIMULATE)]
    Resimulate(Box<Resimulate>),
    /// Write one page about models: verdict, equations, regions, errors, simulations.
    #[command(after_help = examples::REPORT)]
    Report(Box<Report>),
    /// Print a model's equations and regions, or a controller's set point and gains.
    #[command(after_help = examples::SHOW)]
    Show(Show),
    /// Write a model as C, Rust, Python, LaTeX, arrays or an ONNX network.
    #[command(after_help = examples::EXPORT)]
    Export(Export),
    /// Make a model of a network that another program trained (ONNX).
    #[command(after_help = examples::IMPORT)]
    Import(Import),
    /// Simulate a robot: logs with known truth, and the recipe to fit them.
    #[command(after_help = examples::GENERATE)]
    Generate(Box<Generate>),
    /// Print completions for a shell, to be saved where the shell looks for them.
    #[command(after_help = examples::COMPLETIONS)]
    Completions(Completions),
    /// Write the manual pages of all commands.
    #[command(after_help = examples::MAN)]
    Man(Man),
}

#[derive(Debug, Subcommand)]
pub(crate) enum Fit {
    /// A piecewise-affine model.
    #[command(after_help = examples::FIT_PWA)]
    Pwa(Box<FitPwa>),
    /// Sparse equations over latent functions, which several equations may share.
    #[command(after_help = examples::FIT_SPARSE, mut_arg("radial", |arg| arg.hide(true)), mut_arg("keep_all", |arg| arg.hide(true)))]
    Sparse(Box<FitSparse>),
    /// Sparse sums of candidate functions (SINDy), beside a known part of the dynamics.
    #[command(after_help = examples::FIT_SINDY)]
    Sindy(Box<FitSindy>),
    /// Autoregression: outputs from past outputs and inputs, polynomial or piecewise (NARX).
    // The method fixes these options: they are refused, with a hint to the right ones.
    #[command(after_help = examples::FIT_NARX, mut_arg("radial", |arg| arg.hide(true)), mut_arg("derivative", |arg| arg.hide(true)), mut_arg("predict", |arg| arg.hide(true)), mut_arg("lags", |arg| arg.conflicts_with_all(["lags_out", "lags_in"])))]
    Narx(Box<FitNarx>),
    /// A network beside a linear map, where it predicts held-out rows better; else the linear model.
    #[command(after_help = examples::FIT_NETWORK, mut_arg("radial", |arg| arg.hide(true)), mut_arg("weight", |arg| arg.hide(true)), mut_arg("keep_all", |arg| arg.hide(true)), mut_arg("data", |arg| arg.value_name("DATA").help("Files, globs or folders")))]
    Network(Box<FitNetwork>),
    /// Parameters of given equations, with intervals, by output error, filter error or equation error.
    // The equations fix targets and regressors: these options are refused.
    #[command(after_help = examples::FIT_PARAMETERS, mut_arg("radial", |arg| arg.hide(true)), mut_arg("predict", |arg| arg.hide(true)), mut_arg("degree", |arg| arg.hide(true)), mut_arg("lags", |arg| arg.hide(true)), mut_arg("weight", |arg| arg.hide(true)), mut_arg("keep_all", |arg| arg.hide(true)), mut_arg("data", |arg| arg.value_name("DATA").help("Files, globs or folders")))]
    Parameters(Box<FitParameters>),
}

#[derive(Debug, Args)]
pub(crate) struct Demo {
    /// Folder for the generated logs and the models.
    #[arg(short, long, value_name = "DIR", default_value = "fleetfoot-demo")]
    pub(crate) output: PathBuf,
    /// Seed of all random numbers.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Repeat the tables and figures of the running robot's paper on a simulated hexapod, in a quarter of an hour.
    #[arg(long)]
    pub(crate) paper: bool,
    /// Simulated time of all runs together, with --paper.
    #[arg(long, value_name = "MINUTES", default_value_t = 10.0, requires = "paper", allow_negative_numbers = true)]
    pub(crate) minutes: f64,
}

#[derive(Debug, Args)]
pub(crate) struct Info {
    /// Files, globs or folders.
    #[arg(required = true, value_name = "DATA")]
    pub(crate) data: Vec<PathBuf>,
    /// Minimum, mean, maximum and missing values of every column.
    #[arg(long)]
    pub(crate) values: bool,
    /// Correlation of every pair of columns.
    #[arg(long, conflicts_with_all = ["values", "lag"])]
    pub(crate) correlation: bool,
    /// Columns of the correlation, separated by commas (default: all numbers).
    #[arg(long, value_name = "COLUMNS", requires = "correlation")]
    pub(crate) columns: Option<List>,
    /// A reference and its response: their difference and correlation by the delay of the response (default: no such
    /// pair).
    #[arg(long, value_name = "REFERENCE,RESPONSE", conflicts_with = "values")]
    pub(crate) lag: Option<List>,
    /// Largest shift of --lag, in rows.
    #[arg(long, value_name = "ROWS", default_value_t = 100, requires = "lag", value_parser = whole::<usize>(1..=100_000))]
    pub(crate) reach: usize,
    /// Recipe of the columns, for --correlation and --lag (default: the columns of the files).
    #[arg(short = 'c', long = "recipe", value_name = "RECIPE")]
    pub(crate) recipe: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct Init {
    /// A log, or the files or the folder of one or several runs, which `[files]` of the recipe joins.
    #[arg(required = true, value_name = "DATA")]
    pub(crate) data: Vec<PathBuf>,
    /// Topics of a robot's log to list, separated by commas (default: all).
    #[arg(long, value_name = "TOPICS")]
    pub(crate) topic: Option<List>,
    /// Recipe to write (default: standard output).
    #[arg(short, long, value_name = "RECIPE")]
    pub(crate) output: Option<PathBuf>,
    /// Overwrite an existing recipe.
    #[arg(long)]
    pub(crate) force: bool,
}

/// Names or expressions separated by commas; commas within parentheses, brackets and backticks do not separate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct List(pub(crate) Vec<String>);

impl std::str::FromStr for List {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let items = fleetfoot::items(text);
        if items.iter().any(String::is_empty) {
            return Err("an empty name between commas".into());
        }
        Ok(Self(items))
    }
}

/// Options that override the recipe.
#[derive(Debug, Args, Default)]
pub(crate) struct RecipeArgs {
    /// Recipe file; flags override its entries (default: none).
    #[arg(short = 'c', long = "recipe", value_name = "RECIPE")]
    pub(crate) recipe: Option<PathBuf>,
    /// States, separated by commas (default: those of the recipe).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) states: Option<List>,
    /// Inputs, separated by commas (default: those of the recipe).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) inputs: Option<List>,
    /// States and inputs that are angles, separated by commas (default: those of the recipe).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) angles: Option<List>,
    /// Short name for a field or an expression; may be repeated.
    #[arg(long, value_name = "NAME=EXPRESSION")]
    pub(crate) alias: Vec<String>,
    /// Derivative of a state: auto, central, central4, central6 (order 2, 4, 6), forward, backward, a column, an
    /// expression, or over:20 (mean slope to 20 rows ahead); may be repeated.
    #[arg(long, value_name = "STATE=HOW")]
    pub(crate) derivative: Vec<String>,
    /// Target: derivative, next, delta, or columns separated by commas; columns need no time stamps (default:
    /// derivative; of network delta).
    #[arg(long, value_name = "WHAT")]
    pub(crate) predict: Option<String>,
    /// Total degree of the polynomial library; 1 is affine (default: 1 of pwa and sparse, 2 of sindy; narx searches).
    #[arg(long, value_name = "N")]
    pub(crate) degree: Option<u32>,
    /// Number of Gaussian radial functions beside the polynomials, for fit pwa and fit sindy (default: none).
    #[arg(long, value_name = "N")]
    pub(crate) radial: Option<usize>,
    /// Past rows of every state and input beside the present one: the last N, or every K-th of the last L as L:K
    /// (default: 0; narx and network search).
    #[arg(long, value_name = "ROWS")]
    pub(crate) lags: Option<Lags>,
    /// Non-negative row weights, a column or an expression; only their ratios matter (default: 1 for every row).
    #[arg(long, value_name = "EXPRESSION")]
    pub(crate) weight: Option<String>,
    #[command(flatten)]
    pub(crate) time: TimeArgs,
}

#[derive(Debug, Args, Default)]
pub(crate) struct TimeArgs {
    /// Column of the time stamps (default: recognised by its name).
    #[arg(long, value_name = "COLUMN")]
    pub(crate) time: Option<String>,
    /// Unit of numeric stamps: s, ms, us, ns (default: inferred from name and size).
    #[arg(long, value_name = "UNIT", requires = "time")]
    pub(crate) time_unit: Option<String>,
    /// Seconds between rows, in place of a time column (default: stamps are read).
    #[arg(long, value_name = "SECONDS", conflicts_with = "time")]
    pub(crate) dt: Option<f64>,
    /// Gap between stamps that ends an episode: seconds, auto (five median periods) or none (default: auto).
    #[arg(long, value_name = "SECONDS")]
    pub(crate) max_gap: Option<String>,
    /// Condition on rows, as in 'armed > 0 and 2 < time() < 60'; other rows end an episode (default: all rows; with a
    /// model, its condition).
    #[arg(long = "where", value_name = "CONDITION")]
    pub(crate) only: Option<String>,
    #[command(flatten)]
    pub(crate) channels: ChannelArgs,
}

/// Conversion of the channels of a robot's log (MCAP, ULog, ArduPilot, ...) into rows.
#[derive(Debug, Args, Default)]
pub(crate) struct ChannelArgs {
    /// Clock of a robot's log (default: header where every channel in use has one, else log).
    #[arg(long, value_enum, value_name = "CLOCK")]
    pub(crate) stamp: Option<StampArg>,
    /// Topic whose messages make the rows; other topics are joined to it (default: that of the first state).
    #[arg(long, value_name = "TOPIC", conflicts_with = "rate")]
    pub(crate) base: Option<String>,
    /// Even rows per second, for topics and tables (default: the rows of the base topic or of the table).
    #[arg(long, value_name = "HZ")]
    pub(crate) rate: Option<f64>,
    /// Name of a topic in the recipe or model, and in these files; may be repeated.
    #[arg(long, value_name = "/OURS=/FILE")]
    pub(crate) rename: Vec<String>,
    /// Folder for decoded columns, which later commands reuse (default: `.fleetfoot-cache` beside the model, for logs
    /// of 64 MiB and more).
    #[arg(long, value_name = "DIR", conflicts_with = "no_cache")]
    pub(crate) cache: Option<PathBuf>,
    /// Decode the logs anew, and keep no decoded columns.
    #[arg(long)]
    pub(crate) no_cache: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum StampArg {
    /// Stamp in the message's header.
    #[value(alias = "header.stamp")]
    Header,
    /// Time of recording.
    #[value(alias = "log_time")]
    Log,
    /// Time of publication.
    #[value(alias = "publish_time")]
    Publish,
}

/// Data and recipe of a fit.
#[derive(Debug, Args)]
pub(crate) struct FitData {
    /// Files, globs or folders; or one `.stats` file.
    #[arg(required = true, value_name = "DATA|STATS")]
    pub(crate) data: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
}

/// Output of a fit.
#[derive(Debug, Args)]
pub(crate) struct FitOutput {
    /// Models of the other candidates beside the chosen one, such as model_kmeans10.json or model_terms3.json.
    #[arg(long, alias = "keep-front")]
    pub(crate) keep_all: bool,
    /// Print rows, memory and work of the job, then stop.
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// Model to write.
    #[arg(short, long, value_name = "MODEL", default_value = "model.json")]
    pub(crate) output: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct FitPwa {
    #[command(flatten)]
    pub(crate) data: FitData,
    /// Partitions, of which one is chosen: `average`, `kmeans:10`, `kmeans:2,5,10`, `refined:2..20`, `tree:3`,
    /// `labels:COLUMN`, `null` (default: those of the recipe, else `average,kmeans:2,5,10`).
    ///
    /// Others are `zscore:1.5`, `zbox:1.5`, `lattice:2..50` and `labels:COLUMN+kmeans:5` (or `+refined:5`, `+tree:3`).
    /// The default has `refined:2..5` too for 2,000 rows or fewer; of a statistic it is those that it sums.
    #[arg(short, long, value_name = "PARTITIONS")]
    pub(crate) partition: Option<String>,
    /// Columns that define the regions, separated by commas (default: the states).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) partition_on: Option<List>,
    #[command(flatten)]
    pub(crate) pwa: PwaSection,
    #[command(flatten)]
    pub(crate) output: FitOutput,
}

#[derive(Debug, Args)]
pub(crate) struct FitNetwork {
    #[command(flatten)]
    pub(crate) data: FitData,
    #[command(flatten)]
    pub(crate) network: NetworkSection,
    #[command(flatten)]
    pub(crate) output: FitOutput,
}

/// A model, and the logs to run it on.
#[derive(Debug, Args)]
pub(crate) struct ModelData {
    /// Model file.
    #[arg(value_name = "MODEL")]
    pub(crate) model: PathBuf,
    /// Files, globs or folders.
    #[arg(required = true, value_name = "DATA")]
    pub(crate) data: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) time: TimeArgs,
}

#[derive(Debug, Args)]
pub(crate) struct Score {
    #[command(flatten)]
    pub(crate) model: ModelData,
    /// Score of every episode.
    #[arg(long)]
    pub(crate) episodes: bool,
    /// Two columns or expressions: a map of region changes and errors over their plane (default: no plane).
    #[arg(long, value_name = "A,B")]
    pub(crate) plane: Option<List>,
    /// Cells of the plane along each axis.
    #[arg(long, value_name = "N", default_value_t = 36, requires = "plane", value_parser = whole::<usize>(0..=1000))]
    pub(crate) bins: usize,
    /// File for the cells of the plane: Parquet or text (`*.csv`) (default: none).
    #[arg(short, long, value_name = "FILE", requires = "plane")]
    pub(crate) output: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct Predict {
    #[command(flatten)]
    pub(crate) model: ModelData,
    /// File to write: Parquet (`*.parquet`), text (`*.csv`, `*.tsv`) or messages for viewers (`*.mcap`).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct Show {
    /// Model, or controller of `control`.
    #[arg(value_name = "MODEL")]
    pub(crate) model: PathBuf,
    /// Number of regions to print, the largest first.
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub(crate) regions: usize,
    /// Sequence and duration of regions, position along a phase, and neighbours whose maps differ; for refined
    /// partitions, lattices, trees and --phase.
    #[arg(long)]
    pub(crate) transitions: bool,
    /// Comparison of all pairs of regions, not only of neighbours.
    #[arg(long, requires = "transitions")]
    pub(crate) all_pairs: bool,
}

#[cfg(test)]
mod tests;
