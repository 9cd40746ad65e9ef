//! Every format of logs from the command line, each written by an independent writer: `info`, `init`, `fit` and `score` find
//! the same rover in all of them.

use std::{fs, path::Path};

use crate::runner::fleetfoot;

/// File or folder, speed and command.
const FORMATS: [(&str, &str, &str); 8] = [
    ("lerobot", "observation.state[0]", "action[0]"),
    ("rover.bag", "/speed.data", "/command.data"),
    ("rover.db3", "/speed.data", "/command.data"),
    ("rover.bin", "/RVR.V", "/RVR.U"),
    ("rover.log", "/RVR.V", "/RVR.U"),
    ("rover.wpilog", "/speed.value", "/command.value"),
    ("rover.npz", "v", "u"),
    ("rover.mat", "run.v", "run.u"),
];

#[test]
fn every_format_gives_the_same_rover() {
    let folder = tempfile::tempdir().unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data");
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    for (file, v, u) in FORMATS {
        let path = data.join(if file == "lerobot" { file.into() } else { format!("rovers/{file}") });
        let path = path.to_str().unwrap();
        let info = run(&["info", path, "--json"]).ok().json();
        let rows = |info: &serde_json::Value| {
            info["rows"].as_u64().or_else(|| info["topics"][0]["messages"].as_u64()).unwrap()
        };
        let all: u64 = info.as_array().unwrap().iter().map(rows).sum();
        // LeRobot keeps single precision.
        let (expected, tolerance) = if file == "lerobot" { (360, 1e-3) } else { (300, 1e-6) };
        assert_eq!(all, expected, "{file}: {info}");
        let draft = run(&["init", path]).ok().out;
        assert!([v, u].iter().all(|field| draft.contains(&format!("{field:?}"))), "{file}: {draft}");
        let recipe = format!(
            "[columns]\nv = {v:?}\nu = {u:?}\n[states]\nv = {{ derivative = \"forward\" }}\n[inputs]\nu = {{}}\n"
        );
        fs::write(folder.path().join("rover.toml"), recipe).unwrap();
        run(&["fit", "pwa", "-c", "rover.toml", path, "-p", "average", "-o", "model.json"]).ok();
        let model = run(&["show", "model.json", "--json"]).ok().json();
        for (place, expected) in [(0, -2.0), (1, 3.0)] {
            let coefficient =
                model.pointer(&format!("/model/latents/0/coefficients/0/{place}")).unwrap().as_f64().unwrap();
            assert!((coefficient - expected).abs() < tolerance, "{file}: {coefficient} for {expected}");
        }
        let score = run(&["score", "model.json", path]).ok();
        assert!(score.out.contains("d(v)/dt"), "{file}: {}", score.out);
    }
}
