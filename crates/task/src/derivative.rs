//! What the derivative of a state is measured as.

use fleetfoot_library::{Expr, backward_difference, central_difference, forward_difference, mean_slope};
use fleetfoot_recipe::{Aliases, Derivative, Error};

/// What the derivative of `x` is measured as; `place` is where the recipe says it.
pub(crate) fn measured(
    said: Option<&Derivative>,
    x: &Expr,
    angle: bool,
    place: &str,
    aliases: &mut Aliases<'_>,
) -> Result<Expr, Error> {
    if let Some(central) = Derivative::central(said, x, angle) {
        return Ok(central.expression());
    }
    match said {
        Some(Derivative::Text(word)) if word == "forward" => Ok(forward_difference(x, angle)),
        Some(Derivative::Text(word)) if word == "backward" => Ok(backward_difference(x, angle)),
        Some(Derivative::Text(text)) => aliases.over_aliases(text, &format!("{place} derivative")),
        Some(Derivative::Span(span)) => Ok(mean_slope(x, span.rows(place)?, angle)),
        None => Ok(central_difference(x, angle)),
    }
}
