//! Names of columns as mathematical symbols.

const GREEK: [&str; 34] = [
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu", "xi",
    "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi", "omega", "pi", "Gamma", "Delta", "Theta", "Lambda", "Xi",
    "Pi", "Sigma", "Upsilon", "Phi", "Psi", "Omega",
];

/// The letters of [`GREEK`], in its order.
const LETTERS: &str = "αβγδεζηθικλμνξρστυφχψωπΓΔΘΛΞΠΣΥΦΨΩ";

/// The name of a Greek letter; `None` of others, and of those that look like Latin ones.
pub(crate) fn greek_name(letter: char) -> Option<&'static str> {
    LETTERS.chars().position(|known| known == letter).map(|place| GREEK[place])
}

/// Returns true if a word is the name of a Greek letter.
pub(crate) fn is_greek(word: &str) -> bool {
    GREEK.contains(&word)
}

/// A name as a stem with what stands behind its first `_`, `.` or `[`, and the digits at its end, as subscripts.
pub(crate) struct Symbol<'a> {
    pub(crate) stem: &'a str,
    pub(crate) subscripts: Vec<Subscript<'a>>,
}

/// A subscript.
pub(crate) enum Subscript<'a> {
    /// Digits or a word of the name.
    Word(&'a str),
    /// The row, so many rows back.
    Row(i32),
}

impl<'a> Symbol<'a> {
    /// The symbol of a name; with `lag` it has its row too.
    pub(crate) fn new(name: &'a str, lag: Option<i32>) -> Self {
        let mut parts = name.split(['_', '.', '[', ']']).filter(|part| !part.is_empty());
        let head = parts.next().unwrap_or(name);
        let stem = head.trim_end_matches(|c: char| c.is_ascii_digit());
        // Digits alone are no name.
        let (stem, digits) = if stem.is_empty() { (head, "") } else { head.split_at(stem.len()) };
        let digits = (!digits.is_empty()).then_some(digits);
        let subscripts = digits.into_iter().chain(parts).map(Subscript::Word).chain(lag.map(Subscript::Row));
        Self { stem, subscripts: subscripts.collect() }
    }
}
