//! The log of a positioning stage with dry friction, and what `auto` finds in it: its equations, how far they simulate, and their C code.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use fleetfoot::{
    Auto, AutoOutput, Error, Logs, Model, Recipe, RolledOut, auto,
    dynamics::{RolloutOptions, Starts, Trajectory},
    generate::{Job, World, generate},
    library::Expr,
    log::shell_word,
    model::Prediction,
    output::write_atomic,
    read_rows, rollout,
    sim::plant::stage::Stage,
    useful_in_words,
};
use serde::Serialize;
use serde_json::Value;

use crate::{
    args,
    commands::{Context, auto as auto_command, check as check_command},
    curve::Curves,
    table::{count, number, seconds},
};

/// Two runs: one to fit, and one of other strokes that neither fits nor choices see.
const RUNS: u64 = 2;
const SECONDS: f64 = 20.0;
const LOGS: [&str; 2] = ["log/stage_00.mcap", "log/stage_01.mcap"];
/// Recipe that a user would write: the measured topics, and the position as the integral of the speed.
const RECIPE: &str =
    "# The log's fields under short names, what the model advances in time, and what is given from outside.
[columns]
q = \"/stage/joint_states.position[carriage]\"
qd = \"/stage/joint_states.velocity[carriage]\"

[states]
q = { known = \"qd\", regressor = false, unit = \"m\" }
qd = { unit = \"m/s\" }

[inputs]
u = { column = \"/stage/voltage.data\", unit = \"V\" }
";
const RECIPE_FILE: &str = "stage.toml";
const FOLDER: &str = "model";
/// Simulations of the other run: seconds of each, and how many.
const HORIZON: f64 = 2.0;
const STARTS: usize = 200;
/// Candidates that the screen shows beside the chosen one.
const CANDIDATES: usize = 6;

/// JSON report of the demo.
#[derive(Serialize)]
struct DemoReport {
    folder: String,
    auto: Value,
    rollouts: Value,
    code: Code,
}

/// Result of compiling and running the exported code.
#[derive(Serialize)]
struct Code {
    /// True if the compiled code gives the model's values; `None` without a C compiler.
    agrees: Option<bool>,
    files: Vec<String>,
}

pub(super) fn demo(arguments: &args::Demo, context: &Context) -> Result<(), Error> {
    let demo = Demo { context, folder: &arguments.output };
    demo.log(arguments.seed)?;
    let recipe = demo.recipe()?;
    demo.check(&recipe)?;
    let outcome = demo.auto(&recipe)?;
    let rolled = demo.rollout(&outcome.model, &recipe)?;
    let code = demo.code()?;
    demo.page();
    if context.json {
        let folder = demo.folder.display().to_string();
        context.print(DemoReport { folder, auto: outcome.to_json(), rollouts: rolled.to_json(), code }, String::new);
    }
    Ok(())
}

struct Demo<'a> {
    context: &'a Context,
    folder: &'a Path,
}

impl Demo<'_> {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// A file of the demonstration as a word of a command.
    fn word(&self, name: &str) -> String {
        shell_word(&self.path(name).display().to_string())
    }

    /// A command that repeats what follows, to be pasted.
    fn command(&self, words: &str) {
        self.context.say(format!("\n$ {} {words}", shell_word(&self.context.program)));
    }

    fn tell(&self, text: &str) {
        if !self.context.json {
            crate::commands::write_out(&format!("{}\n", text.trim_end()));
        }
    }

    fn log(&self, seed: u64) -> Result<(), Error> {
        self.command(&format!(
            "generate stage --seed {seed} --runs {RUNS} --seconds {SECONDS} -o {} --force",
            self.word("log")
        ));
        let mut job = Job::new(World::of("stage")?, self.path("log"));
        (job.runs, job.seconds, job.seed, job.force) = (RUNS, SECONDS, seed, true);
        let bar = self.context.bar();
        let made = generate(&job, &bar);
        bar.finish();
        let bytes = made?.runs.iter().map(|run| run.bytes).sum();
        self.tell(&format!(
            "a carriage on a rail with dry friction, driven by a motor: {RUNS} runs of {SECONDS} s at 200 Hz as MCAP, {}; the first is fitted",
            crate::table::bytes(bytes)
        ));
        Ok(())
    }

    fn recipe(&self) -> Result<Recipe, Error> {
        let path = self.path(RECIPE_FILE);
        self.context.say(format!("\nwrote {}:", path.display()));
        self.tell(RECIPE);
        write_atomic(&path, RECIPE.as_bytes())?;
        Ok(Recipe::read(&path)?)
    }

    fn check(&self, recipe: &Recipe) -> Result<(), Error> {
        self.command(&format!("check -c {} {}", self.word(RECIPE_FILE), self.word(LOGS[0])));
        let bar = self.context.bar();
        let checked = fleetfoot::check(recipe, Logs::from([self.path(LOGS[0])].as_slice()), &bar);
        bar.finish();
        self.tell(&check_command::to_text(&checked?));
        Ok(())
    }

    fn auto(&self, recipe: &Recipe) -> Result<Auto, Error> {
        let files = vec![self.path(LOGS[0])];
        self.command(&format!(
            "auto -c {} {} --export c -o {} --force",
            self.word(RECIPE_FILE),
            self.word(LOGS[0]),
            self.word(FOLDER)
        ));
        let output = AutoOutput { folder: self.path(FOLDER), force: true, c: true };
        output.check(&files)?;
        let logs = Logs::from(files.as_slice());
        let bar = self.context.bar();
        let outcome = auto(recipe, &logs, &bar);
        bar.finish();
        let outcome = outcome?;
        outcome.write(&output, &logs, &fleetfoot::Silent)?;
        self.context.notes(&outcome.notes);
        self.tell(&auto_command::to_text(&outcome, CANDIDATES));
        if let Some(words) = machine(&outcome.model) {
            self.tell(&format!("\n{words}"));
        }
        Ok(outcome)
    }

    /// Simulations of the run that was not fitted, and one of them beside what was measured.
    fn rollout(&self, model: &Model, recipe: &Recipe) -> Result<RolledOut, Error> {
        let steps = (HORIZON / model.step).round() as usize;
        self.command(&format!(
            "rollout {} {} --horizon {steps} --starts {STARTS}",
            self.word("model/model.json"),
            self.word(LOGS[1])
        ));
        let logs = || Logs::from([self.path(LOGS[1])].as_slice());
        let (changes, starts) = (Recipe::default(), Starts::Even(STARTS));
        let mut options = RolloutOptions::new(steps);
        options.keep = true;
        let bar = self.context.bar();
        let rolled = rollout(model, &changes, logs(), &starts, &options, None, None, &bar);
        bar.finish();
        let rolled = rolled?;
        let names = ["q".to_owned()];
        let rows = read_rows(recipe, Some(&names), logs(), &fleetfoot::Silent)?;
        let measured = rows.columns.first().map_or(&[][..], |(_, values)| values);
        let at = |time: f64| rows.seconds.partition_point(|&second| second < time - 1e-9);
        // The one whose carriage goes farthest.
        let way = |trajectory: &Trajectory| {
            let (low, high) = (0..=trajectory.steps()).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), step| {
                (low.min(trajectory.state(step)[0]), high.max(trajectory.state(step)[0]))
            });
            high - low
        };
        let drawn = rolled.rollouts.trajectories.iter().max_by(|a, b| way(a).total_cmp(&way(b)));
        if let Some(trajectory) = drawn {
            let begin = trajectory.start.row as f64 * model.step;
            let simulated: Vec<f64> = (0..=trajectory.steps()).map(|step| 1e3 * trajectory.state(step)[0]).collect();
            let recorded =
                trajectory.time.iter().map(|time| measured.get(at(begin + time)).map_or(f64::NAN, |q| 1e3 * q));
            let curves = Curves {
                title: "position of the carriage, mm: measured (.) and simulated from its first value (o), in a run that was not fitted",
                measured: recorded.collect(),
                simulated,
                below: format!("0 to {} s", number(trajectory.time.last().copied().unwrap_or(0.0))),
            };
            self.tell(&format!("\n{}", curves.text()));
        }
        let horizon = &rolled.rollouts.horizon;
        let last = horizon.model.rmse.len() - horizon.states.len();
        self.tell(&format!(
            "\n{} of {}: the position is off by {:.3} mm after {} (root of the mean square)\n{}",
            count(rolled.rollouts.outcomes.len(), "simulation"),
            seconds(HORIZON),
            1e3 * horizon.model.rmse[last],
            seconds(HORIZON),
            useful_in_words(horizon)
        ));
        Ok(rolled)
    }

    /// Compiles the exported code with its test, where there is a compiler.
    fn code(&self) -> Result<Code, Error> {
        let folder = self.path("model/c");
        let files = ["model.c", "model.h", "model_test.c"].map(|name| format!("model/c/{name}")).to_vec();
        let program = self.path("model_test");
        let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".into());
        self.context.say(format!(
            "\n$ {compiler} -std=c99 -O2 -o {program} {test} {code} -lm && {program}",
            program = self.word("model_test"),
            test = self.word("model/c/model_test.c"),
            code = self.word("model/c/model.c")
        ));
        let compiled = Command::new(&compiler)
            .args(["-std=c99", "-O2", "-o"])
            .args([&program, &folder.join("model_test.c"), &folder.join("model.c")])
            .arg("-lm")
            .output();
        let agrees = match compiled {
            Err(_) => None,
            Ok(made) => {
                let whole = fs::canonicalize(&program).unwrap_or_else(|_| program.clone());
                Some(made.status.success() && Command::new(whole).output().is_ok_and(|ran| ran.status.success()))
            }
        };
        self.tell(match agrees {
            None => "no C compiler here: the code and its test are in the folder model/c",
            Some(true) => {
                "the C code has the model's values at 32 points: two files without a library, for a microcontroller"
            }
            Some(false) => "the C code and the model differ: see model/c/model_test.c",
        });
        match agrees {
            Some(false) => Err(Error::output(format!("{}: the exported code fails its test", folder.display()))),
            _ => Ok(Code { agrees, files }),
        }
    }

    fn page(&self) {
        self.context.say(format!(
            "\nthe result on one page: {}\nmore: fleetfoot show {}; fleetfoot auto YOUR_LOG -o model",
            self.path("model/report.html").display(),
            self.word("model/model.json")
        ));
    }
}

/// The machine that the equations of the two largest regions describe, beside the one that was simulated; nothing where the model is of another kind.
fn machine(model: &Model) -> Option<String> {
    let truth = Stage::default();
    let equation = model.equations.iter().find(|equation| equation.subject == "qd")?;
    let seconds = match equation.prediction {
        Prediction::Difference => model.step,
        Prediction::Derivative => 1.0,
        _ => return None,
    };
    let latent = model.latents.iter().find(|latent| Expr::column(&*latent.name) == equation.right)?;
    let (map, u) = (latent.affine()?, Expr::column("u"));
    let at = model.libraries.get(latent.library)?.iter().position(|function| *function == u)?;
    let &[first, second, ..] = model.summaries.get(latent.partition)?.by_size().as_slice() else { return None };
    let gain = |region: usize| map.coefficients[region][at] / seconds;
    let mass = |region: usize| truth.gain / gain(region);
    let force = |region: usize| map.constants[region] / seconds * mass(region);
    Some(format!(
        "With the motor's {} N/V these are a mass of {:.1} and {:.1} kg (simulated with {}), and a dry friction of {:.1} N (simulated with {}).",
        truth.gain,
        mass(first),
        mass(second),
        truth.mass,
        0.5 * (force(first) - force(second)).abs(),
        truth.dry
    ))
}
