//! `fleetfoot rollout`.

use super::{Context, files, in_sample, read_by, read_model, time_changes};
use crate::{
    args::{Method, OutsideArg, Rollout},
    table::{count, number, ratio, seconds, table},
};
use fleetfoot::{
    Error, Model, Recipe, RolledOut,
    dynamics::{Estimate, Horizon, HorizonScore, Method as Integration, Outside, RolloutOptions, Starts},
    interval_in_words, replayed_in_words, useful_in_words,
};

pub(crate) fn rollout(arguments: &Rollout, context: &Context) -> Result<(), Error> {
    let model = read_model(&arguments.model.model)?;
    let files = files(&arguments.model.data)?;
    let layouts = arguments.output.as_deref().map(fleetfoot::layout_files).unwrap_or_default();
    let outputs: Vec<_> = arguments.output.iter().chain(&layouts).cloned().collect();
    context.claim(
        &outputs,
        &read_by(&files, arguments.controller.file().iter().chain([&arguments.model.model])),
        false,
    )?;
    let mut options = RolloutOptions::new(arguments.horizon);
    options.method = match arguments.method {
        Method::Euler => Integration::Euler,
        Method::Rk4 => Integration::Rk4,
    };
    options.outside = match arguments.outside {
        OutsideArg::Tell => Outside::Tell,
        OutsideArg::End => Outside::End,
        OutsideArg::Hold => Outside::Hold,
    };
    arguments.paths.options().apply(&model, &mut options)?;
    let starts = match arguments.seed {
        None => Starts::Even(arguments.starts),
        Some(seed) => Starts::Random { count: arguments.starts, seed },
    };
    let changes = time_changes(&arguments.model)?;
    let controller = arguments.controller.read()?;
    let bar = context.bar();
    let rolled = fleetfoot::rollout(
        &model,
        &changes,
        &files,
        &starts,
        &options,
        controller.as_ref(),
        arguments.output.as_deref(),
        &bar,
    );
    bar.finish();
    let rolled = rolled?;
    context.notes(&rolled.notes);
    in_sample(context, &rolled.in_sample, rolled.episodes);
    if !rolled.rollouts.driven_inputs.is_empty() {
        context.say(format!(
            "note: closed loop: {} come from the controller, not from the recording",
            rolled.rollouts.driven_inputs.join(", ")
        ));
    }
    context.print(rolled.to_json(), || to_text(&rolled, &model, &options.position.join(", ")));
    if let Some(advice) = against_divergence(&rolled, &model) {
        context.say(format!("note: {advice}"));
    }
    if let Some(path) = &arguments.output {
        context.say(format!("wrote {}", path.display()));
        context.layouts(&layouts);
    }
    Ok(())
}

/// Advice against divergence, if at least one of a hundred rollouts of a model of several regions diverged.
fn against_divergence(rolled: &RolledOut, model: &Model) -> Option<String> {
    let (diverged, all) = (rolled.rollouts.diverged(), rolled.rollouts.outcomes.len());
    let several =
        model.method.starts_with("pwa ") && model.partitions.iter().any(|partition| partition.rule.count() > 1);
    let bounded = Recipe::parse(&model.training.recipe, "the model's recipe")
        .is_ok_and(|recipe| recipe.pwa.stable.is_some() || recipe.pwa.passive.is_some());
    (several && !bounded && diverged > 0 && 100 * diverged >= all).then(|| {
        format!(
            "{diverged} of {all} rollouts diverged: a region whose map has a gain above 1 amplifies every error. `fit pwa --stable` bounds the maps of all regions; regions fitted to the dynamics (--partition refined:10, tree:4) simulate more accurately than clusters; `--outside hold` keeps regressors within the training range of their region"
        )
    })
}

/// The steps worth a line: 1, 2, 5, 10, 20, 50, ... and the last.
pub(crate) fn printed_steps(steps: usize) -> Vec<usize> {
    let mut steps_shown = Vec::new();
    let mut decade = 1;
    while decade <= steps {
        steps_shown.extend([1, 2, 5].iter().map(|factor| factor * decade).filter(|&step| step < steps));
        decade *= 10;
    }
    steps_shown.push(steps);
    steps_shown
}

/// Errors over whole rollouts, of the model and of the baselines.
fn summaries(horizon: &Horizon, position: &str) -> String {
    let names = std::iter::once("model").chain(horizon.baselines.iter().map(|(baseline, _)| baseline.name()));
    let scores: Vec<&HorizonScore> =
        std::iter::once(&horizon.model).chain(horizon.baselines.iter().map(|(_, score)| score)).collect();
    let mut header = vec![""];
    header.extend(names);
    let half =
        |e: &Estimate| if e.high.is_finite() { format!(" ± {}", ratio(e.high - e.value)) } else { String::new() };
    let row = |name: String, of: &dyn Fn(&HorizonScore) -> Option<Estimate>| {
        let ratio_text = |score: &&HorizonScore| of(score).map_or_else(|| "-".into(), |e| ratio(e.value) + &half(&e));
        std::iter::once(name).chain(scores.iter().map(ratio_text)).collect::<Vec<String>>()
    };
    let mut rows = vec![
        row("Mahalanobis, average".into(), &|score| Some(score.summary.average)),
        row("Mahalanobis, last step".into(), &|score| Some(score.summary.last)),
        row("Mahalanobis, drift per second".into(), &|score| Some(score.summary.drift)),
    ];
    if horizon.model.average_orientation.is_some() {
        rows.push(row("cosine of the errors of angles".into(), &|score| score.average_orientation));
    }
    for (at, state) in horizon.states.iter().enumerate() {
        if horizon.model.explained_variance[at].value.is_finite() {
            rows.push(row(format!("explained variance of {state}"), &|score| Some(score.explained_variance[at])));
        }
    }
    if horizon.model.displacement_summary.is_some() {
        rows.push(row(format!("displacement of {position}, average"), &|score| {
            Some(score.displacement_summary?.average)
        }));
        rows.push(row(format!("displacement of {position}, last step"), &|score| {
            Some(score.displacement_summary?.last)
        }));
        rows.push(row(format!("displacement of {position}, drift per second"), &|score| {
            Some(score.displacement_summary?.drift)
        }));
        rows.push(row(format!("alignment of {position}"), &|score| Some(score.path.as_ref()?.average_alignment)));
        rows.push(row(format!("propagated error of {position}"), &|score| Some(score.path.as_ref()?.propagated_error)));
        rows.push(row(format!("time warping of {position}"), &|score| Some(score.path.as_ref()?.warping_distance)));
    }
    let pair = horizon.beside_reference.as_ref().map(|pair| {
        let text = |e: &Estimate| ratio(e.value) + &half(e);
        format!(
            "\nmodel beside reference: displacement of {position} {}, alignment {}, propagated error {}, time warping {}",
            text(&pair.displacement.average),
            text(&pair.path.average_alignment),
            text(&pair.path.propagated_error),
            text(&pair.path.warping_distance)
        )
    });
    table(&header, rows) + &pair.unwrap_or_default()
}

pub(crate) fn to_text(rolled: &RolledOut, model: &Model, position: &str) -> String {
    let rollouts = &rolled.rollouts;
    let horizon = &rollouts.horizon;
    let states = horizon.states.len();
    let mut header = vec!["step".to_owned(), "time".into(), "Mahalanobis".into()];
    header.extend(horizon.baselines.iter().map(|(baseline, _)| baseline.name().to_owned()));
    header.push("ended".into());
    header.extend(horizon.states.iter().map(|name| {
        format!("RMSE {name}{}", model.unit_of(name).map(|unit| format!(" [{unit}]")).unwrap_or_default())
    }));
    // Beside the errors on smoothed values those against their measurements.
    let raw = horizon.raw.as_ref().map(|raw| raw.rmse.as_slice());
    let is_measured =
        |state: &usize| raw.is_some_and(|raw| raw.iter().skip(*state).step_by(states).any(|value| value.is_finite()));
    let measured: Vec<usize> = (0..states).filter(is_measured).collect();
    header.extend(measured.iter().map(|&state| format!("raw RMSE {}", horizon.states[state])));
    let rows = printed_steps(horizon.time.len())
        .into_iter()
        .map(|step| {
            let at = step - 1;
            let mut row = vec![step.to_string(), seconds(horizon.time[at]), ratio(horizon.model.mahalanobis[at].value)];
            row.extend(horizon.baselines.iter().map(|(_, score)| ratio(score.mahalanobis[at].value)));
            row.push(format!("{:.1} %", 100.0 * horizon.ended[at]));
            row.extend(horizon.model.rmse[at * states..(at + 1) * states].iter().map(|&value| number(value)));
            row.extend(
                raw.into_iter().flat_map(|raw| measured.iter().map(move |state| number(raw[at * states + state]))),
            );
            row
        })
        .collect();
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let outside = match rollouts.outside {
        Outside::Tell => "",
        Outside::End => " and ended there",
        Outside::Hold => " and were held at its border",
    };
    format!(
        "{} from {}; {} starts left out for missing values; {} diverged, {} stopped at an unknown label, {} left the training range{outside}\n{}\n{}\n{}\n{}",
        count(rollouts.outcomes.len(), "rollout"),
        count(rolled.episodes, "episode"),
        rollouts.missing,
        rollouts.diverged(),
        rollouts.without_region(),
        rollouts.left_domain(),
        replayed_in_words(&rollouts.replayed),
        table(&header, rows) + "\n\n" + &summaries(horizon, position) + "\n",
        interval_in_words(&horizon.basis),
        useful_in_words(horizon)
    )
}
