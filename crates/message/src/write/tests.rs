//! Messages read back by their definitions: a reader of CDR's rules and the text finds the written fields, in order,
//! and nothing after them.

use std::collections::HashMap;

use super::*;

/// A field's value.
#[derive(Debug, Clone, PartialEq)]
enum Leaf {
    Number(f64),
    Text(String),
}

fn number(value: impl Into<f64>) -> Leaf {
    Leaf::Number(value.into())
}

fn text(value: &str) -> Leaf {
    Leaf::Text(value.to_owned())
}

/// Types by `package/Name`, each a list of (type, name).
type Types = HashMap<String, Vec<(String, String)>>;

fn full_name(package: &str, name: &str) -> String {
    let name = name.replace("/msg/", "/");
    if name.contains('/') { name } else { format!("{package}/{name}") }
}

fn types<M: Message>() -> Types {
    let rule = format!("\n{}\nMSG: ", "=".repeat(80));
    let root = format!("{}\n{}", full_name("", M::NAME), M::SCHEMA);
    let rest = root.split(&rule).map(str::to_owned).collect::<Vec<_>>();
    let mut types = Types::new();
    for part in rest {
        let (name, fields) = part.split_once('\n').unwrap();
        let mut list = Vec::new();
        for line in fields.lines() {
            let words: Vec<&str> = line.split(' ').collect();
            assert!(words.len() == 2 || words.len() == 3, "{line:?} in {name}");
            list.push((words[0].to_owned(), words[1].to_owned()));
        }
        assert!(fields.ends_with('\n') && !list.is_empty(), "{name}");
        assert!(types.insert(name.to_owned(), list).is_none(), "{name} twice");
    }
    types
}

/// Reads with every value aligned to its size after the four bytes of the encapsulation.
struct Reader<'a> {
    types: &'a Types,
    bytes: &'a [u8],
    at: usize,
    leaves: Vec<(String, Leaf)>,
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        while !self.at.is_multiple_of(N) {
            assert_eq!(self.bytes[self.at], 0, "padding at {}", self.at);
            self.at += 1;
        }
        self.at += N;
        self.bytes[self.at - N..self.at].try_into().unwrap()
    }

    fn read(&mut self, package: &str, kind: &str, path: &str) {
        if let Some((element, length)) = kind.strip_suffix(']').and_then(|kind| kind.split_once('[')) {
            let length = length.parse().unwrap_or_else(|_| u32::from_le_bytes(self.take()));
            for index in 0..length {
                self.read(package, element, &format!("{path}[{index}]"));
            }
            return;
        }
        let leaf = match kind {
            "bool" => number(self.take::<1>()[0]),
            "int32" => number(i32::from_le_bytes(self.take())),
            "uint32" => number(u32::from_le_bytes(self.take())),
            "float64" => number(f64::from_le_bytes(self.take())),
            "string" => {
                let length = u32::from_le_bytes(self.take()) as usize;
                let bytes = &self.bytes[self.at..self.at + length];
                self.at += length;
                let (zero, bytes) = bytes.split_last().unwrap();
                assert_eq!(*zero, 0);
                text(std::str::from_utf8(bytes).unwrap())
            }
            _ => {
                let name = full_name(package, kind);
                let package = name.split('/').next().unwrap();
                let fields = self.types.get(&name).unwrap_or_else(|| panic!("{name} is not defined"));
                for (kind, field) in fields {
                    self.read(package, kind, &if path.is_empty() { field.clone() } else { format!("{path}.{field}") });
                }
                return;
            }
        };
        self.leaves.push((path.to_owned(), leaf));
    }
}

/// The fields of a message, and the assurance that its definition says all about it and no more.
fn read_back<M: Message>(message: &M) -> Vec<(String, Leaf)> {
    let types = types::<M>();
    let mut bytes = b"what was there before".to_vec();
    message.encode(&mut bytes);
    assert_eq!(bytes[..4], [0, 1, 0, 0]);
    let mut reader = Reader { types: &types, bytes: &bytes[4..], at: 0, leaves: Vec::new() };
    reader.read("", &full_name("", M::NAME), "");
    assert_eq!(reader.at, reader.bytes.len(), "{} has bytes that its definition does not explain", M::NAME);
    reader.leaves
}

fn expect<M: Message>(message: &M, expected: &[(&str, Leaf)]) {
    let message_read = read_back(message);
    let expected: Vec<_> = expected.iter().map(|(path, leaf)| ((*path).to_owned(), leaf.clone())).collect();
    assert_eq!(message_read, expected, "{}", M::NAME);
}

/// Consecutive numbers, so that a field in the wrong place shows.
fn from<const N: usize>(start: u32) -> [f64; N] {
    std::array::from_fn(|index| f64::from(start) + index as f64 + 0.25)
}

/// The leaves of `count` numbers from [`from`] at `path[0]`, `path[1]` ...
fn list(path: &str, start: u32, count: u32) -> Vec<(String, Leaf)> {
    (0..count).map(|index| (format!("{path}[{index}]"), number(f64::from(start + index) + 0.25))).collect()
}

fn xyz(path: &str, axes: &str, start: u32) -> Vec<(String, Leaf)> {
    axes.chars().zip(start..).map(|(axis, value)| (format!("{path}.{axis}"), number(f64::from(value) + 0.25))).collect()
}

const STAMP: Time = Time { sec: 1_700_000_000, nanosec: 999_999_999 };

/// Every length of the frame's name, so that all paddings occur.
const FRAMES: [&str; 9] = ["", "a", "ab", "abc", "abcd", "abcde", "abcdef", "abcdefg", "räder"];

fn header(path: &str, frame: &str) -> Vec<(String, Leaf)> {
    vec![
        (format!("{path}header.stamp.sec"), number(1_700_000_000)),
        (format!("{path}header.stamp.nanosec"), number(999_999_999)),
        (format!("{path}header.frame_id"), text(frame)),
    ]
}

#[test]
fn bare_numbers() {
    expect(&Float64 { data: -2.5 }, &[("data", number(-2.5))]);
    expect(&Bool { data: true }, &[("data", number(1))]);
    expect(&Bool { data: false }, &[("data", number(0))]);
    let twist = Twist { linear: from(1), angular: from(4) };
    assert_eq!(read_back(&twist), [xyz("linear", "xyz", 1), xyz("angular", "xyz", 4)].concat());
}

#[test]
fn arrays_with_and_without_dimensions() {
    expect(&Float64MultiArray::default(), &[("layout.data_offset", number(0))]);
    let dim = [
        MultiArrayDimension { label: "rows", size: 2, stride: 6 },
        MultiArrayDimension { label: "of", size: 3, stride: 3 },
    ];
    let data: [f64; 6] = from(0);
    let message_read = read_back(&Float64MultiArray { dim: &dim, data_offset: 7, data: &data });
    let mut expected = vec![
        ("layout.dim[0].label".to_owned(), text("rows")),
        ("layout.dim[0].size".to_owned(), number(2)),
        ("layout.dim[0].stride".to_owned(), number(6)),
        ("layout.dim[1].label".to_owned(), text("of")),
        ("layout.dim[1].size".to_owned(), number(3)),
        ("layout.dim[1].stride".to_owned(), number(3)),
        ("layout.data_offset".to_owned(), number(7)),
    ];
    expected.extend(list("data", 0, 6));
    assert_eq!(message_read, expected);
}

#[test]
fn stamped_vectors_after_frames_of_any_length() {
    for frame in FRAMES {
        let stamped = Header { stamp: STAMP, frame_id: frame };
        let message = Vector3Stamped { header: stamped, vector: from(1) };
        assert_eq!(read_back(&message), [header("", frame), xyz("vector", "xyz", 1)].concat());
        let message = WrenchStamped { header: stamped, force: from(1), torque: from(4) };
        let parts = [header("", frame), xyz("wrench.force", "xyz", 1), xyz("wrench.torque", "xyz", 4)];
        assert_eq!(read_back(&message), parts.concat());
        let message = TwistStamped { header: stamped, twist: Twist { linear: from(1), angular: from(4) } };
        let parts = [header("", frame), xyz("twist.linear", "xyz", 1), xyz("twist.angular", "xyz", 4)];
        assert_eq!(read_back(&message), parts.concat());
        let message = PoseStamped { header: stamped, pose: Pose { position: from(1), orientation: from(4) } };
        let parts = [header("", frame), xyz("pose.position", "xyz", 1), xyz("pose.orientation", "xyzw", 4)];
        assert_eq!(read_back(&message), parts.concat());
    }
}

#[test]
fn odometry_and_inertial_units() {
    for frame in FRAMES {
        let stamped = Header { stamp: STAMP, frame_id: frame };
        let message = Odometry {
            header: stamped,
            child_frame_id: "base",
            pose: Pose { position: from(1), orientation: from(4) },
            pose_covariance: from(100),
            twist: Twist { linear: from(8), angular: from(11) },
            twist_covariance: from(200),
        };
        let expected = [
            header("", frame),
            vec![("child_frame_id".to_owned(), text("base"))],
            xyz("pose.pose.position", "xyz", 1),
            xyz("pose.pose.orientation", "xyzw", 4),
            list("pose.covariance", 100, 36),
            xyz("twist.twist.linear", "xyz", 8),
            xyz("twist.twist.angular", "xyz", 11),
            list("twist.covariance", 200, 36),
        ];
        assert_eq!(read_back(&message), expected.concat());
        let message = Imu {
            header: stamped,
            orientation: from(1),
            orientation_covariance: from(20),
            angular_velocity: from(5),
            angular_velocity_covariance: from(40),
            linear_acceleration: from(8),
            linear_acceleration_covariance: from(60),
        };
        let expected = [
            header("", frame),
            xyz("orientation", "xyzw", 1),
            list("orientation_covariance", 20, 9),
            xyz("angular_velocity", "xyz", 5),
            list("angular_velocity_covariance", 40, 9),
            xyz("linear_acceleration", "xyz", 8),
            list("linear_acceleration_covariance", 60, 9),
        ];
        assert_eq!(read_back(&message), expected.concat());
    }
}

#[test]
fn light() {
    for frame in FRAMES {
        let message =
            Illuminance { header: Header { stamp: STAMP, frame_id: frame }, illuminance: 400.5, variance: 0.25 };
        let values = [("illuminance".to_owned(), number(400.5)), ("variance".to_owned(), number(0.25))];
        assert_eq!(read_back(&message), [header("", frame), values.to_vec()].concat());
    }
}

#[test]
fn joints_and_frames() {
    for frame in FRAMES {
        let stamped = Header { stamp: STAMP, frame_id: frame };
        let (position, effort): ([f64; 2], [f64; 2]) = (from(1), from(5));
        let message = JointState {
            header: stamped,
            name: &["left_crank", frame],
            position: &position,
            velocity: &[],
            effort: &effort,
        };
        let names = vec![("name[0]".to_owned(), text("left_crank")), ("name[1]".to_owned(), text(frame))];
        let expected = [header("", frame), names, list("position", 1, 2), list("effort", 5, 2)];
        assert_eq!(read_back(&message), expected.concat());
        let transforms = [
            TransformStamped { header: stamped, child_frame_id: "base", translation: from(1), rotation: from(4) },
            TransformStamped { header: stamped, child_frame_id: frame, translation: from(8), rotation: from(11) },
        ];
        let expected = [
            header("transforms[0].", frame),
            vec![("transforms[0].child_frame_id".to_owned(), text("base"))],
            xyz("transforms[0].transform.translation", "xyz", 1),
            xyz("transforms[0].transform.rotation", "xyzw", 4),
            header("transforms[1].", frame),
            vec![("transforms[1].child_frame_id".to_owned(), text(frame))],
            xyz("transforms[1].transform.translation", "xyz", 8),
            xyz("transforms[1].transform.rotation", "xyzw", 11),
        ];
        assert_eq!(read_back(&TFMessage { transforms: &transforms }), expected.concat());
    }
    expect(&TFMessage::default(), &[]);
}

/// Bytes written down by hand from the rules, so that writer and reader above cannot share a mistake.
#[test]
fn the_bytes_of_a_joint_state() {
    let message = JointState {
        header: Header { stamp: Time { sec: 1, nanosec: 2 }, frame_id: "" },
        name: &["ab"],
        position: &[1.0],
        velocity: &[],
        effort: &[],
    };
    let mut bytes = Vec::new();
    message.encode(&mut bytes);
    #[rustfmt::skip]
    let expected = [
        0, 1, 0, 0,
        1, 0, 0, 0,  2, 0, 0, 0,              // stamp
        1, 0, 0, 0,  0,  0, 0, 0,             // frame_id: the zero, padding to 4
        1, 0, 0, 0,                           // one name
        3, 0, 0, 0,  b'a', b'b', 0,  0,       // its length, text, padding to 4
        1, 0, 0, 0,                           // one position: ends at 32, no padding to 8
        0, 0, 0, 0, 0, 0, 0xf0, 0x3f,         // 1.0
        0, 0, 0, 0,  0, 0, 0, 0,              // no velocity, no effort, nothing aligned for them
    ];
    assert_eq!(bytes, expected);
}

#[test]
fn stamps_before_1970_round_down() {
    let time = |sec, nanosec| Some(Time { sec, nanosec });
    assert_eq!(Time::from_nanoseconds(0), time(0, 0));
    assert_eq!(Time::from_nanoseconds(1_700_000_000_999_999_999), time(1_700_000_000, 999_999_999));
    assert_eq!(Time::from_nanoseconds(-1), time(-1, 999_999_999));
    assert_eq!(Time::from_nanoseconds(-1_700_000_000), time(-2, 300_000_000));
    let end = (i64::from(i32::MAX) + 1) * 1_000_000_000;
    assert_eq!(Time::from_nanoseconds(end - 1), time(i32::MAX, 999_999_999));
    assert_eq!(Time::from_nanoseconds(end), None);
    let start = i64::from(i32::MIN) * 1_000_000_000;
    assert_eq!(Time::from_nanoseconds(start), time(i32::MIN, 0));
    assert_eq!(Time::from_nanoseconds(start - 1), None);
    assert_eq!(Time::from_nanoseconds(i64::MIN), None);
    assert_eq!(Time::from_nanoseconds(i64::MAX), None);
}
