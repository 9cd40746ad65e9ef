//! What is fitted to few rows: a fall, a collision or a gross error may hold most of what least squares look at.

use fleetfoot_data::EpisodeId;
use fleetfoot_data::setting::{PREPARE, WHERE};
use fleetfoot_stats::Concentration;

/// What to say of targets whose variance few rows hold, by their labels and the names of episodes.
pub(crate) fn notes(
    targets: &[(String, Option<Concentration>)],
    name: impl Fn(EpisodeId) -> Option<String>,
) -> Vec<String> {
    let note = |(target, found): &(String, Option<Concentration>)| {
        let Concentration { rows, squares, place: (episode, stretch) } = found.as_ref()?;
        Some(format!(
            "{target}: {:.2} % of the rows hold {:.0} % of its variance (the heaviest: from row {} of {} on); least squares fit these. If it was a fall, a collision or a gross error, leave \
             them out ({WHERE}, {PREPARE})",
            100.0 * rows,
            100.0 * squares,
            stretch.start + 1,
            name(*episode)?
        ))
    };
    targets.iter().filter_map(note).collect()
}
