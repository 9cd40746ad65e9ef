//! Radial functions among the candidates of a fit: their centres are found on its rows.

use fleetfoot_data::setting::{FIT_PWA, FIT_SINDY, LIBRARY_SECTION, RADIAL};
use fleetfoot_data::{Progress, Source};
use fleetfoot_library::Expr;
use fleetfoot_model::RadialFunctions;
use fleetfoot_pwa::{Options, Problem, Specification};
use fleetfoot_recipe::Recipe;

use crate::error::Error;

/// Most radial functions.
const MOST: usize = 2_000;

/// Number of radial functions in `[library]`.
///
/// # Errors
/// Zero, or too many.
pub(crate) fn count(recipe: &Recipe) -> Result<Option<usize>, Error> {
    match recipe.library.radial {
        Some(count) if !(1..=MOST).contains(&count) => Err(Error::value(format!(
            "{entry} ({given_radial}): give a number of centres from 1 to {MOST}, or remove it",
            given_radial = RADIAL.to(count),
            entry = LIBRARY_SECTION.entry("radial").is(count)
        ))),
        count => Ok(count),
    }
}

/// The radial functions of a recipe, around the centroids of k-means on all rows that `problem` counts; targets have no
/// part in them.
///
/// # Errors
/// Those of reading; fewer rows than centres.
pub(crate) fn functions(
    recipe: &Recipe,
    variables: &[Expr],
    problem: &Problem,
    (seed, source): (u64, &dyn Source),
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Option<RadialFunctions>, Error> {
    let Some(count) = count(recipe)? else { return Ok(None) };
    let problem = Problem { partition_columns: variables.to_vec(), ..problem.clone() };
    let mut options = Options::default();
    (options.folds, options.seed) = (0, seed);
    options.partitions = vec![Specification::KMeans(count)];
    let partitions = fleetfoot_pwa::partition(&problem, &options, source, progress)?;
    let few = |rows: u64| {
        Error::too_few_rows(
            rows,
            count as u64,
            format!(
                "{entry} ({given_radial}): {rows} complete rows are too few for so many centres; give a smaller number",
                given_radial = RADIAL.to(count),
                entry = LIBRARY_SECTION.entry("radial").is(count)
            ),
        )
    };
    if partitions.rows <= count as u64 {
        return Err(few(partitions.rows));
    }
    let partition = partitions.partitions.first().map(|(_, partition)| partition);
    let radial = partition.and_then(RadialFunctions::around).ok_or_else(|| few(partitions.rows))?;
    if radial.centres.len() < count {
        notes.push(format!(
            "{given_radial}: the rows have only {} distinct places, so there are only as many radial functions",
            radial.centres.len(),
            given_radial = RADIAL.to(count)
        ));
    }
    Ok(Some(radial))
}

/// Refuses radial functions of another method.
pub(crate) fn refuse(recipe: &Recipe, command: &str) -> Result<(), Error> {
    match recipe.library.radial {
        None => Ok(()),
        Some(count) => Err(Error::conflict(format!(
            "{entry} ({given_radial}): `{command}` has no radial functions; remove it, or use {FIT_PWA} or {FIT_SINDY}",
            given_radial = RADIAL.to(count),
            entry = LIBRARY_SECTION.entry("radial").is(count)
        ))),
    }
}

/// Refuses radial functions of a statistic.
pub(crate) fn refuse_statistic(recipe: &Recipe) -> Result<(), Error> {
    match recipe.library.radial {
        None => Ok(()),
        Some(count) => Err(Error::needs_rows(format!(
            "{entry} ({given_radial}): the centres of radial functions are computed from rows, which a statistic lacks; give the logs instead",
            given_radial = RADIAL.to(count),
            entry = LIBRARY_SECTION.entry("radial").is(count)
        ))),
    }
}
