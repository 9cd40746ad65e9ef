//! Rows that trained a model are known as such, in whatever file they stand.

use std::{fs, path::Path};

use crate::{narx, runner::*};

/// The lines of a log whose numbers (the header is 0) are in a range, with the header.
fn lines(text: &str, range: std::ops::Range<usize>) -> String {
    let kept = |(number, _): &(usize, &str)| *number == 0 || range.contains(number);
    text.lines().enumerate().filter(kept).map(|(_, line)| format!("{line}\n")).collect()
}

/// Returns true if a note says that scores on a file are in-sample.
#[track_caller]
fn has_in_sample_note(folder: &Path, model: &str, log: &str) -> bool {
    let output = fleetfoot(folder, &["score", model, log, "--json"]).ok();
    let noted = output.err.contains("used in training, as a whole or in part");
    let scored = output.json();
    assert_eq!(scored["in_sample_episodes"].as_array().is_some_and(|names| !names.is_empty()), noted, "{scored:#}");
    let in_training = |episode: &serde_json::Value| episode["in_training"] == true;
    assert_eq!(
        scored["by_episode"].as_array().is_some_and(|episodes| episodes.iter().any(in_training)),
        noted,
        "{scored:#}"
    );
    noted
}

#[test]
fn parts_of_training_logs_are_recognised() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let whole = robot_csv(3000, 1.0);
    write("whole.csv", &whole);
    write("middle.csv", &lines(&whole, 700..1700));
    write("tail.csv", &lines(&whole, 2200..3001));
    write("longer.csv", &robot_csv(4000, 1.0));
    write("other.csv", &robot_csv(3000, 5.0));
    write(
        "robot.toml",
        "[columns]\nv = \"`v [m/s]`\"\n[states]\nv = { derivative = \"forward\" }\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n",
    );
    run(&["scan", "-c", "robot.toml", "whole.csv", "-o", "whole.stats"]);
    run(&["fit", "pwa", "-c", "robot.toml", "whole.csv", "--partition", "kmeans:2", "-o", "pwa.json"]);
    run(&["fit", "sindy", "-c", "robot.toml", "whole.csv", "-o", "sindy.json"]);
    run(&["fit", "sindy", "whole.stats", "-o", "sums.json"]);
    for model in ["pwa.json", "sindy.json", "sums.json"] {
        let noted: Vec<bool> = ["whole.csv", "middle.csv", "tail.csv", "longer.csv", "other.csv"]
            .map(|log| has_in_sample_note(folder.path(), model, log))
            .into();
        assert_eq!(noted, [true, true, true, true, false], "{model}");
    }
    // Rows that simulations start from are training rows as well; a page has a note about its data.
    let rolled = run(&["rollout", "sindy.json", "middle.csv", "--horizon", "20", "--starts", "50"]);
    assert!(rolled.err.contains("in part (middle.csv)"), "{}", rolled.err);
    // Whatever they happen to read of it.
    let few = run(&["rollout", "sindy.json", "middle.csv", "--horizon", "5", "--starts", "2"]);
    assert!(few.err.contains("in part (middle.csv)"), "{}", few.err);
    run(&["report", "sindy.json", "middle.csv", "-o", "page.html"]);
    let page = fs::read_to_string(folder.path().join("page.html")).unwrap();
    assert!(page.contains("in-sample: ") && page.contains("1 of them trained the model, as a whole or in part"));
}

/// An autoregression holds out the end of its log: its training part is a separate episode.
#[test]
fn whole_logs_of_autoregressions_are_recognised() {
    let log = narx::csv(2000, 3, false, 0.01);
    let folder = narx::folder(&[("log.csv", log.clone()), ("end.csv", lines(&log, 1700..2001))]);
    fs::write(
        folder.path().join("r.toml"),
        "[states]\ny = {}\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n[narx]\nlags_out = 2\nlags_in = 1\n",
    )
    .unwrap();
    narx::fit(folder.path(), &["-c", "r.toml", "log.csv", "--test-share", "0.2", "-o", "narx.json"]).ok();
    assert!(has_in_sample_note(folder.path(), "narx.json", "log.csv"));
    assert!(!has_in_sample_note(folder.path(), "narx.json", "end.csv"));
}
