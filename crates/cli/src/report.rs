//! Errors for people: expressions with a mark under the place.

use fleetfoot::Error;
use miette::{LabeledSpan, NamedSource, miette};

/// Prints an error on standard error.
pub(crate) fn report(error: Error) {
    match &error {
        Error::Expression { place, text, source } => {
            let at = source.position().min(text.len());
            let length = text[at..].chars().next().map_or(0, char::len_utf8);
            let report = miette!(labels = vec![LabeledSpan::at(at..at + length, "here")], "{source}")
                .with_source_code(NamedSource::new(place, text.clone()));
            eprintln!("{report:?}");
        }
        other => eprintln!("error: {other}"),
    }
}
