//! The topics that rows are made of.

use fleetfoot_log::TopicInfo;

use super::Dataset;

impl Dataset {
    /// The topics of the first log that the fields in use are of; none where a log is a table.
    pub fn topics(&self) -> impl Iterator<Item = &TopicInfo> {
        let is_of = |name: &str, topic: &TopicInfo| {
            name.strip_prefix(topic.name.as_str()).is_some_and(|rest| rest.starts_with(['.', '[']))
        };
        self.topics.iter().filter(move |topic| self.fields().iter().any(|field| is_of(&field.name, topic)))
    }
}
