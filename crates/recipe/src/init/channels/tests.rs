//! Drafts of channels: roles by names, kinds and motion.

use super::*;

#[test]
fn an_odometry_is_ready_to_be_uncommented() {
    let ends = ["pose.pose.position.x", "pose.pose.position.y", "twist.twist.linear.x", "twist.twist.angular.z"];
    let mut columns: Vec<Column> = ends.iter().map(|end| Column::float(format!("/odom.{end}"))).collect();
    columns.extend(["x", "y", "z", "w"].map(|end| Column::float(format!("/odom.pose.pose.orientation.{end}"))));
    columns.push(Column::float("/odom.pose.covariance[0]"));
    columns.push(Column::float("/joint_states.position[left]"));
    let mut topic = TopicInfo::default();
    (topic.name, topic.type_name, topic.messages) = ("/odom".into(), "nav_msgs/msg/Odometry".into(), Some(9));
    let out = recipe("run.mcap", &columns, &[topic]);
    assert!(Recipe::parse(&out, "starter").unwrap().states.is_empty());
    let uncommented: String = out
        .lines()
        .map(|line| match line.strip_prefix("# ") {
            Some(rest) if ["x =", "y =", "v =", "w =", "yaw ="].iter().any(|name| rest.starts_with(name)) => rest,
            _ => line,
        })
        .flat_map(|line| [line, "\n"])
        .collect();
    let recipe = Recipe::parse(&uncommented, "uncommented").unwrap();
    assert_eq!(recipe.states.keys().collect::<Vec<_>>(), ["x", "y", "yaw", "v", "w"]);
    assert_eq!(recipe.columns["v"], "/odom.twist.twist.linear.x");
    assert_eq!(recipe.columns["yaw"], "yaw(/odom.pose.pose.orientation)");
    assert!(!out.contains("covariance"));
    // The same without a person.
    let mut command = TopicInfo::default();
    (command.name, command.type_name, command.messages) = ("/cmd_vel".into(), "geometry_msgs/msg/Twist".into(), None);
    columns.extend(["linear.x", "linear.y", "angular.z"].map(|end| Column::float(format!("/cmd_vel.{end}"))));
    let mut topic = TopicInfo::default();
    (topic.name, topic.type_name, topic.messages) = ("/odom".into(), "nav_msgs/msg/Odometry".into(), Some(900));
    let drafted = of_odometry(&columns, &[topic, command]).unwrap();
    assert_eq!((&drafted.states, &drafted.columns["yaw"]), (&recipe.states, &recipe.columns["yaw"]));
    let inputs: Vec<Option<String>> = drafted.inputs.values().map(|input| input.table().column).collect();
    assert_eq!(inputs, [Some("/cmd_vel.linear.x".into()), Some("/cmd_vel.angular.z".into())]);
}

#[test]
fn a_flight_has_a_draft_of_rates_and_controls() {
    let mut columns: Vec<Column> =
        (0..3).map(|k| Column::float(format!("/vehicle_angular_velocity.xyz[{k}]"))).collect();
    columns.extend((0..8).map(|k| Column::float(format!("/actuator_controls_0.control[{k}]"))));
    columns.extend((0..400).map(|k| Column::float(format!("/esc_status.esc[{k}].rpm"))));
    let topic = |name: &str| {
        let mut topic = TopicInfo::default();
        (topic.name, topic.type_name, topic.messages) = (name.into(), name[1..].into(), Some(9));
        topic
    };
    let topics = ["/actuator_controls_0", "/esc_status", "/vehicle_angular_velocity"].map(topic);
    let out = recipe("flight.ulg", &columns, &topics);
    let recipe = Recipe::parse(&out, "starter").unwrap();
    assert_eq!(recipe.states.len(), 3, "{out}");
    assert_eq!(recipe.inputs.len(), 4, "{out}");
    let names: Vec<&String> = recipe.states.keys().chain(recipe.inputs.keys()).collect();
    assert!(names.iter().all(|name| recipe.columns.contains_key(*name)), "{out}");
    assert!(out.lines().count() < 80 && out.contains("`fleetfoot init --topic /esc_status` lists them"), "{out}");
}

#[test]
fn ardupilot_draft_has_attitude_rates_and_outputs() {
    let ends =
        |topic: &str, all: &[&str]| all.iter().map(|end| Column::float(format!("{topic}.{end}"))).collect::<Vec<_>>();
    let outputs: Vec<String> = (1..15).map(|channel| format!("C{channel}")).collect();
    let columns: Vec<Column> = [
        ends("/ATT", &["TimeUS", "DesRoll", "Roll", "DesPitch", "Pitch", "DesYaw", "Yaw"]),
        ends("/IMU", &["TimeUS", "GyrX", "GyrY", "GyrZ", "AccX"]),
        ends("/IMU.1", &["TimeUS", "GyrX", "GyrY", "GyrZ", "AccX"]),
        ends("/RCOU", &outputs.iter().map(String::as_str).collect::<Vec<_>>()),
    ]
    .concat();
    let topic = |name: &str| {
        let mut topic = TopicInfo::default();
        (topic.name, topic.type_name, topic.messages) = (name.into(), name[1..].into(), Some(9));
        topic
    };
    let out = recipe("flight.bin", &columns, &["/ATT", "/IMU", "/IMU.1", "/RCOU"].map(topic));
    let draft = Recipe::parse(&out, "starter").unwrap();
    assert_eq!(draft.states.keys().collect::<Vec<_>>(), ["roll", "pitch", "yaw", "p", "q", "r"], "{out}");
    assert_eq!(draft.inputs.keys().collect::<Vec<_>>(), ["u0", "u1", "u2", "u3"], "{out}");
    assert_eq!((&*draft.columns["p"], &*draft.columns["u3"]), ("/IMU.GyrX", "/RCOU.C4"), "{out}");
    let scope = fleetfoot_library::Scope::new(columns.iter().map(|column| column.name.as_str()));
    let roll = Expr::parse(&draft.columns["roll"], &scope).unwrap();
    let mut source = fleetfoot_data::MemorySource::new(vec![Column::float("/ATT.Roll")]);
    source.push_uniform("e", 0.1, vec![vec![90.0]]);
    let view = fleetfoot_library::View::new(&source, &[(Column::float("roll"), roll)]).unwrap();
    let block = fleetfoot_data::Source::read(&view, 0, 0..1, fleetfoot_data::Halo::default()).unwrap();
    assert!((block.core(0)[0] - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
}

/// Of a quaternion that is known by hand: `q = q_yaw q_pitch q_roll` of half angles, w first as PX4 logs it.
#[test]
fn attitude_is_drafted_as_correct_angles() {
    let (roll, pitch, yaw) = (0.3_f64, -0.2_f64, 1.1_f64);
    let ((sr, cr), (sp, cp), (sy, cy)) = ((roll / 2.0).sin_cos(), (pitch / 2.0).sin_cos(), (yaw / 2.0).sin_cos());
    let quaternion = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ];
    let mut columns: Vec<Column> = (0..4).map(|k| Column::float(format!("/vehicle_attitude.q[{k}]"))).collect();
    columns.extend((0..3).map(|k| Column::float(format!("/vehicle_angular_velocity.xyz[{k}]"))));
    columns.extend((0..4).map(|k| Column::float(format!("/actuator_controls_0.control[{k}]"))));
    let topic = |name: &str| {
        let mut topic = TopicInfo::default();
        (topic.name, topic.type_name, topic.messages) = (name.into(), name[1..].into(), Some(9));
        topic
    };
    let topics = ["/vehicle_attitude", "/vehicle_angular_velocity", "/actuator_controls_0"].map(topic);
    let out = recipe("flight.ulg", &columns, &topics);
    let drafted = Recipe::parse(&out, "starter").unwrap();
    assert_eq!(drafted.states.keys().collect::<Vec<_>>(), ["roll", "pitch", "yaw", "p", "q", "r"], "{out}");
    assert_eq!(drafted.inputs.keys().collect::<Vec<_>>(), ["u0", "u1", "u2", "u3"], "{out}");
    let mut source = fleetfoot_data::MemorySource::new(columns[..4].to_vec());
    source.push_uniform("e", 0.1, quaternion.iter().map(|part| vec![*part]).collect());
    let scope = fleetfoot_library::Scope::new(columns.iter().map(|column| column.name.as_str()));
    let angles = ["roll", "pitch", "yaw"]
        .map(|name| (Column::float(name), Expr::parse(&drafted.columns[name], &scope).unwrap()));
    let view = fleetfoot_library::View::new(&source, &angles).unwrap();
    let block = fleetfoot_data::Source::read(&view, 0, 0..1, fleetfoot_data::Halo::default()).unwrap();
    for (at, angle) in [roll, pitch, yaw].into_iter().enumerate() {
        assert!((block.core(at)[0] - angle).abs() < 1e-12, "{}: {}", block.core(at)[0], angle);
    }
    // Known rates of a turn, p = (1, 2, 3) rad/s, against its difference quotient.
    let rates = [1.0, 2.0, 3.0];
    let (p, q, r) = (rates[0], rates[1], rates[2]);
    let step = 1e-6;
    let [w, x, y, z] = quaternion;
    let turned = [
        w - 0.5 * step * (x * p + y * q + z * r),
        x + 0.5 * step * (w * p + y * r - z * q),
        y + 0.5 * step * (w * q + z * p - x * r),
        z + 0.5 * step * (w * r + x * q - y * p),
    ];
    let mut source = fleetfoot_data::MemorySource::new(columns[..4].to_vec());
    source.push_uniform("e", 0.1, turned.iter().map(|part| vec![*part]).collect());
    let view = fleetfoot_library::View::new(&source, &angles).unwrap();
    let block = fleetfoot_data::Source::read(&view, 0, 0..1, fleetfoot_data::Halo::default()).unwrap();
    let known = ["roll", "pitch", "yaw"].map(|name| drafted.states[name].known.clone().unwrap());
    let names = ["roll", "pitch", "yaw", "p", "q", "r"];
    let scope = fleetfoot_library::Scope::new(names);
    let mut source = fleetfoot_data::MemorySource::new(names.map(Column::float).to_vec());
    source.push_uniform("e", 0.1, [roll, pitch, yaw, p, q, r].map(|value| vec![value]).to_vec());
    let equations: Vec<(Column, Expr)> =
        known.iter().map(|text| (Column::float(text), Expr::parse(text, &scope).unwrap())).collect();
    let view = fleetfoot_library::View::new(&source, &equations).unwrap();
    let slopes = fleetfoot_data::Source::read(&view, 0, 0..1, fleetfoot_data::Halo::default()).unwrap();
    for (at, angle) in [roll, pitch, yaw].into_iter().enumerate() {
        let quotient = (block.core(at)[0] - angle) / step;
        assert!((quotient - slopes.core(at)[0]).abs() < 1e-4, "{}: {quotient}, {}", known[at], slopes.core(at)[0]);
    }
}

#[test]
fn two_odometries_and_two_commands_share_no_name() {
    let ends = ["pose.pose.position.x", "pose.pose.position.y", "twist.twist.linear.x", "twist.twist.angular.z"];
    let quaternion = ["x", "y", "z", "w"].map(|end| format!("pose.pose.orientation.{end}"));
    let of_odometry = |topic: &str| {
        let names = ends.iter().map(ToString::to_string).chain(quaternion.clone());
        names.map(|end| Column::float(format!("{topic}.{end}"))).collect::<Vec<_>>()
    };
    let mut columns = [of_odometry("/odom"), of_odometry("/wheel/odom")].concat();
    columns.extend(["/a/cmd_vel.linear.x", "/b/cmd_vel.linear.x", "/scan.2d"].map(Column::float));
    let topic = |name: &str, kind: &str| {
        let mut topic = TopicInfo::default();
        (topic.name, topic.type_name, topic.messages) = (name.into(), kind.into(), Some(9));
        topic
    };
    let odometry = "nav_msgs/msg/Odometry";
    let topics = [
        topic("/odom", odometry),
        topic("/wheel/odom", odometry),
        topic("/a/cmd_vel", "Twist"),
        topic("/b/cmd_vel", "Twist"),
        topic("/scan", "Scan"),
    ];
    let out = recipe("run.mcap", &columns, &topics);
    let is_line =
        |line: &&str| line.strip_prefix("# ").is_some_and(|rest| rest.contains(" = ") && !rest.starts_with(' '));
    let section = |from: &str, to: &str| {
        let text = &out[out.find(from).unwrap()..out.find(to).unwrap()];
        text.lines().filter(is_line).fold(format!("{from}\n"), |all, line| format!("{all}{}\n", &line[2..]))
    };
    let names = Recipe::parse(&section("[columns]", "# all fields of a kind"), "columns").unwrap();
    assert_eq!(names.columns["x_2"], "/wheel/odom.pose.pose.position.x");
    assert_eq!(names.columns["_2d"], "/scan.2d");
    let states = Recipe::parse(&section("[states]", "# Inputs:"), "states").unwrap();
    assert_eq!(states.states["x_2"].known.as_deref(), Some("v_2*cos(yaw_2)"));
    let inputs = Recipe::parse(&section("[inputs]", "# One clock"), "inputs").unwrap();
    assert_eq!(inputs.inputs.keys().collect::<Vec<_>>(), ["u0", "u1"]);
}
