//! Models as files.

use std::path::Path;

use fleetfoot_model::Model;
use fleetfoot_output::write_atomic;

use crate::error::Error;

/// Writes a model, whole or not at all.
///
/// # Errors
/// [`Error::NotFinite`]; those of writing.
pub fn write_model(model: &Model, path: &Path) -> Result<(), Error> {
    refuse_not_finite(model)?;
    Ok(write_atomic(path, model.to_json().as_bytes())?)
}

/// Refuses a model with a coefficient that is not finite: its predictions would not be finite either.
///
/// # Errors
/// [`Error::NotFinite`], with the coefficient.
pub(crate) fn refuse_not_finite(model: &Model) -> Result<(), Error> {
    model.not_finite().map_or(Ok(()), |what| Err(Error::NotFinite { what }))
}
