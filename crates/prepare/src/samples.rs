//! The samples of states whose topic is not the one that makes the rows.
//!
//! A join fills faster rows with values on the straight line between two samples, or with the last one again. To a
//! curve these would be measurements without noise and with corners, and the true ones gross errors. So the curve of
//! such a state goes through the samples of its topic at their stamps, and is read off at the rows.

use std::collections::BTreeMap;

use fleetfoot_data::{Block, Episode, Halo, Progress, Source};
use fleetfoot_dataset::{Dataset, Error, Logs};
use fleetfoot_library::Expr;
use fleetfoot_recipe::{Recipe, wildcard::is_match};
use fleetfoot_signal::dejitter;

use crate::{columns::Planned, options::Method, report::ClockReport};

/// Samples of a channel in an episode of the rows.
#[derive(Debug, Clone, Default)]
pub(crate) struct Samples {
    pub(crate) topic: String,
    /// Seconds of the rows' episode, rising.
    pub(crate) times: Vec<f64>,
    pub(crate) values: Vec<f64>,
    /// Clock of the longest run of stamps.
    pub(crate) clock: Option<ClockReport>,
}

impl Samples {
    /// Those from the last one at or before the first second to the first one at or after the last.
    pub(crate) fn within(&self, first: f64, last: f64) -> (&[f64], &[f64]) {
        let from = self.times.partition_point(|&time| time <= first).saturating_sub(1);
        let to = (self.times.partition_point(|&time| time < last) + 1).min(self.times.len());
        (&self.times[from..to.max(from)], &self.values[from..to.max(from)])
    }
}

/// The states of one topic, opened at its own samples.
struct OfTopic {
    topic: String,
    /// Their places among the planned columns.
    channels: Vec<usize>,
    dataset: Dataset,
}

/// All topics beside that of the rows.
pub(crate) struct Topics {
    sets: Vec<OfTopic>,
    even: bool,
}

/// The topic of a field, with the key of its group where it has one: `/tf.transforms[base]` of `/tf.transforms[base].x`.
fn group(field: &str, topics: &[&str]) -> Option<String> {
    let is_of = |topic: &&&str| field.strip_prefix(**topic).is_some_and(|rest| rest.starts_with(['.', '[']));
    let topic = topics.iter().filter(is_of).max_by_key(|topic| topic.len())?;
    let keyed = field[topic.len()..].find("].").map(|end| topic.len() + end + 1);
    Some(field[..keyed.unwrap_or(topic.len())].to_owned())
}

/// The one group of all that an expression reads in its own row.
fn only_group(expression: &Expr, topics: &[&str]) -> Option<String> {
    if expression.reads_other_rows() || expression.reads_clock() || !expression.filters().is_empty() {
        return None;
    }
    let sources = expression.sources();
    let mut groups = sources.iter().map(|field| group(field, topics));
    let first = groups.next()??;
    groups.all(|other| other.as_ref() == Some(&first)).then_some(first)
}

impl Topics {
    /// Opens the topics of the smoothed states that are of another topic than the rows. A field with a join in the
    /// recipe stays joined.
    pub(crate) fn new(
        recipe: &Recipe,
        dataset: &Dataset,
        planned: &[Planned],
        logs: &Logs,
        even: bool,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let topics: Vec<&str> = dataset.topics().map(|topic| topic.name.as_str()).collect();
        let base = match (&recipe.time.base, recipe.time.rate) {
            (_, Some(_)) => None,
            (Some(base), None) => group(&format!("{base}.x"), &topics),
            (None, None) => dataset.aliases().iter().find_map(|(_, alias)| group(alias.sources().first()?, &topics)),
        };
        let is_joined = |alias: &Expr| {
            alias.sources().iter().any(|field| recipe.join.keys().any(|pattern| is_match(pattern, field)))
        };
        let mut groups: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (at, (planned, (_, expression))) in planned.iter().zip(dataset.aliases()).enumerate() {
            let is_smooth = planned.options.is_some_and(|options| options.method != Method::None);
            let Some(topic) = only_group(expression, &topics).filter(|_| is_smooth && !is_joined(expression)) else {
                continue;
            };
            if base.as_ref() != Some(&topic) {
                groups.entry(topic).or_default().push(at);
            }
        }
        let open = |(topic, channels): (String, Vec<usize>)| {
            let names: Vec<String> = channels.iter().map(|&at| planned[at].name.clone()).collect();
            let dataset = Dataset::for_channels(recipe, &names, dataset.topic_clocks(), logs, progress)?;
            Ok(OfTopic { topic, channels, dataset })
        };
        Ok(Self { sets: groups.into_iter().map(open).collect::<Result<_, Error>>()?, even })
    }

    /// The samples that belong to the rows of a block of `rows`, by the places of their channels. A topic whose stamps
    /// go back in the log is left to the join, with a note.
    pub(crate) fn of_episode(
        &self,
        rows: &Dataset,
        episode: usize,
        block: &Block,
        notes: &mut Vec<String>,
    ) -> Result<BTreeMap<usize, Samples>, Error> {
        let mut samples_of_column = BTreeMap::new();
        for set in &self.sets {
            let samples = set.samples(rows.origin(episode), block, self.even)?;
            match samples {
                Some(samples) => samples_of_column.extend(set.channels.iter().copied().zip(samples)),
                None => notes.push(format!(
                    "{}: stamps of {} decrease; its states are smoothed at the rows of the log instead of its own stamps",
                    rows.episodes()[episode].name,
                    set.topic
                )),
            }
        }
        Ok(samples_of_column)
    }
}

impl OfTopic {
    /// The topic's samples in a log about the rows of a block, channel by channel, of those of its episodes that meet
    /// the rows. `None` if their stamps do not rise.
    fn samples(&self, log: &std::path::Path, rows: &Block, even: bool) -> Result<Option<Vec<Samples>>, Error> {
        let seconds = rows.seconds();
        let (Some(&first), Some(&last)) = (seconds.first(), seconds.last()) else { return Ok(None) };
        let view = self.dataset.view()?;
        // A pause of the topic is a border here as it is for the rows: what was sampled beyond it is no part of their curve.
        let meets = |episode: &Episode| episode.start <= stamp_at(rows, last) && episode.end >= stamp_at(rows, first);
        let of_log = |(at, episode): &(usize, &Episode)| self.dataset.origin(*at) == log && meets(episode);
        let empty = Samples { topic: self.topic.clone(), ..Samples::default() };
        let mut all = vec![empty; self.channels.len()];
        let mut longest = 0;
        for (at, episode) in view.episodes().iter().enumerate().filter(of_log) {
            let mut block = view.read(at, 0..episode.rows, Halo::default())?;
            view.turn_on(&mut block);
            let since = (block.start - rows.start) as f64 * 1e-9;
            let mut times: Vec<f64> = block.seconds();
            if even && times.len() > 2 {
                let error =
                    |source| Error::Signal { episode: episode.name.clone(), channel: self.topic.clone(), source };
                let dejittered = dejitter(&times).map_err(error)?;
                if times.len() > longest {
                    longest = times.len();
                    all.iter_mut().for_each(|samples| samples.clock = Some(ClockReport::of(&dejittered)));
                }
                times = dejittered.times;
            }
            let times: Vec<f64> = times.iter().map(|time| since + time).collect();
            // One more on either side, so that the first and the last row lie between samples.
            let from = times.partition_point(|&time| time < first).saturating_sub(1);
            let to = (times.partition_point(|&time| time <= last) + 1).min(times.len());
            for (column, samples) in all.iter_mut().enumerate() {
                samples.times.extend_from_slice(&times[from..to.max(from)]);
                samples.values.extend_from_slice(&block.column(column)[from..to.max(from)]);
            }
        }
        let rises = |samples: &Samples| samples.times.windows(2).all(|pair| pair[0] < pair[1]);
        Ok(all.iter().all(rises).then_some(all))
    }
}

/// The stamp at so many seconds of a block.
fn stamp_at(block: &Block, seconds: f64) -> i64 {
    block.start + (seconds * 1e9).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_belong_to_topic_and_key() {
        let topics = ["/tf", "/joint_states", "/imu", "/imu/data"];
        let of = |field: &str| group(field, &topics);
        assert_eq!(of("/imu/data.angular_velocity.x").as_deref(), Some("/imu/data"));
        assert_eq!(of("/joint_states.position[left]").as_deref(), Some("/joint_states"));
        assert_eq!(of("/tf.transforms[base].translation.x").as_deref(), Some("/tf.transforms[base]"));
        assert_eq!(of("/tf.transforms[base].x"), of("/tf.transforms[base].x"));
        assert_eq!(of("x"), None);
    }

    #[test]
    fn pieces_include_one_neighbouring_sample() {
        let times: Vec<f64> = (0..10).map(f64::from).collect();
        let samples = Samples { values: times.clone(), times, ..Samples::default() };
        assert_eq!(samples.within(2.5, 5.5).0, [2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(samples.within(2.0, 5.0).0, [2.0, 3.0, 4.0, 5.0]);
        assert_eq!(samples.within(-1.0, 0.5).0, [0.0, 1.0]);
        assert_eq!(samples.within(8.5, 20.0).0, [8.0, 9.0]);
        assert!(Samples::default().within(0.0, 1.0).0.is_empty());
    }
}
