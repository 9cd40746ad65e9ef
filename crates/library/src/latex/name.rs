//! Names of columns as mathematical symbols.

use std::fmt::Write;

const GREEK: [&str; 34] = [
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu", "xi",
    "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi", "omega", "pi", "Gamma", "Delta", "Theta", "Lambda", "Xi",
    "Pi", "Sigma", "Upsilon", "Phi", "Psi", "Omega",
];

/// A name with what stands behind its first `_`, `.` or `[`, and the digits at its end, as subscripts; with `lag` the row too.
pub(super) fn symbol(name: &str, lag: Option<i32>) -> String {
    let mut parts = name.split(['_', '.', '[', ']']).filter(|part| !part.is_empty());
    let head = parts.next().unwrap_or(name);
    let stem = head.trim_end_matches(|c: char| c.is_ascii_digit());
    // Digits alone are no name.
    let (stem, digits) = if stem.is_empty() { (head, "") } else { head.split_at(stem.len()) };
    let digits = (!digits.is_empty()).then(|| digits.to_owned());
    let mut subscripts: Vec<String> = digits.into_iter().chain(parts.map(word)).collect();
    match lag {
        None => {}
        Some(0) => subscripts.push("k".to_owned()),
        Some(lag) => subscripts.push(format!("k{}{}", if lag > 0 { '-' } else { '+' }, lag.unsigned_abs())),
    }
    let mut symbol = word(stem);
    if !subscripts.is_empty() {
        let _ = write!(symbol, "_{{{}}}", subscripts.join(","));
    }
    symbol
}

/// A Greek letter, a single letter, a number, or an upright word.
fn word(text: &str) -> String {
    if GREEK.contains(&text) {
        return format!("\\{text}");
    }
    let mut characters = text.chars();
    let single = characters.next().is_some_and(|c| c.is_ascii_alphabetic()) && characters.next().is_none();
    if single || (!text.is_empty() && text.bytes().all(|c| c.is_ascii_digit())) {
        return text.to_owned();
    }
    let mut word = "\\mathrm{".to_owned();
    for c in text.chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => word.extend(['\\', c]),
            '\\' => word.push_str("\\backslash "),
            '^' => word.push_str("\\hat{}"),
            '~' => word.push_str("\\sim "),
            ' ' => word.push_str("\\ "),
            _ => word.push(c),
        }
    }
    word.push('}');
    word
}
