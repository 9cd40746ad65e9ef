//! Information that residuals hold about the logarithms of the noise variances.
//!
//! | symbol | here |
//! |---|---|
//! | r, J | residuals in units of their deviations, and their slopes |
//! | R = 1 - J (J'J)^-1 J' | what the unknowns leave of residuals |
//! | w_k | the part of every residual's variance that noise of kind k makes, 0 of what has none |
//!
//! The average of the observed and the expected information of the restricted likelihood is 1/2 (w_k r)' R (w_l r) of
//! kinds k and l (Gilmour, Thompson, Cullis, "Average information REML: an efficient algorithm for variance parameter
//! estimation in linear mixed models", Biometrics 51, 1995). R times a vector is the residual of a step with that
//! vector as the right side. A kind therefore costs as much as a step of Gauss and Newton, and no covariance is formed.

use fleetfoot_data::checkpoint;
use nalgebra::DMatrix;

use super::{
    BodyNoise, ImuNoise,
    chain::{BORDER_AT, Eliminated, NEXT_AT, RIGHT, Row, Undetermined, solve_border},
    problem::Problem,
    state::{BORDER, BorderError, STATE, StateError},
    track::Track,
};

/// Kinds of noise: rates about three axes, what they miss, forces along three axes (the first stands for the jerk where there are none), what they miss, positions, attitudes, the walks of both biases.
const KINDS: usize = 12;
const RATE: usize = 0;
const FORCE: usize = 4;
const MISSED: [usize; 2] = [3, 7];
const POSE: usize = 8;
const WALK: usize = 10;

/// The part of its own information that the other kinds must leave of a kind, below which it is not told apart from them.
const LEFT: f64 = 1e-6;

/// The parts that the kinds of noise make of a residual's variance.
type Parts = [f64; KINDS];

impl Problem<'_> {
    /// The standard deviations of the estimates of the noise, in its own units: 0 of what was given, infinite of what residuals do not tell.
    pub(super) fn noise_deviations(&self) -> Result<BodyNoise, Undetermined> {
        let kinds = self.kinds();
        let information = self.information(&kinds)?;
        let logs = deviations(&information);
        let share = |kind: usize| kinds.iter().position(|index| *index == kind).map_or(0.0, |at| 0.5 * logs[at]);
        let BodyNoise { imu, position, attitude, jerk } = self.setting.noise;
        let deviations =
            self.readings.map(|axes| axes.map(|prior| prior.map_or(f64::INFINITY, |prior| prior.deviation)));
        let axes = |values: [f64; 3], first: usize| std::array::from_fn(|axis| values[axis] * share(first + axis));
        let has_forces = self.has_forces();
        Ok(BodyNoise {
            imu: ImuNoise {
                gyro: axes(imu.gyro, RATE),
                accelerometer: if has_forces { axes(imu.accelerometer, FORCE) } else { [0.0; 3] },
                gyro_walk: imu.gyro_walk * share(WALK),
                accelerometer_walk: imu.accelerometer_walk * share(WALK + 1),
                missed: [0, 1].map(|which| imu.missed[which] * share(MISSED[which])),
                scatter: if self.options.fit_noise { deviations } else { [[0.0; 3]; 2] },
            },
            position: position * share(POSE),
            attitude: attitude * share(POSE + 1),
            jerk: if has_forces { 0.0 } else { jerk * share(FORCE) },
        })
    }

    /// The kinds of noise that are estimated.
    fn kinds(&self) -> Vec<usize> {
        let (options, missed, has_forces) = (&self.options, self.setting.noise.imu.missed, self.has_forces());
        let is_estimated = |kind: usize| match kind {
            3 | 7 => missed[kind / 4] > 0.0,
            FORCE => true,
            5 | 6 => has_forces,
            WALK => options.fit_walks[0],
            11 => options.fit_walks[1] && has_forces,
            _ => true,
        };
        (0..KINDS).filter(|&kind| options.fit_noise && is_estimated(kind)).collect()
    }

    /// The information of these kinds.
    pub(super) fn information(&self, kinds: &[usize]) -> Result<DMatrix<f64>, Undetermined> {
        let mut information = DMatrix::zeros(kinds.len(), kinds.len());
        for (column, kind) in kinds.iter().enumerate() {
            let sums = self.information_of(*kind)?;
            for (row, other) in kinds.iter().enumerate() {
                information[(row, column)] = sums[*other];
            }
        }
        Ok(information)
    }

    /// The information of a kind with all kinds.
    fn information_of(&self, kind: usize) -> Result<Parts, Undetermined> {
        let eliminated = self.each(|at| {
            let track = &self.tracks[at];
            self.chain_of(track, &|node, rows| self.weighted(track, node, kind, rows), |chain| chain.eliminated())
        })?;
        let of_tracks = eliminated.iter().flat_map(|track| track.border.iter().copied());
        let known = self.border_rows(&self.border).into_iter().map(|mut row| {
            row[RIGHT] = 0.0;
            row
        });
        let squares = eliminated.iter().fold(BorderError::zeros(), |sum, track| sum + track.squares);
        let (border, _) = solve_border(known.chain(of_tracks).collect(), &squares, 0.0)?;
        let of_tracks = self.each(|at| self.left_of(at, kind, &eliminated[at], &border))?;
        let mut sums = [0.0; KINDS];
        for track in of_tracks {
            sums.iter_mut().zip(track).for_each(|(sum, part)| *sum += part);
        }
        Ok(sums)
    }

    /// The rows of a node, the residuals times their part of this kind on the right side.
    fn weighted(&self, track: &Track<'_>, node: usize, kind: usize, rows: &mut Vec<Row>) {
        let first = rows.len();
        self.push(track, node, rows);
        for (row, parts) in rows[first..].iter_mut().zip(self.parts(track, node)) {
            row[RIGHT] *= parts[kind];
        }
    }

    /// Product of a track's remaining weighted residuals after the solution with the weighted residuals of all kinds.
    fn left_of(
        &self,
        at: usize,
        kind: usize,
        eliminated: &Eliminated,
        border: &BorderError,
    ) -> Result<Parts, Undetermined> {
        let track = &self.tracks[at];
        let (mut sums, mut next, mut rows) = ([0.0; KINDS], StateError::zeros(), Vec::new());
        let mut visit = |node: usize, error: &StateError, _: Option<&_>| {
            rows.clear();
            self.push(track, node, &mut rows);
            for (row, parts) in rows.iter().zip(self.parts(track, node)) {
                let explained: f64 = (0..STATE).map(|i| row[i] * error[i] + row[NEXT_AT + i] * next[i]).sum::<f64>()
                    + (0..BORDER).map(|i| row[BORDER_AT + i] * border[i]).sum::<f64>();
                let left = 0.5 * row[RIGHT] * (parts[kind] * row[RIGHT] - explained);
                sums.iter_mut().zip(&parts).for_each(|(sum, part)| *sum += part * left);
            }
            next = *error;
        };
        self.chain_of(track, &|node, rows| self.weighted(track, node, kind, rows), |chain| {
            chain.back(eliminated, border, None, &mut visit)
        })?;
        Ok(sums)
    }

    /// The parts that kinds of noise make of the rows of a node, in the order in which [`Track::push`] has them.
    fn parts(&self, track: &Track<'_>, node: usize) -> Vec<Parts> {
        if node.is_multiple_of(super::chain::KEPT) {
            checkpoint();
        }
        let only = |kind: usize| {
            let mut parts = [0.0; KINDS];
            parts[kind] = 1.0;
            parts
        };
        let mut parts = Vec::with_capacity(6 + 6 + 15);
        if node == 0 {
            let known = self.setting.biases.iter().filter(|prior| prior.deviation.is_finite()).count();
            parts.resize(3 * known, [0.0; KINDS]);
        }
        for which in (0..2).filter(|&which| track.used[node][which]) {
            parts.extend([only(POSE + which); 3]);
        }
        if node + 1 < track.nodes() {
            let between = track.between(node, &self.setting);
            let has_forces = track.imu.has_forces();
            let of = |which: usize, axis: usize| {
                let missed = between.missed_part(which, axis);
                let mut parts = [0.0; KINDS];
                parts[if which == 0 { RATE } else { FORCE } + axis] = 1.0 - missed;
                parts[MISSED[which]] = missed;
                parts
            };
            parts.extend((0..3).map(|axis| of(0, axis)));
            let moved = |axis: usize| if has_forces { of(1, axis) } else { only(FORCE) };
            parts.extend((0..6).map(|row| moved(row % 3)));
            parts.extend([only(WALK); 3]);
            parts.extend([only(if has_forces { WALK + 1 } else { FORCE }); 3]);
        }
        parts
    }
}

/// The deviations of logarithms of variances by the information of all of them; infinite where there is none, or the others leave none.
fn deviations(information: &DMatrix<f64>) -> Vec<f64> {
    let count = information.nrows();
    let mut deviations = vec![f64::INFINITY; count];
    let determined: Vec<usize> = (0..count).filter(|&i| information[(i, i)] > 0.0).collect();
    // In units of their own information, each in turn the last of a Cholesky factor: what is left there is what the others leave of it.
    let scaled = |a: usize, b: usize| information[(a, b)] / (information[(a, a)] * information[(b, b)]).sqrt();
    for &last in &determined {
        let order: Vec<usize> = determined.iter().copied().filter(|&i| i != last).chain([last]).collect();
        let scaled = DMatrix::from_fn(order.len(), order.len(), |i, j| {
            0.5 * (scaled(order[i], order[j]) + scaled(order[j], order[i]))
        });
        if let Some(factor) = scaled.cholesky() {
            let left = factor.l_dirty()[(order.len() - 1, order.len() - 1)].powi(2);
            if left > LEFT {
                deviations[last] = (information[(last, last)] * left).sqrt().recip();
            }
        }
    }
    deviations
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The deviations are the roots of the inverse's diagonal, and infinite where nothing is told.
    #[test]
    fn deviations_match_inverse() {
        let information = DMatrix::from_row_slice(3, 3, &[40.0, 10.0, 0.0, 10.0, 5.0, 0.0, 0.0, 0.0, 0.0]);
        let computed = deviations(&information);
        // The inverse of the first two is (5, -10; -10, 40) / 100.
        assert!(
            (computed[0] - 0.05_f64.sqrt()).abs() < 1e-14 && (computed[1] - 0.4_f64.sqrt()).abs() < 1e-14,
            "{computed:?}"
        );
        assert_eq!(computed[2], f64::INFINITY);
        let alike = deviations(&DMatrix::from_element(2, 2, 7.0));
        assert!(alike.iter().all(|deviation| *deviation == f64::INFINITY), "{alike:?}");
    }
}
