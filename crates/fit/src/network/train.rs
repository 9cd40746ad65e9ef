//! One network on some rows: hidden layers trained, the output layer solved; and the linear map on the same rows.

use fleetfoot_data::{Progress, Silent, mix};
use fleetfoot_learn::{Activation, Error, Output, Shape, Statistic, Table, Training, Units, Window, statistic, train};

/// Parts that rows are cut into to say when to stop, and how many of them train between two that do not.
const PARTS: usize = 40;
const EVERY: usize = 5;

/// A network, or a linear map, fitted to some rows.
#[derive(Clone)]
pub(super) struct Fitted {
    /// `None` for the linear map.
    pub(super) hidden: Option<(Shape, Vec<f64>)>,
    pub(super) units: Units,
    pub(super) output: Output,
    /// Ridge of the features' weights in it.
    pub(super) ridge: f64,
    /// The sums that the output layer was solved from.
    pub(super) sums: Statistic,
}

/// Units of some rows; those of a column are the same in all steps of a window.
pub(super) fn units(table: &Table, rows: &[usize], window: Option<&Window>) -> Result<Units, Error> {
    let mut units = Units::measured(table, rows)?;
    window.into_iter().for_each(|window| window.share(&mut units));
    Ok(units)
}

/// Units of some rows: those of the targets are deviations from the linear map, so that each counts alike; and the sums of that map.
fn linear_sums(table: &Table, rows: &[usize], window: Option<&Window>) -> Result<(Units, Statistic), Error> {
    let mut units = units(table, rows, window)?;
    let shape = Shape { inputs: table.inputs(), hidden: vec![1], activation: Activation::Tanh, window: None };
    let sums = |units: &Units| -> Result<Statistic, Error> {
        Ok(statistic(&shape, &shape.initial(0), &table.samples(rows, units), &Silent)?.linear())
    };
    let first = sums(&units)?;
    let errors = first.errors(&first.solve(0.0)?);
    for (scale, error) in units.scale[table.inputs()..].iter_mut().zip(errors) {
        // Rounding errors of targets that the linear map explains are not amplified.
        *scale *= error.sqrt().max(1e-6);
    }
    let sums = sums(&units)?;
    Ok((units, sums))
}

/// The linear map.
pub(super) fn linear(table: &Table, rows: &[usize]) -> Result<Fitted, Error> {
    let (units, sums) = linear_sums(table, rows, None)?;
    Ok(Fitted { hidden: None, units, output: sums.solve(0.0)?, ridge: 0.0, sums })
}

/// A network of this shape. A part of the rows says when to stop; the output layer is solved from all.
pub(super) fn network(
    shape: &Shape,
    table: &Table,
    rows: &[usize],
    training: &Training,
    progress: &dyn Progress,
) -> Result<Fitted, Error> {
    let (units, _) = linear_sums(table, rows, shape.window.as_ref())?;
    let stops = |at: usize| (at * PARTS / rows.len()) % EVERY == EVERY - 1;
    let part = |wanted: bool| {
        let mut part_rows: Vec<usize> =
            rows.iter().enumerate().filter(|(at, _)| stops(*at) == wanted).map(|(_, &row)| row).collect();
        // Mini-batches of neighbours in time would be all alike.
        let key = mix(training.seed);
        part_rows.sort_by_key(|&row| (mix(key.wrapping_add(row as u64)), row));
        part_rows
    };
    let [fitted, held] = [false, true].map(|wanted| table.samples(&part(wanted), &units));
    let trained = train(shape, &fitted, &held, training, progress)?;
    solved(shape, trained.parameters, trained.ridge, (table, rows, units), progress)
}

/// The same hidden layers with the output layer of these rows.
pub(super) fn solved(
    shape: &Shape,
    parameters: Vec<f64>,
    ridge: f64,
    (table, rows, units): (&Table, &[usize], Units),
    progress: &dyn Progress,
) -> Result<Fitted, Error> {
    let sums = statistic(shape, &parameters, &table.samples(rows, &units), progress)?;
    let output = sums.solve(ridge)?;
    Ok(Fitted { hidden: Some((shape.clone(), parameters)), units, output, ridge, sums })
}

impl Fitted {
    /// Mean squared error of each target on other rows, in the units of the target.
    pub(super) fn errors(&self, table: &Table, rows: &[usize]) -> Result<Vec<f64>, Error> {
        let samples = table.samples(rows, &self.units);
        let sums = match &self.hidden {
            Some((shape, parameters)) => statistic(shape, parameters, &samples, &Silent)?,
            None => {
                let shape =
                    Shape { inputs: table.inputs(), hidden: vec![1], activation: Activation::Tanh, window: None };
                statistic(&shape, &shape.initial(0), &samples, &Silent)?.linear()
            }
        };
        let scales = &self.units.scale[table.inputs()..];
        Ok(sums.errors(&self.output).iter().zip(scales).map(|(error, scale)| error * scale * scale).collect())
    }
}
