//! From wanted fields to operations.

use super::{
    block::Block,
    program::{Elements, Keys, Load, Names, Numbers, Op, Picked, Program, Written},
    want::{Want, Wanted, Which, key_field},
    wire::{Sizes, Wire},
};
use crate::{Length, Scalar, Schema, Type};

/// Structs with more leaves than this are skipped by a call instead of by operations on the spot: a small schema may spell a huge struct.
const INLINE: usize = 64;

/// Makes the program for one wire.
pub(super) fn compile(schema: &Schema, wanted: &Wanted, wire: Wire, sizes: &Sizes) -> Program {
    let compiler = Compiler { schema, wire, sizes, leaves: leaves(schema) };
    let mut block = Block::start();
    let root = Type::Struct(schema.root);
    compiler.load(&mut block, &root, &wanted.root, false);
    let skips = (0..schema.structs.len()).map(|index| {
        let mut block = Block::anywhere(wire);
        if !compiler.is_inline(index) {
            compiler.skip_fields(&mut block, index, None);
        }
        block.finish()
    });
    Program { skips: skips.collect(), ops: block.finish() }
}

/// Operations that skipping a struct would take at the most, by its index.
fn leaves(schema: &Schema) -> Vec<usize> {
    let mut leaves: Vec<usize> = Vec::with_capacity(schema.structs.len());
    for struct_type in &schema.structs {
        let of = |kind: &Type| match kind {
            Type::Struct(index) => leaves.get(*index).copied().unwrap_or(0),
            _ => 1,
        };
        let sum = struct_type.fields.iter().map(|field| of(&field.kind)).fold(0, usize::saturating_add);
        leaves.push(sum);
    }
    leaves
}

struct Compiler<'a> {
    schema: &'a Schema,
    wire: Wire,
    sizes: &'a Sizes,
    leaves: Vec<usize>,
}

impl Compiler<'_> {
    fn is_inline(&self, index: usize) -> bool {
        self.leaves.get(index).is_some_and(|&leaves| leaves <= INLINE)
    }

    fn anywhere(&self) -> Block {
        Block::anywhere(self.wire)
    }

    fn skip(&self, block: &mut Block, kind: &Type) {
        match kind {
            Type::Scalar(scalar) => {
                block.place(scalar.size(), self.wire.alignment(scalar.size()));
            }
            Type::Text { wide } => block.push(Op::SkipText { unit: self.wire.text_unit(*wide) }, self.wire),
            Type::PlainText { size: Some(size) } | Type::Padding(size) => {
                block.place(*size, 1);
            }
            Type::PlainText { size: None } => block.push(Op::LoadRest { slots: Box::default() }, self.wire),
            Type::Struct(index) if self.wire.struct_header(self.schema, *index) => block.push(Op::SkipPart, self.wire),
            Type::Struct(index) if self.is_inline(*index) => self.skip_fields(block, *index, None),
            Type::Struct(index) => block.push(Op::Call(*index), self.wire),
            Type::Array { element, .. } if self.wire.array_header(element) => block.push(Op::SkipPart, self.wire),
            Type::Array { element, length } => self.skip_array(block, element, *length),
        }
    }

    /// Skips an array that has no length in bytes before it.
    fn skip_array(&self, block: &mut Block, element: &Type, length: Length) {
        match (element, length) {
            (Type::Scalar(scalar), Length::Fixed(count)) => {
                block.place(scalar.size().saturating_mul(count), self.wire.alignment(scalar.size()));
            }
            (Type::Scalar(scalar), Length::Sequence(_)) => {
                let alignment = self.wire.alignment(scalar.size());
                block.push(Op::SkipNumbers { size: scalar.size(), alignment }, self.wire);
            }
            _ => self.elements(block, element, length, &Want::default(), true),
        }
    }

    /// Skips the fields of a struct, of which one may be the name of the element that the struct is.
    fn skip_fields(&self, block: &mut Block, index: usize, key: Option<usize>) {
        let Some(struct_type) = self.schema.structs.get(index) else { return };
        for (place, field) in struct_type.fields.iter().enumerate() {
            if key == Some(place) {
                self.key(block, &field.kind);
            } else if field.optional {
                self.optional(block, |block| self.skip(block, &field.kind));
            } else {
                self.skip(block, &field.kind);
            }
        }
    }

    /// The name of the element that is being walked.
    fn key(&self, block: &mut Block, kind: &Type) {
        let op = match kind {
            Type::PlainText { size } => Op::PlainKey { size: size.unwrap_or(0) },
            _ => Op::KeyText,
        };
        block.push(op, self.wire);
    }

    fn optional(&self, block: &mut Block, field: impl FnOnce(&mut Block)) {
        if self.wire == Wire::Xcdr1 {
            return block.push(Op::Refuse, self.wire);
        }
        let mut inside = self.anywhere();
        field(&mut inside);
        block.push(Op::Optional(inside.finish()), self.wire);
    }

    /// Loads what is wanted of a value. Unless it is needed, its end need not be reached.
    fn load(&self, block: &mut Block, kind: &Type, want: &Want, to_end: bool) {
        match kind {
            Type::Scalar(scalar) => {
                let offset = block.place(scalar.size(), self.wire.alignment(scalar.size()));
                self.load_scalar(block, *scalar, offset, want);
            }
            Type::Text { wide } => {
                let (unit, slots) = (self.wire.text_unit(*wide), want.slots.clone().into());
                block.push(Op::LoadText { wide: *wide, unit, slots }, self.wire);
            }
            Type::PlainText { size: Some(size) } => {
                let offset = block.place(*size, 1);
                block.load(Load::Text { offset, size: *size, slots: want.slots.clone().into() });
            }
            Type::PlainText { size: None } => {
                block.push(Op::LoadRest { slots: want.slots.clone().into() }, self.wire);
            }
            Type::Padding(size) => {
                block.place(*size, 1);
            }
            Type::Struct(index) if self.wire.struct_header(self.schema, *index) => {
                let mut inside = self.anywhere();
                self.load_fields(&mut inside, *index, want, true, false);
                block.push(Op::Part(inside.finish()), self.wire);
            }
            Type::Struct(index) => self.load_fields(block, *index, want, false, to_end),
            Type::Array { element, length } if self.wire.array_header(element) => {
                let mut inside = self.anywhere();
                self.load_array(&mut inside, element, *length, want, false);
                block.push(Op::Part(inside.finish()), self.wire);
            }
            Type::Array { element, length } => self.load_array(block, element, *length, want, to_end),
        }
    }

    fn load_scalar(&self, block: &mut Block, scalar: Scalar, offset: usize, want: &Want) {
        for &slot in &want.slots {
            block.load(Load::Numbers { scalar, offset, slot, count: 1 });
        }
        let signed = scalar == Scalar::I32;
        if !want.seconds.is_empty() {
            block.load(Load::Seconds { signed, offset, groups: want.seconds.clone().into() });
        }
        if !want.nanoseconds.is_empty() {
            block.load(Load::Nanoseconds { signed, offset, groups: want.nanoseconds.clone().into() });
        }
    }

    /// Loads fields of a struct; in a part with a length, fields at its end may be missing.
    fn load_fields(&self, block: &mut Block, index: usize, want: &Want, in_part: bool, to_end: bool) {
        let Some(struct_type) = self.schema.structs.get(index) else { return };
        let first = want.fields.keys().next().copied().unwrap_or(0);
        let names = want.names.as_ref();
        // Names that stand behind a field that is keyed by them, or that are wanted themselves, are read beforehand.
        let ahead = names.filter(|names| names.field >= first);
        if let Some(names) = ahead {
            let mut inside = block.fork();
            for field in struct_type.fields.iter().take(names.field) {
                self.field(&mut inside, in_part, field.optional, |block| self.skip(block, &field.kind));
            }
            self.names(&mut inside, names, in_part);
            block.push_in_place(Op::Ahead(inside.finish()));
        }
        let inline = names.filter(|names| names.field < first);
        let last = want.fields.keys().next_back().copied();
        for (place, field) in struct_type.fields.iter().enumerate() {
            let is_last = last.is_none_or(|last| place >= last);
            if !to_end && last.is_none_or(|last| place > last) {
                break;
            }
            match (want.fields.get(&place), inline) {
                (Some(wanted), _) => self.field(block, in_part, field.optional, |block| {
                    self.load(block, &field.kind, wanted, to_end || !is_last || field.optional);
                }),
                (None, Some(names)) if names.field == place => self.names(block, names, in_part),
                (None, _) => self.field(block, in_part, field.optional, |block| self.skip(block, &field.kind)),
            }
        }
    }

    fn field(&self, block: &mut Block, in_part: bool, optional: bool, field: impl FnOnce(&mut Block)) {
        if in_part {
            block.push_in_place(Op::EndOfPart);
        }
        if optional { self.optional(block, field) } else { field(block) }
    }

    fn names(&self, block: &mut Block, names: &super::want::Names, in_part: bool) {
        if in_part {
            block.push_in_place(Op::EndOfPart);
        }
        let keys = Keys::new(names.wanted.iter().enumerate().map(|(place, (key, ..))| (key.as_str(), place)));
        let wanted = names.wanted.iter().map(|(_, register, groups)| (*register, groups.clone().into())).collect();
        let op = Op::Names(Box::new(Names { keys, wanted }));
        let has_header = self.wire.array_header(&Type::Text { wide: false });
        block.push(if has_header { Op::Part(Box::new([op])) } else { op }, self.wire);
    }

    /// Loads elements of an array behind its length in bytes.
    fn load_array(&self, block: &mut Block, element: &Type, length: Length, want: &Want, to_end: bool) {
        let Type::Scalar(scalar) = element else { return self.elements(block, element, length, want, to_end) };
        let alignment = self.wire.alignment(scalar.size());
        let picks = want.picks.iter();
        let indices = picks.clone().filter_map(|pick| match pick.which {
            Which::Index(index) => Some((index, &pick.want)),
            _ => None,
        });
        let registers = picks.filter_map(|pick| match pick.which {
            Which::Register(register) => Some((register, &pick.want)),
            _ => None,
        });
        if let Length::Fixed(count) = length
            && registers.clone().next().is_none()
        {
            let offset = block.place(scalar.size().saturating_mul(count), alignment);
            let mut indices: Vec<_> = indices.filter(|&(index, _)| index < count).collect();
            indices.sort_by_key(|&(index, _)| index);
            for (index, want) in indices {
                self.load_scalar(block, *scalar, offset.saturating_add(index.saturating_mul(scalar.size())), want);
            }
            return;
        }
        let slots =
            |(place, want): (usize, &Want)| want.slots.iter().map(move |&slot| (place, slot)).collect::<Vec<_>>();
        let numbers = Numbers {
            scalar: *scalar,
            alignment,
            length: fixed(length),
            indices: indices.flat_map(slots).collect(),
            registers: registers.flat_map(slots).collect(),
        };
        block.push(Op::Numbers(Box::new(numbers)), self.wire);
    }

    fn elements(&self, block: &mut Block, element: &Type, length: Length, want: &Want, to_end: bool) {
        let mut places = (Vec::new(), Vec::new(), Vec::new());
        for (place, pick) in want.picks.iter().enumerate() {
            match &pick.which {
                Which::Index(index) => places.0.push((*index, place)),
                Which::Key(key) => places.1.push((key.as_str(), place)),
                Which::Register(register) => places.2.push((*register, place)),
            }
        }
        places.0.sort_unstable();
        let (indices, keys, registers) = places;
        // Only elements by their places need not be followed by a walk to the end.
        let few = !to_end && keys.is_empty() && registers.is_empty();
        let walked = few.then(|| indices.last().map_or(0, |&(index, _)| index.saturating_add(1)));
        let mut skip = self.anywhere();
        self.walk(&mut skip, element, length, !keys.is_empty());
        let picks = want.picks.iter().map(|pick| {
            let mut inside = self.anywhere();
            match (length, element) {
                // The further dimensions of an array have no lengths in bytes of their own.
                (Length::Fixed(_), Type::Array { element, length: length @ Length::Fixed(_) }) => {
                    self.load_array(&mut inside, element, *length, &pick.want, false);
                }
                _ => self.load(&mut inside, element, &pick.want, false),
            }
            Picked { ops: inside.finish(), group: pick.group, written: written(&pick.want) }
        });
        let elements = Elements {
            length: fixed(length),
            least: self.sizes.least(element),
            walked,
            skip: skip.finish(),
            picks: picks.collect(),
            indices: indices.into(),
            keys: Keys::new(keys.into_iter()),
            registers: registers.into(),
        };
        block.push(Op::Elements(Box::new(elements)), self.wire);
    }

    /// Walks over one element, and notes its name.
    fn walk(&self, block: &mut Block, element: &Type, of: Length, keyed: bool) {
        let key = |index: usize| self.schema.structs.get(index).and_then(key_field).filter(|_| keyed);
        match (element, of) {
            (Type::Struct(index), _) if key(*index).is_some() => {
                if self.wire.struct_header(self.schema, *index) {
                    let mut inside = self.anywhere();
                    let (key, struct_type) = (key(*index).unwrap_or(0), &self.schema.structs[*index]);
                    for (place, field) in struct_type.fields.iter().enumerate().take(key + 1) {
                        self.field(&mut inside, true, field.optional, |block| match place == key {
                            true => self.key(block, &field.kind),
                            false => self.skip(block, &field.kind),
                        });
                    }
                    block.push(Op::Part(inside.finish()), self.wire);
                } else {
                    self.skip_fields(block, *index, key(*index));
                }
            }
            (Type::Array { element, length: length @ Length::Fixed(_) }, Length::Fixed(_)) => {
                self.skip_array(block, element, *length);
            }
            _ => self.skip(block, element),
        }
    }
}

fn fixed(length: Length) -> Option<usize> {
    match length {
        Length::Fixed(count) => Some(count),
        Length::Sequence(_) => None,
    }
}

/// Slots, stamps and groups that loading this value writes.
fn written(want: &Want) -> Written {
    fn collect(want: &Want, written: &mut Written) {
        written.slots.extend(&want.slots);
        written.stamps.extend(&want.seconds);
        let groups =
            want.names.iter().flat_map(|names| names.wanted.iter().flat_map(|(_, _, groups)| groups.iter().copied()));
        written.present.extend(groups.chain(want.picks.iter().filter_map(|pick| pick.group)));
        want.fields
            .values()
            .chain(want.picks.iter().map(|pick| &pick.want))
            .for_each(|inside| collect(inside, written));
    }
    let mut all = Written::default();
    collect(want, &mut all);
    all
}
