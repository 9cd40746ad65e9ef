//! Ranges of the rows, column by column, beside the training range.

use fleetfoot_data::Column;
use fleetfoot_model::Model;
use fleetfoot_report::{
    Axis, Bins, Cell, Chart, Figure, Lines, Panels, Part, Series, Stroke, Table,
    words::{number, unit},
};
use fleetfoot_stats::nonuniformity;

/// Bins of a column, columns that are drawn, and columns that stand unfolded in the table.
const BINS: usize = 32;
const DRAWN: usize = 12;
const LISTED: usize = 12;

/// Bins along the time of all logs, of values that are missing.
pub(crate) const MISSING: usize = 256;

/// A column's values.
#[derive(Clone)]
pub(crate) struct Coverage {
    pub(crate) name: String,
    pub(crate) unit: Option<String>,
    /// Its place in the rows that are read.
    pub(crate) place: usize,
    /// True if a prediction reads the column, or nothing does. A column that serves only to measure a target correlates
    /// with its errors by construction.
    pub(crate) explains: bool,
    bins: Bins,
    /// Its training range, if the model knows it; then the number of values outside.
    trained: Option<[f64; 2]>,
    outside: u64,
    /// Rows without a value, by the time since the first log's start, logs one behind the other.
    pub(crate) missing: Bins,
}

/// The columns of a model, among those that are read.
pub(crate) fn columns(model: &Model, read: &[Column]) -> Vec<Coverage> {
    let known = read.iter().enumerate().filter(|(_, column)| model.column(&column.name).is_some());
    let one = |(place, column): (usize, &Column)| Coverage {
        name: column.name.clone(),
        unit: column.unit.clone(),
        place,
        explains: explains(model, &column.name),
        bins: Bins::new(BINS),
        trained: trained(model, &column.name),
        outside: 0,
        missing: Bins::new(MISSING),
    };
    known.map(one).collect()
}

fn explains(model: &Model, name: &str) -> bool {
    let speaks = |expression: &fleetfoot_library::Expr| expression.columns().iter().any(|column| **column == *name);
    let targets = model.equations.iter().filter_map(|equation| equation.target.as_ref());
    let rights = model.equations.iter().map(|equation| &equation.right);
    let partitions = model.partitions.iter().flat_map(|partition| &partition.columns);
    model.libraries.iter().flatten().chain(rights).chain(partitions).any(speaks) || !targets.into_iter().any(speaks)
}

/// The training range of a column that is itself a function of a library.
fn trained(model: &Model, name: &str) -> Option<[f64; 2]> {
    let of = |latent: &fleetfoot_model::Latent| {
        let function =
            model.libraries[latent.library].iter().position(|function| function.as_column() == Some(name))?;
        let regions = model.summaries[latent.partition].regions.iter();
        let ranges = regions.filter(|region| region.rows > 0).filter_map(|region| region.range.get(function));
        ranges.copied().reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    };
    model.latents.iter().find_map(of).filter(|range| range[0] <= range[1])
}

impl Coverage {
    /// Takes the values of rows; `seconds` is the time of one of them.
    pub(crate) fn take(&mut self, values: &[f64], seconds: impl Fn(usize) -> f64) {
        for (row, &value) in values.iter().enumerate() {
            self.bins.add(value, value);
            if !value.is_finite() {
                self.missing.add(seconds(row), 1.0);
            }
        }
        if let Some([low, high]) = self.trained {
            self.outside += values.iter().filter(|&&value| value < low || value > high).count() as u64;
        }
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        self.bins.merge(&other.bins);
        self.outside += other.outside;
        self.missing.merge(&other.missing);
    }

    /// Rows without a value.
    pub(crate) fn without(&self) -> u64 {
        self.missing.counts().iter().sum()
    }

    fn rows(&self) -> u64 {
        self.bins.counts().iter().sum()
    }

    fn panel(&self) -> Lines {
        let total = self.rows().max(1) as f64;
        let share: Vec<f64> = self.bins.counts().iter().map(|&count| 100.0 * count as f64 / total).collect();
        let rows = Series::line("rows", self.bins.places(), share).looks(Stroke::Area);
        let axis = Axis::of(self.name.clone(), self.unit.clone().unwrap_or_default());
        let lines = Lines::new(axis, Axis::of("share of rows", "%").with_zero(), vec![rows]);
        match self.trained {
            Some(range) => lines.shaded(range, "range of the training rows"),
            None => lines,
        }
    }

    /// Its row in the table; `gaps`: true if the table has a column for missing values.
    fn row(&self, gaps: bool) -> Vec<Cell> {
        let all = self.rows() as f64;
        let least = self.bins.lows().into_iter().fold(f64::NAN, f64::min);
        let most = self.bins.highs().into_iter().fold(f64::NAN, f64::max);
        let counts = self.bins.counts();
        let sums = self.bins.means().into_iter().zip(&counts).filter(|(_, count)| **count > 0);
        let mean = sums.map(|(mean, &count)| mean * count as f64).sum::<f64>() / all;
        let trained =
            self.trained.map_or_else(|| "-".to_owned(), |[low, high]| format!("{} to {}", number(low), number(high)));
        let outside = match self.trained {
            Some(_) => format!("{:.1} %", 100.0 * self.outside as f64 / all.max(1.0)),
            None => "-".to_owned(),
        };
        let words = [self.name.clone(), unit(self.unit.as_deref().unwrap_or_default())].map(Cell::Text);
        let numbers = [least, mean, most].map(Cell::of);
        let uneven = nonuniformity(counts.iter().map(|&count| count as f64));
        words
            .into_iter()
            .chain(numbers)
            .chain([Cell::Number(trained), Cell::Number(outside), Cell::of(uneven)])
            .chain(gaps.then(|| {
                Cell::Number(format!("{:.1} %", 100.0 * self.without() as f64 / (all + self.without() as f64)))
            }))
            .collect()
    }
}

/// Histograms of the columns, and their table.
pub(crate) fn parts(columns: &[Coverage]) -> Vec<Part> {
    if columns.iter().all(|column| column.rows() == 0) {
        return Vec::new();
    }
    let gaps = columns.iter().any(|column| column.without() > 0);
    let table = |columns: &[Coverage]| {
        let head = ["column", "unit", "least", "mean", "largest", "in training", "outside of it", "unevenness"];
        let head = head.into_iter().chain(gaps.then_some("missing"));
        let caption = "Range of the rows, and the unevenness of their spread over the bins between: 0 is even, 1 is all in one bin.";
        let mut table = Table::new(caption, head);
        columns.iter().for_each(|column| table = std::mem::take(&mut table).row(column.row(gaps)));
        Part::Table(table)
    };
    let mut parts = vec![Part::Figure(figure(columns)), table(&columns[..columns.len().min(LISTED)])];
    if columns.len() > LISTED {
        let rest = table(&columns[LISTED..]);
        parts.push(Part::Fold(format!("{} more columns", columns.len() - LISTED), vec![rest]));
    }
    parts
}

fn figure(columns: &[Coverage]) -> Figure {
    let drawn: Vec<Lines> = columns.iter().take(DRAWN).map(Coverage::panel).collect();
    let more =
        if columns.len() > DRAWN { format!(" Shown are {DRAWN} of {} columns.", columns.len()) } else { String::new() };
    let caption = format!(
        "Share of rows in per cent over the value of each column that the model reads, in at most {BINS} bins. Where rows lie beside the shaded range the model \
         saw none in training.{more}"
    );
    Figure::new("coverage", "Coverage of the rows", caption, Chart::Panels(Panels::new(drawn)))
}
