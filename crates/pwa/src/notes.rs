//! Notes for the user about a fit.

use fleetfoot_data::setting::SHRINKAGE;
use fleetfoot_stats::SquareRoot;

use crate::{
    Problem, Score, Specification,
    complete::Fit,
    fit::{Roots, Solver},
    region_model::Base,
    select::Order,
    walks::MOST_REGIONS,
};

/// Adds notes about confounded regressors.
pub(crate) fn confounded(problem: &Problem, base: &Base, notes: &mut Vec<String>) {
    let name = |&function: &usize| problem.library[function].to_string();
    for group in &base.average.confounded {
        let names: Vec<String> = group.iter().map(name).collect();
        notes.push(match names.as_slice() {
            [one] => format!("{one} does not change: its coefficient cannot be separated from the constant"),
            _ => format!("the data cannot separate {}: their coefficients are the smallest that fit", names.join(", ")),
        });
    }
}

impl Score {
    /// Of a model that is worth no more than the mean of the targets, whose held-out loss is 1: how little; `None` of another.
    pub fn no_better(&self) -> Option<String> {
        let Self { specification, loss, standard_error, .. } = self;
        let verb = match (specification, loss) {
            (Specification::Null, _) => return None,
            (_, loss) if *loss >= 1.0 => "predicts",
            (_, loss) if loss + standard_error >= 1.0 => "may predict",
            _ => return None,
        };
        Some(format!(
            "{specification} {verb} held-out rows no better than their mean: its loss is {loss:.3} +- {standard_error:.3}, the loss of the mean is 1"
        ))
    }
}

impl Fit<'_> {
    /// In many dimensions hardly any row is near the centre of a ball; a box may have all rows.
    pub(crate) fn empty_regions(&self, solver: &Solver<'_>, notes: &mut Vec<String>) {
        for candidate in &self.segmentation.candidates {
            let columns = self.rows.partition;
            let (size, why) = match candidate.specification {
                Specification::ZScore(radius) => (
                    radius,
                    format!(
                        "in {columns} standardised columns the root mean square distance is {:.1}",
                        (columns as f64).sqrt()
                    ),
                ),
                Specification::ZBox(half) => (half, format!("the box has {columns} standardised columns")),
                _ => continue,
            };
            let regions = solver.training(candidate.full, None);
            for (region, place) in [(0, "within"), (1, "beyond")] {
                if regions.get(&region).is_none_or(|root| root.rows == 0) {
                    notes.push(format!("{}: no row is {place} {size} of the centre; {why}", candidate.specification));
                }
            }
        }
    }

    /// Kept models with regions of fewer rows than a map of theirs has numbers, that nothing pulls towards the map of all rows.
    pub(crate) fn starved(&self, kept: &[usize], orders: &[Order], solver: &Solver<'_>) -> Vec<String> {
        let numbers = self.rows.regressors + 1;
        let note = |&candidate: &usize| {
            let (candidate, order) = (&self.segmentation.candidates[candidate], &orders[candidate]);
            if candidate.specification == Specification::Null || order.shrinkage > 0.0 || order.continuity.is_some() {
                return None;
            }
            let partition = &self.segmentation.partitions[candidate.full];
            let few =
                |(region, root): (&u32, &SquareRoot)| (root.rows > 0 && root.rows < numbers as u64).then_some(*region);
            let regions: Vec<u32> = solver.training(candidate.full, None).iter().filter_map(few).collect();
            let first = partition.region_name(*regions.first()? as usize);
            let (count, all) = (regions.len(), partition.rule.count());
            Some(format!(
                "{}: {count} of {all} regions (the first: {first}) have fewer rows than the {numbers} coefficients of a map, so their maps are the smallest that fit and do not hold for other rows; \
                 ask for fewer regions, or pull them towards the map of all rows ({SHRINKAGE})",
                candidate.specification
            ))
        };
        kept.iter().filter_map(note).collect()
    }

    /// Kept models whose regions are too many for their pairs to be counted along the phase.
    pub(crate) fn uncounted(&self, kept: &[usize]) -> Vec<String> {
        let Some(phase) = &self.options.phase else { return Vec::new() };
        let many = |&candidate: &usize| {
            let candidate = &self.segmentation.candidates[candidate];
            let regions = self.segmentation.partitions[candidate.full].rule.count();
            let note = || {
                format!(
                    "{}: {regions} regions are too many to count transitions along {}",
                    candidate.specification, phase.specification
                )
            };
            (!candidate.specification.fits_targets() && regions > MOST_REGIONS).then(note)
        };
        kept.iter().filter_map(many).collect()
    }
}
