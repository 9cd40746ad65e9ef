//! Every command over models that are damaged as their structure allows: numbers, lists, names and expressions change, and the checksum is right all the same.

use std::{fs, time::Duration};

use fleetfoot::data::mix;

use crate::runner::*;

/// JSON whose entries stay in their order and whose numbers keep their digits: the checksum of a model covers both.
#[derive(Debug, Clone)]
enum Tree {
    Leaf(String),
    List(Vec<Tree>),
    Map(Vec<(String, Tree)>),
}

impl Tree {
    /// Reads the JSON that fleetfoot writes.
    fn parse(text: &str) -> Self {
        let bytes = text.as_bytes();
        let (tree, end) = Self::value(text, blank(bytes, 0));
        assert_eq!(blank(bytes, end), bytes.len(), "all of it is read");
        tree
    }

    fn value(text: &str, at: usize) -> (Self, usize) {
        let bytes = text.as_bytes();
        match bytes[at] {
            b'[' => {
                let (mut items, mut at) = (Vec::new(), blank(bytes, at + 1));
                while bytes[at] != b']' {
                    let (item, end) = Self::value(text, at);
                    items.push(item);
                    at = comma(bytes, end);
                }
                (Self::List(items), at + 1)
            }
            b'{' => {
                let (mut entries, mut at) = (Vec::new(), blank(bytes, at + 1));
                while bytes[at] != b'}' {
                    let (name, end) = leaf(text, at);
                    let colon = blank(bytes, end);
                    assert_eq!(bytes[colon], b':');
                    let (value, end) = Self::value(text, blank(bytes, colon + 1));
                    entries.push((name, value));
                    at = comma(bytes, end);
                }
                (Self::Map(entries), at + 1)
            }
            _ => {
                let (text, end) = leaf(text, at);
                (Self::Leaf(text), end)
            }
        }
    }

    fn write(&self, out: &mut String) {
        let (open, close) = if matches!(self, Self::List(_)) { ('[', ']') } else { ('{', '}') };
        match self {
            Self::Leaf(text) => return out.push_str(text),
            Self::List(items) => {
                out.push(open);
                for (at, item) in items.iter().enumerate() {
                    out.push_str(if at > 0 { "," } else { "" });
                    item.write(out);
                }
            }
            Self::Map(entries) => {
                out.push(open);
                for (at, (name, value)) in entries.iter().enumerate() {
                    out.push_str(if at > 0 { "," } else { "" });
                    out.push_str(name);
                    out.push(':');
                    value.write(out);
                }
            }
        }
        out.push(close);
    }

    fn child(&mut self, name: &str) -> &mut Self {
        let Self::Map(entries) = self else { panic!("no object") };
        &mut entries.iter_mut().find(|(key, _)| key.trim_matches('"') == name).expect("an entry").1
    }

    /// All leaves and lists below, in order.
    fn places<'a>(&'a mut self, out: &mut Vec<&'a mut Tree>) {
        match self {
            Self::Leaf(_) => out.push(self),
            // A list is a place of its own every other time that it is met: its items are, too.
            Self::List(items) if items.is_empty() || items.len() % 2 == 1 && items.iter().all(Self::is_leaf) => {
                out.push(self);
            }
            Self::List(items) => items.iter_mut().for_each(|item| item.places(out)),
            Self::Map(entries) => entries.iter_mut().for_each(|(_, value)| value.places(out)),
        }
    }

    fn is_leaf(&self) -> bool {
        matches!(self, Self::Leaf(_))
    }

    /// All names and expressions below.
    fn words(&self, out: &mut Vec<String>) {
        match self {
            Self::Leaf(text) => out.extend(text.starts_with('"').then(|| text.clone())),
            Self::List(items) => items.iter().for_each(|item| item.words(out)),
            Self::Map(entries) => entries.iter().for_each(|(_, value)| value.words(out)),
        }
    }
}

fn blank(bytes: &[u8], mut at: usize) -> usize {
    while at < bytes.len() && bytes[at].is_ascii_whitespace() {
        at += 1;
    }
    at
}

fn comma(bytes: &[u8], at: usize) -> usize {
    let at = blank(bytes, at);
    if bytes[at] == b',' { blank(bytes, at + 1) } else { at }
}

/// A text, a number or a word of JSON, and where it ends.
fn leaf(text: &str, at: usize) -> (String, usize) {
    let bytes = text.as_bytes();
    let mut end = at + 1;
    if bytes[at] == b'"' {
        while bytes[end] != b'"' {
            end += if bytes[end] == b'\\' { 2 } else { 1 };
        }
        end += 1;
    } else {
        while !b",]} \n".contains(&bytes[end]) {
            end += 1;
        }
    }
    (text[at..end].to_owned(), end)
}

const FLOATS: [&str; 10] =
    ["0.0", "-1.0", "1e300", "-1e300", "5e-324", "\"nan\"", "\"inf\"", "\"-inf\"", "1.7976931348623157e308", "1e17"];
const INTEGERS: [&str; 8] =
    ["0", "1", "2", "255", "65536", "4294967295", "9223372036854775807", "18446744073709551615"];
const EXPRESSIONS: [&str; 10] = [
    "\"1/0\"",
    "\"sqrt(-1)\"",
    "\"exp(exp(1000))\"",
    "\"x/(v - v)\"",
    "\"log(x - x)\"",
    "\"no_such_column\"",
    "\"\"",
    "\"x^999999999\"",
    "\"lag(x, 1000000)\"",
    "\"if(x > 0, 1/x, v)\"",
];

/// A model with one to three changes, and a checksum that fits.
fn mutant(model: &Tree, seed: u64) -> String {
    let mut changed = model.clone();
    let mut words = Vec::new();
    model.words(&mut words);
    let mut draw = (0..).map(|turn| mix(seed.wrapping_mul(1000).wrapping_add(turn)) as usize);
    let mut below = move |bound: usize| draw.next().unwrap_or_default() % bound.max(1);
    for _ in 0..=below(3) {
        let mut places = Vec::new();
        changed.child("model").places(&mut places);
        let count = places.len();
        let place = &mut *places[below(count)];
        match place {
            Tree::Leaf(text) if text.starts_with('"') => {
                *text = match below(2) {
                    0 => words[below(words.len())].clone(),
                    _ => EXPRESSIONS[below(EXPRESSIONS.len())].to_owned(),
                };
            }
            Tree::Leaf(text) if text.contains(['.', 'e']) && text.parse::<f64>().is_ok() => {
                FLOATS[below(FLOATS.len())].clone_into(text);
            }
            Tree::Leaf(text) if text.parse::<f64>().is_ok() => INTEGERS[below(INTEGERS.len())].clone_into(text),
            Tree::Leaf(text) => (if text == "true" { "false" } else { "null" }).clone_into(text),
            Tree::List(items) if items.is_empty() => items.push(Tree::Leaf("0.0".into())),
            Tree::List(items) => match below(3) {
                0 => items.clear(),
                1 => drop(items.pop()),
                _ => items.push(items[0].clone()),
            },
            Tree::Map(_) => unreachable!("no place is a map"),
        }
    }
    let mut canonical = String::new();
    changed.child("model").write(&mut canonical);
    *changed.child("checksum") = Tree::Leaf(format!("\"{}\"", blake3::hash(canonical.as_bytes()).to_hex()));
    let mut text = String::new();
    changed.write(&mut text);
    text
}

/// Every command that reads a model.
const COMMANDS: [&str; 17] = [
    "show m.json",
    "show m.json --transitions --json",
    "score m.json log.csv --episodes --plane x,v",
    "predict m.json log.csv -o p.csv",
    "rollout m.json log.csv --horizon 20 --starts 20 -o r.csv",
    "rollout m.json log.csv --horizon 20 --starts 20 --method rk4 --outside hold",
    "filter m.json log.csv --measured x=0.01",
    "filter m.json gaps.csv --measured x=0.01 --max-gap none -o f.csv",
    "resimulate m.json short.csv --iterations 5",
    "report m.json log.csv -o report.html",
    "control lqr m.json -o c.json",
    "control mpc m.json -o p.json",
    "export m.json --to c -o c",
    "export m.json --to rust -o rust",
    "export m.json --to python -o python",
    "export m.json --to latex -o latex",
    "export m.json --to npz -o npz",
];

#[test]
fn damaged_models_get_a_message() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let log = robot_csv(600, 0.3);
    let rows = |keep: &dyn Fn(usize) -> bool| -> String {
        let kept = log.lines().enumerate().filter(|(at, _)| *at == 0 || keep(*at));
        kept.map(|(_, line)| format!("{line}\n")).collect()
    };
    for (name, text) in
        [("log.csv", &log), ("gaps.csv", &rows(&|at| at % 97 < 40)), ("short.csv", &rows(&|at| at < 60))]
    {
        fs::write(path.join(name), text).expect("a file");
    }
    fs::write(path.join("r.toml"), "[columns]\nv = \"v [m/s]\"\n[states]\nx = {}\nv = {}\n[inputs]\nu = \"u\"\n")
        .expect("a recipe");
    let common = "log.csv -c r.toml";
    let fits = [
        ("pwa", format!("fit pwa {common} --predict next -p kmeans:3")),
        ("tree", format!("fit pwa {common} -p tree:2")),
        ("labels", format!("fit pwa {common} --predict next -p labels:mode")),
        ("sindy", format!("fit sindy {common} --degree 2")),
        ("narx", "fit narx log.csv --outputs x --inputs u --lags-out 2 --lags-in 1 --degree 2".to_owned()),
    ];
    let models: Vec<Tree> = (fits.iter())
        .map(|(name, command)| {
            let output = format!("{name}.json");
            fleetfoot(path, &command.split(' ').chain(["-o", &output]).collect::<Vec<_>>()).ok();
            Tree::parse(&fs::read_to_string(path.join(output)).expect("a model"))
        })
        .collect();
    // An unchanged model passes: the checksum is made as the program makes it.
    for model in &models {
        let mut text = String::new();
        model.write(&mut text);
        fs::write(path.join("m.json"), text).expect("a model");
        fleetfoot(path, &["show", "m.json"]).ok();
    }
    let full = std::env::var_os("FLEETFOOT_SWEEPS").is_some_and(|size| size == "full");
    let (mutants, step) = if full { (400, 1) } else { (32, 5) };
    let (mut refused, mut read, mut damaged) = (0, 0, 0);
    for seed in 0..mutants {
        let text = mutant(&models[seed as usize % models.len()], seed);
        fs::write(path.join("m.json"), &text).expect("a model");
        for command in COMMANDS.iter().skip(seed as usize % step).step_by(step) {
            let arguments: Vec<&str> = command.split(' ').collect();
            let answer = fleetfoot_within(path, &arguments, Duration::from_secs(120));
            let description = || {
                let kept = std::env::temp_dir().join("fleetfoot-mutant.json");
                fs::write(&kept, &text).expect("a model");
                format!("mutant {seed} ({}), `{command}`: exit {}\n{}", kept.display(), answer.code, answer.err)
            };
            assert!(matches!(answer.code, 0 | 1) && !answer.err.contains("panicked"), "{}", description());
            assert!(answer.code == 0 || answer.err.len() > 20, "{}", description());
            // Some empty lists are not written, so that the program makes another checksum.
            damaged += u32::from(answer.err.contains("checksum"));
            if answer.code == 1 { refused += 1 } else { read += 1 }
        }
    }
    println!("{read} runs read the model, {refused} refused it, {damaged} of them by its checksum");
    assert!(refused > 2 * damaged + 10 && read > 10, "{read} {refused} {damaged}");
}
