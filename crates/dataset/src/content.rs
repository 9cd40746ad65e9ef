//! Hash of a file's content, which identifies the same log under any name.

use std::{
    fs,
    io::Read,
    path::{Path, PathBuf},
};

use fleetfoot_data::{Cancelled, ColumnKind, Progress, parallel_map};
use fleetfoot_log::{Log, MemoryTable};
use fleetfoot_recipe::Recipe;

use crate::{error::Error, logs::Logs, statistic_error::StatisticError, stats_file::ContentHash};

/// Bytes read at once.
const BUFFER: usize = 1 << 20;
/// Rows of a table that are hashed at once.
const HASHED_ROWS: usize = 1 << 14;

/// A file or table, its hash and its size.
#[derive(Debug, Clone)]
pub struct Hashed {
    /// The file or table.
    pub log: Log,
    /// Its hash.
    pub hash: ContentHash,
    /// Its size.
    pub bytes: u64,
}

impl Hashed {
    /// The file's path; of a table its name.
    pub fn path(&self) -> &Path {
        self.log.path()
    }
}

/// Hashes logs, in order, as a recipe reads them: the files of a run as one.
///
/// # Errors
/// Those of grouping files and of reading.
pub fn hash_logs(logs: &Logs, recipe: &Recipe, progress: &dyn Progress) -> Result<Vec<Hashed>, Error> {
    let (logs, _) = logs.by(recipe)?;
    progress.stage("hashing");
    parallel_map(logs.len(), progress, |i| {
        let log = logs.all()[i].clone();
        let (hash, bytes) = match &log {
            Log::File(path) => hash_path(path, progress)?,
            Log::Run(run) => hash_files(run.files.iter().map(|(topic, path)| (topic.as_bytes(), path)), progress)?,
            Log::Table(table) => hash_table(table.as_ref(), progress)?,
        };
        Ok(Hashed { log, hash, bytes })
    })
}

/// All columns of a table, by name, kind and values.
fn hash_table(table: &dyn MemoryTable, progress: &dyn Progress) -> Result<(ContentHash, u64), Error> {
    let mut hasher = blake3::Hasher::new();
    let text = |hasher: &mut blake3::Hasher, text: &str| {
        hasher.update(&(text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    };
    let mut bytes = Vec::with_capacity(8 * HASHED_ROWS);
    for (place, column) in table.columns().iter().enumerate() {
        text(&mut hasher, &column.name);
        if let ColumnKind::Category(names) = &column.kind {
            names.iter().for_each(|name| text(&mut hasher, name));
        }
        let rows = table.rows();
        for from in (0..rows).step_by(HASHED_ROWS) {
            if progress.cancelled() {
                return Err(Cancelled.into());
            }
            let part = from..(from + HASHED_ROWS).min(rows);
            bytes.clear();
            match table.integers(place, part.clone()) {
                Some(values) => bytes.extend(values.iter().flat_map(|value| value.to_le_bytes())),
                None => {
                    let values = table.values(&[place], part);
                    bytes.extend(values.iter().flat_map(|values| values.iter()).flat_map(|value| value.to_le_bytes()));
                }
            }
            hasher.update(&bytes);
        }
    }
    Ok((ContentHash(*hasher.finalize().as_bytes()), 8 * (table.rows() * table.columns().len()) as u64))
}

/// Hashes a file, or the folder of a recording, and tells its size.
///
/// # Errors
/// Those of reading.
pub fn hash_path(path: &Path, progress: &dyn Progress) -> Result<(ContentHash, u64), Error> {
    if path.is_dir() { hash_folder(path, progress) } else { hash_file(path, progress) }
}

fn hash_file(path: &Path, progress: &dyn Progress) -> Result<(ContentHash, u64), Error> {
    let error = |source| StatisticError::Read { path: path.to_owned(), source };
    let mut file = fs::File::open(path).map_err(error)?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; BUFFER];
    loop {
        if progress.cancelled() {
            return Err(Cancelled.into());
        }
        match file.read(&mut buffer).map_err(error)? {
            0 => return Ok((ContentHash(*hasher.finalize().as_bytes()), hasher.count())),
            read => _ = hasher.update(&buffer[..read]),
        }
    }
}

fn hash_folder(folder: &Path, progress: &dyn Progress) -> Result<(ContentHash, u64), Error> {
    let error = |source| StatisticError::Read { path: folder.to_owned(), source };
    let mut inside: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(folder).map_err(error)? {
        let path = entry.map_err(error)?.path();
        if path.is_file() {
            inside.push(path);
        }
    }
    inside.sort();
    hash_files(inside.iter().map(|path| (path.file_name().unwrap_or_default().as_encoded_bytes(), path)), progress)
}

/// Files that are one log, with their names in it.
fn hash_files<'a>(
    files: impl Iterator<Item = (&'a [u8], &'a PathBuf)>,
    progress: &dyn Progress,
) -> Result<(ContentHash, u64), Error> {
    let (mut hasher, mut bytes) = (blake3::Hasher::new(), 0);
    for (name, path) in files {
        let (hash, length) = hash_file(path, progress)?;
        hasher.update(&(name.len() as u64).to_le_bytes());
        hasher.update(name);
        hasher.update(&hash.0);
        bytes += length;
    }
    Ok((ContentHash(*hasher.finalize().as_bytes()), bytes))
}
