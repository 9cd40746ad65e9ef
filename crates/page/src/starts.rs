//! Common starts of the simulations of several models: errors from different rows cannot be compared.

use fleetfoot_data::{Episode, Halo};
use fleetfoot_dataset::Dataset;
use fleetfoot_dynamics::{Start, Starts};
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_run::RolledOut;

/// An episode, whatever columns are read of it: its identity is one of the columns in use.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Recorded {
    name: String,
    span: [i64; 2],
    rows: usize,
}

impl Recorded {
    pub(crate) fn of(episode: &Episode) -> Self {
        Self { name: episode.name.clone(), span: [episode.start, episode.end], rows: episode.rows }
    }

    /// Its number among these.
    pub(crate) fn among(&self, episodes: &[Episode]) -> Option<usize> {
        episodes.iter().position(|episode| Self::of(episode) == *self)
    }
}

/// A row of an episode.
pub(crate) type Place = (Recorded, usize);

/// Rows before and after a row that the simulation of one of these models reads.
pub(crate) fn reach(models: &[(String, Model)]) -> Halo {
    let expressions = models.iter().flat_map(|(_, model)| {
        let partitions = model.partitions.iter().flat_map(|partition| &partition.columns);
        let rights = model.equations.iter().map(|equation| &equation.right);
        model.libraries.iter().flatten().chain(partitions).chain(rights)
    });
    expressions.map(fleetfoot_library::Expr::reach).fold(Halo::default(), |most, (before, after)| Halo {
        before: most.before.max(before as usize),
        after: most.after.max(after as usize),
    })
}

/// The starts of a model: those of the models before it, or so many rows that every model can begin at. `None` if these
/// logs have no such rows.
pub(crate) fn common(
    rows: &Dataset,
    horizon: usize,
    count: usize,
    reach: Halo,
    before: Option<&[Place]>,
) -> Result<Option<Starts>, Error> {
    if let Some(places) = before {
        let start = |(episode, row): &Place| Some(Start { episode: episode.among(rows.episodes())?, row: *row });
        return Ok(places.iter().map(start).collect::<Option<Vec<Start>>>().map(Starts::At));
    }
    let after = horizon.max((horizon + reach.after).saturating_sub(1));
    Ok(Starts::Even(count).choose(&rows.view()?, horizon, reach.before.max(1), after).ok().map(Starts::At))
}

/// Starts of the simulations.
pub(crate) fn places(rows: &Dataset, rolled: &RolledOut) -> Vec<Place> {
    let place = |start: Start| (Recorded::of(&rows.episodes()[start.episode]), start.row);
    rolled.rollouts.outcomes.iter().map(|outcome| place(outcome.start)).collect()
}
