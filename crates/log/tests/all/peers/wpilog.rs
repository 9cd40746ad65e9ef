//! Logs of WPILib, held against what robotpy-wpiutil reads in them.

use std::path::Path;

use super::{
    hold::hold,
    oracle::{read_lines, run},
};

#[test]
fn every_number_of_logs_of_wpilib() {
    let Some(python) = crate::outside::python("wpiutil") else { return };
    let folder = tempfile::tempdir().unwrap();
    run(&python, "write_wpilog.py", &[folder.path().as_os_str(), "800".as_ref()]);
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/robot.wpilog");
    for (path, numbers) in [(folder.path().join("robot.wpilog"), 28_000), (fixture, 2_100)] {
        let lines = run(&python, "read_wpilog.py", &[path.as_os_str()]);
        let peer_read = read_lines(&lines).into_values().next().unwrap_or_default();
        let held = hold(&path, &peer_read.topics, false);
        eprintln!("{}: {} topics, {} messages, {} numbers", path.display(), held.topics, held.messages, held.numbers);
        assert_eq!(held.differences, [""; 0], "{}", path.display());
        assert_eq!(held.topics, 12, "{:?}", held.refused);
        assert!(held.numbers > numbers, "{}", held.numbers);
    }
}
