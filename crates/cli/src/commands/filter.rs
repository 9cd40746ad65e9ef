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
    changes.override_with(arguments.section.clone());
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
    let sensor = |report: &SensorReport| {
        let from = match report.deviation_from {
            DeviationFrom::Given => "given",
            DeviationFrom::Column => "log",
            DeviationFrom::Innovations => "innovations",
        };
        let white = if report.correlation.abs() <= report.white { "white" } else { "not white" };
        vec![
            report.state.clone(),
            number(report.deviation),
            from.to_owned(),
            report.rows.to_string(),
            percent(report.share),
            format!("{} ({white})", number(report.correlation)),
        ]
    };
    let header = ["sensor", "deviation", "from", "rows", "in 95 % band", "correlation"];
    text.push_str(&table(&header, filtered.sensors.iter().map(sensor).collect()));
    if !filtered.truth.is_empty() {
        let row = |report: &fleetfoot::TruthReport| {
            vec![report.state.clone(), number(report.rmse), report.measured_rmse.map_or_else(|| "-".to_owned(), number)]
        };
        let header = ["RMSE of", "estimate", "measurement"];
        text.push_str(&format!("\n\n{}", table(&header, filtered.truth.iter().map(row).collect())));
    }
    for (name, report) in [("NIS", &filtered.nis), ("NEES", &filtered.nees)] {
        if let Some(report) = report {
            text.push_str(&format!("\n{}", squares(name, report)));
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
fn squares(name: &str, report: &SquareReport) -> String {
    let verdict = match report {
        report if report.holds() => "consistent",
        report if report.mean > report.high => "errors larger than the filter's covariance",
        _ => "errors smaller than the filter's covariance",
    };
    format!(
        "{name} {} a degree of freedom, 95 % band {}..{}: {verdict}; {} of {} rows in the 95 % band of a row",
        number(report.mean),
        number(report.low),
        number(report.high),
        percent(report.share),
        report.rows
    )
}
