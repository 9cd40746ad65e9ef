//! Inside a crate, too, arrows have one direction. Two modules of one parent, each with all that is below it, do not
//! use each other, directly or by way of others. (A parent and its children are one thing.)
//!
//! The sources are read as tokens, which is enough for paths. A `use` gives the place of a name, a re-export is
//! followed to the file that defines it, and a file uses the names in its text. Tests may name anything.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

/// A file of a crate.
#[derive(Default)]
struct Module {
    /// Names that it imports or hands on, and where they stand, as it is written.
    imports: BTreeMap<String, Vec<String>>,
    /// Paths that its text names, single names among them.
    named: BTreeSet<Vec<String>>,
}

/// Modules by their path from the crate's root.
type Crate = BTreeMap<Vec<String>, Module>;

/// Modules, those that each uses, and the names that it takes.
type Edges = BTreeMap<Vec<String>, BTreeMap<Vec<String>, Vec<String>>>;

#[test]
fn modules_do_not_go_round() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let (mut files, mut circles) = (0, Vec::new());
    for folder in fs::read_dir(&crates).expect("a folder of crates") {
        let folder = folder.expect("an entry");
        let name = folder.file_name().into_string().expect("a name");
        let mut modules = Crate::new();
        read(&folder.path().join("src"), Vec::new(), &mut modules);
        files += modules.len();
        let edges = between_siblings(&modules);
        for circle in going_round(&edges) {
            let within = |from: &Vec<String>| {
                let arrows = edges[from].iter().filter(|(to, _)| circle.contains(*to));
                let line = |to: &[String], names: &[String]| {
                    format!("    {} -> {}: {}", from.join("::"), to.join("::"), names.join(", "))
                };
                arrows.map(|(to, names)| line(to, names)).collect::<Vec<_>>()
            };
            let lines: Vec<String> = circle.iter().flat_map(within).collect();
            circles.push(format!("{name}: {} modules\n{}", circle.len(), lines.join("\n")));
        }
    }
    assert!(files > 300, "only {files} files were found below {}", crates.display());
    assert!(circles.is_empty(), "{} circles of modules:\n{}", circles.len(), circles.join("\n"));
}

/// Reads the files of a folder and below; `tests.rs` and folders of tests are left out.
fn read(folder: &Path, parent: Vec<String>, modules: &mut Crate) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let paths: BTreeSet<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    for path in paths {
        let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default().to_owned();
        if stem.starts_with("tests") || stem == "bin" {
            continue;
        }
        let name: Vec<String> = parent.iter().cloned().chain([stem.clone()]).collect();
        if path.is_dir() {
            read(&path, name, modules);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let root = parent.is_empty() && ["lib", "main"].contains(&stem.as_str());
            let text = fs::read_to_string(&path).expect("a source file");
            modules.insert(if root { Vec::new() } else { name }, module(&tokens(&text)));
        }
    }
}

/// Names, `::`, texts in their quotes, and single signs; no comments, numbers or lifetimes.
pub(crate) fn tokens(text: &str) -> Vec<String> {
    let signs: Vec<char> = text.chars().collect();
    let (mut list, mut at) = (Vec::new(), 0);
    let starts = |at: usize, pattern: &str| pattern.chars().enumerate().all(|(i, c)| signs.get(at + i) == Some(&c));
    while at < signs.len() {
        let sign = signs[at];
        if starts(at, "//") {
            while at < signs.len() && signs[at] != '\n' {
                at += 1;
            }
        } else if starts(at, "/*") {
            while at < signs.len() && !starts(at, "*/") {
                at += 1;
            }
            at += 2;
        } else if (sign == 'r' || starts(at, "br")) && raw(&signs, at).is_some() {
            let end = raw(&signs, at).unwrap_or(at);
            list.push(format!("\"{}", signs[at..end].iter().collect::<String>()));
            at = end;
        } else if sign == '"' {
            let begun = at;
            at += 1;
            while at < signs.len() && signs[at] != '"' {
                at += if signs[at] == '\\' { 2 } else { 1 };
            }
            at += 1;
            list.push(signs[begun..at].iter().collect());
        } else if sign == '\'' {
            // A character ends with a quote; a lifetime does not.
            at += match (signs.get(at + 1), signs.get(at + 2)) {
                (Some('\\'), _) => signs[at + 3..].iter().position(|&c| c == '\'').map_or(1, |end| end + 4),
                (Some(_), Some('\'')) => 3,
                _ => 1 + signs[at + 1..].iter().take_while(|c| c.is_alphanumeric() || **c == '_').count(),
            };
        } else if sign.is_alphabetic() || sign == '_' {
            let end = at + signs[at..].iter().take_while(|c| c.is_alphanumeric() || **c == '_').count();
            list.push(signs[at..end].iter().collect());
            at = end;
        } else if sign.is_numeric() {
            at += signs[at..].iter().take_while(|c| c.is_alphanumeric() || **c == '_').count();
        } else if starts(at, "::") {
            list.push("::".into());
            at += 2;
        } else {
            if !sign.is_whitespace() {
                list.push(sign.into());
            }
            at += 1;
        }
    }
    list
}

/// The end of a raw text that begins here.
fn raw(signs: &[char], at: usize) -> Option<usize> {
    let begun = at + 1 + usize::from(signs[at] == 'b');
    let hashes = signs.get(begun..)?.iter().take_while(|&&c| c == '#').count();
    (signs.get(begun + hashes) == Some(&'"')).then_some(())?;
    let body = begun + hashes + 1;
    let end = (body..signs.len())
        .find(|&i| signs[i] == '"' && signs[i + 1..].iter().take_while(|&&c| c == '#').count() >= hashes)?;
    Some(end + hashes + 1)
}

/// Returns true if an item of tests begins here.
pub(crate) fn is_test(tokens: &[String], at: usize) -> bool {
    is(tokens, at, &["#", "[", "cfg", "(", "test"]) || is(tokens, at, &["#", "[", "cfg", "(", "all", "(", "test"])
}

fn is(tokens: &[String], at: usize, pattern: &[&str]) -> bool {
    pattern.iter().enumerate().all(|(i, w)| tokens.get(at + i).is_some_and(|t| t == w))
}

/// Imports and names of a file, without its tests.
fn module(tokens: &[String]) -> Module {
    let (mut module, mut at) = (Module::default(), 0);
    let is = |at: usize, pattern: &[&str]| is(tokens, at, pattern);
    while at < tokens.len() {
        if is_test(tokens, at) {
            at = after_item(tokens, at + 1);
        } else if is(at, &["use"]) {
            let end = at + tokens[at..].iter().position(|token| token == ";").unwrap_or(tokens.len() - at);
            tree(&tokens[at + 1..end], &[], &mut module.imports);
            at = end + 1;
        } else if is(at, &["mod"]) {
            at += 2;
        } else if is_name(&tokens[at]) && (at == 0 || ![".", "::"].contains(&tokens[at - 1].as_str())) {
            let mut path = vec![tokens[at].clone()];
            at += 1;
            while is(at, &["::"]) && tokens.get(at + 1).is_some_and(|next| is_name(next)) {
                path.push(tokens[at + 1].clone());
                at += 2;
            }
            module.named.insert(path);
        } else {
            at += 1;
        }
    }
    module
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// The place after an item: its further attributes, and up to its `;` or its closed braces.
pub(crate) fn after_item(tokens: &[String], mut at: usize) -> usize {
    let mut depth = 0;
    while at < tokens.len() {
        match tokens[at].as_str() {
            "{" | "[" | "(" => depth += 1,
            "}" | "]" | ")" => {
                depth -= 1;
                if depth == 0 && tokens[at] == "}" {
                    return at + 1;
                }
            }
            ";" if depth == 0 => return at + 1,
            _ => {}
        }
        at += 1;
    }
    at
}

/// The names of a `use`, by the paths that they stand for; a glob has the name `*` and its path.
fn tree(tokens: &[String], before: &[String], imports: &mut BTreeMap<String, Vec<String>>) {
    let mut path = before.to_vec();
    let mut at = 0;
    while at < tokens.len() {
        match tokens[at].as_str() {
            "{" => {
                let (mut depth, mut from) = (0, at + 1);
                for (i, token) in tokens.iter().enumerate().skip(at) {
                    match token.as_str() {
                        "{" => depth += 1,
                        "}" => depth -= 1,
                        _ => {}
                    }
                    if depth == 0 || depth == 1 && token == "," {
                        tree(&tokens[from..i], &path, imports);
                        from = i + 1;
                    }
                    if depth == 0 {
                        return;
                    }
                }
                return;
            }
            "as" => {
                imports.insert(tokens.get(at + 1).cloned().unwrap_or_default(), path);
                return;
            }
            "*" => {
                imports.insert(format!("{}::*", path.join("::")), path);
                return;
            }
            "::" => {}
            name => path.push(name.to_owned()),
        }
        at += 1;
    }
    if path.last().is_some_and(|last| last == "self") {
        path.pop();
    }
    if path.len() > before.len() || !before.is_empty() && !tokens.is_empty() {
        imports.insert(path.last().cloned().unwrap_or_default(), path);
    }
}

/// The modules that a module uses, with the names that it takes from each.
fn uses(modules: &Crate, module: &[String]) -> BTreeMap<Vec<String>, Vec<String>> {
    let mut used: BTreeMap<Vec<String>, Vec<String>> = BTreeMap::new();
    let globs = modules[module].imports.iter().filter(|(name, _)| name.ends_with("::*")).map(|(_, path)| {
        // A glob uses the module of which it takes everything.
        path.iter().cloned().chain(["*".to_owned()]).collect::<Vec<_>>()
    });
    for path in modules[module].named.iter().cloned().chain(globs) {
        if let Some(place) = stands(modules, module, &path, 0)
            && place != module
        {
            used.entry(place).or_default().push(path.last().cloned().unwrap_or_default());
        }
    }
    used
}

/// The module that defines a path's name, if it is one of the crate's and no module itself.
fn stands(modules: &Crate, from: &[String], path: &[String], depth: usize) -> Option<Vec<String>> {
    // Names that import themselves in a circle would be an error of the compiler; a name that stands for a crate is not followed for ever.
    let (first, mut rest) = path.split_first().filter(|_| depth < 16)?;
    let mut place = from.to_vec();
    match first.as_str() {
        "crate" => place.clear(),
        "self" => {}
        "super" => drop(place.pop()),
        _ => rest = path,
    }
    if std::ptr::eq(rest, path) {
        // A name alone: imported, or a child's, else its own or another crate's.
        let child: Vec<String> = place.iter().chain([first]).cloned().collect();
        let known = modules[from].imports.contains_key(first) || modules.contains_key(&child);
        known.then_some(())?;
    }
    while let Some((name, further)) = rest.split_first() {
        if name == "super" {
            place.pop();
        } else {
            let child: Vec<String> = place.iter().chain([name]).cloned().collect();
            if modules.contains_key(&child) {
                place = child;
            } else if let Some(meant) = modules.get(&place)?.imports.get(name) {
                let whole: Vec<String> = meant.iter().chain(further).cloned().collect();
                return stands(modules, &place, &whole, depth + 1);
            } else {
                return Some(place);
            }
        }
        rest = further;
    }
    None
}

/// Dependencies between the modules of one parent: each stands for all that is below it.
fn between_siblings(modules: &Crate) -> Edges {
    let mut edges: Edges = modules.keys().map(|module| (module.clone(), BTreeMap::new())).collect();
    for module in modules.keys() {
        for (place, names) in uses(modules, module) {
            let common = module.iter().zip(&place).take_while(|(a, b)| a == b).count();
            // A parent and what is below it are one thing.
            if common < module.len().min(place.len()) {
                let (from, to) = (module[..=common].to_vec(), place[..=common].to_vec());
                edges.entry(from).or_default().entry(to).or_default().extend(names);
            }
        }
    }
    let targets: Vec<Vec<String>> = edges.values().flat_map(|to| to.keys().cloned()).collect();
    for to in targets {
        edges.entry(to).or_default();
    }
    edges
}

/// The sets of modules that use each other, directly or not.
fn going_round(edges: &BTreeMap<Vec<String>, BTreeMap<Vec<String>, Vec<String>>>) -> BTreeSet<BTreeSet<Vec<String>>> {
    let reached = |from: &Vec<String>| {
        let (mut seen, mut waiting) = (BTreeSet::new(), vec![from]);
        while let Some(module) = waiting.pop() {
            waiting.extend(edges[module].keys().filter(|next| seen.insert((*next).clone())));
        }
        seen
    };
    let all: BTreeMap<&Vec<String>, BTreeSet<Vec<String>>> =
        edges.keys().map(|module| (module, reached(module))).collect();
    let round = all.iter().filter(|(module, reached)| reached.contains(**module));
    round.map(|(module, reached)| reached.iter().filter(|to| all[to].contains(*module)).cloned().collect()).collect()
}
