//! Labels of episodes from the path of their file: `aircraft={dir1}`.

use std::{
    path::{Component, Path, PathBuf},
    str::FromStr,
};

use fleetfoot_dataset::StatisticError;

/// A label of an episode, made from its file's path: a name and a text. The text may have `{dir1}` (the folder of the
/// file), `{dir2}` (the one above, and so on), `{name}` (the file's name) and `{stem}` (the name up to its first dot).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LabelKey {
    name: String,
    parts: Vec<Part>,
    text: String,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Part {
    Text(String),
    Folder(usize),
    Name,
    Stem,
}

impl FromStr for LabelKey {
    type Err = StatisticError;

    fn from_str(text: &str) -> Result<Self, StatisticError> {
        let wrong = |problem: String| StatisticError::Key { key: text.to_owned(), problem };
        let (name, template) = text
            .split_once('=')
            .filter(|(name, template)| !name.trim().is_empty() && !template.is_empty())
            .ok_or_else(|| wrong("write NAME=TEXT, for example aircraft={dir1}".into()))?;
        let mut parts = Vec::new();
        let mut rest = template;
        while let Some((before, after)) = rest.split_once('{') {
            if !before.is_empty() {
                parts.push(Part::Text(before.to_owned()));
            }
            let (inside, after) = after.split_once('}').ok_or_else(|| wrong("a `{` without a `}`".into()))?;
            let folder = inside.strip_prefix("dir").and_then(|level| level.parse::<usize>().ok());
            parts.push(match (inside, folder) {
                ("name", _) => Part::Name,
                ("stem", _) => Part::Stem,
                (_, Some(level)) if level > 0 => Part::Folder(level),
                _ => {
                    return Err(wrong(format!(
                        "`{{{inside}}}` is unknown; there are {{dir1}}, {{dir2}}, ..., {{name}} and {{stem}}"
                    )));
                }
            });
            rest = after;
        }
        if !rest.is_empty() {
            parts.push(Part::Text(rest.to_owned()));
        }
        Ok(Self { name: name.trim().to_owned(), parts, text: text.to_owned() })
    }
}

impl LabelKey {
    /// The label's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// As it was written.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Its value for a file.
    ///
    /// # Errors
    /// When the path has too few folders.
    pub fn value(&self, file: &Path) -> Result<String, StatisticError> {
        let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let mut value = String::new();
        for part in &self.parts {
            match part {
                Part::Text(text) => value.push_str(text),
                Part::Name => value.push_str(&name),
                Part::Stem => value.push_str(name.split('.').next().unwrap_or_default()),
                Part::Folder(level) => {
                    let folder = folders(file).into_iter().nth(level - 1).ok_or_else(|| StatisticError::Key {
                        key: self.text.clone(),
                        problem: format!("{} does not lie in {level} folders; use a smaller number", file.display()),
                    })?;
                    value.push_str(&folder);
                }
            }
        }
        Ok(value)
    }
}

/// The names of the folders that a file lies in, the innermost first.
fn folders(file: &Path) -> Vec<String> {
    let absolute = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let mut folder = absolute.parent().map(PathBuf::from).unwrap_or_default();
    if folder.components().any(|component| component == Component::ParentDir) {
        folder = folder.canonicalize().unwrap_or(folder);
    }
    let names = folder.components().rev().filter_map(|component| match component {
        Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
        _ => None,
    });
    names.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_come_from_the_path() {
        let of = |key: &str, file: &str| key.parse::<LabelKey>().unwrap().value(Path::new(file)).unwrap();
        assert_eq!(of("aircraft={dir1}", "/fleet/7/flight_3.parquet"), "7");
        assert_eq!(of("aircraft={dir2}", "/fleet/7/flight_3.parquet"), "fleet");
        assert_eq!(of("flight={dir1}/{stem}", "/fleet/7/flight_3.csv.gz"), "7/flight_3");
        assert_eq!(of("file=<{name}>", "x/flight_3.csv.gz"), "<flight_3.csv.gz>");
        assert_eq!(of("site=north", "a.csv"), "north");
        let here = std::env::current_dir().unwrap();
        let here = here.file_name().unwrap().to_string_lossy();
        assert_eq!(of("folder={dir1}", "a.csv"), here, "a relative path lies in the current folder");
    }

    #[test]
    fn wrong_keys_are_refused() {
        for (key, word) in [
            ("aircraft", "NAME=TEXT"),
            ("=x", "NAME=TEXT"),
            ("a={dir0}", "dir1"),
            ("a={dir1", "without"),
            ("a={x}", "{stem}"),
        ] {
            let message = key.parse::<LabelKey>().unwrap_err().to_string();
            assert!(message.contains(word) && message.contains(key), "{message}");
        }
        let message = "a={dir9}".parse::<LabelKey>().unwrap().value(Path::new("/b/c.csv")).unwrap_err().to_string();
        assert!(message.contains("/b/c.csv"), "{message}");
    }
}
