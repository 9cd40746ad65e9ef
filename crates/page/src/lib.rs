//! One page that shows the quality of models: sentences, equations, tables and figures, from the common score and
//! rollout.

mod bode;
mod compared;
mod condition;
mod coverage;
mod drawn_stretch;
mod excitation;
mod fitting;
mod horizons;
mod intervals;
mod json;
mod judged;
mod leftover;
mod limits;
mod logs;
mod missing;
mod models;
mod opened;
mod passed;
mod plane;
mod regions;
mod residuals;
mod rolled_on;
mod scores;
mod sentence;
mod series;
mod starts;
mod target;
mod transitions;
mod verdict;

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

pub use bode::{bode, decibels, thinned};
use fitting::Fit;
use fleetfoot_data::Progress;
use fleetfoot_dataset::Logs;
use fleetfoot_dynamics::{PathOptions, controller::Controller};
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_output::{check_outputs, together, write_atomic};
use fleetfoot_recipe::Recipe;
use fleetfoot_report::{Page, Part, Section, Sentence, words::series as listed};
use judged::Judged;
use opened::Opened;
use passed::Passed;
use rolled_on::Wanted;
use serde_json::Value;

/// Options of a page beside its models and logs.
#[derive(Clone)]
#[non_exhaustive]
pub struct ReportOptions {
    /// The title; `None`: the names of the models.
    pub title: Option<String>,
    /// Steps of every simulation; `None`: 200, and at most a quarter of the longest episode.
    pub horizon: Option<usize>,
    /// Simulations of every model, evenly spread.
    pub starts: usize,
    /// Controller of the inputs in simulations; `None`: recorded inputs.
    pub controller: Option<Arc<dyn Controller>>,
    /// Two columns, or expressions over columns: the page shows on their plane where the best model errs, and where its regions change. `None`: the angles of a model
    /// that has two, else none.
    pub plane: Option<[String; 2]>,
    /// Scores of simulated paths.
    pub paths: PathOptions,
    /// Reports of fits, in the form of `--json`, each with the `hash` of its model.
    pub fits: Vec<Value>,
}

/// Format of written figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FigureFormat {
    /// Drawings, `.svg`.
    Svg,
    /// Their numbers, comma-separated values, `.csv`.
    Csv,
}

impl Default for ReportOptions {
    fn default() -> Self {
        Self {
            title: None,
            horizon: None,
            starts: 500,
            controller: None,
            plane: None,
            paths: PathOptions::default(),
            fits: Vec::new(),
        }
    }
}

/// A page, and notes about the data.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Report {
    /// The page.
    pub page: Page,
    /// Episodes scored.
    pub episodes: usize,
    /// Names of those that one of the models was trained on: scores on them are in-sample.
    pub in_sample: Vec<String>,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

/// Shows models, and their errors on logs. Without logs it shows the models alone.
///
/// The logs are opened once for models of the same columns. Their rows are read once a model to score it, once more for
/// the residuals of the best one, and at the starts of simulations. All figures are binned while reading: the page does
/// not grow with the rows.
///
/// # Errors
/// No model. Those of [`score`](fleetfoot_run::score) and [`rollout`](fleetfoot_run::rollout), except that a failure to
/// score or simulate is reported on the page.
pub fn report(
    models: &[(String, Model)],
    changes: &Recipe,
    logs: impl Into<Logs>,
    options: &ReportOptions,
    progress: &dyn Progress,
) -> Result<Report, Error> {
    let logs = logs.into();
    if models.is_empty() {
        return Err(Error::missing("there is no model to report on: name a model file (*.json)".into()));
    }
    if logs.is_statistic() {
        return Err(Error::needs_rows(
            "a report scores and simulates on the rows of logs, and a statistic has none: give logs".into(),
        ));
    }
    let fits = fitting::read(&options.fits)?;
    let first = &models[0].1;
    let mut opened = if logs.is_empty() { None } else { Some(Opened::new(first, changes, &logs, progress)?) };
    let mut seen = opened.as_ref().map(|opened| logs::Seen::of(first, changes, &opened.dataset)).transpose()?;
    let mut judged: Vec<Judged<'_>> = Vec::with_capacity(models.len());
    let reach = starts::reach(models);
    for (name, model) in models {
        opened = opened.map(|opened| opened.or_for(model, changes, &logs, progress)).transpose()?;
        let rows = opened.as_ref().map(|opened| (&logs, &opened.dataset));
        let stretch = judged.iter().find_map(|one| Some(&one.on_stretch.as_ref()?.stretch));
        let starts = judged.iter().find_map(|one| Some(one.starts.as_slice()).filter(|starts| !starts.is_empty()));
        let wanted = Wanted { stretch, several: models.len() > 1, reach, starts };
        let next = Judged::new(name, model, changes, rows, &wanted, options, progress)?;
        judged.push(next);
    }
    if let (Some(seen), Some(scored)) = (&mut seen, judged[0].scored()) {
        seen.learn(&scored.in_sample);
    }
    let best = best(&judged);
    let worst = best.scored().and_then(scores::worst);
    let (mut passed, mut maps) = (None, Vec::new());
    if let (Some(opened), Some(worst)) = (opened, worst) {
        let opened = opened.or_for(best.model, changes, &logs, progress)?;
        passed = Passed::over(best.model, &opened.dataset, worst.id, progress)?;
        if let Some(axes) = plane::axes(best.model, options.plane.as_ref()) {
            maps = plane::parts(best.model, &opened.dataset, &axes, progress)?;
        }
    }
    let mut sections = sections(&judged, seen.as_ref(), passed.as_ref().map(|passed| (best.model, passed)), &fits);
    sections.iter_mut().filter(|section| section.id == series::ID).for_each(|section| section.parts.append(&mut maps));
    let mut page = Page::new(title(models, options), lead(models, seen.as_ref()), sections);
    page.source = source(models);
    let mut notes: Vec<String> = seen.iter().flat_map(|seen| seen.notes.clone()).collect();
    let mut in_sample: Vec<String> = Vec::new();
    for scored in judged.iter().filter_map(Judged::scored) {
        notes.extend(scored.notes.iter().filter(|note| !notes.contains(note)).cloned().collect::<Vec<_>>());
        in_sample.extend(scored.in_sample.iter().filter(|name| !in_sample.contains(name)).cloned().collect::<Vec<_>>());
    }
    if let strangers @ 1.. = fitting::strangers(&judged, &fits) {
        notes.push(format!("reports of fits whose model is not on this page, by hash: {strangers}"));
    }
    let episodes = seen.as_ref().map_or(0, |seen| seen.episodes.len());
    Ok(Report { page, episodes, in_sample, notes })
}

/// The model with the least one-step error in the targets of all models, else at the end of simulations. Of several
/// models, the rows and logs of this one are shown.
fn best<'a, 'b>(judged: &'b [Judged<'a>]) -> &'b Judged<'a> {
    let shared = scores::shared(judged);
    let known = judged.iter().filter_map(|one| Some((one.mean_over_null(&shared)?, one)));
    let one_step = known.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, one)| one);
    let simulated = || judged.iter().find(|one| Some(one.name) == horizons::best_at_the_end(judged));
    one_step.or_else(simulated).unwrap_or(&judged[0])
}

fn sections(
    judged: &[Judged<'_>],
    seen: Option<&logs::Seen>,
    passed: Option<(&Model, &Passed)>,
    fits: &[Fit],
) -> Vec<Section> {
    let mut sections = vec![verdict::section(judged, passed.map(|(_, passed)| passed))];
    sections.extend(scores::section(judged));
    sections.extend(horizons::section(judged));
    if let (Some((model, passed)), Some(seen)) = (passed, seen) {
        sections.push(series::section(model, passed, seen));
    }
    sections.push(models::section(judged, fits));
    sections.extend(seen.map(|seen| seen.section(passed.map(|(_, passed)| passed))));
    sections
}

fn title(models: &[(String, Model)], options: &ReportOptions) -> String {
    options.title.clone().unwrap_or_else(|| match models {
        [(name, _)] => name.clone(),
        [(first, _), (second, _)] => format!("{first} and {second}"),
        several => format!("{} models", several.len()),
    })
}

fn lead(models: &[(String, Model)], seen: Option<&logs::Seen>) -> String {
    let outputs = models[0].1.outputs();
    let what = if outputs.is_empty() { "given equations".to_owned() } else { listed(&outputs, 8) };
    match seen {
        Some(seen) => format!("Models of {what}, held against {}.", seen.in_words()),
        None => format!("Models of {what}. No log was given, so nothing is scored here."),
    }
}

/// Versions and models that made the page.
fn source(models: &[(String, Model)]) -> Vec<String> {
    let one = |(name, model): &(String, Model)| {
        format!("{name}: model {}, fitted by fleetfoot {}.", model.hash(), model.training.version)
    };
    let made = format!("Made by fleetfoot {}.", env!("CARGO_PKG_VERSION"));
    std::iter::once(made).chain(models.iter().map(one)).collect()
}

impl Report {
    /// Sentences of the first section.
    pub fn findings(&self) -> impl Iterator<Item = &Sentence> {
        let parts = self.page.sections.first().into_iter().flat_map(|section| &section.parts);
        let findings = parts.filter_map(|part| match part {
            Part::Findings(findings) => Some(findings),
            _ => None,
        });
        findings.flatten()
    }

    /// Writes the page. `inputs` are files that must not be written over.
    ///
    /// # Errors
    /// The file cannot be written, or is one of the inputs.
    pub fn write(&self, path: &Path, inputs: &[PathBuf]) -> Result<(), Error> {
        check_outputs(std::slice::from_ref(&path.to_path_buf()), inputs)?;
        Ok(write_atomic(path, self.page.to_html().as_bytes())?)
    }

    /// Writes every figure into a folder, and gives the paths. `inputs` are files that must not be written over.
    ///
    /// # Errors
    /// A file cannot be written, or is one of the inputs.
    pub fn write_figures(
        &self,
        folder: &Path,
        format: FigureFormat,
        inputs: &[PathBuf],
    ) -> Result<Vec<PathBuf>, Error> {
        std::fs::create_dir_all(folder)
            .map_err(|source| fleetfoot_dataset::Error::Write { path: folder.to_owned(), source })?;
        let figures: Vec<_> = self.page.figures().collect();
        let suffix = if format == FigureFormat::Svg { "svg" } else { "csv" };
        let paths: Vec<PathBuf> =
            figures.iter().map(|figure| folder.join(format!("{}.{suffix}", figure.name))).collect();
        check_outputs(&paths, inputs)?;
        together(|| {
            figures.iter().zip(&paths).try_for_each(|(figure, path)| {
                let text = if format == FigureFormat::Svg { figure.to_svg() } else { figure.to_csv() };
                write_atomic(path, text.as_bytes())
            })
        })?;
        Ok(paths)
    }
}
