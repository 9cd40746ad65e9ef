//! Selection of a log's data: clock, episodes and joins from the recipe, and the roles of columns.

use std::collections::BTreeSet;

use fleetfoot_data::Column;
use fleetfoot_data::setting::{JOIN, TIME_SECTION};
use fleetfoot_library::Expr;
use fleetfoot_log::{Base, ColumnJoin, JoinKind, JoinSpec, LabelRule, MaxGap, Selection, Stamp, TimeSpec, TimeUnit};
use fleetfoot_model::{Column as ModelColumn, Role};
use fleetfoot_recipe::{Gap, Recipe, wildcard::is_match};

use crate::error::Error;

/// Topics as the recipe calls them, and as the files do.
pub(crate) fn renames(recipe: &Recipe) -> Vec<(String, String)> {
    recipe.rename.iter().map(|(ours, file)| (ours.clone(), file.clone())).collect()
}

pub(crate) fn label_names(recipe: &Recipe) -> Vec<String> {
    let mut names: Vec<String> = recipe.episodes.iter().flat_map(|rule| rule.labels.keys().cloned()).collect();
    names.sort();
    names.dedup();
    names
}

fn max_gap(gap: Option<&Gap>, place: &str) -> Result<MaxGap, Error> {
    match gap {
        None => Ok(MaxGap::Auto),
        Some(Gap::Seconds(seconds)) if *seconds > 0.0 => Ok(MaxGap::Seconds(*seconds)),
        Some(Gap::Word(word)) if word == "auto" => Ok(MaxGap::Auto),
        Some(Gap::Word(word)) if word == "none" => Ok(MaxGap::Unlimited),
        Some(gap) => {
            let written = match gap {
                Gap::Seconds(seconds) => seconds.to_string(),
                Gap::Word(word) => format!("\"{word}\""),
            };
            Err(Error::value(format!("{place} max_gap = {written}: write seconds above 0, \"auto\" or \"none\"")))
        }
    }
}

/// The recipe's settings for the channels of a robot's log.
fn join_spec(recipe: &Recipe, columns: &[String]) -> Result<JoinSpec, Error> {
    let time = &recipe.time;
    let mut join = JoinSpec { cache: recipe.cache.clone(), ..JoinSpec::default() };
    join.renames = renames(recipe);
    if let Some(text) = &time.stamp {
        join.stamp = Some(Stamp::parse(text).ok_or_else(|| {
            Error::value(format!(
                "{entry}: write \"header\", \"log\" or \"publish\"",
                entry = TIME_SECTION.entry("stamp").is(format_args!("\"{text}\""))
            ))
        })?);
    }
    join.base = match (&time.base, time.rate) {
        (Some(_), Some(_)) => {
            return Err(Error::conflict(format!(
                "{TIME_SECTION} has both `base` and `rate`; the rows come from one of them"
            )));
        }
        (Some(topic), None) => Some(Base::Channel(topic.clone())),
        (None, Some(rate)) => Some(Base::Rate(rate)),
        (None, None) => None,
    };
    join.reorder_seconds = time.reorder.unwrap_or(join.reorder_seconds);
    for (pattern, rule) in &recipe.join {
        let (table, place) = (rule.table(), JOIN.entry(pattern).to_string());
        let kind = match table.kind.as_deref() {
            None => None,
            Some(text) => Some(JoinKind::parse(text).ok_or_else(|| {
                Error::value(format!("{place}: `{text}` is not a kind of join; write linear, hold, angle or slerp"))
            })?),
        };
        let rule = ColumnJoin { kind, max_gap: max_gap(table.max_gap.as_ref(), &place)? };
        for column in columns.iter().filter(|column| is_match(pattern, column)) {
            join.columns.insert(column.clone(), rule);
        }
    }
    Ok(join)
}

/// Joins as the roles of the columns ask for: inputs are held, angles go along the shorter arc. What the recipe says stands above.
fn add_roles(join: &mut JoinSpec, columns: &[ModelColumn], aliases: &[(Column, Expr)]) {
    let mut rule = |field: &str, kind| {
        let rule = join.columns.entry(field.to_owned()).or_default();
        rule.kind = rule.kind.or(Some(kind));
    };
    let uses = |role: Role| {
        aliases
            .iter()
            .zip(columns)
            .filter(move |(_, column)| column.role == role)
            .flat_map(|((_, expr), _)| expr.sources())
    };
    let states: BTreeSet<String> = uses(Role::State).map(|name| name.to_string()).collect();
    for field in uses(Role::Input).filter(|field| !states.contains(&**field)) {
        rule(&field, JoinKind::Hold);
    }
    for ((_, expression), column) in aliases.iter().zip(columns) {
        if let Some(field) = expression.as_column()
            && column.angle
        {
            rule(field, JoinKind::Angle);
        }
    }
}

/// The fields that aliases speak of, and how they are read and joined.
pub(crate) fn full_selection(
    recipe: &Recipe,
    model: &[ModelColumn],
    aliases: &[(Column, Expr)],
) -> Result<Selection, Error> {
    let labels = label_names(recipe);
    let mut columns: Vec<String> = Vec::new();
    for (_, expression) in aliases {
        columns.extend(expression.sources().iter().map(|name| name.to_string()).filter(|name| !labels.contains(name)));
    }
    // The channel of the first column makes the rows unless the recipe says otherwise.
    let first = columns.first().cloned().map(Base::Channel);
    columns.sort();
    columns.dedup();
    let mut selection = selection(recipe, columns)?;
    add_roles(&mut selection.join, model, aliases);
    selection.join.base = selection.join.base.or(first);
    Ok(selection)
}

/// The recipe's settings for clock and episodes.
fn selection(recipe: &Recipe, columns: Vec<String>) -> Result<Selection, Error> {
    let time = &recipe.time;
    let mut selection = Selection::new(columns);
    selection.join = join_spec(recipe, &selection.columns)?;
    selection.time = match (&time.column, time.dt) {
        (Some(_), Some(_)) => {
            return Err(Error::conflict(format!(
                "{TIME_SECTION} has both `column` and `dt`; the stamps come from one of them"
            )));
        }
        (None, Some(dt)) if dt > 0.0 && dt.is_finite() => TimeSpec::Uniform { dt_seconds: dt },
        (None, Some(dt)) => {
            return Err(Error::value(format!(
                "{entry}: the sampling period must be positive",
                entry = TIME_SECTION.entry("dt").is(dt)
            )));
        }
        (Some(name), None) => {
            let unit = match time.unit.as_deref() {
                None => None,
                Some(text) => Some(TimeUnit::parse(text).ok_or_else(|| {
                    Error::value(format!(
                        "{entry}: write s, ms, us or ns",
                        entry = TIME_SECTION.entry("unit").is(format_args!("\"{text}\""))
                    ))
                })?),
            };
            TimeSpec::Column { name: name.clone(), unit }
        }
        (None, None) if time.unit.is_some() => {
            return Err(Error::missing(format!(
                "{TIME_SECTION} has a unit and no column: name the column of the stamps (column)"
            )));
        }
        (None, None) => TimeSpec::Auto,
    };
    selection.max_gap = max_gap(time.max_gap.as_ref(), &TIME_SECTION.to_string())?;
    selection.label_rules = recipe
        .episodes
        .iter()
        .map(|rule| LabelRule {
            pattern: rule.pattern.clone(),
            labels: rule
                .labels
                .iter()
                .map(|(key, value)| (key.clone(), value.as_str().map_or_else(|| value.to_string(), str::to_owned)))
                .collect(),
        })
        .collect();
    Ok(selection)
}
