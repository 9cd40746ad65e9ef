//! Report of a fit to simulations, for people and for programs.

use fleetfoot_estimate::Status;
use fleetfoot_library::Expr;
use fleetfoot_model::{Latent, Model};
use fleetfoot_task::EquationTask;
use serde::{Serialize, Serializer};

use super::{Bounded, HeldOutErrors, RefinedFold, Refinement};

impl Refinement {
    fn mean(&self, of: impl Fn(&HeldOutErrors) -> f64) -> [f64; 2] {
        let mean = |side: fn(&RefinedFold) -> &HeldOutErrors| {
            self.folds.iter().map(|fold| of(side(fold))).sum::<f64>() / self.folds.len() as f64
        };
        [mean(|fold| &fold.one_step), mean(|fold| &fold.simulated)]
    }

    /// Error of held-out rollouts over persistence, the mean over the folds: fitted to one step, and to simulations.
    pub fn rollouts(&self) -> [f64; 2] {
        self.mean(|errors| errors.rollouts)
    }

    /// The same of the longer rollouts.
    pub fn far_rollouts(&self) -> [f64; 2] {
        self.mean(|errors| errors.far)
    }

    /// Held-out error one step ahead over the null model's, the mean over targets and folds: fitted to one step, and to simulations.
    pub fn one_step(&self) -> [f64; 2] {
        self.mean(HeldOutErrors::over_null)
    }

    /// Held-out rollouts that ended early: fitted to one step, and to simulations; and how many there are.
    pub fn ended(&self) -> ([usize; 2], usize) {
        let sum = |of: fn(&RefinedFold) -> usize| self.folds.iter().map(of).sum();
        ([sum(|fold| fold.one_step.ended), sum(|fold| fold.simulated.ended)], sum(|fold| fold.one_step.starts))
    }

    /// Root of the mean squared error of a target one step ahead on the rows that did not train, and the coefficient of determination there: of the model
    /// fitted to simulations.
    pub fn held_out(&self, target: usize) -> [f64; 2] {
        let scores = || self.folds.iter().map(|fold| &fold.simulated.one_step);
        let rows: f64 = scores().map(|scores| scores.rows as f64).sum();
        let squares = |of: fn(&fleetfoot_dynamics::TargetScore) -> f64| {
            scores().map(|scores| scores.rows as f64 * of(&scores.targets[target]).powi(2)).sum::<f64>()
        };
        let (errors, spread) = (squares(|target| target.rmse), squares(|target| target.deviation));
        // Of what does not vary there is nothing to explain.
        [(errors / rows).sqrt(), if spread > 0.0 { 1.0 - errors / spread } else { f64::NAN }]
    }

    /// One sentence: the model that is written, and the reason.
    pub fn verdict(&self) -> &'static str {
        if self.written {
            "The model fitted to simulations is written: its rollouts on rows that did not train err less."
        } else if self.far_rollouts()[1] > self.far_rollouts()[0] && self.rollouts()[1] < self.rollouts()[0] {
            "The model fitted one step ahead is written: the one fitted to simulations is better over its own steps and worse over more of them, on rows that did not train."
        } else {
            "The model fitted one step ahead is written: the fit to simulations does not improve rollouts on rows that did not train."
        }
    }

    /// The fit and its effect on held-out rollouts, in sentences.
    pub fn in_words(&self) -> String {
        let Self { rule, fitted, far, .. } = self;
        let end = match fitted.status {
            Status::Iterations => "as many as are allowed: the minimum is not reached",
            Status::Reduction => "until a step lowers the sum by less than a thousandth",
            _ => "converged",
        };
        let missing = match fitted.missing {
            0 => String::new(),
            count => format!(", {count} left out for missing values"),
        };
        let roots = fitted.cost.map(|cost| (cost / fitted.segments as f64).sqrt());
        let ([before, after], starts) = self.ended();
        let ([rollouts, simulated], [one_far, far_simulated]) = (self.rollouts(), self.far_rollouts());
        let [one_step, refined] = self.one_step();
        format!(
            "Simulation error: {} coefficients fitted to {} segments of {} steps{missing}; {} passes, {end}.\n\
             In training, the root of the mean squared error in standard deviations goes from {:.4} to {:.4}; {} and {} segments ended early.\n\
             Held out ({} folds), before and after: rollouts of {} steps over persistence {rollouts:.4} and {simulated:.4}, {before} and {after} of {starts} ended early; of {far} steps {one_far:.4} and {far_simulated:.4};\n\
             one step ahead, mean absolute error over the null model's, {one_step:.4} and {refined:.4}.\n{}{}{}",
            fitted.coefficients.len(),
            fitted.segments,
            rule.horizon,
            fitted.passes,
            roots[0],
            roots[1],
            fitted.ended[0],
            fitted.ended[1],
            rule.folds,
            rule.horizon,
            self.weights_in_words(),
            self.bound_in_words(),
            self.verdict()
        )
    }

    /// The chosen weight of the prior, in words; empty without a prior.
    fn weights_in_words(&self) -> String {
        let Some(weight) = self.fitted.weight.filter(|_| !self.weights.is_empty()) else { return String::new() };
        let text =
            |errors: &super::WeightErrors| format!("{} ({:.4}, {:.4})", errors.weight, errors.rollouts, errors.far);
        let tried: Vec<String> = self.weights.iter().map(text).collect();
        format!(
            "The error of one step weighs {weight} of the squared number of steps, of {}: rollouts of {} and of {} steps, held out.\n",
            tried.join(", "),
            self.rule.horizon,
            self.far
        )
    }

    /// The contraction of the maps, in words; empty without a bound.
    fn bound_in_words(&self) -> String {
        self.bound.map_or_else(String::new, |bound| format!("Its regions {}\n", bound.in_words()))
    }
}

impl Bounded {
    /// The greatest of the regions, as sentences behind their subject.
    pub fn in_words(self) -> String {
        let passive = self.passive_norm.map_or_else(String::new, |norm| {
            format!(
                " At its ports their energy gain is at most {norm:.4} of the allowed one, with the storage of one step."
            )
        });
        format!(
            "contract by {} in the metric of one step: greatest radius {:.4}, greatest norm {:.4}.{passive}",
            self.bound, self.radius, self.norm
        )
    }
}

impl Serialize for Refinement {
    /// The same for programs; pairs are before and after.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Content<'a> {
            steps: usize,
            folds: usize,
            coefficients: usize,
            segments: u64,
            missing: u64,
            passes: usize,
            converged: bool,
            gradient: f64,
            cost: &'a [f64],
            ended_segments: &'a [u64],
            residuals: u64,
            rollouts_over_persistence: [f64; 2],
            rollouts_by_fold: Vec<[f64; 2]>,
            far_steps: usize,
            far_rollouts_over_persistence: [f64; 2],
            one_step_over_null: [f64; 2],
            one_step_by_fold: Vec<[f64; 2]>,
            ended_rollouts: [usize; 2],
            rollouts: usize,
            #[serde(skip_serializing_if = "Option::is_none")]
            prior_weight: Option<f64>,
            #[serde(skip_serializing_if = "<[_]>::is_empty")]
            prior_weights: &'a [super::WeightErrors],
            #[serde(skip_serializing_if = "Option::is_none")]
            bound: Option<super::Bounded>,
            written: bool,
        }
        let each = |of: fn(&HeldOutErrors) -> f64| {
            self.folds.iter().map(|fold| [of(&fold.one_step), of(&fold.simulated)]).collect()
        };
        let (rule, fitted) = (&self.rule, &self.fitted);
        let (ended_rollouts, rollouts) = self.ended();
        Content {
            steps: rule.horizon,
            folds: rule.folds,
            coefficients: fitted.coefficients.len(),
            segments: fitted.segments,
            missing: fitted.missing,
            passes: fitted.passes,
            converged: fitted.status.converged(),
            gradient: fitted.gradient,
            cost: &fitted.cost,
            ended_segments: &fitted.ended,
            residuals: fitted.residuals,
            rollouts_over_persistence: self.rollouts(),
            rollouts_by_fold: each(|errors| errors.rollouts),
            far_steps: self.far,
            far_rollouts_over_persistence: self.far_rollouts(),
            one_step_over_null: self.one_step(),
            one_step_by_fold: each(HeldOutErrors::over_null),
            ended_rollouts,
            rollouts,
            prior_weight: fitted.weight,
            prior_weights: &self.weights,
            bound: self.bound,
            written: self.written,
        }
        .serialize(serializer)
    }
}

/// Positions of a fitted equation's candidates in its latent.
pub(crate) struct Coefficients<'a> {
    latent: Option<&'a Latent>,
    /// The feature of every candidate: `None` for one that the latent does not have.
    features: Vec<Option<usize>>,
    constant: bool,
}

impl<'a> Coefficients<'a> {
    /// Of the fitted equation `target` of a task, in a model of that task.
    pub(crate) fn new(task: &EquationTask, model: &'a Model, target: usize) -> Self {
        let latent = model.latents.iter().find(|latent| latent.name == task.fitted[target].latent);
        let features: Vec<Option<Expr>> = latent.map_or_else(Vec::new, |latent| {
            let library = model.libraries.get(latent.library).map_or(&[][..], |library| library);
            (0..latent.map.features()).map(|j| latent.map.expression(j, library)).collect()
        });
        let place = |function: &Expr| features.iter().position(|feature| feature.as_ref() == Some(function));
        Self { latent, features: task.functions.iter().map(place).collect(), constant: task.constant }
    }

    /// The coefficient of a candidate, by its index, in a region.
    pub(crate) fn of(&self, region: usize, candidate: usize) -> Option<f64> {
        let map = &self.latent?.map;
        if region >= map.regions() {
            return None;
        }
        match candidate.checked_sub(usize::from(self.constant)) {
            None => Some(map.constant(region)),
            Some(function) => Some(map.coefficient(region, self.features[function]?)),
        }
    }
}
