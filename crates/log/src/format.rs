//! File formats, by name and by content.

use std::{fs::File, io::Read, path::Path};

/// The file that makes a folder a rosbag2 recording.
pub(crate) const BAG_METADATA: &str = "metadata.yaml";

/// The key under which everything stands in it.
pub(crate) const BAG_KEY: &[u8] = b"rosbag2_bagfile_information";

/// First bytes of ArduPilot logs: a message that defines the first type, binary or as text.
pub(crate) const DATAFLASH: [&[u8]; 2] = [&[0xa3, 0x95, 0x80], b"FMT,"];

/// A readable file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Apache Parquet.
    Parquet,
    /// Delimited text.
    Csv(Compression),
    /// One array of NumPy (`.npy`).
    Npy,
    /// Arrays of NumPy by their names (`.npz`).
    Npz,
    /// Variables of MATLAB (`.mat`, up to `save -v7`).
    Mat,
    /// A robot's log in one MCAP file.
    Mcap(Compression),
    /// A log of PX4. Its topics are `/vehicle_attitude`, and `/sensor_accel.1` for a further instance; fields have the names that pyulog gives
    /// them.
    Ulog(Compression),
    /// A log of ArduPilot, binary (`.bin`) or as text (`.log`). Its topics are `/ATT`, and `/IMU.1` for a further instance.
    Dataflash(Compression),
    /// A log of WPILib. Its topics are the entries with a slash at the beginning (`/NT:/pose`).
    Wpilog(Compression),
    /// A recording of ROS 1 in one bag.
    Bag(Compression),
    /// A recording of rosbag2 in one SQLite database.
    Db3(Compression),
    /// A folder of MCAP files or of databases with the `metadata.yaml` of rosbag2: one recording.
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
            ("npy", Compression::None) => Some(Self::Npy),
            ("npz", Compression::None) => Some(Self::Npz),
            ("mat", Compression::None) => Some(Self::Mat),
            ("csv" | "tsv" | "txt", compression) => Some(Self::Csv(compression)),
            ("mcap", compression) => Some(Self::Mcap(compression)),
            ("ulg", compression) => Some(Self::Ulog(compression)),
            ("bin" | "log", compression) => Some(Self::Dataflash(compression)),
            ("wpilog", compression) => Some(Self::Wpilog(compression)),
            ("bag", compression) => Some(Self::Bag(compression)),
            ("db3", compression) => Some(Self::Db3(compression)),
            _ => None,
        }
    }

    /// The format of a file that was found, not named: files of many programs end in `.bin` and `.log`, so that their first bytes decide.
    pub fn detect(path: &Path) -> Option<Self> {
        let format = Self::of(path)?;
        match format {
            Self::Dataflash(compression) => {
                let start = start(path, compression);
                DATAFLASH.iter().any(|magic| start.starts_with(magic)).then_some(format)
            }
            _ => Some(format),
        }
    }

    /// True for a robot's log (messages by topic), false for a table of rows.
    pub fn is_log(self) -> bool {
        !matches!(self, Self::Parquet | Self::Csv(_) | Self::Npy | Self::Npz | Self::Mat)
    }

    /// A word for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parquet => "Parquet",
            Self::Npy => "NumPy (.npy)",
            Self::Npz => "NumPy (.npz)",
            Self::Mat => "MATLAB",
            Self::Csv(Compression::None) => "CSV",
            Self::Csv(Compression::Gzip) => "CSV (gzip)",
            Self::Csv(Compression::Zstd) => "CSV (zstd)",
            Self::Mcap(Compression::None) => "MCAP",
            Self::Mcap(Compression::Gzip) => "MCAP (gzip)",
            Self::Mcap(Compression::Zstd) => "MCAP (zstd)",
            Self::Ulog(Compression::None) => "ULog",
            Self::Ulog(Compression::Gzip) => "ULog (gzip)",
            Self::Ulog(Compression::Zstd) => "ULog (zstd)",
            Self::Dataflash(Compression::None) => "ArduPilot DataFlash",
            Self::Dataflash(Compression::Gzip) => "ArduPilot DataFlash (gzip)",
            Self::Dataflash(Compression::Zstd) => "ArduPilot DataFlash (zstd)",
            Self::Wpilog(Compression::None) => "WPILOG",
            Self::Wpilog(Compression::Gzip) => "WPILOG (gzip)",
            Self::Wpilog(Compression::Zstd) => "WPILOG (zstd)",
            Self::Bag(Compression::None) => "ROS 1 bag",
            Self::Bag(Compression::Gzip) => "ROS 1 bag (gzip)",
            Self::Bag(Compression::Zstd) => "ROS 1 bag (zstd)",
            Self::Db3(Compression::None) => "rosbag2 (SQLite)",
            Self::Db3(Compression::Gzip) => "rosbag2 (SQLite, gzip)",
            Self::Db3(Compression::Zstd) => "rosbag2 (SQLite, zstd)",
            Self::Rosbag2 => "rosbag2",
        }
    }
}

/// The first bytes of a file, as far as they can be read.
fn start(path: &Path, compression: Compression) -> Vec<u8> {
    let Ok(file) = File::open(path) else { return Vec::new() };
    let file: Box<dyn Read> = match compression {
        Compression::None => Box::new(file),
        Compression::Gzip => Box::new(flate2::read::MultiGzDecoder::new(file)),
        Compression::Zstd => match zstd::Decoder::new(file) {
            Ok(decoder) => Box::new(decoder),
            Err(_) => return Vec::new(),
        },
    };
    let mut start = Vec::new();
    // Bytes that were read before an error stay.
    let _ = file.take(16).read_to_end(&mut start);
    start
}

/// True if a folder is a rosbag2 recording. A `metadata.yaml` of something else does not make it one.
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
