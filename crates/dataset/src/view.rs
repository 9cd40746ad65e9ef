//! Rows seen through aliases.

use fleetfoot_data::{Column, Source};
use fleetfoot_library::{Expr, Filter, Filtered, View};

use crate::error::Error;

/// Rows seen through aliases. Filters in them are computed from the fields.
///
/// # Errors
/// An alias reads what is not there, or a filter's constant is out of its range.
pub(crate) fn seen_through<'a>(rows: Box<dyn Source + 'a>, aliases: &[(Column, Expr)]) -> Result<View<'a>, Error> {
    let filters: Vec<Filter> = aliases.iter().flat_map(|(_, expression)| expression.filters()).collect();
    let filtered: Box<dyn Source + 'a> =
        if filters.is_empty() { rows } else { Box::new(Filtered::over(rows, &filters)?) };
    Ok(View::over(filtered, aliases)?)
}
