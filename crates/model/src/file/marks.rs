//! Marks of episodes as text: hexadecimal numbers, by episode and field.

use std::collections::BTreeMap;

use crate::TrainedEpisode;

/// By the identity of an episode, by field.
pub(super) type MarksText = BTreeMap<String, BTreeMap<String, String>>;

pub(super) fn of(episodes: &[TrainedEpisode]) -> MarksText {
    let text = |marks: &[u64]| marks.iter().map(|mark| format!("{mark:016x}")).collect::<Vec<_>>().join(" ");
    let marked = episodes.iter().filter(|episode| !episode.marks.is_empty());
    marked
        .map(|episode| {
            let fields = episode.marks.iter().map(|(field, marks)| (field.clone(), text(marks)));
            (episode.id.clone(), fields.collect())
        })
        .collect()
}

/// Episodes with their marks; `None` if a mark is malformed, or of an unknown episode.
pub(super) fn joined(episodes: Vec<(String, String)>, mut text: MarksText) -> Option<Vec<TrainedEpisode>> {
    let numbers = |text: &str| text.split(' ').map(|mark| u64::from_str_radix(mark, 16).ok()).collect::<Option<_>>();
    let with_marks = |(id, name): (String, String)| {
        let fields = text.remove(&id).unwrap_or_default().into_iter();
        let marks = fields.map(|(field, marks)| Some((field, numbers(&marks)?))).collect::<Option<_>>()?;
        Some(TrainedEpisode { id, name, marks })
    };
    let joined = episodes.into_iter().map(with_marks).collect::<Option<_>>()?;
    text.is_empty().then_some(joined)
}
