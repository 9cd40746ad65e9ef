//! Logs of ArduPilot, held against what pymavlink reads in them.

use std::path::Path;

use super::{
    hold::hold,
    oracle::{read_lines, run},
};

#[test]
fn every_number_of_logs_of_ardupilot() {
    let Some(python) = crate::outside::python("pymavlink.DFReader") else { return };
    let folder = tempfile::tempdir().unwrap();
    run(&python, "write_dataflash.py", &[folder.path().as_os_str(), "600".as_ref()]);
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    for (path, topics, numbers) in [
        (folder.path().join("flight.bin"), 14, 20_000),
        (folder.path().join("flight.log"), 13, 20_000),
        (fixtures.join("flight.bin"), 14, 2_000),
        (fixtures.join("flight.log"), 13, 2_000),
    ] {
        let lines = run(&python, "read_dataflash.py", &[path.as_os_str()]);
        let peer_read = read_lines(&lines).into_values().next().unwrap_or_default();
        let held = hold(&path, &peer_read.topics, false);
        eprintln!("{}: {} topics, {} messages, {} numbers", path.display(), held.topics, held.messages, held.numbers);
        assert_eq!(held.differences, [""; 0], "{}", path.display());
        assert_eq!(held.topics, topics, "{:?}", held.refused);
        assert!(held.numbers > numbers, "{}", held.numbers);
    }
}
