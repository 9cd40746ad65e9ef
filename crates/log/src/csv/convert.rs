//! Reader that converts text on its way, byte for byte: offsets in the text stay the same.

use std::io::{self, Read};

/// A conversion of text that keeps its length.
pub(super) trait Convert {
    /// Converts text in place; returns how many bytes are settled. The rest depends on what follows: it is to be given again, with more behind it, unless
    /// this is the end.
    fn convert(&mut self, text: &mut [u8], is_end: bool) -> usize;
}

/// A reader of converted text.
pub(super) struct Converted<R, C> {
    inner: R,
    conversion: C,
    /// Bytes that were read; those up to `settled` are converted, those up to `given` handed on.
    buffer: Vec<u8>,
    settled: usize,
    given: usize,
    ended: bool,
}

/// Bytes read at once.
const PIECE: usize = 1 << 16;

impl<R: Read, C: Convert> Converted<R, C> {
    pub(super) fn new(inner: R, conversion: C) -> Self {
        Self { inner, conversion, buffer: Vec::new(), settled: 0, given: 0, ended: false }
    }

    fn fill(&mut self) -> io::Result<()> {
        self.buffer.drain(..self.settled);
        (self.settled, self.given) = (0, 0);
        while self.settled == 0 && !self.ended {
            let from = self.buffer.len();
            self.buffer.resize(from + PIECE, 0);
            let read = self.inner.read(&mut self.buffer[from..]);
            self.buffer.truncate(from + *read.as_ref().unwrap_or(&0));
            self.ended = read? == 0;
            self.settled = self.conversion.convert(&mut self.buffer, self.ended);
        }
        Ok(())
    }
}

impl<R: Read, C: Convert> Read for Converted<R, C> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.given == self.settled {
            self.fill()?;
        }
        let count = out.len().min(self.settled - self.given);
        out[..count].copy_from_slice(&self.buffer[self.given..self.given + count]);
        self.given += count;
        Ok(count)
    }
}
