//! Transitions and pairs of regions as text.

use fleetfoot_model::{PhaseBins, RegionPair, describe_transitions};

use crate::{counted, models};

/// Tables from sample to sample, along the phase and from stride to stride; then the pairs, those with the same map
/// first.
#[test]
fn tables_of_transitions_print_as_text() {
    let mut model = counted::model(1_000);
    let pair = |a, b, p| RegionPair { regions: [a, b], statistic: 12.5, freedom: 3, p };
    // 0 and 4 are neighbours in one direction, 2 and 4 in none.
    model.partitions[0].pairs = vec![pair(0, 1, 0.02), pair(0, 4, 0.04), pair(2, 4, 1e-9), pair(3, 4, f64::NAN)];
    let text = describe_transitions(&model, false).expect("counted");
    let line =
        |start: &str| text.lines().find(|line| line.trim_start().starts_with(start)).unwrap_or_default().to_owned();
    assert_eq!(
        line("0.00..0.50"),
        "  0.00..0.50  0.0089  0.9881  0.0000  0.0010  0.0020    1012  0 to 4 98.8 %, 4 to 0 0.1 %"
    );
    assert_eq!(line("0.50..1.00"), "  0.50..1.00       -       -       -       -       -       0");
    assert!(
        text.contains("a stride begins where the phase wraps; 19 of 5.21053 rows (0.104211 s) on average"),
        "{text}"
    );
    // Holm's of two: 0.04 each; of three with one that is nothing to do with neighbours, other numbers.
    let pairs: Vec<&str> =
        text.lines().skip_while(|line| !line.contains("separate maps of neighbours")).skip(2).collect();
    assert_eq!(pairs[0].split_whitespace().collect::<Vec<_>>()[..6], ["0", "4", "12.5", "3", "0.04", "0.04"], "{text}");
    assert_eq!(pairs.len(), 2, "{text}");
    // Regions drawn by their maps differ in them by construction; a note says so.
    model.partitions[0].specification = "refined:5".into();
    let refined = describe_transitions(&model, false).expect("counted");
    assert!(refined.contains("chosen on the same rows") && !text.contains("chosen on the same rows"));
    let all = describe_transitions(&model, true).expect("counted");
    assert!(all.contains("too few rows") && all.contains("1e-9"), "{all}");
    assert!(describe_transitions(&models::pwa(5, 2), true).is_none());
    let phases = model.partitions[0].phases.as_mut().expect("phases");
    (phases.strides, phases.bins) = (vec![vec![0; 5]; 5], PhaseBins::Labels(vec!["left".into(), "right".into()]));
    let text = describe_transitions(&model, false).expect("counted");
    assert!(text.contains("no two strides follow each other: a stride begins where left is entered"), "{text}");
}
