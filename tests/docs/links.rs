//! Links between the pages.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// The relative links of a page whose file or heading is not there.
pub(crate) fn broken(root: &Path, page: &Path, text: &str) -> Vec<String> {
    let folder = root.join(page).parent().map(Path::to_owned).unwrap_or_default();
    let relative = targets(text).into_iter().filter(|link| !link.contains("://") && !link.starts_with("mailto:"));
    relative
        .filter_map(|link| {
            problem(&folder, &root.join(page), &link).map(|problem| format!("{}: {link}: {problem}", page.display()))
        })
        .collect()
}

fn problem(folder: &Path, page: &Path, link: &str) -> Option<String> {
    let (file, heading) = link.split_once('#').map_or((link, None), |(file, heading)| (file, Some(heading)));
    let path: PathBuf = if file.is_empty() { page.to_owned() } else { folder.join(file) };
    // Made by `make docs`.
    let made = file.contains("gallery/") || file.contains("/rust/") || file == "genindex.html";
    if made {
        return None;
    }
    if !path.exists() {
        return Some("there is no such file".into());
    }
    let heading = heading.filter(|_| path.extension().is_some_and(|extension| extension == "md"))?;
    let text = fs::read_to_string(&path).ok()?;
    let known = text.lines().filter(|line| line.starts_with('#')).map(slug).any(|slug| slug == heading);
    (!known).then(|| format!("{} has no such heading", path.display()))
}

/// The address of a heading within its page, as GitHub and MyST make it.
fn slug(heading: &str) -> String {
    let kept = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || [' ', '-', '_'].contains(c));
    kept.map(|character| if character == ' ' { '-' } else { character }).collect()
}

/// Targets of `](...)` and `src="..."`, outside of fenced blocks and code.
fn targets(text: &str) -> Vec<String> {
    let mut links = Vec::new();
    let mut within = false;
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            within = !within;
        }
        if within {
            continue;
        }
        let plain: String = line.split('`').step_by(2).collect();
        for (begin, end) in [("](", ')'), ("src=\"", '"'), ("srcset=\"", '"')] {
            let after = plain.split(begin).skip(1);
            links.extend(after.filter_map(|rest| rest.split(end).next()).map(str::to_owned));
        }
    }
    links
}

#[test]
fn missing_files_and_headings_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("b.md"), "# One thing\n## And `another`, too\n").unwrap();
    let text = "[x](b.md#one-thing) [y](b.md#and-another-too) [z](https://example.org)\n[bad](c.md), `[code](d.md)`, [bad](b.md#two)\n";
    let errors = broken(folder.path(), Path::new("a.md"), text);
    assert_eq!(errors.len(), 2, "{errors:?}");
    assert!(errors[0].contains("c.md: there is no such file") && errors[1].contains("no such heading"));
}
