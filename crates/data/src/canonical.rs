//! Canonical bytes of values, for hashes. Texts and lists begin with their length, numbers are little-endian, and
//! variants begin with a number.

/// A value as bytes. Two values have the same bytes only where all that was put in is the same.
///
/// ```
/// use fleetfoot_data::Canonical;
///
/// let of = |names: &[&str]| {
///     let mut bytes = Canonical::default();
///     names.iter().for_each(|name| bytes.text(name));
///     bytes
/// };
/// assert_ne!(of(&["ab", "c"]), of(&["a", "bc"]));
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Canonical(Vec<u8>);

impl Canonical {
    /// Appends the number of a type's variant, which is the same in all versions.
    pub fn tag(&mut self, tag: u8) {
        self.0.push(tag);
    }

    /// A whole number, or a length.
    pub fn count(&mut self, count: u64) {
        self.0.extend(count.to_le_bytes());
    }

    /// A number; all NaN are one.
    pub fn number(&mut self, number: f64) {
        let bits = if number.is_nan() { f64::NAN.to_bits() } else { number.to_bits() };
        self.0.extend(bits.to_le_bytes());
    }

    /// A list of numbers.
    pub fn numbers(&mut self, numbers: &[f64]) {
        self.count(numbers.len() as u64);
        numbers.iter().for_each(|&number| self.number(number));
    }

    /// A text.
    pub fn text(&mut self, text: &str) {
        self.bytes(text.as_bytes());
    }

    /// Bytes of any kind.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.count(bytes.len() as u64);
        self.0.extend(bytes);
    }

    /// The bytes.
    pub fn as_bytes(&self) -> &[u8] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hashes in files depend on the layout.
    #[test]
    fn the_layout_stays() {
        let mut all = Canonical::default();
        all.tag(7);
        all.count(258);
        all.text("ab");
        all.numbers(&[1.0, -f64::NAN]);
        let hex: String = all.as_bytes().iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(
            hex,
            "07\
             0201000000000000\
             02000000000000006162\
             0200000000000000000000000000f03f000000000000f87f"
        );
    }
}
