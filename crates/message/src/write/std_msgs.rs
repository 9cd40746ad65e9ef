//! `std_msgs`: bare numbers. They carry no stamp: readers know only when they were logged.

use super::{Message, cdr::Cdr, definition::section};

/// `std_msgs/msg/Float64`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Float64 {
    /// The number.
    pub data: f64,
}

impl Message for Float64 {
    const NAME: &'static str = "std_msgs/msg/Float64";
    const SCHEMA: &'static str = "float64 data\n";

    fn encode(&self, out: &mut Vec<u8>) {
        Cdr::begin(out).f64(self.data);
    }
}

/// `std_msgs/msg/Bool`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Bool {
    /// The truth value.
    pub data: bool,
}

impl Message for Bool {
    const NAME: &'static str = "std_msgs/msg/Bool";
    const SCHEMA: &'static str = "bool data\n";

    fn encode(&self, out: &mut Vec<u8>) {
        Cdr::begin(out).bool(self.data);
    }
}

/// `std_msgs/msg/Float64MultiArray`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Float64MultiArray<'a> {
    /// The dimensions, outermost first; none for a plain list.
    pub dim: &'a [MultiArrayDimension<'a>],
    /// Numbers of `data` before the array.
    pub data_offset: u32,
    /// The numbers.
    pub data: &'a [f64],
}

/// `std_msgs/msg/MultiArrayDimension`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MultiArrayDimension<'a> {
    /// Its name.
    pub label: &'a str,
    /// Number of elements along this dimension.
    pub size: u32,
    /// Numbers from one element of the next outer dimension to the next.
    pub stride: u32,
}

impl Message for Float64MultiArray<'_> {
    const NAME: &'static str = "std_msgs/msg/Float64MultiArray";
    const SCHEMA: &'static str = concat!(
        "MultiArrayLayout layout\nfloat64[] data\n",
        section!("std_msgs/MultiArrayLayout", "MultiArrayDimension[] dim\nuint32 data_offset\n"),
        section!("std_msgs/MultiArrayDimension", "string label\nuint32 size\nuint32 stride\n")
    );

    fn encode(&self, out: &mut Vec<u8>) {
        let mut cdr = Cdr::begin(out);
        cdr.count(self.dim.len());
        for dimension in self.dim {
            cdr.text(dimension.label);
            cdr.u32(dimension.size);
            cdr.u32(dimension.stride);
        }
        cdr.u32(self.data_offset);
        cdr.f64_sequence(self.data);
    }
}
