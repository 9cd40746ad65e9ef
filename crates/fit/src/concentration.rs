//! Notes about targets whose variance a few rows hold: after a fall, a collision or a gross error least squares fit
//! mostly these.

use fleetfoot_data::EpisodeId;
use fleetfoot_data::setting::{PREPARE, WHERE};
use fleetfoot_stats::Concentration;

/// Notes about targets whose variance a few rows hold, with the target's label and the episode's name.
pub(crate) fn notes(
    targets: &[(String, Option<Concentration>)],
    name: impl Fn(EpisodeId) -> Option<String>,
) -> Vec<String> {
    let note = |(target, concentration): &(String, Option<Concentration>)| {
        let Concentration { rows, squares, place: (episode, stretch) } = concentration.as_ref()?;
        Some(format!(
            "{target}: {:.2} % of the rows hold {:.0} % of its variance (the heaviest: from row {} of {} on); least squares mostly fit these rows. If they are a fall, a collision or a gross error, leave them out ({WHERE}, {PREPARE})",
            100.0 * rows,
            100.0 * squares,
            stretch.start + 1,
            name(*episode)?
        ))
    };
    targets.iter().filter_map(note).collect()
}
