//! Columns separated by blanks: every run of them becomes one tab, and nothing moves, so that places in the text stay what they are.

use std::io::{self, Read};

/// What separates the cells of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Delimiter {
    /// This byte.
    Byte(u8),
    /// Any number of blanks and tabs.
    Blanks,
}

impl Delimiter {
    /// The byte that separates cells once blanks have become tabs.
    pub(super) fn byte(self) -> u8 {
        match self {
            Self::Byte(byte) => byte,
            Self::Blanks => b'\t',
        }
    }

    /// Text in which that byte separates cells.
    pub(super) fn separated<'a>(self, text: impl Read + 'a) -> Box<dyn Read + 'a> {
        match self {
            Self::Byte(_) => Box::new(text),
            Self::Blanks => Box::new(Separated::new(text)),
        }
    }

    /// For messages.
    pub(super) fn shown(self) -> char {
        match self {
            Self::Byte(byte) => char::from(byte),
            Self::Blanks => ' ',
        }
    }
}

/// Where a reader stands in a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// Before its first cell.
    Begin,
    /// In a cell.
    Cell,
    /// In a cell's quotes.
    Quoted,
    /// In the brackets of a unit: `v [m / s]` is one cell.
    Unit(u8),
}

/// Turns the first blank of every run between two cells into a tab. Blanks at the ends of a row, in quotes, before and in the brackets of a unit stay.
#[derive(Debug)]
pub(super) struct Separator {
    place: Place,
}

impl Separator {
    pub(super) fn new() -> Self {
        Self { place: Place::Begin }
    }

    /// Converts text in place; returns how many bytes are settled. The rest, blanks at the end, depends on what follows: it is to be given again, with more
    /// behind it, unless this is the end.
    pub(super) fn convert(&mut self, text: &mut [u8], is_end: bool) -> usize {
        let mut at = 0;
        while at < text.len() {
            let byte = text[at];
            if is_blank(byte) && self.place == Place::Cell {
                let run = text[at..].iter().take_while(|&&byte| is_blank(byte)).count();
                match text.get(at + run) {
                    None if !is_end => return at,
                    None | Some(b'\n' | b'\r' | b'[' | b'(') => text[at..at + run].fill(b' '),
                    Some(_) => {
                        text[at..at + run].fill(b' ');
                        text[at] = b'\t';
                    }
                }
                at += run;
                continue;
            }
            if byte == b'\t' {
                text[at] = b' ';
            }
            self.place = match (self.place, byte) {
                (_, b'\n' | b'\r') => Place::Begin,
                (Place::Begin, b' ' | b'\t') => Place::Begin,
                (Place::Begin | Place::Cell, b'"') => Place::Quoted,
                (Place::Quoted, b'"') => Place::Cell,
                (Place::Quoted, _) => Place::Quoted,
                (Place::Begin | Place::Cell, b'[') => Place::Unit(b']'),
                (Place::Begin | Place::Cell, b'(') => Place::Unit(b')'),
                (Place::Unit(close), _) if byte != close => Place::Unit(close),
                _ => Place::Cell,
            };
            at += 1;
        }
        at
    }
}

fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t')
}

/// Text whose columns blanks separate, as text whose columns tabs separate.
struct Separated<R> {
    inner: R,
    separator: Separator,
    /// Bytes that were read; those up to `settled` are converted, those up to `given` handed on.
    buffer: Vec<u8>,
    settled: usize,
    given: usize,
    ended: bool,
}

/// Bytes read at once.
const PIECE: usize = 1 << 16;

impl<R: Read> Separated<R> {
    fn new(inner: R) -> Self {
        Self { inner, separator: Separator::new(), buffer: Vec::new(), settled: 0, given: 0, ended: false }
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
            self.settled = self.separator.convert(&mut self.buffer, self.ended);
        }
        Ok(())
    }
}

impl<R: Read> Read for Separated<R> {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Hands out a few bytes at a time.
    struct Slow<'a>(&'a [u8], usize);

    impl Read for Slow<'_> {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            let count = self.1.min(out.len()).min(self.0.len());
            out[..count].copy_from_slice(&self.0[..count]);
            self.0 = &self.0[count..];
            Ok(count)
        }
    }

    #[test]
    fn one_tab_a_gap_wherever_the_reads_end() {
        let text = "  t   x [m / s]\t\tname \n0.0  1.5   \"a b\"\n\n  0.1\t 2 c  \r\n1 2 3   ";
        let expected = "  t\t  x [m / s]\t name \n0.0\t 1.5\t  \"a b\"\n\n  0.1\t 2\tc  \r\n1\t2\t3   ";
        for piece in 1..12 {
            let mut found = String::new();
            Separated::new(Slow(text.as_bytes(), piece)).read_to_string(&mut found).unwrap();
            assert_eq!(found, expected, "{piece} bytes at a time");
        }
    }
}
