//! `fleetfoot demo --paper`: from a simulated robot's logs to models, and what they are worth: Table I and Figures 5, 8 and 9 of Buchan, Haldane, Fearing,
//! "Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot".

use std::path::{Path, PathBuf};

use fleetfoot::{
    Error, FitReport, FitRequest, Model, Projected, Pwa, Recipe, Report, ReportOptions,
    demo::{DemoLogs, differential_drive, gaits, generate_logs},
    dynamics::{RolloutOptions, Starts},
    fit,
    generate::RunReport,
    log::{Cache, shell_word},
    pwa::Specification,
    rival_file, write_model,
};
use serde::Serialize;
use serde_json::{Map, Value};

use super::{
    gait,
    horizons::{self, Curve},
    table_one,
};
use crate::{
    args,
    commands::{
        Context, plane,
        report::{OnPage, named},
        tree, write_out,
    },
};

/// The models of Table I. A ball of 1.5 standard deviations is nearly empty in as many dimensions as the partition has, whose mean square distance
/// from the centre is their number; one of 4 is about half full.
const PARTITIONS: &str = "null,average,zbox:1.5,kmeans:10,kmeans:50";
/// The file of the one that cross-validation chooses.
const MODEL: &str = "model.json";
/// The finest of them.
const FINEST: &str = "kmeans:50";
/// Seconds around a held-out span that do not train: strides repeat.
const PURGE: f64 = 0.1;
/// Fig. 8: steps of 1 ms, and starts; fewer where the runs are short, as simulations that overlap more than these tell little more.
const HORIZON: usize = 200;
const STARTS: u64 = 1000;
const ROWS_PER_START: u64 = 40;
/// The page, and the models on it: the null model is the baseline that all are compared with.
const PAGE: &str = "report.html";
const REPORTED: [&str; 3] = ["average", "kmeans:10", "kmeans:50"];
/// The page of the differential drive (Fig. 9a).
const DRIVE_PAGE: &str = "drive.html";
/// Fig. 9: the plane, and cells along each axis.
const PLANE: [&str; 2] = ["alpha_l", "alpha_r"];
const BINS: usize = 36;

pub(super) fn demo(arguments: &args::Demo, context: &Context) -> Result<(), Error> {
    if !(arguments.minutes > 0.0 && arguments.minutes.is_finite()) {
        return Err(Error::value(format!("--minutes {}: write minutes above 0", arguments.minutes)));
    }
    let mut demo = Demo { context, folder: arguments.output.clone(), seed: arguments.seed, results: Map::new() };
    let logs = demo.logs(arguments.minutes)?;
    demo.gait(&logs)?;
    demo.fit(&logs)?;
    demo.horizons(&logs)?;
    demo.planes(&logs)?;
    demo.report(&logs)?;
    demo.files();
    if context.json {
        write_out(&format!("{:#}\n", Value::Object(demo.results)));
    }
    Ok(())
}

struct Demo<'a> {
    context: &'a Context,
    folder: PathBuf,
    seed: u64,
    results: Map<String, Value>,
}

/// The logs that were simulated.
#[derive(Serialize)]
struct Simulated {
    runs: usize,
    rows: u64,
    seconds: f64,
    bytes: u64,
    faults: usize,
    training_runs: usize,
    held_out_runs: usize,
}

impl Demo<'_> {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn model(&self) -> PathBuf {
        self.path(MODEL)
    }

    /// A command that repeats what follows, to be pasted.
    fn command(&self, words: &[String]) {
        self.context.say(format!("\n$ {} {}", shell_word(&self.context.program), words.join(" ")));
    }

    /// A file of the demonstration as a word of a command.
    fn word(&self, name: &str) -> String {
        shell_word(&self.path(name).display().to_string())
    }

    /// Logs as a word of a command: their folder if all of it was used, else the files.
    fn data(&self, folder: &str, runs: &[RunReport], files: &[PathBuf]) -> String {
        if runs.len() == files.len() {
            return self.word(folder);
        }
        files.iter().map(|file| shell_word(&file.display().to_string())).collect::<Vec<_>>().join(" ")
    }

    fn training_data(&self, logs: &DemoLogs) -> String {
        self.data("train", &logs.training.runs, &logs.training_files())
    }

    fn tell(&mut self, key: &str, report: impl Serialize, text: impl FnOnce() -> String) {
        if self.context.json {
            self.results.insert(key.to_owned(), tree(report));
        } else {
            write_out(&format!("{}\n", text().trim_end()));
        }
    }

    fn cached(&self, mut recipe: Recipe) -> Recipe {
        recipe.cache = Some(Cache { folder: self.path(".fleetfoot-cache"), least_bytes: 64 << 20 });
        recipe
    }

    fn logs(&mut self, minutes: f64) -> Result<DemoLogs, Error> {
        let page = self.path(PAGE);
        self.context.say(format!("the result will be one page, {}", page.display()));
        self.context.say(format!("simulating {minutes} minutes of a hexapod on a treadmill"));
        let bar = self.context.bar();
        let logs = generate_logs(&self.folder, self.seed, minutes, &bar);
        bar.finish();
        let logs = logs?;
        for (held_out, folder) in [(false, "train"), (true, "test")] {
            self.command(&words(&["generate", &logs.arguments(held_out), "-o", &self.word(folder), "--force"]));
        }
        let runs = || logs.training.runs.iter().chain(&logs.held_out.runs);
        let faults = runs().filter(|run| run.end != fleetfoot::sim::End::Complete).count();
        let (rows, bytes) = (runs().map(|run| run.rows).sum(), runs().map(|run| run.bytes).sum());
        let seconds = runs().map(|run| run.seconds).sum();
        let simulated = Simulated {
            runs: runs().count(),
            rows,
            seconds,
            bytes,
            faults,
            training_runs: logs.training.runs.len(),
            held_out_runs: logs.held_out.runs.len(),
        };
        self.tell("logs", simulated, || {
            format!(
                "{} runs to fit on and {} to score on: {} of running, {rows} rows of 1 ms, {} of MCAP; {faults} ended early, off the belt",
                logs.training.runs.len(),
                logs.held_out.runs.len(),
                crate::table::seconds(seconds),
                crate::table::bytes(bytes)
            )
        });
        Ok(logs)
    }

    fn gait(&mut self, logs: &DemoLogs) -> Result<(), Error> {
        let recipe = self.cached(Recipe::read(&logs.training.recipe)?);
        let bar = self.context.bar();
        let gait_list = gaits(&recipe, &logs.drive, &logs.training_files(), &bar);
        bar.finish();
        let gait_list = gait_list?;
        self.context.say("");
        self.tell("gait", gait::GaitReport::new(&gait_list), || gait::to_text(&gait_list));
        Ok(())
    }

    /// Fits all models at once.
    fn fit(&mut self, logs: &DemoLogs) -> Result<(), Error> {
        let mut recipe = self.cached(Recipe::read(&logs.training.recipe)?);
        recipe.model.partition = Some(PARTITIONS.to_owned());
        recipe.pwa.purge = Some(PURGE);
        let (recipe_file, path) = (shell_word(&logs.training.recipe.display().to_string()), self.model());
        let (data, output) = (self.training_data(logs), self.word(MODEL));
        let purge = PURGE.to_string();
        let flags = ["--partition", PARTITIONS, "--purge", &purge, "--keep-all", "-o", &output];
        self.command(&words(&[&["fit", "pwa", "-c", &recipe_file, &data], &flags[..]].concat()));
        let bar = self.context.bar();
        let request = FitRequest { rivals: true, ..FitRequest::default() };
        let fitted = fit::<Pwa>(&recipe, &request, &logs.training_files(), &bar);
        bar.finish();
        let fitted = fitted?;
        fitted.write(&path)?;
        let report = &fitted.report;
        self.context.notes(&report.summary().notes);
        self.tell("table_1", table_one::TableReport::from(report), || {
            format!("{}\n\n{}", table_one::to_text(report), table_one::paper())
        });
        Ok(())
    }

    /// Simulates every model from states of runs that did not train, with the treadmill's controller around it and with the recorded inputs.
    fn horizons(&mut self, logs: &DemoLogs) -> Result<(), Error> {
        let files = logs.held_out_files();
        let changes = self.cached(Recipe::default());
        let data = self.data("test", &logs.held_out.runs, &files);
        let starts = starts(logs);
        for (key, name, closed) in
            [("figure_8", "closed loop", true), ("figure_8_open_loop", "open loop (recorded inputs)", false)]
        {
            let controller = if closed { Some(fleetfoot::controller("treadmill", &[])?) } else { None };
            let mut curves = Vec::new();
            for (model, path) in self.models()? {
                if model == FINEST {
                    let model = shell_word(&path.display().to_string());
                    let (horizon, starts) = (HORIZON.to_string(), starts.to_string());
                    let flags: &[&str] = &["rollout", &model, &data, "--horizon", &horizon, "--starts", &starts];
                    let closing: &[&str] = if closed { &["--controller", "treadmill"] } else { &[] };
                    self.command(&words(&[flags, closing].concat()));
                }
                let bar = self.context.bar();
                let rolled = fleetfoot::rollout(
                    &Model::read(&path)?,
                    &changes,
                    &files,
                    &Starts::Even(starts),
                    &RolloutOptions::new(HORIZON),
                    controller.as_ref(),
                    None,
                    &bar,
                );
                bar.finish();
                curves.push(Curve { model, rolled: rolled? });
            }
            self.tell(key, horizons::HorizonReport::new(&curves), || horizons::to_text(&curves, name));
        }
        Ok(())
    }

    /// Names and files of the models of Table I.
    fn models(&self) -> Result<Vec<(String, PathBuf)>, Error> {
        let path = self.model();
        let list = Specification::parse_list(PARTITIONS)?;
        Ok(list
            .iter()
            .map(|specification| (specification.to_string(), rival_file(&path, &specification.to_string())))
            .collect())
    }

    /// Fig. 9: the plane of the cranks.
    fn planes(&mut self, logs: &DemoLogs) -> Result<(), Error> {
        let files = logs.training_files();
        let recipe = self.cached(Recipe::read(&logs.training.recipe)?);
        let bar = self.context.bar();
        let drive = differential_drive(&recipe, &logs.drive, &files, &bar);
        bar.finish();
        let drive_path = self.path("differential_drive.json");
        write_model(&drive?, &drive_path)?;
        let projected = self.plane(&drive_path, "plane_drive.parquet", logs)?;
        let [drive_page, page] = [DRIVE_PAGE, PAGE].map(|name| self.path(name));
        self.tell("figure_9a", plane::PlaneReport::from(&projected), || {
            format!(
                "Fig. 9a. Differential drive (equation (2)): mean Mahalanobis score of forward speed and yaw rate {:.2}; map over the cranks: {}",
                projected.plane.total().mean_score(),
                drive_page.display()
            )
        });
        self.page(&[drive_path], (&self.training_data(logs), &files), DRIVE_PAGE, None)?;
        let finest = self.models()?.into_iter().find(|(name, _)| name == FINEST).map(|(_, path)| path);
        let projected = self.plane(&finest.unwrap_or_else(|| self.model()), "plane_transitions.parquet", logs)?;
        self.tell("figure_9b", plane::PlaneReport::from(&projected), || {
            format!(
                "Fig. 9b. {FINEST}: the region changes in {:.1} % of the passages through cells of the plane of the cranks; map: {}",
                100.0 * projected.plane.total().transition_ratio(),
                page.display()
            )
        });
        Ok(())
    }

    fn plane(&self, model: &Path, output: &str, logs: &DemoLogs) -> Result<Projected, Error> {
        let (file, data, bins) = (shell_word(&model.display().to_string()), self.training_data(logs), BINS.to_string());
        let flags = ["--plane", &PLANE.join(","), "--bins", &bins, "-o", &self.word(output)];
        self.command(&words(&[&["score", &file, &data], &flags[..]].concat()));
        let (model, changes, axes) = (Model::read(model)?, self.cached(Recipe::default()), PLANE.map(str::to_owned));
        let output = self.path(output);
        let bar = self.context.bar();
        let files = logs.training_files();
        let projected = fleetfoot::project(&model, &changes, &files, &axes, BINS, Some(&output), &bar);
        bar.finish();
        projected
    }

    /// The page that shows the models on the runs that did not train them.
    fn report(&mut self, logs: &DemoLogs) -> Result<(), Error> {
        let models = self.models()?.into_iter().filter(|(name, _)| REPORTED.contains(&name.as_str()));
        let paths: Vec<PathBuf> = models.map(|(_, path)| path).collect();
        let data = self.data("test", &logs.held_out.runs, &logs.held_out_files());
        let made = self.page(&paths, (&data, &logs.held_out_files()), PAGE, Some(starts(logs)))?;
        let page = self.path(PAGE);
        self.tell("report", OnPage::new(&made, &page), || format!("The result on one page: {}", page.display()));
        Ok(())
    }

    /// A page of models on logs (as words of a command, and their files), with their plane; `starts`: simulations
    /// under the treadmill's controller.
    fn page(
        &self,
        models: &[PathBuf],
        (data, files): (&str, &[PathBuf]),
        name: &str,
        starts: Option<usize>,
    ) -> Result<Report, Error> {
        let mut options = ReportOptions::default();
        options.plane = Some(PLANE.map(str::to_owned));
        let mut flags = format!("--plane {}", PLANE.join(","));
        if let Some(starts) = starts {
            options.horizon = Some(HORIZON);
            options.starts = starts;
            options.controller = Some(fleetfoot::controller("treadmill", &[])?);
            flags += &format!(" --horizon {HORIZON} --starts {starts} --controller treadmill");
        }
        let models_text: Vec<String> = models.iter().map(|path| shell_word(&path.display().to_string())).collect();
        self.command(&words(&["report", &models_text.join(" "), data, &flags, "-o", &self.word(name)]));
        let bar = self.context.bar();
        let made = fleetfoot::report(&named(models)?, &self.cached(Recipe::default()), files, &options, &bar);
        bar.finish();
        let made = made?;
        made.write(&self.path(name), files)?;
        Ok(made)
    }

    fn files(&mut self) {
        let folder = shell_word(&self.folder.display().to_string());
        self.command(&words(&["show", &self.word(MODEL)]));
        self.context.say(format!(
            "\nin {folder}: report.html, drive.html, train/ and test/ (logs, robot.toml), model.json and the rivals model_*.json, differential_drive.json, plane_*.parquet"
        ));
        if self.context.json {
            self.results.insert("folder".into(), self.folder.display().to_string().into());
        }
    }
}

/// Simulations: no more than tell something.
fn starts(logs: &DemoLogs) -> usize {
    let rows: u64 = logs.held_out.runs.iter().map(|run| run.rows).sum();
    (rows / ROWS_PER_START).clamp(1, STARTS) as usize
}

fn words(words: &[&str]) -> Vec<String> {
    words.iter().map(|&word| word.to_owned()).collect()
}
