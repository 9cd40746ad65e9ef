//! The residuals of the problem and their Jacobians, in units of their standard deviations.
//!
//! | symbol | here |
//! |---|---|
//! | R, p, v, b_g, b_a | the state of a node; R turns body into world |
//! | l, M, tau, g | lever, mounting, how late the poses are, gravity |
//! | r + J d | what is left of a measurement when the error d is added to the states |

use nalgebra::{SMatrix, SVector};

use crate::{Loss, spline::chain::Chain};

use super::{
    BodyNoise,
    chain::{BORDER_AT, NEXT_AT, RIGHT, Row, WIDTH},
    preintegration::{Preintegrated, Reading},
    rotation::{Matrix, Rotation, Vector, exp, log, right_jacobian, right_jacobian_inverse},
    state::{BORDER, Border, STATE, State, part},
};

/// A block of residuals in units of their deviations, with its slopes.
#[derive(Debug, Clone)]
pub(super) struct Block<const N: usize> {
    pub(super) residual: SVector<f64, N>,
    /// With respect to the node, the next node and the constants.
    pub(super) node: SMatrix<f64, N, STATE>,
    pub(super) next: SMatrix<f64, N, STATE>,
    pub(super) border: SMatrix<f64, N, BORDER>,
}

/// Residuals of the inertial sensor: rotation, velocity, position, walk of both biases. Of a gyroscope alone those of the motion are of the chain of position, velocity and acceleration.
pub(super) const INERTIAL: usize = 15;

impl<const N: usize> Block<N> {
    fn zeros() -> Self {
        Self { residual: SVector::zeros(), node: SMatrix::zeros(), next: SMatrix::zeros(), border: SMatrix::zeros() }
    }

    /// Takes the block times a number.
    fn scale(&mut self, scale: f64) {
        self.residual *= scale;
        self.node *= scale;
        self.next *= scale;
        self.border *= scale;
    }

    /// Rows J d = -r of a least-squares problem.
    pub(super) fn push(&self, rows: &mut Vec<Row>) {
        let first = rows.len();
        rows.resize(first + N, [0.0; WIDTH]);
        let rows = &mut rows[first..];
        for (j, (column, next)) in self.node.data.0.iter().zip(&self.next.data.0).enumerate() {
            for i in 0..N {
                rows[i][j] = column[i];
                rows[i][NEXT_AT + j] = next[i];
            }
        }
        for (j, column) in self.border.data.0.iter().enumerate() {
            for i in 0..N {
                rows[i][BORDER_AT + j] = column[i];
            }
        }
        for i in 0..N {
            rows[i][RIGHT] = -self.residual[i];
        }
    }
}

/// Residual of the preintegrated motion between two nodes, not yet in units of deviations (Forster et al., equation
/// 45).
fn inertial_residual(between: &Preintegrated, reference: &[Vector; 2], states: [&State; 2], g: &Vector) -> [Vector; 3] {
    let [from, to] = states;
    let (rotation, velocity, position) =
        between.corrected(&(from.gyro - reference[0]), &(from.accelerometer - reference[1]));
    let (dt, back) = (between.dt, from.attitude.inverse());
    let turned = rotation.inverse() * back * to.attitude;
    let gained = back * (to.velocity - from.velocity - g * dt);
    let moved = back * (to.position - from.position - from.velocity * dt - g * (0.5 * dt * dt));
    [log(&turned), gained - velocity, moved - position]
}

/// The residual between two nodes; `reference` are the biases with which the readings were summed. Without an accelerometer, the place of its bias holds the acceleration in the world.
pub(super) fn inertial(
    between: &Preintegrated,
    reference: &[Vector; 2],
    states: [&State; 2],
    border: &Border,
    noise: &BodyNoise,
    has_forces: bool,
) -> Block<INERTIAL> {
    let mut block = if has_forces {
        moved_by_forces(between, reference, states, border)
    } else {
        turned_alone(between, reference, states)
    };
    walk(&mut block, states, between.dt, noise);
    if !has_forces {
        chain(&mut block, states, between.dt, noise);
    }
    block
}

/// Residuals of a gyroscope alone between two nodes.
fn turned_alone(between: &Preintegrated, reference: &[Vector; 2], states: [&State; 2]) -> Block<INERTIAL> {
    let mut block = Block::<INERTIAL>::zeros();
    let still = Border::default();
    let [turned, ..] = inertial_residual(between, reference, states, &still.gravity);
    block.residual.fixed_rows_mut::<3>(0).copy_from(&turned);
    turn(&mut block, between, reference, states, &turned);
    whiten(&mut block, between, 3);
    block
}

/// The motion of a body of which no force is measured: each axis of the world a chain of integrators whose jerk is white noise, the prior of a quintic spline.
fn chain(block: &mut Block<INERTIAL>, states: [&State; 2], dt: f64, noise: &BodyNoise) {
    use part::{ACCELEROMETER, POSITION, VELOCITY};
    let (rows, columns) = ([6, 3, 12], [POSITION, VELOCITY, ACCELEROMETER]);
    let back = whitening(dt, noise.jerk);
    let left = chain_residual(states, dt);
    // Shares of position, velocity and acceleration that are carried on from each of the first node.
    let forward = [[1.0, dt, 0.5 * dt * dt], [0.0, 1.0, dt], [0.0, 0.0, 1.0]];
    for (row, row_of_back) in rows.into_iter().zip(&back) {
        for axis in 0..3 {
            block.residual[row + axis] = (0..3).map(|k| row_of_back[k] * left[k][axis]).sum();
            for (column, j) in columns.into_iter().zip(0..) {
                block.node[(row + axis, column + axis)] = -(0..3).map(|k| row_of_back[k] * forward[k][j]).sum::<f64>();
                block.next[(row + axis, column + axis)] = row_of_back[j];
            }
        }
    }
}

/// Residuals of position, velocity and acceleration: the second node less the prediction from the first.
fn chain_residual([from, to]: [&State; 2], dt: f64) -> [Vector; 3] {
    [
        to.position - from.position - from.velocity * dt - from.accelerometer * (0.5 * dt * dt),
        to.velocity - from.velocity - from.accelerometer * dt,
        to.accelerometer - from.accelerometer,
    ]
}

/// The inverse of the lower root of the covariance of a chain's increments.
fn whitening(dt: f64, jerk: f64) -> [[f64; 3]; 3] {
    let root = Chain::<3>::new(jerk * jerk).step(dt).root();
    let mut back = [[0.0; 3]; 3];
    for j in 0..3 {
        for i in j..3 {
            let known: f64 = (j..i).map(|k| root[i][k] * back[k][j]).sum();
            back[i][j] = (f64::from(u8::from(i == j)) - known) / root[i][i];
        }
    }
    back
}

/// Residuals of an inertial sensor with an accelerometer between two nodes.
fn moved_by_forces(
    between: &Preintegrated,
    reference: &[Vector; 2],
    states: [&State; 2],
    border: &Border,
) -> Block<INERTIAL> {
    use part::{ACCELEROMETER, ATTITUDE, GRAVITY, GYRO, POSITION, VELOCITY};
    let [from, to] = states;
    let (g, dt) = (&border.gravity, between.dt);
    let [turned, gained, moved] = inertial_residual(between, reference, states, g);
    let back = from.attitude.inverse().to_rotation_matrix().into_inner();
    let mut block = Block::<INERTIAL>::zeros();
    for (row, part) in [(0, turned), (3, gained), (6, moved)] {
        block.residual.fixed_rows_mut::<3>(row).copy_from(&part);
    }
    turn(&mut block, between, reference, states, &turned);
    let mut set_slope = |row: usize, column: usize, slope: Matrix| {
        block.node.fixed_view_mut::<3, 3>(row, column).copy_from(&slope);
    };
    set_slope(3, ATTITUDE, (back * (to.velocity - from.velocity - g * dt)).cross_matrix());
    set_slope(3, VELOCITY, -back);
    set_slope(3, GYRO, -between.velocity_g);
    set_slope(3, ACCELEROMETER, -between.velocity_a);
    let displaced = to.position - from.position - from.velocity * dt - g * (0.5 * dt * dt);
    set_slope(6, ATTITUDE, (back * displaced).cross_matrix());
    set_slope(6, POSITION, -back);
    set_slope(6, VELOCITY, -back * dt);
    set_slope(6, GYRO, -between.position_g);
    set_slope(6, ACCELEROMETER, -between.position_a);
    let mut next = |row: usize, column: usize, slope: Matrix| {
        block.next.fixed_view_mut::<3, 3>(row, column).copy_from(&slope);
    };
    next(3, VELOCITY, back);
    next(6, POSITION, back);
    let tilt = border.gravity_slope();
    block.border.fixed_view_mut::<3, 2>(3, GRAVITY).copy_from(&(back * tilt * -dt));
    block.border.fixed_view_mut::<3, 2>(6, GRAVITY).copy_from(&(back * tilt * (-0.5 * dt * dt)));
    whiten(&mut block, between, 9);
    block
}

/// The slopes of the turn between two nodes.
fn turn(
    block: &mut Block<INERTIAL>,
    between: &Preintegrated,
    reference: &[Vector; 2],
    [from, to]: [&State; 2],
    turned: &Vector,
) {
    let inverse = right_jacobian_inverse(turned);
    let attitude = (to.attitude.inverse() * from.attitude).to_rotation_matrix().into_inner();
    let shift = between.rotation_g * (from.gyro - reference[0]);
    let by_gyro = exp(turned).inverse().to_rotation_matrix() * right_jacobian(&shift) * between.rotation_g;
    block.node.fixed_view_mut::<3, 3>(0, part::ATTITUDE).copy_from(&(-inverse * attitude));
    block.node.fixed_view_mut::<3, 3>(0, part::GYRO).copy_from(&(-inverse * by_gyro));
    block.next.fixed_view_mut::<3, 3>(0, part::ATTITUDE).copy_from(&inverse);
}

/// Divides the first so many rows of the motion by the root of their covariance.
fn whiten(block: &mut Block<INERTIAL>, between: &Preintegrated, rows: usize) {
    let root = &between.root;
    let scales: [f64; 9] = std::array::from_fn(|i| root[(i, i)].recip());
    let forward = |column: &mut [f64; INERTIAL]| {
        if column[..rows].iter().all(|entry| *entry == 0.0) {
            return;
        }
        for i in 0..rows {
            column[i] *= scales[i];
            for k in i + 1..rows {
                column[k] -= root[(k, i)] * column[i];
            }
        }
    };
    block.residual.data.0.iter_mut().for_each(forward);
    block.node.data.0.iter_mut().for_each(forward);
    block.next.data.0.iter_mut().for_each(forward);
    block.border.data.0[part::GRAVITY..].iter_mut().for_each(forward);
}

/// The sum of squares of [`inertial`], without slopes.
pub(super) fn inertial_cost(
    between: &Preintegrated,
    reference: &[Vector; 2],
    states: [&State; 2],
    gravity: &Vector,
    noise: &BodyNoise,
    has_forces: bool,
) -> f64 {
    let root = &between.root;
    let left = inertial_residual(between, reference, states, gravity);
    let mut residual: [f64; 9] = std::array::from_fn(|i| left[i / 3][i % 3]);
    let mut sum = 0.0;
    for i in 0..if has_forces { 9 } else { 3 } {
        let known: f64 = (0..i).map(|k| root[(i, k)] * residual[k]).sum();
        residual[i] = (residual[i] - known) / root[(i, i)];
        sum += residual[i] * residual[i];
    }
    let [from, to] = states;
    let densities = [noise.imu.gyro_walk, noise.imu.accelerometer_walk];
    let walks = [to.gyro - from.gyro, to.accelerometer - from.accelerometer];
    if !has_forces {
        let left = chain_residual(states, between.dt);
        let weighted = |row: &[f64; 3]| (left[0] * row[0] + left[1] * row[1] + left[2] * row[2]).norm_squared();
        let walked = walks[0].norm_squared() / (densities[0] * densities[0] * between.dt);
        return sum + walked + whitening(between.dt, noise.jerk).iter().map(weighted).sum::<f64>();
    }
    sum + walks
        .iter()
        .zip(densities)
        .map(|(step, density)| step.norm_squared() / (density * density * between.dt))
        .sum::<f64>()
}

/// The walk of the biases between two nodes.
fn walk(block: &mut Block<INERTIAL>, [from, to]: [&State; 2], dt: f64, noise: &BodyNoise) {
    let scales = [noise.imu.gyro_walk, noise.imu.accelerometer_walk].map(|density| (density * dt.sqrt()).recip());
    let steps = [to.gyro - from.gyro, to.accelerometer - from.accelerometer];
    for (which, (scale, step)) in scales.into_iter().zip(steps).enumerate() {
        for axis in 0..3 {
            let (row, column) = (9 + 3 * which + axis, part::GYRO + 3 * which + axis);
            block.residual[row] = step[axis] * scale;
            block.node[(row, column)] = -scale;
            block.next[(row, column)] = scale;
        }
    }
}

/// A measured pose of the markers' frame in the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    pub(super) position: Vector,
    pub(super) attitude: Rotation,
}

/// Residual of a pose, position and attitude, in units of their deviations; `turn` is the rotation of the body until
/// the pose is seen.
pub(super) fn pose_left(
    measured: &Pose,
    state: &State,
    border: &Border,
    turn: &Rotation,
    noise: &BodyNoise,
) -> [Vector; 2] {
    let attitude = state.attitude * turn;
    let position = measured.position - state.position - state.velocity * border.late - attitude * border.lever;
    let angle = log(&(border.mounting.inverse() * attitude.inverse() * measured.attitude));
    [position / noise.position, angle / noise.attitude]
}

/// Rotation of the body from a node until its pose is seen.
pub(super) fn turn_until_seen(state: &State, border: &Border, reading: &Reading) -> Rotation {
    exp(&((reading.rate - state.gyro) * border.late))
}

/// The residuals of a pose: position, then attitude, each in units of its deviation. `reading` is what the inertial sensor says at the node.
pub(super) fn pose(
    measured: &Pose,
    state: &State,
    border: &Border,
    reading: &Reading,
    noise: &BodyNoise,
) -> [Block<3>; 2] {
    use part::{ATTITUDE, GYRO, LEVER, MOUNTING, OFFSET, POSITION, VELOCITY};
    let (late, lever, rate) = (border.late, &border.lever, reading.rate - state.gyro);
    let turn = turn_until_seen(state, border, reading);
    let [away, turned_away] = pose_left(measured, state, border, &turn, noise);
    let attitude = state.attitude * turn;
    let matrix = attitude.to_rotation_matrix().into_inner();
    let by_gyro = right_jacobian(&(rate * late)) * late;
    let mut position = Block::<3>::zeros();
    let turned = state.attitude.to_rotation_matrix() * (turn * lever).cross_matrix();
    position.node.fixed_view_mut::<3, 3>(0, ATTITUDE).copy_from(&turned);
    position.node.fixed_view_mut::<3, 3>(0, POSITION).copy_from(&-Matrix::identity());
    position.node.fixed_view_mut::<3, 3>(0, VELOCITY).copy_from(&(Matrix::identity() * -late));
    position.node.fixed_view_mut::<3, 3>(0, GYRO).copy_from(&(-matrix * lever.cross_matrix() * by_gyro));
    position.border.fixed_view_mut::<3, 3>(0, LEVER).copy_from(&-matrix);
    position.border.fixed_view_mut::<3, 1>(0, OFFSET).copy_from(&(-state.velocity - matrix * rate.cross(lever)));
    let mut angle = Block::<3>::zeros();
    let back = border.mounting.inverse();
    let inverse = right_jacobian_inverse(&(turned_away * noise.attitude)).transpose();
    let back_matrix = back.to_rotation_matrix();
    let turned = (back * turn.inverse()).to_rotation_matrix().into_inner();
    angle.node.fixed_view_mut::<3, 3>(0, ATTITUDE).copy_from(&(-inverse * turned));
    angle.node.fixed_view_mut::<3, 3>(0, GYRO).copy_from(&(inverse * back_matrix * by_gyro));
    angle.border.fixed_view_mut::<3, 3>(0, MOUNTING).copy_from(&-inverse);
    angle.border.fixed_view_mut::<3, 1>(0, OFFSET).copy_from(&(-inverse * (back * rate)));
    position.scale(noise.position.recip());
    angle.scale(noise.attitude.recip());
    (position.residual, angle.residual) = (away, turned_away);
    [position, angle]
}

impl Block<3> {
    /// Weighs the block as it counts under a loss.
    pub(super) fn weigh(&mut self, loss: Loss) {
        let (_, weight) = loss.of(self.residual.norm_squared(), 3.0);
        if weight != 1.0 {
            self.scale(weight.sqrt());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fuse::{
        ImuNoise, ImuRecord,
        state::{BorderError, StateError},
    };

    const NOISE: BodyNoise =
        BodyNoise { imu: ImuNoise::even(0.01, 0.1, 0.02, 0.03), position: 0.02, attitude: 0.03, jerk: 2.0 };

    fn state(k: f64) -> State {
        State {
            attitude: exp(&Vector::new(0.3 * k, -0.8, 1.1 + 0.1 * k)),
            position: Vector::new(1.0, 2.0 * k, -0.5),
            velocity: Vector::new(0.4, -0.7 * k, 0.2),
            gyro: Vector::new(0.02, -0.01 * k, 0.03),
            accelerometer: Vector::new(-0.1, 0.2, 0.05 * k),
        }
    }

    fn border() -> Border {
        Border {
            lever: Vector::new(0.1, -0.2, 0.3),
            mounting: exp(&Vector::new(1.0, -2.0, 0.5)),
            late: 0.07,
            gravity: Vector::new(0.3, -0.2, -9.8),
        }
    }

    /// Central differences of step 1e-5 on residuals of some 1e3: their own error is near 1e-6.
    fn check<const N: usize>(name: &str, of: impl Fn(&State, &State, &Border) -> Block<N>) {
        let (a, b, c) = (state(1.0), state(1.3), border());
        let block = of(&a, &b, &c);
        let h = 1e-5;
        let size = block.residual.norm().max(1.0);
        let near = |slope: SVector<f64, N>, column: SVector<f64, N>, what: &str| {
            assert!((slope - column).norm() < 1e-7 * (size + column.norm()), "{name} {what}: {slope} {column}");
        };
        for j in 0..STATE {
            let d = StateError::ith(j, h);
            let slope = (of(&a.moved(&d), &b, &c).residual - of(&a.moved(&-d), &b, &c).residual) / (2.0 * h);
            near(slope, block.node.column(j).into_owned(), &format!("node {j}"));
            let slope = (of(&a, &b.moved(&d), &c).residual - of(&a, &b.moved(&-d), &c).residual) / (2.0 * h);
            near(slope, block.next.column(j).into_owned(), &format!("next {j}"));
        }
        for j in 0..BORDER {
            let d = BorderError::ith(j, h);
            let slope = (of(&a, &b, &c.moved(&d)).residual - of(&a, &b, &c.moved(&-d)).residual) / (2.0 * h);
            near(slope, block.border.column(j).into_owned(), &format!("border {j}"));
        }
    }

    fn with_record<T>(rows: usize, f: impl Fn(&ImuRecord<'_>) -> T) -> T {
        let times: Vec<f64> = (0..rows).map(|row| 0.01 * row as f64).collect();
        let rates: Vec<[f64; 3]> = times.iter().map(|t| [3.0 * t.sin(), 2.0 - t, 1.0 + (5.0 * t).cos()]).collect();
        let forces: Vec<[f64; 3]> = times.iter().map(|t| [1.0 - t, 2.0 * (7.0 * t).sin(), 9.0]).collect();
        f(&ImuRecord { times: &times, rates: &rates, forces: &forces, averages: [0.0; 2] })
    }

    #[test]
    fn slopes_of_the_inertial_residual() {
        with_record(40, |imu| {
            let reference = [Vector::new(0.01, 0.02, -0.01), Vector::new(0.1, 0.0, -0.1)];
            let between = Preintegrated::new(imu, 0.033, 0.291, &reference, &NOISE.imu);
            assert!((between.dt - 0.258).abs() < 1e-14);
            for has_forces in [true, false] {
                check("inertial", |a, b, c| inertial(&between, &reference, [a, b], c, &NOISE, has_forces));
                let (a, b, c) = (state(1.0), state(1.3), border());
                let squares = inertial(&between, &reference, [&a, &b], &c, &NOISE, has_forces).residual.norm_squared();
                let cost = inertial_cost(&between, &reference, [&a, &b], &c.gravity, &NOISE, has_forces);
                assert!((squares / cost - 1.0).abs() < 1e-10, "{squares} {cost}");
            }
        });
    }

    #[test]
    fn slopes_of_a_pose() {
        let reading = Reading { rate: Vector::new(1.0, -2.0, 3.0), force: Vector::zeros() };
        let measured = Pose { position: Vector::new(1.1, 2.2, -0.3), attitude: exp(&Vector::new(0.7, 0.1, 0.9)) };
        check("position", |a, _, c| pose(&measured, a, c, &reading, &NOISE)[0].clone());
        check("attitude", |a, _, c| pose(&measured, a, c, &reading, &NOISE)[1].clone());
    }

    /// The slopes with respect to the biases against sums with other biases.
    #[test]
    fn biases_are_corrected_as_if_summed_anew() {
        with_record(40, |imu| {
            let sum = |g: Vector, a: Vector| Preintegrated::new(imu, 0.033, 0.291, &[g, a], &NOISE.imu);
            let (zero, h) = (Vector::zeros(), 1e-4);
            let motion = sum(zero, zero);
            for axis in 0..3 {
                let d = Vector::ith(axis, h);
                for (g, a) in [(d, zero), (zero, d)] {
                    let (there, back) = (sum(g, a), sum(-g, -a));
                    let turned = log(&(motion.rotation.inverse() * there.rotation))
                        - log(&(motion.rotation.inverse() * back.rotation));
                    let corrected = motion.corrected(&g, &a);
                    assert!((turned / 2.0 - log(&(motion.rotation.inverse() * corrected.0))).norm() < 1e-7 * h);
                    assert!(
                        ((there.velocity - back.velocity) / 2.0 - (corrected.1 - motion.velocity)).norm() < 1e-7 * h
                    );
                    assert!(
                        ((there.position - back.position) / 2.0 - (corrected.2 - motion.position)).norm() < 1e-7 * h
                    );
                }
            }
        });
    }

    /// A constant rate about z and a force that turns with the world: closed forms.
    #[test]
    fn preintegration_of_a_circle() {
        let (rate, rows) = (2.0_f64, 2001);
        let times: Vec<f64> = (0..rows).map(|row| 1e-3 * f64::from(row)).collect();
        let rates = vec![[0.0, 0.0, rate]; times.len()];
        let forces = vec![[1.0, 0.0, 0.0]; times.len()];
        let imu = ImuRecord { times: &times, rates: &rates, forces: &forces, averages: [0.0; 2] };
        let t: f64 = 1.7;
        let sum = Preintegrated::new(&imu, 0.0, t, &[Vector::zeros(); 2], &NOISE.imu);
        let angle = rate * t;
        let velocity = Vector::new(angle.sin(), 1.0 - angle.cos(), 0.0) / rate;
        let position = Vector::new(1.0 - angle.cos(), angle - angle.sin(), 0.0) / (rate * rate);
        // The middle stands for a step: (rate dt)^2 / 24.
        assert!((log(&sum.rotation).z - (angle - std::f64::consts::TAU)).abs() < 1e-12);
        assert!((sum.velocity - velocity).norm() < 1e-6 && (sum.position - position).norm() < 1e-6);
        // White noise of the rate, and of a force along the axis of the turn: integrated once and twice.
        assert!((sum.covariance[(2, 2)] / (1e-4 * t) - 1.0).abs() < 1e-9);
        assert!((sum.covariance[(5, 5)] / (1e-2 * t) - 1.0).abs() < 0.5);
    }
}
