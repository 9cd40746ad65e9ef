//! Errors of rollouts by horizon, beside the baselines on the same starts.

mod sums;
mod useful;

use std::ops::Range;

use fleetfoot_data::{nearest, packed};
use fleetfoot_library::UnknownColumn;
use fleetfoot_model::Model;

use crate::{
    Baseline, Basis, End, Error, Estimate, Mahalanobis, PathScores, RawHorizon, RolloutOptions, Simulator, Trajectory,
    geometry::{Component, Geometry, Shape, parts},
    ideal::References,
    path::{alignment, propagated_error, warping_distance},
    window::Window,
};
pub(crate) use sums::HorizonSums;
use sums::{AVERAGE, ErrorTable, GROWTH, PAIR, PREDICTORS, REFERENCE, SUMMARY, Spread, WARPING};
use useful::{beats, spans, useful_horizon};

/// Errors of a model's rollouts against the recording, by step.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Horizon {
    /// Seconds from the start after each step (mean over the starts), from step 1.
    pub time: Vec<f64>,
    /// The states scored, in the order of [`HorizonScore::rmse`]; a rotation by its name, whose error is its angle (rad).
    pub states: Vec<String>,
    /// The model's scores.
    pub model: HorizonScore,
    /// The baselines' scores on the same starts.
    pub baselines: Vec<(Baseline, HorizonScore)>,
    /// Share of the trajectories that had ended early (diverged, or without a region) by each step. They are scored with their last good state.
    pub ended: Vec<f64>,
    /// The model's errors against raw measurements, where these are at hand.
    pub raw: Option<RawHorizon>,
    /// Horizon up to which the model beats the baselines.
    pub useful: UsefulHorizon,
    /// The steps at which the model's mean Mahalanobis score is below that of each baseline.
    pub better: Vec<(Baseline, Vec<StepSpan>)>,
    /// Parts that the intervals compare.
    pub basis: Basis,
    /// The model's paths beside those of the [references](crate::RolloutOptions::references), where the reference has
    /// the columns of the position.
    pub beside_reference: Option<ReferencePair>,
}

/// Distance of the model's paths from those of the reference.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ReferencePair {
    /// The distance over whole rollouts.
    pub displacement: RolloutSummary,
    /// Direction, growth and time warping.
    pub path: PathScores,
}

/// Scores by step, from step 1.
#[derive(Debug, Clone, PartialEq)]
pub struct HorizonScore {
    /// Root of the mean squared error, steps x states.
    pub rmse: Vec<f64>,
    /// Mean absolute error, steps x states.
    pub mae: Vec<f64>,
    /// Mean Mahalanobis score (equation 10) of the state error under the training states' covariance: the vertical axis of Fig. 8 of Buchan, Haldane,
    /// Fearing.
    pub mahalanobis: Vec<Estimate>,
    /// The Mahalanobis score over whole rollouts.
    pub summary: RolloutSummary,
    /// Mean Euclidean distance of the columns of [`RolloutOptions::position`](crate::RolloutOptions::position) by step, in their unit; empty where there are none.
    pub displacement: Vec<Estimate>,
    /// The distance over whole rollouts; `None` where there is none.
    pub displacement_summary: Option<RolloutSummary>,
    /// Direction, growth of the distance and time warping of the position's path; `None` without a position.
    pub path: Option<PathScores>,
    /// Mean cosine of the errors of angles and rotations, by step; empty where the model has none.
    pub orientation: Vec<Estimate>,
    /// The cosine over whole rollouts; `None` without an angle or a rotation.
    pub average_orientation: Option<Estimate>,
    /// Explained variance `1 - var(error) / var(measured)` over the starts, steps x states; NaN for rotations.
    pub explained_variance_by_step: Vec<f64>,
    /// Explained variance of each state over all steps. Intervals need two episodes.
    pub explained_variance: Vec<Estimate>,
}

/// Averages over rollouts of equal weight: displacement and its growth (section 7.1 of *Towards Sim-to-Real via
/// Real-to-Sim*).
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct RolloutSummary {
    /// Mean over the steps.
    pub average: Estimate,
    /// At the last step.
    pub last: Estimate,
    /// Growth from the first step to the last, per second.
    pub drift: Estimate,
}

/// When the model's mean Mahalanobis score is below that of every baseline.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct UsefulHorizon {
    /// Steps from the start up to the first at which a baseline is better.
    pub steps: usize,
    /// Seconds of these; 0 when a baseline is better at the first step.
    pub seconds: f64,
    /// The baseline that is better at the next step; `None` when none is up to the end.
    pub beaten_by: Option<Baseline>,
    /// All steps at which the model is better than every baseline, in spans. A model that loses the first steps may be
    /// the better one for all that follow.
    pub spans: Vec<StepSpan>,
    /// Steps at which there is something to compare: a measured state, and a baseline.
    pub compared: usize,
}

/// Consecutive steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepSpan {
    /// The first step, from 1.
    pub first: usize,
    /// The last step.
    pub last: usize,
    /// Seconds from the start after the first step.
    pub from: f64,
    /// Seconds from the start after the last step.
    pub to: f64,
}

/// The baselines of rollouts.
pub(crate) const ROLLOUT_BASELINES: [Baseline; 4] =
    [Baseline::Null, Baseline::Persistence, Baseline::ConstantVelocity, Baseline::Reference];

/// Scorer of windows.
pub(crate) struct HorizonScorer {
    pub(crate) horizon: usize,
    /// States that are advanced.
    states: usize,
    /// Components of the reported errors: states and rotations.
    components: Vec<Component>,
    /// The parts of the errors that enter the Mahalanobis score: one of a state, the rotation vector's three of a rotation.
    scored: Vec<Range<usize>>,
    metric: Mahalanobis,
    /// Geometry of all reported states.
    geometry: Geometry,
    columns: Vec<usize>,
    /// Positions, among the reported components, of the columns of the displacement.
    position: Vec<usize>,
    /// States of these columns.
    place: Vec<usize>,
    /// Positions, among the reported components, of angles and rotations.
    turned: Vec<usize>,
    /// Training means, for variances without cancellation.
    mean: Vec<f64>,
    interval: usize,
    band: usize,
    references: Option<References>,
}

/// The states' velocities in front of a start.
struct Velocity {
    states: Vec<f64>,
    /// Of every rotation, rad/s in the body's axes.
    rotations: Vec<[f64; 3]>,
}

impl Velocity {
    fn new(geometry: &Geometry, measured: &[&[f64]], interval: f64) -> Self {
        let (now, before) = (|s: usize| measured[s][1], |s: usize| measured[s][0]);
        let rate = |s: usize| geometry.difference(s, now, before) / interval;
        let turning = geometry.groups.iter().map(|group| group.rotation(now, before).map(|part| part / interval));
        Self { states: (0..measured.len()).map(rate).collect(), rotations: turning.collect() }
    }

    /// Turns rotations on at their rate for `seconds`.
    fn turn(&self, geometry: &Geometry, measured: &[&[f64]], seconds: f64, value: &mut [f64]) {
        for (group, rate) in geometry.groups.iter().zip(&self.rotations) {
            let moved = group.kind.moved(&group.of(|s| measured[s][1]), rate.map(|part| part * seconds));
            group.places.iter().zip(moved).for_each(|(&place, part)| value[place] = part);
        }
    }
}

impl HorizonScorer {
    /// # Errors
    /// [`Error::UnknownColumn`] for a position that is not an advanced state.
    pub(crate) fn new(
        model: &Model,
        simulator: &Simulator,
        options: &RolloutOptions,
        references: Option<References>,
    ) -> Result<Self, Error> {
        let (horizon, shown) = (options.horizon, simulator.shown());
        let names = simulator.states();
        let geometry = Geometry::new(model, &shown.iter().map(|state| state.column).collect::<Vec<_>>());
        let components = geometry.components();
        // Of a part of a rotation there is no distance.
        let place = |name: &String| {
            let place = components
                .iter()
                .position(|component| matches!(*component, Component::State(state) if names[state] == *name));
            place.ok_or_else(|| {
                let nearest = nearest(name, names.iter().map(String::as_str));
                Error::from(UnknownColumn { name: name.clone(), nearest })
            })
        };
        let counts = |component: &Component| match *component {
            Component::State(state) => shown[state].order.is_some(),
            Component::Group(group) => geometry.groups[group].places.iter().all(|&place| shown[place].order.is_some()),
        };
        let ordered: Vec<Component> = components.iter().copied().filter(counts).collect();
        let order = |s: usize| shown[s].order.unwrap_or_default();
        let training = &model.training;
        let covariance = geometry.covariance(
            &ordered,
            |i, j| training.state_covariance[packed(order(i), order(j))],
            |s| training.state_mean.get(order(s)).copied().unwrap_or_else(|| geometry.neutral(s)),
        );
        let scored: Vec<Range<usize>> = components
            .iter()
            .zip(parts(&components))
            .filter(|(component, _)| counts(component))
            .map(|(_, span)| span)
            .collect();
        let position: Vec<usize> = options.position.iter().map(place).collect::<Result<_, _>>()?;
        let state = |&component: &usize| match components[component] {
            Component::State(state) => Some(state),
            Component::Group(_) => None,
        };
        let is_turned = |component: &usize| match components[*component] {
            Component::State(state) => matches!(geometry.shapes[state], Shape::Circle),
            Component::Group(_) => true,
        };
        let mean = |shown_state: &crate::state::State| {
            shown_state.order.and_then(|order| training.state_mean.get(order)).copied().filter(|mean| mean.is_finite())
        };
        Ok(Self {
            horizon,
            place: position.iter().filter_map(state).collect(),
            position,
            turned: (0..components.len()).filter(is_turned).collect(),
            mean: shown.iter().map(|shown_state| mean(shown_state).unwrap_or_default()).collect(),
            interval: options.interval.max(1),
            band: options.band.unwrap_or_else(|| horizon.div_ceil(10)),
            references,
            states: shown.len(),
            metric: Mahalanobis::of_covariance(&covariance, scored.iter().map(Range::len).sum()),
            scored,
            components,
            geometry,
            columns: shown.iter().map(|state| state.column).collect(),
        })
    }

    pub(crate) fn empty(&self) -> HorizonSums {
        let kinds = 1 + self.path_kinds() + usize::from(!self.turned.is_empty());
        let cells = self.horizon * self.components.len();
        let table = ErrorTable {
            square: vec![0.0; cells],
            absolute: vec![0.0; cells],
            rows: vec![0.0; cells],
            spread: vec![Spread::default(); cells],
        };
        HorizonSums {
            starts: 0,
            time: vec![0.0; self.horizon],
            ended: vec![0; self.horizon],
            raw: table.clone(),
            tables: vec![table; PREDICTORS],
            scores: vec![vec![[0.0; 3]; self.horizon + SUMMARY]; kinds * PREDICTORS],
            episodes: Vec::new(),
            spreads: Vec::new(),
            states: self.components.len(),
        }
    }

    /// Kinds of scores of a path: distance and direction.
    fn path_kinds(&self) -> usize {
        if self.position.is_empty() { 0 } else { 2 }
    }

    /// Place of the scores of the angles' cosine.
    fn orientation(&self) -> usize {
        (1 + self.path_kinds()) * PREDICTORS
    }

    /// Adds one start: the model's trajectory, the null model's, and the recording. `time` holds horizon + 1 seconds.
    pub(crate) fn add(
        &self,
        window: &Window<'_>,
        time: &[f64],
        model: &Trajectory,
        null: Option<&Trajectory>,
        sums: &mut HorizonSums,
    ) {
        let measured: Vec<&[f64]> =
            self.columns.iter().map(|&column| window.values(column, -1, self.horizon as i64 + 1)).collect();
        let stamps = &window.block.time[window.at - 1..=window.at];
        let interval = (stamps[1] - stamps[0]) as f64 * 1e-9;
        let velocity = Velocity::new(&self.geometry, &measured, interval);
        sums.starts += 1;
        let episode = sums.episode(window.start.episode);
        let mut series = vec![Vec::new(); sums.scores.len()];
        let length = parts(&self.components).last().map_or(0, |last| last.end);
        let mut value = vec![0.0; self.states];
        let mut error = vec![0.0; length];
        let mut size = vec![0.0; self.components.len()];
        let mut vector = Vec::with_capacity(error.len());
        let mut scratch = vec![0.0; self.metric.width()];
        let reference = self.references.as_ref().map(|references| references.paths(window, time, &measured));
        let beside: Vec<&[f64]> = reference.iter().flatten().map(Vec::as_slice).collect();
        let mut paths = vec![Vec::new(); PREDICTORS];
        let mut distances = vec![Vec::new(); PREDICTORS];
        let predictors = if reference.is_some() { PREDICTORS } else { REFERENCE };
        for k in 1..=self.horizon {
            sums.time[k - 1] += time[k];
            sums.ended[k - 1] += u64::from(model.end != End::Horizon && k > model.steps());
            for predictor in 0..predictors {
                for (s, value) in value.iter_mut().enumerate() {
                    *value = match (predictor, null) {
                        (0 | PAIR, _) => model.state(k)[s],
                        (1, Some(null)) => null.state(k)[s],
                        (1, None) => f64::NAN,
                        (2, _) => measured[s][1],
                        (REFERENCE, _) => beside[s][k + 1],
                        _ => time[k].mul_add(velocity.states[s], measured[s][1]),
                    };
                }
                if predictor == 3 {
                    velocity.turn(&self.geometry, &measured, time[k], &mut value);
                }
                let against = if predictor == PAIR { beside.as_slice() } else { measured.as_slice() };
                self.errors(against, k + 1, &value, &mut error, &mut size);
                if predictor != PAIR {
                    let cell = (k - 1) * self.components.len();
                    sums.tables[predictor].add(cell, &size);
                    self.add_spread((predictor, episode, k), &measured, &size, sums);
                    vector.clear();
                    self.scored.iter().for_each(|span| vector.extend_from_slice(&error[span.clone()]));
                    if !vector.is_empty() && vector.iter().all(|value| value.is_finite()) {
                        let score = self.metric.score_with(&vector, &mut scratch);
                        sums.push(episode, predictor, k - 1, score);
                        series[predictor].push((time[k], score));
                    }
                }
                if !self.position.is_empty() {
                    let distance = self.position.iter().map(|&s| size[s] * size[s]).sum::<f64>().sqrt();
                    distances[predictor].push(distance);
                    paths[predictor].extend(self.place.iter().map(|&s| value[s]));
                    if distance.is_finite() {
                        sums.push(episode, PREDICTORS + predictor, k - 1, distance);
                        series[PREDICTORS + predictor].push((time[k], distance));
                    }
                }
                let cosines =
                    || self.turned.iter().map(|&component| size[component].cos()).filter(|cosine| cosine.is_finite());
                if cosines().next().is_some() {
                    let mean = cosines().sum::<f64>() / cosines().count() as f64;
                    sums.push(episode, self.orientation() + predictor, k - 1, mean);
                    series[self.orientation() + predictor].push((time[k], mean));
                }
            }
        }
        for (predictor, series) in series.iter().enumerate() {
            for (at, value) in summary(series).into_iter().flatten().enumerate() {
                sums.push(episode, predictor, self.horizon + at, value);
            }
        }
        for predictor in (0..predictors).filter(|_| !self.position.is_empty()) {
            let against = if predictor == PAIR { beside.as_slice() } else { measured.as_slice() };
            self.add_path((predictor, episode), against, &paths[predictor], &distances[predictor], sums);
        }
    }

    /// Adds direction, growth of the distance and time warping of one path.
    fn add_path(
        &self,
        (predictor, episode): (usize, usize),
        recorded: &[&[f64]],
        path: &[f64],
        distances: &[f64],
        sums: &mut HorizonSums,
    ) {
        let width = self.place.len();
        // Angles without jumps, so that increments and distances are those of the shorter way.
        let unwrapped = |value: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            let mut path: Vec<f64> = self.place.iter().map(|&s| recorded[s][1]).collect();
            for k in 1..=self.horizon {
                for (i, &s) in self.place.iter().enumerate() {
                    let before = path[(k - 1) * width + i];
                    let now = value(k, i);
                    let step = matches!(self.geometry.shapes[s], Shape::Circle).then(|| crate::wrap(now - before));
                    path.push(step.map_or(now, |step| before + step));
                }
            }
            path
        };
        let predicted = unwrapped(&|k, i| path[(k - 1) * width + i]);
        let other = unwrapped(&|k, i| recorded[self.place[i]][k + 1]);
        let row = 2 * PREDICTORS + predictor;
        let increment = |path: &[f64], k: usize| -> Vec<f64> {
            (0..width).map(|i| path[k * width + i] - path[(k - 1) * width + i]).collect()
        };
        let (mut sum, mut count) = (0.0, 0.0);
        for k in 1..=self.horizon {
            if let Some(cosine) = alignment(&increment(&predicted, k), &increment(&other, k)) {
                sums.push(episode, row, k - 1, cosine);
                (sum, count) = (sum + cosine, count + 1.0);
            }
        }
        let mut push = |at: usize, value: Option<f64>| {
            if let Some(value) = value.filter(|value| value.is_finite()) {
                sums.push(episode, row, self.horizon + at, value);
            }
        };
        push(AVERAGE, (count > 0.0).then(|| sum / count));
        push(GROWTH, propagated_error(distances, self.interval));
        push(WARPING, warping_distance(&predicted, &other, width, self.band));
    }

    /// Adds errors and measurements to the sums behind the explained variance.
    fn add_spread(
        &self,
        (predictor, episode, k): (usize, usize, usize),
        measured: &[&[f64]],
        size: &[f64],
        sums: &mut HorizonSums,
    ) {
        let width = self.components.len();
        for (t, components) in self.components.iter().enumerate() {
            let Component::State(state) = *components else { continue };
            let value = self.geometry.difference(state, |s| measured[s][k + 1], |s| self.mean[s]);
            if size[t].is_finite() && value.is_finite() {
                sums.tables[predictor].spread[(k - 1) * width + t].add(size[t], value);
                sums.spreads[episode][predictor * width + t].add(size[t], value);
            }
        }
    }

    /// Adds the errors of a trajectory against raw measurements.
    pub(crate) fn add_raw(&self, raw: &Window<'_>, model: &Trajectory, sums: &mut HorizonSums) {
        let measured: Vec<&[f64]> =
            self.columns.iter().map(|&column| raw.values(column, 0, self.horizon as i64 + 1)).collect();
        let mut error = vec![0.0; parts(&self.components).last().map_or(0, |last| last.end)];
        let mut size = vec![0.0; self.components.len()];
        for k in 1..=self.horizon {
            self.errors(&measured, k, model.state(k), &mut error, &mut size);
            sums.raw.add((k - 1) * size.len(), &size);
        }
    }

    /// Errors of the states at a measured row, and their sizes: of a state the error itself, of a rotation its angle.
    fn errors(&self, measured: &[&[f64]], row: usize, value: &[f64], error: &mut [f64], size: &mut [f64]) {
        let (recorded, simulated) = (|s: usize| measured[s][row], |s: usize| value[s]);
        let mut at = 0;
        for (component, size) in self.components.iter().zip(size) {
            match *component {
                Component::State(state) => {
                    error[at] = self.geometry.difference(state, recorded, simulated);
                    *size = error[at];
                    at += 1;
                }
                Component::Group(group) => {
                    let rotation = self.geometry.groups[group].rotation(recorded, simulated);
                    error[at..at + 3].copy_from_slice(&rotation);
                    *size = rotation.iter().map(|part| part * part).sum::<f64>().sqrt();
                    at += 3;
                }
            }
        }
    }

    /// The names of the reported components.
    fn names(&self, states: &[String]) -> Vec<String> {
        let name = |component: &Component| match *component {
            Component::State(state) => states[state].clone(),
            Component::Group(group) => self.geometry.groups[group].name.clone(),
        };
        self.components.iter().map(name).collect()
    }

    /// The scores behind the sums.
    pub(crate) fn finish(&self, states: &[String], sums: &HorizonSums) -> Horizon {
        let starts = sums.starts as f64;
        let basis = if sums.episodes.len() >= 2 {
            Basis::Episodes(sums.episodes.len())
        } else {
            Basis::Starts(sums.starts as usize)
        };
        let score = |predictor: usize| HorizonScore {
            rmse: sums.tables[predictor].means(|table| &table.square).map(f64::sqrt).collect(),
            mae: sums.tables[predictor].means(|table| &table.absolute).collect(),
            mahalanobis: (0..self.horizon).map(|k| sums.estimate(predictor, k)).collect(),
            summary: sums.summary(predictor, self.horizon),
            displacement: match self.position.as_slice() {
                [] => Vec::new(),
                _ => (0..self.horizon).map(|k| sums.estimate(PREDICTORS + predictor, k)).collect(),
            },
            displacement_summary: match self.position.as_slice() {
                [] => None,
                _ => Some(sums.summary(PREDICTORS + predictor, self.horizon)),
            },
            path: (!self.position.is_empty()).then(|| sums.path(2 * PREDICTORS + predictor, self.horizon)),
            orientation: match self.turned.as_slice() {
                [] => Vec::new(),
                _ => (0..self.horizon).map(|k| sums.estimate(self.orientation() + predictor, k)).collect(),
            },
            average_orientation: (!self.turned.is_empty())
                .then(|| sums.estimate(self.orientation() + predictor, self.horizon)),
            explained_variance_by_step: sums.tables[predictor].spread.iter().map(Spread::explained).collect(),
            explained_variance: (0..self.components.len()).map(|state| sums.explained(predictor, state)).collect(),
        };
        let pair = PREDICTORS + PAIR;
        let beside_reference =
            sums.scores.get(pair).filter(|scores| self.path_kinds() > 0 && scores[0][2] > 0.0).map(|_| ReferencePair {
                displacement: sums.summary(pair, self.horizon),
                path: sums.path(pair + PREDICTORS, self.horizon),
            });
        let time: Vec<f64> = sums.time.iter().map(|time| time / starts).collect();
        let model = score(0);
        // A baseline that does not exist for this model has no rows.
        let baselines: Vec<(Baseline, HorizonScore)> = ROLLOUT_BASELINES
            .iter()
            .enumerate()
            .filter(|(i, _)| sums.tables[i + 1].rows.iter().any(|&rows| rows > 0.0))
            .map(|(i, &baseline)| (baseline, score(i + 1)))
            .collect();
        Horizon {
            useful: useful_horizon(&time, &model, &baselines),
            better: baselines
                .iter()
                .filter(|(_, score)| score.mahalanobis.iter().any(|estimate| estimate.value.is_finite()))
                .map(|(baseline, score)| {
                    (*baseline, spans(&time, |k| beats(&model, k, Some((*baseline, score.mahalanobis[k].value)))))
                })
                .collect(),
            ended: sums.ended.iter().map(|&count| count as f64 / starts).collect(),
            time,
            states: self.names(states),
            raw: sums.raw.rows.iter().any(|&rows| rows > 0.0).then(|| RawHorizon {
                rmse: sums.raw.means(|table| &table.square).map(f64::sqrt).collect(),
                mae: sums.raw.means(|table| &table.absolute).collect(),
            }),
            model,
            baselines,
            basis,
            beside_reference,
        }
    }
}

/// Average, last value and growth per second of the scores of one rollout, by time; `None` where there are none.
fn summary(series: &[(f64, f64)]) -> Option<[f64; SUMMARY]> {
    let (&(begin, first), &(end, last)) = (series.first()?, series.last()?);
    let average = series.iter().map(|(_, score)| score).sum::<f64>() / series.len() as f64;
    Some([average, last, if end > begin { (last - first) / (end - begin) } else { 0.0 }])
}
