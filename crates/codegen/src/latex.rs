//! Equations for people, in LaTeX.

use std::fmt::Write;

use fleetfoot_library::Expr;
use fleetfoot_model::{Definition, Latent, Model, Prediction, Rule, Tree, summands};

use crate::{ExportOptions, ExportedFile};

/// The file `prefix.tex`: an `align*` for the equations, one for the latents, regions as cases. It needs the package `amsmath`.
pub(crate) fn file(model: &Model, options: &ExportOptions) -> ExportedFile {
    let mut out = String::new();
    let note = crate::names::comment(&format!("{} model {}, {} rows", model.method, model.hash(), model.training.rows));
    let _ = writeln!(out, "% {note}. Needs \\usepackage{{amsmath}}.");
    let lines: Vec<String> = model
        .equations
        .iter()
        .map(|equation| {
            let subject = Expr::column(equation.subject.as_str());
            let left = match equation.prediction {
                Prediction::Derivative => format!("\\frac{{\\mathrm{{d}}}}{{\\mathrm{{d}}t}} {}", subject.to_latex()),
                Prediction::Next => subject.shifted(-1).to_latex(),
                Prediction::Difference => (subject.shifted(-1) - &subject).to_latex(),
                Prediction::Value => subject.to_latex(),
            };
            format!("{left} &= {}", equation.right.to_latex())
        })
        .collect();
    align(&mut out, &lines);
    let latents: Vec<String> = model.latents.iter().map(|latent| latent_lines(model, latent)).collect();
    align(&mut out, &latents);
    if model.latents.iter().any(|latent| !latent.beyond.is_empty()) {
        let line = "Outside of the training ranges of a region its functions are held at the border; the distance beyond it is multiplied by the slopes of `beyond` in the model file.";
        let _ = writeln!(out, "% {line}");
    }
    for definition in model.definitions() {
        basis_lines(&mut out, &definition);
    }
    for (index, partition) in model.partitions.iter().enumerate() {
        if partition.rule != Rule::Whole {
            partition_lines(&mut out, index, partition);
        }
    }
    ExportedFile::text(format!("{}.tex", options.prefix), out)
}

/// Basis functions: their definition, and the numbers of each.
fn basis_lines(out: &mut String, definition: &Definition) {
    let head: Vec<String> = definition.head.iter().map(|name| escaped(name)).collect();
    let rows = definition.rows.iter().map(|(name, values)| {
        let values: Vec<String> = values.iter().map(|&value| Expr::number(rounded(value)).to_latex()).collect();
        format!("{} & {}", Expr::column(name.as_str()).to_latex(), values.join(" & "))
    });
    let rows: Vec<String> = rows.collect();
    let _ = writeln!(
        out,
        "% {}\n\\begin{{align*}}\n\\begin{{array}}{{l{}}}\n & \\text{{{}}} \\\\\n{}\n\\end{{array}}\n\\end{{align*}}",
        crate::names::comment(&definition.text),
        "r".repeat(head.len()),
        head.join("} & \\text{"),
        rows.join(" \\\\\n")
    );
}

/// Six significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

fn align(out: &mut String, lines: &[String]) {
    if !lines.is_empty() {
        let _ = writeln!(out, "\\begin{{align*}}\n{}\n\\end{{align*}}", lines.join(" \\\\\n"));
    }
}

/// `f = c + ...`, or a case a region.
fn latent_lines(model: &Model, latent: &Latent) -> String {
    let left = Expr::column(latent.name.as_str()).to_latex();
    let regions = latent.map.regions();
    if regions == 1 {
        return format!("{left} &= {}", sum(model, latent, 0));
    }
    let names = &model.summaries[latent.partition].regions;
    let case = |region: usize| {
        let label = names.get(region).map_or_else(|| region.to_string(), |region| region.name.clone());
        format!("  {} & \\text{{region {}}}", sum(model, latent, region), escaped(&label))
    };
    let cases: Vec<String> = (0..regions).map(case).collect();
    format!("{left} &= \\begin{{cases}}\n{}\n\\end{{cases}}", cases.join(" \\\\\n"))
}

/// The function in a region, coefficients with six digits.
fn sum(model: &Model, latent: &Latent, region: usize) -> String {
    let terms = summands(model, latent, region, 6).into_iter();
    let sum = terms.fold(None, |sum: Option<Expr>, (negative, term)| {
        Some(match (sum, negative) {
            (None, false) => term,
            (None, true) => -term,
            (Some(sum), false) => sum + term,
            (Some(sum), true) => sum - term,
        })
    });
    sum.map_or_else(|| "0".into(), |sum| sum.to_latex())
}

fn partition_lines(out: &mut String, index: usize, partition: &fleetfoot_model::Partition) {
    let _ = writeln!(out, "% Regions of partition {index}: {}.", crate::names::comment(&partition.specification));
    if let Rule::Tree(tree) = &partition.rule {
        return tree_lines(out, tree, &partition.columns);
    }
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
                column.to_latex(),
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
        Rule::Box { half } => {
            let _ = writeln!(
                out,
                "The region is inner where $\\lVert z \\rVert_\\infty \\le {}$, else outer.",
                number(*half)
            );
        }
        Rule::Labels { names, .. } => {
            let names: Vec<String> = names.iter().map(|name| escaped(name)).collect();
            let _ = writeln!(out, "The region follows from the label, the last of these: {}.", names.join(", "));
        }
        Rule::Joined { regions, .. } => {
            let _ = writeln!(
                out,
                "The region is that of the nearest of {} centroids, which the other exports have.",
                regions.len()
            );
        }
        Rule::Whole | Rule::Tree(_) => {}
    }
}

/// The region as cases of the columns' values.
fn tree_lines(out: &mut String, tree: &Tree, columns: &[Expr]) {
    let _ = writeln!(out, "The region is");
    let bound = |(column, [low, high]): &(usize, [f64; 2])| {
        let name = columns.get(*column).map_or_else(String::new, Expr::to_latex);
        match (low.is_finite(), high.is_finite()) {
            (true, true) => format!("{} \\le {name} < {}", signed(*low), signed(*high)),
            (true, false) => format!("{name} \\ge {}", signed(*low)),
            _ => format!("{name} < {}", signed(*high)),
        }
    };
    let case = |(region, sides): (usize, &Vec<(usize, [f64; 2])>)| {
        let bounds: Vec<String> = sides.iter().map(bound).collect();
        format!("  {region} & {}", bounds.join(",\\ "))
    };
    let cases: Vec<String> = tree.boxes().iter().enumerate().map(case).collect();
    let _ = writeln!(out, "\\[\n\\begin{{cases}}\n{}\n\\end{{cases}}\n\\]", cases.join(" \\\\\n"));
}

/// Text in which nothing is a command.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in crate::names::comment(text).chars() {
        match c {
            '\\' => out += "\\backslash{}",
            '{' | '}' | '_' | '$' | '%' | '&' | '#' => {
                out.push('\\');
                out.push(c);
            }
            '^' => out += "\\hat{}",
            '~' => out += "\\sim{}",
            c if c.is_ascii() => out.push(c),
            c => out += &format!("${}$", Expr::column(c.to_string()).to_latex()),
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
