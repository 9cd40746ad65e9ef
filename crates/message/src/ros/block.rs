//! Operations in sequence, with the known alignment of the place in the message.

use super::{
    program::{Load, Op},
    wire::Wire,
};

/// Known alignment of a place: its residue modulo a power of two.
#[derive(Debug, Clone, Copy)]
struct Phase {
    modulus: usize,
    residue: usize,
}

/// Operations in the making.
///
/// Values of fixed size, skipped and loaded, gather in a run until something comes whose size only the message knows.
pub(super) struct Block {
    ops: Vec<Op>,
    phase: Phase,
    size: usize,
    loads: Vec<Load>,
}

impl Block {
    /// At the beginning of a message.
    pub(super) fn start() -> Self {
        Self { ops: Vec::new(), phase: Phase { modulus: 8, residue: 0 }, size: 0, loads: Vec::new() }
    }

    /// At a place of which nothing is known.
    pub(super) fn anywhere(wire: Wire) -> Self {
        Self { phase: unknown(wire), ..Self::start() }
    }

    /// Operations from the place that this block has come to.
    pub(super) fn fork(&self) -> Self {
        Self { phase: self.phase, ..Self::start() }
    }

    /// Goes past a value of fixed size; answers its offset in the run.
    pub(super) fn place(&mut self, size: usize, alignment: usize) -> usize {
        if alignment > self.phase.modulus {
            self.flush();
            self.ops.push(Op::Align(alignment));
            self.phase = Phase { modulus: alignment, residue: 0 };
        }
        let padding = self.phase.residue.next_multiple_of(alignment) - self.phase.residue;
        let offset = self.size.saturating_add(padding);
        self.size = offset.saturating_add(size);
        self.phase.residue = (self.phase.residue + padding + size % self.phase.modulus) % self.phase.modulus;
        offset
    }

    /// A load from the run.
    pub(super) fn load(&mut self, load: Load) {
        if let (
            Some(Load::Numbers { scalar, offset, slot, count }),
            Load::Numbers { scalar: next, offset: at, slot: into, count: 1 },
        ) = (self.loads.last_mut(), &load)
            && *scalar == *next
            && offset.checked_add(*count * scalar.size()) == Some(*at)
            && *slot + *count == *into
        {
            *count += 1;
            return;
        }
        self.loads.push(load);
    }

    /// An operation whose length only the message knows.
    pub(super) fn push(&mut self, op: Op, wire: Wire) {
        self.push_in_place(op);
        self.phase = unknown(wire);
    }

    /// An operation that ends where it begins.
    pub(super) fn push_in_place(&mut self, op: Op) {
        self.flush();
        self.ops.push(op);
    }

    fn flush(&mut self) {
        if self.size > 0 {
            self.ops.push(Op::Run { size: self.size, loads: std::mem::take(&mut self.loads).into() });
            self.size = 0;
        }
    }

    pub(super) fn finish(mut self) -> Box<[Op]> {
        self.flush();
        self.ops.into()
    }
}

/// In a packed layout every place is as good as the beginning.
fn unknown(wire: Wire) -> Phase {
    Phase { modulus: if wire == Wire::Ros1 { 8 } else { 1 }, residue: 0 }
}
