//! The linear-quadratic regulator of a model about a set point, a law for each region.

use faer::Mat;
use fleetfoot_model::{Model, Rule};

use super::{
    LqrOptions, MpcOptions, Named, Schedule,
    coordinates::Coordinates,
    gains::{Answer, Gains, Weights},
    requested::{period, weights},
    setpoint::{Rest, Wanted, rest},
};
use crate::{
    Error,
    control_error::ControlError,
    controller::{Controller, RegionChoice, RegionLaw, Regulator},
    linear::Mode,
    named::{find, indices},
    pieces::{Affine, Pieces},
};

/// A Riccati equation that is solved no better than this has no solution that can be trusted.
const TRUSTED: f64 = 1e-6;
/// States take part in a mode from this share on.
const TAKES_PART: f64 = 0.1;

/// A regulator, with its certificates and notes.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Lqr {
    /// The law.
    pub regulator: Regulator,
    /// Set point of the model.
    pub setpoint: SetPoint,
    /// One entry a law.
    pub regions: Vec<LqrRegion>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// A set point.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SetPoint {
    /// All states.
    pub states: Vec<Named>,
    /// All inputs, those that are not driven too.
    pub inputs: Vec<Named>,
    /// The region that rests there; `None` where it is found for the mean of all.
    pub region: Option<usize>,
    /// Remaining motion there: derivatives, or changes a sample, of the states that are kept.
    pub drift: Vec<Named>,
    /// True if the model rests there within its accuracy: the drift is within three standard errors of the model's
    /// numbers.
    pub at_rest: bool,
}

/// The law of a region, certified.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LqrRegion {
    /// The region's name.
    pub name: String,
    /// Its training rows.
    pub rows: u64,
    /// Modes that do not decay and that the driven inputs do not reach, in words; none: it is stabilisable.
    pub unreached: Vec<String>,
    /// Spectral radius of the closed loop, a sample.
    pub radius: f64,
    /// Residual of the Riccati equation, relative to its solution.
    pub residual: f64,
    /// True if its submodel can rest near the set point.
    pub rests: bool,
    /// True if its law is that of the set point, because it has no law itself.
    pub borrowed: bool,
}

/// A model, with the coordinates that are kept, driven and measured.
pub(super) struct Design<'a> {
    pub(super) pieces: &'a Pieces,
    pub(super) coordinates: Coordinates<'a>,
    pub(super) options: &'a LqrOptions,
    pub(super) period: f64,
    /// Places of the coordinates that are kept.
    pub(super) kept: Vec<usize>,
    /// Start of the search for a set point, and marks of the given coordinates, then inputs.
    start: Vec<f64>,
    given: Vec<bool>,
    /// Indices of the inputs that are driven.
    pub(super) driven: Vec<usize>,
    /// Indices of those that are not.
    pub(super) measured: Vec<usize>,
    pub(super) weights: Weights,
    notes: Vec<String>,
}

/// Finds the set point and the laws.
///
/// # Errors
/// [`Error::Control`]: names that the model does not have, weights or a set point that are impossible, a model with
/// lags. Those of [`fleetfoot_dynamics::Stepper::new`].
pub fn lqr(model: &Model, options: &LqrOptions) -> Result<Lqr, Error> {
    designed(model, options, None)
}

/// The regulator, with a prediction if there are options of one.
pub(super) fn designed(model: &Model, options: &LqrOptions, predictive: Option<&MpcOptions>) -> Result<Lqr, Error> {
    let pieces = Pieces::new(model)?;
    let labelled = |index: usize| matches!(model.partitions[index].rule, Rule::Labels { .. });
    if pieces.partition.is_some_and(labelled) {
        return Err(ControlError::Labels.into());
    }
    let mut design = Design::new(model, &pieces, options)?;
    let (rest, region) = design.setpoint()?;
    let by_region = match options.schedule {
        Schedule::Auto => pieces.regions.len() > 1 && region.is_some(),
        Schedule::Region => pieces.regions.len() > 1,
        Schedule::Mean => false,
    };
    let steps: Vec<(String, u64, Affine)> = if by_region {
        let step = |piece: &crate::pieces::Piece| {
            let step = design.step(&piece.linearized(&rest.x, &rest.u), &rest.x);
            (piece.name.clone(), piece.rows, step)
        };
        pieces.regions.iter().map(step).collect()
    } else {
        let rows = pieces.regions.iter().map(|piece| piece.rows).sum();
        vec![("all".to_owned(), rows, design.step(&design.mean(&rest.x, &rest.u), &rest.x))]
    };
    // A law that others may borrow is found first: that of the set point's region, else of the one with most rows.
    let most = (0..steps.len()).max_by_key(|&i| (steps[i].1, std::cmp::Reverse(i))).unwrap_or(0);
    let lender = if by_region { region.unwrap_or(most) } else { 0 };
    let first = design.law(&steps[lender], &rest)?;
    let (mut laws, mut regions) = (Vec::new(), Vec::new());
    for (i, step) in steps.iter().enumerate() {
        let law_of_region = if i == lender { Ok(first.clone()) } else { design.law(step, &rest) };
        let (law, mut about) = match law_of_region {
            Ok(law) => law,
            Err(_) => {
                let borrowed = LqrRegion { borrowed: true, radius: f64::NAN, residual: f64::NAN, ..first.1.clone() };
                (first.0.clone(), borrowed)
            }
        };
        about.name.clone_from(&step.0);
        about.rows = step.1;
        about.unreached = design.unreached(&step.2);
        laws.push(law);
        regions.push(about);
    }
    let partition = if by_region { pieces.partition.and_then(|_| choice(&pieces)) } else { None };
    let mut regulator = design.regulator(&rest, laws, partition);
    if let Some(options) = predictive {
        let steps: Vec<&Affine> = steps.iter().map(|step| &step.2).collect();
        regulator.prediction = Some(design.prediction(options, &steps, lender, &rest)?);
    }
    Controller::validate(&regulator).map_err(fleetfoot_dynamics::Error::from)?;
    let setpoint = design.summary_of(&rest, region);
    Ok(Lqr { regulator, setpoint, regions, notes: design.notes })
}

/// The partition that decides the region, over columns that are not computed.
fn choice(pieces: &Pieces) -> Option<RegionChoice> {
    let model = pieces.whole.model();
    let partition = model.partitions.get(pieces.partition?)?;
    Some(RegionChoice {
        columns: partition.columns.iter().map(ToString::to_string).collect(),
        centre: partition.centre.clone(),
        scale: partition.scale.clone(),
        rule: partition.rule.clone(),
    })
}

impl<'a> Design<'a> {
    fn new(model: &Model, pieces: &'a Pieces, options: &'a LqrOptions) -> Result<Self, Error> {
        let inputs = &pieces.inputs;
        let period = period(model, pieces, options.period)?;
        let driven = match indices("drive", "input", &options.drive, inputs)? {
            none if none.is_empty() => {
                let is_input = |i: &usize| {
                    model
                        .columns
                        .get(pieces.whole.input_column(*i))
                        .is_some_and(|column| column.role == fleetfoot_model::Role::Input)
                };
                (0..inputs.len()).filter(is_input).collect()
            }
            some => some,
        };
        if driven.is_empty() {
            return Err(ControlError::NoInputs.into());
        }
        let coordinates = Coordinates::new(pieces, model);
        let kept = coordinates.kept(&options.free)?;
        if kept.is_empty() {
            return Err(ControlError::NoStates.into());
        }
        let (start, given) = given(model, pieces, &coordinates, &options.setpoint)?;
        let measured = (0..inputs.len()).filter(|input| !driven.contains(input)).collect();
        let weights = weights(pieces, &coordinates, options, (&kept, &given), &driven, period)?;
        Ok(Self {
            pieces,
            coordinates,
            options,
            period,
            kept,
            start,
            given,
            driven,
            measured,
            weights,
            notes: Vec::new(),
        })
    }

    /// The set point, and the region that rests there.
    fn setpoint(&mut self) -> Result<(Rest, Option<usize>), Error> {
        let pieces = self.pieces;
        let (n, m, states) = (self.coordinates.len(), pieces.inputs.len(), pieces.states.len());
        for &input in self.measured.iter().filter(|&&input| !self.given[n + input]) {
            let known = if pieces.seen[states + input].is_some() {
                "its mean in training"
            } else {
                "as it has no statistics from training"
            };
            let value = self.start[states + input];
            self.notes.push(format!(
                "the set point has no value of an input and takes {} = {value}, {known}: give a value in the set point",
                pieces.inputs[input]
            ));
        }
        let unknown =
            |v: usize| !self.given[v] && if v < n { self.kept.contains(&v) } else { self.driven.contains(&(v - n)) };
        let wanted = Wanted {
            unknown: (0..n + m).map(unknown).collect(),
            rests: (0..n).map(|at| self.kept.contains(&at)).collect(),
            x: self.start[..states].to_vec(),
            u: self.start[states..].to_vec(),
        };
        let mut best: Option<(Rest, usize)> = None;
        for (i, piece) in pieces.regions.iter().enumerate() {
            let rest_of_region =
                rest(pieces, &self.coordinates, &wanted, (&|x, u| piece.linearized(x, u), &piece.doubt));
            let here = rest_of_region.holds() && pieces.region(&rest_of_region.x, &rest_of_region.u) == Some(i);
            // Exact equilibria go before approximate ones, then the region of more rows.
            let rank = |rest: &Rest, region: usize| (rest.exact, pieces.regions[region].rows);
            if here && best.as_ref().is_none_or(|(other, region)| rank(other, *region) < rank(&rest_of_region, i)) {
                best = Some((rest_of_region, i));
            }
        }
        if let Some((rest, region)) = best {
            self.note_input_limits(&rest);
            return Ok((rest, Some(region)));
        }
        let rest_of_mean = rest(pieces, &self.coordinates, &wanted, (&|x, u| self.mean(x, u), &self.mean_doubt()));
        if pieces.regions.len() > 1 {
            self.notes.push(
                "no region is at rest at the set point: it is computed for the mean of all regions, weighted by their training rows"
                    .to_owned(),
            );
        }
        if !rest_of_mean.holds() {
            let moved = |&at: &usize| {
                let (coordinate, drift) = (&self.coordinates.of[at], rest_of_mean.drift[at]);
                match pieces.continuous {
                    true => format!("d({})/dt = {drift:.3e}", coordinate.name),
                    false => format!("delta({}) = {drift:.3e}", coordinate.name),
                }
            };
            let moves: Vec<String> = rest_of_mean.moving.iter().map(moved).collect();
            self.notes.push(format!(
                "the model is not at rest at the set point: at best {}; give fewer values of the set point, or list states as free",
                moves.join(", ")
            ));
        }
        self.note_input_limits(&rest_of_mean);
        Ok((rest_of_mean, None))
    }

    /// Notes the inputs whose limits the set point exceeds.
    fn note_input_limits(&mut self, rest: &Rest) {
        for (name, lowest, highest) in &self.options.limits {
            let limited = self.driven.iter().find(|&&input| self.pieces.inputs[input] == *name);
            let Some(value) = limited.map(|&input| rest.u[input]).filter(|u| !(lowest..=highest).contains(&u)) else {
                continue;
            };
            self.notes.push(format!(
                "the set point asks for {name} = {value:.4}, beyond its limits {lowest} to {highest}: the law will not reach it; choose another set point or wider limits"
            ));
        }
    }

    /// Standard errors of [`Design::mean`].
    fn mean_doubt(&self) -> Vec<f64> {
        let rows: f64 = self.pieces.regions.iter().map(|piece| piece.rows as f64).sum();
        let square = |s: usize| {
            self.pieces.regions.iter().map(|piece| (piece.rows as f64 * piece.doubt[s]).powi(2)).sum::<f64>()
        };
        (0..self.pieces.states.len()).map(|s| if rows > 0.0 { square(s).sqrt() / rows } else { 0.0 }).collect()
    }

    /// The mean of the regions' derivatives, or of their next states.
    fn mean(&self, x: &[f64], u: &[f64]) -> Affine {
        let rows: f64 = self.pieces.regions.iter().map(|piece| piece.rows as f64).sum();
        let (n, m) = (x.len(), u.len());
        let mut mean = Affine { a: Mat::zeros(n, n), b: Mat::zeros(n, m), c: vec![0.0; n] };
        for piece in &self.pieces.regions {
            let share = if rows > 0.0 { piece.rows as f64 / rows } else { 1.0 / self.pieces.regions.len() as f64 };
            let affine = piece.linearized(x, u);
            mean.a += faer::Scale(share) * affine.a;
            mean.b += faer::Scale(share) * affine.b;
            mean.c.iter_mut().zip(&affine.c).for_each(|(mean, part)| *mean += share * part);
        }
        mean
    }

    /// The step of `period` seconds of a submodel about `x`, inputs held, in coordinates: of a continuous one exactly, by the exponential of a matrix.
    fn step(&self, affine: &Affine, x: &[f64]) -> Affine {
        let reduced = self.coordinates.reduced(affine, x, self.pieces.continuous);
        if self.pieces.continuous { reduced.held(self.period) } else { reduced }
    }

    /// The step of the states that are kept by the inputs that are driven.
    pub(super) fn kept_step(&self, step: &Affine) -> (Mat<f64>, Mat<f64>) {
        let (kept, driven) = (&self.kept, &self.driven);
        (
            Mat::from_fn(kept.len(), kept.len(), |i, j| step.a[(kept[i], kept[j])]),
            Mat::from_fn(kept.len(), driven.len(), |i, j| step.b[(kept[i], driven[j])]),
        )
    }

    /// The motion of the kept coordinates in a step from the set point.
    pub(super) fn moved(&self, step: &Affine, rest: &Rest) -> Vec<f64> {
        let values = self.coordinates.values(&rest.x);
        let next = step.at(&values, &rest.u);
        self.kept.iter().map(|&at| next[at] - values[at]).collect()
    }

    /// The same, by a unit of an input.
    pub(super) fn moved_by(&self, step: &Affine, input: usize) -> Vec<f64> {
        self.kept.iter().map(|&at| step.b[(at, input)]).collect()
    }

    fn unreached(&self, step: &Affine) -> Vec<String> {
        let (a, b) = self.kept_step(step);
        self.weights.unreached(a.as_ref(), b.as_ref()).iter().map(|mode| self.in_words(mode)).collect()
    }

    /// The law of a step about the set point.
    fn law(
        &self,
        (name, rows, step): &(String, u64, Affine),
        rest: &Rest,
    ) -> Result<(RegionLaw, LqrRegion), ControlError> {
        let place = || {
            if self.pieces.regions.len() > 1 && name != "all" {
                format!("region {name}")
            } else {
                "the model".to_owned()
            }
        };
        let (a, b) = self.kept_step(step);
        let unreached = self.unreached(step);
        if !unreached.is_empty() {
            return Err(ControlError::NotStabilisable { place: place(), modes: unreached.join(" and ") });
        }
        let untrusted = |problem: String| ControlError::Riccati { place: place(), problem };
        let gains = self.weights.gains(a.as_ref(), b.as_ref()).ok_or_else(|| untrusted("it diverges".to_owned()))?;
        if !(gains.residual <= TRUSTED && gains.radius < 1.0) {
            let problem = format!("residual {:.1e}, closed loop's spectral radius {:.9}", gains.residual, gains.radius);
            return Err(untrusted(problem));
        }
        let Answer { command, rests, .. } =
            self.weights.answer(&gains, a.as_ref(), b.as_ref(), &self.moved(step, rest));
        let inputs = self.driven.iter().zip(&command).map(|(&input, correction)| rest.u[input] + correction).collect();
        let answers: Vec<Vec<f64>> = self
            .measured
            .iter()
            .map(|&input| self.weights.answer(&gains, a.as_ref(), b.as_ref(), &self.moved_by(step, input)).command)
            .collect();
        let law = RegionLaw {
            inputs,
            gain: rows_of(&gains.state),
            integral: if self.weights.integrated.is_empty() { Vec::new() } else { rows_of(&gains.integral) },
            measured: if answers.is_empty() {
                Vec::new()
            } else {
                (0..self.driven.len()).map(|j| answers.iter().map(|answer| -answer[j]).collect()).collect()
            },
        };
        let Gains { residual, radius, .. } = gains;
        let about = LqrRegion { name: name.clone(), rows: *rows, unreached, radius, residual, rests, borrowed: false };
        Ok((law, about))
    }

    /// A mode in words: `x and yaw (eigenvalue 1.02)`.
    fn in_words(&self, mode: &Mode) -> String {
        let kept = |at: usize| &self.coordinates.of[self.kept[at]].name;
        let name = |i: usize| match i.checked_sub(self.kept.len()) {
            None => kept(i).clone(),
            Some(integral) => format!("the integral of {}", kept(self.weights.integrated[integral].0)),
        };
        let parts: Vec<String> = (0..mode.share.len()).filter(|&i| mode.share[i] >= TAKES_PART).map(name).collect();
        let [re, im] = mode.eigenvalue;
        let eigenvalue = if im > 0.0 { format!("{re:.4} ± {im:.4}i") } else { format!("{re:.4}") };
        format!("a mode in {} (eigenvalue {eigenvalue} a sample)", parts.join(", "))
    }
}

/// Start of the search for a set point (states, then inputs), and marks of the given coordinates, then inputs.
fn given(
    model: &Model,
    pieces: &Pieces,
    coordinates: &Coordinates<'_>,
    setpoint: &[Named],
) -> Result<(Vec<f64>, Vec<bool>), ControlError> {
    let n = pieces.states.len();
    let mut start: Vec<f64> = pieces.seen.iter().map(|seen| seen.map_or(0.0, |[mean, _]| mean)).collect();
    let order = |place: usize| pieces.whole.state_order(place);
    for &place in coordinates.groups.iter().flat_map(|group| &group.places) {
        start[place] = order(place).and_then(|order| model.training.state_mean.get(order).copied()).unwrap_or(0.0);
    }
    pieces.whole.geometry().begin(&mut start[..n]);
    let (mut given, rest) = coordinates.given(setpoint, &mut start[..n])?;
    given.resize(coordinates.len() + pieces.inputs.len(), false);
    let rotations = coordinates.groups.iter().map(|group| format!("yaw({})", group.name)).collect::<Vec<_>>();
    let names: Vec<&String> = pieces.states.iter().chain(&rotations).chain(&pieces.inputs).collect();
    let inputs = names.len() - pieces.inputs.len();
    for (name, value) in &rest {
        let at = find("setpoint", "state or input", name, &names)? - inputs;
        (start[n + at], given[coordinates.len() + at]) = (*value, true);
    }
    Ok((start, given))
}

pub(super) fn rows_of(matrix: &Mat<f64>) -> Vec<Vec<f64>> {
    (0..matrix.nrows()).map(|i| (0..matrix.ncols()).map(|j| matrix[(i, j)]).collect()).collect()
}
