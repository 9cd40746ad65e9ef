//! Formats of robots' logs, all in one place.

use std::path::{Path, PathBuf};

use fleetfoot_data::Progress;

use crate::{
    Error, Format,
    container::{Container, Several},
    dataflash::DataflashContainer,
    format::is_bag,
    mcap::McapContainer,
    rosbag1::BagContainer,
    rosbag2::{self, DatabaseContainer},
    ulog::UlogContainer,
    wpilog::WpilogContainer,
};

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
    let files = std::iter::once(path).chain(further.iter().map(PathBuf::as_path));
    Ok(match format {
        Format::Mcap(compression) => {
            joined(path, files, |path| Ok(Box::new(McapContainer::open(path, compression, progress)?)))?
        }
        Format::Rosbag2 => joined(path, rosbag2::files(path)?.iter(), |(path, storage)| {
            Ok(match *storage {
                rosbag2::Storage::Mcap(compression) => Box::new(McapContainer::open(path, compression, progress)?),
                rosbag2::Storage::Database(compression) => {
                    Box::new(DatabaseContainer::open(path, compression, progress)?)
                }
            })
        })?,
        Format::Ulog(compression) => Box::new(UlogContainer::open(path, compression, progress)?),
        Format::Dataflash(compression) => Box::new(DataflashContainer::open(path, compression, progress)?),
        Format::Wpilog(compression) => Box::new(WpilogContainer::open(path, compression, progress)?),
        Format::Bag(compression) => {
            joined(path, files, |path| Ok(Box::new(BagContainer::open(path, compression, progress)?)))?
        }
        Format::Db3(compression) => {
            joined(path, files, |path| Ok(Box::new(DatabaseContainer::open(path, compression, progress)?)))?
        }
        Format::Parquet | Format::Csv(_) | Format::Npy | Format::Npz | Format::Mat => {
            return Err(Error::UnknownFormat { path: path.into() });
        }
    })
}

/// Opens the files of a recording, and joins them where there are several.
fn joined<F>(
    path: &Path,
    files: impl Iterator<Item = F>,
    open: impl Fn(F) -> Result<Box<dyn Container>, Error>,
) -> Result<Box<dyn Container>, Error> {
    let mut files: Vec<Box<dyn Container>> = files.map(open).collect::<Result<_, _>>()?;
    match files.len() {
        1 => Ok(files.swap_remove(0)),
        _ => Ok(Box::new(Several::new(path, files))),
    }
}

/// True if numbered files of a format, packed or not, may be parts of one recording.
pub(crate) fn is_split(format: Format) -> bool {
    matches!(format, Format::Mcap(_) | Format::Bag(_) | Format::Db3(_))
}

/// `Some` if a folder is one recording rather than a place for several, with the error if it cannot be read.
pub(crate) fn folder(path: &Path) -> Option<Result<(), Error>> {
    is_bag(path).then(|| rosbag2::files(path).map(drop))
}
