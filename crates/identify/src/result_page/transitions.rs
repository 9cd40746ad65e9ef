//! Which region follows which (Fig. 9 of Buchan, Haldane, Fearing shows where they lie; this shows how they are walked).

use fleetfoot_model::{Partition, Transitions};
use fleetfoot_report::{
    Chart, Figure, Matrix,
    words::{number, seconds},
};

use super::regions::by_size;

/// Regions that are drawn, the largest first.
const DRAWN: usize = 12;

/// A map of transitions; `rows` says whose they are, `place` tells the figure from others. `None` where no row was followed.
pub(super) fn figure(
    partition: &Partition,
    counted: &Transitions,
    step: f64,
    place: &str,
    rows: &str,
) -> Option<Figure> {
    let followed = |region: &usize| counted.counts.get(*region).is_some_and(|row| row.iter().any(|&count| count > 0));
    let all: Vec<usize> = by_size(partition).into_iter().filter(followed).collect();
    let drawn = &all[..all.len().min(DRAWN)];
    if drawn.len() < 2 {
        return None;
    }
    let dwell = |region: usize| match counted.dwell(region) {
        rows if rows.is_infinite() => "never left".to_owned(),
        rows if step > 0.0 => seconds(rows * step),
        rows => format!("{} rows", number(rows)),
    };
    let name = |&region: &usize| format!("{}: {}", partition.region_name(region), dwell(region));
    let values = drawn.iter().map(|&from| drawn.iter().map(|&to| counted.probability(from, to)).collect()).collect();
    let names = [drawn.iter().map(name).collect(), drawn.iter().map(|&region| partition.region_name(region)).collect()];
    let more = if all.len() > DRAWN {
        format!(" Shown are the {DRAWN} largest of {} regions.", all.len())
    } else {
        String::new()
    };
    let caption = format!(
        "Of the rows in a region (from the top), the share that is in each region (from the left) one row later, in {rows}. Beside each name stands how long a \
         visit lasts on average.{more}"
    );
    let matrix = Matrix::new("share of rows one row later", ["from", "to"], names, values);
    Some(Figure::new(
        format!("transitions-{place}"),
        format!("Which region follows which in {}", partition.specification),
        caption,
        Chart::Matrix(matrix),
    ))
}
