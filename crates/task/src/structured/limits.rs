//! Limits that a fit keeps at every row: bounds of latents, and constraints between latents.

use fleetfoot_data::setting::CONSTRAINTS;
use fleetfoot_library::Expr;
use fleetfoot_recipe::{Aliases, ConstraintSection, Error, Recipe};
use fleetfoot_sparse::constrained::{Form, Limit, RowLimit};

use super::right_side::linear;
use crate::coefficients;

/// The limits of one latent by its bounds; infinite ones are none.
pub(super) fn of_latent(name: &str, latent: usize, bounds: [f64; 2]) -> Vec<RowLimit> {
    let sides = [Limit::AtLeast, Limit::AtMost].into_iter().zip(bounds).filter(|(_, bound)| bound.is_finite());
    sides.map(|(side, bound)| RowLimit::of_latent(name, latent, side, Expr::number(bound))).collect()
}

/// Those of `[constraints]` that are not of single coefficients, over unknowns of a kind, `latent` or `parameter`.
///
/// # Errors
/// Expressions that are not linear in the latents, or in none; a matrix that is not symmetric; no bound, or bounds between which nothing lies.
pub(crate) fn together(
    recipe: &Recipe,
    latents: &[String],
    kind: &str,
    aliases: &mut Aliases<'_>,
) -> Result<Vec<RowLimit>, Error> {
    let mut limits = Vec::new();
    for (name, section) in recipe.constraints.iter().filter(|(_, section)| section.coefficients.is_empty()) {
        let place = CONSTRAINTS.entry(name).to_string();
        let forms = forms(section, (latents, kind), &place, aliases)?;
        if forms.iter().all(|form| form.terms.is_empty()) {
            let latents = latents.join(", ");
            return Err(Error::missing(format!("{place}: no {kind} is in it; the {kind}s are {latents}")));
        }
        let sides = coefficients::sides(section, &place)?.into_iter();
        limits.extend(sides.map(|(side, bound)| RowLimit {
            name: name.clone(),
            forms: forms.clone(),
            side,
            bound: Expr::number(bound),
        }));
    }
    Ok(limits)
}

/// The matrix (packed lower triangle), of one form where it is a number.
fn forms(
    section: &ConstraintSection,
    (latents, kind): (&[String], &str),
    place: &str,
    aliases: &mut Aliases<'_>,
) -> Result<Vec<Form>, Error> {
    let mut form = |text: &str, place: &str| {
        let expression = aliases.over_latents(text, latents, place)?;
        Ok::<_, Error>((linear(&expression, latents, place, text, kind)?, expression.simplified().to_string()))
    };
    let rows = match (&section.of, section.matrix.is_empty()) {
        (Some(text), true) => return Ok(vec![form(text, &format!("{place} of"))?.0]),
        (None, false) => &section.matrix,
        (Some(_), false) => {
            return Err(Error::conflict(format!("{place}: it has both `of` and `matrix`; remove one of them")));
        }
        (None, true) => {
            return Err(Error::missing(format!(
                "{place}: write what is bounded, `of = \"F*v\"`, `matrix = [[\"M11\", \"M12\"], [\"M12\", \"M22\"]]` or `coefficients = {{ F = [\"v\"] }}`"
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
        let mut entries = Vec::with_capacity(row.len());
        for (j, text) in row.iter().enumerate() {
            let (form, text) = form(text, &format!("{place} matrix, row {}, column {}", i + 1, j + 1))?;
            entries.push(text);
            if j <= i {
                forms.push(form);
            }
        }
        texts.push(entries);
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
