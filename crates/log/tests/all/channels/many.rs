//! Logs of very many topics.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

use fleetfoot_log::{inspect, inspect_values};
use mcap::{WriteOptions, Writer, records::MessageHeader};

/// Topics of one message each. What grew with their square took more than ten minutes of so many.
const TOPICS: u16 = 20_000;

/// A linear reader takes seconds, on a machine that others share too.
const SOON: Duration = Duration::from_secs(90);

#[test]
fn a_log_of_many_topics_takes_time_by_their_number() {
    let folder = tempfile::tempdir().unwrap();
    for (name, options) in [
        ("chunks", WriteOptions::new().chunk_size(Some(1 << 16))),
        ("no index", WriteOptions::new().chunk_size(Some(1 << 16)).emit_message_indexes(false)),
        ("no chunks", WriteOptions::new().use_chunks(false)),
    ] {
        let path = folder.path().join("many.mcap");
        let mut writer = Writer::with_options(std::fs::File::create(&path).unwrap(), options).unwrap();
        let schema = writer.add_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n").unwrap();
        for topic in 0..TOPICS {
            let channel_id = writer.add_channel(schema, &format!("/t{topic}"), "cdr", &BTreeMap::new()).unwrap();
            let time = 1_000_000 * u64::from(topic);
            let header = MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
            let data = [&[0, 1, 0, 0][..], &f64::from(topic).to_le_bytes()].concat();
            writer.write_to_known_channel(&header, &data).unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        let begin = Instant::now();
        let info = inspect(&path).unwrap();
        assert_eq!((info.topics.len(), info.columns.len()), (usize::from(TOPICS), usize::from(TOPICS)), "{name}");
        let info = inspect_values(&path, &fleetfoot_data::Silent).unwrap();
        let largest = info.columns.iter().filter_map(|column| column.statistics.as_ref()).map(|known| known.max);
        assert_eq!(largest.fold(0.0, f64::max), f64::from(TOPICS - 1), "{name}");
        assert!(begin.elapsed() < SOON, "{name}: {:?}", begin.elapsed());
    }
}
