//! Note that errors on prepared logs are not errors against measurements.

use std::{collections::BTreeMap, path::PathBuf};

use crate::logs::{Logs, NOISE, is_prepared};

/// Says that prepared logs hold smoothed values, and by how much the measurements scatter about them, where `prepare` knew it.
pub(super) fn truth(logs: &Logs) -> Option<String> {
    let is_smoothed = |file: &PathBuf| file.file_name().is_some_and(|name| is_prepared(&name.to_string_lossy()));
    let files: Vec<PathBuf> = logs.files().into_iter().filter(is_smoothed).collect();
    (!files.is_empty()).then(|| {
        let scatter: Vec<String> =
            scatter(&files).into_iter().map(|(column, noise)| format!("{column} {noise:.2e}")).collect();
        let beside = if scatter.is_empty() {
            "`fleetfoot rollout MODEL RAW.csv` gives the error against measurements if the model needs no derivative columns".to_owned()
        } else {
            format!(
                "the measurements scatter about them by {} (standard deviation n), so that an error e of a state is about sqrt(e^2 + n^2) against \
                 measurements",
                scatter.join(", ")
            )
        };
        format!(
            "`prepare` wrote these logs: held-out errors, scores and rollouts compare with smoothed values, which a smooth model fits more easily than \
             measurements; {beside}"
        )
    })
}

/// Root mean square over the files of the deviation of a measurement about the curve, by column.
fn scatter(files: &[PathBuf]) -> BTreeMap<String, f64> {
    let mut sums: BTreeMap<String, (f64, usize)> = BTreeMap::new();
    for file in files {
        let text = fleetfoot_log::metadata(file).ok().and_then(|mut all| all.remove(NOISE)).unwrap_or_default();
        for (column, noise) in serde_json::from_str::<BTreeMap<String, f64>>(&text).unwrap_or_default() {
            let sum = sums.entry(column).or_default();
            *sum = (sum.0 + noise * noise, sum.1 + 1);
        }
    }
    sums.into_iter().map(|(column, (squares, files))| (column, (squares / files as f64).sqrt())).collect()
}
