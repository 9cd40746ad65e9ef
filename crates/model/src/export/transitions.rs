//! Which region follows which, as tables of the code: counts, shares and dwells. Nothing that is exported reads them: C has them in a source of its own, so that a robot which does not want them spends no memory on them.

use super::{assemble::Assembled, c_syntax::C, layout, options::Precision, print::Syntax, public::fold};
use crate::Transitions;

/// The numbers of one model.
pub(super) struct TransitionTables<'a> {
    counted: &'a Transitions,
    /// What the tables are, for people.
    about: String,
}

/// A table before it is in a language: its name, what it is, its numbers by rows.
struct Table {
    name: &'static str,
    doc: String,
    rows: Vec<Vec<f64>>,
}

impl<'a> TransitionTables<'a> {
    /// Those of the partition whose regions the code gives; `None` where none were counted.
    pub(super) fn of(assembled: &'a Assembled<'_>) -> Option<Self> {
        let counted = assembled.reported()?.transitions.as_ref()?;
        let about = format!(
            "Rows are the training's, one every {:?} s; the order of the regions is that of their names.",
            assembled.own.step
        );
        Some(Self { counted, about })
    }

    fn regions(&self) -> usize {
        self.counted.counts.len()
    }

    /// Bits of the counts' type.
    fn bits(&self) -> usize {
        let most = self.counted.counts.iter().flatten().max().copied().unwrap_or(0);
        if most > u64::from(u32::MAX) { 64 } else { 32 }
    }

    fn count_rows(&self) -> Vec<Vec<String>> {
        self.counted.counts.iter().map(|row| row.iter().map(u64::to_string).collect()).collect()
    }

    fn count_doc(&self) -> String {
        format!(
            "How many training rows of a region (the first index) were followed, one row later, by a row of each (the second). {}",
            self.about
        )
    }

    fn reals(&self) -> [Table; 2] {
        let count = self.regions();
        let shares = |from: usize| (0..count).map(|to| self.counted.probability(from, to)).collect();
        [
            Table {
                name: "transition_probability",
                doc: "The share of a region's rows (the first index) that a row of each (the second) follows; not a number where no row was followed by any."
                    .into(),
                rows: (0..count).map(shares).collect(),
            },
            Table {
                name: "dwell",
                doc: "Rows that a visit of a region lasts on average; infinite where it was never left, not a number where no row was followed by any."
                    .into(),
                rows: vec![(0..count).map(|region| self.counted.dwell(region)).collect()],
            },
        ]
    }
}

/// What C's header says.
pub(super) fn c_declarations(tables: &TransitionTables<'_>, c: &C<'_>, out: &mut String) {
    let (p, count) = (c.prefix, format!("{}_REGION_COUNT", c.upper()));
    let mut declare = |doc: &str, kind: &str, name: &str, matrix: bool| {
        *out += "/*\n";
        for line in fold(doc, 112) {
            *out += &format!(" * {line}\n");
        }
        let size = if matrix { format!("[{count}][{count}]") } else { format!("[{count}]") };
        *out += &format!(" */\nextern const {kind} {p}_{name}{size};\n\n");
    };
    let own =
        format!("{} The tables stand in {p}_transitions.c, which only who reads them compiles.", tables.count_doc());
    declare(&own, &format!("uint{}_t", tables.bits()), "transition_count", true);
    for table in tables.reals() {
        declare(&table.doc, c.real(), table.name, table.rows.len() > 1);
    }
}

/// C's source of the tables.
pub(super) fn c_source(tables: &TransitionTables<'_>, c: &C<'_>) -> String {
    let (p, count) = (c.prefix, format!("{}_REGION_COUNT", c.upper()));
    let number = |value: f64| {
        // The macros are of type `float`.
        let cast = if c.precision == Precision::Double { "(double)" } else { "" };
        match value {
            _ if value.is_nan() => format!("{cast}NAN"),
            f64::INFINITY => format!("{cast}INFINITY"),
            _ => c.number(value),
        }
    };
    let reals = tables.reals();
    let finite = reals.iter().flat_map(|table| table.rows.iter().flatten()).all(|value| value.is_finite());
    let mut out = format!("/* Which region follows which: see {p}.h. */\n#include \"{p}.h\"\n");
    out += if finite { "\n" } else { "\n#include <math.h>\n\n" };
    out += &format!("const uint{}_t {p}_transition_count[{count}][{count}] = {{\n", tables.bits());
    matrix(&tables.count_rows(), ["{", "}"], &mut out);
    out += "};\n";
    for table in reals {
        let rows = texts(&table, &number);
        if let [row] = rows.as_slice() {
            out += &format!("\nconst {} {p}_{}[{count}] = {{\n", c.real(), table.name);
            layout::rows(row, row.len(), &mut out);
        } else {
            out += &format!("\nconst {} {p}_{}[{count}][{count}] = {{\n", c.real(), table.name);
            matrix(&rows, ["{", "}"], &mut out);
        }
        out += "};\n";
    }
    out
}

/// Rust's tables: constants, which take no memory where nothing reads them.
pub(super) fn rust(tables: &TransitionTables<'_>, real: &str, number: &dyn Fn(f64) -> String, out: &mut String) {
    let count = tables.regions();
    let mut declare = |doc: &str, name: &str, kind: &str, rows: &[Vec<String>]| {
        for line in fold(doc, 114) {
            *out += &format!("/// {line}\n");
        }
        *out += &format!("pub const {}: ", name.to_ascii_uppercase());
        if let [row] = rows {
            *out += &format!("[{kind}; {count}] = [\n");
            layout::rows(row, row.len(), out);
        } else {
            *out += &format!("[[{kind}; {count}]; {count}] = [\n");
            matrix(rows, ["[", "]"], out);
        }
        *out += "];\n\n";
    };
    declare(&tables.count_doc(), "transition_count", &format!("u{}", tables.bits()), &tables.count_rows());
    let number = |value: f64| match value {
        _ if value.is_nan() => format!("{real}::NAN"),
        f64::INFINITY => format!("{real}::INFINITY"),
        _ => number(value),
    };
    for table in tables.reals() {
        declare(&table.doc, table.name, real, &texts(&table, &number));
    }
}

/// Python's tables: tuples.
pub(super) fn python(tables: &TransitionTables<'_>, out: &mut String) {
    let mut declare = |doc: &str, name: &str, rows: &[Vec<String>]| {
        for line in fold(doc, 112) {
            *out += &format!("# {line}\n");
        }
        *out += &format!("{} = (\n", name.to_ascii_uppercase());
        if let [row] = rows {
            layout::rows(row, row.len(), out);
        } else {
            matrix(rows, ["(", ")"], out);
        }
        *out += ")\n\n";
    };
    declare(&tables.count_doc(), "transition_count", &tables.count_rows());
    let number = |value: f64| match value {
        _ if value.is_nan() => "math.nan".into(),
        f64::INFINITY => "math.inf".into(),
        _ => format!("{value:?}"),
    };
    for table in tables.reals() {
        declare(&table.doc, table.name, &texts(&table, &number));
    }
}

/// NumPy's arrays: counts regions x regions, shares regions x regions, dwells by region.
pub(super) fn arrays(counted: &Transitions) -> (Vec<i64>, Vec<f64>, Vec<f64>) {
    let count = counted.counts.len();
    let counts = counted.counts.iter().flatten().map(|&rows| i64::try_from(rows).unwrap_or(i64::MAX)).collect();
    let shares = (0..count).flat_map(|from| (0..count).map(move |to| counted.probability(from, to))).collect();
    (counts, shares, (0..count).map(|region| counted.dwell(region)).collect())
}

fn texts(table: &Table, number: &dyn Fn(f64) -> String) -> Vec<Vec<String>> {
    table.rows.iter().map(|row| row.iter().map(|&value| number(value)).collect()).collect()
}

/// Rows between brackets of their own.
fn matrix(rows: &[Vec<String>], [open, close]: [&str; 2], out: &mut String) {
    for row in rows {
        *out += &format!("    {open}\n");
        layout::rows(row, row.len(), out);
        *out += &format!("    {close},\n");
    }
}
