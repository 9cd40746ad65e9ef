//! Programs, run on messages.

use super::{
    program::{Elements, Load, Names, Numbers, Op, Program},
    wire::{Wire, narrow, plain, wide},
};
use crate::{DecodeError, MISSING, Row, Scalar};

/// No place in an array.
const ABSENT: u32 = u32::MAX;

/// Registers that need no memory from the heap.
const FEW: usize = 32;

/// Runs a program on the message whose body starts behind `header` bytes. The row has its final size.
pub(super) fn run<const BIG: bool>(
    program: &Program,
    wire: Wire,
    registers: usize,
    message: &[u8],
    header: usize,
    row: &mut Row,
) -> Result<(), DecodeError> {
    let body = message.get(header..).unwrap_or_default();
    let mut few = [ABSENT; FEW];
    let mut many = Vec::new();
    let registers = match few.get_mut(..registers) {
        Some(few) => few,
        None => {
            many.resize(registers, ABSENT);
            &mut many[..]
        }
    };
    let packed = wire == Wire::Ros1;
    let mut machine = Machine::<BIG> { program, packed, body, place: 0, end: body.len(), row, registers, key: None };
    machine.ops(&program.ops).map_err(|fault| fault.describe(header + machine.place))
}

/// Why a program stops; the words are made only when they are needed.
#[derive(Debug, Clone, Copy)]
enum Fault {
    Short { needed: usize, left: usize },
    Count { count: usize, least: usize, left: usize },
    Optional,
}

impl Fault {
    #[cold]
    fn describe(self, place: usize) -> DecodeError {
        let problem = match self {
            Self::Short { needed, left } => format!("{needed} bytes are needed, but only {left} are left"),
            Self::Count { count, least, left } => {
                format!("an array has {count} elements of at least {least} bytes, but only {left} bytes are left")
            }
            Self::Optional => "optional members in version 1 of CDR are not read; write the log with XCDR2".to_owned(),
        };
        DecodeError::new(place, problem)
    }
}

struct Machine<'a, const BIG: bool> {
    program: &'a Program,
    /// True if values are not aligned and texts have no NUL.
    packed: bool,
    body: &'a [u8],
    place: usize,
    /// End of the body, or of the innermost part.
    end: usize,
    row: &'a mut Row,
    registers: &'a mut [u32],
    /// The name of the element that was walked last.
    key: Option<&'a [u8]>,
}

impl<'a, const BIG: bool> Machine<'a, BIG> {
    fn ops(&mut self, ops: &'a [Op]) -> Result<(), Fault> {
        for op in ops {
            match op {
                Op::Align(alignment) => self.align(*alignment),
                Op::Run { size, loads } => {
                    let bytes = self.take(*size)?;
                    for load in loads {
                        self.load(load, bytes);
                    }
                }
                Op::SkipText { unit } => {
                    self.text(*unit)?;
                }
                Op::LoadText { wide, unit, slots } => self.load_text(*wide, *unit, slots)?,
                Op::KeyText => self.key = Some(self.narrow()?),
                Op::PlainKey { size } => self.key = Some(plain(self.take(*size)?)),
                Op::LoadRest { slots } => {
                    let bytes = self.take(self.left())?;
                    self.set_texts(slots, plain(bytes));
                }
                Op::SkipNumbers { size, alignment } => {
                    self.numbers(None, *size, *alignment)?;
                }
                Op::Numbers(numbers) => self.load_numbers(numbers)?,
                Op::Elements(elements) => self.elements(elements)?,
                Op::Names(names) => self.names(names)?,
                Op::SkipPart => {
                    let size = self.count()?;
                    self.take(size)?;
                }
                Op::Part(inside) => self.part(inside)?,
                Op::EndOfPart if self.place == self.end => return Ok(()),
                Op::EndOfPart => {}
                Op::Optional(inside) => {
                    if self.take(1)? != [0] {
                        self.ops(inside)?;
                    }
                }
                Op::Refuse => return Err(Fault::Optional),
                Op::Ahead(inside) => {
                    let place = self.place;
                    self.ops(inside)?;
                    self.place = place;
                }
                Op::Call(index) => {
                    let program = self.program;
                    self.ops(program.skips.get(*index).map_or(&[], |ops| &**ops))?;
                }
            }
        }
        Ok(())
    }

    fn left(&self) -> usize {
        self.end.saturating_sub(self.place)
    }

    #[inline]
    fn align(&mut self, alignment: usize) {
        // Alignments are powers of two; a place beyond the end is noticed by the next look at the bytes.
        self.place = (self.place + (alignment - 1)) & !(alignment - 1);
    }

    #[inline]
    fn take(&mut self, size: usize) -> Result<&'a [u8], Fault> {
        let body = self.body;
        let stop = self.place.checked_add(size).filter(|&stop| stop <= self.end);
        match stop.and_then(|stop| body.get(self.place..stop)) {
            Some(bytes) => {
                self.place += size;
                Ok(bytes)
            }
            None => Err(Fault::Short { needed: size, left: self.left() }),
        }
    }

    #[inline]
    fn count(&mut self) -> Result<usize, Fault> {
        if !self.packed {
            self.align(4);
        }
        let bytes = self.take(4)?.first_chunk::<4>().copied().unwrap_or_default();
        Ok(if BIG { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) } as usize)
    }

    #[inline]
    fn text(&mut self, unit: usize) -> Result<&'a [u8], Fault> {
        let size = self.count()?.saturating_mul(unit);
        self.take(size)
    }

    #[inline]
    fn narrow(&mut self) -> Result<&'a [u8], Fault> {
        let bytes = self.text(1)?;
        Ok(if self.packed { bytes } else { narrow(bytes) })
    }

    fn load_text(&mut self, is_wide: bool, unit: usize, slots: &[usize]) -> Result<(), Fault> {
        if is_wide {
            let text = wide::<BIG>(self.text(unit)?, unit);
            slots.iter().for_each(|&slot| self.row.set_text(slot, &text));
        } else {
            let bytes = self.narrow()?;
            self.set_texts(slots, bytes);
        }
        Ok(())
    }

    fn set_texts(&mut self, slots: &[usize], bytes: &[u8]) {
        let text = String::from_utf8_lossy(bytes);
        slots.iter().for_each(|&slot| self.row.set_text(slot, &text));
    }

    #[inline]
    fn load(&mut self, load: &Load, run: &[u8]) {
        let time = |signed: bool, offset: usize| {
            let bytes = run.get(offset..).and_then(|rest| rest.first_chunk::<4>()).copied().unwrap_or_default();
            let word = if BIG { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) };
            if signed { i64::from(word.cast_signed()) } else { i64::from(word) }
        };
        match load {
            Load::Numbers { scalar, offset, slot, count } => {
                let size = scalar.size();
                let (Some(bytes), Some(into)) =
                    (run.get(*offset..*offset + count * size), self.row.values.get_mut(*slot..*slot + count))
                else {
                    return;
                };
                numbers::<BIG>(*scalar, bytes, into);
            }
            Load::Text { offset, size, slots } => {
                let bytes = run.get(*offset..).and_then(|rest| rest.get(..*size)).unwrap_or_default();
                self.set_texts(slots, plain(bytes));
            }
            Load::Seconds { signed, offset, groups } => {
                let nanoseconds = time(*signed, *offset) * 1_000_000_000;
                for &group in groups {
                    if let Some(stamp) = self.row.stamps.get_mut(group) {
                        *stamp = nanoseconds;
                    }
                }
            }
            Load::Nanoseconds { signed, offset, groups } => {
                let nanoseconds = time(*signed, *offset);
                for &group in groups {
                    if let Some(stamp) = self.row.stamps.get_mut(group) {
                        // Between -2^31 and 2^32 seconds there is room for 2^32 nanoseconds more.
                        *stamp = stamp.saturating_add(nanoseconds);
                    }
                }
            }
        }
    }

    /// Goes past numbers; answers their bytes.
    fn numbers(&mut self, length: Option<usize>, size: usize, alignment: usize) -> Result<&'a [u8], Fault> {
        let count = match length {
            Some(length) => length,
            None => self.count()?,
        };
        // Before no number there is no padding.
        if count == 0 {
            return Ok(&[]);
        }
        self.align(alignment);
        match count.checked_mul(size) {
            Some(bytes) if bytes <= self.left() => self.take(bytes),
            _ => Err(Fault::Count { count, least: size, left: self.left() }),
        }
    }

    fn load_numbers(&mut self, wanted_numbers: &Numbers) -> Result<(), Fault> {
        let size = wanted_numbers.scalar.size();
        let bytes = self.numbers(wanted_numbers.length, size, wanted_numbers.alignment)?;
        let registers = wanted_numbers.registers.iter().filter_map(|&(register, slot)| {
            let index = *self.registers.get(register)?;
            (index != ABSENT).then_some((index as usize, slot))
        });
        for (index, slot) in wanted_numbers.indices.iter().copied().chain(registers) {
            let element = index.checked_mul(size).and_then(|start| bytes.get(start..start.checked_add(size)?));
            if let (Some(bytes), Some(value)) = (element, self.row.values.get_mut(slot..=slot)) {
                numbers::<BIG>(wanted_numbers.scalar, bytes, value);
            }
        }
        Ok(())
    }

    fn part(&mut self, inside: &'a [Op]) -> Result<(), Fault> {
        let size = self.count()?;
        if size > self.left() {
            return Err(Fault::Short { needed: size, left: self.left() });
        }
        let outer = self.end;
        self.end = self.place + size;
        self.ops(inside)?;
        self.place = self.end;
        self.end = outer;
        Ok(())
    }

    fn elements(&mut self, list: &'a Elements) -> Result<(), Fault> {
        let count = match list.length {
            Some(length) => length,
            None => self.count()?,
        };
        // Elements without bytes have nothing to walk over or to load.
        let Some(most) = self.left().checked_div(list.least) else { return Ok(()) };
        if count > most {
            return Err(Fault::Count { count, least: list.least, left: self.left() });
        }
        let mut indices = list.indices.iter().peekable();
        for index in 0..list.walked.map_or(count, |walked| walked.min(count)) {
            let start = self.place;
            self.ops(&list.skip)?;
            let stop = self.place;
            // Arrays inside the element are walked without looking at names: the name is the element's own.
            if !list.keys.is_empty()
                && let Some(pick) = self.key.take().and_then(|key| list.keys.find(key))
            {
                self.pick(list, pick, start)?;
            }
            while let Some((_, pick)) = indices.next_if(|(wanted, _)| *wanted == index) {
                self.pick(list, *pick, start)?;
            }
            for &(register, pick) in &list.registers {
                if self.registers.get(register).is_some_and(|&place| place as usize == index) {
                    self.pick(list, pick, start)?;
                }
            }
            self.place = stop;
        }
        Ok(())
    }

    /// Decodes an element that starts at this place.
    fn pick(&mut self, elements: &'a Elements, pick: usize, start: usize) -> Result<(), Fault> {
        let Some(pick) = elements.picks.get(pick) else { return Ok(()) };
        // An earlier element of the same name does not shine through.
        for &slot in &pick.written.slots {
            if let Some(value) = self.row.values.get_mut(slot) {
                *value = f64::NAN;
            }
        }
        for &group in &pick.written.present {
            if let Some(present) = self.row.present.get_mut(group) {
                *present = false;
            }
        }
        for &group in &pick.written.stamps {
            if let Some(stamp) = self.row.stamps.get_mut(group) {
                *stamp = MISSING;
            }
        }
        if let Some(present) = pick.group.and_then(|group| self.row.present.get_mut(group)) {
            *present = true;
        }
        self.place = start;
        self.ops(&pick.ops)
    }

    fn names(&mut self, name_list: &Names) -> Result<(), Fault> {
        for (register, _) in &name_list.wanted {
            if let Some(place) = self.registers.get_mut(*register) {
                *place = ABSENT;
            }
        }
        let count = self.count()?;
        if count > self.left() / 4 {
            return Err(Fault::Count { count, least: 4, left: self.left() });
        }
        for index in 0..count {
            let name = self.narrow()?;
            let Some((register, groups)) = name_list.keys.find(name).and_then(|place| name_list.wanted.get(place))
            else {
                continue;
            };
            if let Some(place) = self.registers.get_mut(*register) {
                // There are fewer than 2^30 names in a message whose lengths have 32 bits.
                *place = index as u32;
            }
            for &group in groups {
                if let Some(present) = self.row.present.get_mut(group) {
                    *present = true;
                }
            }
        }
        Ok(())
    }
}

/// Numbers that lie side by side. The choice of their type is made once for all of them.
#[inline]
fn numbers<const BIG: bool>(scalar: Scalar, bytes: &[u8], into: &mut [f64]) {
    macro_rules! read {
        ($number:ty, $size:literal, $convert:expr) => {
            for (bytes, value) in bytes.chunks_exact($size).zip(into) {
                let bytes = bytes.first_chunk::<$size>().copied().unwrap_or_default();
                let number = if BIG { <$number>::from_be_bytes(bytes) } else { <$number>::from_le_bytes(bytes) };
                *value = $convert(number);
            }
        };
    }
    match scalar {
        Scalar::F64 => read!(f64, 8, |number| number),
        Scalar::F32 => read!(f32, 4, f64::from),
        Scalar::Bool => read!(u8, 1, |number| f64::from(u8::from(number != 0))),
        Scalar::I8 => read!(i8, 1, f64::from),
        Scalar::U8 => read!(u8, 1, f64::from),
        Scalar::I16 => read!(i16, 2, f64::from),
        Scalar::U16 => read!(u16, 2, f64::from),
        Scalar::I32 => read!(i32, 4, f64::from),
        Scalar::U32 => read!(u32, 4, f64::from),
        Scalar::I64 => read!(i64, 8, |number| number as f64),
        Scalar::U64 => read!(u64, 8, |number| number as f64),
        // Nothing reads them; the schema refuses to want one.
        Scalar::LongDouble => into.fill(f64::NAN),
    }
}
