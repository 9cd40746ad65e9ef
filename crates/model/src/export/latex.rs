//! Equations for people, in LaTeX.

use std::fmt::Write;

use fleetfoot_library::{Binary, Expr, Node, Unary};

use super::{ExportOptions, ExportedFile};
use crate::{Latent, Model, Prediction, Rule};

/// The file `prefix.tex`: an `align*` for the equations, one for the latents, regions as cases. It needs the package `amsmath`.
pub(super) fn file(model: &Model, options: &ExportOptions) -> ExportedFile {
    let mut out = String::new();
    let note = super::names::comment(&format!("{} model {}, {} rows", model.method, model.hash(), model.training.rows));
    let _ = writeln!(out, "% {note}. Needs \\usepackage{{amsmath}}.");
    let lines: Vec<String> = model
        .equations
        .iter()
        .map(|equation| {
            let subject = name(&equation.subject);
            let left = match equation.prediction {
                Prediction::Derivative => format!("\\frac{{\\mathrm{{d}}}}{{\\mathrm{{d}}t}} {subject}"),
                Prediction::Next => format!("{subject}_{{k+1}}"),
                Prediction::Difference => format!("{subject}_{{k+1}} - {subject}_{{k}}"),
                Prediction::Value => subject,
            };
            format!("{left} &= {}", text(&equation.right))
        })
        .collect();
    align(&mut out, &lines);
    let latents: Vec<String> = model.latents.iter().map(|latent| latent_lines(model, latent)).collect();
    align(&mut out, &latents);
    for (index, partition) in model.partitions.iter().enumerate() {
        if partition.rule != Rule::Whole {
            partition_lines(&mut out, index, partition);
        }
    }
    ExportedFile::text(format!("{}.tex", options.prefix), out)
}

fn align(out: &mut String, lines: &[String]) {
    if !lines.is_empty() {
        let _ = writeln!(out, "\\begin{{align*}}\n{}\n\\end{{align*}}", lines.join(" \\\\\n"));
    }
}

/// `f = c + ...`, or a case a region.
fn latent_lines(model: &Model, latent: &Latent) -> String {
    let left = name(&latent.name);
    let regions = latent.constants.len();
    if regions == 1 {
        return format!("{left} &= {}", sum(model, latent, 0));
    }
    let names = &model.partitions[latent.partition].regions;
    let case = |region: usize| {
        let label = names.get(region).map_or_else(|| region.to_string(), |region| region.name.clone());
        format!("  {} & \\text{{region {}}}", sum(model, latent, region), escaped(&label))
    };
    let cases: Vec<String> = (0..regions).map(case).collect();
    format!("{left} &= \\begin{{cases}}\n{}\n\\end{{cases}}", cases.join(" \\\\\n"))
}

fn sum(model: &Model, latent: &Latent, region: usize) -> String {
    let mut out = String::new();
    let mut add = |value: f64, function: Option<&Expr>| {
        let sign = match (out.is_empty(), value < 0.0) {
            (true, false) => "",
            (true, true) => "-",
            (false, false) => " + ",
            (false, true) => " - ",
        };
        out += sign;
        out += &number(value.abs());
        if let Some(function) = function {
            let body = factor(function);
            let _ = write!(out, "\\,{body}");
        }
    };
    if latent.constants[region] != 0.0 {
        add(latent.constants[region], None);
    }
    for (function, &value) in model.libraries[latent.library].iter().zip(&latent.coefficients[region]) {
        if value != 0.0 {
            add(value, Some(function));
        }
    }
    if out.is_empty() { "0".into() } else { out }
}

fn partition_lines(out: &mut String, index: usize, partition: &crate::Partition) {
    let _ = writeln!(out, "% Regions of partition {index}: {}.", super::names::comment(&partition.specification));
    let lines: Vec<String> = partition
        .columns
        .iter()
        .zip(partition.centre.iter().zip(&partition.scale))
        .enumerate()
        .map(|(i, (column, (centre, scale)))| {
            let sign = if *centre < 0.0 { '+' } else { '-' };
            format!(
                "z_{{{}}} &= \\frac{{{} {sign} {}}}{{{}}}",
                i + 1,
                text(column),
                number(centre.abs()),
                number(*scale)
            )
        })
        .collect();
    align(out, &lines);
    match &partition.rule {
        Rule::Linear { weights, offsets } => {
            let _ = writeln!(out, "The region is $\\operatorname{{arg\\,max}}_i (w_i^\\top z + b_i)$ with");
            let row = |(weights, offset): (&Vec<f64>, &f64)| {
                let weights: Vec<String> = weights.iter().map(|&weight| signed(weight)).collect();
                format!("  {} & {}", weights.join(" & "), signed(*offset))
            };
            let rows: Vec<String> = weights.iter().zip(offsets).map(row).collect();
            let columns = "r".repeat(partition.columns.len());
            let _ = writeln!(
                out,
                "\\[\n[W \\mid b] = \\left[\\begin{{array}}{{{columns}|r}}\n{}\n\\end{{array}}\\right]\n\\]",
                rows.join(" \\\\\n")
            );
        }
        Rule::Ball { radius } => {
            let _ =
                writeln!(out, "The region is inner where $\\lVert z \\rVert \\le {}$, else outer.", number(*radius));
        }
        Rule::Labels { names, .. } => {
            let names: Vec<String> = names.iter().map(|name| escaped(name)).collect();
            let _ = writeln!(out, "The region follows from the label, the last of these: {}.", names.join(", "));
        }
        Rule::Whole => {}
    }
}

/// How tightly a formula binds.
#[derive(Clone, PartialEq, PartialOrd)]
enum Binding {
    Sum,
    Product,
    Atom,
}

/// A formula.
fn text(expr: &Expr) -> String {
    formula(expr).0
}

/// A formula that may stand in a product.
fn factor(expr: &Expr) -> String {
    let (body, binding) = formula(expr);
    if binding < Binding::Product { bracketed(&body) } else { body }
}

fn bracketed(body: &str) -> String {
    format!("\\left({body}\\right)")
}

fn formula(expr: &Expr) -> (String, Binding) {
    expr.fold(|part, arguments: &[(String, Binding)]| {
        let at_least = |index: usize, least: Binding| {
            let (body, binding) = &arguments[index];
            if *binding < least { bracketed(body) } else { body.clone() }
        };
        match part.node() {
            Node::Number(value) => {
                (signed(*value), if value.is_sign_negative() { Binding::Sum } else { Binding::Atom })
            }
            Node::Column { name: column, lag } => (lagged(&name(column), *lag), Binding::Atom),
            Node::Time { lag } => (lagged("t", *lag), Binding::Atom),
            Node::Power(_, exponent) => {
                (format!("{{{}}}^{{{exponent}}}", at_least(0, Binding::Atom)), Binding::Product)
            }
            Node::Unary(function, _) => unary(*function, &arguments[0].0, &at_least(0, Binding::Product)),
            Node::Binary(function, ..) => match function {
                Binary::Add => (format!("{} + {}", arguments[0].0, at_least(1, Binding::Product)), Binding::Sum),
                Binary::Sub => (format!("{} - {}", arguments[0].0, at_least(1, Binding::Product)), Binding::Sum),
                Binary::Mul => {
                    (format!("{}\\,{}", at_least(0, Binding::Product), at_least(1, Binding::Product)), Binding::Product)
                }
                Binary::Div => (format!("\\frac{{{}}}{{{}}}", arguments[0].0, arguments[1].0), Binding::Atom),
                Binary::Pow => (format!("{{{}}}^{{{}}}", at_least(0, Binding::Atom), arguments[1].0), Binding::Product),
                Binary::Atan2 => (call("\\operatorname{atan2}", &pair(arguments)), Binding::Atom),
                Binary::Min => (call("\\min", &pair(arguments)), Binding::Atom),
                Binary::Max => (call("\\max", &pair(arguments)), Binding::Atom),
            },
        }
    })
}

fn pair(arguments: &[(String, Binding)]) -> String {
    arguments.iter().map(|argument| argument.0.as_str()).collect::<Vec<_>>().join(", ")
}

fn call(function: &str, arguments: &str) -> String {
    format!("{function}{}", bracketed(arguments))
}

fn unary(function: Unary, plain: &str, product: &str) -> (String, Binding) {
    let name = match function {
        Unary::Neg => return (format!("-{product}"), Binding::Sum),
        Unary::Sqrt => return (format!("\\sqrt{{{plain}}}"), Binding::Atom),
        Unary::Abs => return (format!("\\left|{plain}\\right|"), Binding::Atom),
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
        Unary::Sign => "\\operatorname{sgn}",
        Unary::Step => "\\operatorname{H}",
        Unary::Wrap => "\\operatorname{wrap}",
    };
    (call(name, plain), Binding::Atom)
}

fn lagged(name: &str, lag: i32) -> String {
    match lag {
        0 => name.to_owned(),
        lag if lag > 0 => format!("{{{name}}}_{{k-{lag}}}"),
        lag => format!("{{{name}}}_{{k+{}}}", lag.unsigned_abs()),
    }
}

/// A name upright, one letter in italics.
fn name(name: &str) -> String {
    let mut letters = name.chars();
    match (letters.next(), letters.next()) {
        (Some(letter), None) if letter.is_ascii_alphabetic() => letter.to_string(),
        _ => format!("\\mathrm{{{}}}", escaped(name)),
    }
}

/// Text in which nothing is a command.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in super::names::comment(text).chars() {
        match c {
            '\\' => out += "\\backslash{}",
            '{' | '}' | '_' | '$' | '%' | '&' | '#' => {
                out.push('\\');
                out.push(c);
            }
            '^' => out += "\\hat{}",
            '~' => out += "\\sim{}",
            other => out.push(other),
        }
    }
    out
}

fn signed(value: f64) -> String {
    if value < 0.0 { format!("-{}", number(-value)) } else { number(value) }
}

/// Six significant digits.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !value.is_finite() {
        return if value.is_nan() { "\\mathrm{nan}".into() } else { "\\infty".into() };
    }
    let scientific = format!("{value:.5e}");
    let (digits, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let trimmed = |text: &str| {
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text.to_owned() }
    };
    if (-4..6).contains(&exponent) {
        let decimals = usize::try_from(5 - exponent).unwrap_or(0);
        return trimmed(&format!("{value:.decimals$}"));
    }
    match trimmed(digits).as_str() {
        "1" => format!("10^{{{exponent}}}"),
        digits => format!("{digits} \\cdot 10^{{{exponent}}}"),
    }
}
