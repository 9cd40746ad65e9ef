//! Models for people.

mod places;
mod transitions;

use std::fmt::Write;

use fleetfoot_library::Expr;

use crate::{Branch, Definition, Latent, Lattice, Level, Model, Partition, Prediction, RegionSummary, Rule, Tree};
pub use transitions::describe_transitions;

/// The model as text: columns, equations, and per region its size, rank, place and coefficients. Places have the units of their columns.
///
/// At most `regions` regions are written out, the largest first; terms are listed in the order of the library, zeros
/// left out. Latents that hold over one region stand alone, each with the number of its functions in use.
pub fn describe(model: &Model, regions: usize) -> String {
    let mut out = String::new();
    let t = &model.training;
    let _ = writeln!(
        out,
        "{} model {}: {} rows of {} episode{}, fleetfoot {}",
        model.method,
        model.hash(),
        t.rows,
        t.episodes.len(),
        if t.episodes.len() == 1 { "" } else { "s" },
        t.version
    );
    if model.step > 0.0 {
        let _ = writeln!(out, "sampled every {} s", short(model.step));
    }
    let _ = writeln!(out, "\ncolumns");
    for column in &model.columns {
        let unit = column.unit.as_ref().map(|unit| format!(" [{unit}]")).unwrap_or_default();
        let angle = match &column.rotation {
            Some(rotation) => {
                format!(", {} of {} {}", rotation.kind.letters()[rotation.part], rotation.kind.word(), rotation.group)
            }
            None if column.angle => ", angle".to_owned(),
            None => String::new(),
        };
        let role = format!("{:?}", column.role).to_lowercase();
        let source = if column.source == column.name { String::new() } else { format!(" = {}", column.source) };
        let _ = writeln!(out, "  {}{source}{unit}  ({role}{angle})", column.name);
    }
    let _ = writeln!(out, "\nequations");
    for equation in &model.equations {
        let suffix = match equation.target_text() {
            None => "  (given)".to_owned(),
            Some(target) if equation.prediction == Prediction::Derivative => format!("  (measured as {target})"),
            Some(_) => String::new(),
        };
        let _ = writeln!(out, "  {} = {}{suffix}", equation.label(), equation.right);
    }
    let whole = |index: usize| model.partitions.len() > 1 && model.partitions[index].rule == Rule::Whole;
    for latent in model.latents.iter().filter(|latent| whole(latent.partition)) {
        describe_latent(&mut out, model, latent);
    }
    for (index, partition) in model.partitions.iter().enumerate().filter(|(index, _)| !whole(*index)) {
        describe_partition(&mut out, model, index, regions, &partition.specification);
    }
    for definition in model.definitions() {
        describe_basis(&mut out, &definition);
    }
    out
}

/// Basis functions, one a line.
fn describe_basis(out: &mut String, definition: &Definition) {
    let _ = writeln!(out, "\n{}", definition.text);
    let _ = writeln!(out, "  {}", definition.head.join(", "));
    for (name, values) in &definition.rows {
        let values: Vec<String> = values.iter().map(|&value| short(value)).collect();
        let _ = writeln!(out, "  {name}  {}", values.join(", "));
    }
}

/// A latent that is one function everywhere.
fn describe_latent(out: &mut String, model: &Model, latent: &Latent) {
    let library = &model.libraries[latent.library];
    let count = (0..latent.map.features()).filter(|&feature| latent.map.coefficient(0, feature) != 0.0).count();
    let _ = writeln!(out, "\nlatent {}: {count} of {} functions", latent.name, latent.map.features());
    let _ = writeln!(out, "  {} = {}", latent.name, terms(model, latent, 0));
    let first = model.latents.iter().find(|other| other.partition == latent.partition);
    let regions = &model.summaries[latent.partition].regions;
    if let (Some(info), true) = (regions.first(), first.is_some_and(|first| first.library == latent.library)) {
        describe_confounded(out, info, library, "  ");
    }
}

/// Describes confounded regressors.
fn describe_confounded(out: &mut String, info: &RegionSummary, library: &[Expr], indent: &str) {
    if info.confounded.is_empty() {
        return;
    }
    let group = |group: &Vec<usize>| group.iter().map(|&f| library[f].to_string()).collect::<Vec<_>>().join(" ~ ");
    let groups: Vec<String> = info.confounded.iter().map(group).collect();
    let _ = writeln!(out, "{indent}not separable here: {}", groups.join("; "));
}

fn describe_partition(out: &mut String, model: &Model, index: usize, limit: usize, specification: &str) {
    let partition = &model.partitions[index];
    let count = partition.rule.count();
    let _ = writeln!(out, "\npartition {specification}: {count} region{}", if count == 1 { "" } else { "s" });
    if !partition.columns.is_empty() {
        let columns: Vec<String> = partition.columns.iter().map(ToString::to_string).collect();
        let _ = writeln!(out, "  on {}", columns.join(", "));
    }
    if let Some(rule) = model.outside_in_words(index) {
        let _ = writeln!(out, "  outside the training ranges of a region {rule}");
    }
    if let Some(lattice) = &partition.lattice {
        describe_joins(out, partition, lattice);
    }
    describe_trees(out, partition);
    let summary = &model.summaries[index];
    let (order, total) = (summary.by_size(), summary.rows());
    let places = places::places(partition, &model.columns);
    for &region in order.iter().take(limit) {
        let info = &summary.regions[region];
        let share = if total > 0 { 100.0 * info.rows as f64 / total as f64 } else { 0.0 };
        let _ = writeln!(
            out,
            "\n  region {} ({} rows, {share:.1} %, rank {}, condition {})",
            info.name,
            info.rows,
            info.rank,
            short(info.condition)
        );
        for line in places.get(region).into_iter().flatten() {
            let _ = writeln!(out, "    {line}");
        }
        for latent in model.latents.iter().filter(|latent| latent.partition == index) {
            let _ = writeln!(out, "    {} = {}", latent.name, terms(model, latent, region));
        }
        let library = model
            .latents
            .iter()
            .find(|latent| latent.partition == index)
            .map(|latent| &model.libraries[latent.library]);
        if let Some(library) = library {
            describe_confounded(out, info, library, "    ");
        }
    }
    if order.len() > limit {
        let _ = writeln!(out, "\n  and {} smaller regions", order.len() - limit);
    }
}

/// The trees of a partition: one, or one a label.
fn describe_trees(out: &mut String, partition: &Partition) {
    match &partition.rule {
        Rule::Tree(tree) => {
            let _ = writeln!(out);
            describe_cuts(out, tree, partition, 0);
        }
        Rule::Labels { names, rules, .. } => {
            let mut first = 0;
            for (name, rule) in names.iter().zip(rules) {
                if let Rule::Tree(tree) = rule {
                    let _ = writeln!(out, "\n  {name}");
                    describe_cuts(out, tree, partition, first);
                }
                first += rule.count();
            }
        }
        _ => {}
    }
}

/// The cuts of a tree as they are nested; its regions are counted from `first` on.
fn describe_cuts(out: &mut String, tree: &Tree, partition: &Partition, first: usize) {
    let name = |column: usize| partition.columns.get(column).map_or_else(String::new, Expr::to_string);
    let mut open = vec![(Branch::Cut(0), 1, String::new())];
    while let Some((branch, depth, head)) = open.pop() {
        let indent = "  ".repeat(depth);
        match branch {
            Branch::Region(region) => {
                let name = partition.region_name(first + region as usize);
                let _ = writeln!(out, "{indent}{head}region {name}");
            }
            Branch::Cut(at) => {
                let Some(cut) = tree.cuts.get(at) else { continue };
                if !head.is_empty() {
                    let _ = writeln!(out, "{indent}{}", head.trim_end());
                }
                let (inner, column) = (depth + usize::from(!head.is_empty()), name(cut.column));
                let threshold = exact(cut.threshold);
                // The side below comes first: it is taken first.
                open.push((cut.above, inner, format!("if {column} >= {threshold}: ")));
                open.push((cut.below, inner, format!("if {column} < {threshold}: ")));
            }
        }
    }
}

/// Lines of a tree that are printed, at most.
const LEVELS: usize = 24;

/// The levels of the tree of joins, and how the regions would be joined on.
fn describe_joins(out: &mut String, partition: &Partition, lattice: &Lattice) {
    let Rule::Joined { regions: cells, .. } = &partition.rule else { return };
    let count = partition.rule.count();
    let _ = writeln!(
        out,
        "\n  joined from {} cells; squared errors over variance:\n    regions    training    held out  standard error         BIC",
        cells.len()
    );
    let every = lattice.levels.len().div_ceil(LEVELS).max(1);
    for (at, level) in lattice.levels.iter().enumerate() {
        if at % every == 0 || at + 1 == lattice.levels.len() || level.regions == count {
            describe_level(out, level, level.regions == count);
        }
    }
    let last = &lattice.joins[lattice.joins.len().saturating_sub(LEVELS)..];
    if !last.is_empty() {
        let _ = writeln!(out, "\n  the joins to follow, with the training error then:");
    }
    for join in last {
        let _ = writeln!(out, "    {:>3} joins {:<3}  {:>10}", join.gone, join.kept, short(join.training));
    }
}

fn describe_level(out: &mut String, level: &Level, is_chosen: bool) {
    let known = |value: f64| if value.is_nan() { "-".to_owned() } else { short(value) };
    let _ = writeln!(
        out,
        "    {:>7}  {:>10}  {:>10}  {:>14}  {:>10}{}",
        level.regions,
        short(level.training),
        known(level.held_out),
        known(level.standard_error),
        short(level.bic),
        if is_chosen { "  <- this model" } else { "" }
    );
}

fn terms(model: &Model, latent: &Latent, region: usize) -> String {
    let constant = latent.map.constant(region);
    let used: Vec<(Expr, f64)> = (model.terms_for_people(latent, region).into_iter())
        .filter_map(|(function, value)| function.filter(|_| value != 0.0).map(|function| (function, value)))
        .collect();
    let mut text = if constant != 0.0 || used.is_empty() { short(constant) } else { String::new() };
    for (function, coefficient) in used {
        let (size, function) = (short(coefficient.abs()), factor(function.to_string()));
        let _ = match (text.is_empty(), coefficient < 0.0) {
            (true, false) => write!(text, "{size}*{function}"),
            (true, true) => write!(text, "-{size}*{function}"),
            (false, negative) => write!(text, " {} {size}*{function}", if negative { '-' } else { '+' }),
        };
    }
    text
}

/// A printed function as it may stand behind a coefficient: a sum in parentheses.
pub fn factor(function: String) -> String {
    let (mut depth, mut quoted, mut sum) = (0, false, function.starts_with('-'));
    for (at, c) in function.char_indices() {
        match c {
            '`' => quoted = !quoted,
            '(' if !quoted => depth += 1,
            ')' if !quoted => depth -= 1,
            '+' | '-' if !quoted && depth == 0 => sum |= function[..at].ends_with(' '),
            _ => {}
        }
    }
    if sum { format!("({function})") } else { function }
}

/// All digits of a number.
fn exact(value: f64) -> String {
    let (plain, scientific) = (format!("{value}"), format!("{value:e}"));
    if plain.len() <= scientific.len() + 3 { plain } else { scientific }
}

/// Six significant digits, without a tail of zeros.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let magnitude = value.abs().log10().floor();
    if !(-5.0..6.0).contains(&magnitude) {
        let text = format!("{value:.5e}");
        return match text.split_once('e') {
            Some((digits, exponent)) if digits.contains('.') => {
                format!("{}e{exponent}", digits.trim_end_matches('0').trim_end_matches('.'))
            }
            _ => text,
        };
    }
    let decimals = (5.0 - magnitude).clamp(0.0, 12.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::{factor, short};

    #[test]
    fn sums_stand_in_parentheses() {
        for (function, expected) in [
            ("x - v", "(x - v)"),
            ("-x", "(-x)"),
            ("x*(y + z)", "x*(y + z)"),
            ("sin(x - v)", "sin(x - v)"),
            ("`a - b`", "`a - b`"),
            ("2e-5^x", "2e-5^x"),
        ] {
            assert_eq!(factor(function.into()), expected);
        }
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(short(0.1), "0.1");
        assert_eq!(short(-1234.5678), "-1234.57");
        assert_eq!(short(1.5e-9), "1.5e-9");
        assert_eq!(short(2e20), "2e20");
        assert_eq!(short(999_999.7), "1000000");
        assert_eq!(short(f64::NAN), "NaN");
    }
}
