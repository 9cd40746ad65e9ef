//! Feed-forward networks beside a linear map: of several sizes the smallest that predicts as well as the best what did not train; the linear model where no network is better.

mod options;
mod report;
mod rows;
mod search;
#[cfg(test)]
mod tests;
mod train;

use std::sync::Arc;

use fleetfoot_data::setting::{EFFORT, FIT_NETWORK, HIDDEN};
use fleetfoot_data::{Progress, Work, packed};
use fleetfoot_dataset::{Dataset, Logs, StatisticFile};
use fleetfoot_library::Expr;
use fleetfoot_model::{Activation, Basis, BasisMap, DenseLayer, Model, Network as Units};
use fleetfoot_pwa::Identification;
use fleetfoot_recipe::{PwaSection, Recipe};
use fleetfoot_task::Task;
use options::NetworkOptions;
pub use report::{NetworkCandidate, NetworkErrors, NetworkReport};
use rows::Rows;
use search::{Found, search};
use train::Fitted as Trained;

use crate::{
    error::Error,
    method::{Data, FitRequest, Fitted, Method, RowFacts},
    objective::{Beginning, Refinement},
    plan::FitPlan,
    pwa::Pwa,
    radial,
    rollout_choice::RolloutRule,
    summary::FitSummary,
};

/// `fit network`.
#[derive(Debug, Clone)]
pub struct Network {
    options: NetworkOptions,
    /// The linear model of the same functions.
    linear: Pwa,
}

/// The linear model, what was compared, and the model that is written.
pub struct NetworkFound {
    linear: Identification,
    found: Found,
    rule: String,
    trained_rows: usize,
    model: Model,
}

impl Method for Network {
    const NAME: &'static str = "network";
    type Report = NetworkReport;
    type Task = Task;
    type Sums = ();
    type Found = NetworkFound;

    fn new(recipe: &Recipe, request: &FitRequest) -> Result<Self, Error> {
        radial::refuse(recipe, "fit network")?;
        let options = NetworkOptions::new(recipe)?;
        let mut linear = recipe.clone();
        linear.model.partition = Some("average".into());
        linear.pwa = PwaSection { folds: Some(options.folds), seed: Some(options.seed), ..PwaSection::default() };
        Ok(Self { options, linear: Pwa::new(&linear, request)? })
    }

    fn plan(&self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<FitPlan, Error> {
        let mut plan = self.linear.plan(recipe, logs, progress)?;
        let (inputs, targets) = (plan.candidates, plan.equations.len());
        let rows = plan.reading.rows.min(self.options.most_rows(inputs, targets));
        plan.passes += 1;
        plan.memory += self.options.bytes().min(rows * (inputs + 2 * targets) * 32);
        plan.work.operations += self.options.work(rows, inputs, targets);
        let sizes: Vec<String> = self.options.sizes().iter().map(|own| NetworkCandidate::name_of(own)).collect();
        plan.details = vec![format!("compared with the linear model on {rows} rows: {}", sizes.join(", "))];
        Ok(plan)
    }

    fn open(&mut self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<(Dataset, Task), Error> {
        let (dataset, task) = self.linear.open(recipe, logs, progress)?;
        match task.problem.weight {
            None => Ok((dataset, task)),
            Some(weight) => Err(Error::conflict(format!(
                "weight = \"{weight}\": {FIT_NETWORK} has no weights of rows; leave it away"
            ))),
        }
    }

    fn of_statistic(
        &self,
        _: &Recipe,
        _: &Recipe,
        _: &Arc<StatisticFile>,
        _: &mut Vec<String>,
        _: &dyn Progress,
    ) -> Result<(Task, ()), Error> {
        Err(Error::needs_rows(format!(
            "{FIT_NETWORK} trains on rows, which a statistic has not; give the logs instead"
        )))
    }

    fn carried(&self, recipe: &Recipe, over: Option<u32>) -> Recipe {
        self.linear.carried(recipe, over)
    }

    fn rollouts(&self) -> Option<RolloutRule> {
        self.linear.rollouts()
    }

    fn with_span(&self, recipe: &Recipe, task: &Task, over: Option<u32>) -> Task {
        self.linear.with_span(recipe, task, over)
    }

    /// Spans of derivatives are chosen by the linear model.
    fn trials(&self, data: Data<'_, Task>, progress: &dyn Progress) -> Result<Vec<(String, Model)>, Error> {
        self.linear.trials(data, progress)
    }

    fn sum(&self, _: Data<'_, Task>, _: &mut Vec<String>, _: &dyn Progress) -> Result<(), Error> {
        Ok(())
    }

    fn find(
        &self,
        data: Data<'_, Task>,
        (): &(),
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Vec<NetworkFound>, Error> {
        let mut of_linear = Vec::new();
        let linear = self.linear.find(data, &None, &mut of_linear, progress)?.swap_remove(0);
        let rows = self.rows(data, progress, true)?;
        let (p, q) = (rows.table.inputs(), rows.table.targets());
        progress.expect(Work {
            operations: self.options.work(rows.table.rows(), p, q),
            parts: usize::from(self.options.folds),
            mend: format!(
                "less effort ({}) or one size of hidden layers ({}) makes it shorter",
                EFFORT.to("low"),
                HIDDEN.to("16")
            ),
        });
        let mut found = search(&rows, &self.options, progress)?;
        if rows.table.rows() < rows.complete {
            found.notes.push(format!(
                "{} of {} complete rows, evenly taken, train and test the networks; more memory or effort takes more",
                rows.table.rows(),
                rows.complete
            ));
        }
        let mut model = linear.model.clone();
        if found.chosen == 0 {
            model.method = "network linear".into();
            let reason = match found.candidates.len() {
                1 => "no network was compared",
                _ => "no network predicts held-out rows better than the linear model by more than one standard error",
            };
            found.notes.push(format!("{reason}: the linear model is written"));
            notes.append(&mut of_linear);
        } else {
            self.write(&mut model, &found.fitted, &rows);
        }
        notes.append(&mut found.notes);
        Ok(vec![NetworkFound { linear, found, rule: rows.rule, trained_rows: rows.table.rows(), model }])
    }

    fn model(found: &NetworkFound) -> &Model {
        &found.model
    }

    fn again(&self, data: Data<'_, Task>, found: &NetworkFound, progress: &dyn Progress) -> Result<Beginning, Error> {
        let (_, mut model) = self.linear.trials(data, progress)?.swap_remove(0);
        model.method.clone_from(&found.model.method);
        let hidden = &found.found.candidates[found.found.chosen].hidden;
        if !hidden.is_empty() {
            let rows = self.rows(data, progress, false)?;
            let [all, _] = rows.split(None);
            let (p, q) = (rows.table.inputs(), rows.table.targets());
            let how = self.options.training(hidden, all.len(), p, q);
            let shape =
                fleetfoot_learn::Shape { inputs: p, hidden: hidden.clone(), activation: self.options.activation };
            let fitted = train::network(&shape, &rows.table, &all, &how, progress)?;
            self.write(&mut model, &fitted, &rows);
        }
        Ok((model, None))
    }

    fn refine(&self, _: Data<'_, Task>, (): &(), _: &mut NetworkFound, _: &mut Refinement) -> Result<(), Error> {
        Ok(())
    }

    fn expressions(&self, task: &Task) -> Vec<Expr> {
        self.linear.expressions(task)
    }

    fn facts(&self, data: Data<'_, Task>, (): &(), found: &NetworkFound) -> RowFacts {
        self.linear.facts(data, &None, &found.linear)
    }

    fn report(
        &self,
        _: Data<'_, Task>,
        (): &(),
        found: NetworkFound,
        summary: FitSummary,
        _: &dyn Progress,
    ) -> Result<Fitted<NetworkReport>, Error> {
        let NetworkFound { linear, found, rule, trained_rows, model } = found;
        let report = NetworkReport {
            hash: model.hash(),
            rows: linear.rows,
            trained_rows: trained_rows as u64,
            targets: linear.targets,
            sigma: linear.sigma,
            fold_rule: rule,
            candidates: found.candidates,
            chosen: found.chosen,
            held_out: found.held_out,
            summary,
        };
        Ok(Fitted { value: None, model, rivals: Vec::new(), report })
    }
}

impl Network {
    /// The rows of a fit, in folds or not.
    fn rows(&self, data: Data<'_, Task>, progress: &dyn Progress, folds: bool) -> Result<Rows, Error> {
        let problem = &data.task.problem;
        let mut options = self.linear.of(data);
        if !folds {
            options.folds = 0;
        }
        let targets = problem.equations.iter().filter(|equation| equation.target.is_some()).count();
        Rows::read(problem, &options, self.options.most_rows(problem.library.len(), targets), data.rows()?, progress)
    }

    /// Puts a network into the latents of the linear model, and the covariance of its residuals in place of the linear model's.
    fn write(&self, model: &mut Model, fitted: &Trained, rows: &Rows) {
        let Some((shape, parameters)) = &fitted.hidden else { return };
        let (p, q) = (rows.table.inputs(), rows.table.targets());
        let (centre, scale) = (&fitted.units.centre, &fitted.units.scale);
        let activation = match shape.activation {
            fleetfoot_learn::Activation::Tanh => Activation::Tanh,
            fleetfoot_learn::Activation::Relu => Activation::Relu,
            fleetfoot_learn::Activation::Softplus => Activation::Softplus,
        };
        let mut before = p;
        let layer = |(weights, biases): (&[f64], &[f64])| {
            let weights = weights.chunks_exact(before).map(<[f64]>::to_vec).collect();
            before = biases.len();
            DenseLayer { weights, biases: biases.to_vec() }
        };
        let basis = Basis::Network(Arc::new(Units {
            inputs: rows.inputs.clone(),
            centre: centre[..p].to_vec(),
            scale: scale[..p].to_vec(),
            activation,
            layers: shape.split(parameters).into_iter().map(layer).collect(),
        }));
        let output = &fitted.output.0;
        for (t, latent) in model.latents.iter_mut().enumerate() {
            let Some(affine) = latent.affine() else { continue };
            let mut affine = affine.clone();
            let unit = scale[p + t];
            let mut constant = output[(0, t)];
            affine.coefficients[0].fill(0.0);
            for (j, &input) in rows.inputs.iter().enumerate() {
                constant -= output[(1 + j, t)] * centre[j] / scale[j];
                affine.coefficients[0][input] = unit * output[(1 + j, t)] / scale[j];
            }
            affine.constants[0] = centre[p + t] + unit * constant;
            let weights = vec![(0..shape.features()).map(|k| unit * output[(1 + p + k, t)]).collect()];
            latent.map = BasisMap { affine, basis: basis.clone(), weights }.into();
        }
        if let Some(region) = model.summaries.first_mut().and_then(|summary| summary.regions.first_mut()) {
            for a in 0..q {
                for b in 0..=a {
                    let product = fitted.sums.error_product(&fitted.output, [a, b]);
                    region.residual_covariance[packed(a, b)] = product * scale[p + a] * scale[p + b];
                }
            }
        }
        model.partitions.iter_mut().for_each(|partition| partition.correlation = None);
        let sizes: Vec<String> = shape.hidden.iter().map(usize::to_string).collect();
        model.method = format!("network {} {}", sizes.join("-"), activation.name());
    }
}
