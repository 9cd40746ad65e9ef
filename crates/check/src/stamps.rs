//! Stamps: backward, repeated, dropped, jittering, in bursts, of two clocks.

use std::{collections::HashMap, path::Path};

use fleetfoot_data::setting::{CLOCKS, DT, MAX_GAP, PREPARE, RATE, STAMP, TIME};
use fleetfoot_data::{Episode, Halo, Progress, Source, parallel_map};
use fleetfoot_dataset::{Dataset, Error};
use fleetfoot_log::{FileInfo, HeaderOffset};

use crate::finding::{Fault, Finding};

/// Stamps that are read at once, and at most an episode: the scatter is the same further on.
const ROWS: usize = 65_536;
const MOST: usize = 1 << 20;
/// Share of the rows that are more than a fifth of a period off, from which on stamps jitter.
const OFF: f64 = 0.02;
const FIFTH: f64 = 0.2;
/// Share of rows that may be dropped.
const DROPPED: f64 = 0.001;
/// Share of rows in bursts, and share of a period that counts as a burst.
const IN_BURSTS: f64 = 0.01;
const BURST: f64 = 0.1;
/// Number of periods below which there is no finding.
const FEW: usize = 8;
/// Seconds that two clocks may run apart: messages come later or sooner by less.
const APART: f64 = 0.05;

/// Findings about the stamps of tables: each is a row's own, so none may repeat or go backward.
pub(crate) fn of_tables(dataset: &Dataset) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut by_file: HashMap<&Path, Vec<&Episode>> = HashMap::new();
    for (at, episode) in dataset.episodes().iter().enumerate() {
        by_file.entry(dataset.origin(at)).or_default().push(episode);
    }
    for (file, clock) in dataset.files() {
        let name = file.display().to_string();
        let backward = by_file.get(file).map_or(0, |episodes| backward(episodes));
        if backward > 0 {
            findings.push(Finding::new(
                Fault::Backward,
                &name,
                (
                    backward as f64,
                    format!("{backward} of its {} stamps are earlier than the stamp of the row above", clock.rows),
                ),
                format!(
                    "each begins an episode; sort the rows, or name another clock ({given_time})",
                    given_time = TIME.to("COLUMN")
                ),
            ));
        }
        if clock.repeated > 0 {
            findings.push(Finding::new(
                Fault::Repeated,
                &name,
                (
                    clock.repeated as f64 / clock.rows.max(1) as f64,
                    format!("{} rows repeat the stamp of the row above, and are left out", clock.repeated),
                ),
                format!("{given_dt} counts rows instead of stamps", given_dt = DT.to("SECONDS")),
            ));
        }
    }
    findings
}

/// Number of episodes of a file that begin before the end of the episode above. A clock that begins anew, where the
/// session above began, is sound.
fn backward(episodes: &[&Episode]) -> usize {
    let mut session = episodes.first().map_or(0, |episode| episode.start);
    let mut count = 0;
    for pair in episodes.windows(2) {
        let [above, below] = [pair[0], pair[1]];
        if below.start >= above.end {
            continue;
        }
        let is_anew = 10 * i128::from(below.start - session).abs() <= i128::from(above.end - session);
        if is_anew {
            session = below.start;
        } else {
            count += 1;
        }
    }
    count
}

/// Findings about the clocks of topics.
pub(crate) fn of_topics(infos: &[FileInfo]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for info in infos {
        for topic in &info.topics {
            let Some(HeaderOffset { first, last, zero, .. }) = topic.header_offset else { continue };
            if zero {
                findings.push(Finding::new(
                    Fault::TwoClocks,
                    &topic.name,
                    (1.0, "its headers have no stamps".into()),
                    format!("{given_stamp} takes the clock of the log", given_stamp = STAMP.to("log")),
                ));
            } else if (first - last).abs() > APART {
                findings.push(Finding::new(
                    Fault::TwoClocks,
                    &topic.name,
                    (
                        first - last,
                        format!("the clock of its headers runs {:.4} s away from the log's", (first - last).abs()),
                    ),
                    format!(
                        "{CLOCKS} in the recipe aligns them; {given_stamp} takes the clock of the log",
                        given_stamp = STAMP.to("log")
                    ),
                ));
            }
        }
    }
    findings
}

/// Counts of periods of all episodes, in shares of the median of their episode.
#[derive(Default)]
struct Periods {
    rows: u64,
    off: u64,
    dropped: u64,
    bursts: u64,
}

/// Findings about the stamps of the rows.
pub(crate) fn of_rows(view: &dyn Source, progress: &dyn Progress) -> Result<Vec<Finding>, Error> {
    progress.stage("stamps");
    let episodes = parallel_map(view.episodes().len(), progress, |at| {
        let rows = view.episodes()[at].rows.min(MOST);
        let mut stamps: Vec<i64> = Vec::with_capacity(rows);
        for from in (0..rows).step_by(ROWS) {
            let block = view.read(at, from..(from + ROWS).min(rows), Halo::default())?;
            stamps.extend_from_slice(block.stamps());
        }
        Ok::<Periods, Error>(Periods::of(&stamps))
    })?;
    let mut sum = Periods::default();
    for episode in episodes {
        sum.rows += episode.rows;
        sum.off += episode.off;
        sum.dropped += episode.dropped;
        sum.bursts += episode.bursts;
    }
    Ok(sum.findings())
}

impl Periods {
    fn of(stamps: &[i64]) -> Self {
        let mut totals = Self::default();
        let mut periods: Vec<i64> = stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
        if periods.len() < FEW {
            return totals;
        }
        let mean = (stamps[stamps.len() - 1] - stamps[0]) as f64 / periods.len() as f64;
        totals.rows = periods.len() as u64;
        totals.bursts = periods.iter().filter(|&&period| (period as f64) < BURST * mean).count() as u64;
        // Of rows in groups the median is that within a group, and tells nothing of what is missing.
        if totals.bursts * 10 > totals.rows {
            return totals;
        }
        let middle = periods.len() / 2;
        let median = (*periods.select_nth_unstable(middle).1 as f64).max(1.0);
        for period in &periods {
            let share = *period as f64 / median;
            // A whole number of periods: rows between are missing.
            let whole = share.round();
            if whole >= 2.0 && (share - whole).abs() < FIFTH {
                totals.dropped += whole as u64 - 1;
            } else if (share - 1.0).abs() > FIFTH {
                totals.off += 1;
            }
        }
        totals
    }

    fn findings(&self) -> Vec<Finding> {
        let rows = self.rows.max(1) as f64;
        let [off, dropped, bursts] = [self.off, self.dropped, self.bursts].map(|count| count as f64 / rows);
        let mut findings = Vec::new();
        let place = "stamps of the rows";
        if bursts > IN_BURSTS {
            findings.push(Finding::new(
                Fault::Bursts,
                place,
                (
                    bursts,
                    format!(
                        "{:.1} % of the rows follow the row above within a tenth of the median period",
                        100.0 * bursts
                    ),
                ),
                format!("{PREPARE} resamples; {given_rate} makes even rows", given_rate = RATE.to("HZ")),
            ));
        }
        if dropped > DROPPED {
            findings.push(Finding::new(
                Fault::Dropped,
                place,
                (dropped, format!("{:.2} % of the rows are missing", 100.0 * dropped)),
                format!(
                    "{PREPARE} resamples; {given_max_gap} ends an episode there",
                    given_max_gap = MAX_GAP.to("SECONDS")
                ),
            ));
        }
        if off > OFF {
            findings.push(Finding::new(
                Fault::Jitter,
                place,
                (off, format!("{:.1} % of the periods are more than a fifth of the median off", 100.0 * off)),
                format!(
                    "{PREPARE} resamples at even stamps; {given_dt} counts rows where stamps are those of arrival",
                    given_dt = DT.to("SECONDS")
                ),
            ));
        }
        findings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(stamps: &[i64]) -> Vec<Fault> {
        Periods::of(stamps).findings().iter().map(|finding| finding.fault).collect()
    }

    #[test]
    fn only_new_sessions_may_go_back() {
        let episode = |&(start, end): &(i64, i64)| Episode {
            id: fleetfoot_data::EpisodeId(0),
            name: String::new(),
            file: None,
            labels: Default::default(),
            rows: 2,
            start,
            end,
            period: 1.0,
            marks: Vec::new(),
        };
        let count = |spans: &[(i64, i64)]| {
            let episodes: Vec<Episode> = spans.iter().map(episode).collect();
            backward(&episodes.iter().collect::<Vec<_>>())
        };
        // Sessions whose clock begins anew, one of them with a gap.
        assert_eq!(count(&[(0, 100), (1, 50), (60, 90), (0, 80)]), 0);
        // Rows that come twice, pieces in the wrong order, and rows in reverse order.
        assert_eq!(count(&[(0, 100), (95, 200)]), 1);
        assert_eq!(count(&[(50, 100), (0, 50)]), 1);
        assert_eq!(count(&[(9, 9), (8, 8), (7, 7), (6, 6)]), 3);
    }

    #[test]
    fn kinds_of_bad_stamps_are_named() {
        let even: Vec<i64> = (0..1000).map(|row| row * 10_000_000).collect();
        assert_eq!(faults(&even), []);
        let dropped: Vec<i64> =
            even.iter().copied().enumerate().filter(|(row, _)| row % 50 != 7).map(|(_, s)| s).collect();
        assert_eq!(faults(&dropped), [Fault::Dropped]);
        let jitter: Vec<i64> =
            even.iter().enumerate().map(|(row, s)| s + [0, 3_000_000, -2_000_000][row % 3]).collect();
        assert_eq!(faults(&jitter), [Fault::Jitter]);
        // Four rows of 40 ms arrive together.
        let bursts: Vec<i64> = (0..1000).map(|row| row / 4 * 40_000_000 + row % 4 * 100_000).collect();
        assert_eq!(faults(&bursts), [Fault::Bursts]);
    }
}
