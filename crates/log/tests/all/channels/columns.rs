//! All messages of a topic as columns.

use fleetfoot_data::{ColumnKind, Silent};
use fleetfoot_log::Messages;
use fleetfoot_message::write::{Float64, Odometry};

use super::logs::{Log, MILLISECOND, START, stamped, usual};

#[test]
fn columns_are_the_messages_one_by_one() {
    let log = usual();
    let messages = Messages::open(&log.path).unwrap();
    let columns = messages.columns("/odom", None, &Silent).unwrap();
    assert!(columns.notes.is_empty(), "{:?}", columns.notes);
    let fields = messages.fields("/odom", &Silent).unwrap();
    let names: Vec<&str> = columns.fields.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(names, fields.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>());
    assert!(names.contains(&"twist.twist.linear.x") && names.contains(&"pose.covariance[35]"));
    let mut row = 0;
    messages
        .read("/odom", &names, &Silent, |message| {
            assert_eq!(columns.log_time[row], message.log_time);
            assert_eq!(columns.publish_time[row], message.publish_time);
            assert_eq!(columns.header_stamp[row], message.header_stamp.unwrap());
            for (field, &value) in columns.fields.iter().zip(message.values) {
                if !matches!(field.kind, ColumnKind::Category(_)) {
                    assert_eq!(field.values[row].to_bits(), value.to_bits(), "{} in row {row}", field.name);
                }
            }
            row += 1;
            Ok(())
        })
        .unwrap();
    assert_eq!((row, columns.log_time.len()), (80, 80));
}

#[test]
fn texts_are_numbered_over_all_pieces_of_the_file() {
    let mut log = Log::with_chunks(256);
    let name = |k: i64| ["base", "tool", "left wheel"][(k * k % 7 % 3) as usize];
    for k in 0..60 {
        let header = stamped(START + k);
        let message = Odometry { header, child_frame_id: name(k), ..Odometry::default() };
        log.write("/odom", START + k * MILLISECOND, &message);
    }
    log.announce::<Float64>("/quiet");
    let log = log.finish();
    let messages = Messages::open(&log.path).unwrap();
    let wanted = ["child_frame_id".to_owned()];
    let columns = messages.columns("/odom", Some(&wanted), &Silent).unwrap();
    let ColumnKind::Category(names) = &columns.fields[0].kind else { panic!("{:?}", columns.fields[0].kind) };
    let texts: Vec<&str> = columns.fields[0].values.iter().map(|&code| names[code as usize].as_str()).collect();
    assert_eq!(texts, (0..60).map(name).collect::<Vec<_>>());
    let quiet = messages.columns("/quiet", None, &Silent).unwrap();
    assert!(quiet.log_time.is_empty() && quiet.fields.is_empty());
    let none = messages.columns("/odom", Some(&[]), &Silent).unwrap();
    assert_eq!((none.log_time.len(), none.fields.len()), (60, 0));
    for (topic, field) in [("/odm", "child_frame_id"), ("/odom", "child_fram_id")] {
        let message = messages.columns(topic, Some(&[field.to_owned()]), &Silent).unwrap_err().to_string();
        assert!(message.contains("run.mcap") && message.contains(topic), "{message}");
    }
}
