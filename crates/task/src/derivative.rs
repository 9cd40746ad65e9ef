//! Measured derivative of a state.

use fleetfoot_library::{Expr, backward_difference, central_difference, forward_difference, mean_slope};
use fleetfoot_recipe::{Aliases, Derivative, Error};

/// Measured derivative of `x`, as an expression; `place`: its place in the recipe, for messages.
pub(crate) fn measured(
    derivative: Option<&Derivative>,
    x: &Expr,
    angle: bool,
    place: &str,
    aliases: &mut Aliases<'_>,
) -> Result<Expr, Error> {
    if let Some(central) = Derivative::central(derivative, x, angle) {
        return Ok(central.expression());
    }
    match derivative {
        Some(Derivative::Text(word)) if word == "forward" => Ok(forward_difference(x, angle)),
        Some(Derivative::Text(word)) if word == "backward" => Ok(backward_difference(x, angle)),
        Some(Derivative::Text(text)) => aliases.over_aliases(text, &format!("{place} derivative")),
        Some(Derivative::Span(span)) => Ok(mean_slope(x, span.rows(place)?, angle)),
        None => Ok(central_difference(x, angle)),
    }
}
