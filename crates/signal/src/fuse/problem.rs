//! The whole problem: all tracks and the constants that they share, Gauss and Newton's steps with Levenberg's damping, and covariances.

use fleetfoot_data::{Cancelled, Silent, checkpoint, parallel_map};
use nalgebra::SMatrix;

use super::{
    FuseOptions, ImuRecord, Prior,
    chain::{BORDER_AT, Chain, Eliminated, Joint, NARROW, RIGHT, Row, Undetermined, WIDTH, product, solve_border},
    factors::Block,
    noise::{SINGLE, Share, Shares, Sought},
    rotation::{Vector, log, right_jacobian_inverse, rotation},
    start::{slack, sum},
    state::{BORDER, Border, BorderError, STATE, State, StateError, part},
    track::{Setting, Track},
};
use crate::SignalError;

/// Steps of Gauss and Newton, at most, before the nodes are moved.
pub(super) const STEPS: usize = 3;

/// A step whose every number is less than this changes nothing: rad, m, m/s, rad/s, m/s^2, s.
const SMALL: f64 = 1e-9;

/// The damping that follows a step that did not go down.
const FIRST_DAMPING: f64 = 1e-6;

/// The problem and where it is at present.
pub(super) struct Problem<'a> {
    pub(super) tracks: Vec<Track<'a>>,
    pub(super) border: Border,
    pub(super) setting: Setting,
    pub(super) options: FuseOptions,
    /// Elimination of the last step, if that step changed nothing and nothing changed since: the solution's covariances
    /// are computed from it.
    pub(super) at_rest: Option<Whole>,
    /// Noise estimates from the readings alone.
    pub(super) readings: Readings,
}

/// Deviations of single readings of rate and force, an axis, with those of their estimates.
pub(super) type Readings = [[Option<Prior<f64>>; 3]; 2];

/// A step of all unknowns.
pub(super) struct Step<T> {
    /// Result for each state's error, track by track.
    pub(super) states: Vec<Vec<T>>,
    pub(super) border: BorderError,
    /// Elimination that the step was computed from.
    whole: Whole,
    /// The greatest number of all errors.
    size: f64,
}

/// Outcome of Gauss and Newton's steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Descent {
    pub(super) steps: usize,
    pub(super) converged: bool,
}

/// A visitor of nodes, from the last to the first, with their covariances.
pub(super) type Visit<'v> = dyn FnMut(usize, &StateError, Option<&Joint>) + 'v;

impl<'a> Problem<'a> {
    /// Runs `work` on every track, in any order, and hands back what it gives in theirs.
    pub(super) fn each<T: Send>(
        &self,
        work: impl Fn(usize) -> Result<T, Undetermined> + Sync,
    ) -> Result<Vec<T>, Undetermined> {
        parallel_map(self.tracks.len(), &Silent, |at| work(at).map_err(Stopped::from)).map_err(|_| {
            // Tracks that were not begun, as a stop was set, are no answer: the whole work ends here.
            checkpoint();
            Undetermined
        })
    }

    /// Returns true if every track has an accelerometer.
    pub(super) fn has_forces(&self) -> bool {
        self.tracks.iter().all(|track| track.imu.has_forces())
    }

    /// For each constant: true if its value is given.
    pub(super) fn given(&self) -> [bool; BORDER] {
        let FuseOptions { lever, mounting, offset, gravity, .. } = &self.options;
        let of = |at: usize| match at {
            part::LEVER..part::MOUNTING => lever.deviation,
            part::MOUNTING..part::OFFSET => mounting.deviation,
            part::OFFSET => offset.deviation,
            _ => gravity.deviation,
        };
        std::array::from_fn(|at| of(at) == 0.0)
    }

    /// The rows whose first node is this one; given constants have no slopes.
    pub(super) fn push(&self, track: &Track<'_>, node: usize, rows: &mut Vec<Row>) {
        let before = rows.len();
        track.push(node, &self.border, &self.setting, rows);
        let given = self.given();
        for at in (0..BORDER).filter(|&at| given[at]) {
            for row in &mut rows[before..] {
                row[BORDER_AT + at] = 0.0;
            }
        }
    }

    /// Priors of the constants, as rows; a given constant does not move.
    pub(super) fn border_rows(&self, border: &Border) -> Vec<Row> {
        let FuseOptions { lever, mounting, offset, gravity, .. } = &self.options;
        let mut rows = Vec::new();
        let mut row = |slopes: &[(usize, f64)], left: f64, deviation: f64| {
            if deviation.is_finite() {
                let mut row = [0.0; WIDTH];
                let scale = if deviation > 0.0 { deviation.recip() } else { 1.0 };
                for &(at, slope) in slopes {
                    row[BORDER_AT + at] = slope * scale;
                }
                row[RIGHT] = if deviation > 0.0 { left * scale } else { 0.0 };
                rows.push(row);
            }
        };
        for axis in 0..3 {
            row(&[(part::LEVER + axis, 1.0)], lever.value[axis] - border.lever[axis], lever.deviation);
        }
        let turned = log(&(rotation(&mounting.value).inverse() * border.mounting));
        let slope = if mounting.deviation > 0.0 { right_jacobian_inverse(&turned) } else { SMatrix::identity() };
        for axis in 0..3 {
            let slopes = [0, 1, 2].map(|column| (part::MOUNTING + column, slope[(axis, column)]));
            row(&slopes, -turned[axis], mounting.deviation);
        }
        row(&[(part::OFFSET, 1.0)], offset.value - self.setting.anchor - border.late, offset.deviation);
        let size = border.gravity.norm_squared();
        let tilt = border.gravity_slope().transpose() * (Vector::from(gravity.value) - border.gravity) / size;
        for axis in 0..2 {
            row(&[(part::GRAVITY + axis, 1.0)], tilt[axis], gravity.deviation);
        }
        rows
    }

    /// Objective of these states and constants.
    pub(super) fn cost(&self, states: &[Vec<State>], border: &Border) -> Result<f64, Undetermined> {
        let tracks = self.each(|at| Ok(self.tracks[at].cost(&states[at], border, &self.setting)))?;
        Ok(tracks.iter().sum::<f64>() + self.known_cost(border))
    }

    fn known_cost(&self, border: &Border) -> f64 {
        self.border_rows(border).iter().map(|row| row[RIGHT] * row[RIGHT]).sum()
    }

    /// Eliminates all states, track by track, and solves for the constants.
    fn eliminated(&self, damping: f64) -> Result<(Vec<Eliminated>, BorderError, Covariance), Undetermined> {
        let eliminated = self.each(|at| self.chain(&self.tracks[at], damping, |chain| chain.eliminated()))?;
        let of_tracks = eliminated.iter().flat_map(|track| track.border.iter().copied());
        let rows = self.border_rows(&self.border).into_iter().chain(of_tracks).collect();
        let squares = eliminated.iter().fold(BorderError::zeros(), |sum, track| sum + track.squares);
        let (border, covariance) = solve_border(rows, &squares, damping)?;
        Ok((eliminated, border, covariance))
    }

    fn chain<T>(&self, track: &Track<'_>, damping: f64, work: impl FnOnce(&Chain<'_>) -> T) -> T {
        let rows = |node: usize, rows: &mut Vec<Row>| self.push(track, node, rows);
        work(&Chain { damping, ..self.undamped(track, &rows) })
    }

    /// Works on the chain of a track with other rows than its own, of the same columns.
    pub(super) fn chain_of<T>(
        &self,
        track: &Track<'_>,
        rows: &(dyn Fn(usize, &mut Vec<Row>) + Sync),
        work: impl FnOnce(&Chain<'_>) -> T,
    ) -> T {
        work(&self.undamped(track, rows))
    }

    fn undamped<'c>(&self, track: &Track<'_>, rows: &'c (dyn Fn(usize, &mut Vec<Row>) + Sync)) -> Chain<'c> {
        let width = if self.given() == [true; BORDER] { NARROW } else { WIDTH };
        Chain { nodes: track.nodes(), rows, damping: 0.0, width, keeps_all: !track.sums.is_empty() }
    }

    /// The step to the least of the linearised problem, and what `of` makes of every node's error.
    fn stepped<T: Copy + Send + Sync>(
        &self,
        damping: f64,
        none: T,
        of: impl Fn(&State, &StateError) -> T + Sync,
    ) -> Result<Step<T>, Undetermined> {
        let (eliminated, border, covariance) = self.eliminated(damping)?;
        let back = |at: usize| {
            let track = &self.tracks[at];
            let (mut states, mut size) = (vec![none; track.nodes()], 0.0_f64);
            let mut visit = |node: usize, error: &StateError, _: Option<&Joint>| {
                states[node] = of(&track.states[node], error);
                size = size.max(error.amax());
            };
            self.chain(track, damping, |chain| chain.back(&eliminated[at], &border, None, &mut visit))?;
            Ok((states, size))
        };
        let (states, sizes): (Vec<_>, Vec<f64>) = self.each(back)?.into_iter().unzip();
        let size = sizes.into_iter().fold(border.amax(), f64::max);
        Ok(Step { states, border, whole: Whole { tracks: eliminated, covariance }, size })
    }

    /// The errors of all states and of the constants.
    #[cfg(test)]
    pub(super) fn step(&self, damping: f64) -> Result<Step<StateError>, Undetermined> {
        self.stepped(damping, StateError::zeros(), |_, error| *error)
    }

    /// Objective of the tracks' present states.
    pub(super) fn cost_now(&self) -> Result<f64, Undetermined> {
        let tracks = self.each(|at| Ok(self.tracks[at].cost(&self.tracks[at].states, &self.border, &self.setting)))?;
        Ok(tracks.iter().sum::<f64>() + self.known_cost(&self.border))
    }

    /// Goes down until steps change nothing, by so many at most.
    pub(super) fn descend(&mut self, most: usize) -> Result<Descent, SignalError> {
        let (mut cost, mut damping) = (self.cost_now()?, 0.0);
        if !cost.is_finite() {
            return Err(SignalError::NotFused {
                problem: "squares of the residuals overflow: leave out impossibly large readings and poses",
            });
        }
        self.at_rest = None;
        for steps in 1..=most {
            let step = self.stepped(damping, State::default(), State::moved)?;
            let border = self.border.moved(&step.border);
            let (new_cost, is_small) = (self.cost(&step.states, &border)?, step.size < SMALL);
            let gained = (cost - new_cost) / cost.max(f64::MIN_POSITIVE);
            let undamped = damping == 0.0;
            if new_cost <= cost {
                (cost, self.border) = (new_cost, border);
                for (track, states) in self.tracks.iter_mut().zip(step.states) {
                    track.states = states;
                }
                damping = if damping > FIRST_DAMPING { 0.1 * damping } else { 0.0 };
            } else if gained < -1e-9 || !new_cost.is_finite() {
                damping = (10.0 * damping).max(FIRST_DAMPING);
                continue;
            }
            // The rounding of the cost cannot tell two such states apart.
            if is_small || gained.abs() < 1e-12 {
                self.at_rest = Some(step.whole).filter(|_| undamped);
                return Ok(Descent { steps, converged: true });
            }
        }
        Ok(Descent { steps: most, converged: false })
    }

    /// Visits the nodes of a track with their covariances.
    pub(super) fn visit(&self, at: usize, eliminated: &Whole, visit: &mut Visit<'_>) -> Result<(), Undetermined> {
        let covariance = Some(&eliminated.covariance);
        let back = |chain: &Chain<'_>| chain.back(&eliminated.tracks[at], &BorderError::zeros(), covariance, visit);
        self.chain(&self.tracks[at], 0.0, back)
    }

    /// All states eliminated at the solution: by the last step, where that changed nothing.
    pub(super) fn whole(&mut self) -> Result<Whole, Undetermined> {
        if let Some(whole) = self.at_rest.take() {
            return Ok(whole);
        }
        let (tracks, _, covariance) = self.eliminated(0.0)?;
        Ok(Whole { tracks, covariance })
    }

    /// Noise estimates from residuals, track by track.
    pub(super) fn shares(&self, whole: &Whole) -> Result<Vec<Shares>, Undetermined> {
        let of_track = |at: usize| {
            let track = &self.tracks[at];
            let (mut shares, mut next): (_, Option<Joint>) = (Shares::default(), None);
            let mut visit = |node: usize, _: &StateError, joint: Option<&Joint>| {
                let Some(joint) = joint else { return };
                self.add_shares(track, node, joint, next.as_ref(), &whole.covariance, &mut shares);
                next = Some(joint.clone());
            };
            self.visit(at, whole, &mut visit)?;
            Ok(shares)
        };
        self.each(of_track)
    }

    /// Results of `of` for every node of a track and the covariances of its error.
    pub(super) fn spread<T: Send>(
        &self,
        whole: &Whole,
        of: impl Fn(usize, usize, &Joint) -> T + Sync,
    ) -> Result<Vec<Vec<T>>, Undetermined> {
        let of_track = |at: usize| {
            let mut spread = Vec::with_capacity(self.tracks[at].nodes());
            let mut visit = |node: usize, _: &StateError, joint: Option<&Joint>| {
                let Some(joint) = joint else { return };
                spread.push(of(at, node, joint));
            };
            self.visit(at, whole, &mut visit)?;
            spread.reverse();
            Ok(spread)
        };
        self.each(of_track)
    }

    /// Results of `of` for every filtered state and its covariances, given the constants and the measurements up to it.
    /// They start at the first node whose state is determined, which is returned with them.
    pub(super) fn filtered<T: Send>(
        &self,
        whole: &Whole,
        of: impl Fn(usize, usize, &State, &Joint) -> T + Sync,
    ) -> Result<Vec<(usize, Vec<T>)>, Undetermined> {
        let of_track = |at: usize| {
            let track = &self.tracks[at];
            let (mut first, mut states) = (track.nodes(), Vec::with_capacity(track.nodes()));
            let mut visit = |node: usize, error: &StateError, joint: &Joint| {
                first = first.min(node);
                states.push(of(at, node, &track.states[node].moved(error), joint));
            };
            self.chain(track, 0.0, |chain| chain.filtered(&whole.covariance, &mut visit))?;
            Ok((first, states))
        };
        self.each(of_track)
    }

    fn add_shares(
        &self,
        track: &Track<'_>,
        node: usize,
        joint: &Joint,
        next: Option<&Joint>,
        theta: &Covariance,
        shares: &mut Shares,
    ) {
        let given = self.given();
        let blocks = track.pose(node, &track.states[node], &self.border, &self.setting);
        for (at, block) in blocks.into_iter().enumerate().filter(|(at, _)| track.used[node][*at]) {
            let square = block.residual.norm_squared();
            let (_, weight) = self.setting.loss.of(square, 3.0);
            let taken = taken(&block, &given, joint, None, theta);
            shares.pose[at].add(&Share { squares: weight * square, count: 3.0, taken: weight * taken.sum() });
        }
        let Some(next) = next else { return };
        let between = track.between(node, &self.setting);
        let block = track.inertial(&between, node, &self.border, &self.setting);
        let taken = taken(&block, &given, joint, Some(next), theta);
        // The first three rows are of the turn, and see the gyroscope's noise alone; those of the motion are of the accelerometer's, or, without one, of the jerk. What is missed between readings has the part of
        // a residual's variance that it makes.
        let has_forces = track.imu.has_forces();
        for axis in 0..3 {
            let square = |row: usize| block.residual[row].powi(2);
            let mut split = |which: usize, row: usize, part: f64| {
                shares.inertial[which][axis].residual(part, square(row), taken[row]);
            };
            split(0, axis, between.missed_part(0, axis));
            let part = if has_forces { between.missed_part(1, axis) } else { 0.0 };
            split(1, 3 + axis, part);
            split(1, 6 + axis, part);
            if !has_forces {
                split(1, 12 + axis, 0.0);
            }
            for (which, row) in [9 + axis, 12 + axis].into_iter().enumerate().take(if has_forces { 2 } else { 1 }) {
                shares.walk[which].add(&Share { squares: square(row), count: 1.0, taken: taken[row] });
            }
        }
    }

    /// Takes the noise for what residuals say it is; see [`Shares::take`].
    pub(super) fn take_noise(&mut self, tracks: &[Shares], changes: &mut [f64; SINGLE]) -> f64 {
        let mut shares = Shares::default();
        tracks.iter().for_each(|track| shares.add(track));
        let FuseOptions { fit_walks: walks, noise: expected, .. } = &self.options;
        let sought = Sought {
            has_forces: self.has_forces(),
            walks: *walks,
            expected: expected.imu,
            densities: [0, 1].map(|which| self.prior_density(which)),
        };
        let change = shares.take(&mut self.setting.noise, &sought, changes);
        self.sum();
        change
    }

    /// The densities that the noise of single readings of rate (0) or force (1) has along the axes, where the readings tell it.
    fn prior_density(&self, which: usize) -> [Option<f64>; 3] {
        let seconds = |imu: &ImuRecord<'_>| imu.times[imu.times.len() - 1] - imu.times[0];
        let (all, rows) = self
            .tracks
            .iter()
            .fold((0.0, 0), |(all, rows), track| (all + seconds(&track.imu), rows + track.imu.times.len() - 1));
        self.readings[which].map(|prior| prior.map(|prior| prior.value * (all / rows as f64).sqrt()))
    }

    /// Returns true if the lateness of the poses is within the margin that was kept at the ends of the readings.
    pub(super) fn is_within_slack(&self) -> bool {
        let offset = &self.options.offset;
        (self.setting.anchor + self.border.late - offset.value).abs() <= slack(offset)
    }

    /// Moves the nodes to where the poses are now thought to have been, so that they are late no more; not beyond where there are readings.
    pub(super) fn move_nodes(&mut self) {
        let offset = &self.options.offset;
        let [least, most] = [-slack(offset), slack(offset)].map(|slack| offset.value + slack - self.setting.anchor);
        let late = self.border.late.max(least).min(most);
        for track in &mut self.tracks {
            track.shift(late, &self.border, &self.setting);
        }
        self.setting.anchor += late;
        self.border.late -= late;
        self.sum();
    }

    /// Sums the readings between nodes anew, after nodes or noise changed.
    pub(super) fn sum(&mut self) {
        self.at_rest = None;
        sum(&mut self.tracks, &self.setting);
    }
}

/// Covariance of the constants.
pub(super) type Covariance = SMatrix<f64, BORDER, BORDER>;

/// All states eliminated, and the covariance of the constants.
pub(super) struct Whole {
    tracks: Vec<Eliminated>,
    pub(super) covariance: Covariance,
}

/// A track that is undetermined, or was not begun.
struct Stopped;

impl From<Undetermined> for Stopped {
    fn from(_: Undetermined) -> Self {
        Self
    }
}

impl From<Cancelled> for Stopped {
    fn from(_: Cancelled) -> Self {
        Self
    }
}

/// The variance of what the unknowns explain of every residual of a block.
fn taken<const N: usize>(
    block: &Block<N>,
    given: &[bool; BORDER],
    joint: &Joint,
    next: Option<&Joint>,
    theta: &Covariance,
) -> nalgebra::SVector<f64, N> {
    let mut border = block.border;
    for at in (0..BORDER).filter(|&at| given[at]) {
        border.column_mut(at).fill(0.0);
    }
    // Of A B' with these factors only the diagonal is asked for.
    let diagonal = |a: SMatrix<f64, N, STATE>, b: &SMatrix<f64, N, STATE>| a.component_mul(b).column_sum();
    let (by_node, by_border) = (product(&block.node, &joint.node), product(&block.node, &joint.with_border));
    let mut taken = diagonal(by_node, &block.node);
    taken += (product(&border, theta) + by_border * 2.0).component_mul(&border).column_sum();
    if let Some(next) = next {
        let crossed = product(&block.node, &joint.with_next) * 2.0 + product(&block.next, &next.node);
        taken += diagonal(crossed, &block.next);
        taken += (product(&block.next, &next.with_border) * 2.0).component_mul(&border).column_sum();
    }
    taken
}
