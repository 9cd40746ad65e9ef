//! The bytes of a file, mapped into memory.

use std::{
    fs::File,
    io::{self, BufReader, Read, Write},
    ops::{Deref, Range},
    path::Path,
};

use memmap2::Mmap;

use crate::{Compression, Error, format::DATAFLASH};

/// Bytes that a compressed file may grow to, whatever its size.
const FREE_GROWTH: u64 = 1 << 30;

/// Beyond [`FREE_GROWTH`], how many times its size a compressed file may grow: robots' logs shrink by 2 to 50.
const MAX_RATIO: u64 = 1000;

/// First bytes of PX4's logs; the version follows.
pub(crate) const ULOG: &[u8] = b"ULog\x01\x12\x35";

/// Name and first bytes of a container's files.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kind {
    /// e.g. `MCAP`.
    pub(crate) name: &'static str,
    /// The first bytes.
    pub(crate) magic: &'static [u8],
}

/// A whole file in memory, page by page as it is read.
#[derive(Debug)]
pub(crate) struct Map {
    bytes: Mmap,
    /// Why the bytes end before the file does, for a compressed file that is cut.
    pub(crate) cut: Option<String>,
}

impl Deref for Map {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Map {
    /// Maps a file of a kind; a compressed one is first unpacked into an unnamed temporary file.
    pub(crate) fn open(path: &Path, compression: Compression, kind: Kind) -> Result<Self, Error> {
        let io = |source| Error::Io { path: path.into(), action: "read", source };
        let file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        if length == 0 {
            let mend = "leave it out, or copy it again: the recorder may not have closed it";
            return Err(Error::WrongFormat { path: path.into(), problem: "the file is empty".into(), mend });
        }
        let (file, cut) = match compression {
            Compression::None => (file, None),
            _ => unpack(path, file, compression, FREE_GROWTH.max(length.saturating_mul(MAX_RATIO)))?,
        };
        // SAFETY: a mapping is undefined behaviour only if the file changes or shrinks under it. An unpacked copy has no name, so that nobody can
        // change it. A log that is still being written grows at its end, beyond the length that is mapped here. A log that somebody
        // truncates or rewrites while it is read is out of our hands, as for every reader that maps files; nothing here keeps a
        // parsed invariant across two reads of the same bytes: each length is checked where it is used.
        let bytes = unsafe { Mmap::map(&file) }.map_err(|source| Error::Io {
            path: path.into(),
            action: "map into memory",
            source,
        })?;
        if !bytes.starts_with(kind.magic) {
            return Err(wrong_magic(path, &bytes, kind));
        }
        Ok(Self { bytes, cut })
    }
}

impl Map {
    /// Maps a temporary file that has no name.
    pub(crate) fn unnamed(file: &File) -> io::Result<Self> {
        // SAFETY: nobody else can change or shrink a file without a name.
        let bytes = unsafe { Mmap::map(file) }?;
        Ok(Self { bytes, cut: None })
    }

    /// Why the file is none of a kind, by its first bytes.
    pub(crate) fn refused(&self, path: &Path, kind: Kind) -> Error {
        wrong_magic(path, &self.bytes, kind)
    }

    /// Tells the system that some of the bytes are not needed soon, so that what this process has in memory does not grow with the file.
    /// They stay readable: the system's cache has them, or the disk.
    #[cfg(unix)]
    pub(crate) fn release(&self, bytes: Range<usize>) {
        use memmap2::UncheckedAdvice::DontNeed;
        if bytes.start < bytes.end && bytes.end <= self.bytes.len() {
            // SAFETY: the advice throws away what was written into private or anonymous pages. This mapping is of a file, shared, and cannot
            // be written through, so that its bytes are the same when they are read again, by whichever thread.
            // If the advice is not taken, memory is reclaimed later: nothing depends on it.
            let _ = unsafe { self.bytes.unchecked_advise_range(DontNeed, bytes.start, bytes.len()) };
        }
    }

    /// Nothing to advise here.
    #[cfg(not(unix))]
    pub(crate) fn release(&self, _bytes: Range<usize>) {}
}

/// Unpacks a file as far as it is sound, to at most `limit` bytes; the second answer is why it ends early.
fn unpack(path: &Path, file: File, compression: Compression, limit: u64) -> Result<(File, Option<String>), Error> {
    let read = |source| Error::Io { path: path.into(), action: "read", source };
    let keep = |source| Error::Io {
        path: path.into(),
        action: "keep it unpacked in a temporary file (TMPDIR sets the folder)",
        source,
    };
    let input = BufReader::with_capacity(1 << 16, file);
    let mut input: Box<dyn Read> = match compression {
        Compression::Gzip => Box::new(flate2::bufread::MultiGzDecoder::new(input)),
        _ => Box::new(zstd::Decoder::with_buffer(input).map_err(read)?),
    };
    let mut unpacked = tempfile::tempfile().map_err(keep)?;
    let mut buffer = vec![0; 1 << 20];
    let (mut total, mut cut) = (0_u64, None);
    loop {
        let count = match input.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => {
                cut = Some(format!("the compressed file is cut or damaged after {total} unpacked bytes ({error})"));
                break;
            }
        };
        total += count as u64;
        if total > limit {
            let problem = format!("it unpacks to more than {limit} bytes");
            let mend = "this does not look like a log; if it is one, unpack it by hand";
            return Err(Error::WrongFormat { path: path.into(), problem, mend });
        }
        unpacked.write_all(buffer.get(..count).unwrap_or_default()).map_err(keep)?;
    }
    if total == 0 {
        let problem = cut.unwrap_or_else(|| "nothing is packed in it".into());
        return Err(Error::WrongFormat { path: path.into(), problem, mend: "copy it again" });
    }
    Ok((unpacked, cut))
}

/// Says what a file looks like that is not of its kind.
fn wrong_magic(path: &Path, bytes: &[u8], kind: Kind) -> Error {
    let looks: [(&[u8], &str, &'static str); 14] = [
        (mcap::MAGIC, "MCAP", "give it the extension .mcap"),
        (ULOG, "ULog", "give it the extension .ulg"),
        (b"#ROSBAG V", "a ROS 1 bag", "give it the extension .bag"),
        (b"SQLite format 3\0", "an SQLite database, as rosbag2 writes them", "give it the extension .db3"),
        (DATAFLASH[0], "a log of ArduPilot", "give it the extension .bin"),
        (DATAFLASH[1], "a log of ArduPilot as text", "give it the extension .log"),
        (b"WPILOG", "a log of WPILib", "give it the extension .wpilog"),
        (b"PAR1", "Parquet", "give it the extension .parquet"),
        (&[0x28, 0xb5, 0x2f, 0xfd], "compressed by zstd", "add .zst to its name"),
        (&[0x1f, 0x8b], "compressed by gzip", "add .gz to its name"),
        (b"\x93NUMPY", "an array of NumPy", "give it the extension .npy"),
        (b"PK\x03\x04", "a zip archive", "unpack it, or give it the extension .npz if NumPy wrote it"),
        (b"MATLAB 5.0", "a file of MATLAB", "give it the extension .mat"),
        (b"\x89HDF", "HDF5", "convert it to Parquet or CSV"),
    ];
    let start = bytes.get(..bytes.len().min(512)).unwrap_or_default();
    let magic_match = looks.iter().find(|(magic, ..)| start.starts_with(magic));
    let text = start.iter().all(|&byte| byte >= 0x20 || matches!(byte, b'\t' | b'\n' | b'\r'));
    let (what, mend) = match magic_match {
        Some((_, what, mend)) => (format!("it is {what}"), *mend),
        None if kind.magic.starts_with(start) => ("only the first bytes are there".to_owned(), "copy it again"),
        None if text => ("it is text".to_owned(), "give it the extension of its format (.csv, .tsv)"),
        None if start.iter().all(|&byte| byte == 0) => {
            ("it begins with zeros, as after a loss of power or a broken copy".to_owned(), "copy it again")
        }
        None => {
            let what = format!("its first bytes are not those of {}", kind.name);
            (what, "give it the extension of its format, or copy it again")
        }
    };
    Error::WrongFormat { path: path.into(), problem: format!("the content is not {}: {what}", kind.name), mend }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIND: Kind = Kind { name: "MCAP", magic: mcap::MAGIC };

    #[test]
    fn other_files_are_recognised_by_their_first_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        for (bytes, word) in [
            (&b""[..], "empty"),
            (b"#ROSBAG V2.0\n", "ROS 1 bag"),
            (b"SQLite format 3\0....", "SQLite"),
            (b"PAR1....PAR1", "Parquet"),
            (b"\x1f\x8b\x08", "gzip"),
            (&[0x28, 0xb5, 0x2f, 0xfd, 0], "zstd"),
            (b"t,x,y\n1,2,3\n", "text"),
            (&[0; 40], "zeros"),
            (&KIND.magic[..4], "first bytes"),
            (&[1, 2, 3], "first bytes"),
        ] {
            std::fs::write(&path, bytes).unwrap();
            let message = Map::open(&path, Compression::None, KIND).unwrap_err().to_string();
            assert!(message.contains("run.mcap") && message.contains(word), "{message}");
        }
    }

    #[test]
    fn damaged_compressed_file_is_partly_unpacked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap.zst");
        // Two frames, so that the cut leaves a whole one.
        let mut bytes = zstd::encode_all(KIND.magic, 3).unwrap();
        let second = zstd::encode_all(&[7_u8; 1000][..], 3).unwrap();
        bytes.extend(&second);
        std::fs::write(&path, &bytes).unwrap();
        let map = Map::open(&path, Compression::Zstd, KIND).unwrap();
        assert_eq!((map.len(), map.cut.as_deref()), (1008, None));
        std::fs::write(&path, &bytes[..bytes.len() - 3]).unwrap();
        let map = Map::open(&path, Compression::Zstd, KIND).unwrap();
        assert!(map.len() >= 8 && map.cut.is_some());
        let file = File::open(&path).unwrap();
        assert!(unpack(&path, file, Compression::Zstd, 7).unwrap_err().to_string().contains("more than 7 bytes"));
    }
}
