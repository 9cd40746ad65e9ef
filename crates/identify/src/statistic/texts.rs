//! Texts are no numbers.

use std::collections::BTreeSet;

use fleetfoot_data::{Column, ColumnKind};
use fleetfoot_library::Expr;

use super::StatisticError;

/// Codes of texts are numbered by the files that are open, which is no number to sum.
pub(super) fn refuse_text<'e>(
    read: impl Iterator<Item = &'e Expr>,
    aliases: &[(Column, Expr)],
    fields: &[Column],
) -> Result<(), StatisticError> {
    let used: BTreeSet<_> = read.flat_map(Expr::columns).collect();
    let text =
        |name: &str| fields.iter().any(|field| field.name == name && matches!(field.kind, ColumnKind::Category(_)));
    for (column, source) in aliases.iter().filter(|(column, _)| used.contains(column.name.as_str())) {
        if source.columns().iter().any(|name| text(name)) {
            return Err(StatisticError::Text { column: column.name.clone() });
        }
    }
    Ok(())
}
