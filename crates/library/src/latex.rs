//! Expressions as LaTeX mathematics.

use crate::{
    Expr, Unary,
    typeset::{Forms, Notation, Subscript, Symbol, greek_name, is_greek, typeset},
};

impl Expr {
    /// The expression in LaTeX's mathematical mode: quotients as fractions, `vx_1` as an upright vx with the subscript 1, Greek
    /// letters by their names, other characters beyond ASCII as text that pdflatex sets, columns of a recording in discrete time as `x_{k-1}` (where a lag occurs, every column has its `k`).
    pub fn to_latex(&self) -> String {
        typeset::<Latex>(self)
    }
}

struct Latex;

impl Notation for Latex {
    const FORMS: Forms = Forms {
        parentheses: ["\\left(", "\\right)"],
        absolute: ["\\left|", "\\right|"],
        root: ["\\sqrt{", "}"],
        fraction: ["\\frac{", "}{", "}"],
        power: ["", "^{", "}"],
        comma: ", ",
        plus: " + ",
        minus: " - ",
        negative: "-",
        product: [" \\, ", " \\cdot "],
        minimum: "\\min",
        maximum: "\\max",
    };

    fn number(digits: &str, exponent: Option<i32>) -> String {
        match exponent {
            Some(exponent) => format!("{digits} \\cdot 10^{{{exponent}}}"),
            None => digits.to_owned(),
        }
    }

    fn not_finite(value: f64) -> String {
        let text = match value {
            v if v.is_nan() => "\\mathrm{NaN}",
            v if v > 0.0 => "\\infty",
            _ => "-\\infty",
        };
        text.to_owned()
    }

    /// All digits: what is exported is computed with.
    fn rounded(value: f64) -> f64 {
        value
    }

    fn symbol(symbol: &Symbol<'_>) -> String {
        let one = |subscript: &Subscript<'_>| match subscript {
            Subscript::Word(text) => word(text),
            Subscript::Row(0) => "k".to_owned(),
            Subscript::Row(lag) => format!("k{}{}", if *lag > 0 { '-' } else { '+' }, lag.unsigned_abs()),
        };
        let subscripts: Vec<String> = symbol.subscripts.iter().map(one).collect();
        let stem = word(symbol.stem);
        if subscripts.is_empty() { stem } else { format!("{stem}_{{{}}}", subscripts.join(",")) }
    }

    fn function(function: Unary, exponent: Option<i32>) -> String {
        let name = match function {
            Unary::Neg => "-",
            Unary::Sin => "\\sin",
            Unary::Cos => "\\cos",
            Unary::Tan => "\\tan",
            Unary::Asin => "\\arcsin",
            Unary::Acos => "\\arccos",
            Unary::Atan => "\\arctan",
            Unary::Sinh => "\\sinh",
            Unary::Cosh => "\\cosh",
            Unary::Tanh => "\\tanh",
            Unary::Exp => "\\exp",
            Unary::Log => "\\ln",
            Unary::Sqrt => "\\sqrt",
            Unary::Abs => "\\operatorname{abs}",
            Unary::Sign => "\\operatorname{sgn}",
            Unary::Step => "\\operatorname{step}",
            Unary::Wrap => "\\operatorname{wrap}",
        };
        exponent.map_or_else(|| name.to_owned(), |exponent| format!("{name}^{{{exponent}}}"))
    }

    fn named(name: &str) -> String {
        format!("\\operatorname{{{}}}", name.replace('_', "\\_"))
    }
}

/// A Greek letter, a single letter, a number, or an upright word.
fn word(text: &str) -> String {
    if is_greek(text) {
        return format!("\\{text}");
    }
    let mut characters = text.chars();
    let first = characters.next().filter(|_| characters.next().is_none());
    if let Some(name) = first.and_then(greek_name) {
        return format!("\\{name}");
    }
    if first.is_some_and(|c| c.is_ascii_alphabetic()) || (!text.is_empty() && text.bytes().all(|c| c.is_ascii_digit()))
    {
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
            c if c.is_ascii() => word.push(c),
            c => word += &beyond_ascii(c),
        }
    }
    word.push('}');
    word
}

/// A character that mathematics of pdflatex with the package `amsmath` alone does not set.
fn beyond_ascii(c: char) -> String {
    const LATIN: &str = "ΑΒΕΖΗΙΚΜΝΟΡΤΧο";
    const ALIKE: &str = "ABEZHIKMNOPTXo";
    let digit = |first: char| char::from_digit(u32::from(c).wrapping_sub(first.into()), 10);
    if let Some(name) = greek_name(c) {
        return format!("\\{name}{{}}");
    }
    if let Some(place) = LATIN.chars().position(|letter| letter == c) {
        return ALIKE[place..=place].to_owned();
    }
    if let Some(digit) = digit('₀') {
        return format!("{{}}_{{{digit}}}");
    }
    match c {
        '¹' => "{}^{1}".to_owned(),
        '²' => "{}^{2}".to_owned(),
        '³' => "{}^{3}".to_owned(),
        '°' => "{}^{\\circ}".to_owned(),
        'µ' => "\\mu{}".to_owned(),
        '·' => "\\cdot{}".to_owned(),
        '×' => "\\times{}".to_owned(),
        // The thorn and the eth are in no font that is always there.
        'À'..='ÿ' if !"ÐÞðþ÷".contains(c) => format!("\\text{{{c}}}"),
        c => format!("\\text{{U+{:04X}}}", u32::from(c)),
    }
}

#[cfg(test)]
mod tests {
    use crate::{Expr, Scope};

    #[test]
    fn expressions_read_as_in_a_book() {
        for (text, wanted) in [
            ("x", "x"),
            ("vx_1", "\\mathrm{vx}_{1}"),
            ("m1", "m_{1}"),
            ("alpha", "\\alpha"),
            ("omega_motor", "\\omega_{\\mathrm{motor}}"),
            ("`θ`", "\\theta"),
            ("`Ω_motor`", "\\Omega_{\\mathrm{motor}}"),
            ("`θ₁₂`*`ω²`", "\\mathrm{\\theta{}{}_{1}{}_{2}} \\, \\mathrm{\\omega{}{}^{2}}"),
            ("`Größe Α`", "\\mathrm{Gr\\text{ö}\\text{ß}e\\ A}"),
            ("`速`", "\\mathrm{\\text{U+901F}}"),
            ("q.x", "q_{x}"),
            ("u[2]", "u_{2}"),
            ("/odom.twist", "\\mathrm{/odom}_{\\mathrm{twist}}"),
            ("`a&b%c`", "\\mathrm{a\\&b\\%c}"),
            ("x^2*y", "x^{2} \\, y"),
            ("2*x", "2 \\, x"),
            ("2*3^x", "2 \\cdot 3^{x}"),
            ("-x + y - (z - 1)", "-x + y - \\left(z - 1\\right)"),
            ("x*(y + 1)", "x \\, \\left(y + 1\\right)"),
            ("x*-2", "x \\, \\left(-2\\right)"),
            ("(x + 1)/(2*y)", "\\frac{x + 1}{2 \\, y}"),
            ("(x/y)^2", "\\left(\\frac{x}{y}\\right)^{2}"),
            ("(x^2)^y", "\\left(x^{2}\\right)^{y}"),
            ("sin(x)^2", "\\sin^{2}\\left(x\\right)"),
            ("sin(x)^-1", "\\left(\\sin\\left(x\\right)\\right)^{-1}"),
            ("sqrt(abs(x - y))", "\\sqrt{\\left|x - y\\right|}"),
            ("abs(x)^3", "\\left|x\\right|^{3}"),
            ("sign(x)*tanh(y)", "\\operatorname{sgn}\\left(x\\right) \\, \\tanh\\left(y\\right)"),
            ("max(x, 0)", "\\max\\left(x, 0\\right)"),
            ("1e-9*x", "1 \\cdot 10^{-9} \\, x"),
            ("lag(x, 1) + x", "x_{k-1} + x_{k}"),
            ("lead(m1, 2)", "m_{1,k+2}"),
            ("lag1(m1, tau)^2", "\\operatorname{lag1}\\left(m_{1}, \\tau\\right)^{2}"),
            ("time()", "t"),
        ] {
            let expr = Expr::parse(text, &Scope::open()).unwrap();
            assert_eq!(expr.to_latex(), wanted, "{text}");
        }
    }
}
