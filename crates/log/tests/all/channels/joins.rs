//! Values in the rows: joins by kind, arrays by name, other names, the base.

use std::f64::consts::PI;

use fleetfoot_data::{ColumnKind, Source};
use fleetfoot_log::{Base, ColumnJoin, JoinKind, MaxGap, Selection, Stamp};
use fleetfoot_message::write::{Bool, Float64, JointState, Odometry, Pose, TFMessage, TransformStamped};

use super::logs::{Log, MILLISECOND, START, near, seconds, stamped, turned, usual, whole, wrapped};

fn kind(kind: JoinKind) -> ColumnJoin {
    ColumnJoin { kind: Some(kind), ..ColumnJoin::default() }
}

#[test]
fn every_kind_gives_the_closed_form() {
    let log = usual();
    let mut selection =
        Selection::new(["/odom.pose.pose.position.x", "/force.vector.x", "/force.vector.y", "/force.vector.z"]);
    selection.join.columns = [("/force.vector.y", JoinKind::Angle), ("/force.vector.z", JoinKind::Hold)]
        .map(|(name, expected_kind)| (name.into(), kind(expected_kind)))
        .into();
    let rows = whole(&log.open(&selection));
    let mut wraps = 0;
    for (row, &stamp) in rows.stamps.iter().enumerate() {
        let t = seconds(stamp);
        near(rows.columns[0][row], 1.0 + 2.0 * t);
        near(rows.columns[1][row], -4.0 * t);
        let off = wrapped(rows.columns[2][row] - 3.0 * t);
        assert!(off.abs() < 1e-9 && rows.columns[2][row].abs() <= PI, "{t}: {}", rows.columns[2][row]);
        wraps += usize::from(row > 0 && (rows.columns[2][row] - rows.columns[2][row - 1]).abs() > PI);
        // The last sample at or before, every 20 ms.
        let held = ((stamp - START) / (20 * MILLISECOND) * 20) as f64 / 1e3;
        assert_eq!(rows.columns[3][row], held * held);
    }
    assert_eq!((rows.stamps.len(), wraps), (80, 2));
}

#[test]
fn rotations_interpolate_on_the_great_arc() {
    let mut log = Log::new();
    for k in 0..400 {
        let at = START + k * 10 * MILLISECOND;
        if k % 5 == 0 {
            log.force(at, at, at);
        }
        if k % 8 == 3 {
            let sign = if k % 3 == 0 { -1.0 } else { 1.0 };
            let orientation = turned(3.0 * seconds(at)).map(|part| sign * part);
            let pose = Pose { orientation, ..Pose::default() };
            log.write("/odom", at, &Odometry { header: stamped(at), pose, ..Odometry::default() });
        }
    }
    let names = ["x", "y", "z", "w"].map(|part| format!("/odom.pose.pose.orientation.{part}"));
    let mut selection = Selection::new(["/force.vector.x".to_owned()].into_iter().chain(names));
    let log = log.finish();
    let rows = whole(&log.open(&selection));
    let mut before: Option<[f64; 4]> = None;
    for (row, &stamp) in rows.stamps.iter().enumerate() {
        let q = [1, 2, 3, 4].map(|column| rows.columns[column][row]);
        let t = seconds(stamp);
        if !(0.03..=3.95).contains(&t) {
            assert!(q.iter().all(|part| part.is_nan()), "{t}: never beyond the samples");
            continue;
        }
        let truth = turned(3.0 * t);
        let dot = |a: [f64; 4], b: [f64; 4]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        near(dot(q, truth).abs(), 1.0);
        near(dot(q, q), 1.0);
        match before {
            Some(before) => assert!(dot(before, q) > 0.0, "{t}: the sign leaps"),
            None => assert!(q[3] >= 0.0),
        }
        before = Some(q);
    }
    assert!(before.is_some());
    selection.columns.retain(|name| !name.contains("orientation") || name.ends_with('w'));
    let alone = whole(&log.open(&selection));
    let bits = |column: &[f64]| column.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&alone.columns[1]), bits(&rows.columns[4]), "one component alone comes out the same");
}

#[test]
fn latched_topic_holds_without_max_gap() {
    let mut log = Log::new();
    log.write("/friction", START, &Float64 { data: 0.75 });
    log.drive(|_, at| Some((at, at + 2 * MILLISECOND)));
    let log = log.finish();
    let mut selection = Selection::new(["/odom.twist.twist.linear.x", "/friction.data"]);
    let held = |max_gap| [("/friction.data".to_owned(), ColumnJoin { kind: Some(JoinKind::Hold), max_gap })].into();
    selection.join.columns = held(MaxGap::Unlimited);
    let rows = whole(&log.open(&selection));
    assert_eq!((rows.stamps.len(), rows.stamps[0]), (80, START + 2 * MILLISECOND));
    assert!(rows.columns[1].iter().all(|&value| value == 0.75));
    // Without that, a value is not known after the last sample, which here comes before the first row.
    for columns in [held(MaxGap::Seconds(10.0)), held(MaxGap::Auto)] {
        selection.join.columns = columns;
        let message = log.refusal(&selection);
        assert!(message.contains("/friction") && message.contains("do not overlap"), "{message}");
    }
}

fn joints() -> Log {
    let mut log = Log::new();
    for k in 0..100 {
        let at = START + k * 20 * MILLISECOND;
        let t = seconds(at);
        let joints_sent = [("left", t), ("right", -t), ("arm.lift", 5.0 * t), ("7", 7.0)];
        let mut joints_sent: Vec<(&str, f64)> =
            joints_sent.into_iter().filter(|(name, _)| k % 5 != 4 || *name != "arm.lift").collect();
        if k % 3 == 0 {
            joints_sent.reverse();
        }
        let (name, position): (Vec<&str>, Vec<f64>) = joints_sent.into_iter().unzip();
        let message =
            JointState { header: stamped(at), name: &name, position: &position, velocity: &position, effort: &[] };
        log.write("/joint_states", at, &message);
    }
    log
}

#[test]
fn joints_are_matched_by_name() {
    let log = joints().finish();
    let names = ["left", "right", "arm.lift"].map(|joint| format!("/joint_states.position[{joint}]"));
    let rows = whole(&log.open(&Selection::new(names)));
    assert_eq!(rows.stamps.len(), 100, "the rows are the samples of the first column's joint");
    for (row, &stamp) in rows.stamps.iter().enumerate() {
        let t = seconds(stamp);
        assert_eq!((rows.columns[0][row], rows.columns[1][row]), (t, -t));
        // A message without the joint is no sample of it: the joint's neighbours count.
        if row < 99 {
            near(rows.columns[2][row], 5.0 * t);
        } else {
            assert!(rows.columns[2][row].is_nan(), "never beyond the last sample");
        }
    }
    let rows = whole(&log.open(&Selection::new(["/joint_states.position[arm.lift]", "/joint_states.velocity[left]"])));
    assert_eq!(rows.stamps.len(), 80);
    assert_eq!(rows.columns[1][0], 0.0);
    let message = log.refusal(&Selection::new(["/joint_states.position[arm.lft]"]));
    assert!(message.contains("position[arm.lft]") && message.contains("position[arm.lift]"), "{message}");
}

#[test]
fn transforms_go_by_child_frame() {
    let mut log = Log::new();
    for k in 0..100 {
        let at = START + k * 20 * MILLISECOND;
        let t = seconds(at);
        let frame = |child_frame_id: &'static str, x: f64, late: i64| TransformStamped {
            header: stamped(at + late),
            child_frame_id,
            translation: [x, 0.0, 0.0],
            rotation: turned(t),
        };
        let mut transforms = vec![frame("base_link", t, 0), frame("laser", 10.0 + t, 1)];
        if k % 4 == 0 {
            transforms.insert(0, frame("odom", 20.0, 2));
        }
        if k % 2 == 1 {
            transforms.remove(0);
        }
        log.write("/tf", at, &TFMessage { transforms: &transforms });
    }
    let log = log.finish();
    let name = |frame: &str| format!("/tf.transforms[{frame}].transform.translation.x");
    let rows = whole(&log.open(&Selection::new([name("base_link"), name("laser")])));
    assert_eq!(rows.stamps.len(), 50);
    for (row, &stamp) in rows.stamps.iter().enumerate() {
        assert_eq!(stamp, START + row as i64 * 40 * MILLISECOND);
        assert_eq!(rows.columns[0][row], seconds(stamp));
        if row > 0 {
            near(rows.columns[1][row], 10.0 + seconds(stamp - 1));
        }
    }
    let rows = whole(&log.open(&Selection::new([name("laser")])));
    assert_eq!(
        (rows.stamps.len(), rows.stamps[1]),
        (100, START + 20 * MILLISECOND + 1),
        "each frame has its own stamp"
    );
    let message = log.refusal(&Selection::new([name("lasr")]));
    assert!(message.contains("transforms[lasr]") && message.contains("transforms[laser]"), "{message}");
}

#[test]
fn topics_and_namespaces_go_by_other_names() {
    let mut log = Log::new();
    for k in 0..50 {
        log.write("/robot2/speed", START + k * MILLISECOND, &Float64 { data: k as f64 });
        log.write("/robot2/arm/lift", START + k * MILLISECOND, &Float64 { data: -k as f64 });
    }
    let log = log.finish();
    let direct = whole(&log.open(&Selection::new(["/robot2/speed.data", "/robot2/arm/lift.data"])));
    assert_eq!((direct.columns[0][9], direct.columns[1][9]), (9.0, -9.0));
    let mut selection = Selection::new(["/speed.data", "/arm/lift.data"]);
    let message = log.refusal(&selection);
    assert!(message.contains("/speed.data") && message.contains("/robot2/speed"), "{message}");
    let pair = |ours: &str, file: &str| (ours.to_owned(), file.to_owned());
    for renames in [
        vec![pair("/speed", "/robot2/speed"), pair("/arm/lift", "/robot2/arm/lift")],
        vec![pair("/", "/robot2/")],
        vec![pair("/speed", "/robot2/speed"), pair("/arm/", "/robot2/arm/")],
    ] {
        selection.join.renames = renames;
        let recording = log.open(&selection);
        let names: Vec<&str> = recording.columns().iter().map(|column| column.name.as_str()).collect();
        assert_eq!(names, ["/speed.data", "/arm/lift.data"]);
        let rows = whole(&recording);
        assert_eq!((rows.stamps, rows.columns), (direct.stamps.clone(), direct.columns.clone()));
    }
}

#[test]
fn texts_are_categories_and_hold() {
    let mut log = Log::new();
    let frames = ["walk", "halt", "walk", "räder"];
    for k in 0..40 {
        let at = START + k * 100 * MILLISECOND;
        let child_frame_id = frames[k as usize / 10];
        log.write("/odom", at, &Odometry { header: stamped(at), child_frame_id, ..Odometry::default() });
        log.write("/contact", at + 50 * MILLISECOND, &Bool { data: k % 2 == 0 });
    }
    let mut selection = Selection::new(["/contact.data", "/odom.child_frame_id"]);
    selection.join.stamp = Some(Stamp::Log);
    // A text has no line to its neighbour, whatever is asked.
    let linear = ColumnJoin { kind: Some(JoinKind::Linear), ..ColumnJoin::default() };
    selection.join.columns.insert("/odom.child_frame_id".into(), linear);
    let recording = log.finish().open(&selection);
    assert_eq!(recording.columns()[0].kind, ColumnKind::Boolean);
    assert_eq!(recording.columns()[1].kind, ColumnKind::Category(["halt", "räder", "walk"].map(String::from).to_vec()));
    let rows = whole(&recording);
    for row in 0..39 {
        assert_eq!(rows.columns[0][row], f64::from(u8::from(row % 2 == 0)));
        assert_eq!(recording.columns()[1].label(rows.columns[1][row]), frames[row / 10]);
    }
}

#[test]
fn rows_come_at_a_rate_or_from_any_topic() {
    let log = usual();
    let mut selection = Selection::new(["/odom.pose.pose.position.x", "/force.vector.x"]);
    selection.join.base = Some(Base::Rate(80.0));
    let rows = whole(&log.open(&selection));
    // Both last from 0 s; odometry ends first, at 3.95 s.
    assert_eq!(rows.stamps.len(), 317);
    for (row, &stamp) in rows.stamps.iter().enumerate() {
        assert_eq!(stamp, START + row as i64 * 12_500_000);
        near(rows.columns[0][row], 1.0 + 2.0 * seconds(stamp));
        near(rows.columns[1][row], -4.0 * seconds(stamp));
    }
    let mut selection = Selection::new(["/odom.pose.pose.position.x"]);
    selection.join.base = Some(Base::Channel("/force".into()));
    let rows = whole(&log.open(&selection));
    assert_eq!((rows.stamps.len(), rows.columns.len()), (200, 1));
    for (row, &stamp) in rows.stamps.iter().enumerate() {
        assert_eq!(stamp, START + row as i64 * 20 * MILLISECOND);
        let t = seconds(stamp);
        if t <= 3.95 { near(rows.columns[0][row], 1.0 + 2.0 * t) } else { assert!(rows.columns[0][row].is_nan()) }
    }
}
