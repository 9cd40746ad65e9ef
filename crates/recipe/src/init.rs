//! A commented recipe for a file, to be edited.

mod channels;
mod names;
mod run_files;
mod short;

use std::{
    collections::{HashMap, HashSet},
    fmt::Write,
};

use fleetfoot_data::{Column, ColumnKind};
use fleetfoot_library::Expr;
use fleetfoot_log::{ClockInfo, FileInfo};
use names::Names;
pub use run_files::starter_recipe_of_runs;

use crate::recipe::Recipe;

/// Names that usually stand for angles in radians.
const ANGLES: [&str; 8] = ["yaw", "pitch", "roll", "theta", "psi", "heading", "angle", "azimuth"];

/// The recipe's text: every field listed where it can be uncommented, the clock filled in, quaternions and angles noticed.
///
/// It is valid TOML as it stands, and is completed by uncommenting.
pub fn starter_recipe(info: &FileInfo) -> String {
    let columns = listed(info);
    let file = info.path.file_name().unwrap_or_default().to_string_lossy();
    if info.topics.is_empty() {
        table_recipe(&file, &columns, info.clock.as_ref())
    } else {
        channels::recipe(&file, &columns, &info.topics)
    }
}

/// States and inputs that [`starter_recipe`] proposes of a robot's log, with the clock and the topics' names of the
/// recipe. `None` of tables, and without a proposal.
pub fn draft_of_topics(recipe: &Recipe, info: &FileInfo) -> Option<Recipe> {
    if info.topics.is_empty() {
        return None;
    }
    let mut draft = Recipe::parse(&starter_recipe(info), "the draft").ok()?;
    if draft.states.is_empty() && draft.inputs.is_empty() {
        return None;
    }
    (draft.time, draft.rename) = (recipe.time.clone(), recipe.rename.clone());
    Some(draft)
}

/// States of a robot's odometry and the commands that it gets; `None` of tables, and of logs without an odometry.
pub fn draft_of_odometry(info: &FileInfo) -> Option<Recipe> {
    channels::of_odometry(&listed(info), &info.topics)
}

/// The columns of a file that can be read.
fn listed(info: &FileInfo) -> Vec<Column> {
    let readable = info.columns.iter().filter(|column| column.unsupported.is_none());
    readable
        .map(|column| Column { name: column.name.clone(), unit: column.unit.clone(), kind: column.kind.clone() })
        .collect()
}

/// Returns true if a name usually stands for an angle in radians.
pub fn is_named_angle(name: &str) -> bool {
    is_angle(name)
}

fn table_recipe(file: &str, columns: &[Column], clock: Option<&ClockInfo>) -> String {
    let time = clock.map(|clock| clock.column.as_str());
    // A name that two columns share says nothing.
    let counts = counts(columns);
    let is_unique = |name: &str| counts.get(name) == Some(&1);
    let fields: Vec<&Column> =
        columns.iter().filter(|column| Some(column.name.as_str()) != time && is_unique(&column.name)).collect();
    let numeric: Vec<&Column> = fields
        .iter()
        .copied()
        .filter(|column| !matches!(column.kind, ColumnKind::Category(_) | ColumnKind::Boolean))
        .collect();
    let mut out = String::new();
    heading(&mut out, file);
    columns_heading(&mut out);
    aliases(&mut out, columns);
    states_heading(&mut out, columns);
    for column in &numeric {
        let details = if is_angle(&column.name) { "{ kind = \"angle\" }" } else { "{}" };
        let _ = writeln!(out, "# {} = {details}{}", key(&column.name), unit(column));
    }
    let _ = writeln!(out, "\n# Inputs: columns that drive the model.");
    let _ = writeln!(out, "[inputs]");
    for column in &numeric {
        let _ = writeln!(out, "# {} = {}{}", key(&column.name), text(&column.name), unit(column));
    }
    let _ = writeln!(out, "\n# The clock. Without a time column: dt = 0.01");
    let _ = writeln!(out, "[time]");
    match clock {
        // A clock in two columns is found, and cannot be named.
        Some(ClockInfo { beside: None, column, .. }) => {
            let _ = writeln!(out, "column = {}", text(column));
        }
        _ => {
            let _ = writeln!(out, "# column = \"t\"");
        }
    }
    match clock.map(|clock| (clock.unit, clock.assumed.as_ref())) {
        Some((Some(unit), Some(assumed))) => {
            let _ = writeln!(out, "unit = \"{}\"   # {}", unit.symbol(), one_line(assumed));
        }
        Some((None, Some(assumed))) => {
            let _ = writeln!(out, "# unit = \"ms\"   # {}", one_line(assumed));
        }
        _ => {}
    }
    model_section(&mut out);
    let labels: Vec<&str> = fields
        .iter()
        .filter(|column| matches!(column.kind, ColumnKind::Category(_) | ColumnKind::Boolean | ColumnKind::Integer))
        .map(|column| column.name.as_str())
        .collect();
    if !labels.is_empty() {
        let _ = writeln!(out, "# columns that may be labels: {}", labels.join(", "));
    }
    method_section(&mut out);
    episodes_section(&mut out);
    out
}

/// Aliases that may be useful: angles of quaternions, short names for odd ones, an example.
fn aliases(out: &mut String, columns: &[Column]) {
    let counts = counts(columns);
    let has = |name: &str| counts.get(name) == Some(&1);
    let mut names = Names::besides(columns.iter().map(|column| column.name.as_str()));
    for column in columns.iter().filter(|column| has(&column.name)) {
        let bare = column.name.split(['[', '(']).next().unwrap_or_default().trim();
        if Expr::column(column.name.as_str()).to_string() != column.name {
            let _ = writeln!(out, "# {} = {}", key(&names.take(bare)), text(&column.name));
        }
    }
    for prefix in quaternions(columns) {
        for angle in ["yaw", "pitch", "roll"] {
            let _ = writeln!(out, "# {} = \"{angle}({prefix})\"", names.take(angle));
        }
    }
    if has("vx") && has("vy") {
        let _ = writeln!(out, "# {} = \"sqrt(vx^2 + vy^2)\"", names.take("speed"));
    }
    let mut twice: Vec<&str> = columns.iter().map(|column| column.name.as_str()).filter(|name| !has(name)).collect();
    twice.sort_unstable();
    twice.dedup();
    for name in twice {
        let _ = writeln!(out, "#   several columns are called {}: rename them in the file to use them", text(name));
    }
    out.push('\n');
}

fn heading(out: &mut String, file: &str) {
    let _ = writeln!(out, "# Recipe for {file} and files like it. Uncomment what the model shall use, then:");
    let _ = writeln!(out, "#   fleetfoot fit pwa -c THIS FILES... -o model.json\n");
}

fn columns_heading(out: &mut String) {
    let _ = writeln!(
        out,
        "# Short names for fields and for expressions over them. Odd names stand in backticks within expressions."
    );
    let _ = writeln!(out, "[columns]");
}

fn states_heading(out: &mut String, columns: &[Column]) {
    let _ = writeln!(out, "# States: the model advances them in time. Details, all optional:");
    let _ = writeln!(
        out,
        "#   kind = \"angle\"         radians; differences wrap, the library and the partition see its cosine and sine"
    );
    let _ = writeln!(
        out,
        "#   derivative = \"central\" how it is measured: auto, central (default), central4, central6, forward, backward, a field or an expression, {{ over = 20 }}"
    );
    let _ = writeln!(out, "#   known = \"vx*cos(yaw)\"  its derivative is this: integrated, not fitted");
    let _ = writeln!(out, "#   regressor = false      not seen by the library and the partition");
    if let Some(prefix) = quaternions(columns).first() {
        let _ = writeln!(
            out,
            "#   [states.attitude]      kind = \"quaternion\", column = {}, rate = [three rates, rad/s, about the body's axes]",
            text(prefix)
        );
    }
    let _ = writeln!(out, "[states]");
}

fn model_section(out: &mut String) {
    let _ = writeln!(
        out,
        "# max_gap = 0.5            # seconds; a longer gap begins an episode (default: five median periods)\n\
         # where = \"time() > 2\"   # the rows to use: comparisons, joined by and (default: all)\n"
    );
    let _ = writeln!(out, "[model]");
    let _ = writeln!(out, "# predict = \"derivative\"   # or next, delta, or a column (plain regression)");
    let _ = writeln!(out, "# degree = 1               # of the polynomial library in each region");
    let _ = writeln!(out, "# lags = 0                 # past rows beside the present one");
    let _ = writeln!(
        out,
        "# partition = \"kmeans:10\"  # or refined:10, tree:3, zscore:1.5, labels:COLUMN (fit pwa tries average,kmeans:2,5,10)"
    );
}

fn method_section(out: &mut String) {
    let _ = writeln!(
        out,
        "\n# How `fit pwa` goes; [sparse], [sindy] and [narx] likewise. Every entry is the flag of the same name."
    );
    let _ = writeln!(out, "# [pwa]\n# select = \"cv\"            # or bic, rollout\n# folds = 10");
}

fn episodes_section(out: &mut String) {
    let _ = writeln!(out, "\n# Labels for the episodes of matching files, for --partition labels:terrain");
    let _ = writeln!(out, "# [[episodes]]\n# match = \"grass_*\"\n# terrain = \"grass\"");
}

/// Number of columns with each name.
fn counts(columns: &[Column]) -> HashMap<&str, usize> {
    let mut counts = HashMap::new();
    columns.iter().for_each(|column| *counts.entry(column.name.as_str()).or_insert(0) += 1);
    counts
}

/// Common beginnings of fields x, y, z, w.
fn quaternions(columns: &[Column]) -> Vec<String> {
    let counts = counts(columns);
    let has = |name: &str| counts.contains_key(name);
    let (mut prefixes, mut seen) = (Vec::new(), HashSet::new());
    for column in columns {
        for separator in [".", "_", ""] {
            if let Some(prefix) = column.name.strip_suffix(&format!("{separator}w"))
                && !prefix.is_empty()
                && !prefix.ends_with(['.', '_'])
                && ["x", "y", "z"].iter().all(|letter| has(&format!("{prefix}{separator}{letter}")))
                && seen.insert(prefix)
            {
                prefixes.push(prefix.to_owned());
            }
        }
    }
    prefixes
}

fn is_angle(name: &str) -> bool {
    let last = name.rsplit(['.', '/']).next().unwrap_or(name).to_lowercase();
    ANGLES.iter().any(|angle| last == *angle || last.strip_suffix("_rad") == Some(angle))
}

/// Text for a comment.
fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}

/// A TOML key.
fn key(name: &str) -> String {
    let bare = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if bare { name.to_owned() } else { text(name) }
}

/// A TOML string.
fn text(text: &str) -> String {
    toml::Value::from(text).to_string()
}

fn unit(column: &Column) -> String {
    column.unit.as_ref().map(|unit| format!("  # {unit}")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use fleetfoot_log::TimeUnit;

    use super::*;

    /// Names were once compared with all others: 20,000 columns took 17 s.
    #[test]
    fn a_hundred_thousand_columns_take_seconds() {
        let mut columns: Vec<Column> = (0..100_000).map(|c| Column::float(format!("c{c}"))).collect();
        columns.extend((0..10_000).map(|c| Column::float(format!("v [{c}]"))));
        let begun = std::time::Instant::now();
        let text = table_recipe("a.csv", &columns, None);
        assert!(begun.elapsed().as_secs() < 20, "{:?}", begun.elapsed());
        assert!(text.contains("# c99999 = {}") && text.contains("# v_10000 = \"v [9999]\""));
    }

    #[test]
    fn draft_parses_before_and_after_uncommenting() {
        let names = ["t", "q_x", "q_y", "q_z", "q_w", "yaw", "v [m/s]", "odd \"name\""];
        let columns: Vec<Column> = names.iter().map(|name| Column::float(*name)).collect();
        let mut clock = ClockInfo::default();
        (clock.column, clock.guess, clock.assumed) = ("t".into(), true, Some("its numbers could be s or\nms".into()));
        let text = table_recipe("a.csv", &columns, Some(&clock));
        assert!(text.contains("# unit = \"ms\"   # its numbers could be s or ms\n"), "{text}");
        (clock.unit, clock.assumed) = (Some(TimeUnit::Microseconds), Some("no other unit fits".into()));
        let text = table_recipe("a.csv", &columns, Some(&clock));
        let recipe = Recipe::parse(&text, "starter").unwrap();
        assert_eq!((recipe.time.column.as_deref(), recipe.time.unit.as_deref()), (Some("t"), Some("us")));
        assert!(text.contains("yaw(q)"));
        let start = text.find("[states]").unwrap();
        let end = text.find("# Inputs:").unwrap();
        let uncommented = text[start..end].replace("\n# ", "\n");
        let recipe = Recipe::parse(&uncommented, "uncommented").unwrap();
        assert_eq!(recipe.states.len(), 7);
        assert_eq!(recipe.states["yaw"].kind, Some(crate::Kind::Angle));
        assert!(recipe.states.contains_key("odd \"name\""));
    }

    #[test]
    fn aliases_are_unique_names_for_expressions() {
        let names =
            ["a_x", "a_y", "a_z", "a_w", "b_x", "b_y", "b_z", "b_w", "yaw", "v [m/s]", "v (km/h)", "2nd", "u", "u"];
        let columns: Vec<Column> = names.iter().map(|name| Column::float(*name)).collect();
        let text = table_recipe("a.csv", &columns, None);
        let start = text.find("[columns]").unwrap();
        let end = text.find("# States: the model advances").unwrap();
        let lines =
            text[start..end].lines().filter_map(|line| line.strip_prefix("# ").filter(|line| line.contains(" = ")));
        let section = lines.fold("[columns]\n".to_owned(), |all, line| format!("{all}{line}\n"));
        let section = Recipe::parse(&section, "the section").unwrap();
        let expected = ["v", "v_2", "_2nd", "yaw_2", "pitch", "roll", "yaw_3", "pitch_2", "roll_2"];
        assert_eq!(section.columns.keys().collect::<Vec<_>>(), expected);
        assert_eq!(section.columns["v_2"], "v (km/h)");
        let mut scope = fleetfoot_library::Scope::new(names);
        scope.define_all(&section.columns).unwrap();
        for name in expected {
            Expr::parse(&format!("1 + {name}"), &scope).unwrap();
        }
        assert!(!text.contains("# u = "), "nobody knows which of the two it is");
    }
}
