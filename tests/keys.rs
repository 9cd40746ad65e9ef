//! The page of keys has every key that commands print beside their reports.

use std::fs;

use serde_json::Value;

use crate::runner::*;

const PAGE: &str = include_str!("../docs/reference/reports.md");
/// Keys whose value has names for keys: functions of code, labels and their values, baselines.
const BY_NAME: [&str; 4] = ["calls", "labels", "baselines", "baseline_rmse"];

pub(crate) fn check_keys(value: &Value, named: bool, command: &str) {
    match value {
        Value::Array(all) => all.iter().for_each(|item| check_keys(item, false, command)),
        Value::Object(fields) => {
            for (key, value) in fields {
                assert!(
                    named || PAGE.contains(&format!("`{key}`")),
                    "docs/reference/reports.md does not tell of `{key}`, which {command} prints"
                );
                // Values of a label are names, too.
                check_keys(value, BY_NAME.contains(&key.as_str()) || (named && command == "stats"), command);
            }
        }
        _ => {}
    }
}

#[test]
fn the_page_describes_every_key() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    for (name, phase) in [("one.csv", 0.0), ("two.csv", 1.0), ("held-out.csv", 9.0)] {
        fs::write(path.join(name), robot_csv(800, phase)).expect("a file");
    }
    let recipe = "[columns]\nv = \"`v [m/s]`\"\n[states]\nx = { known = \"v\", regressor = false }\nv = {}\n[inputs]\nu = \"u\"\n\
                  [time]\ncolumn = \"t\"\n[[episodes]]\nmatch = \"one*\"\nfloor = \"wood\"\n";
    fs::write(path.join("robot.toml"), recipe).expect("a file");
    let commands = [
        "generate diffdrive -o runs --seconds 4 --dry-run",
        "scan -c robot.toml one.csv two.csv --dry-run",
        "scan -c robot.toml one.csv -o one.stats --chunk-rows 100",
        "scan -c robot.toml two.csv --plan one.stats -o two.stats",
        "stats merge one.stats two.stats -o all.stats",
        "stats info all.stats",
        "stats drop all.stats --where floor=wood -o dropped.stats",
        "stats compact all.stats -o small.stats",
        "fit sparse all.stats --dry-run",
        "fit sparse -c robot.toml one.csv two.csv --dry-run",
        "fit sindy -c robot.toml one.csv two.csv --dry-run",
        "fit pwa -c robot.toml one.csv two.csv --dry-run",
        "fit pwa -c robot.toml one.csv two.csv --partition kmeans:2 --partition-on v -o model.json",
        "score model.json held-out.csv --plane v,u --bins 4",
        "predict model.json held-out.csv -o predictions.parquet",
        "report model.json held-out.csv --horizon 20 --svg figures",
        "export model.json --to c -o code",
        "init one.csv",
    ];
    for command in commands {
        let mut words: Vec<&str> = command.split(' ').collect();
        words.push("--json");
        check_keys(&fleetfoot(path, &words).ok().json(), false, command.split(' ').next().unwrap_or_default());
    }
}
