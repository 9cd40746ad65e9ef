//! Bootstrap of episodes or chunks: every replicate is a reweighting of a statistic's members, without a pass over rows.

use fleetfoot_data::Progress;

use super::{
    BolassoError, BootstrapOptions, BootstrapUnit, Selection, counts::multinomial_counts, joint::Joint, unit::enough,
};
use crate::structured::Assembly;
use fleetfoot_sums::structured::{Banks, Structure};

/// Bolasso with replicates of episodes or chunks (Algorithm 1 of the block-sparse bolasso paper; Bach 2008): each replicate draws as many units as there
/// are, with replacement, and its lasso is solved at [`BootstrapOptions::lambda`]; column scales are recomputed for each, task weights stay.
///
/// The draws are a function of seed, replicate and the order of the keys; the same bits come from any number of threads.
///
/// # Errors
/// When an option is out of range, the assembly does not fit the structure, the statistic is empty or not finite, or the user stops it.
pub fn block_bootstrap(
    structure: &Structure,
    banks: &Banks,
    assembly: &Assembly,
    unit: BootstrapUnit,
    options: &BootstrapOptions,
    progress: &dyn Progress,
) -> Result<Selection, BolassoError> {
    options.check()?;
    enough(banks.keys().len(), unit, 1)?;
    let joint = Joint::new(structure, banks, assembly, unit, progress)?;
    let units = joint.units();
    // Replicates resemble the whole: its solution is where they start from.
    let whole =
        joint.resample(1, progress, |_| vec![1.0; units], |sums| Ok(joint.frame.fit(sums, options.lambda, None)?))?;
    let whole = whole.into_iter().flatten().flat_map(|fitted| fitted.coefficients.into_iter().enumerate());
    let guess: Vec<(usize, f64)> =
        whole.filter(|(_, value)| *value != 0.0).map(|(j, value)| (j, value.signum())).collect();
    let resampled = joint.resample(
        options.replicates,
        progress,
        |replicate| multinomial_counts(options.seed, replicate, units),
        |sums| Ok(joint.frame.fit(sums, options.lambda, Some(&guess))?),
    )?;
    Selection::of(&resampled, structure.coefficients(), options.threshold)
}
