//! Fractions of seconds that lost their leading zeros, as `f"{seconds}.{nanoseconds}"` writes them: `48.8519246` for
//! 48.008519246 s.

/// Digits of whole milliseconds, microseconds and nanoseconds.
const WIDTHS: [usize; 3] = [3, 6, 9];
/// Stamps that tell it at least.
const FEWEST: usize = 20;
/// Shortened fractions among them at least.
const FEWEST_SHORT: usize = 2;
/// Share of the uneven steps that are left at most when the zeros are put back.
const LEFT: f64 = 0.95;

/// Stamps whose fractions lack their leading zeros.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fractions {
    /// Digits of a whole fraction.
    width: usize,
    /// A shortened stamp, and its mended text.
    example: (String, String),
}

impl Fractions {
    /// Recognises them in the first stamps of a file: no fraction begins with a zero, some are shorter than the longest,
    /// and with the zeros the stamps lie more evenly. `parse` reads a cell as nanoseconds.
    pub(super) fn of<'a>(
        cells: impl Iterator<Item = &'a [u8]> + Clone,
        parse: impl Fn(&[u8]) -> Option<i64>,
    ) -> Option<Self> {
        let width = cells.clone().map(|cell| split(cell).map(|(_, digits)| digits.len())).max()??;
        if !WIDTHS.contains(&width) {
            return None;
        }
        let mut example = None;
        let (mut short, mut plain, mut mended) = (0, Vec::new(), Vec::new());
        for cell in cells {
            let text = mend(cell, width)?;
            let is_short = text.len() != cell.trim_ascii().len() && split(cell)?.1 != b"0";
            if is_short {
                short += 1;
                example.get_or_insert_with(|| (lossy(cell), lossy(&text)));
            }
            plain.push(parse(cell)?);
            mended.push(parse(&text)?);
        }
        let is_evener = unevenness(mended) < LEFT * unevenness(plain.clone());
        let example = example.filter(|_| plain.len() >= FEWEST && short >= FEWEST_SHORT && is_evener)?;
        Some(Self { width, example })
    }

    /// A stamp with its zeros; `None` where its fraction begins with a zero, or has too many digits: then none is missing.
    pub(super) fn mend(&self, cell: &[u8]) -> Option<Vec<u8>> {
        mend(cell, self.width)
    }

    /// Note on them.
    pub(super) fn note(&self, column: &str) -> String {
        let (text, mended) = &self.example;
        format!(
            "the fractions of `{column}` lost their leading zeros: they are put back (`{text}` is read as {mended}), and the rows of each second are sorted"
        )
    }
}

fn lossy(text: &[u8]) -> String {
    String::from_utf8_lossy(text.trim_ascii()).into_owned()
}

/// The text in front of a fraction, and its digits.
fn split(cell: &[u8]) -> Option<(&[u8], &[u8])> {
    let cell = cell.trim_ascii();
    let point = cell.iter().rposition(|&byte| byte == b'.')?;
    let (whole, digits) = (&cell[..point], &cell[point + 1..]);
    let is_fraction = !digits.is_empty() && digits.iter().all(u8::is_ascii_digit);
    (is_fraction && whole.last().is_some_and(u8::is_ascii_digit) && whole[0] != b'-').then_some((whole, digits))
}

fn mend(cell: &[u8], width: usize) -> Option<Vec<u8>> {
    let (whole, digits) = split(cell)?;
    if digits.len() > width || digits.len() > 1 && digits[0] == b'0' {
        return None;
    }
    let zeros = std::iter::repeat_n(b'0', width - digits.len());
    Some(whole.iter().copied().chain([b'.']).chain(zeros).chain(digits.iter().copied()).collect())
}

/// Sum of the squared steps of sorted stamps.
fn unevenness(mut stamps: Vec<i64>) -> f64 {
    stamps.sort_unstable();
    stamps.windows(2).map(|pair| (pair[1].saturating_sub(pair[0]) as f64).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TimeUnit, stamp};

    fn recognised(stamps: &[String]) -> Option<Fractions> {
        Fractions::of(stamps.iter().map(String::as_bytes), |cell| stamp::parse_decimal(cell, TimeUnit::Seconds))
    }

    /// Nanoseconds of rows at a rate, with some jitter.
    fn clock(rate: i64, jitter: i64) -> Vec<i64> {
        let step = 1_000_000_000 / rate;
        (0..rate * 5).map(|row| 48_000_000_000 + row * step + (row * 7919) % 11 * jitter).collect()
    }

    #[test]
    fn lost_zeros_are_recognised_and_no_others() {
        for rate in [25, 50, 100, 400] {
            for (scale, width) in [(1, 9), (1_000, 6), (1_000_000, 3)] {
                let stamps = clock(rate, 60_001);
                let lost = |ns: &i64| format!("{}.{}", ns / 1_000_000_000, ns % 1_000_000_000 / scale);
                let texts: Vec<String> = stamps.iter().map(lost).collect();
                let fractions = recognised(&texts).unwrap();
                assert_eq!(fractions.width, width, "{rate} Hz");
                for (text, ns) in texts.iter().zip(&stamps) {
                    let mended = stamp::parse_decimal(&fractions.mend(text.as_bytes()).unwrap(), TimeUnit::Seconds);
                    assert_eq!(mended, Some(ns / scale * scale), "{text}");
                }
                // The same stamps as they should be, with all digits and without zeros at the end.
                let padded = |ns: &i64| format!("{}.{:0width$}", ns / 1_000_000_000, ns % 1_000_000_000 / scale);
                let trimmed = |ns: &i64| padded(ns).trim_end_matches('0').trim_end_matches('.').to_owned();
                assert_eq!(recognised(&stamps.iter().map(padded).collect::<Vec<_>>()), None);
                assert_eq!(recognised(&stamps.iter().map(trimmed).collect::<Vec<_>>()), None);
            }
        }
        // No fraction begins with a zero, and some are short, but the steps are even as they stand.
        let eighths: Vec<String> = (0..80).map(|k| format!("{}", 48.0 + f64::from(k) / 8.0)).collect();
        assert_eq!(recognised(&eighths), None);
        let begin: Vec<String> = (0..400).map(|k| format!("{}", 0.125 + f64::from(k) / 1000.0)).collect();
        assert_eq!(recognised(&begin), None);
    }
}
