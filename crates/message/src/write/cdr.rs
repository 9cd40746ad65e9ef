//! Common Data Representation, version 1, little-endian (OMG DDS-XTypes 1.3, section 7.4.1).

/// Representation identifier `CDR_LE` and two bytes of options.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Appends values, each aligned to its size counted from the end of the encapsulation header.
pub(super) struct Cdr<'a> {
    out: &'a mut Vec<u8>,
}

impl<'a> Cdr<'a> {
    /// Begins a message in place of whatever `out` held.
    pub(super) fn begin(out: &'a mut Vec<u8>) -> Self {
        out.clear();
        out.extend_from_slice(&ENCAPSULATION);
        Self { out }
    }

    fn align(&mut self, size: usize) {
        let from_header = self.out.len() - ENCAPSULATION.len();
        self.out.resize(ENCAPSULATION.len() + from_header.next_multiple_of(size), 0);
    }

    pub(super) fn bool(&mut self, value: bool) {
        self.out.push(u8::from(value));
    }

    pub(super) fn i32(&mut self, value: i32) {
        self.align(4);
        self.out.extend_from_slice(&value.to_le_bytes());
    }

    pub(super) fn u32(&mut self, value: u32) {
        self.align(4);
        self.out.extend_from_slice(&value.to_le_bytes());
    }

    /// Number of elements that follow.
    pub(super) fn count(&mut self, length: usize) {
        // A count beyond 32 bits wraps; see `Message::encode` for why that reaches no file.
        self.u32(length as u32);
    }

    pub(super) fn f64(&mut self, value: f64) {
        self.align(8);
        self.out.extend_from_slice(&value.to_le_bytes());
    }

    /// A fixed array, or what follows a sequence's count. Nothing is aligned for no elements.
    pub(super) fn f64s(&mut self, values: &[f64]) {
        if values.is_empty() {
            return;
        }
        self.align(8);
        self.out.reserve(size_of_val(values));
        for value in values {
            self.out.extend_from_slice(&value.to_le_bytes());
        }
    }

    /// A sequence: its count and its elements.
    pub(super) fn f64_sequence(&mut self, values: &[f64]) {
        self.count(values.len());
        self.f64s(values);
    }

    /// A text: its length with the closing zero, its bytes, the zero.
    pub(super) fn text(&mut self, text: &str) {
        self.count(text.len() + 1);
        self.out.extend_from_slice(text.as_bytes());
        self.out.push(0);
    }
}
