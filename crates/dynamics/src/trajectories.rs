//! A simulator rolled out from starts, in groups.

use fleetfoot_data::{Progress, Source, parallel_map};

use crate::{
    Error, Outside, RolloutOptions, Simulator, Start, Trajectory, general,
    run::Run,
    window::{Window, read_windows},
};

/// Starts that one piece of parallel work simulates. A constant: results do not depend on it, only the memory in flight does.
pub(crate) const GROUP: usize = 32;

impl Simulator {
    /// Rolls the model out from every start; `None` for a start whose rows have missing values.
    ///
    /// The source's columns are the model's, in any order. Same bits on any number of threads and for any grouping of starts.
    ///
    /// # Errors
    /// Of reading, of a start that does not fit ([`Starts::choose`](crate::Starts::choose) gives such that do), and of the options.
    pub fn trajectories(
        &self,
        source: &dyn Source,
        starts: &[Start],
        options: &RolloutOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<Option<Trajectory>>, Error> {
        options.validate()?;
        let needed = self.needed_rows(options.horizon);
        let starts = crate::Starts::At(starts.to_vec()).choose(source, options.horizon, needed.before, needed.after)?;
        let map = self.column_map(source)?;
        let groups = parallel_map(starts.len().div_ceil(GROUP), progress, |group| -> Result<_, Error> {
            let starts = &starts[group * GROUP..((group + 1) * GROUP).min(starts.len())];
            let blocks = read_windows(source, starts, needed)?;
            let windows: Vec<Window<'_>> = blocks.windows(starts, &map);
            let usable: Vec<bool> = windows.iter().map(|window| self.is_complete(window, options.horizon)).collect();
            let chosen: Vec<&Window<'_>> = windows.iter().zip(&usable).filter(|(_, ok)| **ok).map(|(w, _)| w).collect();
            let mut done = self.simulate(source, &chosen, options).into_iter();
            Ok(usable.iter().map(|&ok| if ok { done.next() } else { None }).collect::<Vec<_>>())
        })?;
        Ok(groups.into_iter().flatten().collect())
    }

    /// Simulates complete windows.
    pub(crate) fn simulate(
        &self,
        source: &dyn Source,
        windows: &[&Window<'_>],
        options: &RolloutOptions,
    ) -> Vec<Trajectory> {
        let runs: Vec<Run<'_>> = windows.iter().map(|window| Run::new(source, window, options)).collect();
        match &self.kernel {
            // The kernel's slots are not held.
            Some(kernel) if options.outside != Outside::Hold => kernel.simulate(self, &runs, options.method),
            _ => general::simulate(self, &runs, options),
        }
    }
}
