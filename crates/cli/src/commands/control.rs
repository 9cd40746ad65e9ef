//! `fleetfoot control`.

use fleetfoot::{ControllerFile, Error, Recipe, Settings, control_lqr};

use super::{Context, read_model};
use crate::{
    args::ControlLqr,
    table::{number, table},
};

/// What is told as 0.
const ROUNDING: f64 = 1e-12;

pub(crate) fn lqr(arguments: &ControlLqr, context: &Context) -> Result<(), Error> {
    let model = read_model(&arguments.model)?;
    let inputs: Vec<_> = arguments.recipe.iter().chain([&arguments.model]).cloned().collect();
    context.claim(std::slice::from_ref(&arguments.output), &inputs, false)?;
    let below = arguments.recipe.as_ref().map(|path| Recipe::read(path)).transpose()?.unwrap_or_default();
    let made = control_lqr(&model, &arguments.control.clone().over(below.control))?;
    made.write(&arguments.output)?;
    context.notes(&made.notes);
    context.print(&made.told(), || to_text(&made));
    context.say(format!("wrote {}", arguments.output.display()));
    Ok(())
}

/// Gains of an input, those that are rounding beside the others as 0: what a state does, at its size.
fn told_gains(made: &ControllerFile, gains: &[f64]) -> Vec<String> {
    let sizes = made.law.states.iter().map(|state| state.size);
    let effects: Vec<f64> = gains.iter().zip(sizes).map(|(gain, size)| (gain * size).abs()).collect();
    let largest = effects.iter().copied().fold(0.0, f64::max);
    gains.iter().zip(effects).map(|(&gain, own)| number(if own < ROUNDING * largest { 0.0 } else { gain })).collect()
}

fn to_text(made: &ControllerFile) -> String {
    let point = &made.setpoint;
    let rest = |value: f64| if value.abs() < ROUNDING { 0.0 } else { value };
    let named = |(name, value): (&String, &f64)| format!("{name} = {}", number(rest(*value)));
    let states: Vec<String> = point.states.iter().map(named).collect();
    let inputs: Vec<String> = point.inputs.iter().map(named).collect();
    let place = match (&point.region, point.at_rest) {
        (Some(region), _) => format!("region {region} rests there"),
        (None, true) => "the model rests there".to_owned(),
        (None, false) => "the model does not rest there".to_owned(),
    };
    let mut text = format!("set point: {}; {}; {place}\n", states.join(", "), inputs.join(", "));
    let mut header = vec!["region".to_owned(), "rows".into(), "radius".into(), "residual".into()];
    for input in &made.law.inputs {
        header.extend(made.law.states.iter().map(|state| format!("{}/{}", input.name, state.name)));
    }
    let rows = made.regions.iter().zip(&made.law.laws).map(|(own, law)| {
        let told = |value: Option<f64>| value.map_or_else(|| "borrowed".to_owned(), number);
        let mut row = vec![own.region.clone(), own.rows.to_string(), told(own.radius), told(own.residual)];
        row.extend(law.gain.iter().flat_map(|gains| told_gains(made, gains)));
        row
    });
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    text += &table(&header, rows.collect());
    text += "\nradius: what the closed loop keeps of an error from sample to sample; residual: of the Riccati equation, relative to its solution";
    for own in made.regions.iter().filter(|own| !own.unreached.is_empty()) {
        text +=
            &format!("\nregion {} is not stabilisable: no input reaches {}", own.region, own.unreached.join(" and "));
    }
    text
}
