//! Note of every fit about rows that it leaves out because a value is missing: their number, and the first of them.

use std::collections::BTreeSet;

use fleetfoot_data::setting::WHERE;
use fleetfoot_data::{Halo, Source};
use fleetfoot_dataset::Dataset;
use fleetfoot_library::Expr;
use fleetfoot_sums::system::SystemScan;

use crate::{error::Error, not_finite};

/// Rows read at once.
const ROWS: usize = 65_536;

/// Notes about the `incomplete` rows of a dataset that were left out. They give the number of rows, the first of them,
/// and the expressions among `read` that made them incomplete. Empty if there are none.
///
/// The rows up to the first missing value are read again, and a bounded number for the expressions.
///
/// # Errors
/// Those of reading.
pub(crate) fn incomplete_rows(incomplete: u64, dataset: &Dataset, read: Vec<Expr>) -> Result<Vec<String>, Error> {
    if incomplete == 0 {
        return Ok(Vec::new());
    }
    let mut notes = vec![sentence(incomplete, &dataset.view()?, &read)?];
    notes.extend(not_finite::explain(dataset, read)?);
    Ok(notes)
}

/// Note if the regions of a partition have fewer rows than the `complete` ones that other partitions are fitted on.
pub(crate) fn in_no_region(partition: &str, scan: &SystemScan, complete: u64) -> Option<String> {
    let missing = complete.saturating_sub((0..scan.regions()).map(|region| scan.rows(region)).sum());
    (missing > 0).then(|| {
        format!(
            "{partition}: {missing} of {complete} rows have no label and so no region, but other partitions use them: errors are over different rows; leave these rows out ({WHERE})"
        )
    })
}

fn sentence(incomplete: u64, source: &dyn Source, read: &[Expr]) -> Result<String, Error> {
    let rows = if incomplete == 1 { "1 row".to_owned() } else { format!("{incomplete} rows") };
    let place = match first_missing(source, read)? {
        Some((columns, row, episode)) => format!("the first: {} in row {} of {episode}", columns.join(", "), row + 1),
        None => "the columns are complete, but a function of them has no finite value there".to_owned(),
    };
    Ok(format!("{rows} with a missing value (NaN or infinite) left out; {place}"))
}

/// The columns without a number in the first row that lacks any, the row within its episode, and the episode.
fn first_missing(source: &dyn Source, read: &[Expr]) -> Result<Option<(Vec<String>, usize, String)>, Error> {
    let names: BTreeSet<_> = read.iter().flat_map(Expr::columns).collect();
    let columns: Vec<usize> =
        (0..source.columns().len()).filter(|&at| names.contains(source.columns()[at].name.as_str())).collect();
    for (index, episode) in source.episodes().iter().enumerate() {
        for from in (0..episode.rows).step_by(ROWS) {
            let block = source.read(index, from..(from + ROWS).min(episode.rows), Halo::default())?;
            let gap = |&column: &usize| block.core(column).iter().position(|value| !value.is_finite());
            let Some(row) = columns.iter().filter_map(gap).min() else { continue };
            let lacks = |column: &&usize| !block.core(**column)[row].is_finite();
            let names = columns.iter().filter(lacks).map(|&column| format!("`{}`", source.columns()[column].name));
            return Ok(Some((names.collect(), from + row, episode.name.clone())));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource};
    use fleetfoot_library::Scope;

    use super::*;

    #[test]
    fn the_first_missing_value_has_a_place() {
        let mut source = MemorySource::new(["a", "b", "unread"].map(Column::float).to_vec());
        source.push_uniform("one", 0.1, vec![vec![1.0; 4], vec![1.0; 4], vec![f64::NAN; 4]]);
        source.push_uniform(
            "two",
            0.1,
            vec![vec![1.0, 2.0, f64::INFINITY, 4.0], vec![1.0, 2.0, f64::NAN, f64::NAN], vec![0.0; 4]],
        );
        let read = ["a^2", "lag(b, 1)"].map(|text| Expr::parse(text, &Scope::open()).unwrap());
        let note = sentence(3, &source, &read).unwrap();
        assert_eq!(note, "3 rows with a missing value (NaN or infinite) left out; the first: `a`, `b` in row 3 of two");
        let other = sentence(1, &source, &[Expr::number(1.0)]).unwrap();
        assert!(other.starts_with("1 row with") && other.contains("a function of them"), "{other}");
    }
}
