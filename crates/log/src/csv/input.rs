//! The bytes of a text file: decompressed, and watched.

use std::{
    cell::Cell,
    fs::File,
    io::{self, BufRead, BufReader, Read},
    path::Path,
    rc::Rc,
};

use crate::{Compression, Error};

/// Bytes that one row may have; more means an unclosed quote or no text at all.
const MAX_ROW: usize = 64 << 20;

/// Opens a file and decompresses it; zero bytes at its end are left out.
pub(super) fn open(path: &Path, compression: Compression) -> Result<Box<dyn Read>, Error> {
    let io = |source| Error::Io { path: path.into(), action: "read", source };
    let file = File::open(path).map_err(io)?;
    let buffered = |file| BufReader::with_capacity(1 << 16, file);
    Ok(match compression {
        Compression::None => Box::new(WithoutZeroTail::new(file)),
        Compression::Gzip => Box::new(WithoutZeroTail::new(flate2::bufread::MultiGzDecoder::new(buffered(file)))),
        Compression::Zstd => Box::new(WithoutZeroTail::new(zstd::Decoder::new(file).map_err(io)?)),
    })
}

/// Skips the zero bytes at the end of a file, which a logger writes when it loses its power. Zeros before other bytes
/// are passed on.
struct WithoutZeroTail<R> {
    inner: R,
    /// Number of zeros that were read; the bytes from `given` on follow them.
    held: usize,
    bytes: Vec<u8>,
    given: usize,
}

/// Bytes read at once.
const PIECE: usize = 1 << 16;

impl<R: Read> WithoutZeroTail<R> {
    fn new(inner: R) -> Self {
        Self { inner, held: 0, bytes: Vec::new(), given: 0 }
    }

    /// Reads on until something else than a zero is there, or the end.
    fn fill(&mut self) -> io::Result<()> {
        while self.given == self.bytes.len() {
            self.bytes.resize(PIECE, 0);
            self.given = 0;
            let read = self.inner.read(&mut self.bytes);
            self.bytes.truncate(*read.as_ref().unwrap_or(&0));
            if read? == 0 {
                self.held = 0;
                return Ok(());
            }
            let zeros = self.bytes.iter().take_while(|&&byte| byte == 0).count();
            self.held += zeros;
            self.given = zeros;
        }
        Ok(())
    }
}

impl<R: Read> Read for WithoutZeroTail<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        self.fill()?;
        if self.held > 0 {
            let count = self.held.min(out.len());
            out[..count].fill(0);
            self.held -= count;
            return Ok(count);
        }
        let left = &self.bytes[self.given..];
        // Up to the next zero: what follows may be the end.
        let count = left.iter().take(out.len()).take_while(|&&byte| byte != 0).count();
        out[..count].copy_from_slice(&left[..count]);
        self.given += count;
        let zeros = self.bytes[self.given..].iter().take_while(|&&byte| byte == 0).count();
        self.given += zeros;
        self.held += zeros;
        Ok(count)
    }
}

/// Reads on and remembers: how much since the last row, and the last byte.
pub(super) struct Watched<R> {
    inner: R,
    shared: Watch,
}

/// Position of a [`Watched`] reader since the last row and line.
#[derive(Clone, Default)]
pub(super) struct Watch {
    since_row: Rc<Cell<usize>>,
    last: Rc<Cell<Option<u8>>>,
}

impl Watch {
    /// A row is complete.
    pub(super) fn row(&self) {
        self.since_row.set(0);
    }

    /// Returns true if the bytes so far end with a line.
    pub(super) fn ends_with_line(&self) -> bool {
        matches!(self.last.get(), None | Some(b'\n' | b'\r'))
    }
}

impl<R: Read> Watched<R> {
    pub(super) fn new(inner: R) -> (Self, Watch) {
        let shared = Watch::default();
        (Self { inner, shared: shared.clone() }, shared)
    }
}

impl<R: Read> Read for Watched<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        let since = self.shared.since_row.get() + count;
        self.shared.since_row.set(since);
        if since > MAX_ROW {
            let problem = "a row of more than 64 MiB: an unclosed quote, or no text at all";
            return Err(io::Error::new(io::ErrorKind::InvalidData, problem));
        }
        if let Some(&last) = buffer[..count].last() {
            self.shared.last.set(Some(last));
        }
        Ok(count)
    }
}

/// Error while reading, from the operating system or the decompressors.
pub(super) fn read_error(path: &Path, compression: Compression, place: String, source: io::Error) -> Error {
    let mend = match (compression, source.kind()) {
        (Compression::None, io::ErrorKind::InvalidData) => {
            "close the quote, or give the file the extension of what it is"
        }
        (Compression::None, _) => {
            return Error::Io { path: path.into(), action: "read", source };
        }
        _ => "the compressed file is cut or damaged: copy it again, or save what is left with `zcat` or `zstdcat`",
    };
    Error::Damaged { path: path.into(), place, problem: source.to_string(), mend }
}

/// The line, from 1, that begins at `offset` or after the lines there that are to be skipped. Reads the file again: only for messages.
pub(super) fn line_of(path: &Path, compression: Compression, offset: u64, is_skipped: impl Fn(&[u8]) -> bool) -> u64 {
    let Ok(input) = open(path, compression) else {
        return 0;
    };
    let mut line = 1;
    let mut input = BufReader::with_capacity(1 << 16, input);
    for byte in input.by_ref().bytes().take(usize::try_from(offset).unwrap_or(usize::MAX)) {
        line += u64::from(matches!(byte, Ok(b'\n')));
    }
    let mut text = Vec::new();
    while input.read_until(b'\n', &mut text).is_ok_and(|read| read > 0) && is_skipped(&text) {
        line += 1;
        text.clear();
    }
    line
}

/// A reader of rows, with the habits of all places that read text.
pub(super) fn reader<R: Read>(input: R, delimiter: u8) -> csv::Reader<R> {
    csv::ReaderBuilder::new()
        .delimiter(delimiter)
        .has_headers(false)
        .flexible(true)
        .buffer_capacity(1 << 16)
        .from_reader(input)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A reader that hands out a few bytes at a time.
    pub(in crate::csv) struct Slow<'a>(pub &'a [u8], pub usize);

    impl Read for Slow<'_> {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            let count = self.1.min(out.len()).min(self.0.len());
            out[..count].copy_from_slice(&self.0[..count]);
            self.0 = &self.0[count..];
            Ok(count)
        }
    }

    #[test]
    fn only_trailing_zeros_are_dropped() {
        for (bytes, expected) in [
            (&b"a,b\n1,2\n\0\0\0\0"[..], &b"a,b\n1,2\n"[..]),
            (b"\0\0a\0\0b\0", b"\0\0a\0\0b"),
            (b"\0\0\0", b""),
            (b"abc", b"abc"),
            (b"", b""),
        ] {
            for piece in [1, 2, 3, 100] {
                let mut output = Vec::new();
                WithoutZeroTail::new(Slow(bytes, piece)).read_to_end(&mut output).unwrap();
                assert_eq!(output, expected, "{piece} bytes at a time");
                let mut output = Vec::new();
                let mut one = [0];
                let mut reader = WithoutZeroTail::new(Slow(bytes, piece));
                while reader.read(&mut one).unwrap() == 1 {
                    output.push(one[0]);
                }
                assert_eq!(output, expected, "{piece} bytes at a time, one by one");
            }
        }
    }
}
