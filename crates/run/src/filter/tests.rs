use std::path::PathBuf;

use fleetfoot_control::filter::Track;
use fleetfoot_data::{Silent, with_threads};

use super::*;

/// Recordings of a state that jumps at 0, and of one that it drives. They have gaps in inputs and measurements, and a
/// sensor that is held here and there.
fn recordings(folder: &Path, rows: &[usize]) -> Vec<PathBuf> {
    let write = |(at, &rows): (usize, &usize)| {
        let noise = |row: usize, key: usize| {
            let uniform = |key: usize| fleetfoot_data::mix(key as u64 + 1) as f64 / u64::MAX as f64 - 0.5;
            (0..4).map(|turn| uniform(((at * 100_003 + row) * 8 + key) * 4 + turn)).sum::<f64>()
        };
        let (mut x, mut v, mut seen) = (0.3, 0.0, 0.0);
        let mut text = "t,x,v,u,seen,v_seen\n".to_owned();
        for row in 0..rows {
            let u = (0.02 * row as f64 + at as f64).sin();
            if row % 5 != 3 {
                seen = x + 0.2 * noise(row, 0);
            }
            let cell = |there: bool, value: f64| if there { value.to_string() } else { String::new() };
            text.push_str(&format!(
                "{},{x},{v},{},{},{}\n",
                0.01 * row as f64,
                cell(row % 37 != 9, u),
                cell(row % 11 != 4, seen),
                v + 0.3 * noise(row, 1)
            ));
            let side = f64::from(x > 0.0) * 2.0 - 1.0;
            (x, v) = (
                0.9 * x + 0.05 * side + 0.05 * v + 0.05 * noise(row, 2),
                0.8 * v + 0.3 * u - 0.1 * side + 0.05 * noise(row, 3),
            );
        }
        let path = folder.join(format!("run_{at}.csv"));
        std::fs::write(&path, text).expect("written");
        path
    };
    rows.iter().enumerate().map(write).collect()
}

const RECIPE: &str = "[states]\nx = {}\nv = {}\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n[model]\npredict = \"next\"\n\
     partition = \"kmeans:3\"\n[filter]\nmeasured = \"x=0.1,v\"\nsensors = \"x=seen,v=v_seen\"\ntruth = \"x=x,v=v\"\n";

fn fitted(logs: &[PathBuf]) -> Model {
    let recipe = Recipe::parse(RECIPE, "test").expect("a recipe");
    let fitted = fleetfoot_fit::fit::<fleetfoot_fit::Pwa>(
        &recipe,
        &fleetfoot_fit::FitRequest::default(),
        &logs.to_vec(),
        &Silent,
    );
    fitted.expect("a model").model
}

/// Every reported number, as bits.
fn bits(rows: &FilteredRows) -> Vec<u64> {
    let columns = [rows.means(), rows.deviations(), rows.probabilities(), rows.innovations(), rows.log_likelihood()];
    let more = [rows.innovation_deviations(), &rows.nis, &rows.nees];
    columns.into_iter().chain(more).flatten().map(|value| value.to_bits()).collect()
}

#[test]
fn block_size_changes_neither_bits_nor_memory_of_a_filter() {
    let folder = tempfile::tempdir().expect("a folder");
    let logs = recordings(folder.path(), &[900, 40, 333, 1]);
    let white = fitted(&logs[..1]);
    let mut coloured = white.clone();
    let lags = vec![vec![0.7, 0.1, -0.1, 0.5], vec![0.4, 0.1, -0.1, 0.3]];
    coloured.partitions[0].correlation = Some(fleetfoot_model::ResidualCorrelation { lags });
    assert_ne!(filtered_alike(&white, &logs), filtered_alike(&coloured, &logs));
}

/// Report on some recordings; the same for any number of rows that are filtered at a time.
fn filtered_alike(model: &Model, logs: &[PathBuf]) -> String {
    let changes = Recipe::default();
    let filtered = |at_a_time: usize, threads: usize| {
        let (mut kept, mut most): (Vec<FilteredRows>, usize) = (Vec::new(), 0);
        let filtered = with_threads(threads, || {
            filter_pieces(model, &changes, &Logs::from(logs), at_a_time, &Silent, |_, rows| {
                most = most.max(rows.rows());
                match kept.last_mut().filter(|_| rows.first() > 0) {
                    Some(before) => before.extend(rows),
                    None => kept.push(rows.clone()),
                }
                Ok(())
            })
        });
        let episodes: Vec<(String, Vec<i64>, Vec<u64>)> =
            kept.iter().map(|rows| (rows.episode().to_owned(), rows.stamps().to_vec(), bits(rows))).collect();
        assert!(most <= at_a_time, "{most} rows at a time");
        (filtered.expect("filtered").to_json().to_string(), episodes)
    };
    let whole = filtered(10_000, 1);
    let rows: Vec<usize> = whole.1.iter().map(|(_, stamps, _)| stamps.len()).collect();
    assert_eq!(rows, [900, 40, 333, 1]);
    for (at_a_time, threads) in [(1, 2), (7, 7), (64, 1), (333, 2), (899, 7), (900, 2)] {
        assert_eq!(filtered(at_a_time, threads), whole, "{at_a_time} rows at a time, {threads} threads");
    }
    whole.0
}

#[test]
fn a_filter_stepped_row_by_row_gives_the_same_result() {
    let folder = tempfile::tempdir().expect("a folder");
    let logs = recordings(folder.path(), &[900, 200]);
    let model = fitted(&logs[..1]);
    let text = std::fs::read_to_string(&logs[1]).expect("a log");
    let numbers = |line: &str| line.split(',').map(|cell| cell.parse().unwrap_or(f64::NAN)).collect();
    let cells: Vec<Vec<f64>> = text.lines().skip(1).map(numbers).collect();
    let untold = [f64::NAN; 2];
    let (mut track, mut row): (Option<Track>, usize) = (None, 0);
    let take = |filter: &SwitchedFilter, rows: &FilteredRows| {
        for k in 0..rows.rows() {
            let seen = &cells[row][4..6];
            let track = match &mut track {
                // A discrete model's steps do not hang on the seconds between rows, as long as none is missing.
                Some(track) => {
                    filter.step(track, &[cells[row - 1][3]], model.step, seen, &untold);
                    track
                }
                None => track.insert(filter.start(seen, &untold)),
            };
            assert_eq!(rows.means()[2 * k..][..2], track.estimate().mean[..], "row {row}");
            row += 1;
        }
        Ok(())
    };
    filter_pieces(&model, &Recipe::default(), &Logs::from(&logs[1..].to_vec()), 17, &Silent, take).expect("filtered");
    assert_eq!(row, 200);
}
