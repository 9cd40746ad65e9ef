//! Output of other people's decoders for log files: the lines of `tests/peers/columns.py`.

use std::{
    collections::BTreeMap,
    ffi::{OsStr, OsString},
    fs,
    path::{Path, PathBuf},
    process::Command,
};

/// A topic as a decoder reports it.
#[derive(Debug, Default)]
pub(crate) struct Topic {
    pub(crate) name: String,
    /// Messages that were decoded.
    pub(crate) messages: usize,
    /// Messages that could not be decoded.
    pub(crate) undecoded: u64,
    pub(crate) log_time: Vec<i64>,
    pub(crate) publish_time: Vec<i64>,
    /// Paths within the message with one value a message, NaN where a message has none.
    pub(crate) columns: Vec<(String, Vec<f64>)>,
}

/// A file as a decoder reports it.
#[derive(Debug, Default)]
pub(crate) struct PeerLog {
    pub(crate) topics: Vec<Topic>,
    /// Error that ended the reading, if the file is damaged.
    pub(crate) damage: Option<String>,
}

/// The interpreter with the packages that decode logs, where there is one.
pub(crate) fn python() -> Option<OsString> {
    crate::outside::python("mcap_ros1.writer, mcap_ros2.writer, mcap_protobuf.writer, zstandard, lz4")
}

/// The logs of every kind that other writers write.
pub(crate) fn write_logs(python: &OsStr) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    run(python, "write_logs.py", &[folder.path().as_os_str()]);
    folder
}

/// Reports of the decoders on some files, by the names of the files; with `long`, long arrays too.
pub(crate) fn read_logs(python: &OsStr, files: &[PathBuf], long: bool) -> BTreeMap<String, PeerLog> {
    let option: &[&OsStr] = if long { &[OsStr::new("--long")] } else { &[] };
    let arguments: Vec<&OsStr> = option.iter().copied().chain(files.iter().map(|file| file.as_os_str())).collect();
    read_lines(&run(python, "read_logs.py", &arguments))
}

/// Reports in the lines, by the names of the files.
pub(crate) fn read_lines(lines: &str) -> BTreeMap<String, PeerLog> {
    let mut by_file: BTreeMap<String, PeerLog> = BTreeMap::new();
    for line in lines.lines() {
        let json: serde_json::Value = serde_json::from_str(line).unwrap();
        let file = by_file.entry(json["file"].as_str().unwrap().to_owned()).or_default();
        match json["damage"].as_str() {
            Some(damage) => file.damage = Some(damage.to_owned()),
            None => take(&mut file.topics, &json),
        }
    }
    by_file
}

/// The truth that the writer left beside a file, where it did.
pub(crate) fn truth(file: &Path) -> Option<Vec<Topic>> {
    let mut path = file.as_os_str().to_owned();
    path.push(".truth.jsonl");
    let text = fs::read_to_string(path).ok()?;
    let mut topics = Vec::new();
    text.lines().for_each(|line| take(&mut topics, &serde_json::from_str(line).unwrap()));
    Some(topics)
}

/// Output of a script.
pub(crate) fn run(python: &OsStr, script: &str, arguments: &[&OsStr]) -> String {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/peers").join(script);
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn take(topics: &mut Vec<Topic>, json: &serde_json::Value) {
    let name = json["topic"].as_str().unwrap();
    let times = |key: &str| json[key].as_array().unwrap().iter().map(|time| time.as_i64().unwrap()).collect();
    if json["messages"].is_number() {
        topics.push(Topic {
            name: name.to_owned(),
            messages: json["messages"].as_u64().unwrap() as usize,
            undecoded: json["undecoded"].as_u64().unwrap(),
            log_time: times("log_time"),
            publish_time: times("publish_time"),
            columns: Vec::new(),
        });
    } else if json["values"].is_array() {
        let topic = topics.iter_mut().find(|topic| topic.name == name).unwrap();
        let inside = json["name"].as_str().unwrap().strip_prefix(name).unwrap();
        topic.columns.push((inside.strip_prefix('.').unwrap_or(inside).to_owned(), values(&json["values"])));
    }
}

/// The numbers of a line. The workspace's JSON parser gives the nearest `f64` of any decimal.
fn values(json: &serde_json::Value) -> Vec<f64> {
    let number = |value: &serde_json::Value| match value {
        serde_json::Value::Null => f64::NAN,
        serde_json::Value::String(text) => text.parse().unwrap(),
        value => value.as_f64().unwrap(),
    };
    json.as_array().unwrap().iter().map(number).collect()
}
