//! A body's inertial sensor and measured poses fused on a real flight, against the published state.

use fleetfoot::{
    Recipe, Rows, Silent, read_rows,
    signal::fuse::{BodyNoise, BodyRun, BodyState, FuseOptions, Fused, ImuNoise, ImuRecord, PoseRecord, Prior, fuse},
};

use crate::{outside::data, runner::*};

/// The first stamp of the inertial sensor, ns.
pub(crate) const START: i64 = 1_413_394_881_575_760_384;

/// Columns of a table of the data set, its stamps as seconds of the flight.
struct Table {
    times: Vec<f64>,
    columns: Vec<Vec<f64>>,
}

impl Table {
    fn read(file: &Path, stamp: &str, names: &[&str]) -> Self {
        let recipe = format!("[time]\ncolumn = \"{stamp}\"\nunit = \"ns\"\nmax_gap = \"none\"\n");
        let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
        let rows: Rows = read_rows(&Recipe::parse(&recipe, "test").unwrap(), Some(&names), &[file], &Silent).unwrap();
        let times = rows.stamps.iter().map(|stamp| (stamp - START) as f64 * 1e-9).collect();
        Self { times, columns: rows.columns.into_iter().map(|(_, values)| values).collect() }
    }

    /// Neighbouring columns, row by row.
    fn part<const N: usize>(&self, from: usize) -> Vec<[f64; N]> {
        (0..self.times.len()).map(|row| std::array::from_fn(|i| self.columns[from + i][row])).collect()
    }
}

/// Noise of the whole flight (`fit_noise` from the densities of the data sheet on): rotors shake the sensor, whose
/// readings scatter twenty times more than its data sheet says.
const NOISE: BodyNoise =
    BodyNoise { imu: ImuNoise::even(7e-3, 4e-2, 1.9393e-5, 3e-3), position: 2e-4, attitude: 2e-3, jerk: 100.0 };

/// Roots of mean squares an axis between the published state and the fused one, at every published stamp from `times[0]` to `times[1]`.
struct Apart {
    /// m, as they are.
    position: f64,
    /// m, once a shift in time that grows evenly (a clock's offset and skew) and a constant displacement in the body frame are taken out.
    aligned: f64,
    /// That shift in the middle of the flight, s, and its skew.
    shift: [f64; 2],
    /// rad/s.
    gyro_bias: f64,
}

/// A vector turned by a quaternion x, y, z, w: v + 2 q x (q x v + w v).
pub(crate) fn turned([x, y, z, w]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let once = cross([x, y, z], v);
    let twice = cross([x, y, z], [0, 1, 2].map(|i| once[i] + w * v[i]));
    [0, 1, 2].map(|i| v[i] + 2.0 * twice[i])
}

/// The solution of normal equations, by elimination.
fn solved(mut a: [[f64; 5]; 5], mut b: [f64; 5]) -> [f64; 5] {
    for c in 0..5 {
        for i in c + 1..5 {
            let factor = a[i][c] / a[c][c];
            for j in c..5 {
                a[i][j] -= factor * a[c][j];
            }
            b[i] -= factor * b[c];
        }
    }
    for c in (0..5).rev() {
        let known: f64 = (c + 1..5).map(|j| a[c][j] * b[j]).sum();
        b[c] = (b[c] - known) / a[c][c];
    }
    b
}

fn apart(fused: &Fused, imu: &ImuRecord<'_>, truth: &Table) -> Apart {
    let (mut normal, mut right) = ([[0.0; 5]; 5], [0.0; 5]);
    let (mut positions, mut biases, mut rows) = (0.0, 0.0, 0.0);
    for (row, &time) in truth.times.iter().enumerate() {
        let state = fused.tracks.iter().find_map(|track| track.at(imu, fused.constants.gravity, &fused.noise, time));
        let Some(BodyState { attitude, position, velocity, gyro_bias, .. }) = state else { continue };
        let axes = [0, 1, 2].map(|axis| turned(attitude, std::array::from_fn(|i| f64::from(u8::from(i == axis)))));
        for axis in 0..3 {
            let away = truth.columns[axis][row] - position[axis];
            let slopes = [axes[0][axis], axes[1][axis], axes[2][axis], velocity[axis], velocity[axis] * (time - 58.0)];
            for i in 0..5 {
                (0..5).for_each(|j| normal[i][j] += slopes[i] * slopes[j]);
                right[i] += slopes[i] * away;
            }
            positions += away * away;
            biases += (truth.columns[3 + axis][row] - gyro_bias[axis]).powi(2);
            rows += 1.0;
        }
    }
    let constant = solved(normal, right);
    let explained: f64 = right.iter().zip(constant).map(|(a, b)| a * b).sum();
    let mean = |sum: f64| (sum / rows).sqrt();
    Apart {
        position: mean(positions),
        aligned: mean(positions - explained),
        shift: [constant[3], constant[4]],
        gyro_bias: mean(biases),
    }
}

/// The published state is itself a batch solution over the same sensors, and no truth: the test checks agreement.
///
/// Fusion starts without knowledge of lever, mounting and gravity's direction, and with the clock offset from the turns
/// of both. Its result is that poses lie 0.1998 s before readings, to 0.1 ms. The speed of turning alone gives 0.1996 s
/// (the whole-system test of two clocks). The published attitudes lie 0.197 to 0.203 s from the raw ones, the published
/// positions 0.190 to 0.194 s, from third to third of the flight. The two cannot both be right, and without corrections
/// positions differ by 10 mm. They agree to 1.12 mm an axis after an offset and a skew of the clock, and a displacement
/// of the body's origin, are taken out. The raw positions themselves agree with the published ones no better. Biases of
/// the gyroscope agree to 2e-4 rad/s without such corrections.
#[test]
fn a_flight_agrees_with_the_published_state() {
    let file = |name: &str| data(&format!("euroc/{name}.csv.gz"));
    let (Some(imu), Some(vicon), Some(truth)) = (file("imu"), file("vicon"), file("state_groundtruth_estimate")) else {
        return;
    };
    let axes = |name: &str, unit: &str| ["x", "y", "z"].map(|axis| format!("{name}_{axis} [{unit}]"));
    let table = |file: &Path, stamp: &str, names: &[Vec<String>]| {
        Table::read(file, stamp, &names.concat().iter().map(String::as_str).collect::<Vec<_>>())
    };
    let readings = [axes("w_RS_S", "rad s^-1").to_vec(), axes("a_RS_S", "m s^-2").to_vec()];
    let imu = table(&imu, "timestamp [ns]", &readings);
    let turns = ["x", "y", "z", "w"].map(|part| format!("q_RS_{part} []")).to_vec();
    let poses = table(&vicon, "timestamp [ns]", &[axes("p_RS_R", "m").to_vec(), turns]);
    let published = [axes("p_RS_R", "m"), axes("b_w_RS_S", "rad s^-1")].map(|names| names.to_vec());
    let truth = table(&truth, "timestamp", &published);
    let (rates, forces) = (imu.part::<3>(0), imu.part::<3>(3));
    let (positions, attitudes) = (poses.part::<3>(0), poses.part::<4>(3));
    let imu = ImuRecord { times: &imu.times, rates: &rates, forces: &forces, averages: [0.0; 2] };
    let run = BodyRun { imu, poses: PoseRecord { times: &poses.times, positions: &positions, attitudes: &attitudes } };
    let unknown = f64::INFINITY;
    let options = FuseOptions {
        noise: NOISE,
        gravity: Prior { value: [0.0, 0.0, -9.81], deviation: unknown },
        lever: Prior { value: [0.0; 3], deviation: unknown },
        mounting: Prior { value: [0.0, 0.0, 0.0, 1.0], deviation: unknown },
        offset: Prior { value: 0.1996, deviation: 0.01 },
        ..FuseOptions::default()
    };
    let fused = fuse(&[run], &options).unwrap();
    let offset = fused.constants.offset;
    let differences = apart(&fused, &imu, &truth);
    eprintln!(
        "{} steps, offset {:.5} ({:.5}) s, lever {:?}; an axis: position {:.2e} m, aligned {:.2e} m at {:.4?} s, gyro bias {:.1e} rad/s",
        fused.steps,
        offset.value,
        offset.deviation,
        fused.constants.lever.map(|axis| axis.value),
        differences.position,
        differences.aligned,
        differences.shift,
        differences.gyro_bias
    );
    assert!(fused.converged && fused.tracks.len() == 1 && fused.outside < 10);
    assert!((offset.value - 0.1998).abs() < 1e-3 && offset.deviation < 2e-4, "{offset:?}");
    assert!(
        differences.aligned < 1.15e-3 && differences.shift[0].abs() < 0.01,
        "{} {:?}",
        differences.aligned,
        differences.shift
    );
    assert!(differences.gyro_bias < 3e-4, "{}", differences.gyro_bias);
}
