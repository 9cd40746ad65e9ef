//! Logs opened for a check: topics without a moment in common with others are left out and named.

use std::borrow::Cow;

use fleetfoot_data::Progress;
use fleetfoot_data::setting::{INIT, JOIN, STAMP};
use fleetfoot_dataset::{Dataset, Error, Logs};
use fleetfoot_log::{Error as LogError, FileInfo};
use fleetfoot_recipe::{Recipe, draft_of_topics};

use crate::finding::{Fault, Finding};

/// Logs and the recipe by which they were opened.
pub(crate) struct Opened<'a> {
    pub(crate) dataset: Dataset,
    pub(crate) recipe: Cow<'a, Recipe>,
    /// One finding for every topic that was left out.
    pub(crate) findings: Vec<Finding>,
}

impl<'a> Opened<'a> {
    /// Opens the columns of a recipe. Without columns in it: the draft of a robot's log, else all fields, without those
    /// of topics that share no moment with others.
    ///
    /// # Errors
    /// Those of the recipe and of reading; topics without overlap if the recipe names columns.
    pub(crate) fn new(
        recipe: &'a Recipe,
        infos: &[FileInfo],
        logs: &Logs,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let open = |recipe: &Recipe, names: Option<&[String]>| {
            Dataset::for_columns(recipe, names, logs.clone(), progress).map_err(Box::new)
        };
        let has_columns = !recipe.states.is_empty() || !recipe.inputs.is_empty() || !recipe.columns.is_empty();
        let Some(first) = infos.first().filter(|_| !has_columns) else {
            let dataset = open(recipe, None).map_err(|error| *error)?;
            return Ok(Self { dataset, recipe: Cow::Borrowed(recipe), findings: Vec::new() });
        };
        let first = first.clone().renamed(&recipe.rename.clone().into_iter().collect::<Vec<_>>());
        let mut draft = draft_of_topics(recipe, &first);
        let mut names: Option<Vec<String>> = None;
        let mut findings: Vec<Finding> = Vec::new();
        loop {
            let error = match open(draft.as_ref().unwrap_or(recipe), names.as_deref()) {
                Ok(dataset) => {
                    if draft.is_some() {
                        notes.push(format!(
                            "states and inputs are those that {INIT} proposes; a recipe (-c) chooses others"
                        ));
                    }
                    let recipe = draft.map_or(Cow::Borrowed(recipe), Cow::Owned);
                    return Ok(Self { dataset, recipe, findings });
                }
                Err(error) => *error,
            };
            // Each turn leaves a topic out, so this ends.
            let Some(finding) = apart(&error, &first) else { return Err(error) };
            if findings.iter().any(|known| known.place == finding.place) {
                return Err(error);
            }
            findings.push(finding);
            draft = None;
            let is_kept = |name: &str| !findings.iter().any(|finding| is_of_topic(name, &finding.place));
            let readable = first.columns.iter().filter(|column| column.unsupported.is_none());
            names = Some(readable.map(|column| column.name.clone()).filter(|name| is_kept(name)).collect());
        }
    }
}

/// The finding about two series without a moment in common: the topic of the shorter is left out, of equals the second.
fn apart(error: &Error, info: &FileInfo) -> Option<Finding> {
    let Error::Log(LogError::NoOverlap { what, first, second, ranges, .. }) = error else { return None };
    let [one, other] = **ranges;
    let is_first = one.1 - one.0 < other.1 - other.0;
    let (series, range, against, span) =
        if is_first { (first, one, second, other) } else { (second, other, first, one) };
    let topic_of = |series: &str| {
        let topics = info.topics.iter().map(|topic| topic.name.as_str());
        topics.filter(|topic| is_of_topic(series, topic)).max_by_key(|topic| topic.len())
    };
    let (topic, against) = (topic_of(series)?, topic_of(against)?);
    let seconds = |from: i64, to: i64| (to as f64 - from as f64) * 1e-9;
    let (gap, place) = match range.1 < span.0 {
        true => {
            (seconds(range.1, span.0), format!("end {:.3} s before those of `{against}`", seconds(range.1, span.0)))
        }
        false => {
            (seconds(span.1, range.0), format!("begin {:.3} s after those of `{against}`", seconds(span.1, range.0)))
        }
    };
    Some(Finding::new(
        Fault::NoOverlap,
        topic,
        (gap, format!("its {what} {place}, so its channels are not checked")),
        format!(
            "in the recipe: max_gap = \"none\" in {JOIN} holds its values; {given_stamp} takes one clock for all topics",
            given_stamp = STAMP.to("log")
        ),
    ))
}

/// Returns true for the field or the array element of a topic.
fn is_of_topic(name: &str, topic: &str) -> bool {
    name.strip_prefix(topic).is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_belong_to_whole_topics() {
        assert!(is_of_topic("/tf.transforms[odom].transform.translation.x", "/tf"));
        assert!(is_of_topic("/tf_static.transforms[base]", "/tf_static") && is_of_topic("/imu", "/imu"));
        assert!(!is_of_topic("/tf_static.transforms[base]", "/tf") && !is_of_topic("x", "/tf"));
    }
}
