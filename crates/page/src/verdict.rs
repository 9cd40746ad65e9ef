//! Findings at the top of a page.

use fleetfoot_dynamics::{Baseline, TargetScore};
use fleetfoot_fit::{interval_in_words, replayed_in_words, spans_in_words};
use fleetfoot_report::{
    Light, Part, Section, Sentence,
    words::{count, ratio, seconds, series, thousands},
};
use fleetfoot_run::{RolledOut, Scored};

use crate::{
    Judged, horizons,
    passed::Passed,
    regions, residuals, scores,
    sentence::{sentence, sentence_of},
};

/// Names that are written out.
const NAMES: usize = 4;
/// Of the scored rows, a share outside of all training that asks for other logs.
const OUTSIDE: f64 = 0.05;

/// The findings: all of a single model. Of several models: their differences, and the findings of the best, whose rows
/// were read.
pub(crate) fn section(judged: &[Judged<'_>], passed: Option<&Passed>) -> Section {
    let mut findings = Vec::new();
    let best = super::best(judged);
    let errors = passed.and_then(|passed| residuals::finding(&passed.targets, &passed.columns));
    if judged.len() == 1 {
        findings.push(fitted(best));
        findings.extend(of_model(best).into_iter().chain(errors));
    } else {
        findings.extend(scores::best(judged));
        findings.extend(horizons::best(judged));
        findings.extend(of_model(best).into_iter().chain(errors).map(|finding| named(best.name, finding)));
    }
    Section::new("verdict", "Verdict", vec![Part::Findings(findings)])
}

/// A finding with the name of its model.
fn named(name: &str, finding: Sentence) -> Sentence {
    Sentence { head: format!("{name}. {}", finding.head), ..finding }
}

/// Findings about one model.
pub(crate) fn of_model(judged: &Judged<'_>) -> Vec<Sentence> {
    let mut findings = Vec::new();
    match &judged.scores {
        Some(Ok(scored)) => findings.extend([one_step(scored), worst_log(scored)].into_iter().flatten()),
        Some(Err(_)) if judged.model.fitted().next().is_none() => {}
        Some(Err(reason)) => findings.push(sentence(Light::Bad, "It is not scored.", &sentence_of(reason))),
        None => {}
    }
    match &judged.rollouts {
        Some(Ok(rolled)) => findings.push(simulated(rolled)),
        Some(Err(reason)) => findings.push(sentence(Light::Plain, "It is not simulated.", &sentence_of(reason))),
        None => {}
    }
    findings.extend(regions::finding(judged.model));
    findings.extend(judged.scored().and_then(outside));
    findings
}

/// Sentence about the fit: model, method and training logs.
pub(crate) fn fitted(judged: &Judged<'_>) -> Sentence {
    let (model, training) = (judged.model, &judged.model.training);
    // A model has its episodes in the order of their identities, which says nothing to people.
    let mut names: Vec<String> = training.episodes.iter().map(|episode| episode.name.clone()).collect();
    names.sort();
    let logs = match names.as_slice() {
        [] => String::new(),
        names => format!(" of {} ({})", count(names.len(), "episode"), series(names, NAMES)),
    };
    if model.fitted().next().is_none() {
        return sentence(
            Light::Plain,
            "Its equations are given.",
            "Nothing was fitted, so there is nothing to score one step ahead.",
        );
    }
    let text = format!(
        "{} was fitted to {} rows{logs}. It predicts {}.",
        model.method,
        thousands(training.rows),
        series(&model.outputs(), 12)
    );
    sentence(Light::Plain, "What was fitted.", &text)
}

/// The targets with the least and the largest error over the null model's.
fn by_error(scored: &Scored) -> Option<(&TargetScore, &TargetScore)> {
    let known = || scored.scores.targets.iter().filter(|target| target.mae_over_null.value.is_finite());
    let order = |a: &&TargetScore, b: &&TargetScore| a.mae_over_null.value.total_cmp(&b.mae_over_null.value);
    Some((known().min_by(order)?, known().max_by(order)?))
}

/// The error of one-step predictions beside that of predictions that need no model.
fn one_step(scored: &Scored) -> Option<Sentence> {
    let (best, worst) = by_error(scored)?;
    let inside = !scored.in_sample.is_empty();
    // Without an interval, the value itself is the bound.
    let upper = |target: &TargetScore| {
        let error = &target.mae_over_null;
        if error.high.is_finite() { error.high } else { error.value }
    };
    let proven = scored.scores.targets.iter().all(|target| upper(target) < 1.0);
    let (light, head) = match worst.mae_over_null.value {
        _ if scored.in_sample.len() == scored.episodes => {
            (Light::Doubtful, "These scores are in-sample: all of these rows trained the model.")
        }
        _ if inside => (Light::Doubtful, "These scores are partly in-sample: some of these rows trained the model."),
        value if value >= 1.0 => (Light::Bad, "It predicts no better than the mean of its training rows."),
        // The row before tells more of the next than the model does: of use far ahead at most.
        _ if 2 * beaten(scored).iter().map(|(_, wins)| *wins).max().unwrap_or(0) > scored.scores.targets.len() => {
            (Light::Doubtful, "One step ahead, a baseline has a lower error than this model.")
        }
        _ if proven => (Light::Good, "One step ahead it predicts better than the mean of its training rows."),
        _ => (Light::Doubtful, "One step ahead it may be no better than the mean of its training rows."),
    };
    let text = |target: &TargetScore| {
        let error = &target.mae_over_null;
        let ends = if error.low.is_finite() {
            format!(" [{}, {}]", ratio(error.low), ratio(error.high))
        } else {
            String::new()
        };
        format!("{}{ends} for {}", ratio(error.value), target.name)
    };
    let errors = if scored.scores.targets.len() == 1 {
        format!("Its mean absolute error over the null model\u{2019}s is {}", text(best))
    } else {
        format!(
            "Its mean absolute error over the null model\u{2019}s is {} at best and {} at worst",
            text(best),
            text(worst)
        )
    };
    let episodes = count(scored.episodes, "episode");
    let rows = if inside {
        format!("rows of {episodes}, {} of which trained it", scored.in_sample.len())
    } else {
        format!("rows of {episodes} that did not train it")
    };
    let text = format!(
        "{errors}, on {} {rows}. {}{}.",
        thousands(scored.scores.rows),
        capital(&interval_in_words(&scored.scores.basis)),
        beaten_in_words(scored)
    );
    Some(sentence(light, head, &text))
}

fn capital(text: &str) -> String {
    sentence_of(text).trim_end_matches('.').to_owned()
}

/// Of how many targets a prediction that needs no model errs less.
fn beaten(scored: &Scored) -> [(Baseline, usize); 2] {
    [Baseline::Persistence, Baseline::ConstantVelocity].map(|baseline| {
        let wins = |target: &&TargetScore| {
            target.baselines.iter().any(|score| score.baseline == baseline && score.mae < score.model_mae)
        };
        (baseline, scored.scores.targets.iter().filter(wins).count())
    })
}

fn beaten_in_words(scored: &Scored) -> String {
    let targets = count(scored.scores.targets.len(), "target");
    let baselines = beaten(scored).into_iter().filter(|(_, wins)| *wins > 0);
    baselines.map(|(baseline, wins)| format!("; {} is better for {wins} of {targets}", baseline.name())).collect()
}

/// The log with the largest error, where there are several.
fn worst_log(scored: &Scored) -> Option<Sentence> {
    let worst = scores::worst(scored)?;
    let all = scored.scores.mahalanobis.value;
    if scored.scores.episodes.len() < 2 {
        return None;
    }
    let light = if worst.mahalanobis > 2.0 * all { Light::Doubtful } else { Light::Plain };
    let text = format!(
        "Its Mahalanobis score is {}, that of all rows {} (lower is better); it has {} rows.",
        ratio(worst.mahalanobis),
        ratio(all),
        thousands(worst.rows)
    );
    Some(sentence(light, &format!("The worst log is {}.", worst.name), &text))
}

/// Sentence about the steps at which a simulation beats the baselines.
fn simulated(rolled: &RolledOut) -> Sentence {
    let rollouts = &rolled.rollouts;
    let horizon = &rollouts.horizon;
    let steps = horizon.time.len();
    let (light, head) = match horizon.useful.spans.as_slice() {
        _ if horizon.useful.compared == 0 => {
            (Light::Plain, "No measured state can be compared with its simulations.".to_owned())
        }
        [] => (Light::Bad, "Simulated, it is worse than some baseline at every step.".to_owned()),
        spans => {
            let all = spans.len() == 1 && spans[0].first == 1 && spans[0].last == steps;
            let light = if all && rollouts.diverged() == 0 { Light::Good } else { Light::Doubtful };
            (light, format!("Simulated, it is better than every baseline {}.", spans_in_words(spans, steps)))
        }
    };
    let trouble = [
        (rollouts.diverged(), "diverged"),
        (rollouts.without_region(), "met an unknown label"),
        (rollouts.left_domain(), "left the training range"),
    ];
    let trouble: String =
        trouble.iter().filter(|(number, _)| *number > 0).map(|(number, what)| format!(", {number} {what}")).collect();
    let text = format!(
        "{} of {steps} steps ({}){trouble}; {}.",
        count(rollouts.outcomes.len(), "simulation"),
        seconds(horizon.time.last().copied().unwrap_or(f64::NAN)),
        if rollouts.driven_inputs.is_empty() {
            replayed_in_words(&rollouts.replayed)
        } else {
            format!(
                "a controller drives {}; {}",
                series(&rollouts.driven_inputs, NAMES),
                replayed_in_words(&rollouts.replayed)
            )
        }
    );
    sentence(light, &head, &text)
}

/// Rows that the model has seen nothing like.
fn outside(scored: &Scored) -> Option<Sentence> {
    let share = scored.scores.outside_training as f64 / scored.scores.rows as f64;
    (share > OUTSIDE).then(|| {
        let text = format!(
            "{:.1} % of the scored rows lie outside the training range. Fit on logs that cover these values too.",
            100.0 * share
        );
        sentence(Light::Doubtful, "It is scored outside its training range.", &text)
    })
}
