//! Expressions as presentation MathML, which browsers set without a script.

use crate::{
    Expr, Unary,
    typeset::{Forms, Notation, Subscript, Symbol, is_greek, typeset},
};

impl Expr {
    /// The expression as the content of a `<math>` element, set as [`Expr::to_latex`] has it, with numbers of at most six significant digits. Names are escaped.
    pub fn to_mathml(&self) -> String {
        typeset::<MathMl>(self)
    }
}

struct MathMl;

impl Notation for MathMl {
    const FORMS: Forms = Forms {
        parentheses: ["<mrow><mo>(</mo>", "<mo>)</mo></mrow>"],
        absolute: ["<mrow><mo>|</mo>", "<mo>|</mo></mrow>"],
        root: ["<msqrt>", "</msqrt>"],
        fraction: ["<mfrac><mrow>", "</mrow><mrow>", "</mrow></mfrac>"],
        power: ["<msup><mrow>", "</mrow><mrow>", "</mrow></msup>"],
        comma: "<mo>,</mo>",
        plus: "<mo>+</mo>",
        minus: "<mo>\u{2212}</mo>",
        negative: "<mo form=\"prefix\">\u{2212}</mo>",
        product: ["<mspace width=\"0.17em\"/>", "<mo>\u{b7}</mo>"],
        minimum: "<mi>min</mi>",
        maximum: "<mi>max</mi>",
    };

    fn number(digits: &str, exponent: Option<i32>) -> String {
        let mantissa = signed(digits);
        match exponent {
            Some(exponent) => {
                let exponent = signed(&exponent.to_string());
                format!("{mantissa}<mo>\u{b7}</mo><msup><mn>10</mn><mrow>{exponent}</mrow></msup>")
            }
            None => mantissa,
        }
    }

    fn not_finite(value: f64) -> String {
        let text = match value {
            v if v.is_nan() => "<mi>NaN</mi>",
            v if v > 0.0 => "<mi>\u{221e}</mi>",
            _ => "<mo form=\"prefix\">\u{2212}</mo><mi>\u{221e}</mi>",
        };
        text.to_owned()
    }

    /// Six significant digits: more cannot be read.
    fn rounded(value: f64) -> f64 {
        format!("{value:.5e}").parse().unwrap_or(value)
    }

    fn symbol(symbol: &Symbol<'_>) -> String {
        let one = |subscript: &Subscript<'_>| match subscript {
            Subscript::Word(text) => word(text),
            Subscript::Row(0) => "<mi>k</mi>".to_owned(),
            Subscript::Row(lag) => {
                let sign = if *lag > 0 { '\u{2212}' } else { '+' };
                format!("<mi>k</mi><mo>{sign}</mo><mn>{}</mn>", lag.unsigned_abs())
            }
        };
        let subscripts: Vec<String> = symbol.subscripts.iter().map(one).collect();
        let stem = word(symbol.stem);
        if subscripts.is_empty() {
            return stem;
        }
        format!("<msub>{stem}<mrow>{}</mrow></msub>", subscripts.join("<mo>,</mo>"))
    }

    fn function(function: Unary, exponent: Option<i32>) -> String {
        let name = match function {
            Unary::Asin => "arcsin",
            Unary::Acos => "arccos",
            Unary::Atan => "arctan",
            Unary::Log => "ln",
            Unary::Sign => "sgn",
            other => other.name(),
        };
        let name = format!("<mi>{name}</mi>");
        exponent.map_or_else(|| name.clone(), |exponent| format!("<msup>{name}<mn>{exponent}</mn></msup>"))
    }

    fn named(name: &str) -> String {
        format!("<mi>{}</mi>", escaped(name))
    }
}

/// A number with its sign apart.
fn signed(digits: &str) -> String {
    match digits.strip_prefix('-') {
        Some(digits) => format!("<mo form=\"prefix\">\u{2212}</mo><mn>{digits}</mn>"),
        None => format!("<mn>{digits}</mn>"),
    }
}

/// A Greek letter, a number, or a name: browsers set a single letter slanted and a word upright.
fn word(text: &str) -> String {
    if !text.is_empty() && text.bytes().all(|c| c.is_ascii_digit()) {
        return format!("<mn>{text}</mn>");
    }
    match greek(text) {
        Some(letter) => format!("<mi>{letter}</mi>"),
        None => format!("<mi>{}</mi>", escaped(text)),
    }
}

/// The letter of a name.
fn greek(name: &str) -> Option<char> {
    const LETTERS: [(&str, char); 23] = [
        ("alpha", 'α'),
        ("beta", 'β'),
        ("gamma", 'γ'),
        ("delta", 'δ'),
        ("epsilon", 'ε'),
        ("zeta", 'ζ'),
        ("eta", 'η'),
        ("theta", 'θ'),
        ("iota", 'ι'),
        ("kappa", 'κ'),
        ("lambda", 'λ'),
        ("mu", 'μ'),
        ("nu", 'ν'),
        ("xi", 'ξ'),
        ("pi", 'π'),
        ("rho", 'ρ'),
        ("sigma", 'σ'),
        ("tau", 'τ'),
        ("upsilon", 'υ'),
        ("phi", 'φ'),
        ("chi", 'χ'),
        ("psi", 'ψ'),
        ("omega", 'ω'),
    ];
    let small = name.to_ascii_lowercase();
    let (_, letter) = LETTERS.iter().find(|(known, _)| is_greek(name) && *known == small)?;
    if small == name { Some(*letter) } else { letter.to_uppercase().next() }
}

/// Text in which nothing is markup.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use crate::{Expr, Scope};

    #[test]
    fn expressions_are_set_as_in_a_book() {
        for (text, wanted) in [
            ("x", "<mi>x</mi>"),
            ("m1", "<msub><mi>m</mi><mrow><mn>1</mn></mrow></msub>"),
            ("Omega_motor", "<msub><mi>Ω</mi><mrow><mi>motor</mi></mrow></msub>"),
            ("`<b>&`", "<mi>&lt;b&gt;&amp;</mi>"),
            ("2*x", "<mn>2</mn><mspace width=\"0.17em\"/><mi>x</mi>"),
            ("x/2", "<mfrac><mrow><mi>x</mi></mrow><mrow><mn>2</mn></mrow></mfrac>"),
            ("x^2", "<msup><mrow><mi>x</mi></mrow><mrow><mn>2</mn></mrow></msup>"),
            ("sin(x)^2", "<msup><mi>sin</mi><mn>2</mn></msup><mrow><mo>(</mo><mi>x</mi><mo>)</mo></mrow>"),
            (
                "-1e-9",
                "<mo form=\"prefix\">−</mo><mn>1</mn><mo>·</mo><msup><mn>10</mn><mrow><mo form=\"prefix\">−</mo><mn>9</mn></mrow></msup>",
            ),
            ("0.123456789", "<mn>0.123457</mn>"),
            ("lag(x, 1)", "<msub><mi>x</mi><mrow><mi>k</mi><mo>−</mo><mn>1</mn></mrow></msub>"),
        ] {
            let expr = Expr::parse(text, &Scope::open()).unwrap();
            assert_eq!(expr.to_mathml(), wanted, "{text}");
        }
    }
}
