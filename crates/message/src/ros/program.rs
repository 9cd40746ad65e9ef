//! Decoding of selected fields, as operations on the bytes.

use crate::Scalar;

/// The operations that decode the wanted fields on one wire.
#[derive(Debug)]
pub(super) struct Program {
    pub(super) ops: Box<[Op]>,
    /// Operations that skip a struct, for those that are too large to be spelled out wherever they stand; by the struct's index.
    pub(super) skips: Box<[Box<[Op]>]>,
}

/// One operation. All begin where the last one ended.
#[derive(Debug, Clone)]
pub(super) enum Op {
    /// Goes on to a multiple of this, counted from behind the encapsulation header.
    Align(usize),
    /// Bytes whose places are known beforehand: one look whether they are there, then loads from them.
    Run { size: usize, loads: Box<[Load]> },
    /// A text whose length counts units of so many bytes.
    SkipText { unit: usize },
    /// A text that goes to slots.
    LoadText { wide: bool, unit: usize, slots: Box<[usize]> },
    /// A text that names the element of the array that is being walked.
    KeyText,
    /// As [`Op::KeyText`], in so many bytes.
    PlainKey { size: usize },
    /// All that is left, as a text that goes to slots.
    LoadRest { slots: Box<[usize]> },
    /// A sequence of numbers.
    SkipNumbers { size: usize, alignment: usize },
    /// Numbers of which some go to slots.
    Numbers(Box<Numbers>),
    /// Elements that are walked one by one.
    Elements(Box<Elements>),
    /// A sequence of texts that name the elements of the arrays beside it.
    Names(Box<Names>),
    /// A part with its length before it.
    SkipPart,
    /// A part with its length before it, whose beginning is decoded.
    Part(Box<[Op]>),
    /// Ends the innermost part when its bytes are used up: the writer's definition had fewer fields.
    EndOfPart,
    /// A field that is there if the octet before it is not zero.
    Optional(Box<[Op]>),
    /// A field that may be absent, in a layout that has no octet for it: refused.
    Refuse,
    /// Looks ahead, and comes back.
    Ahead(Box<[Op]>),
    /// Skips a struct.
    Call(usize),
}

/// A load from a run of bytes, at an offset from its beginning.
#[derive(Debug, Clone)]
pub(super) enum Load {
    /// Numbers that lie side by side, into slots that lie side by side.
    Numbers { scalar: Scalar, offset: usize, slot: usize, count: usize },
    /// A text in so many bytes, into slots.
    Text { offset: usize, size: usize, slots: Box<[usize]> },
    /// The seconds of these groups' stamp, which counts from here on.
    Seconds { signed: bool, offset: usize, groups: Box<[usize]> },
    /// The nanoseconds, which are added.
    Nanoseconds { signed: bool, offset: usize, groups: Box<[usize]> },
}

/// An array of numbers.
#[derive(Debug, Clone)]
pub(super) struct Numbers {
    pub(super) scalar: Scalar,
    pub(super) alignment: usize,
    /// Number of elements; `None` if the message states it.
    pub(super) length: Option<usize>,
    /// Places in the array, and slots.
    pub(super) indices: Box<[(usize, usize)]>,
    /// Registers that hold places in the array, and slots.
    pub(super) registers: Box<[(usize, usize)]>,
}

/// An array of anything but numbers.
#[derive(Debug, Clone)]
pub(super) struct Elements {
    /// Number of elements; `None` if the message states it.
    pub(super) length: Option<usize>,
    /// The fewest bytes of an element.
    pub(super) least: usize,
    /// Number of elements to walk; `None` for all.
    pub(super) walked: Option<usize>,
    /// Walks over one element, and notes its name where it counts.
    pub(super) skip: Box<[Op]>,
    /// Elements wanted, however they are chosen.
    pub(super) picks: Box<[Picked]>,
    /// Places in the array and in `picks`, in order.
    pub(super) indices: Box<[(usize, usize)]>,
    /// Names, and places in `picks`.
    pub(super) keys: Keys,
    /// Registers that hold places in the array, and places in `picks`.
    pub(super) registers: Box<[(usize, usize)]>,
}

/// A wanted element.
#[derive(Debug, Clone)]
pub(super) struct Picked {
    /// Decodes it, from its beginning.
    pub(super) ops: Box<[Op]>,
    /// The group that it makes present.
    pub(super) group: Option<usize>,
    /// Slots and stamps that an earlier element of the same name may have written.
    pub(super) written: Written,
}

/// Parts of a row.
#[derive(Debug, Clone, Default)]
pub(super) struct Written {
    pub(super) slots: Vec<usize>,
    pub(super) present: Vec<usize>,
    pub(super) stamps: Vec<usize>,
}

/// A sequence of names.
#[derive(Debug, Clone)]
pub(super) struct Names {
    /// Wanted names, and places in `wanted`.
    pub(super) keys: Keys,
    /// The register that takes the place of a name, and the groups that it makes present.
    pub(super) wanted: Box<[(usize, Box<[usize]>)]>,
}

/// Names with what they stand for.
#[derive(Debug, Clone, Default)]
pub(super) struct Keys {
    sorted: Vec<(Box<[u8]>, usize)>,
    /// A wanted name has the sign for bytes that are no UTF-8, and so may stand for such bytes.
    lossy: bool,
}

impl Keys {
    pub(super) fn new<'a>(keys: impl Iterator<Item = (&'a str, usize)>) -> Self {
        let mut lossy = false;
        let bytes = |(key, place): (&str, usize)| {
            lossy |= key.contains(char::REPLACEMENT_CHARACTER);
            (Box::from(key.as_bytes()), place)
        };
        let mut sorted: Vec<_> = keys.map(bytes).collect();
        sorted.sort();
        Self { sorted, lossy }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.sorted.is_empty()
    }

    #[inline]
    pub(super) fn find(&self, key: &[u8]) -> Option<usize> {
        let place = match self.search(key) {
            Err(_) if self.lossy => self.search(String::from_utf8_lossy(key).as_bytes()),
            outcome => outcome,
        };
        self.sorted.get(place.ok()?).map(|&(_, value)| value)
    }

    #[inline]
    fn search(&self, key: &[u8]) -> Result<usize, usize> {
        self.sorted.binary_search_by(|(known_key, _)| (**known_key).cmp(key))
    }
}
