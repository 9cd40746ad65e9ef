//! Cells of text to numbers.

/// Value of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell {
    /// Nothing: empty, or a word for it.
    Missing,
    /// An infinity, or a number beyond what f64 holds. It counts as missing.
    Infinite,
    /// A number.
    Number(f64),
    /// Something else.
    Other,
}

/// Words for a missing value, in lower case; those of spreadsheets and of Windows' C library among them.
const MISSING_WORDS: [&str; 17] = [
    "nan", "null", "none", "na", "n/a", "#n/a", "nil", "?", "-nan", "nat", "<na>", "(null)", "#div/0!", "#value!",
    "#num!", "#ref!", "#null!",
];

/// Texts of Windows' C library for values that are no number, in lower case; digits may follow: `-1.#IND00`.
const MICROSOFT_NAN: [&str; 3] = ["1.#ind", "1.#qnan", "1.#snan"];

/// Reads a number; `decimal_comma` accepts `1,5`.
pub(super) fn number(cell: &[u8], decimal_comma: bool) -> Cell {
    let cell = cell.trim_ascii();
    if cell.is_empty() {
        return Cell::Missing;
    }
    if let Some(value) = std::str::from_utf8(cell).ok().and_then(|text| text.parse::<f64>().ok()) {
        return match value {
            value if value.is_finite() => Cell::Number(value),
            value if value.is_nan() => Cell::Missing,
            _ => Cell::Infinite,
        };
    }
    if is_missing_word(cell) {
        return Cell::Missing;
    }
    if is_microsoft(cell, "1.#inf") {
        return Cell::Infinite;
    }
    if decimal_comma && cell.iter().filter(|&&byte| byte == b',').count() == 1 {
        let mended: Vec<u8> = cell.iter().map(|&byte| if byte == b',' { b'.' } else { byte }).collect();
        return number(&mended, false);
    }
    Cell::Other
}

/// Returns true if the cell is empty or a word for a missing value.
pub(super) fn is_missing(cell: &[u8]) -> bool {
    let cell = cell.trim_ascii();
    cell.is_empty() || is_missing_word(cell)
}

/// A word for what is missing, or dashes in the shape of a number (`-`, `--.--`, `-:--`).
fn is_missing_word(cell: &[u8]) -> bool {
    let is_blank = || cell.contains(&b'-') && cell.iter().all(|byte| matches!(byte, b'-' | b'.' | b',' | b':'));
    let is_word = || MISSING_WORDS.iter().any(|word| cell.eq_ignore_ascii_case(word.as_bytes()));
    cell.len() <= 12 && (is_word() || is_blank() || MICROSOFT_NAN.iter().any(|word| is_microsoft(cell, word)))
}

/// Returns true if a cell is such a word with or without a sign, and zeros behind it.
fn is_microsoft(cell: &[u8], word: &str) -> bool {
    let bare = cell.strip_prefix(b"-").or(cell.strip_prefix(b"+")).unwrap_or(cell);
    let parts = bare.split_at_checked(word.len());
    parts
        .is_some_and(|(start, rest)| start.eq_ignore_ascii_case(word.as_bytes()) && rest.iter().all(u8::is_ascii_digit))
}

/// Reads a truth value: `true`/`false`, `yes`/`no`.
pub(super) fn boolean(cell: &[u8]) -> Option<bool> {
    let cell = cell.trim_ascii();
    let is = |word: &str| cell.eq_ignore_ascii_case(word.as_bytes());
    if is("true") || is("yes") {
        Some(true)
    } else if is("false") || is("no") {
        Some(false)
    } else {
        None
    }
}

/// Returns true if a number is written as a whole one.
pub(super) fn is_whole(cell: &[u8]) -> bool {
    !cell.iter().any(|byte| matches!(byte, b'.' | b'e' | b'E' | b','))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells() {
        for (text, value) in [("1.5", 1.5), (" -2e3 ", -2000.0), ("+7", 7.0), (".5", 0.5), ("5.", 5.0), ("1E-3", 1e-3)]
        {
            assert_eq!(number(text.as_bytes(), false), Cell::Number(value));
        }
        for text in [
            "", "  ", "nan", "NaN", "NAN", "null", "None", "N/A", "-", "<NA>", "-1.#IND", "1.#QNAN0", "--.--",
            "#DIV/0!",
        ] {
            assert_eq!(number(text.as_bytes(), false), Cell::Missing, "{text}");
        }
        for text in ["inf", "-Inf", "infinity", "1e999", "1.#INF", "-1.#INF00"] {
            assert_eq!(number(text.as_bytes(), false), Cell::Infinite, "{text}");
        }
        for text in ["x", "1.2.3", "0x1f", "1,5", "12 V", "\u{ff11}", "..", "1.#x", "-x-"] {
            assert_eq!(number(text.as_bytes(), false), Cell::Other, "{text}");
        }
        assert_eq!(number(b"1,5", true), Cell::Number(1.5));
        assert_eq!(number(b"1,000,5", true), Cell::Other);
        assert_eq!(number(b"\xff\xfe", false), Cell::Other);
        assert_eq!((boolean(b"True"), boolean(b" no"), boolean(b"1")), (Some(true), Some(false), None));
        assert!(is_whole(b"-12") && !is_whole(b"1e3"));
    }
}
