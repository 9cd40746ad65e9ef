//! Computed columns as messages that viewers draw over the recording they were computed from.

use std::path::PathBuf;

use fleetfoot_message::write::{Header, JointState, Time};

use crate::{
    error::Error,
    mcap_writer::{ChannelId, McapOptions, McapWriter},
};

/// Writes named numbers with stamps into an MCAP file.
///
/// A row is a `sensor_msgs/msg/JointState`, the one well-known type with a stamp and names beside numbers. Viewers that
/// know it show the position of `vx` on the topic `/fleetfoot/predicted` as `/fleetfoot/predicted/vx/position`.
/// Dropping it before [`Overlay::finish`] leaves no file.
#[derive(Debug)]
pub struct Overlay {
    writer: McapWriter,
    series: Vec<Named>,
}

/// A topic of an [`Overlay`] with names for its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SeriesId(usize);

#[derive(Debug)]
struct Named {
    channel: ChannelId,
    names: Vec<String>,
    frame: String,
}

impl Overlay {
    /// Begins a file.
    ///
    /// # Errors
    /// A target that is one of the inputs, a folder, or in a folder that is not there.
    pub fn create(path: impl Into<PathBuf>, options: &McapOptions) -> Result<Self, Error> {
        Ok(Self { writer: McapWriter::create(path, options)?, series: Vec::new() })
    }

    /// Numbers called `names` on `topic`, in the coordinate frame `frame` (may be empty).
    ///
    /// # Errors
    /// A topic without a name; too many topics; refusals of the system.
    pub fn joint_state(&mut self, topic: &str, names: &[String], frame: &str) -> Result<SeriesId, Error> {
        let channel = self.writer.channel::<JointState<'_>>(topic)?;
        let series = SeriesId(self.series.len());
        self.series.push(Named { channel, names: names.to_vec(), frame: frame.to_owned() });
        Ok(series)
    }

    /// Appends one number a name. `stamp` is the header's, `log_time` places the row in the file: give those of the recorded message that the
    /// row belongs to. Both are nanoseconds since 1970.
    ///
    /// # Errors
    /// Another number of values than names; a stamp that ROS or MCAP cannot hold; refusals of the system.
    pub fn row(&mut self, series: SeriesId, stamp: i64, log_time: i64, values: &[f64]) -> Result<(), Error> {
        let Some(Named { channel, names, frame }) = self.series.get(series.0) else {
            return Err(self.writer.misuse("a series of another file".to_owned()));
        };
        if values.len() != names.len() {
            let problem = format!("a row of {} values for {} names", values.len(), names.len());
            return Err(self.writer.misuse(problem));
        }
        let Some(stamp) = Time::from_nanoseconds(stamp) else {
            let problem = format!("a row has the stamp {stamp} ns; a ROS header holds times from 1901 to 2038 only");
            return Err(self.writer.misuse(problem));
        };
        let name: Vec<&str> = names.iter().map(String::as_str).collect();
        let header = Header { stamp, frame_id: frame };
        let message = JointState { header, name: &name, position: values, velocity: &[], effort: &[] };
        self.writer.write(*channel, log_time, log_time, &message)
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// A refusal of the system; there is then no file.
    pub fn finish(self) -> Result<(), Error> {
        self.writer.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_joint_states_at_their_stamps() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("overlay.mcap");
        let mut overlay = Overlay::create(&path, &McapOptions::default()).unwrap();
        let names = ["vx".to_owned(), "yaw".to_owned()];
        let predicted = overlay.joint_state("/fleetfoot/predicted", &names, "base").unwrap();
        let residual = overlay.joint_state("/fleetfoot/residual", &names[..1], "").unwrap();
        overlay.row(predicted, 2_000_000_003, 2_500_000_000, &[1.5, f64::NAN]).unwrap();
        // Topics may be written one after the other, going back in time.
        overlay.row(residual, 1_000_000_000, 1_500_000_000, &[-0.25]).unwrap();
        overlay.finish().unwrap();

        let bytes = std::fs::read(&path).unwrap();
        let messages: Vec<_> = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
        assert_eq!(messages.len(), 2);
        assert_eq!(
            (messages[0].channel.topic.as_str(), messages[0].log_time, messages[0].publish_time),
            ("/fleetfoot/predicted", 2_500_000_000, 2_500_000_000)
        );
        assert_eq!(messages[0].channel.schema.as_ref().unwrap().name, "sensor_msgs/msg/JointState");
        #[rustfmt::skip]
        let mut expected = vec![
            0, 1, 0, 0,
            2, 0, 0, 0,  3, 0, 0, 0,
            5, 0, 0, 0,  b'b', b'a', b's', b'e', 0,  0, 0, 0,
            2, 0, 0, 0,
            3, 0, 0, 0,  b'v', b'x', 0,  0,
            4, 0, 0, 0,  b'y', b'a', b'w', 0,
            2, 0, 0, 0,  0, 0, 0, 0,
        ];
        expected.extend(1.5f64.to_le_bytes());
        expected.extend(f64::NAN.to_le_bytes());
        expected.extend([0; 8]);
        assert_eq!(messages[0].data, expected);
        assert_eq!((messages[1].channel.topic.as_str(), messages[1].log_time), ("/fleetfoot/residual", 1_500_000_000));
    }

    #[test]
    fn rows_that_do_not_fit_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("overlay.mcap");
        let mut overlay = Overlay::create(&path, &McapOptions::default()).unwrap();
        let series = overlay.joint_state("/predicted", &["vx".to_owned()], "").unwrap();
        let cases = [
            (overlay.row(series, 0, 0, &[]), "0 values for 1 names"),
            (overlay.row(series, i64::MAX, 0, &[1.0]), "2038"),
            (overlay.row(series, 0, -1, &[1.0]), "log time -1"),
            (overlay.row(SeriesId(1), 0, 0, &[1.0]), "another file"),
        ];
        for (result, part) in cases {
            let message = result.unwrap_err().to_string();
            assert!(message.contains(part) && message.contains("overlay.mcap"), "{message}");
        }
        drop(overlay);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
