//! Transitions between regions, as tables of the code: counts, shares and dwells, along a phase and from stride to
//! stride, and pairs that differ. No exported function reads them. C has them in a separate source, so that a robot
//! which does not need them spends no memory on them.

use fleetfoot_model::{Partition, Phases, RegionPair, Transitions};

use crate::{assemble::Assembled, c_syntax::C, layout, options::Precision, print::Syntax, public::fold};

/// The tables of one model.
pub(crate) struct TransitionTables {
    tables: Vec<Table>,
    /// Bins of the phase, where there is one.
    bins: Option<usize>,
}

/// A table before it is in a language.
pub(crate) struct Table {
    /// Its name in code.
    name: &'static str,
    /// Its name among arrays.
    pub(crate) path: &'static str,
    /// Its description, for people.
    doc: String,
    sizes: Vec<Size>,
    pub(crate) values: Values,
}

/// Length of a table's side.
#[derive(Debug, Clone, Copy)]
enum Size {
    Regions(usize),
    Bins(usize),
}

pub(crate) enum Values {
    Counts(Vec<u64>),
    Reals(Vec<f64>),
}

impl Size {
    fn length(self) -> usize {
        let (Self::Regions(length) | Self::Bins(length)) = self;
        length
    }
}

impl Table {
    fn counts(name: &'static str, path: &'static str, sizes: &[Size], doc: String, rows: Vec<u64>) -> Self {
        Self { name, path, doc, sizes: sizes.to_vec(), values: Values::Counts(rows) }
    }

    fn reals(name: &'static str, path: &'static str, sizes: &[Size], doc: &str, values: Vec<f64>) -> Self {
        Self { name, path, doc: doc.into(), sizes: sizes.to_vec(), values: Values::Reals(values) }
    }

    /// The lengths of its sides.
    pub(crate) fn shape(&self) -> Vec<usize> {
        self.sizes.iter().map(|size| size.length()).collect()
    }

    /// Bits of counts, 0 of reals.
    fn bits(&self) -> usize {
        match &self.values {
            Values::Counts(rows) if rows.iter().any(|&rows| rows > u64::from(u32::MAX)) => 64,
            Values::Counts(_) => 32,
            Values::Reals(_) => 0,
        }
    }

    fn texts(&self, number: &dyn Fn(f64) -> String) -> Vec<String> {
        match &self.values {
            Values::Counts(rows) => rows.iter().map(u64::to_string).collect(),
            Values::Reals(values) => values.iter().map(|&value| number(value)).collect(),
        }
    }
}

/// All tables of a partition whose transitions were counted; `step` is the sampling period, for people.
pub(crate) fn tables(partition: &Partition, step: f64) -> Vec<Table> {
    let Some(counted) = &partition.transitions else { return Vec::new() };
    let mut tables = by_sample(counted, step);
    tables.extend(partition.phases.iter().flat_map(by_phase));
    tables.extend(differences(&partition.pairs, counted.counts.len()));
    tables
}

fn by_sample(counted: &Transitions, step: f64) -> Vec<Table> {
    let count = counted.counts.len();
    let regions = Size::Regions(count);
    let shares = (0..count).flat_map(|from| (0..count).map(move |to| counted.probability(from, to))).collect();
    let about = format!(
        "How many training rows of a region (the first index) were followed, one row later, by a row of each (the second). Rows are the training's, one every \
         {step:?} s; the order of the regions is that of their names."
    );
    let rows = counted.counts.iter().flatten().copied().collect();
    vec![
        Table::counts("transition_count", "transitions/count", &[regions; 2], about, rows),
        Table::reals(
            "transition_probability",
            "transitions/probability",
            &[regions; 2],
            "The share of a region's rows (the first index) that a row of each (the second) follows; not a number where no row was followed by any.",
            shares,
        ),
        Table::reals(
            "dwell",
            "transitions/dwell",
            &[regions],
            "Rows that a visit of a region lasts on average; infinite where it was never left, not a number where no row was followed by any.",
            (0..count).map(|region| counted.dwell(region)).collect(),
        ),
    ]
}

fn by_phase(phases: &Phases) -> Vec<Table> {
    let (bins, count) = (phases.bins.count(), phases.strides.len());
    let (phase, regions) = (Size::Bins(bins), Size::Regions(count));
    let mut passages = vec![0; bins * count * count];
    for passage in &phases.passages {
        passages[(passage.bin as usize * count + passage.from as usize) * count + passage.to as usize] = passage.rows;
    }
    let shares = (0..bins).flat_map(|bin| (0..count).map(move |region| phases.share(bin, region))).collect();
    let strides = (0..count).flat_map(|from| (0..count).map(move |to| phases.stride_probability(from, to))).collect();
    let about = format!(
        "How many training rows of a bin of the phase {} (the first index) were in each region.",
        phases.specification
    );
    let passed = "How many training rows of a bin of the phase (the first index) and a region (the second) were followed, one row later, by a row of each (the third).";
    let strode = "How many strides that began in a region (the first index) were followed by one that began in each (the second).";
    vec![
        Table::counts(
            "phase_rows",
            "phase/rows",
            &[phase, regions],
            about,
            phases.rows.iter().flatten().copied().collect(),
        ),
        Table::reals(
            "phase_share",
            "phase/share",
            &[phase, regions],
            "The share of a bin's rows (the first index) that is in each region (the second); not a number of a bin without rows.",
            shares,
        ),
        Table::counts(
            "phase_transition_count",
            "phase/transition_count",
            &[phase, regions, regions],
            passed.into(),
            passages,
        ),
        Table::counts(
            "stride_count",
            "stride/count",
            &[regions; 2],
            strode.into(),
            phases.strides.iter().flatten().copied().collect(),
        ),
        Table::reals(
            "stride_probability",
            "stride/probability",
            &[regions; 2],
            "The share of the strides that began in a region (the first index) that one which began in each (the second) follows; not a number where none was followed.",
            strides,
        ),
    ]
}

fn differences(pairs: &[RegionPair], count: usize) -> Option<Table> {
    let mut values = vec![f64::NAN; count * count];
    for RegionPair { regions: [a, b], p, .. } in pairs {
        for (from, to) in [(*a as usize, *b as usize), (*b as usize, *a as usize)] {
            values[from * count + to] = *p;
        }
    }
    let doc = "How probable as great a difference between the maps of two regions is where both have the same (a likelihood ratio test); not a number where it is unknown.";
    (!pairs.is_empty()).then(|| Table::reals("difference_p", "pairs/p", &[Size::Regions(count); 2], doc, values))
}

impl TransitionTables {
    /// Those of the partition whose regions the code gives; `None` where none were counted.
    pub(crate) fn of(assembled: &Assembled<'_>) -> Option<Self> {
        let partition = &assembled.plan.model.partitions[assembled.reported()?];
        let tables = tables(partition, assembled.model.step);
        let bins = partition.phases.as_ref().map(|phases| phases.bins.count());
        (!tables.is_empty()).then_some(Self { tables, bins })
    }
}

/// The lengths of a table's sides in C.
fn c_sizes(table: &Table, c: &C<'_>) -> String {
    let side = |size: &Size| match size {
        Size::Regions(_) => format!("[{}_REGION_COUNT]", c.upper()),
        Size::Bins(_) => format!("[{}_PHASE_BIN_COUNT]", c.upper()),
    };
    table.sizes.iter().map(side).collect()
}

fn c_kind(table: &Table, c: &C<'_>) -> String {
    match table.bits() {
        0 => c.real().to_owned(),
        bits => format!("uint{bits}_t"),
    }
}

/// Writes the declarations of C's header.
pub(crate) fn c_declarations(tables: &TransitionTables, c: &C<'_>, out: &mut String) {
    let p = c.prefix;
    if let Some(bins) = tables.bins {
        *out += &format!("/* Bins of the phase. */\n#define {}_PHASE_BIN_COUNT {bins}\n\n", c.upper());
    }
    for (at, table) in tables.tables.iter().enumerate() {
        let first = format!("{} The tables are in {p}_transitions.c: compile it only if you read them.", table.doc);
        *out += "/*\n";
        for line in fold(if at == 0 { &first } else { &table.doc }, 112) {
            *out += &format!(" * {line}\n");
        }
        *out += &format!(" */\nextern const {} {p}_{}{};\n\n", c_kind(table, c), table.name, c_sizes(table, c));
    }
}

/// C's source of the tables.
pub(crate) fn c_source(tables: &TransitionTables, c: &C<'_>) -> String {
    let p = c.prefix;
    let number = |value: f64| {
        // The macros are of type `float`.
        let cast = if c.precision == Precision::Double { "(double)" } else { "" };
        match value {
            _ if value.is_nan() => format!("{cast}NAN"),
            f64::INFINITY => format!("{cast}INFINITY"),
            _ => c.number(value),
        }
    };
    let is_finite = |table: &Table| match &table.values {
        Values::Counts(_) => true,
        Values::Reals(values) => values.iter().all(|value| value.is_finite()),
    };
    let mut out = format!("/* Which region follows which: see {p}.h. */\n#include \"{p}.h\"\n");
    out += if tables.tables.iter().all(is_finite) { "" } else { "\n#include <math.h>\n" };
    for table in &tables.tables {
        out += &format!("\nconst {} {p}_{}{} = {{\n", c_kind(table, c), table.name, c_sizes(table, c));
        nested(&table.texts(&number), &table.shape(), ["{", "}"], &mut out);
        out += "};\n";
    }
    out
}

/// Rust's tables: constants, which take no memory where nothing reads them.
pub(crate) fn rust(tables: &TransitionTables, real: &str, number: &dyn Fn(f64) -> String, out: &mut String) {
    let number = |value: f64| match value {
        _ if value.is_nan() => format!("{real}::NAN"),
        f64::INFINITY => format!("{real}::INFINITY"),
        _ => number(value),
    };
    for table in &tables.tables {
        for line in fold(&table.doc, 114) {
            *out += &format!("/// {line}\n");
        }
        let kind = match table.bits() {
            0 => real.to_owned(),
            bits => format!("u{bits}"),
        };
        let kind = table.shape().iter().rev().fold(kind, |kind, length| format!("[{kind}; {length}]"));
        *out += &format!("pub const {}: {kind} = [\n", table.name.to_ascii_uppercase());
        nested(&table.texts(&number), &table.shape(), ["[", "]"], out);
        *out += "];\n\n";
    }
}

/// Python's tables: tuples.
pub(crate) fn python(tables: &TransitionTables, out: &mut String) {
    let number = |value: f64| match value {
        _ if value.is_nan() => "math.nan".into(),
        f64::INFINITY => "math.inf".into(),
        _ => format!("{value:?}"),
    };
    for table in &tables.tables {
        for line in fold(&table.doc, 112) {
            *out += &format!("# {line}\n");
        }
        *out += &format!("{} = (\n", table.name.to_ascii_uppercase());
        nested(&table.texts(&number), &table.shape(), ["(", ")"], out);
        *out += ")\n\n";
    }
}

/// Values between brackets for every side but the outermost.
fn nested(values: &[String], shape: &[usize], [open, close]: [&str; 2], out: &mut String) {
    let [_, inner @ ..] = shape else { return };
    let length: usize = inner.iter().product();
    if inner.is_empty() {
        return layout::rows(values, values.len(), out);
    }
    for part in values.chunks(length.max(1)) {
        *out += &format!("    {open}\n");
        nested(part, inner, [open, close], out);
        *out += &format!("    {close},\n");
    }
}
