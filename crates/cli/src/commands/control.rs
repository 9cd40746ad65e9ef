//! `fleetfoot control`.

use std::cmp::Reverse;

use fleetfoot::{
    ControlSection, ControllerFile, Error, LqrRecord, Model, Recipe, Settings,
    control::controller::{DrivenInput, RegionLaw},
    control_lqr, control_mpc,
};

use super::{Context, read_model};
use crate::{
    args::ControlDesign,
    table::{number, seconds, table},
};

/// Relative magnitude below which a coefficient is printed as 0.
const ROUNDING: f64 = 1e-12;

pub(crate) fn lqr(arguments: &ControlDesign, context: &Context) -> Result<(), Error> {
    if arguments.control.horizon.is_some() || arguments.control.bounds.is_some() {
        return Err(Error::conflict(
            "a regulator has no horizon and no bounds: use `control mpc`, or leave --horizon and --bounds out"
                .to_owned(),
        ));
    }
    design(arguments, context, control_lqr)
}

pub(crate) fn mpc(arguments: &ControlDesign, context: &Context) -> Result<(), Error> {
    design(arguments, context, control_mpc)
}

/// A design of a controller from a model and settings.
type Designed = fn(&Model, &ControlSection) -> Result<ControllerFile, Error>;

fn design(arguments: &ControlDesign, context: &Context, designed: Designed) -> Result<(), Error> {
    let model = read_model(&arguments.model)?;
    let inputs: Vec<_> = arguments.recipe.iter().chain([&arguments.model]).cloned().collect();
    context.claim(std::slice::from_ref(&arguments.output), &inputs, false)?;
    let below = arguments.recipe.as_ref().map(|path| Recipe::read(path)).transpose()?.unwrap_or_default();
    let made = designed(&model, &arguments.control.clone().over(below.control))?;
    made.write(&arguments.output)?;
    context.notes(&made.notes);
    context.print(made.to_value(), || to_text(&made));
    context.say(format!("wrote {}", arguments.output.display()));
    Ok(())
}

/// Gains of an input, those that are rounding beside the others as 0: what a state does, at its size.
fn gains_text(made: &ControllerFile, gains: &[f64]) -> Vec<String> {
    let sizes = made.law.sizes();
    let effects: Vec<f64> = gains.iter().zip(sizes).map(|(gain, size)| (gain * size).abs()).collect();
    let largest = effects.iter().copied().fold(0.0, f64::max);
    gains
        .iter()
        .zip(effects)
        .map(|(&gain, effect)| number(if effect < ROUNDING * largest { 0.0 } else { gain }))
        .collect()
}

/// The set point, the law of every region, and what is known of it.
fn to_text(made: &ControllerFile) -> String {
    let lines = [Some(set_point(made)), plan(made), Some(laws(made, usize::MAX)), Some(certificates(made))];
    lines.into_iter().flatten().collect::<Vec<_>>().join("\n")
}

fn word(made: &ControllerFile) -> &'static str {
    if made.law.prediction.is_some() { "predictive controller" } else { "linear-quadratic regulator" }
}

/// The horizon and the bounds of a predictive controller, whose regulator's gains stand below.
fn plan(made: &ControllerFile) -> Option<String> {
    let prediction = made.law.prediction.as_ref()?;
    let errors = made.law.errors();
    let seconds_ahead = seconds(prediction.horizon as f64 * made.law.period);
    let mut text = format!("plan: {} samples ({seconds_ahead})", prediction.horizon);
    for bound in &prediction.bounds {
        let at = made.law.states.get(bound.error).map_or(0.0, |state| state.at);
        let end = |value: f64, open: bool| if open { "none".to_owned() } else { number(value + at) };
        text += &format!(
            "; {} from {} to {}",
            errors[bound.error],
            end(bound.lowest, bound.lowest <= f64::MIN),
            end(bound.highest, bound.highest >= f64::MAX)
        );
    }
    Some(text + "; while no limit and no bound is active, its command is that of the regulator:")
}

/// A controller for people: the same, with what it commands, and all gains of `most` regions, the largest first.
pub(super) fn describe(made: &ControllerFile, most: usize) -> String {
    let law = &made.law;
    // An input without limits has those of numbers.
    let is_free = |input: &DrivenInput| input.lowest <= f64::MIN && input.highest >= f64::MAX;
    let command = |input: &DrivenInput| match is_free(input) {
        true => input.name.clone(),
        false => format!("{} from {} to {}", input.name, number(input.lowest), number(input.highest)),
    };
    let commands: Vec<String> = law.inputs.iter().map(command).collect();
    let mut lines = vec![
        format!("{} of the model {} ({})", word(made), made.model, made.method),
        format!("commands every {}: {}", seconds(law.period), commands.join(", ")),
        set_point(made),
    ];
    lines.extend(plan(made));
    lines.push(laws(made, most));
    let errors = law.errors();
    let integrals: Vec<String> = law.integrated.iter().map(|&error| format!("integral of {}", errors[error])).collect();
    if !integrals.is_empty() {
        lines.push(further_gains(made, most, &integrals, |law| &law.integral));
    }
    let measured: Vec<String> = law.measured.iter().map(|column| column.name.clone()).collect();
    if !measured.is_empty() {
        lines.push(further_gains(made, most, &measured, |law| &law.measured));
    }
    let left_out = made.regions.len().saturating_sub(most);
    if left_out > 0 {
        lines.push(format!("and {left_out} smaller regions: --regions {}", made.regions.len()));
    }
    lines.push(certificates(made));
    lines.join("\n")
}

fn set_point(made: &ControllerFile) -> String {
    let point = &made.setpoint;
    let rest = |value: f64| if value.abs() < ROUNDING { 0.0 } else { value };
    let named = |(name, value): (&String, &f64)| format!("{name} = {}", number(rest(*value)));
    let states: Vec<String> = point.states.iter().map(named).collect();
    let inputs: Vec<String> = point.inputs.iter().map(named).collect();
    let place = match (&point.region, point.at_rest) {
        (Some(region), _) => format!("an equilibrium of region {region}"),
        (None, true) => "an equilibrium of the model".to_owned(),
        (None, false) => "no equilibrium of the model".to_owned(),
    };
    format!("set point: {}; {}; {place}", states.join(", "), inputs.join(", "))
}

/// Regions and their laws in their order, at most so many, those with the most rows.
fn largest(made: &ControllerFile, most: usize) -> Vec<(&LqrRecord, &RegionLaw)> {
    let mut order: Vec<usize> = (0..made.regions.len().min(made.law.laws.len())).collect();
    order.sort_by_key(|&region| Reverse(made.regions[region].rows));
    order.truncate(most);
    order.sort_unstable();
    order.into_iter().map(|region| (&made.regions[region], &made.law.laws[region])).collect()
}

/// The gains of the states, region by region.
fn laws(made: &ControllerFile, most: usize) -> String {
    let mut header = vec!["region".to_owned(), "rows".into(), "radius".into(), "residual".into()];
    let errors = made.law.errors();
    header.extend(
        made.law.inputs.iter().flat_map(|input| errors.iter().map(move |error| format!("{}/{error}", input.name))),
    );
    let rows = largest(made, most).into_iter().map(|(record, law)| {
        let cell = |value: Option<f64>| value.map_or_else(|| "borrowed".to_owned(), number);
        let mut row = vec![record.region.clone(), record.rows.to_string(), cell(record.radius), cell(record.residual)];
        row.extend(law.gain.iter().flat_map(|gains| gains_text(made, gains)));
        row
    });
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    table(&header, rows.collect())
}

/// The gains of what is fed back beside the states.
fn further_gains(
    made: &ControllerFile,
    most: usize,
    names: &[String],
    of: impl Fn(&RegionLaw) -> &Vec<Vec<f64>>,
) -> String {
    let mut header = vec!["region".to_owned()];
    header.extend(
        made.law.inputs.iter().flat_map(|input| names.iter().map(move |name| format!("{}/{name}", input.name))),
    );
    let rows = largest(made, most).into_iter().map(|(record, law)| {
        let gains = of(law).iter().flatten().map(|&gain| number(gain));
        std::iter::once(record.region.clone()).chain(gains).collect::<Vec<String>>()
    });
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    table(&header, rows.collect())
}

fn certificates(made: &ControllerFile) -> String {
    let mut text = "radius: factor on an error from sample to sample in the closed loop; residual: of the Riccati equation, relative to its solution".to_owned();
    for record in made.regions.iter().filter(|record| !record.unreached.is_empty()) {
        text += &format!(
            "\nregion {} is not stabilisable: no input reaches {}",
            record.region,
            record.unreached.join(" and ")
        );
    }
    text
}
