//! Transitions between regions, as text: from sample to sample, along a phase, from stride to stride; and regions that
//! have the same map.

use std::fmt::Write;

use super::short;
use crate::{Model, Partition, PhaseBins, Phases, Transitions, holm};

/// Pairs that are printed, at most, where not all are wanted.
const PAIRS: usize = 24;
/// Changes of region of a bin that are printed, at most.
const CHANGES: usize = 4;
/// The probability below which two regions count as different.
const LEVEL: f64 = 0.05;

/// Transitions between regions, as text: shares of a region's rows by the region one sample later, and the mean length
/// of a visit. With a phase: regions along it, and transitions from stride to stride. Neighbours (rows pass from one to
/// the other) are compared by their maps; with `all`, all pairs are. `None` if no partition of the model has
/// transitions.
pub fn describe_transitions(model: &Model, all: bool) -> Option<String> {
    let mut out = String::new();
    for partition in &model.partitions {
        let Some(transitions) = &partition.transitions else { continue };
        let names: Vec<String> = (0..partition.rule.count()).map(|region| partition.region_name(region)).collect();
        if !out.is_empty() {
            out.push('\n');
        }
        by_sample(&mut out, model, partition, (transitions, &names));
        if let Some(phases) = &partition.phases {
            along(&mut out, phases, &names);
            by_stride(&mut out, model, phases, &names);
        }
        pairs(&mut out, partition, (transitions, &names), all);
    }
    (!out.is_empty()).then_some(out)
}

fn width(names: &[String]) -> usize {
    names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(6)
}

/// A share with four digits behind the point.
fn share(share: f64, width: usize) -> String {
    if share.is_nan() { format!("{:>width$}", "-") } else { format!("{share:>width$.4}") }
}

/// The head of a table of regions by regions.
fn heads(names: &[String], width: usize) -> String {
    names.iter().map(|name| format!("{name:>width$}")).collect::<Vec<String>>().join("  ")
}

fn by_sample(out: &mut String, model: &Model, partition: &Partition, (counted, names): (&Transitions, &[String])) {
    let width = width(names);
    let _ = writeln!(
        out,
        "transitions of {}: shares of a region's rows by the region one sample later",
        partition.specification
    );
    let _ = writeln!(out, "  {:>width$}  {}  mean dwell in rows", "from", heads(names, width));
    for (from, name) in names.iter().enumerate() {
        let shares: Vec<String> = (0..names.len()).map(|to| share(counted.probability(from, to), width)).collect();
        let _ = writeln!(out, "  {name:>width$}  {}  {}", shares.join("  "), dwell(counted.dwell(from), model.step));
    }
}

/// Regions along the phase, and the changes of region in each bin.
fn along(out: &mut String, phases: &Phases, names: &[String]) {
    let width = width(names);
    let bins: Vec<String> = (0..phases.bins.count()).map(|bin| phases.bins.name(bin)).collect();
    let first = bins.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(5);
    let _ = writeln!(out, "\nalong {}: shares of a bin's rows in each region", phases.specification);
    let _ = writeln!(out, "  {:>first$}  {}    rows  changes, of the bin's rows", "phase", heads(names, width));
    for (bin, name) in bins.iter().enumerate() {
        let shares: Vec<String> = (0..names.len()).map(|region| share(phases.share(bin, region), width)).collect();
        let rows: u64 = phases.rows[bin].iter().sum();
        let line = format!("  {name:>first$}  {}  {rows:>6}  {}", shares.join("  "), changes(phases, bin, rows, names));
        let _ = writeln!(out, "{}", line.trim_end());
    }
}

/// The most frequent passages of a bin from one region to another.
fn changes(phases: &Phases, bin: usize, rows: u64, names: &[String]) -> String {
    let mut left: Vec<_> =
        phases.passages.iter().filter(|passage| passage.bin as usize == bin && passage.from != passage.to).collect();
    left.sort_by_key(|passage| std::cmp::Reverse(passage.rows));
    let texts = left.iter().take(CHANGES).map(|passage| {
        let percent = 100.0 * passage.rows as f64 / rows as f64;
        format!("{} to {} {percent:.1} %", names[passage.from as usize], names[passage.to as usize])
    });
    texts.collect::<Vec<String>>().join(", ")
}

fn by_stride(out: &mut String, model: &Model, phases: &Phases, names: &[String]) {
    let width = width(names);
    let begins = match (&phases.bins, phases.falling) {
        (PhaseBins::Cyclic { .. }, false) => "the phase wraps".to_owned(),
        (PhaseBins::Cyclic { .. }, true) => "the phase, which falls, wraps".to_owned(),
        (PhaseBins::Labels(labels), _) => format!("{} is entered", labels.first().map_or("", String::as_str)),
    };
    if phases.stride_count() == 0 {
        let _ = writeln!(out, "\nno two strides follow each other: a stride begins where {begins}");
        return;
    }
    let rows = phases.rows_of_a_stride();
    let seconds = if model.step > 0.0 { format!(" ({} s)", short(rows * model.step)) } else { String::new() };
    let _ = writeln!(
        out,
        "\nfrom stride to stride: shares of the strides that began in a region by the region in which the next one began\n  \
         a stride begins where {begins}; {} of {} rows{seconds} on average",
        phases.stride_count(),
        short(rows)
    );
    let _ = writeln!(out, "  {:>width$}  {}  strides", "from", heads(names, width));
    for (from, name) in names.iter().enumerate() {
        let shares: Vec<String> =
            (0..names.len()).map(|to| share(phases.stride_probability(from, to), width)).collect();
        let strides: u64 = phases.strides[from].iter().sum();
        let _ = writeln!(out, "  {name:>width$}  {}  {strides:>7}", shares.join("  "));
    }
}

/// Pairs of regions, tested by their maps: those with the same map come first.
fn pairs(out: &mut String, partition: &Partition, (counted, names): (&Transitions, &[String]), all: bool) {
    let passes = |from: u32, to: u32| counted.counts[from as usize][to as usize] > 0;
    let neighbours = |&[a, b]: &[u32; 2]| passes(a, b) || passes(b, a);
    let pairs: Vec<_> = partition.pairs.iter().filter(|pair| all || neighbours(&pair.regions)).collect();
    if pairs.is_empty() {
        return;
    }
    let adjusted = holm(&pairs.iter().map(|pair| pair.p).collect::<Vec<f64>>());
    let mut order: Vec<usize> = (0..pairs.len()).collect();
    // Pairs without a test come first.
    let least = |at: usize| if adjusted[at].is_nan() { 2.0 } else { adjusted[at] };
    order.sort_by(|&a, &b| least(b).total_cmp(&least(a)).then(pairs[b].p.total_cmp(&pairs[a].p)).then(a.cmp(&b)));
    let which = if all { "pairs of regions" } else { "neighbours" };
    let _ = writeln!(
        out,
        "\nseparate maps of {which}: twice the logarithm of the likelihood ratio of two maps against one, and the p-value if one map holds"
    );
    let width = width(names);
    let _ = writeln!(out, "  {:>width$}  {:>width$}     2 ln ratio  freedom          p  p (Holm)", "region", "region");
    let shown = if all { order.len() } else { PAIRS.min(order.len()) };
    for &at in &order[..shown] {
        let (pair, adjusted) = (pairs[at], adjusted[at]);
        let [a, b] = pair.regions.map(|region| &names[region as usize]);
        let verdict = match adjusted {
            value if value.is_nan() => "  too few rows",
            value if value >= LEVEL => "  <- one map suffices",
            _ => "",
        };
        let _ = writeln!(
            out,
            "  {a:>width$}  {b:>width$}  {:>13}  {:>7}  {:>9}  {:>8}{verdict}",
            known(pair.statistic),
            pair.freedom,
            probability(pair.p),
            probability(adjusted)
        );
    }
    if shown < order.len() {
        let _ = writeln!(out, "  and {} more, which differ at least as much", order.len() - shown);
    }
    if partition.is_drawn_by_targets() {
        let _ = writeln!(
            out,
            "  These regions were chosen on the same rows, so small p-values are expected. Look for the pairs that do NOT differ."
        );
    }
}

fn known(value: f64) -> String {
    if value.is_nan() { "-".into() } else { short(value) }
}

/// A probability with two digits.
fn probability(p: f64) -> String {
    match p {
        p if p.is_nan() => "-".into(),
        p if p >= 0.01 => format!("{p:.2}"),
        p if p < 1e-99 => "0".into(),
        p => format!("{p:.0e}"),
    }
}

fn dwell(rows: f64, step: f64) -> String {
    match rows {
        rows if rows.is_nan() => "-".into(),
        rows if rows.is_infinite() => "never left".into(),
        rows if step > 0.0 => format!("{} ({} s)", short(rows), short(rows * step)),
        rows => short(rows),
    }
}
