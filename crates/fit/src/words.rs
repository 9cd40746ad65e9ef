//! Sentences about simulations and intervals.

use fleetfoot_dynamics::{Basis, Horizon, StepSpan};
use fleetfoot_report::words::{count, seconds};

/// Spans of steps that are written out.
const SPANS: usize = 3;

/// When a model is better than the baselines: than all of them, and than each.
pub fn useful_in_words(horizon: &Horizon) -> String {
    let steps = horizon.time.len();
    if horizon.useful.compared == 0 {
        return "useful horizon: not known, no state was measured after the starts that the rollouts could be compared with".to_owned();
    }
    let mut text = match horizon.useful.spans.as_slice() {
        [] => "useful horizon: none, some baseline is better at every step".to_owned(),
        spans => format!("useful horizon: better than every baseline {}", spans_in_words(spans, steps)),
    };
    for (baseline, spans) in &horizon.better {
        let when = if spans.is_empty() { "at no step".to_owned() } else { spans_in_words(spans, steps) };
        text.push_str(&format!("\n  better than {} {when}", baseline.name()));
    }
    text
}

/// Spans of the `steps` steps of a simulation, in seconds.
pub fn spans_in_words(spans: &[StepSpan], steps: usize) -> String {
    let one = |span: &StepSpan| match (span.first, span.last) {
        (1, last) if last == steps => format!("at every step, to {}", seconds(span.to)),
        (first, last) if last == steps => {
            format!("from {} (step {first}) to the end ({})", seconds(span.from), seconds(span.to))
        }
        (first, last) if first == last => format!("at {} (step {first})", seconds(span.from)),
        (first, last) => {
            format!("from {} to {} (steps {first} to {last})", seconds(span.from), seconds(span.to))
        }
    };
    let mut texts: Vec<String> = spans.iter().take(SPANS).map(one).collect();
    if spans.len() > SPANS {
        texts.push(format!("and in {} more", count(spans.len() - SPANS, "span")));
    }
    texts.join(", ")
}

/// Columns that a simulation takes from the recording
/// ([`Simulator::replayed`](fleetfoot_dynamics::Simulator::replayed)), in words.
pub fn replayed_in_words(columns: &[String]) -> String {
    match columns {
        [] => "replayed from the recording: nothing".into(),
        columns => format!("replayed from the recording: {}", columns.join(", ")),
    }
}

/// Rule of an interval, in words.
pub fn interval_in_words(basis: &Basis) -> String {
    match basis {
        Basis::Episodes(count) => format!("95 % intervals across {count} episodes"),
        Basis::Folds(count) => {
            format!("95 % intervals across {count} folds of spans (too narrow: they are correlated)")
        }
        Basis::Spans(count) => {
            format!("95 % intervals across {count} spans of one episode (too narrow: they are correlated)")
        }
        Basis::Starts(count) => {
            format!("95 % intervals across {count} starts of one episode (too narrow: they are correlated)")
        }
    }
}
