//! The one partition that equations are fitted in the regions of.

use fleetfoot_data::setting::{PARTITION, SCORE};
use fleetfoot_library::Expr;
use fleetfoot_model::Partition;
use fleetfoot_pwa::Specification;
use fleetfoot_recipe::{Error, Recipe};

/// The one partition that a recipe asks for; `None` for one region.
pub fn specification(recipe: &Recipe) -> Result<Option<Specification>, Error> {
    let Some(text) = &recipe.model.partition else { return Ok(None) };
    let mut list = Specification::parse_list(text).map_err(|error| Error::value(error.to_string()))?;
    match (list.pop(), list.is_empty()) {
        (Some(Specification::Average), true) => Ok(None),
        (Some(Specification::Null), true) => Err(Error::value(format!(
            "{given_partition}: a null model has no equations; write average, zscore:1.5, kmeans:5 or labels:COLUMN",
            given_partition = PARTITION.to("null")
        ))),
        (Some(one), true) => Ok(Some(one)),
        _ => Err(Error::value(format!(
            "{given_partition}: equations are fitted in the regions of one partition; name one, and compare models with {SCORE}",
            given_partition = PARTITION.to(text)
        ))),
    }
}

/// A partition before it has numbers: its name and its columns. `None` is the one region of all rows.
pub fn placeholder(one: Option<&Specification>, on: &[Expr]) -> Option<Partition> {
    let one = one.filter(|one| !matches!(one, Specification::Null | Specification::Average))?;
    Some(Partition {
        specification: one.to_string(),
        columns: on.iter().cloned().chain(one.label().map(Expr::column)).collect(),
        ..Partition::whole()
    })
}
