//! File formats, by name and by content.

use std::{fs::File, io::Read, path::Path};

use crate::Error;

/// Remedy for a ROS 1 bag.
pub(crate) const CONVERT_BAG: &str =
    "convert it: `mcap convert in.bag out.mcap`, or `rosbags-convert --src in.bag --dst out --dst-storage mcap`";

/// Remedy for a rosbag2 database.
pub(crate) const CONVERT_DB3: &str = "convert its folder: `ros2 bag convert -i FOLDER -o out.yaml`, where out.yaml says `output_bags: [{uri: NEW_FOLDER, storage_id: mcap, all: true}]`";

/// The file that makes a folder a rosbag2 recording.
pub(crate) const BAG_METADATA: &str = "metadata.yaml";

/// The key under which everything stands in it.
pub(crate) const BAG_KEY: &[u8] = b"rosbag2_bagfile_information";

/// A readable file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Apache Parquet.
    Parquet,
    /// Delimited text.
    Csv(Compression),
    /// A robot's log in one MCAP file.
    Mcap(Compression),
    /// A log of PX4. Its topics are `/vehicle_attitude`, and `/sensor_accel.1` for a further instance; fields have the names that pyulog gives
    /// them.
    Ulog(Compression),
    /// A folder of MCAP files with the `metadata.yaml` of rosbag2: one recording.
    Rosbag2,
}

/// Compression of a whole file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Compression {
    /// Not at all.
    None,
    /// gzip, one or several members.
    Gzip,
    /// Zstandard, one or several frames.
    Zstd,
}

impl Format {
    /// The format that a file's name tells; for a folder, its `metadata.yaml`.
    pub fn of(path: &Path) -> Option<Self> {
        if is_bag(path) {
            return Some(Self::Rosbag2);
        }
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let (stem, compression) = match name.rsplit_once('.') {
            Some((stem, "gz")) => (stem, Compression::Gzip),
            Some((stem, "zst" | "zstd")) => (stem, Compression::Zstd),
            _ => (name.as_str(), Compression::None),
        };
        match (stem.rsplit_once('.')?.1, compression) {
            ("parquet" | "pq", Compression::None) => Some(Self::Parquet),
            ("csv" | "tsv" | "txt", compression) => Some(Self::Csv(compression)),
            ("mcap", compression) => Some(Self::Mcap(compression)),
            ("ulg", compression) => Some(Self::Ulog(compression)),
            _ => None,
        }
    }

    /// Returns true for a robot's log: messages by topic, not rows of a table.
    pub fn is_log(self) -> bool {
        !matches!(self, Self::Parquet | Self::Csv(_))
    }

    /// Why a robot's log in another format cannot be read, and how to convert it; `None` for all other files.
    pub(crate) fn foreign(path: &Path) -> Option<Error> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        let (problem, mend) = match extension.as_str() {
            "bag" => ("ROS 1 bags are not read", CONVERT_BAG),
            "db3" => ("rosbag2 databases (sqlite3) are not read", CONVERT_DB3),
            _ => return None,
        };
        Some(Error::WrongFormat { path: path.into(), problem: problem.into(), mend })
    }

    /// A word for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parquet => "Parquet",
            Self::Csv(Compression::None) => "CSV",
            Self::Csv(Compression::Gzip) => "CSV (gzip)",
            Self::Csv(Compression::Zstd) => "CSV (zstd)",
            Self::Mcap(Compression::None) => "MCAP",
            Self::Mcap(Compression::Gzip) => "MCAP (gzip)",
            Self::Mcap(Compression::Zstd) => "MCAP (zstd)",
            Self::Ulog(Compression::None) => "ULog",
            Self::Ulog(Compression::Gzip) => "ULog (gzip)",
            Self::Ulog(Compression::Zstd) => "ULog (zstd)",
            Self::Rosbag2 => "rosbag2 (MCAP)",
        }
    }
}

/// Returns true if a folder is a rosbag2 recording. A `metadata.yaml` of something else does not make it one.
pub(crate) fn is_bag(folder: &Path) -> bool {
    let path = folder.join(BAG_METADATA);
    path.is_file()
        && File::open(path).is_ok_and(|file| {
            let mut start = Vec::new();
            // The key is the first of the document; comments may stand before it.
            file.take(1 << 16).read_to_end(&mut start).is_ok()
                && start.windows(BAG_KEY.len()).any(|window| window == BAG_KEY)
        })
}
