//! Code and documents made from a model, tested against the engine before they are written.

mod engine;

use std::path::{Path, PathBuf};

use fleetfoot_codegen::{Cost, ExportOptions, ExportedFile, Target, TestVector, test_vectors};
use fleetfoot_data::setting::TO;
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_output::{check_outputs, together, write_atomic};
use fleetfoot_recipe::FilterSection;

use crate::ControllerFile;

/// Test vectors of exported C.
const VECTORS: usize = 32;

/// Seed of the test vectors' points.
const SEED: u64 = 1;

/// Files that an export wrote.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Exported {
    /// The files.
    pub files: Vec<PathBuf>,
    /// Cost of the code; `None` for documents.
    pub cost: Option<Cost>,
    /// Points at which the code and the engine were compared.
    pub compared: usize,
}

/// Writes a model in another language into a folder.
///
/// Code (C, Rust, Python) is compared with the engine first, at points drawn within the training domain ([`engine_vectors`]). The test of C compares with the engine's values.
///
/// `inputs` are files that must not be written over, the model's own among them.
///
/// # Errors
/// [`Error::Export`]; [`Cause::Internal`](fleetfoot_recipe::Cause::Internal) where the code and the engine disagree; those of writing.
pub fn export(model: &Model, options: &ExportOptions, folder: &Path, inputs: &[PathBuf]) -> Result<Exported, Error> {
    let vectors = match options.target {
        Target::C | Target::Rust | Target::Python => engine_vectors(model, options, VECTORS, SEED)?,
        Target::Latex | Target::Npz | Target::Onnx => Vec::new(),
    };
    let exported = fleetfoot_codegen::export(model, options, &vectors)?;
    let files = write(&exported.files, folder, inputs)?;
    Ok(Exported { files, cost: exported.cost, compared: vectors.len() })
}

/// Writes the law of a controller in another language into a folder, as [`export`] writes a model; a predictive
/// controller as C, whose test program holds the engine's commands.
///
/// # Errors
/// Those of [`export`]; a predictive controller in another language than C.
pub fn export_controller(
    made: &ControllerFile,
    options: &ExportOptions,
    folder: &Path,
    inputs: &[PathBuf],
) -> Result<Exported, Error> {
    if made.law.prediction.is_none() {
        return export(&made.law_model()?, options, folder, inputs);
    }
    if options.target != Target::C {
        return Err(Error::conflict(format!(
            "predictive controllers are written as C: export with {given_to}",
            given_to = TO.to("c")
        )));
    }
    let files = write(&fleetfoot_codegen::export_predictive(&made.law, options)?, folder, inputs)?;
    Ok(Exported { files, cost: None, compared: 0 })
}

/// Writes the filter of a model as C into a folder, by the settings of `[filter]`: `PREFIX_filter.h` and
/// `PREFIX_filter.c`.
///
/// # Errors
/// Those of [`crate::filter_of`]; another language than C, regions that are not affine; [`Error::Export`], those of writing.
pub fn export_filter(
    model: &Model,
    section: &FilterSection,
    options: &ExportOptions,
    folder: &Path,
    inputs: &[PathBuf],
) -> Result<Vec<PathBuf>, Error> {
    if options.target != Target::C {
        return Err(Error::conflict(format!(
            "filters are written as C: export with {given_to}",
            given_to = TO.to("c")
        )));
    }
    let filter = crate::filter_of(model, section)?;
    let tables = filter.tables().ok_or_else(|| {
        Error::conflict(
            "the regions of the model are not affine, so that code would have to linearise them at every step: leave the states whose equations multiply or rotate others out of the model"
                .to_owned(),
        )
    })?;
    let exported = fleetfoot_codegen::export_filter(model, &tables, options)?;
    write(&exported, folder, inputs)
}

/// Writes files into a folder: all of them or none.
fn write(exported: &[ExportedFile], folder: &Path, inputs: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    std::fs::create_dir_all(folder)
        .map_err(|source| fleetfoot_dataset::Error::Write { path: folder.to_owned(), source })?;
    let files: Vec<PathBuf> = exported.iter().map(|file| folder.join(&file.name)).collect();
    check_outputs(&files, inputs)?;
    together(|| files.iter().zip(exported).try_for_each(|(path, file)| write_atomic(path, &file.bytes)))?;
    Ok(files)
}

/// Test vectors with the engine's values: next states from a rollout of one step, outputs from a prediction.
///
/// # Errors
/// [`Error::Export`]; [`Cause::Internal`](fleetfoot_recipe::Cause::Internal) where the code, interpreted, and the engine differ by more than rounding or give different regions.
pub fn engine_vectors(
    model: &Model,
    options: &ExportOptions,
    count: usize,
    seed: u64,
) -> Result<Vec<TestVector>, Error> {
    let mut vectors = test_vectors(model, options, count, seed)?;
    engine::replace(model, options, &mut vectors)?;
    Ok(vectors)
}
