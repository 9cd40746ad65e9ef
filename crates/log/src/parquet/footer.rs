//! The footer of a Parquet file, checked before its use.
//!
//! The decoder of the `parquet` crate reserves memory for as many row groups and children as the footer claims. A walk
//! over the bytes (Thrift's compact protocol) refuses lists that are longer than the footer, and schemas that nest
//! without end. A damaged or hostile footer therefore costs an error and not the process.

use std::{fs::File, path::Path};

use crate::{Error, file_io::read_exact_at};

/// Levels of nesting that are followed, of structures and of the schema.
const MAX_DEPTH: usize = 64;
/// Bytes of a footer that are read.
const MAX_LENGTH: u64 = 1 << 30;

/// Reads and checks the bytes of the footer of a file of `length` bytes.
pub(super) fn read(path: &Path, file: &File, length: u64) -> Result<Vec<u8>, Error> {
    let io = |source| Error::Io { path: path.into(), action: "read", source };
    let wrong = |problem: &str, mend| Error::WrongFormat { path: path.into(), problem: problem.into(), mend };
    if length == 0 {
        return Err(wrong("the file is empty", "record or copy it again"));
    }
    let mut start = [0u8; 4];
    let head = length.min(4) as usize;
    read_exact_at(file, &mut start[..head], 0).map_err(io)?;
    match &start {
        b"PAR1" => {}
        b"PARE" => return Err(wrong("its footer is encrypted", "decrypt it first")),
        _ => {
            return Err(wrong(
                "it does not begin as a Parquet file does",
                "give it the extension of its format, or write it again",
            ));
        }
    }
    let truncated = || {
        wrong("the file ends early: its footer is missing", "copy it again, or let the program that writes it finish")
    };
    if length < 12 {
        return Err(truncated());
    }
    let mut tail = [0u8; 8];
    read_exact_at(file, &mut tail, length - 8).map_err(io)?;
    let size = u64::from(u32::from_le_bytes([tail[0], tail[1], tail[2], tail[3]]));
    match &tail[4..] {
        b"PAR1" => {}
        b"PARE" => return Err(wrong("its footer is encrypted", "decrypt it first")),
        _ => return Err(truncated()),
    }
    if size > length - 12 || size > MAX_LENGTH {
        return Err(damaged(path, &format!("it claims {size} bytes in a file of {length}")));
    }
    let mut bytes = vec![0; size as usize];
    read_exact_at(file, &mut bytes, length - 8 - size).map_err(io)?;
    check(&bytes).map_err(|problem| damaged(path, problem))?;
    Ok(bytes)
}

fn damaged(path: &Path, problem: &str) -> Error {
    Error::Damaged {
        path: path.into(),
        place: "its footer".into(),
        problem: problem.into(),
        mend: "copy or write the file again",
    }
}

/// Walks over the whole footer.
fn check(bytes: &[u8]) -> Result<(), &'static str> {
    let mut walk = Walk { bytes };
    let mut last = 0;
    while let Some((kind, id)) = walk.field(&mut last)? {
        if id == 2 && kind == 9 { walk.schema()? } else { walk.skip(kind, 0)? }
    }
    Ok(())
}

struct Walk<'a> {
    bytes: &'a [u8],
}

impl Walk<'_> {
    fn byte(&mut self) -> Result<u8, &'static str> {
        let (&first, rest) = self.bytes.split_first().ok_or("it ends early")?;
        self.bytes = rest;
        Ok(first)
    }

    fn advance(&mut self, count: u64) -> Result<(), &'static str> {
        self.bytes = usize::try_from(count)
            .ok()
            .and_then(|count| self.bytes.get(count..))
            .ok_or("a text is longer than the footer")?;
        Ok(())
    }

    fn varint(&mut self) -> Result<u64, &'static str> {
        let mut value = 0;
        for shift in (0..70).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f).checked_shl(shift).unwrap_or(0);
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err("a number is too long")
    }

    fn signed(&mut self) -> Result<i64, &'static str> {
        let value = self.varint()?;
        Ok((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    /// The type and the number of the next field of a structure; `None` at its end.
    fn field(&mut self, last: &mut i64) -> Result<Option<(u8, i64)>, &'static str> {
        let head = self.byte()?;
        if head == 0 {
            return Ok(None);
        }
        *last = match head >> 4 {
            0 => self.signed()?,
            step => last.wrapping_add(i64::from(step)),
        };
        Ok(Some((head & 15, *last)))
    }

    /// The element type and the length of a list.
    fn list(&mut self) -> Result<(u8, u64), &'static str> {
        let head = self.byte()?;
        let count = if head >> 4 == 15 { self.varint()? } else { u64::from(head >> 4) };
        if count > self.bytes.len() as u64 {
            return Err("a list is longer than the footer");
        }
        Ok((head & 15, count))
    }

    fn skip(&mut self, kind: u8, depth: usize) -> Result<(), &'static str> {
        if depth > MAX_DEPTH {
            return Err("it nests too deep");
        }
        match kind {
            1 | 2 => Ok(()),
            3 => self.byte().map(drop),
            4..=6 => self.varint().map(drop),
            7 => self.advance(8),
            8 => {
                let length = self.varint()?;
                self.advance(length)
            }
            9 | 10 => {
                let (element, count) = self.list()?;
                for _ in 0..count {
                    // Truth values take a byte in a list, and none in a structure.
                    if element <= 2 { self.byte().map(drop)? } else { self.skip(element, depth + 1)? }
                }
                Ok(())
            }
            12 => {
                let mut last = 0;
                while let Some((kind, _)) = self.field(&mut last)? {
                    self.skip(kind, depth + 1)?;
                }
                Ok(())
            }
            _ => Err("it holds a field of an unknown type"),
        }
    }

    /// The flattened schema tree: no element may claim more children than there are elements.
    fn schema(&mut self) -> Result<(), &'static str> {
        let (element, count) = self.list()?;
        if element != 12 {
            return Err("its schema is not a list of structures");
        }
        let mut open: Vec<u64> = Vec::new();
        for left in (0..count).rev() {
            let (mut last, mut children) = (0, 0);
            while let Some((kind, id)) = self.field(&mut last)? {
                if id == 5 && kind == 5 {
                    children = self.signed()?;
                } else {
                    self.skip(kind, 0)?;
                }
            }
            let children = u64::try_from(children).map_err(|_| "its schema has a negative count")?;
            if children > left {
                return Err("its schema claims more columns than it lists");
            }
            while open.last() == Some(&0) {
                open.pop();
            }
            if let Some(siblings) = open.last_mut() {
                *siblings -= 1;
            }
            if children > 0 {
                open.push(children);
            }
            if open.len() > MAX_DEPTH {
                return Err("its schema nests too deep");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_longer_than_the_footer_are_refused() {
        // version = 1; then field 4 (row groups) as a list of 2^31 - 1 structures.
        let bomb = [0x15, 0x02, 0x39, 0xfc, 0xff, 0xff, 0xff, 0xff, 0x07, 0x00];
        assert_eq!(check(&bomb), Err("a list is longer than the footer"));
    }

    #[test]
    fn malformed_schemas_are_refused() {
        // One element with 1000 children (zigzag varint 2000) in a list of one.
        let lying = [0x29, 0x1c, 0x55, 0xd0, 0x0f, 0x00, 0x00];
        assert_eq!(check(&lying), Err("its schema claims more columns than it lists"));
        let mut deep = vec![0x29, 0xfc, 0xe8, 0x07];
        for _ in 0..1000 {
            deep.extend([0x55, 0x02, 0x00]);
        }
        deep.push(0);
        assert_eq!(check(&deep), Err("its schema nests too deep"));
    }

    #[test]
    fn cut_footers_are_refused() {
        let whole = [0x15, 0x02, 0x29, 0x1c, 0x48, 0x01, b'm', 0x15, 0x00, 0x00, 0x16, 0x00, 0x00];
        assert_eq!(check(&whole), Ok(()));
        for end in 0..whole.len() {
            assert!(check(&whole[..end]).is_err(), "{end}");
        }
    }
}
