//! A model's parts must fit together before anybody computes with it.

use crate::{Join, Latent, Model, Partition, Prediction, RegionSummary, Role, Rule, Summary};

impl Model {
    /// Checks that indices, lengths and names agree; the message has the contradiction.
    pub fn validate(&self) -> Result<(), String> {
        if !(self.step.is_finite() && self.step >= 0.0) {
            return Err(format!("step {} is not a positive number of seconds", self.step));
        }
        let fitted = self.fitted().count();
        if self.summaries.len() != self.partitions.len() {
            return Err(format!("{} of {} partitions described", self.summaries.len(), self.partitions.len()));
        }
        for (index, (partition, summary)) in self.partitions.iter().zip(&self.summaries).enumerate() {
            // A partition describes its regions over the library of its first latent.
            let owner = self.latents.iter().find(|latent| latent.partition == index);
            let functions = owner.map_or(0, |latent| self.libraries.get(latent.library).map_or(0, Vec::len));
            check_partition((partition, summary), functions, fitted)?;
        }
        let mut names = std::collections::HashSet::new();
        for latent in &self.latents {
            if self.column(&latent.name).is_some() || !names.insert(latent.name.as_str()) {
                return Err(format!("the latent `{}` has the name of a column or of another latent", latent.name));
            }
            let name = &latent.name;
            let library =
                self.libraries.get(latent.library).ok_or_else(|| format!("{name}: no library {}", latent.library))?;
            let partition = self
                .partitions
                .get(latent.partition)
                .ok_or_else(|| format!("{name}: no partition {}", latent.partition))?;
            let regions = partition.rule.count();
            latent.map.check(library.len(), regions).map_err(|problem| format!("{name}: {problem}"))?;
            self.check_beyond(latent, library.len()).map_err(|problem| format!("{name}: {problem}"))?;
        }
        for equation in &self.equations {
            let subject = &equation.subject;
            if self.column(subject).is_none() {
                return Err(format!("the equation of `{subject}` reads a column that the model does not have"));
            }
        }
        let parts: usize = self.rotations().iter().map(|rotation| rotation.columns.len()).sum();
        if let Some(column) = self.columns.iter().find(|column| column.rotation.is_some())
            && parts != self.columns.iter().filter(|column| column.rotation.is_some()).count()
        {
            return Err(format!("the rotation of `{}` lacks a part, or has one twice", column.name));
        }
        for rotation in self.rotations() {
            let advances = |&column: &usize| {
                let name = &self.columns[column].name;
                self.equations.iter().find(|equation| equation.subject == *name).map(|equation| equation.prediction)
            };
            let predictions: Vec<Option<Prediction>> = rotation.columns.iter().map(advances).collect();
            let alike = predictions.iter().all(|prediction| prediction.is_none())
                || predictions.iter().all(|prediction| *prediction == Some(Prediction::Derivative));
            if !alike {
                return Err(format!(
                    "the rotation `{}` has equations for some of its parts, or no derivatives",
                    rotation.name
                ));
            }
        }
        let states = self.columns.iter().filter(|column| column.role == Role::State).count();
        let triangle = |n: usize| n * (n + 1) / 2;
        let t = &self.training;
        for (what, length, expected) in [
            ("target means", t.target_mean.len(), fitted),
            ("target covariances", t.target_covariance.len(), triangle(fitted)),
            ("target deviations", t.target_deviation.len(), fitted),
            ("covariances of parameters", t.parameter_covariance.len(), triangle(t.parameters.len())),
            ("state covariances", t.state_covariance.len(), triangle(states)),
            ("state means", t.state_mean.len(), if t.state_mean.is_empty() { 0 } else { states }),
        ] {
            if length != expected {
                return Err(format!("{length} {what}, expected {expected}"));
            }
        }
        Ok(())
    }

    /// Slopes outside of training ranges need ranges, and hold for all latents of a partition or for none.
    fn check_beyond(&self, latent: &Latent, functions: usize) -> Result<(), String> {
        let owner = self.latents.iter().find(|other| other.partition == latent.partition);
        match latent.beyond.len() {
            length if owner.is_some_and(|owner| owner.beyond.len() != length) => {
                Err("the latents of one partition differ in their extrapolation".to_owned())
            }
            0 => Ok(()),
            length if length != functions => {
                Err(format!("{length} slopes outside of training for {functions} functions"))
            }
            _ if latent.affine().is_none() => Err("slopes outside of training for a map that is not affine".to_owned()),
            _ if self.summaries[latent.partition].regions.iter().any(|region| region.range.len() != functions) => {
                Err("slopes outside of training without the training ranges of the regions".to_owned())
            }
            _ => Ok(()),
        }
    }

    /// The first coefficient or constant that is NaN or infinite, in words; `None` for a model that can be used.
    pub fn not_finite(&self) -> Option<String> {
        for latent in &self.latents {
            let regions = self.summaries.get(latent.partition).map_or(&[][..], |summary| &summary.regions);
            for region in 0..latent.map.regions() {
                let terms = self.terms(latent, region);
                // The coefficients before the constant.
                let first = terms[1..].iter().chain(&terms[..1]).find(|(_, value)| !value.is_finite());
                let Some((function, value)) = first else { continue };
                let of = match function {
                    Some(function) => format!("the coefficient of `{function}`"),
                    None => "the constant".to_owned(),
                };
                let place = match regions {
                    [] | [_] => String::new(),
                    many => format!(", region {}", many.get(region).map_or("?", |region| region.name.as_str())),
                };
                return Some(format!("{of} in {}{place} is {value}", latent.name));
            }
        }
        None
    }
}

impl Rule {
    /// Returns true if its parts fit together, and to this many columns.
    pub fn fits(&self, columns: usize) -> bool {
        check_rule(self, columns).is_ok()
    }
}

fn check_partition(
    (partition, summary): (&Partition, &Summary),
    functions: usize,
    fitted: usize,
) -> Result<(), String> {
    let name = &partition.specification;
    let columns = partition.columns.len();
    if partition.centre.len() != columns || partition.scale.len() != columns {
        return Err(format!(
            "partition {name}: {columns} columns, {} centres, {} scales",
            partition.centre.len(),
            partition.scale.len()
        ));
    }
    if partition.scale.iter().any(|&scale| scale.is_nan() || scale <= 0.0) {
        return Err(format!("partition {name}: a scale is not positive"));
    }
    check_rule(&partition.rule, columns).map_err(|problem| format!("partition {name}: {problem}"))?;
    if summary.regions.len() != partition.rule.count() {
        return Err(format!(
            "partition {name}: {} of {} regions described",
            summary.regions.len(),
            partition.rule.count()
        ));
    }
    if let Some(transitions) = &partition.transitions {
        let count = partition.rule.count();
        if transitions.counts.len() != count || transitions.counts.iter().any(|row| row.len() != count) {
            return Err(format!("partition {name}: transitions are not {count} x {count}"));
        }
    }
    if let Some(phases) = &partition.phases {
        phases.check(partition.rule.count()).map_err(|problem| format!("partition {name}: {problem}"))?;
    }
    let pairs = partition.pairs.iter().map(|pair| pair.regions);
    if let Some([a, b]) = pairs.into_iter().find(|[a, b]| a >= b || *b as usize >= partition.rule.count()) {
        return Err(format!("partition {name}: {a} and {b} are no pair of {} regions", partition.rule.count()));
    }
    if let Some(lattice) = &partition.lattice {
        let count = partition.rule.count();
        let known = |join: &Join| [join.kept, join.gone].iter().all(|&region| (region as usize) < count);
        if lattice.joins.len() + 1 != count || !lattice.joins.iter().all(known) {
            return Err(format!("partition {name}: {} joins of {count} regions", lattice.joins.len()));
        }
    }
    if let Some(correlation) = &partition.correlation {
        correlation.check(fitted).map_err(|problem| format!("partition {name}: {problem}"))?;
    }
    for region in &summary.regions {
        check_region(region, functions, fitted)
            .map_err(|problem| format!("partition {name}, region {}: {problem}", region.name))?;
    }
    Ok(())
}

fn check_region(region: &RegionSummary, functions: usize, fitted: usize) -> Result<(), String> {
    let lengths = [region.mean.len(), region.range.len(), region.covariance.len(), region.residual_covariance.len()];
    let expected = [functions, functions, functions * (functions + 1) / 2, fitted * (fitted + 1) / 2];
    if lengths != expected {
        return Err(format!(
            "lengths {lengths:?} of mean, range, covariance, residual covariance; expected {expected:?}"
        ));
    }
    if region.confounded.iter().flatten().any(|&function| function >= functions) {
        return Err("a confounded function that does not exist".into());
    }
    Ok(())
}

fn check_rule(rule: &Rule, columns: usize) -> Result<(), String> {
    match rule {
        Rule::Whole => Ok(()),
        Rule::Ball { radius } if *radius > 0.0 => Ok(()),
        Rule::Ball { radius } => Err(format!("radius {radius} is not positive")),
        Rule::Box { half } if *half > 0.0 => Ok(()),
        Rule::Box { half } => Err(format!("half width {half} is not positive")),
        Rule::Linear { weights, offsets } => {
            if weights.is_empty() || weights.len() != offsets.len() || weights.iter().any(|row| row.len() != columns) {
                return Err(format!("{} x {columns} weights and {} offsets do not fit", weights.len(), offsets.len()));
            }
            Ok(())
        }
        Rule::Joined { cells, regions } => {
            if !matches!(**cells, Rule::Linear { .. }) || regions.is_empty() || regions.len() != cells.count() {
                return Err(format!("{} of {} cells have a region", regions.len(), cells.count()));
            }
            check_rule(cells, columns)
        }
        Rule::Tree(tree) => tree.check(columns),
        Rule::Labels { values, names, rules, .. } => {
            if columns == 0 || values.is_empty() || values.len() != names.len() || values.len() != rules.len() {
                return Err(format!("{} labels, {} names, {} rules", values.len(), names.len(), rules.len()));
            }
            rules.iter().try_for_each(|rule| match rule {
                Rule::Labels { .. } => Err("labels within labels".into()),
                _ => check_rule(rule, columns - 1),
            })
        }
    }
}
