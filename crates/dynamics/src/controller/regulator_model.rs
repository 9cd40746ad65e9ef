//! A regulator as a model, so that it becomes code by the same way.

use fleetfoot_data::packed;
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{Column, Equation, Latent, Model, Partition, Prediction, Region, Role, Rule, Training};

use super::{Controller, ParameterError, Regulator};

impl Regulator {
    /// The law as a model of its own memory: states are the inputs that it drives, then the integrals; inputs are the columns that it reads; a step is a sample. After a step
    /// the first states are the commands.
    ///
    /// What the law leaves as it is where no region holds or something is missing, exported code leaves too: it gives a code, and its variable stays.
    ///
    /// # Errors
    /// Those of [`Controller::validate`].
    pub fn model(&self) -> Result<Model, ParameterError> {
        self.validate()?;
        let names = Names::new(self);
        let column = |name: &String, role| Column {
            angle: self.states.iter().any(|state| state.angle && state.name == *name),
            ..Column::new(name.clone(), role)
        };
        let kept = names.driven.iter().chain(&names.integrals);
        let columns: Vec<Column> = (kept.map(|name| column(name, Role::State)))
            .chain(names.read.iter().map(|name| column(name, Role::Input)))
            .collect();
        let count = names.driven.len() + names.integrals.len();
        let mut state_covariance = vec![0.0; count * (count + 1) / 2];
        (0..count).for_each(|i| state_covariance[packed(i, i)] = 1.0);
        let version = env!("CARGO_PKG_VERSION").to_owned();
        let mut model = Model::new(
            "regulator",
            columns,
            self.period,
            Training { version, state_covariance, ..Training::default() },
        );
        model.libraries = vec![self.functions(&names)];
        model.partitions = vec![self.regions()];
        model.equations = self.equations(&names);
        let read = |latent: &Latent| {
            model.equations.iter().any(|equation| equation.right.columns().iter().any(|name| **name == *latent.name))
        };
        let latents = self.latents(&names);
        model.latents = latents.into_iter().filter(read).collect();
        Ok(model)
    }

    /// Errors of states, integrals, and what is measured beside the set point.
    fn functions(&self, names: &Names) -> Vec<Expr> {
        let from = |name: &String, at: f64| {
            if at == 0.0 { Expr::column(name.as_str()) } else { Expr::column(name.as_str()) - at }
        };
        let error = |state: &super::RegulatedState| {
            let error = from(&state.name, state.at);
            if state.angle { error.wrap() } else { error }
        };
        (self.states.iter().map(error))
            .chain(names.integrals.iter().map(|name| Expr::column(name.as_str())))
            .chain(self.measured.iter().map(|column| from(&column.name, column.at)))
            .collect()
    }

    /// The partition, with the sizes of states as what its regions saw.
    fn regions(&self) -> Partition {
        let (n, q) = (self.states.len(), self.integrated.len());
        let sizes: Vec<f64> = (self.states.iter().map(|state| state.size))
            .chain(self.integrated.iter().map(|&state| self.states[state].size))
            .chain(self.measured.iter().map(|column| column.size))
            .collect();
        let functions = n + q + self.measured.len();
        let region = |name: String| Region {
            name,
            rows: 0,
            mean: vec![0.0; functions],
            covariance: vec![0.0; functions * (functions + 1) / 2],
            range: sizes.iter().map(|&size| [-2.0 * size, 2.0 * size]).collect(),
            residual_covariance: Vec::new(),
            rank: functions,
            condition: 1.0,
            confounded: Vec::new(),
        };
        let mut partition = match &self.partition {
            None => Partition::whole(),
            Some(choice) => Partition {
                specification: "regulator".into(),
                columns: choice.columns.iter().filter_map(|text| Expr::parse(text, &Scope::open()).ok()).collect(),
                centre: choice.centre.clone(),
                scale: choice.scale.clone(),
                rule: choice.rule.clone(),
                ..Partition::whole()
            },
        };
        partition.regions = (0..self.laws.len()).map(|region| region.to_string()).map(region).collect();
        if matches!(partition.rule, Rule::Whole) {
            partition.regions.iter_mut().for_each(|region| region.name = "all".into());
        }
        partition
    }

    /// What every input would be with the integrals as they are, and with them grown by a sample.
    fn latents(&self, names: &Names) -> Vec<Latent> {
        let n = self.states.len();
        let row = |law: &super::RegionLaw, j: usize, grown: bool| -> Vec<f64> {
            let integral = law.integral.get(j).map_or(&[][..], Vec::as_slice);
            let mut row: Vec<f64> = law.gain[j].iter().map(|gain| -gain).collect();
            for (&state, gain) in self.integrated.iter().zip(integral).filter(|_| grown) {
                row[state] -= gain * self.period;
            }
            row.resize(n + self.integrated.len(), 0.0);
            row[n..].iter_mut().zip(integral).for_each(|(own, gain)| *own = -gain);
            row.extend(law.measured.get(j).into_iter().flatten().map(|gain| -gain));
            row
        };
        let latent = |name: &String, j: usize, grown: bool| Latent {
            name: name.clone(),
            library: 0,
            partition: 0,
            constants: self.laws.iter().map(|law| law.inputs[j]).collect(),
            coefficients: self.laws.iter().map(|law| row(law, j, grown)).collect(),
        };
        let now = names.now.iter().enumerate().map(|(j, name)| latent(name, j, false));
        now.chain(names.grown.iter().enumerate().map(|(j, name)| latent(name, j, true))).collect()
    }

    fn equations(&self, names: &Names) -> Vec<Equation> {
        let next = |subject: &String, right: Expr| Equation {
            subject: subject.clone(),
            prediction: Prediction::Next,
            right,
            target: None,
            unit: None,
        };
        let mut equations = Vec::new();
        let held = self.outwards(names);
        for (j, input) in self.inputs.iter().enumerate() {
            let now = Expr::column(names.now[j].as_str());
            let wanted = match (names.grown.get(j).map(|name| Expr::column(name.as_str())), &held) {
                (None, _) => now,
                (Some(grown), None) => grown,
                (Some(grown), Some(held)) => held.clone() * now + (Expr::number(1.0) - held.clone()) * grown,
            };
            // Numbers that are no limits do not become code.
            let wanted = if input.lowest > f64::MIN { wanted.max(input.lowest) } else { wanted };
            let wanted = if input.highest < f64::MAX { wanted.min(input.highest) } else { wanted };
            equations.push(next(&input.name, wanted));
        }
        let errors = self.functions(names);
        for (name, &state) in names.integrals.iter().zip(&self.integrated) {
            let growth = Expr::number(self.period) * errors[state].clone();
            let growth = match &held {
                None => growth,
                Some(held) => (Expr::number(1.0) - held.clone()) * growth,
            };
            equations.push(next(name, Expr::column(name.as_str()) + growth));
        }
        equations
    }

    /// 1 where longer integrals would push an input, which is at its limit, further outwards; else 0. `None` where there is nothing to hold.
    fn outwards(&self, names: &Names) -> Option<Expr> {
        let one = |(j, input): (usize, &super::DrivenInput)| {
            let now = || Expr::column(names.now[j].as_str());
            let grown = || Expr::column(names.grown[j].as_str());
            let above = (input.highest < f64::MAX).then(|| (grown() - input.highest).step() * (grown() - now()).step());
            let below = (input.lowest > f64::MIN)
                .then(|| (Expr::number(input.lowest) - grown()).step() * (now() - grown()).step());
            above.into_iter().chain(below)
        };
        if self.integrated.is_empty() {
            return None;
        }
        self.inputs.iter().enumerate().flat_map(one).reduce(|a, b| a.max(b))
    }
}

/// What everything is called.
struct Names {
    driven: Vec<String>,
    read: Vec<String>,
    integrals: Vec<String>,
    now: Vec<String>,
    /// None where nothing is integrated.
    grown: Vec<String>,
}

impl Names {
    fn new(law: &Regulator) -> Self {
        let (driven, read) = (law.drives(), law.reads());
        let mut taken: Vec<String> = driven.iter().chain(&read).cloned().collect();
        let mut fresh = |wanted: String| {
            let mut name = wanted;
            while taken.contains(&name) {
                name.push('_');
            }
            taken.push(name.clone());
            name
        };
        let integrals: Vec<String> =
            law.integrated.iter().map(|&state| fresh(format!("integral_{}", law.states[state].name))).collect();
        let now = driven.iter().map(|name| fresh(format!("law_{name}"))).collect();
        let grown = if integrals.is_empty() {
            Vec::new()
        } else {
            driven.iter().map(|name| fresh(format!("grown_{name}"))).collect()
        };
        Self { driven, read, integrals, now, grown }
    }
}
