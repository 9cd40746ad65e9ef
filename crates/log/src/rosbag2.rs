//! Folders that rosbag2 writes: a `metadata.yaml` and the files that it names.

use std::{
    fs::{self, File},
    io::Read,
    path::{Component, Path, PathBuf},
};

use granit_parser::{Event, Parser, ScalarStyle};

use crate::{
    Compression, Error, Format,
    format::{BAG_KEY, BAG_METADATA},
};

mod database;
mod definitions;

pub(crate) use database::DatabaseContainer;

/// Command that converts a recording from a storage that cannot be read.
const CONVERT: &str = "convert its folder: `ros2 bag convert -i FOLDER -o out.yaml`, where out.yaml says `output_bags: [{uri: NEW_FOLDER, storage_id: mcap, all: true}]`";

/// Bytes of metadata that are read; real ones have a few kilobytes per topic.
const MAX_METADATA: u64 = 16 << 20;

/// Values to read from the metadata.
#[derive(Default)]
struct Information {
    storage_identifier: String,
    relative_file_paths: Vec<String>,
    compression_mode: String,
}

/// A mapping with the key whose value comes next, or a sequence.
enum Open {
    Mapping(Option<String>),
    Sequence,
}

/// Position of the next node.
enum Place {
    Key,
    /// The value of one of the wanted keys, or an item of it.
    Wanted(&'static str),
    Item(&'static str),
    Elsewhere,
}

const WANTED: [&str; 3] = ["storage_identifier", "relative_file_paths", "compression_mode"];

fn place(open: &[Open]) -> Place {
    let wanted = |bag: &str, key: &str| match bag.as_bytes() == BAG_KEY {
        true => WANTED.into_iter().find(|wanted| *wanted == key),
        false => None,
    };
    match open {
        [.., Open::Mapping(None)] => Place::Key,
        [Open::Mapping(Some(bag)), Open::Mapping(Some(key))] => {
            wanted(bag, key).map_or(Place::Elsewhere, Place::Wanted)
        }
        [Open::Mapping(Some(bag)), Open::Mapping(Some(key)), Open::Sequence] => {
            wanted(bag, key).map_or(Place::Elsewhere, Place::Item)
        }
        _ => Place::Elsewhere,
    }
}

impl Information {
    /// The wanted values of a text, event by event: three of them need no tree, and nothing that a hostile text nests or repeats is built.
    fn parse(text: &str) -> Result<Self, String> {
        let (mut metadata, mut open) = (Self::default(), Vec::new());
        let mut has_key = false;
        for event in Parser::new_from_str(text) {
            let (event, span) = event.map_err(|error| error.to_string())?;
            let line = span.start.line();
            let unexpected = |what: &str| Err(format!("line {line}: {what}"));
            match event {
                Event::Scalar(value, style, ..) => match place(&open) {
                    Place::Key => {
                        has_key |= open.len() == 1 && value.as_bytes() == BAG_KEY;
                        if let Some(Open::Mapping(key)) = open.last_mut() {
                            *key = Some(value.into_owned());
                        }
                        continue;
                    }
                    Place::Wanted(_) if style == ScalarStyle::Plain && matches!(&*value, "" | "~" | "null") => {}
                    Place::Wanted("storage_identifier") => metadata.storage_identifier = value.into_owned(),
                    Place::Wanted("compression_mode") => metadata.compression_mode = value.into_owned(),
                    Place::Item("relative_file_paths") => metadata.relative_file_paths.push(value.into_owned()),
                    Place::Wanted(key) | Place::Item(key) => {
                        return unexpected(&format!("`{key}` has an unexpected type"));
                    }
                    Place::Elsewhere => {}
                },
                Event::MappingStart(..) | Event::SequenceStart(..) => {
                    let next = match event {
                        Event::MappingStart(..) => Open::Mapping(None),
                        _ => Open::Sequence,
                    };
                    match (place(&open), &next) {
                        (Place::Key, _) => return unexpected("a key that is not text"),
                        (Place::Wanted("relative_file_paths"), Open::Sequence) | (Place::Elsewhere, _) => {}
                        (Place::Wanted(key) | Place::Item(key), _) => {
                            return unexpected(&format!("`{key}` has an unexpected type"));
                        }
                    }
                    open.push(next);
                    continue;
                }
                Event::MappingEnd | Event::SequenceEnd => drop(open.pop()),
                Event::Alias(..) => return unexpected("an alias, which rosbag2 does not write"),
                _ => continue,
            }
            // A node has ended: in a mapping a key comes next.
            if let Some(Open::Mapping(key)) = open.last_mut() {
                *key = None;
            }
        }
        if has_key { Ok(metadata) } else { Err("the key `rosbag2_bagfile_information` is missing".into()) }
    }
}

/// Storage of a file of a recording, with how the file is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Storage {
    Mcap(Compression),
    Database(Compression),
}

/// The files of a rosbag2 folder, in the order of its metadata.
pub(crate) fn files(folder: &Path) -> Result<Vec<(PathBuf, Storage)>, Error> {
    let path = folder.join(BAG_METADATA);
    let damaged =
        |place: &str, problem: String, mend| Error::Damaged { path: path.clone(), place: place.into(), problem, mend };
    let io = |source| Error::Io { path: path.clone(), action: "read", source };
    let mut text = String::new();
    File::open(&path).map_err(io)?.take(MAX_METADATA).read_to_string(&mut text).map_err(io)?;
    let information = Information::parse(&text).map_err(|problem| {
        let mend = "mend it, remove it (the files are then read one by one), or write it again with `ros2 bag reindex`";
        damaged("the text", problem, mend)
    })?;
    let storage = information.storage_identifier.as_str();
    if !matches!(storage, "mcap" | "sqlite3" | "") {
        let problem = format!("a rosbag2 recording stored as {storage}, which fleetfoot cannot read");
        return Err(Error::WrongFormat { path: folder.into(), problem, mend: CONVERT });
    }
    // Messages in a database show by their first bytes that each is packed alone.
    if storage != "sqlite3" && information.compression_mode.eq_ignore_ascii_case("message") {
        let problem = "its messages are compressed one by one, which fleetfoot cannot read".into();
        return Err(Error::WrongFormat { path: folder.into(), problem, mend: CONVERT });
    }
    if information.relative_file_paths.is_empty() {
        return Err(damaged(
            "relative_file_paths",
            "it names no file".into(),
            "write it again with `ros2 bag reindex`, or remove it",
        ));
    }
    let mut files = Vec::new();
    for name in &information.relative_file_paths {
        let inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
        if !Path::new(name).components().all(inside) {
            let mend = "copy the file into the folder, and name it without a path in the list";
            return Err(damaged("relative_file_paths", format!("{name} is not in the folder"), mend));
        }
        let file = locate(folder, name).ok_or_else(|| {
            let problem = format!("{name} does not exist");
            damaged("relative_file_paths", problem, "copy the file beside it, or remove its line from the list")
        })?;
        let storage = match Format::of(&file) {
            Some(Format::Mcap(compression)) => Storage::Mcap(compression),
            Some(Format::Db3(compression)) => Storage::Database(compression),
            _ => return Err(Error::UnknownFormat { path: file }),
        };
        files.push((file, storage));
    }
    Ok(files)
}

/// Finds a file of the list. The first versions of rosbag2 put the folder's own name before it; and a file may have been compressed or
/// unpacked since.
fn locate(folder: &Path, name: &str) -> Option<PathBuf> {
    let base = Path::new(name).file_name()?.to_str()?;
    let mut names = vec![name.to_owned(), base.to_owned()];
    for ending in [".zstd", ".zst"] {
        names.push(format!("{base}{ending}"));
        names.extend(base.strip_suffix(ending).map(str::to_owned));
    }
    names.into_iter().map(|name| folder.join(name)).find(|path| fs::metadata(path).is_ok_and(|data| data.is_file()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::is_bag;

    fn bag(names: &[&str], information: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            fs::write(folder.path().join(name), "x").unwrap();
        }
        let text = format!("rosbag2_bagfile_information:\n  version: 5\n{information}");
        fs::write(folder.path().join(BAG_METADATA), text).unwrap();
        folder
    }

    fn message(folder: &tempfile::TempDir) -> String {
        files(folder.path()).unwrap_err().to_string()
    }

    #[test]
    fn files_come_in_the_order_of_the_metadata() {
        let information = "  storage_identifier: mcap\n  relative_file_paths:\n    - run/b_1.mcap\n    - a_0.mcap.zstd\n    - c.mcap\n  \
                           compression_format: zstd\n  compression_mode: FILE\n  topics_with_message_count: []\n";
        let folder = bag(&["a_0.mcap.zstd", "b_1.mcap", "c.mcap.zstd", "unlisted.mcap"], information);
        let files = files(folder.path()).unwrap();
        let names: Vec<_> =
            files.into_iter().map(|(path, storage)| (path.file_name().unwrap().to_owned(), storage)).collect();
        let expected =
            [("b_1.mcap", Compression::None), ("a_0.mcap.zstd", Compression::Zstd), ("c.mcap.zstd", Compression::Zstd)];
        assert_eq!(names, expected.map(|(name, compression)| (name.into(), Storage::Mcap(compression))));
        assert_eq!(Format::of(folder.path()), Some(Format::Rosbag2));
    }

    #[test]
    fn unreadable_files_are_reported_with_a_remedy() {
        let folder = bag(&["a.db3"], "  storage_identifier: tape\n  relative_file_paths: [a.db3]\n");
        let text = message(&folder);
        assert!(text.contains("tape") && text.contains("ros2 bag convert"), "{text}");
        let folder = bag(&[], "  storage_identifier: mcap\n  relative_file_paths: [a.mcap]\n");
        let text = message(&folder);
        assert!(text.contains("metadata.yaml") && text.contains("a.mcap does not exist"), "{text}");
        let folder = bag(
            &["a.mcap"],
            "  storage_identifier: mcap\n  compression_mode: MESSAGE\n  relative_file_paths: [a.mcap]\n",
        );
        assert!(message(&folder).contains("one by one"));
        assert!(message(&bag(&[], "  storage_identifier: mcap\n")).contains("names no file"));
        for nested in [
            "  other: {a: {storage_identifier: db}, [x]: 1}\n",
            "  relative_file_paths: [[a.mcap]]\n",
            "  b: &b c\n  a: *b\n",
        ] {
            assert!(matches!(files(bag(&[], nested).path()), Err(Error::Damaged { .. })), "{nested}");
        }
        let deep = format!("  other: {}\n  relative_file_paths: [a.mcap]\n", "[".repeat(200_000));
        assert!(matches!(files(bag(&[], &deep).path()), Err(Error::Damaged { .. })));
        let elsewhere =
            "  topics: [{storage_identifier: db, relative_file_paths: x}]\n  relative_file_paths: [a.mcap]\n";
        assert!(matches!(files(bag(&["a.mcap"], elsewhere).path()), Ok(files) if files.len() == 1));
        for broken in ["  relative_file_paths: [a\n", "  relative_file_paths: {a: 1}\n", "\t- x", "  a: *b\n"] {
            assert!(matches!(files(bag(&[], broken).path()), Err(Error::Damaged { .. })), "{broken}");
        }
    }

    #[test]
    fn files_outside_of_the_folder_are_refused() {
        let outside = tempfile::tempdir().unwrap();
        let secret = outside.path().join("a.mcap");
        fs::write(&secret, "x").unwrap();
        let absolute = secret.display().to_string();
        for name in ["../a.mcap", "run/../../a.mcap", absolute.as_str(), "/a.mcap"] {
            let information = format!("  storage_identifier: mcap\n  relative_file_paths: [{name}]\n");
            // A file of that name in the folder is none that the list names.
            let text = message(&bag(&["a.mcap"], &information));
            assert!(text.contains("is not in the folder") && text.contains(name), "{text}");
        }
    }

    #[test]
    fn metadata_of_something_else_makes_no_bag() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(BAG_METADATA), "title: my runs\n").unwrap();
        assert!(!is_bag(folder.path()));
        assert_eq!(Format::of(folder.path()), None);
    }
}
