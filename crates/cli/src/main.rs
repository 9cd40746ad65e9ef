//! The `fleetfoot` command: arguments, progress, exit codes.
//!
//! Exit codes: 0, 1 (the data or the fit is at fault; the message says what to do about it), 2 (usage), 130 (stopped).

mod args;
mod commands;
mod heatmap;
mod progress;
#[cfg(test)]
mod reference;
mod report;
mod table;

use std::process::ExitCode;

use clap::Parser;
use commands::Context;

use crate::args::{Cli, Command, Control, Fit};

fn main() -> ExitCode {
    let cli = Cli::try_parse().unwrap_or_else(|error| report::usage(&error));
    if let Err(error) = fleetfoot::data::check_instruction_set() {
        report::tell(error);
        return ExitCode::from(2);
    }
    progress::stop_on_interrupt();
    let context = Context { json: cli.json, quiet: cli.quiet };
    let result = fleetfoot::with_threads(cli.threads, || match &cli.command {
        Command::Demo(arguments) => commands::demo::demo(arguments, &context),
        Command::Info(arguments) => commands::info::info(arguments, &context),
        Command::Init(arguments) => commands::init::init(arguments, &context),
        Command::Fit(Fit::Pwa(arguments)) => commands::fit::pwa(arguments, &context),
        Command::Fit(Fit::Sparse(arguments)) => commands::fit_sparse::sparse(arguments, &context),
        Command::Fit(Fit::Parameters(arguments)) => commands::fit_parameters::parameters(arguments, &context),
        Command::Fit(Fit::Narx(arguments)) => commands::fit_narx::narx(arguments, &context),
        Command::Fit(Fit::Sindy(arguments)) => commands::fit_sindy::sindy(arguments, &context),
        Command::Prepare(arguments) => commands::prepare::prepare(arguments, &context),
        Command::Scan(arguments) => commands::scan::scan(arguments, &context),
        Command::Stats(arguments) => commands::stats::stats(arguments, &context),
        Command::Control(Control::Lqr(arguments)) => commands::control::lqr(arguments, &context),
        Command::Score(arguments) => commands::score::score(arguments, &context),
        Command::Predict(arguments) => commands::predict::predict(arguments, &context),
        Command::Rollout(arguments) => commands::rollout::rollout(arguments, &context),
        Command::Filter(arguments) => commands::filter::filter(arguments, &context),
        Command::Resimulate(arguments) => commands::resimulate::resimulate(arguments, &context),
        Command::Generate(arguments) => commands::generate::generate(arguments, &context),
        Command::Report(arguments) => commands::report::report(arguments, &context),
        Command::Show(arguments) => commands::show::show(arguments, &context),
        Command::Export(arguments) => commands::export::export(arguments, &context),
        Command::Completions(arguments) => commands::completions::completions(arguments),
        Command::Man(arguments) => commands::man::man(arguments, &context),
    });
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error @ fleetfoot::Error::Paused { .. }) => {
            report::tell(error);
            ExitCode::from(130)
        }
        Err(_) if progress::stopped() => {
            report::tell("stopped; nothing was written");
            ExitCode::from(130)
        }
        Err(error) => {
            report::report(error);
            ExitCode::from(1)
        }
    }
}
