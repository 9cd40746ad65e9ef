//! Messages of libraries name settings and commands by the constants of `data/src/setting.rs`, so that each front end words them: no text has a flag.

use std::{fs, path::Path};

use crate::circles::{after_item, is_test, tokens};

/// The front ends, whose messages have flags and arguments.
const FRONT_ENDS: [&str; 2] = ["cli", "py"];

/// Files whose texts have flags that no front end words.
const ALLOWED: [(&str, &str); 8] = [
    ("data/src/setting.rs", "the words themselves"),
    ("recipe/src/init.rs", "a comment of a recipe that is written"),
    ("recipe/src/init/channels.rs", "a comment of a recipe that is written"),
    ("report/src/figure/plain.rs", "a variable of CSS"),
    ("synth/src/demo/logs.rs", "a command that a file records"),
    ("synth/src/lib.rs", "a command that a file records"),
    ("synth/src/recipes.rs", "a comment of a recipe that is written"),
    ("synth/src/world.rs", "a comment of a file that is written"),
];

#[test]
fn library_messages_name_no_flag() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let (mut texts, mut flagged) = (0, Vec::new());
    for folder in fs::read_dir(&root).expect("a folder of crates") {
        let folder = folder.expect("an entry");
        if !FRONT_ENDS.iter().any(|name| folder.file_name() == *name) {
            walk(&root, &folder.path().join("src"), &mut texts, &mut flagged);
        }
    }
    flagged.sort();
    let files: Vec<&str> = ALLOWED.iter().map(|(file, _)| *file).collect();
    let idle: Vec<&&str> = files.iter().filter(|file| !flagged.iter().any(|(of, _)| of == *file)).collect();
    flagged.retain(|(file, _)| !files.contains(&file.as_str()));
    let lines: Vec<String> = flagged.iter().map(|(file, text)| format!("{file}: {text}")).collect();
    assert!(texts > 8_000, "only {texts} texts were found");
    assert!(lines.is_empty(), "take a constant of `data::setting` in the place of a flag:\n{}", lines.join("\n"));
    assert!(idle.is_empty(), "these files have no flags any more: {idle:?}");
}

#[test]
fn flags_are_matched_in_texts_alone() {
    let text = r##"let a = "fewer --folds"; /* "--no" */ x(r#"--raw"#, "a--b", "--- ", "{--}"); #[cfg(test)] mod tests { f("--t") }"##;
    assert_eq!(flags(text).1, ["\"fewer --folds\"", "\"r#\"--raw\"#"]);
}

fn walk(root: &Path, folder: &Path, texts: &mut usize, flagged: &mut Vec<(String, String)>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries {
        let path = entry.expect("an entry").path();
        if path.file_stem().is_some_and(|stem| stem == "tests") {
            continue;
        }
        if path.is_dir() {
            walk(root, &path, texts, flagged);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let (count, flags) = flags(&fs::read_to_string(&path).expect("a source file"));
            let file = path.strip_prefix(root).expect("below the root").display().to_string();
            *texts += count;
            flagged.extend(flags.into_iter().map(|text| (file.clone(), text)));
        }
    }
}

/// Number of texts in a source file outside of its tests, and the texts with a flag.
fn flags(source: &str) -> (usize, Vec<String>) {
    let tokens = tokens(source);
    let (mut texts, mut flagged, mut at) = (0, Vec::new(), 0);
    while at < tokens.len() {
        if is_test(&tokens, at) {
            at = after_item(&tokens, at + 1);
            continue;
        }
        if tokens[at].starts_with('"') {
            texts += 1;
            flagged.extend(has_flag(&tokens[at]).then(|| tokens[at].clone()));
        }
        at += 1;
    }
    (texts, flagged)
}

/// Returns true if `--` stands before a letter and behind no word.
fn has_flag(text: &str) -> bool {
    text.match_indices("--").any(|(at, _)| {
        let word = |sign: char| sign.is_alphanumeric() || sign == '_' || sign == '-';
        !text[..at].ends_with(word) && text[at + 2..].starts_with(|sign: char| sign.is_ascii_lowercase())
    })
}
