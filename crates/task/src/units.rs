//! Units, if the log or the recipe gives them: notes on contradictions, and units of coefficients.

use fleetfoot_library::{Expr, Unit, coefficient_unit};

use crate::equations::EquationTask;

impl EquationTask {
    fn unit_of(&self, name: &str) -> Option<Unit> {
        let column = self.columns.iter().find(|column| column.name == name).and_then(|column| column.unit.as_deref());
        let parameter = || self.parameters.iter().find(|known| known.name == name)?.unit.as_deref();
        Unit::parse(column.or_else(parameter)?).ok()
    }

    fn target_unit(&self, target: usize) -> Option<Unit> {
        Unit::parse(self.fitted[target].unit.as_deref()?).ok()
    }

    /// Notes on units that do not fit: inside a candidate function, inside a nominal part, and between it and its
    /// neighbours.
    pub fn unit_notes(&self) -> Vec<String> {
        let unit = |expression: &Expr| expression.unit(|name| self.unit_of(name));
        let mut notes = Vec::new();
        for function in &self.functions {
            if let Err(problem) = unit(function) {
                notes.push(format!("units of the candidate {function}: {problem}"));
            }
        }
        for (target, equation) in self.fitted.iter().enumerate() {
            let Some(nominal) = &equation.nominal else { continue };
            match (unit(nominal), self.target_unit(target)) {
                (Err(problem), _) => notes.push(format!("units of the nominal part of {}: {problem}", equation.label)),
                (Ok(Some(unit)), Some(wanted)) if unit != wanted => {
                    notes.push(format!("{} has the unit {wanted}, its nominal part {unit}", equation.label));
                }
                _ => {}
            }
        }
        notes
    }

    /// The unit of a candidate's coefficient in an equation, where it is known.
    pub fn coefficient_unit(&self, target: usize, candidate: usize) -> Option<String> {
        let left = self.target_unit(target)?;
        let unit = match candidate.checked_sub(usize::from(self.constant)) {
            None => left,
            // A radial function has no unit.
            Some(function) if self.radial_function(function).is_some() => left,
            Some(function) => {
                coefficient_unit(Some(&left), &self.functions[function], |name| self.unit_of(name)).ok()??
            }
        };
        Some(unit.to_string())
    }
}
