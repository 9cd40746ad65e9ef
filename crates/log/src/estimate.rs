//! Estimate of the cost of opening a recording, before it is opened.

use std::path::Path;

use fleetfoot_data::Progress;

use crate::{Error, Estimate, Format, Log, Selection, channels, splits};

/// Estimates the cost of opening robots' logs from their indexes and a few messages. `None` when a file is another kind
/// of recording, whose rows are counted by opening it.
///
/// # Errors
/// Files that cannot be read, and columns that they do not have.
pub fn estimate<P: AsRef<Path>>(
    paths: &[P],
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Option<Estimate>, Error> {
    let mut total = Estimate { cached: true, ..Estimate::default() };
    let logs = paths.iter().map(|path| Log::File(path.as_ref().to_path_buf())).collect();
    let joined = splits::joined(logs, progress)?;
    for path in joined.logs.iter().map(Log::path) {
        let Some(format) = Format::of(path).filter(|format| format.is_log()) else { return Ok(None) };
        let rough = channels::estimate(path, format, joined.further(path), selection, progress)?;
        total.bytes += rough.bytes;
        total.rows = total.rows.saturating_add(rough.rows);
        total.decoded_bytes = total.decoded_bytes.saturating_add(rough.decoded_bytes);
        total.cached &= rough.cached;
    }
    Ok((!paths.is_empty()).then_some(total))
}
