//! Evaluation: the tape over tiles of rows, or over one row.
//!
//! A tile is short enough that the values of the whole tape stay in the second-level cache. Loops are plain arithmetic on
//! slices, compiled for the vector instructions that the processor has at run time; products and sums are never fused, so
//! that the result does not depend on which these are.

use std::ops::Range;

use fleetfoot_data::Block;

use crate::{
    Binary, Leaf, Program, Unary,
    program::{Instruction, Operand, Operation, Target},
};

/// Bytes that outputs and registers of a tile should fill at most.
const TILE_BYTES: usize = 256 * 1024;
/// Rows of a tile.
const TILE_ROWS: Range<usize> = 64..512;

/// Memory for evaluation, reused between calls and between programs.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    registers: Vec<f64>,
    seconds: Vec<f64>,
}

impl Scratch {
    /// No memory yet.
    pub fn new() -> Self {
        Self::default()
    }
}

impl Program {
    /// Evaluates `rows` rows: output j of row i goes to `out[j*stride + i]`. `leaves[l]` holds the values of
    /// [`Program::leaves`]`[l]` for at least `rows` rows.
    ///
    /// # Panics
    /// If there are too few or too short leaves, if `stride < rows`, or if `out` is too short.
    pub fn evaluate(&self, leaves: &[&[f64]], rows: usize, out: &mut [f64], stride: usize, scratch: &mut Scratch) {
        assert_eq!(leaves.len(), self.leaves.len(), "one slice for each leaf");
        assert!(leaves.iter().all(|leaf| leaf.len() >= rows), "leaves hold all rows");
        if rows == 0 || self.outputs == 0 {
            return;
        }
        assert!(stride >= rows, "stride of at least the rows");
        assert!(out.len() >= (self.outputs - 1) * stride + rows, "room for all outputs");
        let columns = self.outputs + self.registers + self.leaves.len();
        let tile = (TILE_BYTES / 8 / columns).clamp(TILE_ROWS.start, TILE_ROWS.end) / 16 * 16;
        let tile = tile.min(rows);
        let needed = self.registers * tile;
        if scratch.registers.len() < needed {
            scratch.registers.resize(needed, 0.0);
        }
        let registers = &mut scratch.registers[..needed];
        fleetfoot_data::arch().dispatch(Tiles { tape: &self.tape, leaves, rows, tile, out, stride, registers });
    }

    /// Evaluates core rows of a block: row `rows.start` of the core is row 0 of `out`, laid out as for [`Program::evaluate`].
    /// The block's columns are those that the program was compiled for.
    ///
    /// # Panics
    /// If `rows` is not empty and not within [`Program::valid_rows`], or if `out` is too short.
    pub fn evaluate_block(
        &self,
        block: &Block,
        rows: Range<usize>,
        out: &mut [f64],
        stride: usize,
        scratch: &mut Scratch,
    ) {
        if rows.is_empty() {
            return;
        }
        let valid = self.valid_rows(block);
        assert!(valid.start <= rows.start && rows.end <= valid.end, "rows whose lags are inside the block");
        let halo = self.halo();
        // Position in the block of the first row that anything reads.
        let base = block.before + rows.start - halo.before;
        let span = base..base + halo.before + rows.len() + halo.after;
        let mut seconds = std::mem::take(&mut scratch.seconds);
        if self.leaves.iter().any(|leaf| matches!(leaf, Leaf::Time { .. })) {
            seconds.clear();
            // As `Block::seconds`.
            seconds.extend(block.time[span.clone()].iter().map(|&stamp| (stamp - block.start) as f64 * 1e-9));
        }
        let leaves: Vec<&[f64]> = self
            .leaves
            .iter()
            .map(|leaf| {
                // Between 0 and before + after, as the halo is made of the lags.
                let offset = (halo.before as i64 - i64::from(leaf.lag())) as usize;
                match *leaf {
                    Leaf::Column { column, .. } => &block.column(column)[span.start + offset..][..rows.len()],
                    Leaf::Time { .. } => &seconds[offset..][..rows.len()],
                }
            })
            .collect();
        self.evaluate(&leaves, rows.len(), out, stride, scratch);
        drop(leaves);
        scratch.seconds = seconds;
    }

    /// Evaluates one row: `leaf_values[l]` is the value of [`Program::leaves`]`[l]`, `out[j]` becomes output j.
    ///
    /// # Panics
    /// If there are fewer values than leaves, or less room than outputs.
    pub fn evaluate_row(&self, leaf_values: &[f64], out: &mut [f64], scratch: &mut Scratch) {
        let leaves = &leaf_values[..self.leaves.len()];
        let out = &mut out[..self.outputs];
        if scratch.registers.len() < self.registers {
            scratch.registers.resize(self.registers, 0.0);
        }
        let registers = &mut scratch.registers[..self.registers];
        for instruction in &self.tape {
            let read = |operand: Operand| match operand {
                Operand::Constant(value) => value,
                Operand::Leaf(leaf) => leaves[leaf],
                Operand::Register(register) => registers[register],
                Operand::Output(output) => out[output],
            };
            let value = match instruction.operation {
                Operation::Copy(x) => read(x),
                Operation::Unary(function, x) => function.apply(read(x)),
                Operation::Binary(function, a, b) => function.apply(read(a), read(b)),
            };
            match instruction.target {
                Target::Register(register) => registers[register] = value,
                Target::Output(output) => out[output] = value,
            }
        }
    }
}

/// The tape over all tiles, as a task for one instruction set.
struct Tiles<'a> {
    tape: &'a [Instruction],
    leaves: &'a [&'a [f64]],
    rows: usize,
    tile: usize,
    out: &'a mut [f64],
    stride: usize,
    registers: &'a mut [f64],
}

impl pulp::WithSimd for Tiles<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { tape, leaves, rows, tile, out, stride, registers } = self;
        for first in (0..rows).step_by(tile) {
            let length = tile.min(rows - first);
            for instruction in tape {
                let at = |target| match target {
                    Target::Register(register) => register * tile,
                    Target::Output(output) => output * stride + first,
                };
                let (target, registers, outputs) = match instruction.target {
                    Target::Register(_) => {
                        let (target, others) = split(registers, at(instruction.target), length);
                        (target, others, Others::all(out))
                    }
                    Target::Output(_) => {
                        let (target, others) = split(out, at(instruction.target), length);
                        (target, Others::all(registers), others)
                    }
                };
                let read = |operand| match operand {
                    Operand::Constant(value) => Input::Constant(value),
                    Operand::Leaf(leaf) => Input::Rows(&leaves[leaf][first..first + length]),
                    Operand::Register(register) => Input::Rows(registers.get(at(Target::Register(register)), length)),
                    Operand::Output(output) => Input::Rows(outputs.get(at(Target::Output(output)), length)),
                };
                match instruction.operation {
                    Operation::Copy(x) => copy(target, read(x)),
                    Operation::Unary(function, x) => unary(function, target, read(x)),
                    Operation::Binary(function, a, b) => binary(function, target, read(a), read(b)),
                }
            }
        }
    }
}

/// Returns true if no value is NaN and no absolute value exceeds the limit.
pub(crate) fn all_within(values: &[f64], limit: f64) -> bool {
    fleetfoot_data::arch().dispatch(AllWithin { values, limit })
}

struct AllWithin<'a> {
    values: &'a [f64],
    limit: f64,
}

impl pulp::WithSimd for AllWithin<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> bool {
        let (vectors, tail) = S::as_simd_f64s(self.values);
        let (limit, zero) = (simd.splat_f64s(self.limit), simd.splat_f64s(0.0));
        let yes = simd.less_than_or_equal_f64s(zero, zero);
        let mut within = [yes; 4];
        let (fours, rest) = pulp::as_arrays::<4, _>(vectors);
        for four in fours {
            for k in 0..4 {
                within[k] = simd.and_m64s(within[k], simd.less_than_or_equal_f64s(simd.abs_f64s(four[k]), limit));
            }
        }
        for &v in rest {
            within[0] = simd.and_m64s(within[0], simd.less_than_or_equal_f64s(simd.abs_f64s(v), limit));
        }
        let all = simd.and_m64s(simd.and_m64s(within[0], within[1]), simd.and_m64s(within[2], within[3]));
        simd.first_true_m64s(simd.xor_m64s(all, yes)) == S::F64_LANES
            && tail.iter().all(|value| value.abs() <= self.limit)
    }
}

/// One argument of an instruction over a tile.
#[derive(Clone, Copy)]
enum Input<'a> {
    Rows(&'a [f64]),
    Constant(f64),
}

/// A buffer without the part that is being written.
struct Others<'a> {
    head: &'a [f64],
    tail: &'a [f64],
    tail_start: usize,
}

impl<'a> Others<'a> {
    #[inline(always)]
    fn all(buffer: &'a [f64]) -> Self {
        Self { head: buffer, tail: &[], tail_start: buffer.len() }
    }

    #[inline(always)]
    fn get(&self, start: usize, length: usize) -> &'a [f64] {
        if start < self.head.len() {
            &self.head[start..start + length]
        } else {
            &self.tail[start - self.tail_start..][..length]
        }
    }
}

/// The part to write, and the rest to read.
#[inline(always)]
fn split(buffer: &mut [f64], start: usize, length: usize) -> (&mut [f64], Others<'_>) {
    let (head, rest) = buffer.split_at_mut(start);
    let (target, tail) = rest.split_at_mut(length);
    (target, Others { head, tail, tail_start: start + length })
}

#[inline(always)]
fn copy(target: &mut [f64], x: Input<'_>) {
    match x {
        Input::Rows(x) => target.copy_from_slice(x),
        Input::Constant(x) => target.fill(x),
    }
}

#[inline(always)]
fn map(target: &mut [f64], x: Input<'_>, function: impl Fn(f64) -> f64) {
    match x {
        Input::Rows(x) => {
            for (target, &x) in target.iter_mut().zip(x) {
                *target = function(x);
            }
        }
        Input::Constant(x) => target.fill(function(x)),
    }
}

#[inline(always)]
fn zip(target: &mut [f64], a: Input<'_>, b: Input<'_>, function: impl Fn(f64, f64) -> f64) {
    match (a, b) {
        (Input::Rows(a), Input::Rows(b)) => {
            for ((target, &a), &b) in target.iter_mut().zip(a).zip(b) {
                *target = function(a, b);
            }
        }
        (Input::Rows(_), Input::Constant(b)) => map(target, a, |a| function(a, b)),
        (Input::Constant(a), _) => map(target, b, |b| function(a, b)),
    }
}

/// One loop for each function: the choice is made once a tile, not once a row.
macro_rules! one_loop_each {
    ($choice:ident in $enumeration:ident: $($variant:ident)* => $loop:expr) => {
        match $choice {
            $($enumeration::$variant => {
                // A constant from here on, so that `apply` becomes one of its arms.
                let $choice = $enumeration::$variant;
                $loop
            })*
        }
    };
}

#[inline(always)]
fn unary(function: Unary, target: &mut [f64], x: Input<'_>) {
    one_loop_each!(function in Unary:
        Neg Sin Cos Tan Asin Acos Atan Sinh Cosh Tanh Exp Log Sqrt Abs Sign Step Wrap
        => map(target, x, |x| function.apply(x)));
}

#[inline(always)]
fn binary(function: Binary, target: &mut [f64], a: Input<'_>, b: Input<'_>) {
    one_loop_each!(function in Binary: Add Sub Mul Div Pow Atan2 Min Max
        => zip(target, a, b, |a, b| function.apply(a, b)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_value_is_detected_at_any_row() {
        for length in [1, 7, 64, 101] {
            let mut values: Vec<f64> = (0..length).map(|i| f64::from(i - 50)).collect();
            assert!(all_within(&values, 51.0));
            for at in 0..values.len() {
                for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e151, -1e151] {
                    let kept = std::mem::replace(&mut values[at], bad);
                    assert!(!all_within(&values, 1e150), "{bad} at {at} of {length}");
                    assert_eq!(all_within(&values, f64::MAX), bad.is_finite());
                    values[at] = kept;
                }
            }
        }
        assert!(all_within(&[], 0.0));
    }
}
