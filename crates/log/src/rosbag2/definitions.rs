//! Definitions of message types for recordings that have none in the file.

use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use fleetfoot_message::complete_definition;

use crate::container::SchemaRecord;

/// Bytes of a definition that are read; real ones have a few hundred.
const MAX_DEFINITION: u64 = 1 << 20;

/// The list of folders that a sourced ROS environment sets.
const ENVIRONMENT: &str = "AMENT_PREFIX_PATH";

/// Folders with definitions of types, `PACKAGE/msg/TYPE.msg` or `TYPE.msg`.
pub(super) struct Definitions {
    folders: Vec<PathBuf>,
}

impl Definitions {
    /// The folder of a recording, the one above it, and the packages of the sourced ROS environment, in this order.
    pub(super) fn beside(recording: &Path) -> Self {
        let here = recording.parent().map(|folder| if folder.as_os_str().is_empty() { Path::new(".") } else { folder });
        let above =
            here.and_then(|here| here.canonicalize().ok()).and_then(|here| here.parent().map(Path::to_path_buf));
        let prefixes = std::env::var_os(ENVIRONMENT).unwrap_or_default();
        let shared = std::env::split_paths(&prefixes).map(|prefix| prefix.join("share"));
        Self { folders: here.map(Path::to_path_buf).into_iter().chain(above).chain(shared).collect() }
    }

    /// The schema of a type, from these folders and the standard packages.
    ///
    /// # Errors
    /// The missing definition and the searched places, in words.
    pub(super) fn schema(&self, kind: &str) -> Result<SchemaRecord, String> {
        match complete_definition(kind, &|name| self.text(name)) {
            Ok(text) => Ok(SchemaRecord {
                name: kind.to_owned(),
                encoding: "ros2msg".to_owned(),
                data: text.into_bytes().into(),
            }),
            Err(missing) => {
                let file = format!("{missing}.msg");
                let of = if missing == kind { String::new() } else { format!("the type `{missing}` of ") };
                Err(format!(
                    "{of}its type `{kind}` is not described in the file, and is none of the standard packages: put `{file}` beside the recording, \
                     or source the ROS workspace that has it ({ENVIRONMENT})"
                ))
            }
        }
    }

    fn text(&self, name: &str) -> Option<String> {
        let parts: Vec<&str> = name.split('/').collect();
        let [package, "msg", kind] = parts[..] else { return None };
        // Names of packages and types, not ways out of the folder.
        if ![package, kind].iter().all(|part| part.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')) {
            return None;
        }
        let file = format!("{kind}.msg");
        let places = |folder: &PathBuf| [folder.join(package).join("msg").join(&file), folder.join(&file)];
        self.folders.iter().flat_map(places).find_map(|path| {
            let mut text = String::new();
            File::open(path).ok()?.take(MAX_DEFINITION).read_to_string(&mut text).ok()?;
            Some(text)
        })
    }
}
