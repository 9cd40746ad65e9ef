//! Names and labels of episodes.

use std::{
    collections::{BTreeMap, HashMap},
    path::Path,
};

use crate::LabelRule;

/// The file's name, the whole path where two files share the name, and `#k` where a file holds several episodes.
pub(crate) fn episode_names(files: &[&Path], owners: &[usize]) -> Vec<String> {
    let short = |path: &Path| {
        path.file_name().map_or_else(|| path.to_string_lossy().into_owned(), |name| name.to_string_lossy().into_owned())
    };
    let mut shared: HashMap<String, usize> = HashMap::new();
    for path in files {
        *shared.entry(short(path)).or_default() += 1;
    }
    let mut count = vec![0usize; files.len()];
    owners.iter().for_each(|&file| count[file] += 1);
    let mut next = vec![0usize; files.len()];
    let mut names = Vec::with_capacity(owners.len());
    for &file in owners {
        let path = files[file];
        let mut name = short(path);
        if shared.get(&name).is_some_and(|&times| times > 1) {
            name = path.to_string_lossy().into_owned();
        }
        next[file] += 1;
        names.push(if count[file] > 1 { format!("{name}#{}", next[file]) } else { name });
    }
    names
}

/// The labels that the rules give to an episode of a file.
pub(crate) fn labels(rules: &[LabelRule], path: &Path, episode: &str) -> BTreeMap<String, String> {
    let whole = path.to_string_lossy();
    let file = path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
    let stem = file.split('.').next().unwrap_or_default();
    let mut labels = BTreeMap::new();
    for rule in rules {
        let Ok(pattern) = glob::Pattern::new(&rule.pattern) else {
            continue;
        };
        if [whole.as_ref(), file.as_ref(), stem, episode].iter().any(|name| pattern.matches(name)) {
            labels.extend(rule.labels.clone());
        }
    }
    labels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_short_where_they_can_be() {
        let files = [Path::new("a/run.csv"), Path::new("b/run.csv"), Path::new("b/walk.csv")];
        let names = episode_names(&files, &[0, 1, 1, 2, 2]);
        assert_eq!(names, ["a/run.csv", "b/run.csv#1", "b/run.csv#2", "walk.csv#1", "walk.csv#2"]);
    }

    #[test]
    fn later_rules_override_earlier_ones() {
        let rule = |pattern: &str, value: &str| LabelRule {
            pattern: pattern.into(),
            labels: BTreeMap::from([("terrain".into(), value.into())]),
        };
        let rules = [rule("*", "unknown"), rule("grass_*", "grass"), rule("grass_2.csv.gz#1", "wet")];
        let of = |path: &str, episode: &str| labels(&rules, Path::new(path), episode)["terrain"].clone();
        assert_eq!(of("runs/ice.csv", "ice.csv"), "unknown");
        assert_eq!(of("runs/grass_1.csv", "grass_1.csv"), "grass");
        assert_eq!(of("runs/grass_2.csv.gz", "grass_2.csv.gz#1"), "wet");
    }
}
