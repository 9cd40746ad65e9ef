//! Arrays of numpy and scipy, held against what these wrote into them.

use fleetfoot_data::{ColumnKind, Halo, Source};
use fleetfoot_log::{Selection, TimeSpec, open};

use super::oracle::run;

#[test]
fn every_number_of_written_arrays() {
    let Some(python) = crate::outside::python("numpy, scipy.io") else { return };
    let folder = tempfile::tempdir().unwrap();
    let truth = run(&python, "write_arrays.py", &[folder.path().as_os_str()]);
    let mut numbers = 0;
    for line in truth.lines() {
        let parsed: serde_json::Value = serde_json::from_str(line).unwrap();
        let path = folder.path().join(parsed["file"].as_str().unwrap());
        let columns = parsed["columns"].as_object().unwrap();
        let time = TimeSpec::Uniform { dt_seconds: 1.0 };
        let recording = open(&[&path], &Selection { time, ..Selection::new(columns.keys()) }).unwrap();
        let rows = parsed["rows"].as_u64().unwrap() as usize;
        let block = recording.read(0, 0..rows, Halo::default()).unwrap();
        for (place, (column, values)) in columns.iter().enumerate() {
            for (value_read, value) in block.column(place).iter().zip(values.as_array().unwrap()) {
                numbers += 1;
                match (value.as_str(), &recording.columns()[place].kind) {
                    (Some(text), ColumnKind::Category(names)) => {
                        assert_eq!(names[*value_read as usize], text, "{column}")
                    }
                    (None, _) if value.is_null() => assert!(value_read.is_nan(), "{}: {column}", path.display()),
                    _ => assert_eq!(Some(*value_read), value.as_f64(), "{}: {column}", path.display()),
                }
            }
        }
    }
    assert!(numbers > 100_000, "{numbers}");
}
