//! Names and comments that are safe in every language, whatever a log's fields are called.

use std::collections::HashSet;

use crate::ExportError;

/// Words that a file or a module cannot be called in C, Rust or Python.
const RESERVED: &[&str] = &[
    "abstract", "and", "as", "assert", "async", "auto", "await", "become", "bool", "box", "break", "case", "char",
    "class", "const", "continue", "core", "crate", "def", "default", "del", "do", "double", "dyn", "elif", "else",
    "enum", "except", "extern", "false", "final", "finally", "float", "fn", "for", "from", "gen", "global", "goto",
    "if", "impl", "import", "in", "inline", "int", "is", "lambda", "let", "libm", "long", "loop", "macro", "main",
    "match", "math", "mod", "move", "mut", "none", "nonlocal", "not", "or", "override", "pass", "priv", "pub", "raise",
    "ref", "register", "restrict", "return", "self", "short", "signed", "sizeof", "static", "std", "struct", "super",
    "switch", "trait", "true", "try", "type", "typedef", "typeof", "union", "unsafe", "unsigned", "unsized", "use",
    "virtual", "void", "volatile", "where", "while", "with", "yield",
];

/// Refuses a prefix that cannot begin an identifier in every language.
pub(crate) fn check_prefix(prefix: &str) -> Result<(), ExportError> {
    let problem = if !prefix.starts_with(|c: char| c.is_ascii_lowercase()) {
        "must begin with a letter from a to z"
    } else if !prefix.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_') {
        "may have lower-case letters, digits and _ only"
    } else if prefix.len() > 31 {
        "is longer than 31 characters"
    } else if prefix.ends_with('_') || prefix.contains("__") {
        "must not end in _ or contain __"
    } else if RESERVED.contains(&prefix) {
        "is a reserved word"
    } else {
        return Ok(());
    };
    Err(ExportError::Prefix { prefix: prefix.to_owned(), problem })
}

/// Distinct identifiers of upper-case letters, digits and `_` for names, in order. They stand behind a prefix, so that they may begin with a digit.
pub(crate) fn constants<'a>(names: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut taken = HashSet::new();
    names
        .into_iter()
        .map(|name| {
            let mut word = String::new();
            for c in name.chars() {
                if c.is_ascii_alphanumeric() {
                    word.push(c.to_ascii_uppercase());
                } else if !word.ends_with('_') {
                    word.push('_');
                }
            }
            let word = word.trim_matches('_');
            let word: String = if word.is_empty() { "X".into() } else { word.chars().take(48).collect() };
            let mut candidate = word.clone();
            let mut number = 1;
            // `COUNT` ends every list.
            while candidate == "COUNT" || !taken.insert(candidate.clone()) {
                number += 1;
                candidate = format!("{word}_{number}");
            }
            candidate
        })
        .collect()
}

/// Text that ends no comment and hides nothing: one line, no control or direction characters, no comment marks.
pub(crate) fn comment(text: &str) -> String {
    let visible = |c: char| if c.is_control() || c.is_whitespace() || is_hidden(c) { ' ' } else { c };
    let text: String = text.chars().map(visible).collect();
    text.replace('\\', "/").replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?").replace("\"\"\"", "'''")
}

/// Characters that change the direction of a line, or that nobody sees.
fn is_hidden(c: char) -> bool {
    matches!(c, '\u{ad}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

/// A literal in double quotes that Rust and Python read alike, but for `escape`: how the language writes the code of a
/// character that is not printed as it is.
pub(crate) fn literal(text: &str, escape: impl Fn(u32) -> String) -> String {
    let mut out = String::from('"');
    for c in text.chars() {
        match c {
            '\\' | '"' => out.extend(['\\', c]),
            c if c.is_control() || is_hidden(c) => out += &escape(c.into()),
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

/// `CamelCase` of a prefix.
pub(crate) fn camel(prefix: &str) -> String {
    prefix
        .split('_')
        .map(|part| {
            let mut letters = part.chars();
            letters.next().map_or_else(String::new, |first| first.to_ascii_uppercase().to_string() + letters.as_str())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_distinct_and_plain() {
        let names = ["vx", "VX", "/odom.twist[0]", "", "count", "é", "1", "a b", "a-b"];
        assert_eq!(constants(names), ["VX", "VX_2", "ODOM_TWIST_0", "X", "COUNT_2", "X_2", "1", "A_B", "A_B_2"]);
    }

    #[test]
    fn text_cannot_end_a_comment() {
        assert_eq!(comment("a*/ b\n#define x \\\u{202e}"), "a* / b #define x / ");
    }

    #[test]
    fn literals_keep_every_name_apart() {
        let rust = |text: &str| literal(text, |code| format!("\\u{{{code:x}}}"));
        assert_eq!(rust("m/s² \"x\"\\"), r#""m/s² \"x\"\\""#);
        assert_eq!([rust("θ"), rust("ω")], ["\"θ\"", "\"ω\""]);
        assert_eq!(rust("a\nb\u{202e}\u{7f}"), r#""a\u{a}b\u{202e}\u{7f}""#);
    }

    #[test]
    fn prefixes_are_identifiers_everywhere() {
        for prefix in ["drag", "a1_b", "x"] {
            assert!(check_prefix(prefix).is_ok(), "{prefix}");
        }
        for prefix in ["", "1a", "Drag", "while", "a b", "a__b", "a_", "é", "self"] {
            let message = check_prefix(prefix).unwrap_err().to_string();
            assert!(message.contains(&format!("`{prefix}`")), "{message}");
        }
        assert_eq!(camel("drag_model"), "DragModel");
    }
}
