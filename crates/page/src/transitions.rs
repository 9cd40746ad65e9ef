//! Transitions between regions (Fig. 9 of Buchan, Haldane, Fearing shows the regions; this shows the passages between
//! them).

use fleetfoot_model::{Partition, Phases, Summary, Transitions};
use fleetfoot_report::{
    Chart, Figure, Matrix,
    words::{number, seconds},
};

/// Regions against a phase: of the rows in a part of it, the share that is in each region.
pub(crate) fn along(
    (partition, summary): (&Partition, &Summary),
    phases: &Phases,
    step: f64,
    place: &str,
) -> Option<Figure> {
    let all = summary.by_size();
    let drawn = &all[..all.len().min(DRAWN)];
    let bins: Vec<usize> =
        (0..phases.bins.count()).filter(|&bin| phases.rows[bin].iter().any(|&rows| rows > 0)).collect();
    if drawn.len() < 2 || bins.len() < 2 {
        return None;
    }
    let values = bins.iter().map(|&bin| drawn.iter().map(|&region| phases.share(bin, region)).collect()).collect();
    let names = [
        bins.iter().map(|&bin| phases.bins.name(bin)).collect(),
        drawn.iter().map(|&region| partition.region_name(region)).collect(),
    ];
    let more = match all.len() {
        count if count > DRAWN => format!(" Shown are the {DRAWN} largest of {count} regions."),
        _ => String::new(),
    };
    let strides = match phases.stride_count() {
        0 => String::new(),
        count => {
            let rows = phases.rows_of_a_stride();
            let length = if step > 0.0 { seconds(rows * step) } else { format!("{} rows", number(rows)) };
            format!(" {count} strides last {length} on average.")
        }
    };
    let caption = format!(
        "Of the training rows in each part of {} (from the top), the share that is in each region (from the left).{strides}{more}",
        phases.specification
    );
    let matrix = Matrix::new("share of a part's rows", ["phase", "region"], names, values);
    Some(Figure::new(
        format!("phase-{place}"),
        format!("Regions of {} along {}", partition.specification, phases.specification),
        caption,
        Chart::Matrix(matrix),
    ))
}

/// Regions that are drawn, the largest first.
const DRAWN: usize = 12;

/// A map of transitions; `rows` names their owner, `place` distinguishes the figure. `None` if no row was followed.
pub(crate) fn figure(
    (partition, summary): (&Partition, &Summary),
    counted: &Transitions,
    step: f64,
    place: &str,
    rows: &str,
) -> Option<Figure> {
    let followed = |region: &usize| counted.counts.get(*region).is_some_and(|row| row.iter().any(|&count| count > 0));
    let all: Vec<usize> = summary.by_size().into_iter().filter(followed).collect();
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
        format!("Transitions between the regions of {}", partition.specification),
        caption,
        Chart::Matrix(matrix),
    ))
}
