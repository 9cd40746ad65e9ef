//! Formats of robots' logs, all in one place.

use std::path::{Path, PathBuf};

use fleetfoot_data::Progress;

use crate::{Error, Format, container::Container, format::is_bag, mcap::McapContainer, rosbag2, ulog::UlogContainer};

/// Opens a recording of messages: finds its pieces and topics. `further`: the files that go on with it.
///
/// # Errors
/// Files that are not there or are not what their name says, metadata that cannot be read, compressions that are not known, a user who
/// stops. Damage inside a file is no error.
pub(crate) fn open(
    path: &Path,
    format: Format,
    further: &[PathBuf],
    progress: &dyn Progress,
) -> Result<Box<dyn Container>, Error> {
    Ok(match format {
        Format::Mcap(compression) => {
            let files = std::iter::once(path).chain(further.iter().map(PathBuf::as_path));
            let files: Vec<_> = files.map(|file| (file.to_path_buf(), compression)).collect();
            Box::new(McapContainer::open(path, &files, progress)?)
        }
        Format::Rosbag2 => Box::new(McapContainer::open(path, &rosbag2::files(path)?, progress)?),
        Format::Ulog(compression) => Box::new(UlogContainer::open(path, compression, progress)?),
        Format::Parquet | Format::Csv(_) => return Err(Error::UnknownFormat { path: path.into() }),
    })
}

/// Decides whether a folder is one recording, and not a place for several: `None` if it is not. An error if it is one
/// that cannot be read.
pub(crate) fn folder(path: &Path) -> Option<Result<(), Error>> {
    is_bag(path).then(|| rosbag2::files(path).map(drop))
}
