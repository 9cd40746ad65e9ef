//! Errors for people: expressions with a mark under the place.

use std::{
    ffi::OsString,
    fmt::Display,
    io::{Write, stderr, stdout},
};

use clap::error::ErrorKind;
use fleetfoot::{Error, dataset::Error as DatasetError, recipe::Error as RecipeError};
use miette::{LabeledSpan, NamedSource, miette};

/// A line on standard error. Nobody may be reading it any more, as where a pager has ended: what was asked for is done all the same.
pub(crate) fn tell(text: impl Display) {
    let _ = writeln!(stderr(), "{text}");
}

/// Prints an error on standard error.
pub(crate) fn report(error: Error) {
    match &error {
        Error::Dataset(DatasetError::Recipe(RecipeError::Expression { place, text, source })) => {
            let at = source.position().min(text.len());
            let length = text[at..].chars().next().map_or(0, char::len_utf8);
            let report = miette!(labels = vec![LabeledSpan::at(at..at + length, "here")], "{source}")
                .with_source_code(NamedSource::new(place, text.clone()));
            tell(format_args!("{report:?}"));
        }
        other => tell(format_args!("error: {other}")),
    }
}

/// Prints help, the version or the fault of the arguments, and returns the exit code. The method of a fit stands before
/// its options.
pub(crate) fn usage(error: &clap::Error, arguments: &[OsString]) -> u8 {
    let no_method =
        matches!(arguments, [_, fit, next, ..] if fit == "fit" && next.as_encoded_bytes().starts_with(b"-"));
    if no_method && error.kind() == ErrorKind::UnknownArgument {
        tell(
            "error: `fit` has its method before the options, as in `fleetfoot fit pwa -c robot.toml log.csv`: pwa, sparse, sindy, narx, network or parameters",
        );
        return 2;
    }
    // A reader that has closed the pipe wants no more, which is no error.
    let _ = error.print().and_then(|()| stdout().flush());
    // 0 for help, 2 for a fault.
    u8::try_from(error.exit_code()).unwrap_or(2)
}
