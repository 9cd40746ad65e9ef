//! Text of a read plan, for `--dry-run`.

use fleetfoot::ReadPlan;

use crate::table::{bytes, count};

/// Files, episodes and rows, columns, and what must be decoded for them; `skipped` are files that a statistic has already.
pub(super) fn reading(plan: &ReadPlan, skipped: usize) -> String {
    let skipped = match skipped {
        0 => String::new(),
        number => format!(" ({number} more exist already)"),
    };
    let episodes = plan.episodes.map_or("at most ".to_owned(), |episodes| format!("{}, ", count(episodes, "episode")));
    let decoded = match plan.decoded {
        None => String::new(),
        Some((size, true)) => format!("\n{} of decoded columns, in the cache already", bytes(size)),
        Some((size, false)) => format!("\none pass to decode them: {} of columns, less in the cache", bytes(size)),
    };
    format!(
        "{}{skipped}, {episodes}{}\n{} read: {}{decoded}",
        count(plan.files, "file"),
        count(plan.rows, "row"),
        count(plan.columns.len(), "column"),
        plan.columns.join(", ")
    )
}
