//! Sums of every channel from one pass over the rows, and the faults that they show: dead, stuck, saturated, coarse, gross errors.

use std::ops::Range;

use fleetfoot_data::setting::{HAMPEL, JOIN, PREPARE, WHERE};
use fleetfoot_data::{Block, ColumnKind, Halo, Progress, Source};
use fleetfoot_dataset::Error;
use fleetfoot_stats::{Grid, reduce};
use serde::Serialize;

use crate::{
    Channel, Part,
    finding::{Fault, Finding},
    sample::Sample,
};

/// Rows of a chunk.
const CHUNK_ROWS: usize = 65_536;
/// Distance from both neighbours, in usual steps, from which on a value is a gross error, while the neighbours are near
/// to each other. Errors of a smaller share of the rows are ignored.
const FAR: f64 = 20.0;
const NEIGHBOURS: f64 = 0.3;
const GROSS: f64 = 2e-3;
/// A standstill of so many rows and so many seconds, of a channel that changes in this share of its rows, is one.
const STILL_ROWS: u64 = 50;
const STILL_SECONDS: f64 = 0.5;
const LIVELY: f64 = 0.9;
/// Share of rows at the end of the range, in runs of three and more.
const AT_END: f64 = 0.02;
/// Standard deviations in a step of values.
const COARSE: f64 = 0.05;
/// Share of values that may be missing.
const MISSING: f64 = 0.01;

/// A channel and how it moves.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct ChannelSummary {
    /// Its name.
    pub name: String,
    /// Its unit, where it is known.
    pub unit: Option<String>,
    /// Least and greatest value.
    pub range: [f64; 2],
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
    /// Share of the rows without a value.
    pub missing: f64,
    /// Share of the rows in which the value is another than in the row above.
    pub moves: f64,
}

/// Sums of a channel, in the order of its rows.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    rows: u64,
    missing: u64,
    mean: f64,
    squares: f64,
    least: f64,
    most: f64,
    /// Rows at the least and at the greatest value, in runs of three and more.
    at_least: u64,
    at_most: u64,
    /// Rows in which the value changes.
    changes: u64,
    /// The smallest change between two rows.
    step: f64,
    /// The longest run of one value.
    longest: u64,
    gross: u64,
    /// The run at the end of the sums: its value and rows.
    run: (f64, u64),
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            rows: 0,
            missing: 0,
            mean: 0.0,
            squares: 0.0,
            least: f64::INFINITY,
            most: f64::NEG_INFINITY,
            at_least: 0,
            at_most: 0,
            changes: 0,
            step: f64::INFINITY,
            longest: 0,
            gross: 0,
            run: (f64::NAN, 0),
        }
    }
}

impl Sums {
    /// Adds the rows of a tile; `all` has the neighbours, `core` is the range of the rows.
    fn add(&mut self, all: &[f64], core: Range<usize>, usual_step: f64) {
        for at in core {
            let value = all[at];
            if !value.is_finite() {
                self.missing += 1;
                self.end_run();
                continue;
            }
            self.rows += 1;
            let delta = value - self.mean;
            self.mean += delta / self.rows as f64;
            self.squares += delta * (value - self.mean);
            if value < self.least {
                (self.least, self.at_least) = (value, 0);
            }
            if value > self.most {
                (self.most, self.at_most) = (value, 0);
            }
            let before = at.checked_sub(1).map_or(f64::NAN, |at| all[at]);
            let after = all.get(at + 1).copied().unwrap_or(f64::NAN);
            let [back, ahead] = [value - before, value - after];
            if back != 0.0 && back.is_finite() {
                self.changes += 1;
                self.step = self.step.min(back.abs());
            }
            let limit = FAR * usual_step;
            let least = back.abs().min(ahead.abs());
            if limit > 0.0 && back * ahead > 0.0 && least > limit && (before - after).abs() < NEIGHBOURS * least {
                self.gross += 1;
            }
            if value == self.run.0 {
                self.run.1 += 1;
            } else {
                self.end_run();
                self.run = (value, 1);
            }
        }
    }

    /// Counts the run that ends.
    fn end_run(&mut self) {
        let (value, rows) = self.run;
        self.longest = self.longest.max(rows);
        if rows >= 3 && value == self.least {
            self.at_least += rows;
        }
        if rows >= 3 && value == self.most {
            self.at_most += rows;
        }
        self.run = (f64::NAN, 0);
    }

    /// Merges the sums behind.
    fn merge(&mut self, mut other: Self) {
        other.end_run();
        let rows = (self.rows + other.rows).max(1) as f64;
        let delta = other.mean - self.mean;
        self.squares += other.squares + delta * delta * self.rows as f64 * other.rows as f64 / rows;
        self.mean += delta * other.rows as f64 / rows;
        let end = |ours: f64, count: u64, other: f64, others: u64| match ours.total_cmp(&other) {
            std::cmp::Ordering::Equal => count + others,
            std::cmp::Ordering::Less => count,
            std::cmp::Ordering::Greater => others,
        };
        self.at_least = end(self.least, self.at_least, other.least, other.at_least);
        self.at_most = end(-self.most, self.at_most, -other.most, other.at_most);
        (self.least, self.most) = (self.least.min(other.least), self.most.max(other.most));
        self.rows += other.rows;
        self.missing += other.missing;
        self.changes += other.changes;
        self.step = self.step.min(other.step);
        self.longest = self.longest.max(other.longest);
        self.gross += other.gross;
    }

    pub(crate) fn deviation(&self) -> f64 {
        if self.rows == 0 { f64::NAN } else { (self.squares / self.rows as f64).sqrt() }
    }

    fn moves(&self) -> f64 {
        self.changes as f64 / self.rows.max(1) as f64
    }

    /// Returns true if the channel has one value in all rows.
    pub(crate) fn is_dead(&self) -> bool {
        self.rows > 0 && self.least == self.most
    }
}

/// Sums of all channels.
pub(crate) struct Channels {
    sums: Vec<Sums>,
    /// Rows that were read.
    rows: u64,
}

impl Channels {
    /// Reads the rows once.
    pub(crate) fn read(
        view: &dyn Source,
        channels: &[Channel],
        sample: &Sample,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        progress.stage("channels");
        let steps: Vec<f64> = (0..channels.len()).map(|at| sample.usual_step(at)).collect();
        let chunks = Grid { chunk_rows: CHUNK_ROWS }.chunks(view.episodes());
        let mut sums = vec![Sums::default(); channels.len()];
        let halo = Halo { before: 1, after: 1 };
        reduce(
            view,
            &chunks,
            halo,
            progress,
            || vec![Sums::default(); channels.len()],
            |part_sums: &mut Vec<Sums>, _, block: &Block, rows| -> Result<(), Error> {
                let core = block.before + rows.start..block.before + rows.end;
                for ((sum, channel), step) in part_sums.iter_mut().zip(channels).zip(&steps) {
                    sum.add(block.column(channel.place), core.clone(), *step);
                }
                Ok(())
            },
            |_, part_sums| -> Result<(), Error> {
                sums.iter_mut().zip(part_sums).for_each(|(sum, other)| sum.merge(other));
                Ok(())
            },
        )?;
        Ok(Self { sums, rows: view.rows() as u64 })
    }

    pub(crate) fn of(&self, channel: usize) -> &Sums {
        &self.sums[channel]
    }

    pub(crate) fn summaries(&self, channels: &[Channel]) -> Vec<ChannelSummary> {
        let of = |(channel, sums): (&Channel, &Sums)| ChannelSummary {
            name: channel.column.name.clone(),
            unit: channel.column.unit.clone(),
            range: [sums.least, sums.most],
            mean: sums.mean,
            deviation: sums.deviation(),
            missing: sums.missing as f64 / self.rows.max(1) as f64,
            moves: sums.moves(),
        };
        channels.iter().zip(&self.sums).map(of).collect()
    }

    pub(crate) fn findings(&self, channels: &[Channel], step: f64) -> Vec<Finding> {
        let mut findings: Vec<Finding> =
            channels.iter().zip(&self.sums).flat_map(|(channel, sums)| self.of_channel(channel, sums, step)).collect();
        let states = || channels.iter().zip(&self.sums).filter(|(channel, _)| channel.part != Part::Input);
        if states().count() > 0 && states().all(|(_, sums)| sums.rows == 0 || sums.is_dead()) {
            findings.retain(|finding| finding.fault != Fault::Dead);
            findings.push(Finding::new(
                Fault::AtRest,
                "all states",
                (0.0, "nothing moves in these logs".into()),
                "record the robot in motion: rows at rest identify no model",
            ));
        }
        findings
    }

    fn of_channel(&self, channel: &Channel, sums: &Sums, step: f64) -> Vec<Finding> {
        let name = channel.column.name.as_str();
        let mut findings = Vec::new();
        let mut push = |fault, value: (f64, String), mend: &dyn std::fmt::Display| {
            findings.push(Finding::new(fault, name, value, mend.to_string()))
        };
        if let ColumnKind::Category(names) = &channel.column.kind {
            let number = |text: &String| text.trim().replace(',', ".").parse::<f64>().is_ok();
            let numbers = names.iter().filter(|text| number(text)).count();
            if numbers * 2 > names.len() {
                let share = numbers as f64 / names.len() as f64;
                let first = names.iter().find(|text| !number(text)).or(names.first()).map_or("", String::as_str);
                push(
                    Fault::Text,
                    (
                        share,
                        format!("it is text, though {numbers} of its {} values are numbers: `{first}`", names.len()),
                    ),
                    &"write decimal points, and leave cells empty that have no value",
                );
            }
            return findings;
        }
        let missing = sums.missing as f64 / self.rows.max(1) as f64;
        if missing > MISSING {
            push(
                Fault::Missing,
                (missing, format!("{:.1} % of its rows have no value", 100.0 * missing)),
                &format_args!(
                    "{PREPARE} fills short gaps; {JOIN} in the recipe sets how long the samples of a topic hold"
                ),
            );
        }
        if sums.rows == 0 {
            return findings;
        }
        if sums.is_dead() {
            push(
                Fault::Dead,
                (sums.least, format!("it is {} in every row", sums.least)),
                &"leave it out of states and inputs, or move it when you record",
            );
            return findings;
        }
        if !channel.is_measured() {
            return findings;
        }
        let rows = sums.rows as f64;
        let gross = sums.gross as f64 / rows;
        if gross > GROSS {
            push(
                Fault::GrossErrors,
                (
                    gross,
                    format!(
                        "{:.2} % of its values differ from both neighbours by {FAR} usual steps or more",
                        100.0 * gross
                    ),
                ),
                &format_args!("{prepare_command} takes them out", prepare_command = PREPARE.with(HAMPEL.to(5))),
            );
        }
        let still = sums.longest as f64 * step;
        let is_lively = sums.moves() + sums.longest as f64 / rows > LIVELY;
        if is_lively && sums.longest >= STILL_ROWS && (step <= 0.0 || still >= STILL_SECONDS) {
            push(
                Fault::Stuck,
                (
                    sums.longest as f64,
                    format!("it is constant for {} rows, but changes in nearly all others", sums.longest),
                ),
                &format_args!("leave these rows out ({WHERE})"),
            );
        }
        let few_levels = (sums.most - sums.least) / sums.step < 3.5;
        let at_end = sums.at_least.max(sums.at_most) as f64 / rows;
        if channel.part != Part::Input && !few_levels && at_end > AT_END && sums.moves() > 0.5 {
            let end = if sums.at_least > sums.at_most { sums.least } else { sums.most };
            push(
                Fault::Saturated,
                (at_end, format!("{:.1} % of its rows are at {end}, the end of its range", 100.0 * at_end)),
                &format_args!("leave these rows out ({WHERE}); a sensor with a wider range measures them"),
            );
        }
        let coarse = sums.step / sums.deviation();
        if channel.part != Part::Input && !few_levels && coarse > COARSE && sums.moves() < 0.5 {
            push(
                Fault::Quantised,
                (
                    coarse,
                    format!(
                        "its steps of {:.3e} are {coarse:.2} standard deviations, and most rows repeat the value above",
                        sums.step
                    ),
                ),
                &format_args!("{PREPARE} smooths it; derivatives of it are steps"),
            );
        }
        findings
    }
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::Column;
    use proptest::prelude::*;

    use super::*;

    fn summed(values: &[f64], cuts: &[usize]) -> Sums {
        let mut sum = Sums::default();
        let mut from = 0;
        for &to in cuts.iter().chain([&values.len()]) {
            let mut part = Sums::default();
            part.add(values, from..to, 0.01);
            sum.merge(part);
            from = to;
        }
        sum
    }

    proptest! {
        /// Counts and moments do not depend on where chunks end; runs are those of a chunk.
        #[test]
        fn chunks_do_not_matter(values in proptest::collection::vec(-9i8..9, 2..60), cut in 1usize..59) {
            let values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let cut = cut.min(values.len() - 1);
            let (whole, parts) = (summed(&values, &[]), summed(&values, &[cut]));
            prop_assert_eq!((whole.rows, whole.changes, whole.gross), (parts.rows, parts.changes, parts.gross));
            prop_assert_eq!((whole.least, whole.most, whole.step), (parts.least, parts.most, parts.step));
            prop_assert!((whole.mean - parts.mean).abs() < 1e-12 && (whole.squares - parts.squares).abs() < 1e-9);
            prop_assert!(parts.longest <= whole.longest && 2 * parts.longest >= whole.longest);
        }
    }

    #[test]
    fn channel_faults_are_named() {
        let channel = |name: &str| Channel { column: Column::float(name), place: 0, part: Part::State, angle: false };
        let wave = |row: usize| (0.013 * row as f64).sin() + 0.3 * (0.171 * row as f64).sin();
        let faults = |of: &dyn Fn(usize) -> f64| -> Vec<Fault> {
            let values: Vec<f64> = (0..5000).map(of).collect();
            let mut sums = Sums::default();
            let mut step: Vec<f64> = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
            step.sort_by(f64::total_cmp);
            sums.add(&values, 0..values.len(), step[step.len() * 4 / 5]);
            let mut whole = Sums::default();
            whole.merge(sums);
            let channels = Channels { sums: vec![whole], rows: 5000 };
            channels.of_channel(&channel("x"), channels.of(0), 0.01).iter().map(|finding| finding.fault).collect()
        };
        assert_eq!(faults(&wave), []);
        assert_eq!(faults(&|_| 3.5), [Fault::Dead]);
        assert_eq!(faults(&|row| if (1000..1200).contains(&row) { 0.25 } else { wave(row) }), [Fault::Stuck]);
        assert_eq!(faults(&|row| if row % 97 == 5 { 40.0 } else { wave(row) }), [Fault::GrossErrors]);
        assert_eq!(faults(&|row| wave(row).min(0.6)), [Fault::Saturated]);
        assert_eq!(faults(&|row| (wave(row) * 5.0).round() / 5.0), [Fault::Quantised]);
        assert_eq!(faults(&|row| if row % 9 == 0 { f64::NAN } else { wave(row) }), [Fault::Missing]);
    }
}
