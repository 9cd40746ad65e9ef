//! The folder of a result: all files of it, or none.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use fleetfoot_codegen::{ExportOptions, Target};
use fleetfoot_data::Progress;
use fleetfoot_data::setting::FORCE;
use fleetfoot_dataset::{Error as DatasetError, Logs, Part};
use fleetfoot_fit::{Error, write_model};
use fleetfoot_output::write_atomic;
use fleetfoot_page::{ReportOptions, report};
use fleetfoot_recipe::Recipe;

use crate::Auto;

/// The files of a result.
pub const FILES: [&str; 4] = ["model.json", "recipe.toml", "report.html", "auto.json"];
/// The folder of the exported code.
const CODE: &str = "c";

/// Output of a result.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AutoOutput {
    /// The folder, which must not be there.
    pub folder: PathBuf,
    /// Replace the folder of an earlier result.
    pub force: bool,
    /// Write the model as C, too.
    pub c: bool,
}

impl AutoOutput {
    /// Checks the folder before the work.
    ///
    /// # Errors
    /// It is there; with `force`, it holds other files than those of a result.
    pub fn check(&self, inputs: &[PathBuf]) -> Result<(), Error> {
        let folder = self.folder.display();
        let whole = |path: &Path| fs::canonicalize(path).ok();
        let folder_path = whole(&self.folder);
        let within = |input: &&PathBuf| {
            folder_path
                .as_ref()
                .is_some_and(|folder_path| whole(input).is_some_and(|path| path.starts_with(folder_path)))
        };
        // A recipe that an earlier result has is read before its folder is replaced.
        if let Some(input) = inputs.iter().filter(|input| !input.ends_with(FILES[1])).find(within) {
            return Err(Error::output(format!(
                "{folder}: {} is read from it, and would be replaced; name another folder (-o)",
                input.display()
            )));
        }
        let entries = match fs::read_dir(&self.folder) {
            Err(problem) if problem.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(source) => return Err(written(&self.folder, source)),
            Ok(entries) => entries,
        };
        if !self.force {
            return Err(Error::output(format!(
                "{folder} exists already; name another folder (-o), or replace it with {FORCE}"
            )));
        }
        for entry in entries {
            let entry = entry.map_err(|source| written(&self.folder, source))?;
            let name = entry.file_name().to_string_lossy().into_owned();
            if name != CODE && !FILES.contains(&name.as_str()) {
                return Err(Error::output(format!(
                    "{folder}: {FORCE} replaces the folder of an earlier `auto`, and {name} is none of its files; name another folder (-o)"
                )));
            }
        }
        Ok(())
    }
}

/// The parent of a folder that may be named without one.
fn parent(folder: &Path) -> PathBuf {
    match folder.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}

fn written(path: &Path, source: io::Error) -> Error {
    DatasetError::Write { path: path.to_owned(), source }.into()
}

impl Auto {
    /// Writes model, recipe, page and summary into a folder, and the code on request. They are made beside the folder,
    /// which appears whole or not at all.
    ///
    /// # Errors
    /// Those of [`AutoOutput::check`], of the page, of the export and of writing.
    pub fn write(&self, output: &AutoOutput, logs: &Logs, progress: &dyn Progress) -> Result<Vec<PathBuf>, Error> {
        let inputs = logs.files();
        output.check(&inputs)?;
        let beside = parent(&output.folder);
        fs::create_dir_all(&beside).map_err(|source| written(&beside, source))?;
        let staging = tempfile::Builder::new()
            .prefix(".generating-")
            .tempdir_in(&beside)
            .map_err(|source| written(&beside, source))?;
        let folder = staging.path().join("result");
        fs::create_dir(&folder).map_err(|source| written(&folder, source))?;
        write_model(&self.model, &folder.join(FILES[0]))?;
        write_atomic(folder.join(FILES[1]), self.recipe.to_toml().as_bytes())?;
        self.page(logs, progress)?.write(&folder.join(FILES[2]), &inputs)?;
        let mut summary = serde_json::to_string_pretty(&self.summary()).unwrap_or_default();
        summary.push('\n');
        write_atomic(folder.join(FILES[3]), summary.as_bytes())?;
        let mut names: Vec<String> = FILES.map(str::to_owned).to_vec();
        if output.c {
            let mut options = ExportOptions::new(Target::C);
            options.prefix = "model".into();
            let exported = fleetfoot_run::export(&self.model, &options, &folder.join(CODE), &inputs)?;
            let name = |path: &PathBuf| path.file_name().map(|name| format!("{CODE}/{}", name.to_string_lossy()));
            names.extend(exported.files.iter().filter_map(name));
        }
        put(&folder, &output.folder, staging.path())?;
        Ok(names.into_iter().map(|name| output.folder.join(name)).collect())
    }

    /// The page of the model and the linear one on the test rows.
    fn page(&self, logs: &Logs, progress: &dyn Progress) -> Result<fleetfoot_page::Report, Error> {
        let mut models = vec![("model".to_owned(), self.model.clone())];
        // A model of longer steps has rows of its own.
        models
            .extend(self.linear.iter().filter(|_| self.every == 1).map(|linear| ("linear".to_owned(), linear.clone())));
        let mut options = ReportOptions::default();
        (options.title, options.horizon, options.starts) =
            (Some("A model by fleetfoot auto".into()), Some(self.horizon.at_every(self.every).steps), 200);
        options.fits = vec![self.fit.clone()];
        let changes = Recipe { cache: self.recipe.cache.clone(), ..Recipe::default() };
        report(&models, &changes, logs.only(Part::Test), &options, progress)
    }
}

/// Moves a finished folder to its place; one that is there goes out of the way first, and back where the move fails.
fn put(made: &Path, target: &Path, staging: &Path) -> Result<(), Error> {
    let old = staging.join("old");
    let replaced = target.exists();
    if replaced {
        fs::rename(target, &old).map_err(|source| written(target, source))?;
    }
    fs::rename(made, target).map_err(|source| {
        if replaced {
            // The error says where the new files could not go; the old ones are back, or in the staging folder.
            let _ = fs::rename(&old, target);
        }
        written(target, source)
    })
}
