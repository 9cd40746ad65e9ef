//! PX4's logs from the command line: `info`, `init`, fits and scores, alone and by the folder.

use std::{fs, path::Path};

use crate::{
    runner::fleetfoot,
    ulog_writer::{Ulog, flight},
};

/// v' = 3 u - 2 v in exact steps of 10 ms, sampled 2 ms before it is published.
fn write_log(path: &Path, phase: f64) {
    let mut log = Ulog::new(500_000);
    log.format("rover_state:uint64_t timestamp;uint64_t timestamp_sample;float mode;double[2] v;uint8_t[4] _padding0;")
        .format("rover_command:uint64_t timestamp;uint64_t timestamp_sample;double u;")
        .entry(b'P', "float RV_GAIN", &3_f32.to_le_bytes())
        .subscribe(0, 1, "rover_command")
        .subscribe(1, 2, "rover_state");
    let mut v = 0.0_f64;
    for step in 0..1500_u64 {
        let measured = 1_000_000 + 10_000 * step;
        let published = measured + 1500 + 250 * (step % 3);
        let u = (0.05 * step as f64 + phase).sin() + 0.3 * (0.011 * step as f64).cos();
        let (published, measured) = (published.to_le_bytes(), measured.to_le_bytes());
        log.data(1, &[&published, &measured, &u.to_le_bytes()]);
        log.data(2, &[&published, &measured, &[0; 4], &v.to_le_bytes(), &(-v).to_le_bytes()]);
        v += 0.01 * (3.0 * u - 2.0 * v);
    }
    fs::write(path, log.bytes).unwrap();
}

#[test]
fn a_rover_is_identified_from_its_logs() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    fs::create_dir(folder.path().join("runs")).unwrap();
    write_log(&folder.path().join("runs/a.ulg"), 0.0);
    write_log(&folder.path().join("runs/b.ulg"), 1.0);
    write_log(&folder.path().join("held.ulg"), 2.0);

    let info = run(&["info", "held.ulg", "--json"]).ok().json();
    assert_eq!(info[0]["format"], "ULog");
    assert_eq!(info[0]["topics"][1]["name"], "/rover_state.1");
    assert_eq!(info[0]["topics"][0]["messages"], 1500);
    assert_eq!(info[0]["metadata"]["parameter.RV_GAIN"], "3");
    let starter = run(&["init", "held.ulg"]).ok().out;
    assert!(starter.contains("\"/rover_state.1.v[0]\"") && !starter.contains("timestamp_sample"), "{starter}");

    let recipe = "[columns]\nv = \"/rover_state.1.v[0]\"\n[states]\nv = { derivative = \"forward\" }\n[inputs]\n\
                  u = \"/rover_command.u\"\n[time]\ncolumn = \"/rover_state.1.timestamp_sample\"\n";
    fs::write(folder.path().join("rover.toml"), recipe).unwrap();
    run(&["fit", "pwa", "-c", "rover.toml", "runs", "-p", "average", "-o", "model.json"]).ok();
    let model = run(&["show", "model.json", "--json"]).ok().json();
    for (place, expected) in [(0, -2.0), (1, 3.0)] {
        let coefficient = model.pointer(&format!("/model/latents/0/coefficients/0/{place}")).unwrap().as_f64().unwrap();
        assert!((coefficient - expected).abs() < 1e-6, "{coefficient} for {expected}");
    }
    run(&["score", "model.json", "held.ulg"]).ok();
    run(&["score", "model.json", "runs/*.ulg"]).ok();
    run(&["predict", "model.json", "held.ulg", "-o", "held.mcap"]).ok();
}

#[test]
fn damage_and_dropouts_are_printed() {
    let folder = tempfile::tempdir().unwrap();
    let mut log = flight(60);
    log.dropout(40);
    let cut = log.bytes.len() - 9;
    fs::write(folder.path().join("run.ulg"), &log.bytes[..cut]).unwrap();
    let text = fleetfoot(folder.path(), &["info", "run.ulg"]).ok().out;
    assert!(text.contains("damaged") && text.contains("the file ends inside"), "{text}");
    fs::write(folder.path().join("run.ulg"), &log.bytes).unwrap();
    let text = fleetfoot(folder.path(), &["info", "run.ulg"]).ok().out;
    assert!(text.contains("1 dropout of 0.04 s") && text.contains("metadata: 10 values"), "{text}");
    fs::write(folder.path().join("run.ulg"), "t,x\n0,1\n").unwrap();
    fleetfoot(folder.path(), &["info", "run.ulg"]).fails(&["run.ulg", "the content is not ULog", "text"]);
}
