//! `fleetfoot filter`.

use fleetfoot::{DeviationFrom, Error, FilterSwitching, Filtered, SensorReport, SquareReport};

use super::{Context, files, in_sample, read_by, read_model, time_changes};
use crate::{
    args::Filter,
    table::{count, number, table},
};

pub(crate) fn filter(arguments: &Filter, context: &Context) -> Result<(), Error> {
    let model = read_model(&arguments.model.model)?;
    let files = files(&arguments.model.data)?;
    let layouts = arguments.output.as_deref().map(fleetfoot::layout_files).unwrap_or_default();
    let outputs: Vec<_> = arguments.output.iter().chain(&layouts).cloned().collect();
    context.claim(&outputs, &read_by(&files, [&arguments.model.model]), false)?;
    let mut changes = time_changes(&arguments.model)?;
    changes.say(arguments.how.clone());
    let bar = context.bar();
    let filtered = fleetfoot::filter(&model, &changes, &files, arguments.output.as_deref(), &bar);
    bar.finish();
    let filtered = filtered?;
    context.notes(&filtered.notes);
    in_sample(context, &filtered.in_sample_episodes, filtered.episodes);
    context.print(filtered.to_json(), || to_text(&filtered));
    if let Some(path) = &arguments.output {
        context.say(format!("wrote {}", path.display()));
    }
    context.layouts(&layouts);
    Ok(())
}

fn to_text(filtered: &Filtered) -> String {
    let regions = match (filtered.regions, filtered.switching) {
        (1, _) => "one region".to_owned(),
        (regions, FilterSwitching::State) => format!("{regions} regions, by the region of the state"),
        (regions, FilterSwitching::Transitions) => format!("{regions} regions, by counted transitions"),
    };
    let mut text = format!(
        "{}, {} rows; {regions}; {}; process noise x {}{}; log-likelihood {} ({} a row)\n\n",
        count(filtered.episodes, "episode"),
        filtered.rows,
        if filtered.exact { "exact steps" } else { "steps linearised at the mean" },
        number(filtered.process),
        match filtered.noise_rows {
            0 => String::new(),
            rows => format!(", by that of {} before", count(rows, "row")),
        },
        number(filtered.log_likelihood),
        number(filtered.log_likelihood / (filtered.rows - filtered.lost_rows) as f64)
    );
    let sensor = |own: &SensorReport| {
        let from = match own.deviation_from {
            DeviationFrom::Given => "given",
            DeviationFrom::Column => "log",
            DeviationFrom::Innovations => "innovations",
        };
        let white = if own.correlation.abs() <= own.white { "white" } else { "not white" };
        vec![
            own.state.clone(),
            number(own.deviation),
            from.to_owned(),
            own.rows.to_string(),
            percent(own.share),
            format!("{} ({white})", number(own.correlation)),
        ]
    };
    let header = ["sensor", "deviation", "from", "rows", "in 95 % band", "correlation"];
    text.push_str(&table(&header, filtered.sensors.iter().map(sensor).collect()));
    if !filtered.truth.is_empty() {
        let row = |own: &fleetfoot::TruthReport| {
            vec![own.state.clone(), number(own.rmse), own.measured_rmse.map_or_else(|| "-".to_owned(), number)]
        };
        let header = ["RMSE of", "estimate", "measurement"];
        text.push_str(&format!("\n\n{}", table(&header, filtered.truth.iter().map(row).collect())));
    }
    for (name, own) in [("NIS", &filtered.nis), ("NEES", &filtered.nees)] {
        if let Some(own) = own {
            text.push_str(&format!("\n{}", squares(name, own)));
        }
    }
    if filtered.held_inputs > 0 {
        text.push_str(&format!("\ninputs missing at {} rows, and held", filtered.held_inputs));
    }
    text
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// Consistency of a filter's normalised squares with their chi-squared distribution.
fn squares(name: &str, own: &SquareReport) -> String {
    let verdict = match own {
        own if own.holds() => "consistent",
        own if own.mean > own.high => "errors larger than the filter's covariance",
        _ => "errors smaller than the filter's covariance",
    };
    format!(
        "{name} {} a degree of freedom, 95 % band {}..{}: {verdict}; {} of {} rows in the 95 % band of a row",
        number(own.mean),
        number(own.low),
        number(own.high),
        percent(own.share),
        own.rows
    )
}
