//! Comment lines of a text file: line ends take their place, so that no part of them is read, not even a quote.

use std::{cell::Cell, rc::Rc};

use memchr::{memchr, memchr2};

use super::{
    blanks::Delimiter,
    convert::Convert,
    dialect::{begins_comment, is_mark},
};

/// Bytes of a line that tell whether it is a comment: those of a header that comes again, or at least this many.
const TELLING: usize = 4096;

/// Comment lines that were left out.
#[derive(Clone, Default)]
pub(super) struct LeftOut {
    count: Rc<Cell<u64>>,
    first: Rc<Cell<u64>>,
    is_last: Rc<Cell<bool>>,
}

impl LeftOut {
    /// Number of comments behind the header, and the offset of the first of them.
    pub(super) fn behind_header(&self) -> (u64, u64) {
        (self.count.get(), self.first.get())
    }

    /// Returns true if the last line is a comment.
    pub(super) fn ends(&self) -> bool {
        self.is_last.get()
    }
}

/// Position of a reader in a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// Before it.
    Begin,
    /// Before a cell.
    Cell,
    /// In a cell without quotes, or behind quotes.
    Plain,
    /// In quotes.
    Quoted,
    /// In a comment.
    Comment,
}

/// Puts line ends in the place of comment lines; a header that comes again behind a mark (`%time,x`) loses the mark instead.
pub(super) struct Comments {
    delimiter: Delimiter,
    /// True if `;` begins a comment.
    semicolons: bool,
    /// The line of the header, without blanks around it.
    header: Option<Vec<u8>>,
    /// True while the header is still to come.
    above: bool,
    place: Place,
    /// Bytes behind.
    offset: u64,
    left_out: LeftOut,
}

impl Comments {
    pub(super) fn new(delimiter: Delimiter, semicolons: bool) -> Self {
        let left_out = LeftOut::default();
        Self { delimiter, semicolons, header: None, above: false, place: Place::Begin, offset: 0, left_out }
    }

    /// With the line of the header.
    pub(super) fn below(self, header: &[u8]) -> Self {
        let header = Some(header.trim_ascii().to_vec()).filter(|header| !header.is_empty());
        Self { above: header.is_some(), header, ..self }
    }

    /// Record of the comments that are left out.
    pub(super) fn left_out(&self) -> LeftOut {
        self.left_out.clone()
    }

    /// Text without its comments.
    pub(super) fn without(mut self, bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        self.convert(&mut bytes, true);
        bytes
    }

    /// Begins the line at the front of `text`: the place that follows, after so many bytes. `None` where more of the line is needed.
    fn begin(&mut self, text: &mut [u8], is_end: bool) -> Option<(Place, usize)> {
        let end = line_end(text);
        let telling = self.header.as_ref().map_or(0, |header| header.len()) + TELLING;
        let length = end.unwrap_or(text.len());
        let line = &mut text[..length];
        let first = line.iter().copied().find(|byte| !matches!(byte, b' ' | b'\t'));
        if end.is_none() && !is_end && line.len() < telling && first.is_none_or(is_mark) {
            return None;
        }
        self.left_out.is_last.set(false);
        if first.is_none() && end.is_some() {
            return Some((Place::Plain, 0));
        }
        if !begins_comment(line, self.semicolons) {
            self.above = false;
            // Nothing but a quote may go on beyond the line.
            let is_plain = end.is_some() && memchr(b'"', line).is_none();
            return Some(if is_plain { (Place::Begin, length) } else { (Place::Cell, 0) });
        }
        let marks = line.iter().take_while(|&&byte| is_mark(byte)).count();
        if self.header.as_ref().is_some_and(|header| line[marks..].trim_ascii() == header) {
            line[..marks].fill(b' ');
            self.above = false;
            return Some((Place::Cell, 0));
        }
        self.left_out.is_last.set(true);
        if !self.above {
            if self.left_out.count.get() == 0 {
                self.left_out.first.set(self.offset);
            }
            self.left_out.count.update(|count| count + 1);
        }
        Some((Place::Comment, 0))
    }

    /// Returns true if the text can contain a comment or a quote.
    fn is_telling(&self, text: &[u8]) -> bool {
        let has = |byte: u8| text.contains(&byte);
        has(b'#') || has(b'%') || has(b'/') || has(b'"') || self.semicolons && has(b';')
    }

    fn is_delimiter(&self, byte: u8) -> bool {
        match self.delimiter {
            Delimiter::Byte(delimiter) => byte == delimiter,
            Delimiter::Blanks => matches!(byte, b' ' | b'\t'),
        }
    }
}

fn is_line_end(byte: u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}

fn line_end(text: &[u8]) -> Option<usize> {
    memchr2(b'\n', b'\r', text)
}

impl Convert for Comments {
    fn convert(&mut self, text: &mut [u8], is_end: bool) -> usize {
        let before = self.offset;
        // Whole lines without a mark and a quote, as those of numbers are.
        if !is_end
            && self.place == Place::Begin
            && !self.is_telling(text)
            && let Some(end) = text.iter().rposition(|&byte| is_line_end(byte))
        {
            self.above = false;
            self.left_out.is_last.set(false);
            self.offset += 1 + end as u64;
            return 1 + end;
        }
        let mut at = 0;
        while at < text.len() {
            let (byte, rest) = (text[at], &text[at..]);
            let step = match self.place {
                Place::Begin if is_line_end(byte) => 1,
                Place::Begin => {
                    self.offset = before + at as u64;
                    let Some((place, step)) = self.begin(&mut text[at..], is_end) else { break };
                    self.place = place;
                    step
                }
                Place::Cell if byte == b'"' => {
                    self.place = Place::Quoted;
                    1
                }
                Place::Cell | Place::Plain if self.is_delimiter(byte) => {
                    self.place = Place::Cell;
                    1
                }
                Place::Cell | Place::Plain if is_line_end(byte) => {
                    self.place = Place::Begin;
                    1
                }
                Place::Cell | Place::Plain => {
                    self.place = Place::Plain;
                    let ends = |byte: &u8| is_line_end(*byte) || self.is_delimiter(*byte);
                    rest.iter().position(ends).unwrap_or(rest.len())
                }
                // A quote in quotes is written twice: the second one opens them again.
                Place::Quoted => match (memchr(b'"', rest), is_end) {
                    (None, _) => rest.len(),
                    (Some(quote), _) => match rest.get(quote + 1) {
                        Some(b'"') => quote + 2,
                        None if !is_end => {
                            at += quote;
                            break;
                        }
                        _ => {
                            self.place = Place::Plain;
                            quote + 1
                        }
                    },
                },
                Place::Comment => {
                    let end = line_end(rest);
                    let length = end.unwrap_or(rest.len());
                    text[at..at + length].fill(b'\n');
                    if end.is_some() {
                        self.place = Place::Begin;
                    }
                    length
                }
            };
            at += step;
        }
        self.offset = before + at as u64;
        at
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;
    use crate::csv::{convert::Converted, input::tests::Slow};

    #[test]
    fn comments_become_line_ends_wherever_the_reads_end() {
        let text = "%t,x\n#N/A,1\n # a \"quote\r\n\"two\n# lines \"\"of\",2\n\n // end\n/,3\n %t,x\n#lap,4\n \n;5\nx\"y,6\n#z,7";
        let at = |line: &str| text.find(line).unwrap();
        let mut expected = text.as_bytes().to_vec();
        for line in [" # a \"quote", " // end", "#lap,4", ";5", "#z,7"] {
            expected[at(line)..at(line) + line.len()].fill(b'\n');
        }
        for line in ["%t,x", " %t,x"] {
            let marks = line.len() - 3;
            expected[at(line)..at(line) + marks].fill(b' ');
        }
        for piece in 1..12 {
            let comments = Comments::new(Delimiter::Byte(b','), true).below(b"t,x");
            let left_out = comments.left_out();
            let mut output = Vec::new();
            Converted::new(Slow(text.as_bytes(), piece), comments).read_to_end(&mut output).unwrap();
            assert_eq!(String::from_utf8_lossy(&output), String::from_utf8_lossy(&expected), "{piece} bytes at a time");
            assert_eq!((left_out.behind_header(), left_out.ends()), ((5, at(" # a") as u64), true));
        }
        // `;` begins no comment if it is the delimiter.
        assert_eq!(Comments::new(Delimiter::Byte(b';'), false).without(b"a;b\n;1\n"), b"a;b\n;1\n");
    }

    #[test]
    fn a_comment_without_an_end_is_read_once() {
        let text = [b"t,x\n#".to_vec(), vec![b'-'; 8 << 20]].concat();
        let mut output = Vec::new();
        Converted::new(&text[..], Comments::new(Delimiter::Byte(b','), true)).read_to_end(&mut output).unwrap();
        assert!(output.len() == text.len() && output[4..].iter().all(|&byte| byte == b'\n'));
    }
}
