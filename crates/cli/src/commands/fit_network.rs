//! `fleetfoot fit network`.

use fleetfoot::{Error, FitRequest, Network, NetworkReport};

use super::{Context, fit::Job, flags};
use crate::{
    args::FitNetwork,
    table::{count, number, ratio, table},
};

pub(crate) fn network(arguments: &FitNetwork, context: &Context) -> Result<(), Error> {
    let mut recipe = flags::recipe(&arguments.data.recipe)?;
    recipe.override_with(arguments.network.clone());
    let mut job = Job::new(recipe, &arguments.data, &arguments.output)?;
    job.known = true;
    job.run::<Network>(FitRequest::default(), context, |fitted| to_text(&fitted[0].report), |_| None)
}

fn to_text(report: &NetworkReport) -> String {
    let rows = report.candidates.iter().map(|candidate| {
        vec![
            candidate.name.clone(),
            candidate.numbers.to_string(),
            format!("{} +- {}", ratio(candidate.loss), ratio(candidate.standard_error)),
            if candidate.chosen { "<- chosen".into() } else { String::new() },
        ]
    });
    let errors = report.targets.iter().zip(&report.held_out).map(|(target, candidate)| {
        vec![target.clone(), number(candidate.rmse), number(candidate.mean), number(candidate.persistence)]
    });
    let chosen = &report.candidates[report.chosen].name;
    format!(
        "{} rows of {}, {} of them for networks; {} left out at borders, {} incomplete\n\
         held out: {}\n{}\n\nroot mean squared errors, held out\n{}",
        report.rows,
        count(report.summary.episodes, "episode"),
        report.trained_rows,
        report.summary.left_out[0],
        report.summary.left_out[1],
        report.fold_rule,
        table(&["model", "numbers", "squared error over variance", ""], rows.collect()),
        table(&["target", chosen, "mean", "persistence"], errors.collect())
    )
}
