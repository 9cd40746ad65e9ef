//! `fleetfoot report`.

use std::path::{Path, PathBuf};

use fleetfoot::{Error, FigureFormat, Model, ReportOptions, output::together};
use serde::Serialize;
use serde_json::Value;

use super::{Context, changes, files, in_sample, read_by, read_model};
use crate::args::Report;

/// Summary of a report page, and its file.
#[derive(Serialize)]
pub(super) struct OnPage {
    #[serde(flatten)]
    report: Value,
    page: String,
}

impl OnPage {
    pub(super) fn new(made: &fleetfoot::Report, path: &Path) -> Self {
        Self { report: made.to_json(), page: path.display().to_string() }
    }
}

#[derive(Serialize)]
struct PageReport {
    #[serde(flatten)]
    page: OnPage,
    figures: Vec<String>,
}

pub(crate) fn report(arguments: &Report, context: &Context) -> Result<(), Error> {
    let (paths, data): (Vec<PathBuf>, Vec<PathBuf>) = arguments.files.iter().cloned().partition(|path| is_model(path));
    let Some(first) = paths.first() else {
        return Err(Error::missing("no file is a model: name one or more (*.json), then the data".into()));
    };
    let data = if data.is_empty() { Vec::new() } else { files(&data)? };
    let inputs = read_by(&data, arguments.controller.file().iter().chain(&paths).chain(&arguments.fit));
    context.claim(std::slice::from_ref(&arguments.output), &inputs, false)?;
    let models = named(&paths)?;
    let changes = changes(&arguments.time, first)?;
    let mut options = ReportOptions::default();
    options.title.clone_from(&arguments.title);
    options.horizon = arguments.horizon;
    options.starts = arguments.starts.get();
    options.controller = arguments.controller.read()?;
    options.paths = arguments.paths.options();
    options.plane = arguments.plane.as_ref().map(|axes| plane(&axes.0)).transpose()?;
    options.fits = arguments.fit.iter().map(|path| fit_report(path)).collect::<Result<_, _>>()?;
    let bar = context.bar();
    let made = fleetfoot::report(&models, &changes, &data, &options, &bar);
    bar.finish();
    let made = made?;
    context.notes(&made.notes);
    in_sample(context, &made.in_sample, made.episodes);
    let folders = [(&arguments.svg, FigureFormat::Svg), (&arguments.csv, FigureFormat::Csv)];
    let folders = folders.iter().filter_map(|(folder, format)| Some((folder.as_deref()?, *format)));
    let figures: Vec<_> = together(|| {
        made.write(&arguments.output, &inputs)?;
        folders
            .map(|(folder, format)| Ok((folder, made.write_figures(folder, format, &inputs)?)))
            .collect::<Result<_, Error>>()
    })?;
    let shown = |path: &PathBuf| path.display().to_string();
    let report = PageReport {
        page: OnPage::new(&made, &arguments.output),
        figures: figures.iter().flat_map(|(_, paths)| paths.iter().map(shown)).collect(),
    };
    context.print(report, || {
        let finding = |finding: &fleetfoot::report::Sentence| {
            format!("{}: {} {}", finding.light.word(), finding.head, finding.text)
        };
        made.findings().map(finding).collect::<Vec<_>>().join("\n")
    });
    context.say(format!("wrote {}", arguments.output.display()));
    for (folder, paths) in figures {
        context.say(format!("wrote {} figures to {}", paths.len(), folder.display()));
    }
    Ok(())
}

/// The two axes of a plane.
fn plane(axes: &[String]) -> Result<[String; 2], Error> {
    <[String; 2]>::try_from(axes.to_vec())
        .map_err(|axes| Error::value(format!("--plane {}: a plane has two columns", axes.join(","))))
}

/// JSON report of a fit.
fn fit_report(path: &Path) -> Result<Value, Error> {
    let unread = |source| fleetfoot::log::Error::Io { path: path.to_owned(), action: "read", source };
    let text = std::fs::read(path).map_err(unread)?;
    serde_json::from_slice(&text).map_err(|error| {
        let path = path.display();
        Error::value(format!("{path} is not JSON ({error}): give the output of a fit with --json"))
    })
}

pub(super) fn is_model(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

/// Models by what they are; where that does not tell them apart by the names of their files, else by their paths.
pub(super) fn named(paths: &[PathBuf]) -> Result<Vec<(String, Model)>, Error> {
    let models = paths.iter().map(|path| read_model(path)).collect::<Result<Vec<Model>, Error>>()?;
    let methods = models.iter().map(|model| model.method.clone()).collect();
    let stems = paths.iter().map(|path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned()).collect();
    let whole = paths.iter().map(|path| path.display().to_string()).collect();
    let names = [methods, stems, whole].into_iter().find(|names: &Vec<String>| are_distinct(names));
    Ok(names
        .unwrap_or_else(|| (1..=paths.len()).map(|place| format!("model {place}")).collect())
        .into_iter()
        .zip(models)
        .collect())
}

fn are_distinct(names: &[String]) -> bool {
    names.iter().collect::<std::collections::BTreeSet<_>>().len() == names.len()
}
