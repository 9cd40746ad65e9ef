//! Bounds of single coefficients: `[constraints] damping = { coefficients = { v = ["v"] }, at_most = 0.0 }`.

use fleetfoot_data::setting::CONSTRAINTS;
use fleetfoot_data::{did_you_mean, nearest};
use fleetfoot_library::{Expr, Library, Scope, Vocabulary};
use fleetfoot_recipe::{Aliases, ConstraintSection, Error};
use fleetfoot_sparse::constrained::Limit;

/// A bound of one coefficient.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct CoefficientLimit {
    /// The constraint.
    pub name: String,
    /// Owner of the coefficient: the number of the latent, or of the fitted equation.
    pub owner: usize,
    /// The number of the candidate among those of its owner.
    pub candidate: usize,
    /// The coefficient, for people: `v of f_v`.
    pub of: String,
    /// The side.
    pub side: Limit,
    /// The bound.
    pub bound: f64,
}

impl CoefficientLimit {
    /// Distance of a value from the bound, negative where it is broken.
    pub fn clearance(&self, value: f64) -> f64 {
        match self.side {
            Limit::AtLeast => value - self.bound,
            Limit::AtMost => self.bound - value,
        }
    }
}

/// Least and greatest values (one a coefficient) by limits; `place` is that of a limit's coefficient.
pub fn bounds<'a>(
    count: usize,
    limits: impl Iterator<Item = &'a CoefficientLimit>,
    place: impl Fn(&CoefficientLimit) -> usize,
) -> Vec<[f64; 2]> {
    let mut bounds = vec![[f64::NEG_INFINITY, f64::INFINITY]; count];
    for limit in limits {
        let [low, high] = &mut bounds[place(limit)];
        match limit.side {
            Limit::AtLeast => *low = low.max(limit.bound),
            Limit::AtMost => *high = high.min(limit.bound),
        }
    }
    bounds
}

/// Owner of coefficients: an unknown function, or the fitted part of an equation.
pub(crate) struct Owner {
    /// Its possible names; the first stands in messages.
    pub(crate) names: Vec<String>,
    /// Its candidates, the number 1 for a constant; `None` for those that it may not have.
    pub(crate) functions: Vec<Option<Expr>>,
}

/// The bounds that a constraint sets; none where it is about something else. `hidden`: names that the functions may have beside the columns.
///
/// # Errors
/// Unknown owners and candidates, a bound that is missing or empty, and entries of a constraint beside its
/// coefficients.
pub(crate) fn coefficient_limits(
    name: &str,
    section: &ConstraintSection,
    owners: &[Owner],
    hidden: &[String],
    aliases: &mut Aliases<'_>,
) -> Result<Vec<CoefficientLimit>, Error> {
    if section.coefficients.is_empty() {
        return Ok(Vec::new());
    }
    let place = CONSTRAINTS.entry(name).to_string();
    if section.of.is_some() || !section.matrix.is_empty() {
        return Err(Error::conflict(format!(
            "{place}: it has `coefficients`, and `of` or `matrix`; write two constraints"
        )));
    }
    let sides = sides(section, &place)?;
    let mut limits = Vec::new();
    for (owner, texts) in &section.coefficients {
        let at = owners.iter().position(|candidate| candidate.names.iter().any(|known| known == owner)).ok_or_else(
            || {
                let known: Vec<&str> =
                    owners.iter().filter_map(|owner| owner.names.last().map(String::as_str)).collect();
                let near = did_you_mean(&nearest(owner, known.iter().copied()));
                Error::unknown(
                    owner,
                    format!(
                        "{place} coefficients: no coefficients of `{owner}` are fitted{near}; there are {}",
                        known.join(", ")
                    ),
                )
            },
        )?;
        for text in texts {
            let function = aliases.over_latents(text, hidden, &format!("{place} coefficients"))?.simplified();
            let known = |expression: &Option<Expr>| expression.as_ref().is_some_and(|nominal| same(nominal, &function));
            let candidate = owners[at].functions.iter().position(known).ok_or_else(|| {
                let known: Vec<String> = owners[at].functions.iter().flatten().map(Expr::to_string).collect();
                let near = did_you_mean(&nearest(text, known.iter().map(String::as_str)));
                let some: Vec<&str> = known.iter().take(12).map(String::as_str).collect();
                let more = if known.len() > some.len() { ", ..." } else { "" };
                Error::unknown(
                    text,
                    format!(
                        "{place} coefficients: `{text}` is no candidate of {owner}{near}; it has {}{more}",
                        some.join(", ")
                    ),
                )
            })?;
            let known = owners[at].functions[candidate].as_ref().unwrap_or(&function);
            let of = format!("{known} of {}", owners[at].names[0]);
            limits.extend(sides.iter().map(|&(side, bound)| CoefficientLimit {
                name: name.to_owned(),
                owner: at,
                candidate,
                of: of.clone(),
                side,
                bound,
            }));
        }
    }
    Ok(limits)
}

/// Limits between which some value of every coefficient lies.
///
/// # Errors
/// Two constraints that leave a coefficient no value.
pub(crate) fn consistent(limits: Vec<CoefficientLimit>) -> Result<Vec<CoefficientLimit>, Error> {
    let of = |side: Limit| limits.iter().filter(move |limit| limit.side == side);
    for low in of(Limit::AtLeast) {
        let same = |high: &&CoefficientLimit| (high.owner, high.candidate) == (low.owner, low.candidate);
        if let Some(high) = of(Limit::AtMost).filter(same).find(|high| low.bound > high.bound) {
            return Err(Error::conflict(format!(
                "{CONSTRAINTS} {} and {}: no coefficient of {} is at least {} and at most {}; loosen one of them",
                low.name, high.name, low.of, low.bound, high.bound
            )));
        }
    }
    Ok(limits)
}

/// The sides that a constraint bounds, one at least.
///
/// # Errors
/// No bound, or bounds between which nothing lies.
pub(crate) fn sides(section: &ConstraintSection, place: &str) -> Result<Vec<(Limit, f64)>, Error> {
    let bounds = [section.at_least, section.at_most];
    if bounds.iter().flatten().any(|bound| bound.is_nan()) {
        return Err(Error::value(format!("{place}: a bound is not a number; remove it")));
    }
    if let [Some(least), Some(most)] = bounds
        && least > most
    {
        return Err(Error::value(format!("{place}: at_least = {least} is not below at_most = {most}")));
    }
    let sides = [(Limit::AtLeast, section.at_least), (Limit::AtMost, section.at_most)];
    let limits: Vec<(Limit, f64)> =
        sides.into_iter().filter_map(|(side, bound)| Some((side, bound.filter(|bound| bound.is_finite())?))).collect();
    if limits.is_empty() {
        return Err(Error::missing(format!(
            "{place}: nothing bounds it; add `at_least = 0.0` or `at_most`, of a matrix its least and greatest eigenvalue"
        )));
    }
    Ok(limits)
}

/// Returns true if two functions are equal up to the order of factors.
pub(crate) fn same(known: &Expr, function: &Expr) -> bool {
    let scope = Scope::open();
    let vocabulary = Vocabulary { variables: &[], scope: &scope };
    let one = || {
        let pair = [known.to_string(), function.to_string()];
        Library::parse(&pair, &vocabulary).is_ok_and(|library| library.functions.len() == 1 && !library.constant)
    };
    known == function || one()
}
