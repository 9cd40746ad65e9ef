//! A latent of a recipe: its candidate functions, penalty, signs, bounds and prior.

use fleetfoot_data::setting::LATENTS;
use fleetfoot_library::{Expr, Library};
use fleetfoot_recipe::{Aliases, Error, LatentSection, Recipe};
use fleetfoot_sparse::Sign;

use super::right_side::without_latents;

/// A latent while the recipe is read.
pub(super) struct Latent {
    pub(super) name: String,
    pub(super) functions: Vec<Expr>,
    pub(super) penalty: f64,
    pub(super) sign: Sign,
    pub(super) bounds: [f64; 2],
    pub(super) prior: Option<Prior>,
}

/// Prior of a latent.
pub(super) struct Prior {
    pub(super) target: Expr,
    pub(super) strength: Option<f64>,
    pub(super) scale: Option<f64>,
}

const UNBOUNDED: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

impl Latent {
    /// Nothing but its functions.
    pub(super) fn plain(name: String, functions: Vec<Expr>) -> Self {
        Self { name, functions, penalty: 1.0, sign: Sign::Free, bounds: UNBOUNDED, prior: None }
    }

    /// Everything but the prior.
    pub(crate) fn resolve(
        name: &str,
        section: &LatentSection,
        latents: &[String],
        aliases: &mut Aliases<'_>,
    ) -> Result<Self, Error> {
        let place = LATENTS.entry(name).to_string();
        if name.trim().is_empty() {
            return Err(Error::missing(format!(
                "{LATENTS}: a latent has no name; give it one, so that equations can use it"
            )));
        }
        let functions = functions(section, latents, &place, aliases)?;
        let penalty = section.penalty.unwrap_or(1.0);
        if !(penalty >= 0.0 && penalty.is_finite()) {
            return Err(Error::value(format!(
                "{place} penalty = {penalty}: write a factor of lambda, 0 for no penalty"
            )));
        }
        let sign = match section.signs.as_deref() {
            None | Some("free") => Sign::Free,
            Some("+") => Sign::NonNegative,
            Some("-") => Sign::NonPositive,
            Some(other) => {
                return Err(Error::value(format!("{place} signs = \"{other}\": write \"+\", \"-\" or \"free\"")));
            }
        };
        let bounds = [section.at_least.unwrap_or(UNBOUNDED[0]), section.at_most.unwrap_or(UNBOUNDED[1])];
        if bounds.iter().any(|bound| bound.is_nan()) || bounds[0] > bounds[1] {
            return Err(Error::value(format!(
                "{place}: at_least = {} is not below at_most = {}",
                bounds[0], bounds[1]
            )));
        }
        Ok(Self { penalty, sign, bounds, ..Self::plain(name.to_owned(), functions) })
    }
}

/// The candidates: the monomials of `of`, then `functions`, all multiplied with `times`.
fn functions(
    section: &LatentSection,
    latents: &[String],
    place: &str,
    aliases: &mut Aliases<'_>,
) -> Result<Vec<Expr>, Error> {
    let mut parse = |text: &String, what: &str| {
        let place = format!("{place} {what}");
        let expression = aliases.over_latents(text, latents, &place)?;
        without_latents(&expression, latents, &place)?;
        Ok::<_, Error>(expression)
    };
    let variables: Vec<Expr> = section.of.iter().map(|text| parse(text, "of")).collect::<Result<_, _>>()?;
    let listed: Vec<Expr> = section.functions.iter().map(|text| parse(text, "functions")).collect::<Result<_, _>>()?;
    let times = section.times.as_ref().map(|text| parse(text, "times")).transpose()?;
    if variables.is_empty() && section.degree.is_some_and(|degree| degree > 0) {
        return Err(Error::missing(format!(
            "{place}: a degree needs the variables of the monomials; add `of = [...]`"
        )));
    }
    let mut all = Vec::new();
    if section.constant.unwrap_or(!variables.is_empty()) {
        all.push(Expr::number(1.0));
    }
    if !variables.is_empty() {
        all.extend_from_slice(Library::polynomial(&variables, section.degree.unwrap_or(1))?.functions());
    }
    all.extend(listed);
    if let Some(times) = times {
        if all.is_empty() {
            all.push(Expr::number(1.0));
        }
        all = all.iter().map(|function| (&times * function).simplified()).collect();
    }
    if all.is_empty() {
        return Err(Error::missing(format!(
            "{place}: it has no candidate functions; give variables (`of = [\"x\", \"y\"], degree = 2`) or `functions = [\"sin(x)\"]`"
        )));
    }
    if let Some((first, again)) = duplicate(&all) {
        return Err(Error::conflict(format!(
            "{place}: candidate {} is candidate {} once more, `{}`; remove one of them",
            again + 1,
            first + 1,
            all[again]
        )));
    }
    Ok(all)
}

/// Two equal functions.
fn duplicate(functions: &[Expr]) -> Option<(usize, usize)> {
    let mut seen = std::collections::HashMap::new();
    functions.iter().enumerate().find_map(|(index, function)| {
        let first = *seen.entry(function.to_string()).or_insert(index);
        (first != index).then_some((first, index))
    })
}

/// The prior of a latent, where the recipe has one.
pub(super) fn prior(
    recipe: &Recipe,
    section: &LatentSection,
    name: &str,
    latents: &[String],
    aliases: &mut Aliases<'_>,
) -> Result<Option<Prior>, Error> {
    let place = LATENTS.entry(name).to_string();
    let Some(text) = &section.prior else {
        if let Some(which) = [("prior_strength", section.prior_strength), ("prior_scale", section.prior_scale)]
            .iter()
            .find_map(|(which, value)| value.map(|_| which))
        {
            return Err(Error::missing(format!("{place} {which}: there is no prior; add `prior = \"...\"`")));
        }
        return Ok(None);
    };
    let target = aliases.over_latents(text, latents, &format!("{place} prior"))?;
    without_latents(&target, latents, &format!("{place} prior"))?;
    let strength = section.prior_strength.or(recipe.sparse.prior_strength);
    if let Some(value) = strength.filter(|value| !(*value >= 0.0 && value.is_finite())) {
        return Err(Error::value(format!(
            "{place} prior_strength = {value}: write a weight of zero or more (lambda_t)"
        )));
    }
    if let Some(value) = section.prior_scale.filter(|value| !(*value > 0.0 && value.is_finite())) {
        return Err(Error::value(format!(
            "{place} prior_scale = {value}: write a positive deviation in units of the prior"
        )));
    }
    Ok(Some(Prior { target, strength, scale: section.prior_scale }))
}
