//! One file a command.

pub(crate) mod auto;
pub(crate) mod check;
pub(crate) mod completions;
pub(crate) mod control;
pub(crate) mod demo;
pub(crate) mod export;
pub(crate) mod filter;
pub(crate) mod fit;
pub(crate) mod fit_known;
pub(crate) mod fit_narx;
pub(crate) mod fit_network;
pub(crate) mod fit_parameters;
pub(crate) mod fit_pwa;
pub(crate) mod fit_sindy;
pub(crate) mod fit_sparse;
pub(crate) mod flags;
pub(crate) mod frequency;
pub(crate) mod generate;
pub(crate) mod import;
pub(crate) mod info;
pub(crate) mod init;
pub(crate) mod man;
pub(crate) mod plane;
pub(crate) mod predict;
pub(crate) mod prepare;
mod reading;
pub(crate) mod report;
pub(crate) mod resimulate;
pub(crate) mod rollout;
pub(crate) mod scan;
pub(crate) mod schema;
pub(crate) mod score;
pub(crate) mod show;
pub(crate) mod stats;

use std::path::{Path, PathBuf};

use fleetfoot::{Error, Model, Recipe};
use serde::Serialize;
use serde_json::Value;

use crate::progress::Bar;

/// Settings and streams that all commands share.
pub(crate) struct Context {
    /// Name of the program, as the user typed it.
    pub(crate) program: String,
    pub(crate) json: bool,
    pub(crate) quiet: bool,
    /// True to explain the headings of tables.
    pub(crate) explain: bool,
}

impl Context {
    pub(crate) fn bar(&self) -> Bar {
        Bar::new(self.quiet)
    }

    /// Talk goes to standard error.
    pub(crate) fn say(&self, text: impl AsRef<str>) {
        if !self.quiet {
            crate::report::tell(text.as_ref());
        }
    }

    /// Tells how long work takes, where it is long.
    pub(crate) fn expect(&self, work: fleetfoot::Work) {
        if !self.quiet {
            self.notes(fleetfoot::stats::long_work(work).as_slice());
        }
    }

    pub(crate) fn notes(&self, notes: &[String]) {
        for note in notes {
            self.say(format!("note: {note}"));
        }
    }

    /// Tells of viewers' layouts that were written beside messages.
    pub(crate) fn layouts(&self, paths: &[PathBuf]) {
        let names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
        if !names.is_empty() {
            self.say(format!("wrote layouts that show it over the recording: {}", names.join(", ")));
        }
    }

    /// Looks at what a command will write, before it works: no output is an input, and no two are one file. What killed commands have left beside them is
    /// removed and told.
    pub(crate) fn claim(&self, outputs: &[PathBuf], inputs: &[PathBuf], force: bool) -> Result<(), Error> {
        fleetfoot::output::check_outputs(outputs, inputs)?;
        if !force {
            self.replaces(outputs)?;
        }
        for left in outputs.iter().flat_map(|output| fleetfoot::output::remove_leftovers(output)) {
            self.say(format!("note: removed {}, which a killed command had left", left.display()));
        }
        Ok(())
    }

    /// The one rule of files that are there: what a command makes again is replaced, and a note says so; what people write is not.
    fn replaces(&self, outputs: &[PathBuf]) -> Result<(), Error> {
        for output in outputs.iter().filter(|output| is_replaced(output)) {
            if output.extension().is_some_and(|ending| ending == "toml") {
                return Err(Error::output(format!(
                    "{}: a recipe has this name, and the results would replace it: name another file, or remove the recipe",
                    output.display()
                )));
            }
            self.say(format!("note: {} exists; the result replaces it", output.display()));
        }
        Ok(())
    }

    /// Results go to standard output.
    pub(crate) fn print(&self, report: impl Serialize, text: impl FnOnce() -> String) {
        if self.json {
            write_out(&format!("{:#}\n", tree(report)));
        } else {
            let text = text();
            let legend = if self.explain { crate::legend::legend() } else { String::new() };
            write_out(&format!("{}{legend}\n", text.trim_end()));
        }
    }
}

/// Writes to standard output. A reader that closes the pipe early (`| head`) wants no more, which is no error; a full disk is one.
pub(crate) fn write_out(text: &str) {
    use std::io::{ErrorKind, Write};
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Ok(()) => {}
        Err(problem) if problem.kind() == ErrorKind::BrokenPipe => std::process::exit(0),
        Err(problem) => {
            crate::report::tell(format!("error: standard output cannot be written: {problem}"));
            std::process::exit(1);
        }
    }
}

/// True if writing replaces a file; a device or a pipe has no content to lose.
pub(crate) fn is_replaced(output: &Path) -> bool {
    output.exists() && !fleetfoot::output::is_stream(output)
}

/// All files that a command reads.
pub(crate) fn read_by<'a>(files: &'a [PathBuf], more: impl IntoIterator<Item = &'a PathBuf>) -> Vec<PathBuf> {
    files.iter().chain(more).cloned().collect()
}

/// The files behind the arguments.
pub(crate) fn files(data: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    Ok(fleetfoot::log::paths(data)?)
}

/// The files of a fit: logs, or one statistic in their place.
pub(crate) fn logs_or_statistic(data: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    if fleetfoot::is_statistic(data) { Ok(data.to_vec()) } else { files(data) }
}

pub(crate) fn read_model(path: &Path) -> Result<Model, Error> {
    Ok(Model::read(path)?)
}

/// Flags of the clock and of the channels of a model's data, as a recipe.
pub(crate) fn time_changes(data: &crate::args::ModelData) -> Result<Recipe, Error> {
    changes(&data.time, &data.model)
}

/// The same; what is kept of decoded logs stands beside `model`.
pub(crate) fn changes(time: &crate::args::TimeArgs, model: &Path) -> Result<Recipe, Error> {
    let mut recipe = Recipe::default();
    flags::apply_time(&mut recipe, time)?;
    recipe.cache = flags::cache(&time.channels, model);
    Ok(recipe)
}

/// A warning for data that the model was trained on.
pub(crate) fn in_sample(context: &Context, names: &[String], episodes: usize) {
    if !names.is_empty() {
        let some: Vec<&str> = names.iter().take(3).map(String::as_str).collect();
        let more = if names.len() > 3 { ", ..." } else { "" };
        context.say(format!(
            "warning: {} of {episodes} episodes were used in training, as a whole or in part ({}{more}): these scores are in-sample and flatter the model",
            names.len(),
            some.join(", ")
        ));
    }
}

/// The files that were written.
#[derive(Serialize)]
pub(crate) struct Files<'a> {
    pub(crate) files: &'a [String],
}

/// JSON tree of a report; numbers that are not finite become `null`.
fn tree(report: impl Serialize) -> Value {
    serde_json::to_value(report).expect("keys and paths are text, and nothing else can fail in memory")
}
