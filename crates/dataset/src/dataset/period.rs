//! The period of rows.

use fleetfoot_data::Episode;

/// The sampling period of most rows of some episodes, seconds; 0 for none.
pub(crate) fn of_most<'a>(episodes: impl IntoIterator<Item = &'a Episode>) -> f64 {
    let mut periods: Vec<(f64, usize)> =
        episodes.into_iter().filter(|e| e.rows > 1).map(|episode| (episode.period, episode.rows)).collect();
    periods.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = periods.iter().map(|(_, rows)| rows).sum::<usize>() / 2;
    let mut seen = 0;
    let of_most = periods.into_iter().find(|(_, rows)| {
        seen += rows;
        seen > half
    });
    of_most.map_or(0.0, |(period, _)| period)
}
