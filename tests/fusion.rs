//! A body's inertial sensor and measured poses fused: by the command, against the truth of a simulated body.

use std::fs;

use fleetfoot::{
    Recipe, Silent,
    message::write::{Header, Illuminance, Imu, Pose, PoseStamped, Time},
    output::{McapOptions, McapWriter},
    read_rows,
};

use crate::{
    flight::{START, turned},
    runner::*,
};

/// A number from -1 to 1 that looks random.
fn noise(seed: u64, row: usize) -> f64 {
    let mixed = fleetfoot::data::mix(fleetfoot::data::mix(seed).wrapping_add(row as u64));
    (mixed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Roll, pitch and yaw, and their rates.
fn angles(t: f64) -> ([f64; 3], [f64; 3]) {
    let axes = [[0.6, 1.7, 0.0], [0.5, 1.1, 1.0], [1.2, 0.7, 0.3]];
    (
        axes.map(|[size, rate, phase]: [f64; 3]| size * (rate * t + phase).sin()),
        axes.map(|[size, rate, phase]| size * rate * (rate * t + phase).cos()),
    )
}

/// Rz Ry Rx as a quaternion x, y, z, w.
fn attitude(t: f64) -> [f64; 4] {
    let [(sr, cr), (sp, cp), (sy, cy)] = angles(t).0.map(|angle| (0.5 * angle).sin_cos());
    [sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy]
}

/// In the body frame, from the rates of roll, pitch and yaw.
fn rate(t: f64) -> [f64; 3] {
    let ([roll, pitch, _], [dr, dp, dy]) = angles(t);
    [
        dr - dy * pitch.sin(),
        dp * roll.cos() + dy * roll.sin() * pitch.cos(),
        dy * roll.cos() * pitch.cos() - dp * roll.sin(),
    ]
}

const AXES: [[f64; 3]; 3] = [[1.0, 1.3, 0.2], [0.7, 1.9, 1.4], [0.4, 2.3, 0.9]];

fn position(t: f64) -> [f64; 3] {
    AXES.map(|[size, rate, phase]| size * (rate * t + phase).sin())
}

fn acceleration(t: f64) -> [f64; 3] {
    AXES.map(|[size, rate, phase]| -size * rate * rate * (rate * t + phase).sin())
}

const MOUNT: [f64; 3] = [0.05, -0.02, 0.1];
const BIAS: [f64; 3] = [0.02, -0.03, 0.01];

/// Readings that determine the constants of a body, and fewer that suffice for the course of a preparation.
const LONG: usize = 3000;
const SHORT: usize = 800;

/// As many readings at 200 Hz, and poses at 100 Hz, stamped 8 ms late. The poses are of markers off the body's origin,
/// turned by a quarter about z; a lamp at 50 Hz is an extra column.
fn write_body(path: &Path, rows: usize) {
    write_wrong(path, rows, &|_, _| {}, &|_, _, _| {});
}

/// Change of rates and forces.
type Read<'a> = &'a dyn Fn(&mut [f64; 3], &mut [f64; 3]);

/// Change of positions and quaternions at a second.
type See<'a> = &'a dyn Fn(f64, &mut [f64; 3], &mut [f64; 4]);

/// The same with readings and poses changed by a fault.
fn write_wrong(path: &Path, rows: usize, read: Read<'_>, see: See<'_>) {
    let mut writer = McapWriter::create(path, &McapOptions::default()).unwrap();
    let imu = writer.channel::<Imu<'_>>("/imu").unwrap();
    let pose = writer.channel::<PoseStamped<'_>>("/mocap").unwrap();
    let lamp = writer.channel::<Illuminance<'_>>("/lamp").unwrap();
    for row in 0..rows {
        let t = 0.005 * row as f64;
        let stamp = |t: f64| START + (t * 1e9).round() as i64;
        let header = |t: f64| Header { stamp: Time::from_nanoseconds(stamp(t)).unwrap(), frame_id: "body" };
        let [x, y, z, w] = attitude(t);
        let pushed = acceleration(t);
        let force = turned([-x, -y, -z, w], [pushed[0], pushed[1], pushed[2] + 9.81]);
        let mut angular_velocity =
            [0, 1, 2].map(|axis| rate(t)[axis] + BIAS[axis] + 0.01 * noise(10 + axis as u64, row));
        let mut linear_acceleration = [0, 1, 2].map(|axis| force[axis] + 0.05 * noise(20 + axis as u64, row));
        read(&mut angular_velocity, &mut linear_acceleration);
        let read = Imu { header: header(t), angular_velocity, linear_acceleration, ..Imu::default() };
        writer.write(imu, stamp(t), stamp(t), &read).unwrap();
        if row % 2 == 0 {
            let at = t + 0.0013;
            let [x, y, z, w] = attitude(at);
            let lever = turned([x, y, z, w], MOUNT);
            // A gross error now and then.
            let off = if row % 500 == 300 { 0.2 } else { 0.0 };
            let mut position =
                [0, 1, 2].map(|axis| position(at)[axis] + lever[axis] + off + 1e-3 * noise(30 + axis as u64, row));
            // q times a quarter turn about z, and errors of some milliradians, which are halved in a quaternion.
            let (s, c) = std::f64::consts::FRAC_PI_4.sin_cos();
            let turn = [x * c + y * s, y * c - x * s, z * c + w * s, w * c - z * s];
            let mut orientation = [0, 1, 2, 3].map(|part| turn[part] + 2e-3 * noise(40 + part as u64, row));
            see(at, &mut position, &mut orientation);
            let seen = PoseStamped { header: header(at + 0.008), pose: Pose { position, orientation } };
            writer.write(pose, stamp(at + 0.008), stamp(at + 0.008), &seen).unwrap();
        }
        if row % 4 == 0 {
            let light = Illuminance { header: header(t), illuminance: (0.5 * t).sin(), ..Illuminance::default() };
            writer.write(lamp, stamp(t), stamp(t), &light).unwrap();
        }
    }
    writer.finish().unwrap();
}

const RECIPE: &str = r#"
[columns]
light = "/lamp.illuminance"
[inputs]
light = {}
[body]
gravity = 9.81
[sensor.imu]
kind = "imu"
channels = ["/imu.angular_velocity.x", "/imu.angular_velocity.y", "/imu.angular_velocity.z", "/imu.linear_acceleration.x", "/imu.linear_acceleration.y", "/imu.linear_acceleration.z"]
[sensor.mocap]
kind = "pose"
channels = ["/mocap.pose.position.x", "/mocap.pose.position.y", "/mocap.pose.position.z", "/mocap.pose.orientation.x", "/mocap.pose.orientation.y", "/mocap.pose.orientation.z", "/mocap.pose.orientation.w"]
lever = "auto"
mounting = "auto"
delay = "auto"
[prepare]
clip = 0.1
"#;

fn prepare(folder: &Path, recipe: &str, flags: &[&str]) -> Run {
    fs::write(folder.join("body.toml"), recipe).unwrap();
    fleetfoot(folder, &[&["prepare", "-c", "body.toml", "run.mcap", "-o", "clean", "--force"][..], flags].concat())
}

/// Lever, mounting, delay and biases of a simulated body are recovered, and gross errors are left out. States lie
/// within their deviations of the truth, and the output is ready for a fit.
#[test]
fn the_motion_of_a_body_is_prepared() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_body(&path.join("run.mcap"), LONG);
    let report = prepare(path, RECIPE, &["--json"]).ok().json();
    let body = &report["body"];
    let near = |value: &serde_json::Value, deviation: &serde_json::Value, truth: f64| {
        let (value, deviation) = (value.as_f64().unwrap(), deviation.as_f64().unwrap());
        assert!(deviation > 0.0 && (value - truth).abs() < 4.0 * deviation, "{value} {deviation} {truth}");
        deviation
    };
    for axis in 0..3 {
        assert!(near(&body["lever"][axis], &body["lever_deviation"][axis], MOUNT[axis]) < 6e-3);
    }
    assert!(near(&body["delay"], &body["delay_deviation"], 0.008) < 3e-4, "{body:#}");
    // Two angles tell how far gravity may lie off the third axis.
    for axis in 0..2 {
        let tilt = body["gravity_deviation"][axis].as_f64().unwrap();
        let off = body["gravity"][axis].as_f64().unwrap() / 9.81;
        assert!(tilt > 0.0 && tilt < 5e-3 && off.abs() < 4.0 * tilt, "{body:#}");
    }
    let quarter = [0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2];
    let dot: f64 = quarter.iter().enumerate().map(|(i, part)| part * body["mounting"][i].as_f64().unwrap()).sum();
    assert!(dot.abs() > 1.0 - 1e-5, "{body:#}");
    assert_eq!(body["rejected"][0]["positions"]["rows"], 6, "{body:#}");
    assert!(body["converged"].as_bool().unwrap() && body["noise_fitted"].as_bool().unwrap());
    // Uniform errors of 1 mm have a deviation of a root of three less.
    let position = body["pose_noise"][0].as_f64().unwrap();
    assert!((position * 3.0_f64.sqrt() / 1e-3 - 1.0).abs() < 0.1, "{position}");
    let names = ["x", "x_deviation", "vx", "wx", "ax", "yaw", "qw", "light", "gyro_bias_x"].map(str::to_owned);
    let rows = read_rows(&Recipe::default(), Some(&names), &[path.join("clean/run.clean.parquet")], &Silent).unwrap();
    let column = |name: &str| &rows.columns.iter().find(|(column, _)| column.name == name).unwrap().1;
    let times: Vec<f64> = rows.stamps.iter().map(|stamp| (stamp - START) as f64 * 1e-9).collect();
    let rms = |name: &str, truth: &dyn Fn(f64) -> f64| {
        let squares: f64 = column(name).iter().zip(&times).map(|(value, &t)| (value - truth(t)).powi(2)).sum();
        (squares / times.len() as f64).sqrt()
    };
    let velocity = |t: f64| AXES[0][0] * AXES[0][1] * (AXES[0][1] * t + AXES[0][2]).cos();
    let errors = [
        rms("x", &|t| position_at(t)),
        rms("vx", &velocity),
        rms("wx", &|t| rate(t)[0]),
        rms("ax", &|t| acceleration(t)[0]),
        rms("yaw", &|t| angles(t).0[2]),
        rms("qw", &|t| attitude(t)[3]),
        rms("gyro_bias_x", &|_| BIAS[0]),
    ];
    // The readings themselves are known to 0.006 rad/s and 0.03 m/s^2.
    let allowed = [2e-3, 5e-3, 7e-3, 4e-2, 2e-3, 2e-3, 2e-3];
    assert!(errors.iter().zip(allowed).all(|(error, most)| *error < most), "{errors:?}");
    // The lamp is held for 20 ms.
    assert!(rms("light", &|t| (0.5 * t).sin()) < 0.01 && column("x_deviation").iter().all(|value| *value < 4e-3));
    fleetfoot(path, &["fit", "sindy", "-c", "clean/robot.toml", "clean", "-o", "model.json", "--degree", "1"]).ok();
}

/// On request the attitude is one rotation: the output is ready for a fit, and its rollouts turn as the body does, with
/// one error of the attitude. A note names angles near their singularity.
#[test]
fn attitudes_become_rotations_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_body(&path.join("run.mcap"), LONG);
    let output = prepare(path, &RECIPE.replace("[body]", "[body]\nattitude = \"quaternion\""), &[]).ok();
    assert!(!output.err.contains("degrees"), "{}", output.err);
    let recipe = fs::read_to_string(path.join("clean/robot.toml")).unwrap();
    assert!(recipe.contains("kind = \"quaternion\"") && !recipe.contains("roll"), "{recipe}");
    fleetfoot(path, &["fit", "sindy", "-c", "clean/robot.toml", "clean", "-o", "model.json", "--degree", "1"]).ok();
    let shown = fleetfoot(path, &["show", "model.json"]).ok().out;
    assert!(shown.contains("d(qz)/dt = 0.5*(qw*wz + (qx*wy - qy*wx))  (given)"), "{shown}");
    let report =
        fleetfoot(path, &["rollout", "model.json", "clean", "--horizon", "4", "--method", "rk4", "--json"]).ok().json();
    let names = report["states"].as_array().unwrap();
    let at = names.iter().position(|name| name == "attitude").unwrap();
    let steps = report["model"]["rmse"].as_array().unwrap();
    // Over 20 ms the body turns by some 0.03 rad; rates are fitted by lines of the states, and read to 0.006 rad/s.
    let off = steps[steps.len() - 1][at].as_f64().unwrap();
    assert!(off < 2e-3, "{off} {names:?}");
    // The same flight in a world that is turned by 80 degrees about y.
    let (s, c) = 40.0_f64.to_radians().sin_cos();
    let (sine, cosine) = 80.0_f64.to_radians().sin_cos();
    let sum = |a: f64, x: String, b: f64, y: String| format!("\"{a}*{x} + {b}*{y}\"");
    let position = |axis: &str| format!("/mocap.pose.position.{axis}");
    let orientation = |axis: &str| format!("/mocap.pose.orientation.{axis}");
    let turned = [
        sum(cosine, position("x"), sine, position("z")),
        format!("\"{}\"", position("y")),
        sum(cosine, position("z"), -sine, position("x")),
        sum(c, orientation("x"), s, orientation("z")),
        sum(c, orientation("y"), s, orientation("w")),
        sum(c, orientation("z"), -s, orientation("x")),
        sum(c, orientation("w"), -s, orientation("y")),
    ];
    let start = RECIPE.find("channels = [\"/mocap").unwrap();
    let end = start + RECIPE[start..].find(']').unwrap() + 1;
    let steep = format!("{}channels = [{}]{}", &RECIPE[..start], turned.join(", "), &RECIPE[end..]);
    let output = prepare(path, &steep, &[]).ok();
    assert!(
        output.err.contains("the pitch of the body reaches") && output.err.contains("attitude = \"quaternion\""),
        "{}",
        output.err
    );
    let taken =
        RECIPE.replace("[body]", "[body]\nattitude = \"quaternion\"").replace("light = {}", "attitude = \"light\"");
    let output = prepare(path, &taken, &[]);
    assert!(output.code == 1 && output.err.contains("give it another name"), "{}", output.err);
}

fn position_at(t: f64) -> f64 {
    position(t)[0]
}

#[test]
fn fused_bytes_do_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_body(&path.join("run.mcap"), LONG);
    let recipe = RECIPE
        .replace("kind = \"imu\"", "kind = \"imu\"\nnoise = [4e-4, 2e-3]")
        .replace("kind = \"pose\"", "kind = \"pose\"\nnoise = [6e-4, 1e-3]");
    let written = ["1", "7"].map(|threads| {
        let output = prepare(path, &recipe, &["--threads", threads, "--json"]).ok();
        (output.out, fs::read(path.join("clean/run.clean.parquet")).unwrap())
    });
    let text = prepare(path, &recipe, &[]).ok().out;
    assert!(
        text.contains("fused 1500 poses: 6 positions") && text.contains("attitude 0.001000 rad, as given"),
        "{text}"
    );
    assert!(text.contains("gravity") && text.contains("(deviations of its direction "), "{text}");
    // A delay that is not asked for is nothing, without a sign.
    let punctual = recipe.replace("delay = \"auto\"\n", "").replace("gravity = 9.81", "gravity = 9.81\ngate = 0.0");
    let text = prepare(path, &punctual, &[]).ok().out;
    assert!(text.contains("delay     0, as given"), "{text}");
    assert!(written[0] == written[1] && written[0].0.contains("\"noise_fitted\": false"), "{}", written[0].0);
}

/// The recipe without the accelerometer.
fn gyroscope() -> String {
    let forces = ["x", "y", "z"].map(|axis| format!(", \"/imu.linear_acceleration.{axis}\"")).concat();
    RECIPE.replace("kind = \"imu\"", "kind = \"gyro\"").replace(&forces, "")
}

/// Without an accelerometer attitude, rate and delay are as accurate as with it, and the poses determine position,
/// velocity and acceleration. A joint stands beside the body, at the stamps of the gyroscope.
#[test]
fn gyroscopes_and_joints_are_fused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_body(&path.join("run.mcap"), LONG);
    let recipe = gyroscope().replace("lever = \"auto\"", &format!("lever = {MOUNT:?}"))
        + "[joint.arm]\n[sensor.encoder]\nkind = \"position\"\nchannels = [\"/lamp.illuminance\"]\nnoise = [1e-4]\n";
    let report = prepare(path, &recipe, &["--json"]).ok().json();
    let (body, joint) = (&report["body"], &report["joints"][0]);
    assert!(body["converged"] == true && body["accelerometer"] == false && body["jerk"].as_f64().unwrap() > 0.0);
    let [delay, deviation] = ["delay", "delay_deviation"].map(|name| body[name].as_f64().unwrap());
    assert!((delay - 0.008).abs() < 4.0 * deviation && deviation < 5e-4, "{body:#}");
    assert_eq!(body["rejected"][0]["positions"]["rows"], 6, "{body:#}");
    assert!(joint["joint"] == "arm" && joint["converged"] == true, "{joint:#}");
    let names = ["x", "vx", "ax", "ax_deviation", "yaw", "wx", "gyro_bias_x", "arm", "arm_dot"].map(str::to_owned);
    let rows = read_rows(&Recipe::default(), Some(&names), &[path.join("clean/run.clean.parquet")], &Silent).unwrap();
    let times: Vec<f64> = rows.stamps.iter().map(|stamp| (stamp - START) as f64 * 1e-9).collect();
    let rms = |name: &str, truth: &dyn Fn(f64) -> f64| {
        let column = &rows.columns.iter().find(|(column, _)| column.name == name).unwrap().1;
        let squares: f64 = column.iter().zip(&times).map(|(value, &t)| (value - truth(t)).powi(2)).sum();
        (squares / times.len() as f64).sqrt()
    };
    let [size, rate_of, phase] = AXES[0];
    let errors = [
        rms("x", &|t| position_at(t)),
        rms("vx", &|t| size * rate_of * (rate_of * t + phase).cos()),
        rms("ax", &|t| acceleration(t)[0]),
        rms("yaw", &|t| angles(t).0[2]),
        rms("wx", &|t| rate(t)[0]),
        rms("gyro_bias_x", &|_| BIAS[0]),
        rms("arm", &|t| (0.5 * t).sin()),
        rms("arm_dot", &|t| 0.5 * (0.5 * t).cos()),
    ];
    let allowed = [2e-3, 0.02, 0.5, 2e-3, 7e-3, 2e-3, 1e-4, 1e-3];
    assert!(errors.iter().zip(allowed).all(|(error, most)| *error < most), "{errors:?}");
    // The acceleration's deviation is of the size of its error.
    let ratio = errors[2] / rms("ax_deviation", &|_| 0.0);
    assert!(ratio < 3.0 && ratio > 0.1, "{ratio}");
    fleetfoot(path, &["fit", "sindy", "-c", "clean/robot.toml", "clean", "-o", "model.json", "--degree", "1"]).ok();
}

/// A filter of a body knows less than the smoother, and states it.
#[test]
fn a_body_is_filtered() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_body(&path.join("run.mcap"), LONG);
    let names = ["x", "vx", "x_deviation", "vx_deviation"].map(str::to_owned);
    let prepared_errors = |recipe: &str| {
        prepare(path, recipe, &[]).ok();
        let file = path.join("clean/run.clean.parquet");
        let rows = read_rows(&Recipe::default(), Some(&names), &[file], &Silent).unwrap();
        // From the second second on.
        let rows_of =
            |name: &str| rows.columns.iter().find(|(column, _)| column.name == name).unwrap().1[200..].to_vec();
        let times: Vec<f64> = rows.stamps[200..].iter().map(|stamp| (stamp - START) as f64 * 1e-9).collect();
        let rms = |values: &[f64]| (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt();
        let off: Vec<f64> = rows_of("x").iter().zip(&times).map(|(x, &t)| x - position_at(t)).collect();
        [rms(&off), rms(&rows_of("x_deviation")), rms(&rows_of("vx_deviation"))]
    };
    let filter = prepared_errors(&RECIPE.replace("[body]", "[body]\nestimate = \"filter\""));
    let smoother = prepared_errors(RECIPE);
    // Both have the same error of the lever, and with it of the position.
    assert!(filter.iter().zip(smoother).all(|(filter, smoother)| *filter > smoother), "{filter:?} {smoother:?}");
    assert!(filter[2] > 1.2 * smoother[2], "{filter:?} {smoother:?}");
    assert!((0.5..2.0).contains(&(filter[0] / filter[1])), "{filter:?}");
}

/// A preparation that is killed during fusion resumes, and writes the bytes of one without interruption.
#[test]
fn a_killed_preparation_writes_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_body(&path.join("run.mcap"), SHORT);
    let files = || ["run.clean.parquet", "robot.toml"].map(|name| fs::read(path.join("clean").join(name)).unwrap());
    prepare(path, RECIPE, &[]).ok();
    let whole = files();
    fs::remove_dir_all(path.join("clean")).unwrap();
    let kept = path.join("clean/.fusing");
    let mut killed = Command::new(env!("CARGO_BIN_EXE_fleetfoot"))
        .current_dir(path)
        .args(["prepare", "-c", "body.toml", "run.mcap", "-o", "clean", "--quiet"])
        .spawn()
        .unwrap();
    while !kept.exists() {
        assert!(killed.try_wait().unwrap().is_none(), "it ended without a file of where it stands");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    killed.kill().unwrap();
    assert!(!killed.wait().unwrap().success() && kept.exists() && !path.join("clean/run.clean.parquet").exists());
    prepare(path, RECIPE, &[]).ok();
    assert!(files() == whole && !kept.exists());
}

/// Common faults of logs: degrees, units of gravity, forces without gravity, parts of quaternions in another order or
/// the other way round. A file is written, and a note names the fault.
#[test]
fn wrong_units_and_frames_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let turn = |by: f64| move |vector: &mut [f64; 3]| vector.iter_mut().for_each(|part| *part *= by);
    let degrees = |rate: &mut [f64; 3], _: &mut [f64; 3]| turn(180.0 / std::f64::consts::PI)(rate);
    let in_g = |_: &mut [f64; 3], force: &mut [f64; 3]| turn(1.0 / 9.81)(force);
    let as_is = |_: &mut [f64; 3], _: &mut [f64; 3]| {};
    let seen = |_: f64, _: &mut [f64; 3], _: &mut [f64; 4]| {};
    let first_w = |_: f64, _: &mut [f64; 3], quaternion: &mut [f64; 4]| quaternion.rotate_right(1);
    let world_to_body = |_: f64, _: &mut [f64; 3], quaternion: &mut [f64; 4]| quaternion[3] = -quaternion[3];
    // It takes some seconds to know a bias.
    let cases: [(Read<'_>, See<'_>, usize, &str); 4] = [
        (&degrees, &seen, SHORT, "rad/s"),
        (&in_g, &seen, LONG, "specific force in m/s^2"),
        (&as_is, &first_w, SHORT, "quaternion"),
        (&as_is, &world_to_body, SHORT, "markers' frame to the world"),
    ];
    for (read, see, rows, words) in cases {
        write_wrong(&path.join("run.mcap"), rows, read, see);
        let report = prepare(path, RECIPE, &["--json"]).ok().json();
        let notes = report["notes"].to_string();
        assert!(notes.contains("check") && notes.contains(words), "{words}: {notes}");
    }
    // A correct recording gets no such note.
    write_body(&path.join("run.mcap"), SHORT);
    let notes = prepare(path, RECIPE, &["--json"]).ok().json()["notes"].to_string();
    assert!(!notes.contains("check"), "{notes}");
}

/// A camera that does not see the body sends zeros or its last pose again: these are no poses. Quaternions that are
/// longer than one are normalised. Notes name both, and rows that no pose determines.
#[test]
fn invalid_poses_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let as_is = |_: &mut [f64; 3], _: &mut [f64; 3]| {};
    let is_lost = |t: f64| t > 1.0 && t < 1.5;
    let zeros = |t: f64, position: &mut [f64; 3], quaternion: &mut [f64; 4]| {
        if is_lost(t) {
            // A message whose quaternion is zero to the last bit has none, which another note counts.
            (*position, *quaternion) = ([0.0; 3], [0.0, 0.0, 0.0, 1e-5]);
        }
    };
    let last = std::cell::Cell::new(([0.0; 3], [0.0; 4]));
    let again = |t: f64, position: &mut [f64; 3], quaternion: &mut [f64; 4]| {
        if is_lost(t) {
            (*position, *quaternion) = last.get();
        }
        last.set((*position, *quaternion));
    };
    let long =
        |_: f64, _: &mut [f64; 3], quaternion: &mut [f64; 4]| quaternion.iter_mut().for_each(|part| *part *= 1.5);
    let early = |t: f64, position: &mut [f64; 3], _: &mut [f64; 4]| {
        if t > 3.0 {
            *position = [f64::NAN; 3];
        }
    };
    let worst = || {
        let file = [path.join("clean/run.clean.parquet")];
        let rows = read_rows(&Recipe::parse("", "test").unwrap(), None, &file, &Silent).unwrap();
        let x = &rows.columns.iter().find(|(name, _)| name.name == "x").unwrap().1;
        let off = |(stamp, x): (&i64, &f64)| (x - position((stamp - START) as f64 * 1e-9)[0]).abs();
        rows.stamps.iter().zip(x).map(off).fold(0.0, f64::max)
    };
    for (see, words) in [
        (&zeros as See<'_>, "50 poses have a quaternion of zeros"),
        (&again, "50 poses repeat the previous pose"),
        (&long, "400 poses are not of length 1 (1.4"),
    ] {
        write_wrong(&path.join("run.mcap"), SHORT, &as_is, see);
        let report = prepare(path, RECIPE, &["--json"]).ok().json();
        let notes = report["notes"].to_string();
        assert!(notes.contains(words), "{words}: {notes}");
        assert!((report["body"]["delay"].as_f64().unwrap() - 0.008).abs() < 2e-3, "{words}: {}", report["body"]);
        // Half a second without poses is bridged by the inertial sensor.
        assert!(worst() < 0.03, "{words}: {}", worst());
    }
    write_wrong(&path.join("run.mcap"), SHORT, &as_is, &early);
    let output = prepare(path, RECIPE, &[]).ok();
    assert!(output.out.contains("before, between or after the sensors' readings"), "{}", output.out);
}

#[test]
fn impossible_bodies_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_body(&path.join("run.mcap"), SHORT);
    for (recipe, words) in [
        (RECIPE.replace("lever = \"auto\"", "lever = [1.0]"), vec!["[sensor.mocap] lever", "3 finite numbers"]),
        (RECIPE.replace("delay = \"auto\"", "delay = \"late\""), vec!["[sensor.mocap] delay", "seconds"]),
        (RECIPE.replace("gravity = 9.81", "gravity = -9.81"), vec!["[body] gravity = -9.81"]),
        (RECIPE.replace("\"/mocap.pose.orientation.w\"]", "]"), vec!["[sensor.mocap] channels has 6", "7"]),
        (RECIPE.replace("clip = 0.1", "method = \"cubic\""), vec!["[body]", "clip", "[channels]"]),
        (RECIPE.replace("kind = \"pose\"", "kind = \"posture\""), vec!["posture", "imu"]),
        (RECIPE.replace("light = {}", "vx = { column = \"light\" }"), vec!["`vx`", "written twice"]),
        (
            format!("{RECIPE}[sensor.gyro]\nkind = \"gyro\"\nchannels = [\"light\", \"light\", \"light\"]\n"),
            vec!["[sensor.gyro] kind", "the same quantity"],
        ),
        (format!("{RECIPE}[time]\nbase = \"/lamp\"\n"), vec!["[body]", "base and rate from [time]"]),
        (format!("{RECIPE}[time]\nrate = 50.0\n"), vec!["[body]", "base and rate from [time]"]),
        (RECIPE.split("[sensor.mocap]").next().unwrap().to_owned(), vec!["pose", "[sensor.NAME]"]),
        (gyroscope(), vec!["without an accelerometer the lever cannot be estimated", "give it"]),
        (RECIPE.replace("gravity = 9.81", "huber = 4.0\nstudent = 4.0"), vec!["[body]", "huber and student"]),
        (
            RECIPE.replace("kind = \"pose\"", "kind = \"pose\"\naverage = -0.01"),
            vec!["[sensor.mocap] average", "seconds"],
        ),
        (
            RECIPE.replace("kind = \"imu\"", "kind = \"imu\"\nresolution = 0.1"),
            vec!["[sensor.imu] resolution", "joint"],
        ),
    ] {
        prepare(path, &recipe, &[]).fails(&words);
    }
}
