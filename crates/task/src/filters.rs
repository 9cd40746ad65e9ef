//! Columns that remember (lags, delays) as columns of the model, and parameters put in as numbers.

use std::collections::BTreeMap;

use fleetfoot_data::{Column as DataColumn, ColumnKind};
use fleetfoot_library::{Expr, Filter};
use fleetfoot_model::{Column, Role};

use crate::equations::EquationTask;

impl EquationTask {
    /// The task with numbers in place of its parameters, and a column for every filter, so that rows can be evaluated.
    #[must_use]
    pub fn settled(&self, values: &BTreeMap<String, f64>) -> Self {
        let number = |name: &str| values.get(name).map(|&value| Expr::number(value));
        let mut task = self.map(|expression| expression.substituted(number).simplified());
        task.parameters.clear();
        task.with_filters()
    }

    /// A column of the model for every filter that the expressions read. A model keeps how its values follow from the fields of a log, as of any other column.
    fn with_filters(mut self) -> Self {
        let mut filters: Vec<Filter> = Vec::new();
        for filter in self.expressions().flat_map(Expr::filters) {
            if !filters.contains(&filter) {
                filters.push(filter);
            }
        }
        let over_fields: BTreeMap<String, Expr> =
            self.aliases.iter().map(|(column, expression)| (column.name.clone(), expression.clone())).collect();
        for filter in filters {
            let column = filter.column();
            let source = column.substituted(|name| over_fields.get(name).cloned());
            let of_input = filter.input.as_column().and_then(|name| self.column(name));
            let unit = of_input.and_then(|column| column.unit.clone());
            let given = |name: &str| self.column(name).is_none_or(|column| column.role == Role::Input);
            let role = if filter.sources().iter().all(|name| given(name)) { Role::Input } else { Role::Auxiliary };
            let name = filter.to_string();
            self.columns.push(Column {
                name: name.clone(),
                source: source.to_string(),
                unit: unit.clone(),
                role,
                angle: false,
                rotation: None,
            });
            self.aliases.push((DataColumn { name, unit, kind: ColumnKind::Float }, source));
        }
        self
    }

    fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }
}
