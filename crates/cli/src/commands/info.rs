//! `fleetfoot info`.

use fleetfoot::{
    ColumnKind, Error,
    log::{FileInfo, inspect, inspect_values},
};
use serde_json::json;

use super::{Context, files, real};
use crate::{
    args::Info,
    table::{bytes, number, seconds, table},
};

pub(crate) fn info(arguments: &Info, context: &Context) -> Result<(), Error> {
    let files = files(&arguments.data)?;
    let bar = context.bar();
    let infos: Result<Vec<FileInfo>, _> =
        files.iter().map(|path| if arguments.values { inspect_values(path, &bar) } else { inspect(path) }).collect();
    bar.finish();
    let infos = infos?;
    let json = serde_json::Value::Array(infos.iter().map(to_json).collect());
    context.print(&json, || infos.iter().map(to_text).collect::<Vec<_>>().join("\n\n"));
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

fn to_text(info: &FileInfo) -> String {
    let rows = info.rows.map_or("rows not counted (--values counts)".into(), |rows| format!("{rows} rows"));
    let mut text = format!(
        "{}: {}, {}, {rows}, {} columns",
        info.path.display(),
        info.format.name(),
        bytes(info.bytes),
        info.columns.len()
    );
    match &info.time {
        Some(time) => text.push_str(&format!("\n  clock: `{}` in {}", time.column, time.unit.symbol())),
        None => text.push_str("\n  clock: none found; name one with --time, or give --dt"),
    }
    if let Some(clock) = &info.clock {
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
    text.push('\n');
    text.push_str(&table(header, rows));
    for note in &info.notes {
        text.push_str(&format!("\n  note: {note}"));
    }
    text
}

fn to_json(info: &FileInfo) -> serde_json::Value {
    json!({
        "file": info.path.display().to_string(), "format": info.format.name(), "bytes": info.bytes, "rows": info.rows,
        "episodes": info.episodes,
        "time": info.time.as_ref().map(|time| json!({ "column": time.column, "unit": time.unit.symbol(), "assumed": time.assumed })),
        "clock": info.clock.as_ref().map(|clock| json!({
            "rows": clock.rows, "missing": clock.missing, "repeated": clock.repeated, "backward": clock.backward, "gaps": clock.gaps,
            "largest_step": real(clock.largest_step), "max_gap": real(clock.max_gap), "period": real(clock.period),
            "start": clock.start, "end": clock.end })),
        "columns": info.columns.iter().map(|column| json!({
            "name": column.name, "unit": column.unit, "kind": kind(&column.kind), "unreadable": column.unsupported,
            "statistics": column.statistics.map(|s| json!({
                "count": s.count, "missing": s.missing, "min": real(s.min), "mean": real(s.mean), "max": real(s.max) })),
        })).collect::<Vec<_>>(),
        "notes": info.notes,
    })
}
