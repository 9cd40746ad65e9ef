//! Opening of logs for a filter's measurements, which differ from the columns that the model was fitted on.

use fleetfoot_data::Progress;
use fleetfoot_model::{Column as ModelColumn, Model, Role};
use fleetfoot_recipe::{Recipe, aliases_of_model};

use crate::{
    dataset::{Dataset, fields},
    error::Error,
    logs::Logs,
};

impl Dataset {
    /// Opens files for these columns, by the clock and the labels of a model, which may lack every other column of the model.
    pub fn for_filter(
        model: &Model,
        columns: &[ModelColumn],
        changes: &Recipe,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let mut read = model.clone();
        read.columns = columns.to_vec();
        Self::with_model(&read, changes, logs, (&|_| true, 1), progress)
    }

    /// For each source, a field or an expression: true if the first log has the fields that it reads.
    pub fn readable(recipe: &Recipe, logs: &Logs, sources: &[String]) -> Result<Vec<bool>, Error> {
        let (fields, _) = fields(recipe, logs)?;
        let column = |source: &String| ModelColumn {
            name: "column".into(),
            source: source.clone(),
            unit: None,
            role: Role::Auxiliary,
            angle: false,
            rotation: None,
        };
        Ok(sources.iter().map(|source| aliases_of_model(&[column(source)], &fields).is_ok()).collect())
    }
}
