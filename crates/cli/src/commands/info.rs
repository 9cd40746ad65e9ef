//! `fleetfoot info`.

use std::path::PathBuf;

use fleetfoot::{
    ColumnKind, Correlations, Error, LagCurve, Recipe, correlations, lag_curve,
    log::{ClockInfo, DetectedRuns, FileInfo, Format, TopicInfo, inspect_together, shell_word},
};

use super::{Context, files};
use crate::{
    args::Info,
    table::{bytes, count, number, seconds, table},
};

pub(crate) fn info(arguments: &Info, context: &Context) -> Result<(), Error> {
    let files = files(&arguments.data)?;
    if arguments.correlation || arguments.lag.is_some() {
        return relations(arguments, &files, context);
    }
    if arguments.recipe.is_some() {
        return Err(Error::value("--recipe is for --correlation and --lag; `fleetfoot check` reads a recipe".into()));
    }
    let bar = context.bar();
    let infos = inspect_together(&files, arguments.values, &bar);
    bar.finish();
    let mut infos = infos?;
    if let Some(runs) = DetectedRuns::among(&infos) {
        let data: Vec<String> = arguments.data.iter().map(|path| shell_word(&path.to_string_lossy())).collect();
        let note = format!(
            "these look like the files of {}: their columns differ. [files] in the recipe joins them on one clock ({}); `fleetfoot init {} -o robot.toml` writes such a recipe",
            if runs.runs.len() == 1 { "one run".into() } else { format!("{} runs", runs.runs.len()) },
            runs.in_words(),
            data.join(" ")
        );
        infos.iter_mut().take(1).for_each(|info| info.notes.push(note.clone()));
    }
    context.print(&infos, || infos.iter().map(to_text).collect::<Vec<_>>().join("\n\n"));
    Ok(())
}

/// Correlations, or the difference of two columns by their shift.
fn relations(arguments: &Info, files: &[PathBuf], context: &Context) -> Result<(), Error> {
    let recipe = arguments.recipe.as_deref().map_or_else(|| Ok(Recipe::default()), Recipe::read)?;
    let bar = context.bar();
    let Some(lag) = &arguments.lag else {
        let columns = arguments.columns.as_ref().map(|list| list.0.as_slice());
        let correlations = correlations(&recipe, columns, files, &bar);
        bar.finish();
        let correlations = correlations?;
        context.notes(&correlations.notes);
        context.print(&correlations, || correlations_to_text(&correlations));
        return Ok(());
    };
    let [reference, response] = lag.0.as_slice() else {
        return Err(Error::value(format!("--lag {}: name two columns, REFERENCE,RESPONSE", lag.0.join(","))));
    };
    let curve = lag_curve(&recipe, [reference, response], arguments.reach, files, &bar);
    bar.finish();
    let curve = curve?;
    context.notes(&curve.notes);
    context.print(&curve, || lags_to_text(&curve));
    Ok(())
}

/// Columns of a printed matrix, at most.
const WIDTH: usize = 12;
/// Correlations that are listed.
const STRONG: f64 = 0.9;

fn correlations_to_text(correlations: &Correlations) -> String {
    let mut text =
        format!("correlation of {}, {} rows\n", count(correlations.columns.len(), "column"), correlations.rows);
    let cell = |value: f64| if value.is_finite() { format!("{value:.3}") } else { "-".to_owned() };
    if correlations.columns.len() <= WIDTH {
        let header: Vec<&str> = std::iter::once("").chain(correlations.columns.iter().map(String::as_str)).collect();
        let row = |(name, values): (&String, &Vec<f64>)| {
            std::iter::once(name.clone()).chain(values.iter().map(|value| cell(*value))).collect()
        };
        text.push_str(&table(&header, correlations.columns.iter().zip(&correlations.matrix).map(row).collect()));
        text.push('\n');
    }
    let names = &correlations.columns;
    let pairs = (0..names.len()).flat_map(|i| (i + 1..names.len()).map(move |j| (i, j)));
    let mut strong: Vec<(usize, usize)> = pairs.filter(|&(i, j)| correlations.matrix[i][j].abs() >= STRONG).collect();
    strong.sort_by(|a, b| correlations.matrix[b.0][b.1].abs().total_cmp(&correlations.matrix[a.0][a.1].abs()));
    text.push_str(&format!("pairs of size {STRONG} and more: {}", if strong.is_empty() { "none" } else { "" }));
    for (i, j) in strong {
        text.push_str(&format!("\n  {} {} and {}", cell(correlations.matrix[i][j]), names[i], names[j]));
    }
    text
}

/// Shifts of a lag curve that are printed, at most.
const SHIFTS: usize = 20;

fn lags_to_text(curve: &LagCurve) -> String {
    let step = curve.shifts.len().div_ceil(SHIFTS).max(1);
    let is_shown = |shift: &&fleetfoot::Shift| {
        shift.rows % step as i64 == 0 || shift.rows == curve.nearest || shift.rows == curve.alike
    };
    let row = |shift: &fleetfoot::Shift| {
        let mark = match (shift.rows == curve.nearest, shift.rows == curve.alike) {
            (true, true) => "<- least difference, largest correlation",
            (true, false) => "<- least difference",
            (false, true) => "<- largest correlation",
            (false, false) => "",
        };
        vec![
            shift.rows.to_string(),
            format!("{:.4}", shift.seconds),
            number(shift.difference),
            number(shift.deviation),
            if shift.correlation.is_finite() { format!("{:.4}", shift.correlation) } else { "-".to_owned() },
            mark.to_owned(),
        ]
    };
    let header = ["rows", "s", "mean |difference|", "deviation", "correlation", ""];
    format!(
        "{} behind {}, by the rows by which it is later\n{}",
        curve.response,
        curve.reference,
        table(&header, curve.shifts.iter().filter(is_shown).map(row).collect())
    )
}

fn kind(kind: &ColumnKind) -> String {
    match kind {
        ColumnKind::Float => "float".into(),
        ColumnKind::Integer => "integer".into(),
        ColumnKind::Boolean => "boolean".into(),
        ColumnKind::Category(names) if names.is_empty() => "text".into(),
        ColumnKind::Category(names) if names.len() <= 4 => names.join("|"),
        ColumnKind::Category(names) => format!("text, {} values", names.len()),
    }
}

/// A robot's log: its topics, and its fields when they were scanned.
fn log_to_text(info: &FileInfo) -> String {
    // PX4 gives the stamp 0 to what was never set: no log of it begins with its clock.
    let is_set = |stamp: &i64| *stamp != 0 || !matches!(info.format, Format::Ulog(_));
    let start = info.topics.iter().filter_map(|topic| topic.start).filter(is_set).min();
    let end = info.topics.iter().filter_map(|topic| topic.end).max();
    let long = start.zip(end).map(|(start, end)| format!(", {} long", seconds((end - start) as f64 * 1e-9)));
    let messages: Option<u64> = info.topics.iter().map(|topic| topic.messages).sum();
    let messages = messages.map(|messages| format!(", {}", count(messages as usize, "message"))).unwrap_or_default();
    let mut text = format!(
        "{}: {}, {}{messages}{}, {}, {}",
        info.path.display(),
        info.format.name(),
        bytes(info.bytes),
        long.unwrap_or_default(),
        count(info.topics.len(), "topic"),
        count(info.columns.len(), "field")
    );
    let header = [
        "topic",
        "type",
        "encoding",
        "messages",
        "rate (Hz)",
        "jitter (s)",
        "bursts",
        "gaps",
        "longest (s)",
        "log - header (s)",
    ];
    let rows = info.topics.iter().map(topic_row).collect();
    text.push('\n');
    text.push_str(&table(&header, rows));
    for topic in &info.topics {
        if let Some(problem) = &topic.problem {
            text.push_str(&format!("\n  {} cannot be read: {problem}", topic.name));
        }
    }
    if info.columns.iter().any(|column| column.statistics.is_some()) {
        text.push('\n');
        text.push_str(&columns_table(info));
    } else {
        text.push_str("\n  fields: `fleetfoot init` lists them, --values their ranges");
    }
    if !info.metadata.is_empty() {
        text.push_str(&format!("\n  metadata: {} (--json lists them)", count(info.metadata.len(), "value")));
    }
    for note in &info.notes {
        text.push_str(&format!("\n  note: {note}"));
    }
    text
}

fn topic_row(topic: &TopicInfo) -> Vec<String> {
    let encoding = match topic.schema_encoding.as_str() {
        "" => topic.message_encoding.clone(),
        schema => format!("{}, {schema}", topic.message_encoding),
    };
    let offset = match &topic.header_offset {
        None => String::new(),
        Some(offset) if offset.zero => "headers are zero".into(),
        Some(offset) if (offset.first - offset.last).abs() < 1e-3 * offset.first.abs().max(1.0) => number(offset.first),
        Some(offset) => format!("{} .. {}", number(offset.first), number(offset.last)),
    };
    vec![
        topic.name.clone(),
        topic.type_name.clone(),
        encoding,
        topic.messages.map(|count| count.to_string()).unwrap_or_default(),
        topic.rate.map(number).unwrap_or_default(),
        topic.jitter.map(number).unwrap_or_default(),
        topic.bursts.map(|bursts| bursts.to_string()).unwrap_or_default(),
        topic.gaps.map(|gaps| gaps.to_string()).unwrap_or_default(),
        topic.largest_gap.map(number).unwrap_or_default(),
        offset,
    ]
}

fn to_text(info: &FileInfo) -> String {
    if !info.topics.is_empty() {
        return log_to_text(info);
    }
    let rows = info.rows.map_or("rows not counted (--values counts)".into(), |rows| format!("{rows} rows"));
    let mut text = format!(
        "{}: {}, {}, {rows}, {} columns",
        info.path.display(),
        info.format.name(),
        bytes(info.bytes),
        info.columns.len()
    );
    match &info.clock {
        Some(clock) => text.push_str(&format!("\n  clock: {}", clock_text(clock))),
        None => text.push_str("\n  clock: none found; name one with --time, or give --dt"),
    }
    if let Some(clock) = info.clock.as_ref().and_then(|clock| clock.summary) {
        let rate = if clock.period > 0.0 { format!(", {} Hz", number(1.0 / clock.period)) } else { String::new() };
        text.push_str(&format!(
            "\n  {} long{rate}, largest step {}; {} gaps, {} backward, {} repeated, {} missing stamps; {} episodes",
            seconds((clock.end - clock.start) as f64 * 1e-9),
            seconds(clock.largest_step),
            clock.gaps,
            clock.backward,
            clock.repeated,
            clock.missing,
            info.episodes.unwrap_or(1)
        ));
    }
    text.push('\n');
    text.push_str(&columns_table(info));
    for note in &info.notes {
        text.push_str(&format!("\n  note: {note}"));
    }
    text
}

/// The clock's column, its unit, and whether that is a guess.
fn clock_text(clock: &ClockInfo) -> String {
    let beside = clock.beside.as_ref().map(|beside| format!(" and `{beside}`")).unwrap_or_default();
    let unit = match clock.unit {
        Some(unit) => format!(" in {}", unit.symbol()),
        None if clock.is_open() => ", unit unknown".to_owned(),
        None => ", dates".to_owned(),
    };
    let assumed = clock.assumed.as_ref().map(|assumed| format!(" (a guess: {assumed})")).unwrap_or_default();
    format!("`{}`{beside}{unit}{assumed}", clock.column)
}

fn columns_table(info: &FileInfo) -> String {
    let scanned = info.columns.iter().any(|column| column.statistics.is_some());
    let header: &[&str] = if scanned {
        &["column", "kind", "unit", "min", "mean", "max", "missing"]
    } else {
        &["column", "kind", "unit"]
    };
    let rows = info
        .columns
        .iter()
        .map(|column| {
            let what =
                column.unsupported.as_ref().map_or_else(|| kind(&column.kind), |why| format!("unreadable: {why}"));
            let mut row = vec![column.name.clone(), what, column.unit.clone().unwrap_or_default()];
            if let Some(s) = &column.statistics {
                row.extend([number(s.min), number(s.mean), number(s.max), s.missing.to_string()]);
            }
            row
        })
        .collect();
    table(header, rows)
}
