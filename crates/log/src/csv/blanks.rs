//! Columns separated by blanks: every run of blanks becomes one tab without moving a byte, so that offsets in the text
//! stay the same.

use std::{borrow::Cow, io::Read};

use super::convert::{Convert, Converted};

/// Separator of the cells of a row.
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
            Self::Blanks => Box::new(Converted::new(text, Separator::new())),
        }
    }

    /// The same of text in memory.
    pub(super) fn separate(self, text: &[u8]) -> Cow<'_, [u8]> {
        match self {
            Self::Byte(_) => text.into(),
            Self::Blanks => with_tabs(text).into(),
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

/// Position of a reader in a row.
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
}

impl Convert for Separator {
    fn convert(&mut self, text: &mut [u8], is_end: bool) -> usize {
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

/// Text in which tabs stand for the runs of blanks between cells.
pub(super) fn with_tabs(bytes: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    Separator::new().convert(&mut bytes, true);
    bytes
}

fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t')
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::csv::input::tests::Slow;

    #[test]
    fn tabs_separate_across_reads() {
        let text = "  t   x [m / s]\t\tname \n0.0  1.5   \"a b\"\n\n  0.1\t 2 c  \r\n1 2 3   ";
        let expected = "  t\t  x [m / s]\t name \n0.0\t 1.5\t  \"a b\"\n\n  0.1\t 2\tc  \r\n1\t2\t3   ";
        for piece in 1..12 {
            let mut output = String::new();
            Converted::new(Slow(text.as_bytes(), piece), Separator::new()).read_to_string(&mut output).unwrap();
            assert_eq!(output, expected, "{piece} bytes at a time");
        }
    }
}
