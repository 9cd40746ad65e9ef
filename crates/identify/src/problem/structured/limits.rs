//! What a fit keeps at every row: bounds of latents, and what latents keep together.

use fleetfoot_library::Expr;
use fleetfoot_sparse::constrained::{Form, Limit, RowLimit};

use super::right_side::linear;
use crate::{ConstraintSection, Error, Recipe, problem::Aliases};

/// The limits of one latent by its bounds; infinite ones are none.
pub(super) fn of_latent(name: &str, latent: usize, bounds: [f64; 2]) -> Vec<RowLimit> {
    let limit = |(side, bound)| RowLimit::of_latent(name, latent, side, Expr::number(bound));
    sides(bounds.map(Some)).map(limit).collect()
}

/// The sides that say something.
fn sides([least, most]: [Option<f64>; 2]) -> impl Iterator<Item = (Limit, f64)> {
    let sides = [(Limit::AtLeast, least), (Limit::AtMost, most)];
    sides.into_iter().filter_map(|(side, bound)| Some((side, bound.filter(|bound| bound.is_finite())?)))
}

/// `[constraints]`.
///
/// # Errors
/// Expressions that are not linear in the latents, or in none; a matrix that is not symmetric; no bound, or bounds between which nothing lies.
pub(super) fn together(recipe: &Recipe, latents: &[String], aliases: &mut Aliases<'_>) -> Result<Vec<RowLimit>, Error> {
    let mut limits = Vec::new();
    for (name, section) in &recipe.constraints {
        let place = format!("[constraints] {name}");
        let forms = forms(section, latents, &place, aliases)?;
        if forms.iter().all(|form| form.terms.is_empty()) {
            return Err(Error::missing(format!("{place}: no latent is in it; the latents are {}", latents.join(", "))));
        }
        let bounds = [section.at_least, section.at_most];
        if bounds.iter().flatten().any(|bound| bound.is_nan()) {
            return Err(Error::value(format!("{place}: a bound is not a number; leave it away")));
        }
        if let [Some(least), Some(most)] = bounds
            && least > most
        {
            return Err(Error::value(format!("{place}: at_least = {least} is not below at_most = {most}")));
        }
        let before = limits.len();
        limits.extend(sides(bounds).map(|(side, bound)| RowLimit {
            name: name.clone(),
            forms: forms.clone(),
            side,
            bound: Expr::number(bound),
        }));
        if limits.len() == before {
            return Err(Error::missing(format!(
                "{place}: nothing bounds it; add `at_least = 0.0` or `at_most`, of a matrix its least and greatest eigenvalue"
            )));
        }
    }
    Ok(limits)
}

/// The matrix (packed lower triangle), of one form where it is a number.
fn forms(
    section: &ConstraintSection,
    latents: &[String],
    place: &str,
    aliases: &mut Aliases<'_>,
) -> Result<Vec<Form>, Error> {
    let mut form = |text: &str, place: &str| {
        let expression = aliases.over_latents(text, latents, place)?;
        Ok::<_, Error>((linear(&expression, latents, place, text)?, expression.simplified().to_string()))
    };
    let rows = match (&section.of, section.matrix.is_empty()) {
        (Some(text), true) => return Ok(vec![form(text, &format!("{place} of"))?.0]),
        (None, false) => &section.matrix,
        (Some(_), false) => {
            return Err(Error::conflict(format!("{place}: it has both `of` and `matrix`; leave one of them away")));
        }
        (None, true) => {
            return Err(Error::missing(format!(
                "{place}: write what is bounded, `of = \"F*v\"` or `matrix = [[\"M11\", \"M12\"], [\"M12\", \"M22\"]]`"
            )));
        }
    };
    let mut forms = Vec::new();
    let mut texts: Vec<Vec<String>> = Vec::with_capacity(rows.len());
    for (i, row) in rows.iter().enumerate() {
        if row.len() != i + 1 && row.len() != rows.len() {
            return Err(Error::value(format!(
                "{place} matrix: row {} has {} entries; a symmetric matrix of {} rows has {0} up to the diagonal there, or {2} in all",
                i + 1,
                row.len(),
                rows.len()
            )));
        }
        let mut own = Vec::with_capacity(row.len());
        for (j, text) in row.iter().enumerate() {
            let (form, text) = form(text, &format!("{place} matrix, row {}, column {}", i + 1, j + 1))?;
            own.push(text);
            if j <= i {
                forms.push(form);
            }
        }
        texts.push(own);
    }
    for (i, row) in texts.iter().enumerate() {
        for (j, text) in row.iter().enumerate().skip(i + 1) {
            let other = &texts[j][i];
            if text != other {
                return Err(Error::value(format!(
                    "{place} matrix: it is `{text}` in row {}, column {} and `{other}` in row {1}, column {0}; a bound of eigenvalues is of a symmetric matrix",
                    i + 1,
                    j + 1
                )));
            }
        }
    }
    Ok(forms)
}
