//! `fleetfoot resimulate`.

use fleetfoot::{Error, Followed, estimate::Ending, replayed_in_words};

use super::{Context, files, in_sample, read_by, read_model, time_changes};
use crate::{
    args::Resimulate,
    table::{count, number, table},
};

pub(crate) fn resimulate(arguments: &Resimulate, context: &Context) -> Result<(), Error> {
    let model = read_model(&arguments.model.model)?;
    let files = files(&arguments.model.data)?;
    let layouts = arguments.output.as_deref().map(fleetfoot::layout_files).unwrap_or_default();
    let outputs: Vec<_> = arguments.output.iter().chain(&layouts).cloned().collect();
    context.claim(&outputs, &read_by(&files, [&arguments.model.model]), false)?;
    let mut changes = time_changes(&arguments.model)?;
    changes.override_with(arguments.section.clone());
    let bar = context.bar();
    let followed = fleetfoot::resimulate(&model, &changes, &files, arguments.output.as_deref(), &bar);
    bar.finish();
    let followed = followed?;
    context.notes(&followed.notes);
    in_sample(context, &followed.in_sample, followed.names.len());
    context.print(followed.to_json(), || to_text(&followed, arguments.episodes));
    if let Some(path) = &arguments.output {
        context.say(format!("wrote {}", path.display()));
        context.layouts(&layouts);
    }
    Ok(())
}

fn to_text(followed: &Followed, episodes: bool) -> String {
    let resimulation = &followed.resimulation;
    let rows: usize = resimulation.episodes.iter().map(|episode| episode.rows.len()).sum();
    let moved = &resimulation.columns[resimulation.states..];
    let [dynamics, bounds, stationarity] = followed.worst();
    let programs = |of: fn(usize, usize) -> usize, from: usize| {
        resimulation.episodes.iter().map(|episode| episode.programs).fold(from, of)
    };
    let mut text = format!(
        "{} followed, {rows} rows; {}; moved: {}; {}\n",
        count(resimulation.episodes.len(), "episode"),
        if resimulation.continuous { "Hermite and Simpson's rule (order 4)" } else { "row by row" },
        if moved.is_empty() { "the beginning alone".to_owned() } else { moved.join(", ") },
        replayed_in_words(&resimulation.replayed)
    );
    text.push_str(&format!(
        "at a minimum: {} of {}, by {} to {} convex programs; dynamics violated by {dynamics:.1e} at most, bounds by {bounds:.1e}; stationarity {stationarity:.1e}\n\n",
        followed.minima(),
        resimulation.episodes.len(),
        programs(usize::min, usize::MAX),
        programs(usize::max, 0),
    ));
    let single = resimulation.episodes.len() == 1;
    let mut header = vec!["rms of"];
    header.extend(if single {
        vec!["followed", "open loop"]
    } else {
        vec!["followed: median", "90 %", "worst", "open loop: median", "90 %", "worst"]
    });
    header.extend(["may be off", "bounds"]);
    let row = |j: usize| {
        let unit = followed.units[j].as_ref().map(|unit| format!(" [{unit}]")).unwrap_or_default();
        let mut row = vec![format!("{}{unit}", resimulation.columns[j])];
        let spread_text = |spread: fleetfoot::Spread| {
            let values = if single { vec![spread.median] } else { vec![spread.median, spread.ninth, spread.worst] };
            values.into_iter().map(|value| if value.is_infinite() { "diverged".to_owned() } else { number(value) })
        };
        row.extend(spread_text(followed.followed(j)));
        match followed.open_loop(j) {
            Some(spread) => row.extend(spread_text(spread)),
            None => row.extend(vec!["-".to_owned(); if single { 1 } else { 3 }]),
        }
        let [low, high] = resimulation.bounds[j];
        let end = |value: f64| if value.is_finite() { number(value) } else { String::new() };
        row.extend([number(resimulation.deviations[j]), format!("{}..{}", end(low), end(high))]);
        row
    };
    text.push_str(&table(&header, (0..resimulation.columns.len()).map(row).collect()));
    if episodes {
        text.push_str(&format!("\n\n{}", by_episode(followed)));
    }
    followed.warnings().iter().for_each(|warning| text.push_str(&format!("\n{warning}")));
    text
}

/// A line an episode: of every state followed and open loop, of every input followed.
fn by_episode(followed: &Followed) -> String {
    let resimulation = &followed.resimulation;
    let mut header = vec!["episode".to_owned(), "rows".into(), "programs".into(), "ended".into()];
    for (j, name) in resimulation.columns.iter().enumerate() {
        header.push(name.clone());
        header.extend((j < resimulation.states).then(|| format!("{name} open loop")));
    }
    let row = |(episode, name): (&fleetfoot::estimate::Resimulated, &String)| {
        let (ours, open) = (resimulation.deviations_of(episode), resimulation.open_loop_deviations(episode));
        let mut row = vec![
            name.clone(),
            episode.rows.len().to_string(),
            episode.programs.to_string(),
            match episode.ending {
                Ending::Minimum => "at a minimum".to_owned(),
                Ending::Stalled => "no better step".to_owned(),
                _ => "early".to_owned(),
            },
        ];
        for (j, &value) in ours.iter().enumerate() {
            row.push(number(value));
            row.extend(open.get(j).map(|&value| if value.is_infinite() { "diverged".into() } else { number(value) }));
        }
        row
    };
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    table(&header, resimulation.episodes.iter().zip(&followed.names).map(row).collect())
}
