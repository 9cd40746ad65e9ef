//! Interface of containers of messages: the same view of a robot's log for every format.
//!
//! A [`Container`] is a recording in one file or in several. Its topics have messages that are bytes of some encoding.
//! Its pieces are read as a whole, each by one thread. Above this file only [`crate::containers::open`] knows the
//! format. A further format is an implementation of the trait, a line there, and its name in [`crate::Format`].
//!
//! All data of a file are checked before use. Unreadable parts are skipped up to the next sound place and counted
//! ([`Damage`]).

mod damage;
mod map;
mod several;
mod times;
mod unpacked;

use std::{
    collections::BTreeMap,
    fmt,
    path::{Path, PathBuf},
    sync::Arc,
};

use fleetfoot_data::nearest_one;

pub(crate) use damage::{Damage, Lost};
pub(crate) use map::{Kind, Map, ULOG};
pub(crate) use several::Several;
pub(crate) use times::{Span, piece_spans, summary};
pub(crate) use unpacked::{Packing, with_unpacked};

use crate::Error;

/// Takes a message: its topic, log time and publish time in nanoseconds, and its bytes.
pub(crate) type Each<'a> = dyn FnMut(usize, i64, i64, &[u8]) -> Result<(), Error> + 'a;

/// A recording of messages.
///
/// Times are log times, nanoseconds: when messages were recorded, as far as the format tells. What is asked by piece may be asked by several
/// threads at once.
pub(crate) trait Container: fmt::Debug + Send + Sync {
    /// Path that was opened: a file, or the folder of several.
    fn path(&self) -> &Path;

    /// The files, in the order of the recording.
    fn files(&self) -> Vec<PathBuf>;

    /// The topics, sorted by name.
    fn topics(&self) -> &[Topic];

    /// The place of a topic among [`Self::topics`].
    ///
    /// # Errors
    /// A topic that the recording does not have, with the nearest name; one whose definitions contradict each other or are not there.
    fn topic(&self, name: &str) -> Result<usize, Error> {
        let Ok(place) = self.topics().binary_search_by(|topic| topic.name.as_str().cmp(name)) else {
            let nearest = nearest_one(name, self.topics().iter().map(|topic| topic.name.as_str()));
            return Err(Error::MissingColumn { path: self.path().into(), column: name.into(), nearest });
        };
        match self.topics().get(place).and_then(|topic| topic.problem.clone()) {
            Some(problem) => Err(Error::UnusableTopic { path: self.path().into(), topic: name.into(), problem }),
            None => Ok(place),
        }
    }

    /// Number of pieces. Their order is that of the recording.
    fn pieces(&self) -> usize;

    /// Messages of all topics in a piece, where the file tells without reading it.
    fn messages(&self, piece: usize) -> Option<u64>;

    /// Messages of some topics in a piece, where the file tells without reading it. `Some(0)`: reading it would do nothing.
    fn wanted_messages(&self, piece: usize, wanted: &[usize]) -> Option<u64>;

    /// The topics that have messages in a piece, where the file tells without reading it.
    fn topics_of(&self, piece: usize) -> Option<Vec<usize>> {
        let all = 0..self.topics().len();
        let some = all.map(|topic| Some((topic, self.wanted_messages(piece, &[topic])?)));
        let some: Vec<(usize, u64)> = some.collect::<Option<_>>()?;
        Some(some.into_iter().filter(|(_, count)| *count > 0).map(|(topic, _)| topic).collect())
    }

    /// Hands over the messages of the wanted topics in a piece, in the order of the file, the bytes in place where the format allows. An error
    /// of `each` ends the reading.
    ///
    /// Whatever is damaged in the piece is passed over, and counted once however often the piece is read.
    ///
    /// # Errors
    /// Only those of `each`.
    fn read_piece(&self, piece: usize, wanted: &[usize], each: &mut Each<'_>) -> Result<(), Error>;

    /// Log times of a piece by topic, from an index; `None` where only reading the piece tells.
    fn indexed_times(&self, _piece: usize) -> Option<BTreeMap<usize, Vec<i64>>> {
        None
    }

    /// First and last log times of a piece by topic, from an index; `None` where only reading the piece tells.
    fn indexed_spans(&self, _piece: usize) -> Option<BTreeMap<usize, Span>> {
        None
    }

    /// Moments on the log's clock at which its writer says that messages were lost: what lies about them is no neighbour. Sorted.
    fn breaks(&self) -> &[i64] {
        &[]
    }

    /// Metadata of the recording beside its messages.
    fn metadata(&self) -> BTreeMap<String, String>;

    /// Damage from opening and all reading up to now, the end of the file included.
    fn damage(&self) -> Damage;

    /// Notes on the recording, besides damage.
    fn notes(&self) -> Vec<String>;

    /// Tells the system that what was read will not be needed soon.
    fn release(&self) {}
}

/// A topic with all that carries it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Topic {
    /// e.g. `/odom`.
    pub(crate) name: String,
    /// e.g. `nav_msgs/msg/Odometry`; empty without a schema.
    pub(crate) type_name: String,
    /// e.g. `cdr`.
    pub(crate) message_encoding: String,
    pub(crate) schema: Option<SchemaRecord>,
    /// Messages, where the recording tells.
    pub(crate) count: Option<u64>,
    /// Why its messages cannot be decoded.
    pub(crate) problem: Option<String>,
}

impl Topic {
    /// Schema for the decoder: name, encoding, data.
    pub(crate) fn schema(&self) -> Option<(&str, &str, &[u8])> {
        self.schema.as_ref().map(|schema| (schema.name.as_str(), schema.encoding.as_str(), &schema.data[..]))
    }

    /// Why messages of another encoding or schema cannot belong to the topic; `None` where they can.
    pub(crate) fn contradiction(&self, encoding: &str, schema: Option<&SchemaRecord>) -> Option<String> {
        let name = |schema: Option<&SchemaRecord>| schema.map_or("no type", |schema| schema.name.as_str()).to_owned();
        if self.message_encoding != encoding {
            Some(format!("its messages are encoded as `{}` and as `{encoding}`", self.message_encoding))
        } else if self.schema.as_ref() != schema {
            let (first, second) = (name(self.schema.as_ref()), name(schema));
            let differ = if first == second { "in two definitions" } else { "in two types" };
            Some(format!("its messages come {differ}, `{first}` and `{second}`"))
        } else {
            None
        }
    }
}

/// Schema of a message type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct SchemaRecord {
    /// The message type, e.g. `nav_msgs/msg/Odometry`.
    pub(crate) name: String,
    /// e.g. `ros2msg`.
    pub(crate) encoding: String,
    /// The text or descriptor.
    pub(crate) data: Arc<[u8]>,
}
