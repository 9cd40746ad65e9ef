//! `fleetfoot generate`.

use clap::{CommandFactory, error::ErrorKind};
use fleetfoot::{
    ControllerFile, Error,
    generate::{Excitation, Format, Generated, Job, Plan, RunReport, World, generate as run_job, plan},
    sim::End,
};

use super::{Context, write_out};
use crate::{
    args::{Cli, Generate, LogFormat, Speed},
    table::{bytes, count, number, ratio, seconds, table},
};

pub(crate) fn generate(arguments: &Generate, context: &Context) -> Result<(), Error> {
    let world = world(arguments)?;
    if arguments.print_world {
        write_out(&world.to_commented_toml());
        return Ok(());
    }
    let job = job(arguments, world);
    let bar = context.bar();
    if arguments.dry_run {
        let planned = plan(&job, &bar);
        bar.finish();
        let planned = planned?;
        context.print(&planned, || plan_text(&planned));
        return Ok(());
    }
    let made = run_job(&job, &bar);
    bar.finish();
    let made = made?;
    context.notes(&notes(&made));
    context.print(&made, || to_text(&made));
    let folder = job.folder.display();
    context.say(format!(
        "wrote {} and {} in {folder}; next: fleetfoot fit pwa -c {} {folder}",
        count(made.runs.len(), "run"),
        "robot.toml",
        made.recipe.display()
    ));
    Ok(())
}

/// A wrong use of the command, as the argument parser reports it: exit code 2.
fn usage(problem: impl std::fmt::Display) -> ! {
    Cli::command().error(ErrorKind::ArgumentConflict, problem).exit()
}

/// The robot's parameters: the world file's, with what the flags set.
fn world(arguments: &Generate) -> Result<World, Error> {
    let mut world = World::of(&arguments.robot)?;
    if let Some(path) = &arguments.world {
        world = world.read(path)?;
    }
    if let Some(kind) = &arguments.excitation {
        if !world.excitable() {
            usage(format!(
                "--excitation {kind}: only the controller drives `{}`, so it has no excitation; leave --excitation out",
                world.robot()
            ));
        }
        world.excite(kind)?;
    }
    for setting in &arguments.set {
        let Some((path, value)) = setting.split_once('=') else {
            usage(format!("--set {setting}: write KEY=VALUE, e.g. --set belt.speed=0.3"));
        };
        world.set(path.trim(), value.trim())?;
    }
    if let Some(path) = &arguments.controller {
        world.regulate(&ControllerFile::read(path)?.law)?;
    }
    Ok(world)
}

fn job(arguments: &Generate, world: World) -> Job {
    if arguments.speed.is_some() && world.speed_parameter().is_none() {
        usage(format!("--speed: the world of `{}` has no speed parameter; leave --speed out", world.robot()));
    }
    let Some(folder) = &arguments.output else { usage("give the folder of the logs: --output DIR") };
    let mut job = Job::new(world, folder);
    match arguments.format {
        Some(LogFormat::Mcap) => job.format = Format::Mcap,
        Some(LogFormat::Parquet) => job.format = Format::Parquet,
        None => {}
    }
    if arguments.no_truth && job.format == Format::Parquet {
        usage("--no-truth: Parquet files hold only the true states; give --format mcap");
    }
    job.runs = arguments.runs;
    job.first_run = arguments.first_run;
    job.seed = arguments.seed;
    job.truth = !arguments.no_truth;
    job.force = arguments.force;
    job.inputs.extend(arguments.world.iter().chain(&arguments.controller).cloned());
    job.speed = arguments.speed.map(|Speed(first, last)| (first, last));
    if let Some(minutes) = arguments.minutes {
        job.seconds = minutes * 60.0 / arguments.runs as f64;
    } else if let Some(seconds) = arguments.seconds {
        job.seconds = seconds;
    }
    job
}

/// Notes on the generated logs.
fn notes(made: &Generated) -> Vec<String> {
    let mut notes = made.notes.clone();
    if !made.excitation.dependent.is_empty() {
        let which = some(&made.excitation.dependent);
        notes.push(format!(
            "{which} never moved independently of the other inputs in any run, so no model can identify their effect"
        ));
    }
    notes
}

/// The first few of several names.
fn some(names: &[String]) -> String {
    let shown = names.iter().take(4).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > 4 { format!("{shown} and {} more", names.len() - 4) } else { shown }
}

fn determinant(excitation: &Excitation) -> String {
    if excitation.log_determinant.is_finite() {
        format!("{:.2}", excitation.log_determinant)
    } else {
        "singular".to_owned()
    }
}

/// Why runs ended in a fault, a line a run.
fn faults(made: &Generated) -> Vec<String> {
    let fault = |run: &RunReport| match &run.end {
        End::Fault { seconds, reason } => Some(format!("{} ended at {} s: {reason}", file_name(run), number(*seconds))),
        _ => None,
    };
    made.runs.iter().filter_map(fault).collect()
}

/// End of a run in one to three words; the text below the table explains faults.
fn ended(end: &End) -> String {
    match end {
        End::Fault { .. } => "fault".to_owned(),
        End::Early { reason, .. } => reason.clone(),
        _ => "complete".to_owned(),
    }
}

fn file_name(run: &RunReport) -> String {
    run.file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn to_text(made: &Generated) -> String {
    let faults = faults(made);
    let mut early = faults.iter().take(10).map(|line| format!("\n{line}")).collect::<String>();
    if faults.len() > 10 {
        early += &format!("\nand {} more runs", faults.len() - 10);
    }
    let spread = made.excitation.spread.iter();
    let spread: Vec<String> =
        spread.map(|(name, axis)| format!("{name} {}..{}", number(axis.low), number(axis.high))).collect();
    let uneven = if spread.is_empty() {
        String::new()
    } else {
        format!("\nuneven: visits to bins over {}; 0 is even, 1 is all in one bin", spread.join(" x "))
    };
    format!(
        "{}{early}\nln det: log-determinant of the Gram matrix, per row, of a constant and {} regressors in SI units; more is better \
         ({}){uneven}",
        runs_table(made),
        made.excitation.regressors.len(),
        made.excitation.regressors.join(", ")
    )
}

/// A line a run, and all together; without what no run has.
fn runs_table(made: &Generated) -> String {
    let sum = |value: fn(&RunReport) -> u64| made.runs.iter().map(value).sum::<u64>();
    let speeds = made.runs.iter().any(|run| run.speed.is_some());
    let messages = sum(|run| run.messages) > 0;
    let shown = |name: &&str| (*name != "speed" || speeds) && (*name != "messages" || messages);
    let header = ["run", "speed", "seconds", "rows", "messages", "size", "ln det", "uneven", "end"];
    let line = |cells: [String; 9]| header.iter().zip(cells).filter(|(name, _)| shown(name)).map(|(_, c)| c).collect();
    let of_run = |run: &RunReport| {
        line([
            file_name(run),
            run.speed.map_or("-".into(), number),
            number(run.seconds),
            run.rows.to_string(),
            run.messages.to_string(),
            bytes(run.bytes),
            determinant(&run.excitation),
            ratio(run.excitation.nonuniformity),
            ended(&run.end),
        ])
    };
    let mut rows: Vec<Vec<String>> = made.runs.iter().map(of_run).collect();
    rows.push(line([
        "all".to_owned(),
        String::new(),
        number(made.runs.iter().map(|run| run.seconds).sum()),
        sum(|run| run.rows).to_string(),
        sum(|run| run.messages).to_string(),
        bytes(sum(|run| run.bytes)),
        determinant(&made.excitation),
        ratio(made.excitation.nonuniformity),
        String::new(),
    ]));
    table(&header.into_iter().filter(shown).collect::<Vec<_>>(), rows)
}

fn plan_text(plan: &Plan) -> String {
    let mut out = format!(
        "{} of {}: at most {} rows of {} columns",
        count(plan.runs as usize, "run"),
        seconds(plan.seconds),
        plan.rows,
        plan.columns.len()
    );
    if !plan.topics.is_empty() {
        out += &format!(", about {} messages on {}", plan.messages, count(plan.topics.len(), "topic"));
    }
    out += &format!("\nabout {} of files, judged by a run of {}", bytes(plan.bytes), seconds(plan.sampled_seconds));
    if plan.replaced > 0 {
        out += &format!("\n{} of an earlier command would be replaced", count(plan.replaced, "file"));
    }
    let topics = plan.topics.iter().map(|topic| vec![topic.name.clone(), topic.message_type.to_owned()]).collect();
    if !plan.topics.is_empty() {
        out += &format!("\n{}", table(&["topic", "type"], topics));
    }
    let columns = plan.columns.iter().map(|column| match &column.unit {
        Some(unit) if unit != "1" => format!("{} ({unit})", column.name),
        _ => column.name.clone(),
    });
    out + &format!("\ncolumns of truth: {}", columns.collect::<Vec<_>>().join(", "))
}
