//! States that may be angles: they are called so, and go on beyond one turn.

use std::f64::consts::TAU;

use fleetfoot_data::{Halo, Source};
use fleetfoot_dataset::Error;
use fleetfoot_recipe::{Kind, Recipe, is_named_angle};

use crate::candidates::Variant;

/// Turns at most: more of them are those of a wheel, on whose angle nothing depends, or of degrees.
const TURNS: f64 = 20.0;

/// The recipe with such states as angles in radians. `None` if there is none. A name does not say radians or degrees:
/// simulations of held-out rows decide.
///
/// # Errors
/// Those of reading.
pub(crate) fn turning(recipe: &Recipe, rows: &dyn Source) -> Result<Option<Variant>, Error> {
    let mut turned = recipe.clone();
    let mut names = Vec::new();
    for (name, state) in turned.states.iter_mut().filter(|(_, state)| state.kind.is_none()) {
        let Some(column) = rows.columns().iter().position(|column| column.name == *name) else { continue };
        let bare = name.trim_end_matches(|letter: char| letter.is_ascii_digit() || letter == '_');
        if is_named_angle(bare) && (TAU..TURNS * TAU).contains(&range(rows, column)?) {
            state.kind = Some(Kind::Angle);
            names.push(name.clone());
        }
    }
    let name = format!("{} as angles", names.join(", "));
    Ok((!names.is_empty()).then_some(Variant { name, recipe: turned }))
}

/// The largest value of a column less the smallest one.
fn range(rows: &dyn Source, column: usize) -> Result<f64, Error> {
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for (at, episode) in rows.episodes().iter().enumerate() {
        let block = rows.read(at, 0..episode.rows, Halo::default())?;
        for &value in block.core(column).iter().filter(|value| value.is_finite()) {
            (least, most) = (least.min(value), most.max(value));
        }
    }
    Ok(most - least)
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource};

    use super::*;

    #[test]
    fn wide_angle_is_tried_as_angle() {
        let mut source = MemorySource::new(["theta", "theta_2", "x"].map(Column::float).to_vec());
        let ramp = |most: f64| (0..100).map(|row| most * f64::from(row) / 99.0).collect::<Vec<f64>>();
        source.push_uniform("a", 0.01, vec![ramp(9.0), ramp(1.0), ramp(9.0)]);
        let recipe = Recipe::parse("[states]\ntheta = {}\ntheta_2 = {}\nx = {}\n", "test").unwrap();
        let Variant { name, recipe } = turning(&recipe, &source).unwrap().unwrap();
        let kinds: Vec<bool> = recipe.states.values().map(|state| state.kind == Some(Kind::Angle)).collect();
        assert_eq!((name.as_str(), kinds), ("theta as angles", vec![true, false, false]));
        assert!(turning(&recipe, &source).unwrap().is_none(), "it is an angle already");
    }
}
