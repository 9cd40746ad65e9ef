//! Written MCAP files, read by another implementation field by field.
//!
//! The peer is the Python package `mcap-ros2-support`, run by the interpreter that `FLEETFOOT_PYTHON` names.

use std::{ffi::OsString, path::Path, process::Command};

use fleetfoot_message::write::{
    Bool, Float64, Float64MultiArray, Header, Imu, JointState, Message, MultiArrayDimension, Odometry, Pose,
    PoseStamped, TFMessage, Time, TransformStamped, Twist, TwistStamped, Vector3Stamped, WrenchStamped,
};
use fleetfoot_output::{McapOptions, McapWriter, Overlay};

/// The interpreter, when there is one with the package.
fn peer() -> Option<OsString> {
    crate::outside::python("mcap_ros2.decoder")
}

/// A message as the peer tells it.
#[derive(Debug, PartialEq)]
struct PeerMessage {
    topic: String,
    kind: String,
    log_time: i64,
    publish_time: i64,
    sequence: u64,
    /// Path, kind, text.
    fields: Vec<[String; 3]>,
}

fn read_with_peer(python: &OsString, file: &Path) -> Vec<PeerMessage> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/read_with_peer.py");
    let output = Command::new(python).arg(script).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| {
            let parsed: serde_json::Value = serde_json::from_str(line).unwrap();
            let fields = parsed["fields"].as_array().unwrap();
            PeerMessage {
                topic: text(&parsed["topic"]),
                kind: text(&parsed["type"]),
                log_time: parsed["log_time"].as_i64().unwrap(),
                publish_time: parsed["publish_time"].as_i64().unwrap(),
                sequence: parsed["sequence"].as_u64().unwrap(),
                fields: fields.iter().map(|field| std::array::from_fn(|part| text(&field[part]))).collect(),
            }
        })
        .collect()
}

/// The leaves of a message in the order of its definition.
#[derive(Default)]
struct Fields(Vec<[String; 3]>);

impl Fields {
    fn leaf(mut self, path: &str, kind: &str, text: impl ToString) -> Self {
        self.0.push([path.to_owned(), kind.to_owned(), text.to_string()]);
        self
    }

    fn float(self, path: &str, value: f64) -> Self {
        self.leaf(path, "float", format!("{:016x}", value.to_bits()))
    }

    fn floats(self, path: &str, values: &[f64]) -> Self {
        values.iter().enumerate().fold(self, |fields, (index, &value)| fields.float(&format!("{path}[{index}]"), value))
    }

    /// x, y, z and perhaps w.
    fn axes(self, path: &str, values: &[f64]) -> Self {
        values
            .iter()
            .zip("xyzw".chars())
            .fold(self, |fields, (&value, axis)| fields.float(&format!("{path}.{axis}"), value))
    }

    fn header(self, prefix: &str, header: &Header<'_>) -> Self {
        self.leaf(&format!("{prefix}header.stamp.sec"), "int", header.stamp.sec)
            .leaf(&format!("{prefix}header.stamp.nanosec"), "int", header.stamp.nanosec)
            .leaf(&format!("{prefix}header.frame_id"), "text", header.frame_id)
    }
}

/// A file being written and what must be read from it.
struct Sender {
    writer: McapWriter,
    sent: Vec<PeerMessage>,
}

impl Sender {
    fn send<M: Message>(&mut self, topic: &str, message: &M, fields: Fields) {
        let channel = self.writer.channel::<M>(topic).unwrap();
        let log_time = 1_700_000_000_000_000_000 + 1_000_003 * self.sent.len() as i64;
        let publish_time = log_time - 999;
        self.writer.write(channel, log_time, publish_time, message).unwrap();
        let sequence = self.sent.iter().filter(|sent| sent.topic == topic).count() as u64;
        let (topic, kind) = (topic.to_owned(), M::NAME.to_owned());
        self.sent.push(PeerMessage { topic, kind, log_time, publish_time, sequence, fields: fields.0 });
    }

    /// One message of every type.
    fn send_all(&mut self, header: Header<'_>, number: &mut impl FnMut() -> f64) {
        self.send_bare(number);
        self.send_stamped(header, number);
        self.send_robot(header, number);
        self.send_lists(header, number);
    }

    fn send_bare(&mut self, number: &mut impl FnMut() -> f64) {
        let data = number();
        self.send("/float", &Float64 { data }, Fields::default().float("data", data));
        let data = number() > 0.0;
        self.send("/bool", &Bool { data }, Fields::default().leaf("data", "bool", data));
        let twist = Twist { linear: [(); 3].map(|()| number()), angular: [(); 3].map(|()| number()) };
        self.send("/cmd_vel", &twist, Fields::default().axes("linear", &twist.linear).axes("angular", &twist.angular));
        let data: Vec<f64> = (0..self.sent.len() % 5).map(|_| number()).collect();
        let dim = [MultiArrayDimension { label: "columns", size: data.len() as u32, stride: u32::MAX }];
        let fields = Fields::default()
            .leaf("layout.dim[0].label", "text", "columns")
            .leaf("layout.dim[0].size", "int", data.len())
            .leaf("layout.dim[0].stride", "int", u32::MAX)
            .leaf("layout.data_offset", "int", 3)
            .floats("data", &data);
        self.send("/array", &Float64MultiArray { dim: &dim, data_offset: 3, data: &data }, fields);
    }

    fn send_stamped(&mut self, header: Header<'_>, number: &mut impl FnMut() -> f64) {
        let begin = || Fields::default().header("", &header);
        let pose = Pose { position: [(); 3].map(|()| number()), orientation: [(); 4].map(|()| number()) };
        let fields = begin().axes("pose.position", &pose.position).axes("pose.orientation", &pose.orientation);
        self.send("/pose", &PoseStamped { header, pose }, fields);
        let twist = Twist { linear: [(); 3].map(|()| number()), angular: [(); 3].map(|()| number()) };
        let fields = begin().axes("twist.linear", &twist.linear).axes("twist.angular", &twist.angular);
        self.send("/twist", &TwistStamped { header, twist }, fields);
        let vector = [(); 3].map(|()| number());
        self.send("/vector", &Vector3Stamped { header, vector }, begin().axes("vector", &vector));
        let (force, torque) = ([(); 3].map(|()| number()), [(); 3].map(|()| number()));
        let fields = begin().axes("wrench.force", &force).axes("wrench.torque", &torque);
        self.send("/wrench", &WrenchStamped { header, force, torque }, fields);
    }

    fn send_robot(&mut self, header: Header<'_>, number: &mut impl FnMut() -> f64) {
        let odometry = Odometry {
            header,
            child_frame_id: "base_footprint",
            pose: Pose { position: [(); 3].map(|()| number()), orientation: [(); 4].map(|()| number()) },
            pose_covariance: [(); 36].map(|()| number()),
            twist: Twist { linear: [(); 3].map(|()| number()), angular: [(); 3].map(|()| number()) },
            twist_covariance: [(); 36].map(|()| number()),
        };
        let fields = Fields::default()
            .header("", &header)
            .leaf("child_frame_id", "text", "base_footprint")
            .axes("pose.pose.position", &odometry.pose.position)
            .axes("pose.pose.orientation", &odometry.pose.orientation)
            .floats("pose.covariance", &odometry.pose_covariance)
            .axes("twist.twist.linear", &odometry.twist.linear)
            .axes("twist.twist.angular", &odometry.twist.angular)
            .floats("twist.covariance", &odometry.twist_covariance);
        self.send("/odom", &odometry, fields);
        let imu = Imu {
            header,
            orientation: [(); 4].map(|()| number()),
            orientation_covariance: [(); 9].map(|()| number()),
            angular_velocity: [(); 3].map(|()| number()),
            angular_velocity_covariance: [(); 9].map(|()| number()),
            linear_acceleration: [(); 3].map(|()| number()),
            linear_acceleration_covariance: [(); 9].map(|()| number()),
        };
        let fields = Fields::default()
            .header("", &header)
            .axes("orientation", &imu.orientation)
            .floats("orientation_covariance", &imu.orientation_covariance)
            .axes("angular_velocity", &imu.angular_velocity)
            .floats("angular_velocity_covariance", &imu.angular_velocity_covariance)
            .axes("linear_acceleration", &imu.linear_acceleration)
            .floats("linear_acceleration_covariance", &imu.linear_acceleration_covariance);
        self.send("/imu", &imu, fields);
    }

    fn send_lists(&mut self, header: Header<'_>, number: &mut impl FnMut() -> f64) {
        let names = ["left_crank", "", "räder_3"];
        let count = self.sent.len() % 4;
        let (position, velocity): (Vec<f64>, Vec<f64>) = (0..count).map(|_| (number(), number())).unzip();
        let joints = JointState {
            header,
            name: &names[..count],
            position: &position,
            velocity: &velocity,
            effort: &position[..count.min(1)],
        };
        let named =
            names[..count].iter().enumerate().fold(Fields::default().header("", &header), |fields, (i, name)| {
                fields.leaf(&format!("name[{i}]"), "text", name)
            });
        let fields = named.floats("position", &position).floats("velocity", &velocity).floats("effort", joints.effort);
        self.send("/joint_states", &joints, fields);
        let transforms: Vec<TransformStamped<'_>> = names[..count]
            .iter()
            .map(|child_frame_id| TransformStamped {
                header,
                child_frame_id,
                translation: [(); 3].map(|()| number()),
                rotation: [(); 4].map(|()| number()),
            })
            .collect();
        let fields = transforms.iter().enumerate().fold(Fields::default(), |fields, (i, transform)| {
            fields
                .header(&format!("transforms[{i}]."), &header)
                .leaf(&format!("transforms[{i}].child_frame_id"), "text", transform.child_frame_id)
                .axes(&format!("transforms[{i}].transform.translation"), &transform.translation)
                .axes(&format!("transforms[{i}].transform.rotation"), &transform.rotation)
        });
        self.send("/tf", &TFMessage { transforms: &transforms }, fields);
    }
}

/// Real numbers of all kinds, never the same twice running.
fn numbers() -> impl FnMut() -> f64 {
    let odd = [0.0, -0.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, f64::MIN_POSITIVE / 4.0, f64::MAX, 0.1];
    let mut count = 0usize;
    move || {
        count += 1;
        if count.is_multiple_of(11) { odd[count / 11 % odd.len()] } else { (count as f64 * 0.7).sin() * 1e3 }
    }
}

#[test]
fn another_reader_finds_every_field_of_every_type() {
    let Some(python) = peer() else { return };
    let folder = tempfile::tempdir().unwrap();
    for (compress, chunk_bytes) in [(true, 5000), (true, 1 << 20), (false, 5000)] {
        let path = folder.path().join("all.mcap");
        let options = McapOptions { compress, chunk_bytes, ..McapOptions::default() };
        let writer = McapWriter::create(&path, &options).unwrap();
        let mut sender = Sender { writer, sent: Vec::new() };
        let mut number = numbers();
        for (row, frame_id) in
            ["", "a", "ab", "abc", "abcd", "base_link", "räder", "odom_2"].iter().cycle().take(40).enumerate()
        {
            let stamp = Time::from_nanoseconds(1_700_000_000_123_456_789 * (row as i64 % 2) + row as i64 - 3).unwrap();
            sender.send_all(Header { stamp, frame_id }, &mut number);
        }
        let Sender { writer, sent } = sender;
        writer.finish().unwrap();
        assert_eq!(sent.len(), 40 * 12);
        let peer_read = read_with_peer(&python, &path);
        assert_eq!(peer_read.len(), sent.len());
        for (peer_read, sent) in peer_read.iter().zip(&sent) {
            assert_eq!(peer_read, sent);
        }
    }
}

#[test]
fn another_reader_finds_an_overlay() {
    let Some(python) = peer() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("overlay.mcap");
    let mut overlay = Overlay::create(&path, &McapOptions::default()).unwrap();
    let names = ["vx".to_owned(), "yaw".to_owned()];
    let series = ["/fleetfoot/predicted", "/fleetfoot/residual"]
        .map(|topic| overlay.joint_state(topic, &names, "base_link").unwrap());
    for series in series {
        for row in 0..100 {
            overlay.row(series, 1_000_000_007 * row, 1_000_000_007 * row + 5, &[row as f64 / 3.0, f64::NAN]).unwrap();
        }
    }
    overlay.finish().unwrap();
    let peer_read = read_with_peer(&python, &path);
    assert_eq!(peer_read.len(), 200);
    for (place, peer_read) in peer_read.iter().enumerate() {
        let row = place as i64 % 100;
        let topic = if place < 100 { "/fleetfoot/predicted" } else { "/fleetfoot/residual" };
        let stamp = Time::from_nanoseconds(1_000_000_007 * row).unwrap();
        let fields = Fields::default()
            .header("", &Header { stamp, frame_id: "base_link" })
            .leaf("name[0]", "text", "vx")
            .leaf("name[1]", "text", "yaw")
            .floats("position", &[row as f64 / 3.0, f64::NAN]);
        let log_time = 1_000_000_007 * row + 5;
        let expected = PeerMessage {
            topic: topic.to_owned(),
            kind: JointState::NAME.to_owned(),
            log_time,
            publish_time: log_time,
            sequence: row as u64,
            fields: fields.0,
        };
        assert_eq!(peer_read, &expected);
    }
}
