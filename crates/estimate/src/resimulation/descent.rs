//! Sequential convex programs within a region of trust (Nocedal and Wright, Numerical Optimization, 2006, sections 18.2 and 18.5).
//!
//! A step solves the program whose constraints are linearised at the present place; the objective is quadratic already.
//! The merit is the objective and nu |zeta|_1, nu above every multiplier. A step is taken if it brings a fair part of
//! the reduction that the program promised. If not, the constraints are corrected to second order once, and then the
//! region shrinks. Near a minimum the promise is of second order in the remaining distance, and drowns in the merit's
//! rounding when half of the digits are right. From there on steps are taken as long as the certificate, which is of
//! first order, gets better. Curvature of the constraints is left out of the programs: it matters by as much as the
//! model and the recording disagree.
//!
//! Columns are counted in their deviations here, in which the objective weighs all of them alike. The region of trust
//! and the certificate of the constraints are in spreads.

use super::{
    Certificate, Ending, Scale,
    program::{Program, Step},
};
use crate::{
    EstimateError,
    recorded::Recorded,
    transcription::{Defects, Transcription},
};

/// Convergence limits: defects in spreads, and stationarity.
const DEFECT: f64 = 1e-10;
const STATIONARY: f64 = 1e-8;
/// The region at first, and where it is given up, in spreads.
const RADIUS: [f64; 2] = [1.0, 1e-9];
/// The share of the promised reduction that a step must bring.
const TAKEN: f64 = 1e-3;
/// The share of the merit below which a promise is not to be seen in it.
const DROWNED: f64 = 1e-9;
/// Parts of the gradient that are smaller, in deviations, count as this: a part that is 0 but for rounding needs a
/// floor.
const LEAST_PART: f64 = 1e-4;

/// A recording followed.
pub(super) struct Followed {
    /// Rows x columns.
    pub(super) values: Vec<f64>,
    pub(super) certificate: Certificate,
    pub(super) ending: Ending,
    pub(super) programs: usize,
}

/// Place of the iteration.
struct Place {
    z: Vec<f64>,
    /// In units of the deviations.
    defects: Defects,
    objective: f64,
}

struct Problem<'a> {
    transcription: &'a Transcription,
    recorded: &'a Recorded,
    scale: &'a Scale,
    /// W (rows x columns): the weights of rows, 0 where nothing was recorded.
    weights: Vec<f64>,
    n: usize,
}

/// The iteration.
struct Search<'a> {
    problem: &'a Problem<'a>,
    place: Place,
    multipliers: Vec<f64>,
    radius: f64,
    nu: f64,
    programs: usize,
    /// Origin of a step that the merit could not judge.
    before: Option<(Place, Vec<f64>, Certificate)>,
}

/// Follows a recording from itself; `None` where the model has no value along it.
pub(super) fn follow(
    transcription: &Transcription,
    recorded: &Recorded,
    scale: &Scale,
    iterations: usize,
) -> Result<Option<Followed>, EstimateError> {
    let problem = Problem::new(transcription, recorded, scale);
    let Some(mut search) = Search::new(&problem) else { return Ok(None) };
    let ending = loop {
        fleetfoot_data::checkpoint();
        if let Some(ending) = search.advance(iterations)? {
            break ending;
        }
    };
    let certificate = problem.certificate(&search.place, &search.multipliers);
    Ok(Some(Followed { values: search.place.z, certificate, ending, programs: search.programs }))
}

impl<'a> Search<'a> {
    fn new(problem: &'a Problem<'a>) -> Option<Self> {
        let c = problem.scale.bounds.len();
        let inside = |(at, value): (usize, &f64)| {
            let [low, high] = problem.scale.bounds[at % c];
            value.clamp(low, high)
        };
        let place = problem.at(problem.recorded.values.iter().enumerate().map(inside).collect())?;
        let multipliers = vec![0.0; place.defects.values.len()];
        Some(Self { problem, place, multipliers, radius: RADIUS[0], nu: 1.0, programs: 0, before: None })
    }

    /// A program, and where it leads; how the iteration ends, where it does.
    fn advance(&mut self, iterations: usize) -> Result<Option<Ending>, EstimateError> {
        let (problem, place) = (self.problem, &self.place);
        let slope = problem.slope(&place.z);
        let step = problem.step(place, &slope, (&place.defects.values, &self.multipliers), [self.radius, self.nu])?;
        self.programs += 1;
        self.nu = step.multipliers.iter().fold(self.nu, |nu, value| nu.max(2.0 * value.abs()));
        self.multipliers.clone_from(&step.multipliers);
        let certificate = problem.certificate(place, &self.multipliers);
        if certificate.of_minimum() <= 1.0 {
            return Ok(Some(Ending::Minimum));
        }
        let worse = |(.., other): &mut (Place, Vec<f64>, Certificate)| other.of_minimum() <= certificate.of_minimum();
        if let Some((place, multipliers, _)) = self.before.take_if(worse) {
            (self.place, self.multipliers) = (place, multipliers);
            return Ok(Some(Ending::Stalled));
        }
        if self.programs >= iterations {
            return Ok(Some(Ending::Iterations));
        }
        let promised = problem.promised(place, &slope, &step.step, self.nu);
        if promised > DROWNED * place.objective + problem.rounding(place, self.nu) {
            self.before = None;
            return self.judged(&slope, step, promised);
        }
        let Some(next) = problem.moved(place, &step.step) else { return Ok(Some(Ending::Stalled)) };
        self.before = Some((std::mem::replace(&mut self.place, next), self.multipliers.clone(), certificate));
        Ok(None)
    }

    /// Takes a step, corrects it or shrinks the region, by the merit.
    fn judged(&mut self, slope: &[f64], step: Step, promised: f64) -> Result<Option<Ending>, EstimateError> {
        let (problem, place, nu) = (self.problem, &self.place, self.nu);
        let length = problem.length(&step.step);
        let (ratio, taken) = match problem.tried(place, &step, promised, nu) {
            (ratio, Some(next)) if ratio >= TAKEN => (ratio, Some(next)),
            (ratio, Some(next)) => {
                self.programs += 1;
                let corrected =
                    problem.corrected((place, &next), (slope, &self.multipliers), [self.radius, nu, promised])?;
                corrected.map_or((ratio, None), |(ratio, place)| (ratio, Some(place)))
            }
            (ratio, None) => (ratio, None),
        };
        self.radius = match (&taken, ratio) {
            (None, _) => 0.25 * length.min(self.radius),
            (Some(_), ratio) if ratio > 0.75 => self.radius.max(2.0 * length),
            (Some(_), ratio) if ratio < 0.25 => 0.5 * length.min(self.radius),
            _ => self.radius,
        };
        if let Some(next) = taken {
            self.place = next;
        }
        Ok((self.radius < RADIUS[1]).then_some(Ending::Stalled))
    }
}

impl Certificate {
    /// Distance from a certified minimum, which is at 1 and below.
    fn of_minimum(&self) -> f64 {
        (self.dynamics / DEFECT).max(self.stationarity / STATIONARY)
    }
}

impl<'a> Problem<'a> {
    fn new(transcription: &'a Transcription, recorded: &'a Recorded, scale: &'a Scale) -> Self {
        let c = scale.spreads.len();
        let rows = recorded.weights();
        let weight = |at: usize| if recorded.there[at] { rows[at / c] } else { 0.0 };
        let weights = (0..recorded.values.len()).map(weight).collect();
        Self { transcription, recorded, scale, weights, n: transcription.states() }
    }

    /// Unit of a place's column: its deviation.
    fn unit(&self, at: usize) -> f64 {
        self.scale.deviations[at % self.scale.deviations.len()]
    }

    fn spread(&self, at: usize) -> f64 {
        self.scale.spreads[at % self.scale.spreads.len()]
    }

    fn at(&self, z: Vec<f64>) -> Option<Place> {
        let defects = self.transcription.defects(self.recorded, &z)?.scaled(self.n, &self.scale.deviations);
        let square = |at: usize| self.weights[at] * ((z[at] - self.recorded.values[at]) / self.unit(at)).powi(2);
        let objective = 0.5 * (0..z.len()).map(square).sum::<f64>();
        Some(Place { z, defects, objective })
    }

    /// W xi.
    fn slope(&self, z: &[f64]) -> Vec<f64> {
        let of = |at: usize| self.weights[at] * (z[at] - self.recorded.values[at]) / self.unit(at);
        (0..z.len()).map(of).collect()
    }

    /// The largest component of a step, in spreads.
    fn length(&self, step: &[f64]) -> f64 {
        let scaled = |(at, d): (usize, &f64)| d.abs() * self.unit(at) / self.spread(at);
        step.iter().enumerate().map(scaled).fold(0.0, f64::max)
    }

    /// Step from the defects and the expected multipliers.
    fn step(
        &self,
        place: &Place,
        slope: &[f64],
        (values, known): (&[f64], &[f64]),
        [radius, nu]: [f64; 2],
    ) -> Result<Step, EstimateError> {
        let c = self.scale.spreads.len();
        let room = |end: usize, sign: f64| -> Vec<f64> {
            let of = |at: usize| {
                let room = sign * (self.scale.bounds[at % c][end] - place.z[at]);
                sign * room.min(radius * self.spread(at)).max(0.0) / self.unit(at)
            };
            (0..place.z.len()).map(of).collect()
        };
        let (low, high) = (room(0, -1.0), room(1, 1.0));
        let (states, weights, defects) = (self.n, &self.weights[..], &place.defects);
        // The price of s is above what multipliers were, and is raised while s remains.
        let nu = 10.0 * nu;
        Program { states, columns: c, weights, slope, defects, values, known, low: &low, high: &high }.step(nu)
    }

    fn merit(&self, place: &Place, nu: f64) -> f64 {
        place.objective + nu * place.defects.values.iter().map(|value| value.abs()).sum::<f64>()
    }

    /// Effect of the defects' rounding on the merit: they are differences of states.
    fn rounding(&self, place: &Place, nu: f64) -> f64 {
        let c = self.scale.spreads.len();
        let size_of = |at: usize| if at % c < self.n { (place.z[at] / self.unit(at)).abs() } else { 0.0 };
        4.0 * f64::EPSILON * nu * (0..place.z.len()).map(size_of).sum::<f64>()
    }

    /// By how much the program lowers the merit.
    fn promised(&self, place: &Place, slope: &[f64], step: &[f64], nu: f64) -> f64 {
        let objective = |at: usize| step[at] * (slope[at] + 0.5 * self.weights[at] * step[at]);
        let lowered: f64 = -(0..step.len()).map(objective).sum::<f64>();
        let moved = place.defects.moved(self.n, step);
        let sum = |values: &[f64]| values.iter().map(|value| value.abs()).sum::<f64>();
        let left: Vec<f64> = moved.iter().zip(&place.defects.values).map(|(moved, value)| moved + value).collect();
        lowered + nu * (sum(&place.defects.values) - sum(&left))
    }

    /// End of a step; `None` if the model has no value there.
    fn moved(&self, place: &Place, step: &[f64]) -> Option<Place> {
        let c = self.scale.spreads.len();
        let moved = |at: usize| {
            let [low, high] = self.scale.bounds[at % c];
            (place.z[at] + step[at] * self.unit(at)).clamp(low, high)
        };
        self.at((0..place.z.len()).map(moved).collect())
    }

    /// End of a step, and the share of the promised reduction that it brings.
    fn tried(&self, place: &Place, step: &Step, promised: f64, nu: f64) -> (f64, Option<Place>) {
        match self.moved(place, &step.step) {
            Some(next) => ((self.merit(place, nu) - self.merit(&next, nu)) / promised, Some(next)),
            None => (f64::NEG_INFINITY, None),
        }
    }

    /// The step, corrected for the second-order change of the constraints.
    fn corrected(
        &self,
        (place, tried): (&Place, &Place),
        (slope, known): (&[f64], &[f64]),
        [radius, nu, promised]: [f64; 3],
    ) -> Result<Option<(f64, Place)>, EstimateError> {
        let step: Vec<f64> = (0..place.z.len()).map(|at| (tried.z[at] - place.z[at]) / self.unit(at)).collect();
        let moved = place.defects.moved(self.n, &step);
        let values: Vec<f64> = tried.defects.values.iter().zip(&moved).map(|(value, moved)| value - moved).collect();
        let step = self.step(place, slope, (&values, known), [radius, nu])?;
        let (ratio, next) = self.tried(place, &step, promised, nu);
        Ok(next.filter(|_| ratio >= TAKEN).map(|next| (ratio, next)))
    }

    /// Distance from a minimum of a place with these multipliers.
    fn certificate(&self, place: &Place, multipliers: &[f64]) -> Certificate {
        let c = self.scale.spreads.len();
        let slope = self.slope(&place.z);
        let pull = place.defects.transposed(self.n, multipliers);
        let mut parts = vec![LEAST_PART; c];
        for (at, (slope, pull)) in slope.iter().zip(&pull).enumerate() {
            parts[at % c] = parts[at % c].max(slope.abs()).max(pull.abs());
        }
        // Of what a bound takes up, only the way to it counts.
        let left = |at: usize| {
            let ([low, high], gradient) = (self.scale.bounds[at % c], slope[at] + pull[at]);
            let room = if gradient > 0.0 { place.z[at] - low } else { high - place.z[at] };
            (gradient.abs() / parts[at % c]).min(room.max(0.0) / self.spread(at))
        };
        let outside = |at: usize| {
            let [low, high] = self.scale.bounds[at % c];
            (low - place.z[at]).max(place.z[at] - high).max(0.0) / self.spread(at)
        };
        let defect = |(at, value): (usize, &f64)| {
            let state = at % self.n;
            value.abs() * self.scale.deviations[state] / self.scale.spreads[state]
        };
        let (count, largest) = (place.z.len(), |largest: f64, value: f64| largest.max(value));
        Certificate {
            dynamics: place.defects.values.iter().enumerate().map(defect).fold(0.0, largest),
            bounds: (0..count).map(outside).fold(0.0, largest),
            stationarity: (0..count).map(left).fold(0.0, largest),
        }
    }
}

impl Defects {
    /// J d.
    fn moved(&self, n: usize, step: &[f64]) -> Vec<f64> {
        let c = self.before.len() / self.values.len();
        let of = |at: usize| {
            let k = at / n;
            let (before, behind) = (&self.before[at * c..(at + 1) * c], &self.behind[at * c..(at + 1) * c]);
            let sum = |slopes: &[f64], row: usize| slopes.iter().zip(&step[row * c..]).map(|(a, d)| a * d).sum::<f64>();
            sum(before, k) + sum(behind, k + 1)
        };
        (0..self.values.len()).map(of).collect()
    }

    /// J' lambda.
    pub(super) fn transposed(&self, n: usize, multipliers: &[f64]) -> Vec<f64> {
        let c = self.before.len() / self.values.len();
        let mut product = vec![0.0; (self.values.len() / n + 1) * c];
        for (at, lambda) in multipliers.iter().enumerate() {
            for (block, row) in [(&self.before, at / n), (&self.behind, at / n + 1)] {
                let out = product[row * c..(row + 1) * c].iter_mut();
                out.zip(&block[at * c..(at + 1) * c]).for_each(|(out, slope)| *out += slope * lambda);
            }
        }
        product
    }
}
