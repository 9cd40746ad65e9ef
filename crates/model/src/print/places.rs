//! Places of regions: centres, thresholds and borders in the units of the partition columns.

use super::short;
use crate::{Column, Partition, Rule, UnseenLabel};

/// Cells of a joined region that are written out, at most.
const CELLS: usize = 8;

/// A column of the partition, and how it is standardised.
struct Axis {
    name: String,
    unit: String,
    centre: f64,
    scale: f64,
}

/// Lines about the place of every region. Empty for a tree, whose cuts are written as they are nested, and for the one
/// region of all rows.
pub(super) fn places(partition: &Partition, columns: &[Column]) -> Vec<Vec<String>> {
    let unit = |name: &str| {
        let column = columns.iter().find(|column| column.name == name);
        column.and_then(|column| column.unit.as_ref()).map_or_else(String::new, |unit| format!(" {unit}"))
    };
    let axes: Vec<Axis> = (partition.columns.iter().zip(&partition.centre).zip(&partition.scale))
        .map(|((column, &centre), &scale)| Axis {
            name: column.to_string(),
            unit: column.as_column().map_or_else(String::new, unit),
            centre,
            scale,
        })
        .collect();
    of_rule(&partition.rule, &axes, "regions")
}

fn of_rule(rule: &Rule, axes: &[Axis], of_all: &str) -> Vec<Vec<String>> {
    match rule {
        Rule::Whole => vec![Vec::new()],
        Rule::Tree(tree) => vec![Vec::new(); tree.regions()],
        Rule::Ball { radius } => {
            let square = |axis: &Axis| format!("(({} - {})/{})^2", axis.name, short(axis.centre), short(axis.scale));
            let sum = axes.iter().map(square).collect::<Vec<_>>().join(" + ");
            let border = short(radius * radius);
            vec![vec![format!("where {sum} <= {border}")], vec![format!("where {sum} > {border}")]]
        }
        Rule::Box { half } => {
            let range = |axis: &Axis| {
                let (low, high) = (axis.centre - half * axis.scale, axis.centre + half * axis.scale);
                format!("{} <= {} <= {}", short(low), axis.name, short(high))
            };
            let ranges = axes.iter().map(range).collect::<Vec<_>>().join(" and ");
            vec![vec![format!("where {ranges}")], vec!["elsewhere".to_owned()]]
        }
        Rule::Linear { weights, offsets } => {
            let scores: Vec<Score> = weights.iter().zip(offsets).map(|(w, &b)| Score::new(w, b, axes)).collect();
            let is_nearest =
                weights.iter().zip(offsets).all(|(w, b)| *b == -0.5 * w.iter().map(|v| v * v).sum::<f64>());
            let of = |region: usize| {
                let centre = is_nearest.then(|| centre(&weights[region], axes));
                centre.into_iter().chain([border(&scores, region, axes, of_all)]).collect()
            };
            (0..scores.len()).map(of).collect()
        }
        Rule::Joined { cells, regions } if axes.len() == 1 => match cells.as_ref() {
            Rule::Linear { weights, offsets } => {
                let scores: Vec<Score> = weights.iter().zip(offsets).map(|(w, &b)| Score::new(w, b, axes)).collect();
                united(&scores, regions, rule.count(), &axes[0])
            }
            other => joined(&of_rule(other, axes, "cells"), regions, rule.count()),
        },
        Rule::Joined { cells, regions } => joined(&of_rule(cells, axes, "cells"), regions, rule.count()),
        Rule::Labels { names, rules, unseen, .. } => {
            let Some((label, others)) = axes.split_last() else { return vec![Vec::new(); rule.count()] };
            let mut places = Vec::new();
            for (name, rule) in names.iter().zip(rules) {
                let within = format!("where {} is {name}", label.name);
                let with_label =
                    |places: Vec<String>| std::iter::once(within.clone()).chain(places).collect::<Vec<_>>();
                places.extend(of_rule(rule, others, "regions of the label").into_iter().map(with_label));
            }
            if *unseen == UnseenLabel::Pool {
                places.push(vec![format!("where {} is none of these", label.name)]);
            }
            places
        }
    }
}

/// The cells of every region: where they lie, or how many there are where they are more than a person reads.
fn joined(cells: &[Vec<String>], regions: &[u32], count: usize) -> Vec<Vec<String>> {
    let of = |region: usize| {
        let cells_of: Vec<usize> =
            (0..cells.len()).filter(|&cell| regions.get(cell).is_some_and(|&r| r as usize == region)).collect();
        if cells_of.len() > CELLS {
            return vec![format!("{} of the {} cells", cells_of.len(), cells.len())];
        }
        cells_of.iter().map(|&cell| format!("cell {cell}: {}", cells[cell].join("; "))).collect()
    };
    (0..count).map(of).collect()
}

/// The thresholds between which the cells of every region lie, where these are cells of one column: cells that touch are one interval.
fn united(scores: &[Score], regions: &[u32], count: usize, axis: &Axis) -> Vec<Vec<String>> {
    let of = |region: usize| {
        let cells = (0..scores.len()).filter(|&cell| regions.get(cell).is_some_and(|&r| r as usize == region));
        let mut intervals: Vec<[f64; 2]> =
            cells.map(|cell| bounds(scores, cell)).filter(|[low, high]| low < high).collect();
        intervals.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut joined: Vec<[f64; 2]> = Vec::new();
        for [low, high] in intervals {
            match joined.last_mut() {
                // Both sides of a border are computed, and differ by rounding.
                Some(last) if low <= last[1] + 1e-9 * axis.scale.abs() => last[1] = last[1].max(high),
                _ => joined.push([low, high]),
            }
        }
        joined.into_iter().map(|interval| interval_in_words(interval, axis)).collect()
    };
    (0..count).map(of).collect()
}

/// The score of a region as a function of the columns in their units: `constant + sum_k slopes_k x_k`.
struct Score {
    constant: f64,
    slopes: Vec<f64>,
}

impl Score {
    fn new(weights: &[f64], offset: f64, axes: &[Axis]) -> Self {
        let slopes: Vec<f64> = weights.iter().zip(axes).map(|(weight, axis)| weight / axis.scale).collect();
        let shift: f64 = slopes.iter().zip(axes).map(|(slope, axis)| slope * axis.centre).sum();
        Self { constant: offset - shift, slopes }
    }

    fn minus(&self, other: &Self) -> Self {
        let slopes = self.slopes.iter().zip(&other.slopes).map(|(slope, other)| slope - other).collect();
        Self { constant: self.constant - other.constant, slopes }
    }

    /// The part that depends on the columns, for people.
    fn slopes(&self, axes: &[Axis]) -> String {
        let mut text = String::new();
        for (&slope, axis) in self.slopes.iter().zip(axes).filter(|(slope, _)| **slope != 0.0) {
            let sign = match (text.is_empty(), slope < 0.0) {
                (true, true) => "-",
                (true, false) => "",
                (false, true) => " - ",
                (false, false) => " + ",
            };
            text.push_str(&format!("{sign}{}*{}", short(slope.abs()), axis.name));
        }
        if text.is_empty() { "0".to_owned() } else { text }
    }
}

/// The centre of a cell whose rows are those that are nearest to it.
fn centre(weights: &[f64], axes: &[Axis]) -> String {
    let of = |(weight, axis): (&f64, &Axis)| {
        format!("{} = {}{}", axis.name, short(axis.centre + axis.scale * weight), axis.unit)
    };
    format!("centre {}", weights.iter().zip(axes).map(of).collect::<Vec<_>>().join(", "))
}

/// Set in which the score of a region is the largest, in words.
fn border(scores: &[Score], region: usize, axes: &[Axis], of_all: &str) -> String {
    let score = &scores[region];
    match (axes, scores) {
        (_, [_]) => "everywhere".to_owned(),
        ([axis], _) => interval_in_words(bounds(scores, region), axis),
        (_, [first, second]) => {
            let difference = score.minus(if region == 0 { second } else { first });
            let sign = if region == 0 { ">=" } else { ">" };
            format!("where {} {sign} {}", difference.slopes(axes), short(0.0 - difference.constant))
        }
        _ => {
            let sign = if score.constant < 0.0 { "-" } else { "+" };
            format!(
                "where {} {sign} {} is the largest of all {of_all}",
                score.slopes(axes),
                short(score.constant.abs())
            )
        }
    }
}

/// The thresholds between which the score of a region of one column is the largest.
fn bounds(scores: &[Score], region: usize) -> [f64; 2] {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    for (_, other) in scores.iter().enumerate().filter(|(at, _)| *at != region) {
        let difference = scores[region].minus(other);
        let threshold = -difference.constant / difference.slopes[0];
        match difference.slopes[0] {
            slope if slope > 0.0 => low = low.max(threshold),
            slope if slope < 0.0 => high = high.min(threshold),
            _ if difference.constant < 0.0 => high = f64::NEG_INFINITY,
            _ => {}
        }
    }
    [low, high]
}

/// An interval of a column, for people.
fn interval_in_words([low, high]: [f64; 2], axis: &Axis) -> String {
    let (name, unit) = (&axis.name, &axis.unit);
    match (low.is_finite(), high.is_finite()) {
        _ if low >= high => "nowhere: everywhere another region is nearer".to_owned(),
        (true, true) => format!("where {} <= {name} < {}{unit}", short(low), short(high)),
        (true, false) => format!("where {name} >= {}{unit}", short(low)),
        (false, true) => format!("where {name} < {}{unit}", short(high)),
        (false, false) => "everywhere".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Role;
    use fleetfoot_library::Expr;
    use std::sync::Arc;

    /// Columns `v` (centre 2, scale 0.5) and `u` (centre -1, scale 4), as many as the rule has.
    fn of(rule: Rule, columns: usize) -> Vec<Vec<String>> {
        let mut partition = Partition::whole();
        partition.columns = ["v", "u"].iter().take(columns).map(|name| Expr::column(*name)).collect();
        partition.centre = vec![2.0, -1.0][..columns].to_vec();
        partition.scale = vec![0.5, 4.0][..columns].to_vec();
        partition.rule = rule;
        let speed = Column { unit: Some("m/s".into()), ..Column::new("v", Role::State) };
        places(&partition, &[speed, Column::new("u", Role::Input)])
    }

    #[test]
    fn centres_and_thresholds_have_the_units_of_their_columns() {
        let places = of(Rule::voronoi(vec![vec![-2.0], vec![0.0], vec![3.0]]), 1);
        assert_eq!(places[0], ["centre v = 1 m/s", "where v < 1.5 m/s"]);
        assert_eq!(places[1], ["centre v = 2 m/s", "where 1.5 <= v < 2.75 m/s"]);
        assert_eq!(places[2], ["centre v = 3.5 m/s", "where v >= 2.75 m/s"]);
    }

    #[test]
    fn borders_of_two_regions_are_planes_over_the_columns() {
        // 0.5 (v - 2)/0.5 - 2 (u + 1)/4 + 1 >= 0, so that v - 0.5 u >= 1.5.
        let rule = Rule::Linear { weights: vec![vec![0.5, -2.0], vec![0.0, 0.0]], offsets: vec![1.0, 0.0] };
        let places = of(rule.clone(), 2);
        assert_eq!(places, [["where 1*v - 0.5*u >= 1.5"], ["where -1*v + 0.5*u > -1.5"]]);
        let rows = [[2.0, 1.0], [2.0, 1.02], [0.0, -3.1]];
        for [v, u] in rows {
            let inside = v - 0.5 * u >= 1.5;
            assert_eq!(rule.assign_row(&[(v - 2.0) / 0.5, (u + 1.0) / 4.0]), Some(u32::from(!inside)), "{v} {u}");
        }
    }

    #[test]
    fn texts_describe_scores_and_cells() {
        let cells = Rule::voronoi(vec![vec![0.0, 0.0], vec![2.0, 0.0], vec![0.0, 1.0]]);
        let places = of(cells.clone(), 2);
        assert_eq!(places[1], ["centre v = 3 m/s, u = -1", "where 4*v - 10 is the largest of all regions"]);
        let joined = of(Rule::Joined { cells: Arc::new(cells), regions: vec![0, 1, 0] }, 2);
        assert_eq!(joined[0].len(), 2);
        let line = Rule::voronoi(vec![vec![-2.0], vec![0.0], vec![3.0], vec![5.0]]);
        let united = of(Rule::Joined { cells: Arc::new(line), regions: vec![0, 0, 1, 0] }, 1);
        assert_eq!(united[0], ["where v < 2.75 m/s", "where v >= 4 m/s"]);
        assert_eq!(united[1], ["where 2.75 <= v < 4 m/s"]);
        assert!(
            joined[1][0].starts_with("cell 1: centre v = 3 m/s") && joined[1][0].ends_with("all cells"),
            "{joined:?}"
        );
    }
}
