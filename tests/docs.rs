//! Every command on a page is run: the README, the guide for contributors and every page of `docs/`.
//!
//! `CONTRIBUTING.md` has the rules for pages. Blocks of Python are run by the package's tests, blocks of Rust by the
//! doctests of the facade; here are all other kinds, and the links. `FLEETFOOT_DOCS=overwrite` writes the present
//! output of the commands into the pages.

mod console;
mod links;
mod page;

use std::{
    fs,
    path::{Path, PathBuf},
};

use page::{Block, blocks};

/// The root of the checkout.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().expect("the checkout is there")
}

/// Every page, by its path from the root.
fn pages() -> Vec<PathBuf> {
    let mut pages = vec![
        PathBuf::from("README.md"),
        PathBuf::from("CONTRIBUTING.md"),
        PathBuf::from("CHANGELOG.md"),
        PathBuf::from("SKILL.md"),
    ];
    let mut folders = vec![PathBuf::from("docs")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(root().join(&folder)).expect("the folder of the pages") {
            let path = folder.join(entry.expect("an entry").file_name());
            if root().join(&path).is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                pages.push(path);
            }
        }
    }
    pages.sort();
    pages
}

fn text_of(page: &Path) -> String {
    fs::read_to_string(root().join(page)).unwrap_or_else(|error| panic!("{}: {error}", page.display()))
}

/// Checks a block that is not run by a shell; `Err` has the fault.
fn check(page: &Path, block: &Block) -> Result<(), String> {
    match block.kind.as_str() {
        // Run with the page; run by the package's tests; shown beside what is run.
        "console" | "python" | "text" => Ok(()),
        "toml" => fleetfoot::Recipe::parse(&block.text(), "the block").map(drop).map_err(|error| error.to_string()),
        "sh" => block.lines.iter().try_for_each(|line| build_command(line)),
        // Compiled by a command of the page.
        "c" if block.file.is_some() => Ok(()),
        "c" => Err("a block of C has a name (<!-- file: NAME -->), so that a command of the page compiles it".into()),
        "rust" if page == Path::new("docs/reference/rust.md") => Ok(()),
        "rust" => Err("blocks of Rust are run in docs/reference/rust.md alone".into()),
        // Other people's language, in the page for its users.
        "matlab" if page == Path::new("docs/coming-from/matlab.md") => Ok(()),
        directive if ["{toctree}", "{math}", "{figure}", "{automodule}", "{eval-rst}"].contains(&directive) => Ok(()),
        other => Err(format!("`{other}` is no known kind of block")),
    }
}

/// A line of a block `sh`: commands that build and install are not run within a test, but their targets exist.
fn build_command(line: &str) -> Result<(), String> {
    let command = line.split('#').next().unwrap_or_default().trim();
    let words: Vec<&str> = command.split_whitespace().filter(|word| !word.contains('=')).collect();
    match words.as_slice() {
        []
        | ["cargo", ..]
        | ["git", "clone" | "config", ..]
        | ["python3", "-m", "venv", ..]
        | ["pip", "install", ..] => Ok(()),
        ["make", target] => {
            let makefile = fs::read_to_string(root().join("Makefile")).map_err(|error| error.to_string())?;
            let known = makefile.lines().any(|rule| rule.starts_with(&format!("{target}:")));
            known.then_some(()).ok_or_else(|| format!("`make {target}`: the Makefile has no such target"))
        }
        _ => Err(format!("`{command}` is not run: only commands that build and install stand in a block `sh`")),
    }
}

#[test]
fn every_block_is_of_a_known_kind() {
    let mut wrong = Vec::new();
    for page in pages() {
        for block in blocks(&text_of(&page)) {
            if let Err(problem) = check(&page, &block) {
                wrong.push(format!("{}:{}: {problem}", page.display(), block.line));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    let strange = blocks("```basic\nGOTO 10\n```\n");
    assert!(check(Path::new("README.md"), &strange[0]).is_err());
    let misspelt = blocks("```toml\n[states]\nx = { regresor = false }\n```\n");
    assert!(check(Path::new("README.md"), &misspelt[0]).unwrap_err().contains("regresor"));
    assert!(build_command("make tset").is_err() && build_command("rm -r build").is_err());
}

#[test]
fn commands_print_what_pages_show() {
    let overwrite = std::env::var("FLEETFOOT_DOCS").is_ok_and(|word| word == "overwrite");
    let only = std::env::var("FLEETFOOT_PAGE").unwrap_or_default();
    let mut wrong = Vec::new();
    let mut commands = 0;
    for page in pages().iter().filter(|page| page.to_string_lossy().contains(&only)) {
        let text = text_of(page);
        let ran = console::run(page, &blocks(&text));
        commands += ran.commands;
        if overwrite && !ran.differences.is_empty() {
            fs::write(root().join(page), console::corrected(&text, &ran.differences)).expect("the page can be written");
        }
        wrong.extend(ran.problems);
        wrong.extend(ran.differences.iter().map(|difference| difference.description(page)));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
    assert!(commands > 20 || !only.is_empty(), "{commands} commands were run");
}

#[test]
fn no_link_is_broken() {
    let wrong: Vec<String> = pages().iter().flat_map(|page| links::broken(&root(), page, &text_of(page))).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_readme_ends() {
    let text = text_of(Path::new("README.md"));
    let longest = text.lines().map(|line| line.chars().count()).max().unwrap_or(0);
    assert!(text.lines().count() <= 150, "{} lines", text.lines().count());
    assert!(longest <= 120, "a line of {longest} characters");
}
