//! A log's messages, one by one, as numbers: below episodes, clocks and joins.

use std::path::{Path, PathBuf};

use fleetfoot_data::{Progress, Silent, parallel_fold};
use fleetfoot_message::{Extract, FieldPath, Row, codec};

use super::sample::having;
use crate::{Error, Format, TopicInfo, container::Container, containers};

/// A robot's log, for reading the messages of a topic in the order of the file.
pub struct Messages {
    pub(super) path: PathBuf,
    pub(super) container: Box<dyn Container>,
}

/// One message.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct MessageRow<'a> {
    /// When it was recorded, nanoseconds.
    pub log_time: i64,
    /// When it was published, nanoseconds.
    pub publish_time: i64,
    /// The header's stamp, nanoseconds, where there is one.
    pub header_stamp: Option<i64>,
    /// One value a field; NaN where the message has none, and for texts.
    pub values: &'a [f64],
}

/// Rows of one piece of a file.
#[derive(Default)]
struct Rows {
    times: Vec<(i64, i64, Option<i64>)>,
    values: Vec<f64>,
    failed: u64,
}

impl Messages {
    /// Opens a log.
    ///
    /// # Errors
    /// A file that is no robot's log, or cannot be read.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let format = Format::of(path).ok_or_else(|| Error::UnknownFormat { path: path.into() })?;
        Ok(Self { path: path.into(), container: containers::open(path, format, &[], &Silent)? })
    }

    /// Its topics, sorted by name, with counts and rates from the file's indexes.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn topics(&self) -> Result<Vec<TopicInfo>, Error> {
        super::describe::topic_infos(self.container.as_ref(), &Silent)
    }

    /// Decodes these fields of a topic, given by their paths within a message, and hands on message by message, in the order of the file.
    /// Answers how many messages could not be decoded.
    ///
    /// # Errors
    /// A topic or a field that does not exist, and what `each` returns.
    pub fn read(
        &self,
        topic: &str,
        fields: &[&str],
        progress: &dyn Progress,
        mut each: impl FnMut(MessageRow<'_>) -> Result<(), Error> + Send,
    ) -> Result<u64, Error> {
        let (index, extract) = self.extract(topic, fields)?;
        let pieces = having(self.container.as_ref(), &[index]);
        let mut failed = 0;
        parallel_fold(
            pieces.len(),
            progress,
            |i| self.read_piece(pieces[i], index, extract.as_ref()),
            |rows| {
                failed += rows.failed;
                for (at, &(log_time, publish_time, header_stamp)) in rows.times.iter().enumerate() {
                    let values = &rows.values[at * fields.len()..(at + 1) * fields.len()];
                    each(MessageRow { log_time, publish_time, header_stamp, values })?;
                }
                Ok(())
            },
        )?;
        Ok(failed)
    }

    fn read_piece(&self, piece: usize, topic: usize, extract: &dyn Extract) -> Result<Rows, Error> {
        let (mut rows, mut row) = (Rows::default(), Row::new(extract));
        self.container.read_piece(piece, &[topic], &mut |_, log_time, publish_time, data| {
            if extract.extract(data, &mut row).is_err() {
                rows.failed += 1;
                return Ok(());
            }
            let stamp = row.stamps.iter().copied().find(|&stamp| stamp != fleetfoot_message::MISSING);
            rows.times.push((log_time, publish_time, stamp));
            rows.values
                .extend(row.values.iter().zip(&row.is_text).map(|(&value, &text)| if text { f64::NAN } else { value }));
            Ok(())
        })?;
        Ok(rows)
    }

    pub(super) fn extract(&self, topic: &str, fields: &[&str]) -> Result<(usize, Box<dyn Extract>), Error> {
        let index = self.container.topic(topic)?;
        let info = &self.container.topics()[index];
        let paths: Vec<FieldPath> = fields
            .iter()
            .map(|field| {
                field.parse().map_err(|problem: fleetfoot_message::PathError| Error::BadField {
                    path: self.path.clone(),
                    column: (*field).to_owned(),
                    problem: problem.to_string(),
                })
            })
            .collect::<Result<_, _>>()?;
        let extract = codec(&info.message_encoding, info.schema()).and_then(|codec| codec.compile(&paths));
        let extract = extract.map_err(|problem| Error::Topic {
            path: self.path.clone(),
            topic: topic.to_owned(),
            type_name: info.schema.as_ref().map(|schema| schema.name.clone()).unwrap_or_default(),
            problem: problem.to_string(),
        })?;
        Ok((index, extract))
    }
}
