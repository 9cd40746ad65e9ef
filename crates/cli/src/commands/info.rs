//! `fleetfoot info`.

use fleetfoot::{
    ColumnKind, Error,
    log::{ClockInfo, FileInfo, Format, FoundRuns, TopicInfo, inspect_together, shell_word},
};

use super::{Context, files};
use crate::{
    args::Info,
    table::{bytes, count, number, seconds, table},
};

pub(crate) fn info(arguments: &Info, context: &Context) -> Result<(), Error> {
    let files = files(&arguments.data)?;
    let bar = context.bar();
    let infos = inspect_together(&files, arguments.values, &bar);
    bar.finish();
    let mut infos = infos?;
    if let Some(runs) = FoundRuns::among(&infos) {
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
