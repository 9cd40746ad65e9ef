//! Leaks of the predicted value into its prediction.

use std::collections::BTreeSet;

use fleetfoot_library::{Expr, Node};
use fleetfoot_model::{Equation, Prediction, Role};
use fleetfoot_recipe::{Aliases, Error};

/// Refuses columns of a partition that leak the predicted value, in plain regression: the region of a row would be
/// known only with its target.
///
/// A column leaks if it reads the target at the row itself or later. It may do so by its name, by another alias of the
/// same field, or by an expression over either. If the target is a function of one field, that field leaks too, unless
/// it is a regressor. The target's past is known and may be used.
///
/// # Errors
/// [`Error::TargetInPartition`], with the column.
pub(crate) fn refuse_target_in_partition(
    equations: &[Equation],
    aliases: &Aliases<'_>,
    partition: &[Expr],
) -> Result<(), Error> {
    let regressors: BTreeSet<String> = aliases
        .columns
        .iter()
        .filter(|column| column.role != Role::Auxiliary && !predicted(equations, &column.name))
        .flat_map(|column| now(&in_fields(&Expr::column(column.name.as_str()), aliases)))
        .collect();
    for equation in equations.iter().filter(|equation| equation.prediction == Prediction::Value) {
        let target = in_fields(&Expr::column(equation.subject.as_str()), aliases);
        let fields = now(&target);
        for column in partition {
            let seen = in_fields(column, aliases);
            let of_its_field = fields.len() == 1 && fields.is_disjoint(&regressors) && !fields.is_disjoint(&now(&seen));
            if of_its_field && reads_no_other_row(&target) || holds(&seen, &target) {
                return Err(Error::TargetInPartition { column: column.to_string(), target: equation.subject.clone() });
            }
        }
    }
    Ok(())
}

/// Returns true if a plain regression predicts the column.
pub(crate) fn predicted(equations: &[Equation], name: &str) -> bool {
    equations.iter().any(|equation| equation.prediction == Prediction::Value && equation.subject == name)
}

/// An expression over aliases as one over the fields of the log.
fn in_fields(expression: &Expr, aliases: &Aliases<'_>) -> Expr {
    expression.substituted(|name| {
        let known = aliases.expressions.iter().find(|(column, _)| column.name == name);
        known.map(|(_, expression)| expression.clone())
    })
}

/// The fields that an expression reads at its row or later. A filter's value depends on its input's past alone.
fn now(expression: &Expr) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    expression.fold(|part, _: &[()]| {
        if let Node::Column { name, lag } = part.node()
            && *lag <= 0
        {
            names.insert(name.to_string());
        }
    });
    names
}

fn reads_no_other_row(expression: &Expr) -> bool {
    let mut is_present = true;
    expression.fold(|part, _: &[()]| is_present &= !matches!(part.node(), Node::Column { lag, .. } if *lag != 0));
    is_present
}

fn holds(whole: &Expr, part: &Expr) -> bool {
    whole.fold(|equal, parts: &[bool]| equal == part || parts.contains(&true))
}
