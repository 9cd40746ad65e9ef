//! Numbers as people write them.

/// `1 episode`, `2 episodes`.
pub fn count(number: usize, noun: &str) -> String {
    format!("{number} {noun}{}", if number == 1 { "" } else { "s" })
}

/// Four significant digits.
pub fn number(value: f64) -> String {
    significant(value, 4)
}

/// A number with so many significant digits, one at least.
fn significant(value: f64, digits: i32) -> String {
    if value.is_nan() {
        return "-".into();
    }
    if value == 0.0 || value.is_infinite() {
        return format!("{value}");
    }
    let magnitude = value.abs().log10().floor() as i32;
    if (-4..6).contains(&magnitude) {
        format!("{value:.*}", (digits - 1 - magnitude).max(0) as usize)
    } else {
        format!("{value:.*e}", (digits - 1) as usize)
    }
}

/// Three decimals, for ratios around one; smaller ones in scientific form.
pub fn ratio(value: f64) -> String {
    match value {
        v if v.is_nan() => "-".into(),
        v if v != 0.0 && !(5e-4..1e6).contains(&v.abs()) => format!("{v:.1e}"),
        v => format!("{v:.3}"),
    }
}

/// Seconds, in a unit that suits.
pub fn seconds(value: f64) -> String {
    match value {
        v if v.is_nan() => "-".into(),
        v if v < 1.0 => format!("{} ms", number(v * 1e3)),
        v if v < 600.0 => format!("{} s", number(v)),
        v => format!("{} min", number(v / 60.0)),
    }
}

/// Bytes, in a unit that suits.
pub fn bytes(value: u64) -> String {
    let value = value as f64;
    match value {
        v if v < 1e3 => format!("{v} B"),
        v if v < 1e6 => format!("{} kB", number(v / 1e3)),
        v if v < 1e9 => format!("{} MB", number(v / 1e6)),
        v => format!("{} GB", number(v / 1e9)),
    }
}

/// A whole number with its thousands apart: `24 841`, with narrow spaces that do not break.
pub fn thousands(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3 * 3);
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) && digits.len() > 4 {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

/// A value with half the width of its interval, that to two significant digits: `\u{2212}1.994 \u{b1} 0.012`; without it where that is not known.
pub fn within(value: f64, half_width: f64) -> String {
    let value = typeset(&number(value));
    if half_width.is_finite() { format!("{value} \u{b1} {}", typeset(&significant(half_width, 2))) } else { value }
}

/// Things in a row: `a`, `a and b`, `a, b and c`; of more than `most` the first ones and how many more.
pub fn series(names: &[String], most: usize) -> String {
    let shown = &names[..names.len().min(most)];
    match (shown, names.len() - shown.len()) {
        ([], _) => String::new(),
        ([one], 0) => one.clone(),
        ([most @ .., last], 0) => format!("{} and {last}", most.join(", ")),
        (shown, more) => format!("{} and {more} more", shown.join(", ")),
    }
}

/// A unit as it is typeset: `m/s\u{b2}` for `m/s^2`.
pub fn unit(text: &str) -> String {
    let mut parts = text.split('^');
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let sign = usize::from(part.starts_with('-'));
        let digits = part[sign..].bytes().take_while(u8::is_ascii_digit).count();
        let (power, behind) = part.split_at(if digits == 0 { 0 } else { sign + digits });
        out.push_str(if digits == 0 { "^" } else { "" });
        out.push_str(&raised(power));
        out.push_str(behind);
    }
    out
}

/// A number as it is typeset: with a minus instead of a hyphen, and a power of ten instead of an `e`.
pub(crate) fn typeset(text: &str) -> String {
    let minus = |text: &str| text.replace('-', "\u{2212}");
    match text.split_once('e') {
        Some((digits, power)) if digits.parse::<f64>().is_ok() && power.parse::<i32>().is_ok() => {
            format!("{}\u{b7}10{}", minus(digits), raised(power))
        }
        _ => minus(text),
    }
}

/// Digits of an exponent.
fn raised(text: &str) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let one = |c: char| match c.to_digit(10) {
        Some(digit) => DIGITS[digit as usize],
        None => '⁻',
    };
    text.trim_start_matches('+').chars().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::{series, thousands, typeset, unit, within};

    #[test]
    fn units_are_typeset() {
        for (text, set) in [("m/s^2", "m/s²"), ("kg*m^-1*s", "kg*m⁻¹*s"), ("rad", "rad"), ("a^b^", "a^b^"), ("^", "^")]
        {
            assert_eq!(unit(text), set);
        }
    }

    #[test]
    fn numbers_are_typeset() {
        for (text, set) in
            [("-1.5", "−1.5"), ("1.2e-5", "1.2·10⁻⁵"), ("-3e20", "−3·10²⁰"), ("-", "−"), ("0.25", "0.25")]
        {
            assert_eq!(typeset(text), set);
        }
        assert_eq!(thousands(999), "999");
        assert_eq!(thousands(9999), "9999");
        assert_eq!(thousands(1_234_567), "1\u{202f}234\u{202f}567");
    }

    #[test]
    fn values_have_their_intervals() {
        for (value, half, text) in [
            (-1.99419, 0.012_345, "\u{2212}1.994 \u{b1} 0.012"),
            (1.2e-7, 3e-8, "1.200\u{b7}10\u{207b}\u{2077} \u{b1} 3.0\u{b7}10\u{207b}\u{2078}"),
            (2.0, f64::INFINITY, "2.000"),
        ] {
            assert_eq!(within(value, half), text);
        }
    }

    #[test]
    fn lists_are_joined_with_commas_and_and() {
        let names = ["a", "b", "c"].map(str::to_owned);
        assert_eq!(series(&names[..1], 3), "a");
        assert_eq!(series(&names[..2], 3), "a and b");
        assert_eq!(series(&names, 3), "a, b and c");
        assert_eq!(series(&names, 2), "a, b and 1 more");
        assert_eq!(series(&[], 2), "");
    }
}
