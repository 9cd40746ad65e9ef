//! Columns of a robot's log by name: the topic, and the field in its messages.

use std::collections::{HashMap, HashSet};

use fleetfoot_data::nearest_one;

/// The topics of a log, as columns call them.
pub(crate) struct Names {
    /// Names, the longest first.
    topics: Vec<String>,
    /// Their indexes in the file, and the names by those.
    index: HashMap<String, usize>,
    name: HashMap<usize, String>,
}

impl Names {
    /// Names of a file's topics after renaming. `renames` are pairs of what columns say and what the file says; a pair that ends in slashes
    /// renames a namespace. A renamed topic hides one of the file that has that name.
    pub(crate) fn new<'a>(topics: impl Iterator<Item = &'a str>, renames: &[(String, String)]) -> Self {
        let mut all: Vec<(String, usize, bool)> = topics
            .enumerate()
            .map(|(index, topic)| match renames.iter().find_map(|(ours, file)| rename(topic, ours, file)) {
                Some(ours) => (ours, index, true),
                None => (topic.to_owned(), index, false),
            })
            .collect();
        let renamed: HashSet<String> =
            all.iter().filter(|(.., renamed)| *renamed).map(|(name, ..)| name.clone()).collect();
        all.retain(|(name, _, is_renamed)| *is_renamed || !renamed.contains(name));
        all.sort_by(|a, b| b.0.len().cmp(&a.0.len()).then_with(|| a.0.cmp(&b.0)));
        // Of two of one name the first stands for it.
        let index = all.iter().rev().map(|(name, index, _)| (name.clone(), *index)).collect();
        let name = all.iter().map(|(name, index, _)| (*index, name.clone())).collect();
        Self { topics: all.into_iter().map(|(name, ..)| name).collect(), index, name }
    }

    /// The topic of a column, and the rest of the name, which begins with a dot or a bracket, or is empty.
    pub(crate) fn locate<'a>(&self, column: &'a str) -> Option<(usize, &'a str)> {
        // The longest first: a topic may be the beginning of another.
        let ends = column.match_indices(['.', '[']).map(|(end, _)| end).chain([column.len()]);
        let ends: Vec<usize> = ends.collect();
        ends.into_iter().rev().find_map(|end| Some((*self.index.get(&column[..end])?, &column[end..])))
    }

    /// The name of a topic, by its index in the file.
    pub(crate) fn of(&self, index: usize) -> Option<&str> {
        self.name.get(&index).map(String::as_str)
    }

    /// The name that was probably meant: the same in another namespace, or one with a slip.
    pub(crate) fn nearest(&self, wanted: &str) -> Option<String> {
        let all = || self.topics.iter().map(String::as_str);
        let inside = |outer: &str, inner: &str| {
            let inner = inner.trim_start_matches('/');
            outer.strip_suffix(inner).is_some_and(|rest| !inner.is_empty() && rest.ends_with('/'))
        };
        let moved = all().find(|name| inside(name, wanted) || inside(wanted, name));
        moved.map(str::to_owned).or_else(|| nearest_one(wanted, all()))
    }
}

fn rename(topic: &str, ours: &str, file: &str) -> Option<String> {
    if topic == file {
        return Some(ours.to_owned());
    }
    (file.ends_with('/') && ours.ends_with('/'))
        .then(|| topic.strip_prefix(file).map(|rest| format!("{ours}{rest}")))
        .flatten()
}

/// The path of a field within its message: what follows the topic, without the dot.
pub(super) fn inside(rest: &str) -> &str {
    rest.strip_prefix('.').unwrap_or(rest)
}

/// A column's name from its topic and the path within the message.
pub(super) fn column(topic: &str, path: &str) -> String {
    if path.starts_with('[') { format!("{topic}{path}") } else { format!("{topic}.{path}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_topic_wins_and_renames_hide() {
        let renames = [("/odom".to_owned(), "/robot2/odom".to_owned()), ("/a/".to_owned(), "/b/".to_owned())];
        let names = Names::new(["/odom", "/robot2/odom", "/imu", "/imu.raw", "/b/c"].into_iter(), &renames);
        assert_eq!(names.locate("/odom.twist.linear.x"), Some((1, ".twist.linear.x")));
        assert_eq!(names.locate("/imu.raw.x"), Some((3, ".x")));
        assert_eq!(names.locate("/imu.x"), Some((2, ".x")));
        assert_eq!(names.locate("/a/c[1]"), Some((4, "[1]")));
        assert_eq!(names.locate("/imux"), None);
        assert_eq!(names.of(4), Some("/a/c"));
        assert_eq!(names.of(0), None);
        assert_eq!(names.nearest("/robot2/imu").as_deref(), Some("/imu"));
        assert_eq!(names.nearest("/c").as_deref(), Some("/a/c"));
        assert_eq!(names.nearest("/im").as_deref(), Some("/imu"));
    }
}
