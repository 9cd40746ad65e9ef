//! Sentences of a verdict.

use fleetfoot_report::{Light, Sentence};

pub(crate) fn sentence(light: Light, head: &str, text: &str) -> Sentence {
    Sentence { light, head: head.to_owned(), text: text.to_owned() }
}

/// A message as a sentence.
pub(crate) fn sentence_of(message: &str) -> String {
    let mut letters = message.chars();
    let first: String = letters.next().into_iter().flat_map(char::to_uppercase).collect();
    format!("{first}{}.", letters.as_str().trim_end_matches('.'))
}
