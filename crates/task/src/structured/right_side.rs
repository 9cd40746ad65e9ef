//! Right sides that are linear in the latents.

use fleetfoot_data::setting::COLUMNS;
use fleetfoot_library::{Binary, Expr, Node, Unary};
use fleetfoot_recipe::Error;
use fleetfoot_sparse::constrained::Form;
use fleetfoot_sums::structured::Term;

/// Takes a right side apart, over unknowns of a kind, `latent` or `parameter`. The coefficient of a latent is the
/// derivative with respect to it; the rest is the right side with all latents 0.
///
/// # Errors
/// When it is not linear in the latents.
pub(super) fn linear(right: &Expr, latents: &[String], place: &str, text: &str, kind: &str) -> Result<Form, Error> {
    let is_latent = |name: &str| latents.iter().any(|latent| latent == name);
    let problem = |problem: String| Error::value(format!("{place} = \"{text}\": {problem}"));
    if let Some(part) = kinked(right, &is_latent) {
        return Err(problem(format!(
            "`{part}` is not linear in the {kind}s; only sums of coefficients times {kind}s will do"
        )));
    }
    let mut terms = Vec::new();
    for name in right.columns().iter().filter(|name| is_latent(name)) {
        let coefficient = right.derivative(name).simplified();
        if let Some(other) = coefficient.columns().iter().find(|column| is_latent(column)) {
            return Err(problem(if **other == **name {
                format!("it is not linear in `{name}`; only sums of coefficients times {kind}s will do")
            } else {
                format!("`{name}` is multiplied with `{other}`: a product of two {kind}s is not linear")
            }));
        }
        if coefficient.as_number() == Some(0.0) {
            return Err(problem(format!("`{name}` cancels out; remove it")));
        }
        let latent = latents.iter().position(|latent| **latent == **name).unwrap_or_default();
        terms.push(Term { latent, coefficient });
    }
    terms.sort_by_key(|term| term.latent);
    let rest = right.substituted(|name| is_latent(name).then(|| Expr::number(0.0))).simplified();
    Ok(Form { terms, rest })
}

/// The first part whose derivative would hide that it is not linear in a latent: a step or wrap of one, or one at
/// another row.
fn kinked(right: &Expr, is_latent: &dyn Fn(&str) -> bool) -> Option<Expr> {
    let mut kink = None;
    right.fold(|expr, parts: &[bool]| {
        let within = parts.contains(&true);
        let (latent, kinked) = match expr.node() {
            Node::Column { name, lag } => (is_latent(name), is_latent(name) && *lag != 0),
            Node::Unary(Unary::Sign | Unary::Step | Unary::Wrap, _) | Node::Binary(Binary::Min | Binary::Max, ..) => {
                (within, within)
            }
            _ => (within, false),
        };
        if kinked && kink.is_none() {
            kink = Some(expr.clone());
        }
        latent
    });
    kink
}

/// Refuses an expression with latents.
pub(super) fn without_latents(expression: &Expr, latents: &[String], place: &str) -> Result<(), Error> {
    match expression.columns().iter().find(|column| latents.iter().any(|latent| **latent == ***column)) {
        None => Ok(()),
        Some(name) => Err(Error::value(format!(
            "{place}: `{expression}` reads the latent `{name}`; it may read columns only (a field of this name needs another alias in {COLUMNS})"
        ))),
    }
}
