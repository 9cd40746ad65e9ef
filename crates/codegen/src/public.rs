//! The functions that users of the code call, in every language, with their descriptions.

use fleetfoot_model::Prediction;

use crate::{
    assemble::Assembled,
    code::{Function, Kind},
    plan::{Advance, Plan, Signal, Source},
};

/// A public function: the inner one behind it and its documentation.
pub(crate) struct Public<'a> {
    pub(crate) name: &'static str,
    pub(crate) inner: &'a Function,
    pub(crate) doc: String,
}

impl Assembled<'_> {
    /// The public functions that have no effect, in the order in which they are printed.
    pub(crate) fn public(&self) -> Vec<Public<'_>> {
        let discrete = !self.plan.continuous();
        let named = |function: &'static str, name: &'static str, doc: String| {
            self.code.functions.iter().find(|f| f.name == function).map(|inner| Public { name, inner, doc })
        };
        let method = "the region of (x, u)";
        let right = self.right_sides_doc();
        let slopes = if discrete { "the next states (angles not wrapped)" } else { "the right sides" };
        [
            named("right_sides", "derivative", right).filter(|_| !discrete),
            named("jacobian", "jacobian", format!(
                "Exact derivatives in {method}: {slopes} are A x + B u + c to first order. A is states x states, B states x inputs, by rows.{}",
                match (self.plan.memory() > 0, self.plan.next_inputs) {
                    (true, true) => " What earlier rows and the inputs of the next row contribute is in c.",
                    (true, false) => " What earlier rows contribute is in c.",
                    (false, true) => " What the inputs of the next row contribute is in c.",
                    (false, false) => "",
                }
            )),
            named("next", "next", format!("The states one step later.{}{}", self.step_doc(), self.next_inputs_doc())),
            named("next_jacobian", "next_jacobian", format!("Exact derivatives of a step with inputs held: the next states are A x + B u + c to first order (angles not wrapped{}).", if self.plan.rotations().is_empty() { "" } else { ", rotations not brought back" })),
            named("outputs", "predict", "The outputs.".into()),
            named("outputs_jacobian", "predict_jacobian", "Exact derivatives of the outputs: they are A x + B u + c to first order.".into()),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    fn right_sides_doc(&self) -> String {
        let derivative = Advance::Equation(Prediction::Derivative);
        let mixed = self.plan.states.iter().any(|state| state.advance != derivative);
        if mixed {
            format!(
                "The right sides of the states' equations: derivatives, per second, next values or changes{}.",
                if self.plan.lags() { "; of a first-order lag what it follows" } else { "" }
            )
        } else {
            "The derivatives of the states, per second.".into()
        }
    }

    fn step_doc(&self) -> String {
        match self.step {
            None => " dt is the length of the step in seconds; inputs are held over it.".into(),
            Some(step) => format!(" A step is {step:?} s."),
        }
    }

    /// Sentence about `u_next`; empty without it.
    pub(crate) fn next_inputs_doc(&self) -> &'static str {
        if self.plan.next_inputs {
            " u are the inputs of the present row, u_next those of the row that is stepped to."
        } else {
            ""
        }
    }

    /// Returns true if the caller gives `dt`.
    pub(crate) fn free_step(&self) -> bool {
        self.step.is_none()
    }

    /// The partition whose regions are given; `None` where there is but one region.
    pub(crate) fn reported(&self) -> Option<usize> {
        let evaluation = self.plan.advance.as_ref().or(self.plan.predict.as_ref())?;
        let cells = &evaluation.partitions[evaluation.reported?];
        Some(cells.partition)
    }

    /// Names of the regions that are given.
    pub(crate) fn regions(&self) -> Vec<&str> {
        match self.reported() {
            Some(partition) => {
                self.plan.model.summaries[partition].regions.iter().map(|region| region.name.as_str()).collect()
            }
            None => vec!["all"],
        }
    }

    /// Lines that describe the model, for the head of a file.
    pub(crate) fn about(&self) -> Vec<String> {
        let model = self.plan.model;
        let fitted = match model.training.rows {
            // A law, not what was fitted.
            0 => format!("Sampling period {:?} s.", model.step),
            rows => format!(
                "Fitted to {rows} rows of {} episodes with fleetfoot {}; sampling period {:?} s.",
                model.training.episodes.len(),
                model.training.version,
                model.step
            ),
        };
        let mut lines = vec![
            format!(
                "{} model {}, exported by fleetfoot {}.",
                model.method,
                self.model.hash(),
                env!("CARGO_PKG_VERSION")
            ),
            fitted,
            String::new(),
        ];
        let list = |what: &str, signals: &[&Signal]| -> Vec<String> {
            signals.iter().enumerate().map(|(i, signal)| format!("  {what}[{i}] {}", describe(signal, model))).collect()
        };
        let states: Vec<&Signal> = self.plan.states.iter().map(|state| &state.signal).collect();
        lines.extend(list("x", &states));
        lines.extend(list("u", &self.plan.inputs.iter().collect::<Vec<_>>()));
        lines.extend(list("y", &self.plan.outputs.iter().collect::<Vec<_>>()));
        lines.extend(self.plan.delays.iter().map(|delay| {
            let what = match delay.source {
                Source::State(i) => format!("the last {} values of x[{i}]", delay.depth),
                Source::Input(i) => format!("the last {} values of u[{i}]", delay.depth),
                Source::Time => format!("seconds since each of the last {} rows", delay.depth),
            };
            format!("  past[{}..{}] {what}, oldest first", delay.offset, delay.offset + delay.depth)
        }));
        lines.extend(self.lags_doc());
        lines.push(String::new());
        lines.push("Equations:".into());
        for equation in &self.model.equations {
            let right = equation.right.to_string();
            let right: String =
                if right.len() > 400 { right.chars().take(400).chain("...".chars()).collect() } else { right };
            lines.push(format!("  {} = {right}", equation.label()));
        }
        lines.push(String::new());
        lines.extend(self.codes());
        lines
    }

    /// Lines about the first-order lags among the states, and their initial values.
    fn lags_doc(&self) -> Vec<String> {
        if !self.plan.lags() {
            return Vec::new();
        }
        let states = self.plan.states.iter().enumerate();
        let lags = states.filter(|(_, state)| matches!(state.advance, Advance::Lag(_)));
        let names: Vec<String> = lags.map(|(i, state)| format!("x[{i}] {}", state.signal.name)).collect();
        let text = format!(
            "First-order lags are states: {}. If nothing else is known, start each at the value that it follows, as at rest.",
            names.join(", ")
        );
        [vec![String::new()], fold(&text, 112)].concat()
    }

    fn codes(&self) -> Vec<String> {
        let text = "Every function gives a code. Zero or more: the region. From -1 down: -1 - region, where some function of the regressors is outside of the range that its region saw in training (the numbers are computed all the same: extrapolation). NO_REGION: a label that was not seen in training. NOT_FINITE: an input, a function or a result that is not a finite number. With the last two, results are not to be used and the model's variable stays as it was.";
        fold(text, 112)
    }

    /// Numbers that a model's variable keeps.
    pub(crate) fn kept(&self) -> usize {
        self.plan.states.len() + self.plan.memory() + usize::from(self.plan.time)
    }
}

impl Plan<'_> {
    /// Returns true if a parameter of a public function is taken from the model's variable.
    pub(crate) fn keeps_in_model(&self, name: &str) -> bool {
        self.remembers() && matches!(name, "x" | "past" | "t")
    }
}

impl Public<'_> {
    /// Parameters that the caller gives: name and kind.
    pub(crate) fn parameters(&self, plan: &Plan<'_>) -> Vec<(&'static str, Kind)> {
        let given = self.inner.parameters.iter().filter(|parameter| !plan.keeps_in_model(parameter.name));
        given.map(|parameter| (self.outer_name(parameter.name), parameter.kind)).collect()
    }

    /// The name that the caller sees.
    pub(crate) fn outer_name(&self, name: &'static str) -> &'static str {
        match (self.name, name) {
            ("derivative", "f") => "dx",
            ("next", "n") => "x_next",
            ("predict", "f") => "y",
            (_, name) => name,
        }
    }
}

/// The name, unit and source of a signal.
fn describe(signal: &Signal, model: &fleetfoot_model::Model) -> String {
    let unit = signal.unit.as_ref().map_or_else(String::new, |unit| format!(" [{unit}]"));
    let angle = match &signal.part {
        Some(part) => format!(", {part}"),
        None if signal.angle => ", an angle in radians".to_owned(),
        None => String::new(),
    };
    let source = model.column(&signal.name).map(|column| model.columns[column].source.as_str());
    let source =
        source.filter(|source| *source != signal.name).map_or_else(String::new, |source| format!(" = {source}"));
    format!("{}{unit}{angle}{source}", signal.name)
}

/// Text in lines of at most `width` characters, broken at blanks.
pub(crate) fn fold(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let last = lines.len() - 1;
        if !lines[last].is_empty() && lines[last].len() + 1 + word.len() > width {
            lines.push(word.to_owned());
        } else {
            let line = &mut lines[last];
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}
