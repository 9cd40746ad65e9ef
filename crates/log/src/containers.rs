//! The formats of robots' logs: the one place that knows them all.

use std::path::Path;

use fleetfoot_data::Progress;

use crate::{Error, Format, container::Container, format::is_bag, mcap::McapContainer, rosbag2, ulog::UlogContainer};

/// Opens a recording of messages: finds its pieces and topics.
///
/// # Errors
/// Files that are not there or are not what their name says, metadata that cannot be read, compressions that are not known, a user who
/// stops. Damage inside a file is no error.
pub(crate) fn open(path: &Path, format: Format, progress: &dyn Progress) -> Result<Box<dyn Container>, Error> {
    Ok(match format {
        Format::Mcap(compression) => Box::new(McapContainer::open(path, &[(path.into(), compression)], progress)?),
        Format::Rosbag2 => Box::new(McapContainer::open(path, &rosbag2::files(path)?, progress)?),
        Format::Ulog(compression) => Box::new(UlogContainer::open(path, compression, progress)?),
        Format::Parquet | Format::Csv(_) => return Err(Error::UnknownFormat { path: path.into() }),
    })
}

/// Whether a folder is one recording, not a place for several: `None` where it is not, else why it cannot be read, if so.
pub(crate) fn folder(path: &Path) -> Option<Result<(), Error>> {
    is_bag(path).then(|| rosbag2::files(path).map(drop))
}
