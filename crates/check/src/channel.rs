//! Sums of every channel from one pass over the rows, and the faults that they show: dead, stuck, saturated, coarse, gross errors.

use fleetfoot_data::setting::{HAMPEL, JOIN, PREPARE, WHERE};
use fleetfoot_data::{Block, ColumnKind, Halo, Progress, Source};
use fleetfoot_dataset::Error;
use fleetfoot_stats::{Grid, reduce};
use serde::Serialize;

use crate::{
    Channel, Part,
    finding::{Fault, Finding},
    sample::Sample,
    sums::{AtEnd, EXTREME, Farthest, Sums, Usual},
};

/// Rows of a chunk.
const CHUNK_ROWS: usize = 65_536;
/// Share of rows from which on values far from both neighbours are gross errors, though none of them is extreme.
const GROSS: f64 = 2e-3;
/// A standstill of so many rows and so many seconds, of a channel that changes in this share of its rows, is one.
const STILL_ROWS: u64 = 50;
const STILL_SECONDS: f64 = 0.5;
const LIVELY: f64 = 0.9;
/// Share of rows at the end of the range, in runs of three and more.
const AT_END: f64 = 0.02;
/// Rows between two ends, at least: a switched input crosses in fewer.
const CROSSING: u64 = 5;
/// Steps that lead to the end of a range, in the smallest steps: a rounded value that settles there comes by one.
const ABRUPT: f64 = 3.0;
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

/// Sums of all channels.
pub(crate) struct Channels {
    sums: Vec<Sums>,
    /// Places of the values that are farthest from both neighbours, in words.
    places: Vec<String>,
    /// Steps of the channels whose values lie on a grid.
    grids: Vec<Option<f64>>,
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
        let usual: Vec<Usual> =
            (0..channels.len()).map(|at| Usual { step: sample.usual_step(at), span: sample.usual_span(at) }).collect();
        let grids = (0..channels.len()).map(|at| sample.grid(at)).collect();
        let chunks = Grid { chunk_rows: CHUNK_ROWS }.chunks(view.episodes());
        let mut sums = vec![Sums::default(); channels.len()];
        let halo = Halo { before: 1, after: 1 };
        reduce(
            view,
            &chunks,
            halo,
            progress,
            || vec![Sums::default(); channels.len()],
            |part_sums: &mut Vec<Sums>, chunk, block: &Block, rows| -> Result<(), Error> {
                let core = block.before + rows.start..block.before + rows.end;
                let first = (chunk.episode, block.first - block.before);
                for ((sum, channel), usual) in part_sums.iter_mut().zip(channels).zip(&usual) {
                    sum.add(block.column(channel.place), core.clone(), *usual, first);
                }
                Ok(())
            },
            |_, part_sums| -> Result<(), Error> {
                sums.iter_mut().zip(part_sums).for_each(|(sum, other)| sum.merge(other));
                Ok(())
            },
        )?;
        let places = sums.iter().map(|sum| sum.farthest.map_or(Ok(String::new()), |farthest| place(view, &farthest)));
        let places = places.collect::<Result<_, Error>>()?;
        Ok(Self { sums, places, grids, rows: view.rows() as u64 })
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
            channels.iter().enumerate().flat_map(|(at, channel)| self.of_channel(channel, at, step)).collect();
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

    fn of_channel(&self, channel: &Channel, at: usize, step: f64) -> Vec<Finding> {
        let sums = &self.sums[at];
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
        if let Some((farthest, count)) = gross_errors(sums) {
            push(
                Fault::GrossErrors,
                (
                    count as f64 / rows,
                    format!(
                        "{count} of its {} values {} far from both neighbours, most of all {} in {}",
                        sums.rows,
                        if count == 1 { "is" } else { "are" },
                        farthest.value,
                        self.places[at]
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
        if let Some((share, ends)) = saturation(sums).filter(|_| channel.part != Part::Input) {
            let place = if ends.len() > 1 { "the ends" } else { "the end" };
            let ends: Vec<String> = ends.iter().map(f64::to_string).collect();
            push(
                Fault::Saturated,
                (
                    share,
                    format!("{:.1} % of its rows are at {}, {place} of its range", 100.0 * share, ends.join(" or ")),
                ),
                &format_args!("leave these rows out ({WHERE}); a sensor with a wider range measures them"),
            );
        }
        let grid = self.grids[at].filter(|grid| !has_few_levels(sums, *grid) && sums.moves() < 0.5);
        if let Some(grid) = grid.filter(|grid| channel.part != Part::Input && grid / sums.deviation() > COARSE) {
            let coarse = grid / sums.deviation();
            push(
                Fault::Quantised,
                (
                    coarse,
                    format!(
                        "its steps of {grid:.3e} are {coarse:.2} standard deviations, and most rows repeat the value above"
                    ),
                ),
                &format_args!("{PREPARE} smooths it; derivatives of it are steps"),
            );
        }
        findings
    }
}

/// Values far from both neighbours: the farthest of them and their number. Few of them are a fault if the farthest is
/// also extreme for the whole channel, of which the sample has seen a part.
fn gross_errors(sums: &Sums) -> Option<(Farthest, u64)> {
    let farthest = sums.farthest?;
    let is_extreme = sums.extreme > 0 && farthest.distance > EXTREME * sums.deviation();
    let is_usual = sums.far as f64 > GROSS * sums.rows as f64;
    (is_extreme || is_usual).then_some((farthest, if is_usual { sums.far } else { sums.extreme }))
}

/// The share of the rows at the ends of the range at which a channel saturates, and these ends.
fn saturation(sums: &Sums) -> Option<(f64, Vec<f64>)> {
    let (rows, changes) = (sums.rows as f64, sums.changes as f64);
    // Zero is also the value of rest: of a speed, a pedal, a force.
    let is_rest = |end: f64| end == 0.0 && sums.moves() < 0.5;
    let is_reached = |(end, at_end): &(f64, AtEnd)| {
        at_end.rows as f64 > AT_END * rows
            && at_end.entries > ABRUPT * sums.step * at_end.visits as f64
            && !is_rest(*end)
    };
    let ends: Vec<(f64, AtEnd)> =
        [(sums.least, sums.at_least), (sums.most, sums.at_most)].into_iter().filter(is_reached).collect();
    let at_ends: u64 = ends.iter().map(|(_, at_end)| at_end.rows).sum();
    let visits: u64 = ends.iter().map(|(_, at_end)| at_end.visits).sum();
    let between = sums.rows - at_ends;
    let is_lively = changes > 0.5 * between as f64 && between >= CROSSING * visits;
    (!ends.is_empty() && is_lively && !has_few_levels(sums, sums.step))
        .then(|| (at_ends as f64 / rows, ends.iter().map(|(end, _)| *end).collect()))
}

/// Returns true if the range has room for three steps of values at most.
fn has_few_levels(sums: &Sums, step: f64) -> bool {
    (sums.most - sums.least) / step < 3.5
}

/// The place of a row: its number, the log, and its time.
fn place(view: &dyn Source, Farthest { episode, row, .. }: &Farthest) -> Result<String, Error> {
    let name = &view.episodes()[*episode].name;
    let block = view.read(*episode, *row..*row + 1, Halo::default())?;
    let seconds = (block.stamps()[0] - block.start) as f64 * 1e-9;
    Ok(format!("row {} of {name}, {seconds:.3} s after its first", row + 1))
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::Column;

    use super::*;
    use crate::sample::Stretch;

    /// Faults of a channel with these values, and their numbers.
    fn faults_of(values: Vec<f64>) -> Vec<(Fault, f64)> {
        let time = (0..values.len()).map(|row| 0.01 * row as f64).collect();
        let sample = Sample { stretches: vec![Stretch { time, columns: vec![values.clone()] }] };
        let usual = Usual { step: sample.usual_step(0), span: sample.usual_span(0) };
        let (mut sums, mut whole) = (Sums::default(), Sums::default());
        sums.add(&values, 0..values.len(), usual, (0, 0));
        whole.merge(sums);
        let rows = values.len() as u64;
        let channels = Channels { sums: vec![whole], places: vec!["a row".into()], grids: vec![sample.grid(0)], rows };
        let channel = Channel { column: Column::float("x"), place: 0, part: Part::Open, angle: false };
        channels.of_channel(&channel, 0, 0.01).iter().map(|finding| (finding.fault, finding.value)).collect()
    }

    fn faults(of: &dyn Fn(usize) -> f64) -> Vec<Fault> {
        faults_of((0..5000).map(of).collect()).iter().map(|(fault, _)| *fault).collect()
    }

    fn wave(row: usize) -> f64 {
        (0.013 * row as f64).sin() + 0.3 * (0.171 * row as f64).sin()
    }

    /// A number in [-1, 1) without order.
    fn random(at: usize) -> f64 {
        (fleetfoot_data::mix(at as u64 + 1) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    #[test]
    fn channel_faults_are_named() {
        assert_eq!(faults(&wave), []);
        assert_eq!(faults(&|_| 3.5), [Fault::Dead]);
        assert_eq!(faults(&|row| if (1000..1200).contains(&row) { 0.25 } else { wave(row) }), [Fault::Stuck]);
        assert_eq!(faults(&|row| if row % 97 == 5 { 40.0 } else { wave(row) }), [Fault::GrossErrors]);
        assert_eq!(faults(&|row| wave(row).min(0.6)), [Fault::Saturated]);
        assert_eq!(faults(&|row| (wave(row) * 5.0).round() / 5.0), [Fault::Quantised]);
        assert_eq!(faults(&|row| if row % 9 == 0 { f64::NAN } else { wave(row) }), [Fault::Missing]);
    }

    #[test]
    fn single_extreme_values_are_found() {
        for spikes in [1, 3] {
            let spike = |row: usize| (row % 700 == 312 && row < 700 * spikes).then_some(30.0);
            let moving = faults_of((0..5000).map(|row| spike(row).unwrap_or_else(|| wave(row))).collect());
            assert_eq!(moving, [(Fault::GrossErrors, spikes as f64 / 5000.0)]);
            // An input that is held for 17 rows has no usual step.
            let held = faults_of((0..5000).map(|row| spike(row).unwrap_or_else(|| random(row / 17))).collect());
            assert_eq!(held, [(Fault::GrossErrors, spikes as f64 / 5000.0)]);
        }
        // Pulses of an event, noise, and single peaks of a switching system are sound.
        assert_eq!(faults(&|row| f64::from(u8::from(row % 400 == 7))), []);
        assert_eq!(faults(&|row| (0..6).map(|at| random(6 * row + at)).sum()), []);
        assert_eq!(faults(&|row| 0.01 * wave(row) + if row % 900 == 7 { 0.05 } else { 0.0 }), []);
    }

    #[test]
    fn strong_saturation_counts_both_ends() {
        for gain in [1.1, 1.5, 3.0, 10.0] {
            let clipped = |row: usize| (gain * (0.01 * row as f64).sin()).clamp(-1.0, 1.0);
            let values: Vec<f64> = (0..5000).map(clipped).collect();
            let at_ends = values.iter().filter(|value| value.abs() == 1.0).count() as f64 / 5000.0;
            assert_eq!(faults_of(values), [(Fault::Saturated, at_ends)], "{gain}");
        }
    }

    #[test]
    fn rests_and_switches_are_not_saturated() {
        let level = |row: usize| if random(row / 40) > 0.0 { 1.0 } else { -1.0 };
        assert_eq!(faults(&level), []);
        // With one row of any value between the levels.
        let between = |row: usize| {
            if row.is_multiple_of(40) && level(row) != level(row.max(1) - 1) { random(row) } else { level(row) }
        };
        assert_eq!(faults(&between), []);
        // A pedal that rests at zero.
        assert_eq!(faults(&|row| (0.01 * row as f64).sin().max(0.0) * f64::from(u8::from(row % 2000 < 800))), []);
        // A rounded position that settles at either target.
        let settled = |row: usize| {
            let (side, since) = (if (row / 500).is_multiple_of(2) { 1.0 } else { -1.0 }, (row % 500) as f64);
            (1e4 * side * (1.0 - 2.0 * (-since / 20.0).exp())).round() / 1e4
        };
        assert_eq!(faults(&settled), []);
    }

    #[test]
    fn held_levels_are_not_coarse() {
        for seed in 0..50 {
            let held = faults_of((0..600).map(|row| random(1000 * seed + row / 17)).collect());
            assert_eq!(held, [], "{seed}");
        }
        // Targets on a grid of 0.5, in any order.
        assert_eq!(faults(&|row| (6.0 * random(row / 100)).round() / 2.0), []);
    }
}
