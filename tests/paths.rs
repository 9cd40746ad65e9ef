//! Pages about the house name files: each of them exists. Records of decisions have one form, and an index.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

/// Pages that name files, beside all records of decisions.
const PAGES: [&str; 4] = ["CONTRIBUTING.md", "docs/architecture.md", "docs/numbers.md", "docs/releasing.md"];

/// Folders of the checkout's root that a path may begin with.
const ROOTS: [&str; 7] = ["crates", "tests", "docs", "fuzz", "benches", ".cargo", ".github"];

/// Folders that a path may have behind the name of a crate.
const IN_CRATES: [&str; 6] = ["src", "tests", "build.rs", "benches", "python", "Cargo.toml"];

#[test]
fn paths_that_pages_name_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut pages: Vec<PathBuf> = PAGES.iter().map(PathBuf::from).collect();
    for entry in fs::read_dir(root.join("docs/decisions")).expect("a folder of decisions") {
        let name = entry.expect("an entry").file_name();
        if Path::new(&name).extension().is_some_and(|extension| extension == "md") {
            pages.push(Path::new("docs/decisions").join(name));
        }
    }
    pages.sort();
    let (mut count, mut missing) = (0, Vec::new());
    for page in &pages {
        let text = fs::read_to_string(root.join(page)).unwrap_or_else(|error| panic!("{}: {error}", page.display()));
        for (line, path) in paths(&text) {
            count += 1;
            if !exists(&root, &path) {
                missing.push(format!("{}:{line}: `{path}` does not exist", page.display()));
            }
        }
    }
    assert!(count > 400, "only {count} paths were found in {} pages", pages.len());
    assert!(missing.is_empty(), "{} paths of pages are gone:\n{}", missing.len(), missing.join("\n"));
}

#[test]
fn decisions_have_their_parts_and_index() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/decisions");
    let index = fs::read_to_string(folder.join("README.md")).expect("an index");
    let (mut numbers, mut problems) = (BTreeSet::new(), Vec::new());
    for entry in fs::read_dir(&folder).expect("a folder of decisions") {
        let name = entry.expect("an entry").file_name().into_string().expect("a name");
        if name == "README.md" {
            continue;
        }
        let number = name.split('-').next().unwrap_or_default().to_owned();
        let text = fs::read_to_string(folder.join(&name)).expect("a record");
        for part in [&*format!("# {number}. "), "\nDate: 20", "\n## Question\n", "\n## Choice\n", "\n## Evidence\n"] {
            if !text.contains(part) {
                problems.push(format!("{name} has no `{}`", part.trim()));
            }
        }
        if !index.contains(&format!("\n- [{number}]({name}) ")) {
            problems.push(format!("{name} is not in README.md: write `- [{number}]({name}) TITLE` below its theme"));
        }
        if !numbers.insert(number) {
            problems.push(format!("{name} has the number of another record"));
        }
    }
    assert!(numbers.len() > 90, "only {} records were found", numbers.len());
    assert!(problems.is_empty(), "{} records need work:\n{}", problems.len(), problems.join("\n"));
}

#[test]
fn paths_differ_from_other_code() {
    let text = "See `stats/src/scan.rs`,\n`pwa`, `a/b`, `crates/py/build.rs` and `docs/`.\n```sh\nls `tests/none.rs`\n```\n`tests/peers/` `pwa/src/x.rs:12`";
    let listed: Vec<(usize, String)> = paths(text);
    let expected =
        [(1, "stats/src/scan.rs"), (2, "crates/py/build.rs"), (2, "docs/"), (6, "tests/peers/"), (6, "pwa/src/x.rs")];
    assert_eq!(listed, expected.map(|(line, path)| (line, path.to_owned())));
}

/// Returns true if a path exists, from the root or from the folder of crates.
fn exists(root: &Path, path: &str) -> bool {
    root.join(path).exists() || root.join("crates").join(path).exists()
}

/// Paths between backticks of a page, with the line of each; blocks of code are left out.
fn paths(text: &str) -> Vec<(usize, String)> {
    let (mut listed, mut fenced) = (Vec::new(), false);
    for (number, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        } else if !fenced {
            // Every other piece stands between backticks.
            let code = line.split('`').skip(1).step_by(2);
            listed.extend(code.filter_map(path).map(|path| (number + 1, path.to_owned())));
        }
    }
    listed
}

/// The path that a piece of code is, without the number of a line behind it.
fn path(code: &str) -> Option<&str> {
    let path = code.split_once(':').map_or(code, |(path, _)| path);
    let spelt = |sign: char| sign.is_ascii_alphanumeric() || "_-./".contains(sign);
    let mut parts = path.split('/');
    let (first, second) = (parts.next()?, parts.next()?);
    let named = ROOTS.contains(&first) || IN_CRATES.contains(&second);
    (named && path.chars().all(spelt)).then_some(path)
}
