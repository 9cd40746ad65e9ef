//! The `fleetfoot` command: arguments, progress, exit codes.
//!
//! [`run`] is the command as a function, for the binary and for the Python package. Exit codes: 0, 1 (the data or the
//! fit is at fault; the message says what to do about it), 2 (usage), 130 (stopped).

mod args;
mod commands;
mod curve;
mod heatmap;
mod help;
mod legend;
mod progress;
#[cfg(test)]
mod reference;
mod report;
mod signals;
mod table;

use std::ffi::OsString;

use clap::{CommandFactory, FromArgMatches};
use commands::Context;
use fleetfoot::data::{Cancelled, setting, stoppable};

use crate::args::{Cli, Command, Control, Fit};

/// Threads a core, at most: more of them wait for one another.
const THREADS_A_CORE: usize = 4;

/// The threads that are used of those that are asked for.
fn threads(asked: usize, context: &Context) -> usize {
    let most = THREADS_A_CORE * std::thread::available_parallelism().map_or(1, Into::into);
    if asked > most {
        context
            .say(format!("note: --threads {asked}: {most} threads are used, {THREADS_A_CORE} a core of this machine"));
    }
    asked.min(most)
}

/// Runs the command with its arguments, of which the first is the program's name, and returns the exit code.
///
/// A process runs one command: results go to its standard output, messages to its standard error, and its signals
/// (Ctrl-C) stop the work. A second Ctrl-C and a closed standard output end the process.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    setting::word_as(&setting::Flags);
    let matches = help::grouped(Cli::command()).try_get_matches_from(&arguments);
    let cli = match matches.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) => return report::usage(&error, &arguments),
    };
    if let Err(error) = fleetfoot::data::check_instruction_set() {
        report::tell(error);
        return 2;
    }
    signals::stop_on_signals();
    let program =
        arguments.first().map_or_else(|| "fleetfoot".into(), |program| program.to_string_lossy().into_owned());
    let context = Context { program, json: cli.json, quiet: cli.quiet, explain: cli.explain };
    let work = || match &cli.command {
        Command::Demo(arguments) => commands::demo::demo(arguments, &context),
        Command::Info(arguments) => commands::info::info(arguments, &context),
        Command::Auto(arguments) => commands::auto::auto(arguments, &context),
        Command::Check(arguments) => commands::check::run(arguments, &context),
        Command::Init(arguments) => commands::init::init(arguments, &context),
        Command::Schema(arguments) => commands::schema::schema(arguments, &context),
        Command::Fit(Fit::Network(arguments)) => commands::fit_network::network(arguments, &context),
        Command::Fit(Fit::Pwa(arguments)) => commands::fit_pwa::pwa(arguments, &context),
        Command::Fit(Fit::Sparse(arguments)) => commands::fit_sparse::sparse(arguments, &context),
        Command::Fit(Fit::Parameters(arguments)) => commands::fit_parameters::parameters(arguments, &context),
        Command::Fit(Fit::Narx(arguments)) => commands::fit_narx::narx(arguments, &context),
        Command::Fit(Fit::Sindy(arguments)) => commands::fit_sindy::sindy(arguments, &context),
        Command::Prepare(arguments) => commands::prepare::prepare(arguments, &context),
        Command::Scan(arguments) => commands::scan::scan(arguments, &context),
        Command::Stats(arguments) => commands::stats::stats(arguments, &context),
        Command::Control(Control::Lqr(arguments)) => commands::control::lqr(arguments, &context),
        Command::Control(Control::Mpc(arguments)) => commands::control::mpc(arguments, &context),
        Command::Score(arguments) => commands::score::score(arguments, &context),
        Command::Predict(arguments) => commands::predict::predict(arguments, &context),
        Command::Rollout(arguments) => commands::rollout::rollout(arguments, &context),
        Command::Filter(arguments) => commands::filter::filter(arguments, &context),
        Command::Frequency(arguments) => commands::frequency::run(arguments, &context),
        Command::Resimulate(arguments) => commands::resimulate::resimulate(arguments, &context),
        Command::Generate(arguments) => commands::generate::generate(arguments, &context),
        Command::Report(arguments) => commands::report::report(arguments, &context),
        Command::Show(arguments) => commands::show::show(arguments, &context),
        Command::Export(arguments) => commands::export::export(arguments, &context),
        Command::Import(arguments) => commands::import::import(arguments, &context),
        Command::Completions(arguments) => commands::completions::completions(arguments),
        Command::Man(arguments) => commands::man::man(arguments, &context),
    };
    match fleetfoot::with_threads(threads(cli.threads, &context), || stoppable(signals::stop(), work)) {
        // What a stopped search had found is written, and the search is not complete.
        Ok(Ok(())) if signals::stop().is_set() => signals::STOPPED,
        Ok(Ok(())) => 0,
        Ok(Err(error @ fleetfoot::Error::Paused { .. })) => {
            report::tell(error);
            signals::STOPPED
        }
        Ok(Err(error)) if !signals::stop().is_set() => {
            report::report(error);
            1
        }
        Err(Cancelled) | Ok(Err(_)) => {
            report::tell(match fleetfoot::output::written_files() {
                0 => "stopped; nothing was written".to_owned(),
                1 => "stopped; one file was written whole, and stays".to_owned(),
                files => format!("stopped; {files} files were written whole, and stay"),
            });
            signals::STOPPED
        }
    }
}
