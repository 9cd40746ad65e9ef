//! The words of an OMG IDL text.

/// A word of IDL with the line that it stands on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Token<'a> {
    pub(super) kind: TokenKind<'a>,
    pub(super) line: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum TokenKind<'a> {
    /// A name or keyword; scoped names are one word, `a::b::C`.
    Name(&'a str),
    /// A whole number.
    Number(u64),
    /// A text, a character, or a number that is not whole: nothing that decides about bytes.
    Literal,
    /// Any other character.
    Sign(char),
}

/// Cuts a text into words. Comments, preprocessor lines, separators of `=` and the `IDL: name` lines behind them are left out.
///
/// # Errors
/// A comment or text that does not end; the answer tells the line.
pub(super) fn tokens(text: &str) -> Result<Vec<Token<'_>>, String> {
    let mut tokens = Vec::new();
    let mut rest = text;
    let mut line = 1;
    let mut line_start = true;
    while let Some(first) = rest.chars().next() {
        if line_start && !first.is_whitespace() && is_left_out(rest) {
            rest = rest.find('\n').map_or("", |end| &rest[end..]);
            line_start = false;
            continue;
        }
        let length = match first {
            c if c.is_whitespace() => c.len_utf8(),
            '/' if rest.starts_with("//") => rest.find('\n').unwrap_or(rest.len()),
            '/' if rest.starts_with("/*") => {
                rest.get(2..)
                    .and_then(|inside| inside.find("*/"))
                    .ok_or_else(|| format!("the comment in line {line} does not end"))?
                    + 4
            }
            '"' | '\'' => {
                let length = quoted(rest, first).ok_or_else(|| format!("the text in line {line} does not end"))?;
                tokens.push(Token { kind: TokenKind::Literal, line });
                length
            }
            c if c.is_ascii_alphabetic() || c == '_' || rest.starts_with("::") => {
                let length = name(rest);
                tokens.push(Token { kind: TokenKind::Name(&rest[..length]), line });
                length
            }
            c if c.is_ascii_digit() => {
                let length =
                    rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '.' && c != '_').unwrap_or(rest.len());
                tokens.push(Token { kind: whole(&rest[..length]).map_or(TokenKind::Literal, TokenKind::Number), line });
                length
            }
            c => {
                tokens.push(Token { kind: TokenKind::Sign(c), line });
                c.len_utf8()
            }
        };
        let (word, after) = rest.split_at(length);
        line += word.bytes().filter(|&byte| byte == b'\n').count();
        // White space at the beginning of a line does not end the beginning.
        line_start = word.ends_with('\n') || (line_start && first.is_whitespace());
        rest = after;
    }
    Ok(tokens)
}

/// Returns true if this line is for the preprocessor or between definitions.
fn is_left_out(rest: &str) -> bool {
    let line = rest.lines().next().unwrap_or_default().trim();
    line.starts_with('#') || line.starts_with("IDL:") || re_ros_msg::is_schema_separator(line)
}

/// The bytes of a quoted text.
fn quoted(text: &str, quote: char) -> Option<usize> {
    let mut escaped = false;
    for (place, c) in text.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            c if c == quote => return Some(place + c.len_utf8()),
            _ => {}
        }
    }
    None
}

/// The bytes of a scoped name.
fn name(text: &str) -> usize {
    let mut length = 0;
    loop {
        let rest = &text[length..];
        length += if rest.starts_with("::") {
            2
        } else {
            match rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(rest.len()) {
                0 => return length,
                word => word,
            }
        };
    }
}

fn whole(text: &str) -> Option<u64> {
    match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => u64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}
