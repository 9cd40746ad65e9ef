//! Rows of a table made anew at an even rate, as those of topics are.

use std::{path::Path, sync::Arc};

use fleetfoot_data::{ColumnKind, Progress, parallel_fold};

use crate::{
    Error, JoinKind, Selection, TopicClock,
    cycles::{Cycle, Cycles},
    join::{Base, JoinColumn, Samples, Series, SeriesBuilder, check_rate, join},
    opened::Opened,
    store::{Budget, SEGMENT, StoreBuilder, StoredTable},
    table::{MISSING, Table, TableColumn},
};

/// The table with `hz` rows a second. Between two rows numbers are joined linearly and all else is held, if [`crate::JoinSpec::columns`] asks for nothing else.
///
/// # Errors
/// A table without a clock, a rate out of range, and rows that cannot be read.
pub(crate) fn at_rate(
    path: &Path,
    opened: Opened,
    hz: f64,
    selection: &Selection,
    budget: &Arc<Budget>,
    progress: &dyn Progress,
) -> Result<Opened, Error> {
    let table = opened.table.as_ref();
    let joins: Vec<JoinColumn> = (0..table.columns().len()).map(|at| joined(table.columns(), at, selection)).collect();
    let series = [series(path, &opened, &[], budget, progress)?];
    let [single] = &series;
    check_rate(path, hz, std::iter::once((&*single.name, single.rate())))?;
    let mut rows = StoreBuilder::new(path, joins.len(), budget.clone());
    join(&series, &joins, Base::Rate(hz), progress, |stamps, columns| rows.push_columns(stamps, columns))?;
    let columns = table.columns().iter().zip(&joins).map(|(column, join)| joined_column(column, join)).collect();
    let mut notes = opened.notes;
    notes.push(format!("its rows are resampled to {hz} a second, the requested rate"));
    notes.extend(single.counts.left_out("rows"));
    let table: Box<dyn Table> = Box::new(StoredTable { store: rows.finish()?, columns, has_time: true });
    Ok(Opened { table, notes, cycle: Cycle::Never, sessions: Vec::new(), ..opened })
}

/// The rows of a table in the order of their stamps, as other clocks correct these.
pub(crate) fn series(
    source: &Path,
    opened: &Opened,
    clocks: &[TopicClock],
    budget: &Arc<Budget>,
    progress: &dyn Progress,
) -> Result<Series, Error> {
    let table = opened.table.as_ref();
    let mut builder = SeriesBuilder::of_table(source, table.columns().len(), budget.clone());
    let pieces = table.pieces().into_iter();
    let pieces: Vec<_> = pieces
        .flat_map(|piece| piece.clone().step_by(SEGMENT).map(move |from| from..(from + SEGMENT).min(piece.end)))
        .collect();
    let mut cycles = Cycles::new(opened.cycle);
    parallel_fold(
        pieces.len(),
        progress,
        |at| table.values(pieces[at].clone(), 0),
        |rows| {
            let mut stamps = cycles.pass(rows.time);
            if !clocks.is_empty() {
                let corrected = |&stamp: &i64| match stamp {
                    MISSING => MISSING,
                    stamp => clocks.iter().fold(stamp, |stamp, clock| clock.corrected(stamp)),
                };
                stamps = stamps.iter().map(corrected).collect::<Vec<_>>().into();
            }
            let row = |at: usize| rows.columns.iter().map(move |column| column[at]);
            let values: Vec<f64> = (0..stamps.len()).flat_map(row).collect();
            builder.extend(&Samples { stamps: &stamps, log_times: &stamps, values: &values, width: rows.columns.len() })
        },
    )?;
    builder.finish()
}

/// A column as it is after its join: between samples there are no whole numbers.
pub(crate) fn joined_column(column: &TableColumn, join: &JoinColumn) -> TableColumn {
    let mut column = column.clone();
    if join.kind != JoinKind::Hold {
        column.column.kind = ColumnKind::Float;
    }
    column
}

/// Join of a column of the first series.
pub(crate) fn joined(columns: &[TableColumn], at: usize, selection: &Selection) -> JoinColumn {
    let column = &columns[at].column;
    let rule = selection.join.columns.get(&column.name).copied().unwrap_or_default();
    let kind = match (&column.kind, rule.kind) {
        // Between two texts there is none, whatever is asked.
        (ColumnKind::Category(_), _) => JoinKind::Hold,
        (_, Some(kind)) => kind,
        (ColumnKind::Float, None) => JoinKind::Linear,
        (_, None) => JoinKind::Hold,
    };
    let quaternion = (kind == JoinKind::Slerp).then(|| components(columns, &column.name)).flatten();
    JoinColumn {
        series: 0,
        column: at,
        kind: if quaternion.is_none() && kind == JoinKind::Slerp { JoinKind::Linear } else { kind },
        gap: rule.max_gap,
        quaternion,
        component: quaternion
            .and_then(|all| all.iter().position(|&component_place| component_place == at))
            .unwrap_or(0),
    }
}

/// The columns x, y, z and w of the quaternion that a column is one of, by their names.
fn components(columns: &[TableColumn], name: &str) -> Option<[usize; 4]> {
    let stem = name.strip_suffix(['x', 'y', 'z', 'w'])?;
    let mut places = [0; 4];
    for (place, letter) in places.iter_mut().zip(["x", "y", "z", "w"]) {
        let is_component = |column: &TableColumn| column.column.name.strip_prefix(stem) == Some(letter);
        *place = columns.iter().position(is_component)?;
    }
    Some(places)
}
