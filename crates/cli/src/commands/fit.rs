//! `fleetfoot fit pwa`.

use fleetfoot::{
    BoundedCandidate, Derivative, Error, Fitted, Gap, Input, InputTable, Kind, Objective, PwaOptions, PwaRequest,
    Recipe, Refinement, RolloutCandidate, RolloutChoice, fit_pwa, is_known, is_statistic,
    log::{Cache, Stamp},
    output::together,
    pwa::Score,
    rival, write_model,
};
use serde::Serialize;
use serde_json::Value;

use super::{Context, fit_known, is_replaced, logs_or_statistic, read_by, reading::reading};
use crate::{
    args::{ChannelArgs, FitPwa, RecipeArgs, StampArg, TimeArgs},
    table::{bytes, count, number, ratio, table, text_table},
};

pub(crate) fn pwa(arguments: &FitPwa, context: &Context) -> Result<(), Error> {
    let mut recipe = recipe(&arguments.recipe)?;
    if let Some(partition) = &arguments.partition {
        recipe.model.partition = Some(partition.clone());
    }
    if let Some(on) = &arguments.partition_on {
        recipe.model.partition_on = Some(on.0.clone());
    }
    recipe.say(arguments.pwa.clone());
    recipe.cache = cache(&arguments.recipe.time.channels, &arguments.output);
    let files = logs_or_statistic(&arguments.data)?;
    context.claim(&outputs(arguments, &recipe)?, &read_by(&files, &arguments.recipe.recipe), false)?;
    if is_known(&recipe) && !arguments.dry_run && !is_statistic(&files) {
        return fit_known::known(&recipe, &files, &arguments.output, context);
    }
    if arguments.dry_run {
        return dry_run(&recipe, &files, context);
    }
    say_passes(
        recipe.pwa.objective,
        (fleetfoot::PWA_PASSES, recipe.pwa.stable.is_some() || recipe.pwa.passive.is_some()),
        context,
    );
    let bar = context.bar();
    let fitted = fit_pwa(&recipe, PwaRequest { keep_all: arguments.keep_all }, &files, &bar);
    bar.finish();
    let fitted = fitted?;
    let rivals = together(|| {
        write_model(&fitted.identification.model, &arguments.output)?;
        fitted.write_rivals(&arguments.output)
    })?;
    context.notes(&fitted.notes);
    let told = Told { fitted: fitted.to_json(), model: arguments.output.display().to_string() };
    context.print(told, || to_text(&fitted));
    if recipe.model.partition.is_none() && fitted.identification.candidates.len() > 1 {
        context.say(
            "regions of k-means were tried; --partition refined:2,5,10 looks for regions that fit the dynamics, which takes several times as long",
        );
    }
    for path in std::iter::once(&arguments.output).chain(&rivals) {
        context.say(format!("wrote {}", path.display()));
    }
    Ok(())
}

/// The model's file, and those of its rivals.
fn outputs(arguments: &FitPwa, recipe: &Recipe) -> Result<Vec<std::path::PathBuf>, Error> {
    let mut outputs = vec![arguments.output.clone()];
    if arguments.keep_all {
        let tried = PwaOptions::new(recipe)?.identification.partitions;
        outputs.extend(tried.iter().map(|own| rival(&arguments.output, own)));
    }
    Ok(outputs)
}

/// Steps of the rollouts that choose open spans; refused where none is open.
pub(crate) fn horizon(recipe: &Recipe, steps: Option<u32>) -> Result<Option<usize>, Error> {
    let open = recipe.states.values().any(|state| state.derivative.as_ref().is_some_and(Derivative::is_open));
    match steps {
        Some(steps) if !open => Err(Error::conflict(format!(
            "--horizon {steps}: nothing is chosen by rollouts; add --derivative STATE=over:auto, or leave it away"
        ))),
        _ => Ok(steps.map(|steps| steps as usize)),
    }
}

fn dry_run(recipe: &Recipe, files: &[std::path::PathBuf], context: &Context) -> Result<(), Error> {
    let bar = context.bar();
    let plan = fleetfoot::plan_pwa(recipe, files, &bar);
    bar.finish();
    let plan = plan?;
    context.notes(&plan.notes);
    context.expect(plan.work);
    let clustered = if plan.clustered_rows == 0 {
        "none".to_owned()
    } else if plan.clustered_rows < plan.reading.rows {
        format!("a sample of {} rows", plan.clustered_rows)
    } else {
        "all rows".to_owned()
    };
    let passes = plan.passes;
    let rollouts = plan.rollouts.map_or_else(String::new, |rule| {
        let candidates = plan.spans * plan.partitions;
        let (folds, starts, horizon) = (rule.folds, rule.starts, rule.horizon);
        let of_choice = plan.choice_passes;
        format!("; of them {of_choice} for the choice, with {candidates} x {folds} x {starts} rollouts of {horizon} steps at most")
    });
    let simulations = fleetfoot::simulation_cost(plan.objective, plan.fit_passes, plan.bounded)
        .map_or_else(String::new, |words| format!("\n{words}"));
    context.print(
        &plan,
        || {
            format!(
                "{}\n{} regressors and the constant, {} targets\n{passes} passes over the rows{rollouts}; clustered: {clustered}{simulations}\nabout {} of memory",
                reading(&plan.reading, 0),
                plan.regressors,
                plan.targets,
                bytes(plan.memory as u64)
            )
        },
    );
    Ok(())
}

pub(crate) fn to_text(fitted: &Fitted) -> String {
    let found = &fitted.identification;
    let mut header = vec!["partition", "regions", "coefficients"];
    header.extend(found.targets.iter().map(String::as_str));
    header.extend(["Mahalanobis", "loss"]);
    let continuous = found.candidates.iter().any(|score| score.continuity.is_some());
    header.extend(continuous.then_some("loss apart"));
    header.push("");
    // What sums do not know.
    let quadratic = found.candidates.iter().all(|score| score.over_null.iter().all(|value| value.is_nan()));
    let mut rows: Vec<Vec<String>> = found
        .candidates
        .iter()
        .enumerate()
        .map(|(index, score)| {
            let mut row =
                vec![score.specification.to_string(), score.regions.to_string(), score.coefficients.to_string()];
            row.extend(if quadratic { &score.r2 } else { &score.over_null }.iter().map(|&value| ratio(value)));
            row.push(if quadratic { "-".into() } else { ratio(score.mahalanobis) });
            row.push(if score.loss.is_nan() {
                "-".into()
            } else {
                format!("{} +- {}", ratio(score.loss), ratio(score.standard_error))
            });
            if continuous {
                row.push(score.continuity.map_or_else(|| "-".into(), |own| ratio(own.apart)));
            }
            let marks = [(index == found.chosen, "<- chosen"), (score.front && found.candidates.len() > 1, "front")];
            row.push(marks.iter().filter(|(is, _)| *is).map(|(_, mark)| *mark).collect::<Vec<&str>>().join(", "));
            row
        })
        .collect();
    let mut sigma = vec!["sigma".to_owned(), String::new(), String::new()];
    sigma.extend(found.sigma.iter().map(|&value| number(value)));
    sigma.resize(header.len(), String::new());
    rows.push(sigma);
    let rollouts = fitted.rollouts.as_ref().map_or_else(String::new, |choice| format!("{}\n\n", by_rollouts(choice)));
    let rollouts = rollouts + &fitted.refinement.as_ref().map_or_else(String::new, refined_over_candidates);
    let which = if found.held_out { "cross-validated" } else { "in-sample" };
    let what = if quadratic { "R2" } else { "mean absolute error over the null model's" };
    format!(
        "{rollouts}{} rows of {} ({} independent), {} left out at borders, {} incomplete; condition {} (preconditioned {})\n\
         {what}, {which}{}; loss: squared error over variance\n{}",
        found.rows,
        count(fitted.episodes, "episode"),
        number(found.effective_rows),
        found.at_border,
        found.incomplete,
        number(found.condition),
        number(found.preconditioned),
        found.fold_rule.as_ref().map_or_else(String::new, |rule| format!(" ({rule})")),
        table(&header, rows)
    ) + &found.rule.map_or_else(String::new, |rule| format!("\nchosen: {rule}"))
        + &refinement(&found.candidates[found.chosen])
        + &continuity(&found.candidates[found.chosen])
        + &bounded(&found.candidates, found.held_out)
}

/// What it costs that maps meet at their borders.
fn continuity(score: &Score) -> String {
    score.continuity.map_or_else(String::new, |own| {
        format!(
            "\n{}: the maps meet at {} to {} of a standard deviation, with {} free numbers a target",
            score.specification,
            count(own.borders, "border"),
            number(own.jump),
            own.numbers
        )
    })
}

/// How the regions of a refined partition were found.
fn refinement(score: &Score) -> String {
    match score.objective.as_slice() {
        [first, .., last] => format!(
            "\n{}: the objective fell from {first:.4} to {last:.4} in {} passes",
            score.specification,
            score.objective.len()
        ),
        _ => String::new(),
    }
}

/// How the regions' maps are bounded, and what that costs one step ahead.
fn bounded(candidates: &[Score], held_out: bool) -> String {
    let tables = BoundedCandidate::tables(&BoundedCandidate::of(candidates, held_out));
    tables.iter().map(|own| format!("\n\n{}", text_table(own))).collect()
}

/// Tells what a fit to simulations will cost, before it begins: of so many passes a fit of one step, and whether maps are bounded.
pub(crate) fn say_passes(objective: Option<Objective>, (fit, bounded): (usize, bool), context: &Context) {
    if let Some(words) = fleetfoot::simulation_cost(objective.unwrap_or_default(), fit, bounded) {
        context.say(format!("note: {words}"));
    }
}

/// What a fit to simulations brought, above a table of candidates.
pub(crate) fn refined_over_candidates(refinement: &Refinement) -> String {
    format!("{}\nWhat follows compares models fitted one step ahead.\n\n", refinement.in_words())
}

/// What rollouts said of the candidates.
pub(crate) fn by_rollouts(choice: &RolloutChoice) -> String {
    let over = choice.candidates.iter().any(|candidate| candidate.over.is_some());
    let mut header = vec!["partition", "terms", "rollouts over persistence", "worst fold", ""];
    if over {
        header.insert(1, "derivative");
    }
    let row = |(at, candidate): (usize, &RolloutCandidate)| {
        let worst = candidate.folds.iter().copied().fold(0.0, f64::max);
        let mut row =
            vec![candidate.partition.clone(), candidate.size.to_string(), ratio(candidate.error()), ratio(worst)];
        row.push(if at == choice.chosen { "<- chosen".into() } else { String::new() });
        if over {
            row.insert(1, candidate.over.map_or_else(|| "central".into(), |rows| format!("over {rows} rows")));
        }
        row
    };
    let rows = choice.candidates.iter().enumerate().map(row).collect();
    format!("chosen: {}\n{}", choice.in_words(), table(&header, rows))
}

/// What the fit told, the hash of its model included, and the file of the model.
#[derive(Serialize)]
struct Told {
    #[serde(flatten)]
    fitted: Value,
    model: String,
}

/// The recipe with all flags applied.
pub(crate) fn recipe(arguments: &RecipeArgs) -> Result<Recipe, Error> {
    let mut recipe = arguments.recipe.as_deref().map_or_else(|| Ok(Recipe::default()), Recipe::read)?;
    for text in &arguments.alias {
        let (name, expression) = pair("--alias", text)?;
        recipe.columns.insert(name, expression);
    }
    for state in arguments.states.iter().flat_map(|list| &list.0) {
        recipe.states.entry(state.clone()).or_default();
    }
    for input in arguments.inputs.iter().flat_map(|list| &list.0) {
        recipe.inputs.entry(input.clone()).or_insert_with(|| Input::Table(InputTable::default()));
    }
    for angle in arguments.angles.iter().flat_map(|list| &list.0) {
        if let Some(state) = recipe.states.get_mut(angle) {
            state.kind = Some(Kind::Angle);
        } else if let Some(input) = recipe.inputs.get_mut(angle) {
            *input = Input::Table(InputTable { kind: Some(Kind::Angle), ..input.table() });
        } else {
            return Err(Error::unknown(angle, format!("--angles {angle}: it is neither a state nor an input")));
        }
    }
    for text in &arguments.derivative {
        let (name, how) = pair("--derivative", text)?;
        let Some(state) = recipe.states.get_mut(&name) else {
            return Err(Error::unknown(&name, format!("--derivative {text}: `{name}` is not a state")));
        };
        state.derivative = Some(Derivative::parse(&how));
    }
    let model = &mut recipe.model;
    model.predict = arguments.predict.clone().or(model.predict.take());
    model.degree = arguments.degree.or(model.degree);
    recipe.library.radial = arguments.radial.or(recipe.library.radial);
    let model = &mut recipe.model;
    model.weight = arguments.weight.clone().or(model.weight.take());
    if let Some(lags) = arguments.lags {
        model.lags = Some(lags);
        (recipe.narx.lags_out, recipe.narx.lags_in) = (None, None);
    }
    apply_time(&mut recipe, &arguments.time)?;
    Ok(recipe)
}

pub(crate) fn apply_time(recipe: &mut Recipe, time: &TimeArgs) -> Result<(), Error> {
    if let Some(column) = &time.time {
        recipe.time.column = Some(column.clone());
        recipe.time.unit = time.time_unit.clone();
        recipe.time.dt = None;
    }
    if let Some(dt) = time.dt {
        recipe.time.dt = Some(dt);
        recipe.time.column = None;
    }
    if let Some(gap) = &time.max_gap {
        recipe.time.max_gap = Some(gap.parse().map_or_else(|_| Gap::Word(gap.clone()), Gap::Seconds));
    }
    recipe.time.only = time.only.clone().or(recipe.time.only.take());
    apply_channels(recipe, &time.channels)
}

fn apply_channels(recipe: &mut Recipe, channels: &ChannelArgs) -> Result<(), Error> {
    if let Some(stamp) = channels.stamp {
        let stamp = match stamp {
            StampArg::Header => Stamp::Header,
            StampArg::Log => Stamp::Log,
            StampArg::Publish => Stamp::Publish,
        };
        recipe.time.stamp = Some(stamp.name().to_owned());
    }
    if channels.base.is_some() || channels.rate.is_some() {
        recipe.time.base = channels.base.clone();
        recipe.time.rate = channels.rate;
    }
    for text in &channels.rename {
        let (ours, file) = pair("--rename", text)?;
        recipe.rename.insert(ours, file);
    }
    Ok(())
}

/// Where decoded columns of robot logs are kept: where the user says, else beside the model when there is much to decode.
pub(crate) fn cache(channels: &ChannelArgs, model: &std::path::Path) -> Option<Cache> {
    match &channels.cache {
        _ if channels.no_cache => None,
        // Beside a device or a pipe is no place for files.
        None if model.exists() && !is_replaced(model) => None,
        Some(folder) => Some(Cache { folder: folder.clone(), least_bytes: 0 }),
        None => Some(Cache { folder: model.with_file_name(".fleetfoot-cache"), least_bytes: 64 << 20 }),
    }
}

pub(crate) fn pair(flag: &str, text: &str) -> Result<(String, String), Error> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
            Ok((name.trim().to_owned(), value.trim().to_owned()))
        }
        _ => Err(Error::value(format!("{flag} {text}: write NAME=VALUE"))),
    }
}
