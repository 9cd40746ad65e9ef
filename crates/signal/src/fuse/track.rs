//! One uninterrupted stretch of poses with readings of the inertial sensor: a chain of nodes, one a pose.

use super::{
    BodyNoise, ImuRecord, PoseRecord,
    chain::{KEPT, RIGHT, Row, WIDTH},
    factors::{Block, Pose, inertial, inertial_cost, pose, pose_left, turn_until_seen},
    preintegration::Preintegrated,
    rotation::{Rotation, Vector, exp, rotation},
    state::{Border, State, part},
};
use crate::Loss;
use fleetfoot_data::checkpoint;
use std::borrow::Cow;

/// Prior of a bias at the start: its value, and its deviation; infinite without prior knowledge.
#[derive(Debug, Clone, Copy)]
pub(super) struct BiasPrior {
    pub(super) value: Vector,
    pub(super) deviation: f64,
}

/// A stretch, its poses, and where its states are at present.
pub(super) struct Track<'a> {
    pub(super) imu: ImuRecord<'a>,
    /// The run that it is of, and the first of its poses there.
    pub(super) run: usize,
    pub(super) first: usize,
    /// Stamps of the poses by their own clock.
    pub(super) stamps: &'a [f64],
    /// The run's poses.
    pub(super) poses: PoseRecord<'a>,
    /// For each pose: true if its position counts, and true if its attitude counts.
    pub(super) used: Vec<[bool; 2]>,
    pub(super) states: Vec<State>,
    /// The biases with which readings are summed.
    pub(super) reference: [Vector; 2],
    /// Preintegrated motion between nodes, if kept: valid until the nodes, the noise or these biases change.
    pub(super) sums: Vec<Preintegrated>,
}

/// Settings that all tracks share, besides the constants that are estimated.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setting {
    pub(super) noise: BodyNoise,
    pub(super) loss: Loss,
    pub(super) biases: [BiasPrior; 2],
    /// Offset to add to the stamps of the poses for the instants of the nodes, s.
    pub(super) anchor: f64,
}

impl Track<'_> {
    pub(super) fn nodes(&self) -> usize {
        self.stamps.len()
    }

    /// Measured pose of a node.
    pub(super) fn measured(&self, node: usize) -> Pose {
        let row = self.first + node;
        Pose { position: self.poses.positions[row].into(), attitude: rotation(&self.poses.attitudes[row]) }
    }

    /// The instant of a node by the clock of the inertial sensor.
    pub(super) fn time(&self, node: usize, setting: &Setting) -> f64 {
        self.stamps[node] + setting.anchor
    }

    /// Measured motion between a node and the next.
    pub(super) fn between(&self, node: usize, setting: &Setting) -> Cow<'_, Preintegrated> {
        match self.sums.get(node) {
            Some(sum) => Cow::Borrowed(sum),
            None => Cow::Owned(self.summed(node, setting)),
        }
    }

    /// The readings between a node and the next, summed.
    pub(super) fn summed(&self, node: usize, setting: &Setting) -> Preintegrated {
        let (from, to) = (self.time(node, setting), self.time(node + 1, setting));
        Preintegrated::new(&self.imu, from, to, &self.reference, &setting.noise.imu)
    }

    /// The residuals between a node and the next, of what was measured between them.
    pub(super) fn inertial(
        &self,
        between: &Preintegrated,
        node: usize,
        border: &Border,
        setting: &Setting,
    ) -> Block<15> {
        let states = [&self.states[node], &self.states[node + 1]];
        inertial(between, &self.reference, states, border, &setting.noise, self.imu.has_forces())
    }

    /// The residuals of the pose of a node, position and attitude.
    pub(super) fn pose(&self, node: usize, state: &State, border: &Border, setting: &Setting) -> [Block<3>; 2] {
        let reading = self.imu.at(self.time(node, setting));
        pose(&self.measured(node), state, border, &reading, &setting.noise)
    }

    /// Residual of the pose of a node, position and attitude.
    fn pose_left(&self, node: usize, state: &State, border: &Border, setting: &Setting) -> [Vector; 2] {
        let turn = match border.late == 0.0 {
            true => Rotation::identity(),
            false => turn_until_seen(state, border, &self.imu.at(self.time(node, setting))),
        };
        pose_left(&self.measured(node), state, border, &turn, &setting.noise)
    }

    /// Pushes the rows whose first node is `node`.
    pub(super) fn push(&self, node: usize, border: &Border, setting: &Setting, rows: &mut Vec<Row>) {
        if node == 0 {
            self.push_biases(setting, rows);
        }
        let mut blocks = self.pose(node, &self.states[node], border, setting);
        for (block, _) in blocks.iter_mut().zip(self.used[node]).filter(|(_, used)| *used) {
            block.weigh(setting.loss);
            block.push(rows);
        }
        if node + 1 < self.nodes() {
            self.inertial(&self.between(node, setting), node, border, setting).push(rows);
        }
    }

    fn push_biases(&self, setting: &Setting, rows: &mut Vec<Row>) {
        for (at, prior) in [part::GYRO, part::ACCELEROMETER].into_iter().zip(&setting.biases) {
            let bias = if at == part::GYRO { self.states[0].gyro } else { self.states[0].accelerometer };
            for axis in (0..3).filter(|_| prior.deviation.is_finite()) {
                let mut row = [0.0; WIDTH];
                row[at + axis] = prior.deviation.recip();
                row[RIGHT] = (prior.value[axis] - bias[axis]) / prior.deviation;
                rows.push(row);
            }
        }
    }

    /// The sum of what all residuals cost in these states.
    pub(super) fn cost(&self, states: &[State], border: &Border, setting: &Setting) -> f64 {
        let prior = |prior: &BiasPrior, bias: &Vector| match prior.deviation.is_finite() {
            true => (bias - prior.value).norm_squared() / (prior.deviation * prior.deviation),
            false => 0.0,
        };
        let [gyro, accelerometer] = &setting.biases;
        let mut sum = prior(gyro, &states[0].gyro) + prior(accelerometer, &states[0].accelerometer);
        for node in 0..self.nodes() {
            if node.is_multiple_of(KEPT) {
                checkpoint();
            }
            let left = self.pose_left(node, &states[node], border, setting);
            let used = left.iter().zip(self.used[node]).filter(|(_, used)| *used);
            sum += used.map(|(left, _)| setting.loss.of(left.norm_squared(), 3.0).0).sum::<f64>();
            if node + 1 < self.nodes() {
                let pair = [&states[node], &states[node + 1]];
                let between = self.between(node, setting);
                let has_forces = self.imu.has_forces();
                sum += inertial_cost(&between, &self.reference, pair, &border.gravity, &setting.noise, has_forces);
            }
        }
        sum
    }

    /// Moves every node later by so many seconds, along its motion, and sums readings with the biases of now from here on.
    pub(super) fn shift(&mut self, late: f64, border: &Border, setting: &Setting) {
        for node in 0..self.nodes() {
            let reading = self.imu.at(self.time(node, setting) + 0.5 * late);
            let state = &mut self.states[node];
            let force = match self.imu.has_forces() {
                true => state.attitude * (reading.force - state.accelerometer) + border.gravity,
                false => state.accelerometer,
            };
            state.position += state.velocity * late + force * (0.5 * late * late);
            state.velocity += force * late;
            state.attitude *= exp(&((reading.rate - state.gyro) * late));
        }
        let mean = |of: fn(&State) -> Vector| {
            self.states.iter().map(of).fold(Vector::zeros(), |sum, vector| sum + vector) / self.nodes() as f64
        };
        self.reference = [mean(|state| state.gyro), mean(|state| state.accelerometer)];
    }

    /// Chooses what counts: residuals of no more than `gate` deviations. Whether the choice changed.
    pub(super) fn choose(&mut self, gate: f64, border: &Border, setting: &Setting) -> bool {
        let mut changed = false;
        for node in 0..self.nodes() {
            let inside = self.pose_left(node, &self.states[node], border, setting).map(|left| left.norm() <= gate);
            changed |= inside != self.used[node];
            self.used[node] = inside;
        }
        changed
    }

    /// Returns true if the measurements in use determine position, velocity and attitude of the track.
    pub(super) fn is_determined(&self) -> bool {
        let counted = |which: usize| self.used.iter().filter(|used| used[which]).count();
        counted(0) >= 2 && counted(1) >= 1
    }
}
