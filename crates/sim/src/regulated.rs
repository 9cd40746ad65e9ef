//! A regulator on a robot: its columns are matched with the robot's readings.

use fleetfoot_control::controller::{Controller, ControllerState, Regulator};

use crate::ParameterError;

/// A regulator at work.
pub(crate) struct Regulated {
    state: Box<dyn ControllerState>,
    /// For everything that it reads, the place among what is shown.
    reads: Vec<usize>,
    /// For every input that it drives, the place among the commands.
    drives: Vec<usize>,
    columns: Vec<f64>,
    inputs: Vec<f64>,
}

/// Checks that a regulator can drive a robot with the readings `shown` and the inputs `commands`.
///
/// # Errors
/// A reading or a command that the robot does not have, and laws that cannot be used.
pub(crate) fn check(regulator: &Regulator, shown: &[&str], commands: &[&str]) -> Result<(), ParameterError> {
    regulator.validate()?;
    let known = |names: &[&str], name: &String| names.contains(&name.as_str());
    let refuse = |what: &str, name: &str, names: &[&str]| {
        Err(ParameterError::new(what, name, format!("one of {}, which this robot has", names.join(", "))))
    };
    if let Some(name) = regulator.reads().iter().find(|name| !known(shown, name)) {
        return refuse("reads", name, shown);
    }
    match regulator.drives().iter().find(|name| !known(commands, name)) {
        Some(name) => refuse("drives", name, commands),
        None => Ok(()),
    }
}

impl Regulated {
    /// A regulator that has passed [`check`].
    pub(crate) fn new(regulator: &Regulator, shown: &[&str], commands: &[&str]) -> Self {
        let place = |names: &[&str], name: String| names.iter().position(|known| *known == name).unwrap_or(0);
        let reads: Vec<usize> = regulator.reads().into_iter().map(|name| place(shown, name)).collect();
        let drives: Vec<usize> = regulator.drives().into_iter().map(|name| place(commands, name)).collect();
        let (columns, inputs) = (vec![0.0; reads.len()], vec![0.0; drives.len()]);
        Self { state: regulator.start(), reads, drives, columns, inputs }
    }

    /// Replaces those commands that it drives, `seconds` after it began.
    pub(crate) fn command(&mut self, seconds: f64, shown: &[f64], commands: &mut [f64]) {
        for (column, &place) in self.columns.iter_mut().zip(&self.reads) {
            *column = shown[place];
        }
        self.state.control(seconds, &self.columns, &mut self.inputs);
        for (&input, &place) in self.inputs.iter().zip(&self.drives) {
            commands[place] = input;
        }
    }
}
