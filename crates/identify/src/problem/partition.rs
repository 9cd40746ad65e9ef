//! The one partition that equations are fitted in the regions of.

use fleetfoot_data::{Progress, Source};
use fleetfoot_library::Expr;
use fleetfoot_model::Partition;
use fleetfoot_pwa::{Options, Problem, Specification};

use crate::{Error, Recipe};

/// The one partition that a recipe asks for; `None` for one region.
pub(crate) fn specification(recipe: &Recipe) -> Result<Option<Specification>, Error> {
    let Some(text) = &recipe.model.partition else { return Ok(None) };
    let mut list = Specification::parse_list(text)?;
    match (list.pop(), list.is_empty()) {
        (Some(Specification::Average), true) => Ok(None),
        (Some(Specification::Null), true) => Err(Error::value(
            "--partition null: a null model has no equations; write average, zscore:1.5, kmeans:5 or labels:COLUMN"
                .into(),
        )),
        (Some(one), true) => Ok(Some(one)),
        _ => Err(Error::value(format!(
            "--partition {text}: equations are fitted in the regions of one partition; name one, and compare models with `fleetfoot score`"
        ))),
    }
}

/// A partition before it has numbers: its name, and what it looks at. `None` is the one region of all rows.
pub(crate) fn placeholder(one: Option<&Specification>, on: &[Expr]) -> Option<Partition> {
    let one = one.filter(|one| !matches!(one, Specification::Null | Specification::Average))?;
    Some(Partition {
        specification: one.to_string(),
        columns: on.iter().cloned().chain(one.label().map(Expr::column)).collect(),
        ..Partition::whole()
    })
}

/// How regions are found where nothing but a seed is said.
pub(crate) fn clustering(seed: u64) -> Options {
    let mut options = Options::default();
    options.seed = seed;
    options
}

/// The regions of all rows of a source, found as the options say.
///
/// # Errors
/// Those of reading; more regions than rows.
pub(crate) fn regions(
    problem: &Problem,
    specification: Specification,
    mut options: Options,
    source: &dyn Source,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Partition, Error> {
    if specification.fits_targets() {
        notes.push(format!(
            "{specification}: its regions fit all of these rows, so held-out errors of what is fitted in them are too small; `fit pwa` and `fit narx` on logs make \
             regions anew for every fold"
        ));
    }
    options.partitions = vec![specification];
    let mut found = fleetfoot_pwa::partition(problem, &options, source, progress)?;
    notes.append(&mut found.notes);
    Ok(found.partitions.pop().map_or_else(Partition::whole, |(_, partition)| partition))
}
