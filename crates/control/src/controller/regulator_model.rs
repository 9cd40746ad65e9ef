//! A regulator as a model, so that it becomes code by the same way.

use fleetfoot_data::packed;
use fleetfoot_library::{Expr, Quaternion, Scope};
use fleetfoot_model::{
    AffineMap, Column, Equation, Latent, Model, Partition, Prediction, RegionSummary, Role, RotationKind, Rule,
    Training,
};

use super::{Controller, ParameterError, RegulatedRotation, Regulator};

impl Regulator {
    /// The law as a model of its memory. States are the inputs that it drives, then the integrals; inputs are the
    /// columns that it reads; a step is a sample. After a step the first states are the commands.
    ///
    /// Without a region, or with a missing value, the law leaves its memory as it is. Exported code does the same: it
    /// gives a code, and its variable stays.
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
        let (partition, regions) = self.regions();
        model.add_partition(partition, regions);
        model.equations = self.equations(&names);
        let read = |latent: &Latent| {
            model.equations.iter().any(|equation| equation.right.columns().iter().any(|name| **name == *latent.name))
        };
        let latents = self.latents(&names);
        model.latents = latents.into_iter().filter(read).collect();
        Ok(model)
    }

    /// The measurements of the law as a model of outputs: the errors, the deviations of the further measurements from the
    /// set point, and the partition columns. Its inputs are the columns that the law reads, then the inputs that it
    /// drives; its partition is that of the law.
    ///
    /// # Errors
    /// Those of [`Controller::validate`].
    pub fn measurements(&self) -> Result<Model, ParameterError> {
        self.validate()?;
        let names = Names::new(self);
        let (partition, mut regions) = self.regions();
        // Statistics of a library: there is none.
        for region in &mut regions {
            region.mean.clear();
            region.covariance.clear();
            region.range.clear();
            region.rank = 0;
        }
        let functions = self.functions(&Names { integrals: Vec::new(), ..Names::new(self) });
        let functions: Vec<Expr> = functions.into_iter().chain(partition.columns.iter().cloned()).collect();
        let read = names.read.iter().chain(&names.driven);
        let mut columns: Vec<Column> = read.map(|name| Column::new(name.clone(), Role::Input)).collect();
        let subject = |at: usize| format!("measurement {at}");
        columns.extend((0..functions.len()).map(|at| Column::new(subject(at), Role::Auxiliary)));
        let mut model = Model::new("regulator", columns, self.period, Training::default());
        model.add_partition(partition, regions);
        model.equations = (functions.into_iter().enumerate())
            .map(|(at, right)| Equation {
                subject: subject(at),
                prediction: Prediction::Value,
                right,
                target: None,
                unit: None,
            })
            .collect();
        Ok(model)
    }

    /// Errors of states, integrals, and deviations of the further measurements from the set point.
    fn functions(&self, names: &Names) -> Vec<Expr> {
        let from = |name: &String, at: f64| {
            if at == 0.0 { Expr::column(name.as_str()) } else { Expr::column(name.as_str()) - at }
        };
        let error = |state: &super::RegulatedState| {
            let error = from(&state.name, state.at);
            if state.angle { error.wrap() } else { error }
        };
        (self.states.iter().map(error))
            .chain(self.rotations.iter().flat_map(rotation_error))
            .chain(names.integrals.iter().map(|name| Expr::column(name.as_str())))
            .chain(self.measured.iter().map(|column| from(&column.name, column.at)))
            .collect()
    }

    /// The partition, with the sizes of states as the statistics of its regions.
    fn regions(&self) -> (Partition, Vec<RegionSummary>) {
        let state_sizes = self.sizes();
        let (n, q) = (state_sizes.len(), self.integrated.len());
        let sizes: Vec<f64> = (state_sizes.iter().copied())
            .chain(self.integrated.iter().map(|&error| state_sizes[error]))
            .chain(self.measured.iter().map(|column| column.size))
            .collect();
        let functions = n + q + self.measured.len();
        let region = |name: String| RegionSummary {
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
        let partition = match &self.partition {
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
        let name = |at: usize| if partition.rule == Rule::Whole { "all".to_owned() } else { at.to_string() };
        let regions = (0..self.laws.len()).map(|at| region(name(at))).collect();
        (partition, regions)
    }

    /// Value of every input with the present integrals, and with the integrals grown by a sample.
    fn latents(&self, names: &Names) -> Vec<Latent> {
        let n = self.sizes().len();
        let row = |law: &super::RegionLaw, j: usize, grown: bool| -> Vec<f64> {
            let integral = law.integral.get(j).map_or(&[][..], Vec::as_slice);
            let mut row: Vec<f64> = law.gain[j].iter().map(|gain| -gain).collect();
            for (&state, gain) in self.integrated.iter().zip(integral).filter(|_| grown) {
                row[state] -= gain * self.period;
            }
            row.resize(n + self.integrated.len(), 0.0);
            row[n..].iter_mut().zip(integral).for_each(|(entry, gain)| *entry = -gain);
            row.extend(law.measured.get(j).into_iter().flatten().map(|gain| -gain));
            row
        };
        let latent = |name: &String, j: usize, grown: bool| Latent {
            beyond: Vec::new(),
            name: name.clone(),
            library: 0,
            partition: 0,
            map: AffineMap {
                constants: self.laws.iter().map(|law| law.inputs[j]).collect(),
                coefficients: self.laws.iter().map(|law| row(law, j, grown)).collect(),
            }
            .into(),
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

    /// 1 if longer integrals would push an input, which is at its limit, further outwards; else 0. `None` without
    /// integrals or limits.
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

/// The vector that turns the set point of a rotation into its columns' rotation: twice the half angle along the vector
/// part of `q*^-1 q`, the shorter way round.
///
/// Without an error there is no direction; the least positive length in its place gives zero.
fn rotation_error(rotation: &RegulatedRotation) -> [Expr; 3] {
    let column = |part: usize| Expr::column(rotation.columns[part].as_str());
    let q = match rotation.kind {
        RotationKind::Quaternion => Quaternion::new(column(1), column(2), column(3), column(0)),
        RotationKind::Vector => Quaternion::of_vector(&[column(0), column(1), column(2)]),
    };
    let [w, x, y, z] = rotation.kind.quaternion(&rotation.at);
    let ([a, b, c], d) = (q.vector.each_ref(), &q.w);
    let sum = |terms: [(f64, &Expr); 4]| {
        let factors = terms.into_iter().filter(|(factor, _)| *factor != 0.0).map(|(factor, part)| factor * part);
        factors.reduce(|a, b| a + b).unwrap_or_else(|| Expr::number(0.0))
    };
    let scalar = sum([(w, d), (x, a), (y, b), (z, c)]);
    let vector = [
        sum([(w, a), (-x, d), (-y, c), (z, b)]),
        sum([(w, b), (-y, d), (-z, a), (x, c)]),
        sum([(w, c), (-z, d), (-x, b), (y, a)]),
    ];
    let length = (vector[0].powi(2) + vector[1].powi(2) + vector[2].powi(2)).sqrt();
    // 1 or -1: where the scalar part is zero both ways are as long.
    let sign = 2.0 * scalar.step() - 1.0;
    let angle = 2.0 * length.atan2(scalar.abs());
    let scale = sign * angle / length.max(f64::MIN_POSITIVE);
    vector.map(|part| part * &scale)
}

/// Names of all columns of the model.
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
        let (driven, read, errors) = (law.drives(), law.reads(), law.errors());
        let mut taken: Vec<String> = driven.iter().chain(&read).cloned().collect();
        let mut fresh = |wanted: String| {
            let mut name = wanted;
            while taken.contains(&name) {
                name.push('_');
            }
            taken.push(name.clone());
            name
        };
        let integrals: Vec<String> = law
            .integrated
            .iter()
            .map(|&error| fresh(format!("integral_{}", errors[error].replace(' ', "_"))))
            .collect();
        let now = driven.iter().map(|name| fresh(format!("law_{name}"))).collect();
        let grown = if integrals.is_empty() {
            Vec::new()
        } else {
            driven.iter().map(|name| fresh(format!("grown_{name}"))).collect()
        };
        Self { driven, read, integrals, now, grown }
    }
}
