//! Comparison of a log as this crate reads it with another decoder's output.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use fleetfoot_data::Silent;
use fleetfoot_log::Messages;

use super::oracle::Topic;

/// Result of a comparison with another decoder.
#[derive(Debug, Default)]
pub(crate) struct Held {
    pub(crate) topics: usize,
    pub(crate) messages: usize,
    /// Numbers that are equal, bit by bit.
    pub(crate) numbers: usize,
    /// Values that are missing on both sides.
    pub(crate) missing: usize,
    /// Topics that both decoders refuse, with the error of this crate.
    pub(crate) refused: BTreeMap<String, String>,
    /// Differences between the two; one line a field at most.
    pub(crate) differences: Vec<String>,
}

impl Held {
    pub(crate) fn add(&mut self, other: Self) {
        self.topics += other.topics;
        self.messages += other.messages;
        self.numbers += other.numbers;
        self.missing += other.missing;
        self.refused.extend(other.refused);
        self.differences.extend(other.differences);
    }
}

/// Compares every number and stamp of every message; the same topics must be there, but for those of which a damaged file has lost all messages.
pub(crate) fn hold(path: &Path, peer_topics: &[Topic], damaged: bool) -> Held {
    let log = Messages::open(path).unwrap_or_else(|problem| panic!("{problem}"));
    let ours: BTreeSet<String> = log.topics().unwrap().into_iter().map(|topic| topic.name).collect();
    let theirs: BTreeSet<String> =
        peer_topics.iter().filter(|topic| !damaged || topic.messages > 0).map(|topic| topic.name.clone()).collect();
    if damaged {
        assert!(ours.is_superset(&theirs), "{}: {ours:?} instead of {theirs:?}", path.display());
    } else {
        assert_eq!(ours, theirs, "{}", path.display());
    }
    let mut held = Held::default();
    for topic in peer_topics.iter().filter(|topic| ours.contains(&topic.name)) {
        held.add(hold_topic(path, &log, topic));
    }
    held
}

fn hold_topic(path: &Path, log: &Messages, topic: &Topic) -> Held {
    let at = format!("{}: {}", path.display(), topic.name);
    let fields: Vec<&str> = topic.columns.iter().map(|(name, _)| name.as_str()).collect();
    let (mut logged, mut published) = (Vec::new(), Vec::new());
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); fields.len()];
    let outcome = log.read(&topic.name, &fields, &Silent, |row| {
        logged.push(row.log_time);
        published.push(row.publish_time);
        values.iter_mut().zip(row.values).for_each(|(column, &value)| column.push(value));
        Ok(())
    });
    let mut held = Held::default();
    match outcome {
        Err(problem) if topic.messages == 0 => {
            held.refused.insert(topic.name.clone(), problem.to_string());
            return held;
        }
        Err(problem) => held.differences.push(problem.to_string()),
        Ok(failed) if (logged.len(), failed) != (topic.messages, topic.undecoded) => held.differences.push(format!(
            "{at}: {} messages and {failed} that fail instead of {} and {}",
            logged.len(),
            topic.messages,
            topic.undecoded
        )),
        Ok(_) if logged != topic.log_time => held.differences.push(format!("{at}: other log times")),
        Ok(_) if published != topic.publish_time => held.differences.push(format!("{at}: other publish times")),
        Ok(_) => {}
    }
    if !held.differences.is_empty() {
        return held;
    }
    (held.topics, held.messages) = (1, logged.len());
    for ((field, theirs), ours) in topic.columns.iter().zip(&values) {
        let same = |ours: f64, theirs: f64| ours.to_bits() == theirs.to_bits() || (ours.is_nan() && theirs.is_nan());
        let mut pairs = ours.iter().zip(theirs);
        if let Some(row) = pairs.position(|(&ours, &theirs)| !same(ours, theirs)) {
            let (ours, theirs) = (ours[row], theirs[row]);
            held.differences.push(format!("{at}.{field}, message {row}: {ours:?} instead of {theirs:?}"));
        }
        let missing = ours.iter().filter(|value| value.is_nan()).count();
        held.missing += missing;
        held.numbers += ours.len() - missing;
        if ours.len() != theirs.len() {
            held.differences.push(format!("{at}.{field}: {} values instead of {}", ours.len(), theirs.len()));
        }
    }
    held
}
