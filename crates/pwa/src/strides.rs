//! Regions of the rows along a phase, and transitions from stride to stride, counted over the rows in their order.

use std::collections::BTreeMap;

use fleetfoot_model::{Passage, Phases};

use crate::phase::{Phase, Scale};

/// A row of an episode, its region and its phase.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) row: usize,
    pub(crate) region: u32,
    pub(crate) phase: f64,
}

/// Rows without a gap. Turns are counted from its first row on. A stride begins at each new maximum of the turns
/// (minimum, of a phase that falls), so that a phase which trembles about its wrap begins one.
#[derive(Debug, Clone)]
struct Run {
    episode: usize,
    first: Step,
    last: Step,
    turns: i64,
    /// Row and region of the first row of turn 1, 2, ...; of -1, -2, ...
    begun: [Vec<(usize, u32)>; 2],
}

/// Counts along a phase; parts of an episode are merged in their order.
#[derive(Debug, Clone)]
pub(crate) struct Strides {
    regions: usize,
    /// Bins x regions.
    rows: Vec<u64>,
    /// By bin, region and region one sample later.
    passages: BTreeMap<[u32; 3], u64>,
    /// From region to region, and the rows between, of a phase that rises and of one that falls.
    counts: [Vec<u64>; 2],
    lengths: [u64; 2],
    /// Those that are open to other parts, the last one or all of them.
    runs: Vec<Run>,
}

impl Run {
    fn new(episode: usize, step: Step) -> Self {
        Self { episode, first: step, last: step, turns: 0, begun: [Vec::new(), Vec::new()] }
    }

    /// Returns true if a row is the next one.
    fn goes_on(&self, episode: usize, step: Step) -> bool {
        self.episode == episode && self.last.row + 1 == step.row
    }

    /// Adds the rows that follow.
    fn join(&mut self, next: Self, scale: &Scale) {
        let before = self.turns + scale.turn(self.last.phase, next.first.phase);
        for (side, sign) in [(0, 1), (1, -1)] {
            let begun = &mut self.begun[side];
            if sign * before > begun.len() as i64 {
                begun.push((next.first.row, next.first.region));
            }
            let ahead = begun.len() as i64 - sign * before;
            let new = usize::try_from(ahead).unwrap_or(0);
            begun.extend(next.begun[side].iter().skip(new));
        }
        (self.turns, self.last) = (before + next.turns, next.last);
    }
}

impl Strides {
    pub(crate) fn new(scale: &Scale, regions: usize) -> Self {
        let square = || vec![0; regions * regions];
        Self {
            regions,
            rows: vec![0; scale.count() * regions],
            passages: BTreeMap::new(),
            counts: [square(), square()],
            lengths: [0; 2],
            runs: Vec::new(),
        }
    }

    /// Appends rows of an episode, in their order.
    pub(crate) fn extend(&mut self, scale: &Scale, episode: usize, steps: impl Iterator<Item = Step>) {
        let regions = self.regions;
        for step in steps.filter(|step| (step.region as usize) < regions) {
            self.rows[scale.bin(step.phase) * regions + step.region as usize] += 1;
            self.append(Run::new(episode, step), scale);
        }
    }

    /// Puts a run behind the others.
    fn append(&mut self, run: Run, scale: &Scale) {
        match self.runs.last_mut() {
            Some(last) if last.goes_on(run.episode, run.first) => {
                let bin = scale.bin(last.last.phase) as u32;
                *self.passages.entry([bin, last.last.region, run.first.region]).or_insert(0) += 1;
                last.join(run, scale);
            }
            _ => self.runs.push(run),
        }
    }

    /// Adds the rows that follow.
    pub(crate) fn merge(&mut self, next: &Self, scale: &Scale) {
        self.rows.iter_mut().zip(&next.rows).for_each(|(all, rows)| *all += rows);
        for (passage, rows) in &next.passages {
            *self.passages.entry(*passage).or_insert(0) += rows;
        }
        for (all, counts) in self.counts.iter_mut().zip(&next.counts) {
            all.iter_mut().zip(counts).for_each(|(all, count)| *all += count);
        }
        self.lengths.iter_mut().zip(next.lengths).for_each(|(all, length)| *all += length);
        for run in &next.runs {
            self.append(run.clone(), scale);
        }
        // Earlier runs cannot continue in later rows.
        let closed = self.runs.len().saturating_sub(1);
        for run in self.runs.drain(..closed).collect::<Vec<Run>>() {
            self.close(&run);
        }
    }

    /// Counts the strides of a run to which nothing is added any more.
    fn close(&mut self, run: &Run) {
        for (side, begun) in run.begun.iter().enumerate() {
            for pair in begun.windows(2) {
                let [(row, from), (next, to)] = [pair[0], pair[1]];
                self.counts[side][from as usize * self.regions + to as usize] += 1;
                self.lengths[side] += (next - row) as u64;
            }
        }
    }

    /// All that was counted.
    pub(crate) fn phases(mut self, phase: &Phase, scale: &Scale) -> Phases {
        for run in std::mem::take(&mut self.runs) {
            self.close(&run);
        }
        let strides = |side: usize| self.counts[side].iter().sum::<u64>();
        let side = usize::from(strides(1) > strides(0));
        let square = |values: &[u64]| values.chunks(self.regions.max(1)).map(<[u64]>::to_vec).collect();
        let passage = |(&[bin, from, to], &rows): (&[u32; 3], &u64)| Passage { bin, from, to, rows };
        Phases {
            specification: phase.specification.clone(),
            bins: scale.bins(),
            rows: square(&self.rows),
            passages: self.passages.iter().map(passage).collect(),
            strides: square(&self.counts[side]),
            stride_rows: self.lengths[side],
            falling: side == 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fleetfoot_library::Expr;
    use proptest::prelude::*;

    use crate::PhaseKind;

    const SCALE: Scale = Scale::Cyclic { period: 1.0, bins: 4 };

    fn phase() -> Phase {
        let kind = PhaseKind::Cyclic { bins: 4, period: Some(1.0) };
        Phase { specification: "q:4".into(), column: Expr::column("q"), kind }
    }

    fn walked(steps: &[Step]) -> Strides {
        let mut strides = Strides::new(&SCALE, 3);
        strides.extend(&SCALE, 0, steps.iter().copied());
        strides
    }

    fn steps(regions: &[u32], phases: &[f64]) -> Vec<Step> {
        let step = |(row, (&region, &phase)): (usize, (&u32, &f64))| Step { row, region, phase };
        regions.iter().zip(phases).enumerate().map(step).collect()
    }

    #[test]
    fn a_stride_begins_where_the_phase_wraps() {
        // Three wraps, at rows 3, 6 and 9, in regions 1, 2 and 1.
        let phases: Vec<f64> = (0..12).map(|row| f64::from(row % 3) / 3.0 + 0.1).collect();
        let counted = walked(&steps(&[0, 0, 0, 1, 0, 0, 2, 2, 0, 1, 0, 0], &phases)).phases(&phase(), &SCALE);
        assert_eq!(counted.strides, [[0, 0, 0], [0, 0, 1], [0, 1, 0]]);
        assert_eq!((counted.stride_rows, counted.falling), (6, false));
        assert_eq!(counted.rows.iter().flatten().sum::<u64>(), 12);
        assert_eq!(counted.rows[0], [1, 2, 1]);
        assert_eq!(counted.passages.iter().map(|passage| passage.rows).sum::<u64>(), 11);
        assert!(counted.passages.contains(&Passage { bin: 3, from: 0, to: 1, rows: 2 }), "{counted:?}");
        // The other way round it falls: strides begin where the phase comes to its end, at rows 3, 6 and 9 again.
        let back: Vec<f64> = phases.iter().rev().copied().collect();
        let phases = walked(&steps(&[0, 0, 0, 1, 0, 0, 2, 2, 0, 1, 0, 0], &back)).phases(&phase(), &SCALE);
        assert_eq!((phases.strides, phases.falling), (vec![vec![0, 0, 0], vec![0, 0, 1], vec![0, 1, 0]], true));
    }

    #[test]
    fn noise_of_the_phase_begins_no_additional_stride() {
        let phases = [0.8, 0.95, 0.02, 0.97, 0.99, 0.03, 0.98, 0.04, 0.5, 0.9, 0.1];
        let phases = walked(&steps(&[0, 0, 1, 2, 2, 2, 2, 2, 0, 0, 0], &phases)).phases(&phase(), &SCALE);
        assert_eq!(phases.strides, [[0, 0, 0], [1, 0, 0], [0, 0, 0]], "from row 2 to row 10");
        assert_eq!(phases.stride_rows, 8);
    }

    proptest! {
        #[test]
        fn parts_count_as_the_whole(
            rows in prop::collection::vec((0u32..3, -0.45..0.45f64, prop::bool::weighted(0.08)), 1..80), cuts in prop::collection::vec(0usize..80, 0..5)
        ) {
            // Rows are missing now and then; the phase goes either way.
            let (mut row, mut at) = (0, 0.3);
            let steps: Vec<Step> = rows.into_iter().map(|(region, rise, gap)| {
                (row, at) = (row + 1 + usize::from(gap), at + rise);
                Step { row, region, phase: at }
            }).collect();
            let whole = walked(&steps).phases(&phase(), &SCALE);
            let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(steps.len())).collect();
            cuts.extend([0, steps.len()]);
            cuts.sort_unstable();
            let mut total = Strides::new(&SCALE, 3);
            for cut in cuts.windows(2) {
                total.merge(&walked(&steps[cut[0]..cut[1]]), &SCALE);
            }
            prop_assert_eq!(&total.clone().phases(&phase(), &SCALE), &whole);
            // The same, told plainly: turns of the unwound phase that were never reached before, run by run.
            let mut counts = [vec![vec![0u64; 3]; 3], vec![vec![0u64; 3]; 3]];
            for run in steps.chunk_by(|a, b| a.row + 1 == b.row) {
                for side in [0, 1] {
                    let turn = |step: &Step| if side == 0 { step.phase.floor() } else { -step.phase.floor() };
                    let (mut most, mut last) = (turn(&run[0]), None);
                    for step in run {
                        if turn(step) > most {
                            most = turn(step);
                            if let Some(from) = last.replace(step.region) { counts[side][from as usize][step.region as usize] += 1; }
                        }
                    }
                }
            }
            let side = usize::from(counts[1].iter().flatten().sum::<u64>() > counts[0].iter().flatten().sum::<u64>());
            prop_assert_eq!(&whole.strides, &counts[side]);
            // Another episode begins anew.
            let mut other = Strides::new(&SCALE, 3);
            other.extend(&SCALE, 5, [Step { row: row + 1, region: 0, phase: at + 0.4 }].into_iter());
            total.merge(&other, &SCALE);
            prop_assert_eq!(total.phases(&phase(), &SCALE).strides, whole.strides);
        }
    }
}
