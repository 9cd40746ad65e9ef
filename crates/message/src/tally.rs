//! Statistics of one field.

use crate::Value;

/// Texts of one field that are kept.
const MAX_TEXTS: usize = 64;
/// Bytes of a text that is kept; longer ones are descriptions or documents, no categories.
const MAX_TEXT: usize = 256;

/// Kind of a field's values. Wider kinds come later.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum FieldKind {
    /// Truth values.
    Boolean,
    /// Whole numbers.
    Integer,
    /// Real numbers.
    Float,
    /// Texts.
    Text,
}

/// Counts, range and mean of the values of one field.
///
/// The sum is compensated (Neumaier 1974), so that the mean of a long log is as good as its numbers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tally {
    kind: Option<FieldKind>,
    count: u64,
    missing: u64,
    numbers: u64,
    min: f64,
    max: f64,
    sum: f64,
    compensation: f64,
    texts: Vec<String>,
}

impl Tally {
    /// Adds a number, truth value, text or null.
    pub(crate) fn add(&mut self, value: &Value) {
        let kind = match value {
            Value::Bool(_) => FieldKind::Boolean,
            Value::Int(_) | Value::Uint(_) => FieldKind::Integer,
            Value::Float(_) => FieldKind::Float,
            Value::Text(text) => {
                self.add_text(text);
                FieldKind::Text
            }
            _ => {
                self.missing += 1;
                return;
            }
        };
        self.kind = self.kind.max(Some(kind));
        match value.number() {
            Some(number) if number.is_nan() => self.missing += 1,
            Some(number) => {
                self.count += 1;
                let (min, max) = if self.numbers == 0 { (number, number) } else { (self.min, self.max) };
                self.min = min.min(number);
                self.max = max.max(number);
                self.numbers += 1;
                self.add_to_sum(number);
            }
            None => self.count += 1,
        }
    }

    /// Adds what a tally has seen of the values that follow.
    pub(crate) fn merge(&mut self, later: Self) {
        self.kind = self.kind.max(later.kind);
        self.count += later.count;
        self.missing += later.missing;
        if later.numbers > 0 {
            let (min, max) = if self.numbers == 0 { (later.min, later.max) } else { (self.min, self.max) };
            self.min = min.min(later.min);
            self.max = max.max(later.max);
            self.numbers += later.numbers;
            self.add_to_sum(later.sum);
            self.compensation += later.compensation;
        }
        for text in &later.texts {
            self.add_text(text);
        }
    }

    fn add_to_sum(&mut self, number: f64) {
        let sum = self.sum + number;
        self.compensation +=
            if self.sum.abs() >= number.abs() { (self.sum - sum) + number } else { (number - sum) + self.sum };
        self.sum = sum;
    }

    fn add_text(&mut self, text: &str) {
        if text.len() <= MAX_TEXT
            && self.texts.len() < MAX_TEXTS
            && !self.texts.iter().any(|known_text| known_text == text)
        {
            self.texts.push(text.to_owned());
        }
    }

    /// The widest kind; none when nothing but nulls was seen.
    pub(crate) fn kind(&self) -> Option<FieldKind> {
        self.kind
    }

    /// Values that are there.
    pub(crate) fn count(&self) -> u64 {
        self.count
    }

    /// Values that are NaN or null.
    pub(crate) fn missing(&self) -> u64 {
        self.missing
    }

    /// The smallest number, or NaN.
    pub(crate) fn min(&self) -> f64 {
        if self.numbers == 0 { f64::NAN } else { self.min }
    }

    /// The largest number, or NaN.
    pub(crate) fn max(&self) -> f64 {
        if self.numbers == 0 { f64::NAN } else { self.max }
    }

    /// The mean of the numbers, or NaN.
    pub(crate) fn mean(&self) -> f64 {
        // With an infinite sum the compensation is inf - inf.
        let sum = if self.sum.is_finite() { self.sum + self.compensation } else { self.sum };
        if self.numbers == 0 { f64::NAN } else { sum / self.numbers as f64 }
    }

    /// The first different texts.
    pub(crate) fn texts(&self) -> &[String] {
        &self.texts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_does_not_lose_small_numbers() {
        let mut tally = Tally::default();
        for number in [1e17, 1.0, 1.0, 1.0, 1.0, -1e17] {
            tally.add(&Value::Float(number));
        }
        assert_eq!(tally.mean(), 4.0 / 6.0);
        assert_eq!((tally.min(), tally.max(), tally.count()), (-1e17, 1e17, 6));
    }

    #[test]
    fn infinities_count_and_nan_is_missing() {
        let mut tally = Tally::default();
        for number in [1.0, f64::INFINITY, f64::NAN, 2.0] {
            tally.add(&Value::Float(number));
        }
        tally.add(&Value::Null);
        assert_eq!(
            (tally.count(), tally.missing(), tally.min(), tally.max(), tally.mean()),
            (3, 2, 1.0, f64::INFINITY, f64::INFINITY)
        );
    }

    #[test]
    fn kinds_widen_and_nulls_have_none() {
        let mut tally = Tally::default();
        tally.add(&Value::Null);
        assert_eq!((tally.kind(), tally.missing()), (None, 1));
        assert!(tally.mean().is_nan() && tally.min().is_nan() && tally.max().is_nan());
        for (value, kind) in [
            (Value::Bool(true), FieldKind::Boolean),
            (Value::Int(-4), FieldKind::Integer),
            (Value::Float(0.5), FieldKind::Float),
            (Value::Uint(2), FieldKind::Float),
            (Value::Text("x".into()), FieldKind::Text),
            (Value::Bool(false), FieldKind::Text),
        ] {
            tally.add(&value);
            assert_eq!(tally.kind(), Some(kind));
        }
        assert_eq!((tally.count(), tally.min(), tally.max(), tally.texts()), (6, -4.0, 2.0, &["x".to_owned()][..]));
    }
}
