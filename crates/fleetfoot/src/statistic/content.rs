//! What a file holds, as a hash: the same log is known again whatever it is called.

use std::{
    fmt, fs,
    io::Read,
    path::{Path, PathBuf},
};

use fleetfoot_data::{Cancelled, Progress, parallel_map};

use super::StatisticError;
use crate::Error;

/// Bytes read at once.
const BUFFER: usize = 1 << 20;

/// The blake3 hash of a file's bytes; of a folder (a rosbag2 recording) of its files' names and hashes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ContentHash(pub [u8; 32]);

impl fmt::Display for ContentHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for ContentHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

/// A file, its hash and its size.
#[derive(Debug, Clone)]
pub(super) struct Hashed {
    pub(super) path: PathBuf,
    pub(super) hash: ContentHash,
    pub(super) bytes: u64,
}

/// Hashes files, in order.
pub(super) fn hash_files(files: &[PathBuf], progress: &dyn Progress) -> Result<Vec<Hashed>, Error> {
    progress.stage("hashing");
    parallel_map(files.len(), progress, |i| {
        let path = files[i].clone();
        let (hash, bytes) = if path.is_dir() { hash_folder(&path, progress)? } else { hash_file(&path, progress)? };
        Ok(Hashed { path, hash, bytes })
    })
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
    let (mut hasher, mut bytes) = (blake3::Hasher::new(), 0);
    for path in inside {
        let (hash, length) = hash_file(&path, progress)?;
        let name = path.file_name().unwrap_or_default().as_encoded_bytes();
        hasher.update(&(name.len() as u64).to_le_bytes());
        hasher.update(name);
        hasher.update(&hash.0);
        bytes += length;
    }
    Ok((ContentHash(*hasher.finalize().as_bytes()), bytes))
}
