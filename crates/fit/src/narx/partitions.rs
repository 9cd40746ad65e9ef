//! The partitions that a fit chooses from, made on all rows or on the training rows of a fold.

use std::collections::BTreeMap;

use fleetfoot_data::setting::PARTITION;
use fleetfoot_data::{Progress, Source, Stages};
use fleetfoot_model::Partition;
use fleetfoot_pwa::{Options, Problem, Specification};
use fleetfoot_recipe::NarxSelection;

use super::{OrderRule, choice::Choice, options::USUAL, summed::Evidence, task::NarxTask, training::Fit};
use crate::{error::Error, spans::Spans};

impl Fit<'_> {
    /// The requested partitions, and beside them the cells that refinements start from, on all training rows; the
    /// clustered ones once a start.
    pub(crate) fn partitions(&self, notes: &mut Vec<String>, progress: &dyn Progress) -> Result<Vec<Choice>, Error> {
        if self.options.partitions == [Specification::Average] {
            return Ok(vec![Choice::whole(self.options.seed)]);
        }
        let task = self.task_of_regions()?;
        let source = match self.evidence {
            Evidence::Rows(source) => source,
            Evidence::Sums(sums) => return sums.partitions(&task, self.options),
        };
        let problem = task.task.problem(self.step);
        let mut specifications = match self.options.selection {
            NarxSelection::FreeRun => with_starts(&self.options.partitions),
            NarxSelection::OneStep(_) => self.options.partitions.clone(),
        };
        let mut choices = Vec::new();
        for start in 0..self.options.starts as u64 {
            let seed = self.options.seed.wrapping_add(start);
            if start > 0 {
                // Only what is clustered depends on the seed.
                specifications.retain(Specification::is_seeded);
            }
            if specifications.is_empty() {
                break;
            }
            let partitioned = made((&problem, &specifications, seed), source, progress)?;
            let new = partitioned.notes.into_iter().filter(|note| !notes.contains(note)).collect::<Vec<_>>();
            notes.extend(new);
            choices.extend(partitioned.partitions.into_iter().map(|(specification, partition)| Choice {
                partition: (specification != Specification::Average).then_some(partition),
                specification,
                seed,
            }));
        }
        Ok(choices)
    }

    /// Partitions whose regions follow from the targets, made on the training rows of every fold, so that held-out rows
    /// have no part in them. `None` for the others, whose regions follow from the places of rows alone. `cut`: the
    /// spans; `folds`: the fold of each of them.
    ///
    /// # Errors
    /// Those of reading; training rows of a fold that are too few.
    pub(crate) fn anew(
        &self,
        partitions: &[Choice],
        (cut, folds): (&Spans<'_>, &[usize]),
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<Partition>>, Error> {
        let mut of_partitions = vec![Vec::new(); partitions.len()];
        // Refinements of one seed begin with the same cells.
        let mut by_seed: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
        for (index, choice) in partitions.iter().enumerate().filter(|(_, choice)| choice.specification.fits_targets()) {
            by_seed.entry(choice.seed).or_default().push(index);
        }
        if by_seed.is_empty() {
            return Ok(of_partitions);
        }
        let problem = self.task_of_regions()?.task.problem(self.step);
        for fold in 0..self.options.folds {
            let others = (0..folds.len()).filter(|&e| folds[e] != fold);
            let train = Spans::new(cut, others.map(|e| (e, 0..cut.episodes()[e].rows)).collect(), 1)?;
            for (&seed, indices) in &by_seed {
                let specifications: Vec<Specification> =
                    indices.iter().map(|&index| partitions[index].specification.clone()).collect();
                let of_fold = Stages::fold(progress, fold, self.options.folds);
                let partitions = made((&problem, &specifications, seed), &train, &of_fold)?.partitions;
                indices
                    .iter()
                    .zip(partitions)
                    .for_each(|(&index, (_, partition))| of_partitions[index].push(partition));
            }
        }
        Ok(of_partitions)
    }

    /// Task whose rows have all lags, for the regions, which have separate columns.
    fn task_of_regions(&self) -> Result<NarxTask, Error> {
        let order = match self.options.order {
            OrderRule::Fixed(order) | OrderRule::UpTo(order) => order,
            OrderRule::Look(given) => given.or(USUAL),
        };
        self.evidence.candidates(self.base, &[order])
    }
}

/// Partitions to choose from, and the cells of k-means that refined ones start from. Regions with lower one-step errors
/// need not simulate better; free runs compare both. A request for a single partition stays as it is.
pub(crate) fn with_starts(listed: &[Specification]) -> Vec<Specification> {
    let mut all = listed.to_vec();
    if all.len() > 1 {
        for start in listed.iter().filter_map(Specification::refined_from) {
            if !all.contains(&start) {
                all.push(start);
            }
        }
    }
    all
}

/// Note about a starting partition that only refinements named.
pub(crate) fn start_note(listed: &[Specification], chosen: &Choice) -> Option<String> {
    if listed.contains(&chosen.specification) {
        return None;
    }
    let mut refined =
        listed.iter().filter(|partition| partition.refined_from().as_ref() == Some(&chosen.specification));
    let refined = refined.next()?;
    let start = &chosen.specification;
    Some(format!(
        "{start} is the start of {refined}: without refinement its cells have the lowest simulation error on held-out spans; {given_partition} alone takes the refined regions",
        given_partition = PARTITION.to(refined)
    ))
}

/// Partitions of the rows of a source.
fn made(
    (problem, specifications, seed): (&Problem, &[Specification], u64),
    source: &dyn Source,
    progress: &dyn Progress,
) -> Result<fleetfoot_pwa::Partitioned, Error> {
    let mut options = Options::default();
    options.partitions = specifications.to_vec();
    options.seed = seed;
    Ok(fleetfoot_pwa::partition(problem, &options, source, progress)?)
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource, Silent, mix, with_threads};
    use fleetfoot_model::Rule;
    use fleetfoot_recipe::Recipe;
    use fleetfoot_task::EquationTask;

    use super::*;
    use crate::narx::{
        NarxOptions,
        task::{NarxBase, one_row_ahead},
    };

    /// Two modes of y by the sign of u, and noise.
    fn recording(rows: usize) -> Vec<Vec<f64>> {
        let noise =
            |seed: u64, row: usize| mix(mix(seed).wrapping_add(row as u64)) as f64 / u64::MAX as f64 * 2.0 - 1.0;
        let u: Vec<f64> = (0..rows).map(|row| noise(1, row)).collect();
        let mut y = vec![0.2];
        for k in 1..rows {
            let slope = if u[k - 1] > 0.2 { 0.8 } else { -0.5 };
            y.push(slope * y[k - 1] + u[k - 1] + 0.1 * noise(2, k));
        }
        vec![y, u]
    }

    fn source(columns: Vec<Vec<f64>>) -> MemorySource {
        let mut source = MemorySource::new(vec![Column::float("y"), Column::float("u")]);
        source.push_uniform("run", 1.0, columns);
        source
    }

    const RECIPE: &str = "[states]\ny = {}\n[inputs]\nu = \"u\"\n[narx]\nlags_out = 1\nlags_in = 1\nfolds = 3\nterms = \"all\"\n[model]\ndegree = 1\n\
                          partition = \"average,kmeans:2,refined:2,4,tree:1\"\npartition_on = [\"u\"]\n";

    /// The regions that are made anew of some rows, by partition and fold.
    fn regions(columns: Vec<Vec<f64>>) -> Vec<Vec<Partition>> {
        let source = source(columns);
        let recipe = Recipe::parse(RECIPE, "test").unwrap();
        let options = NarxOptions::new(&recipe).unwrap();
        let task = EquationTask::resolve(&one_row_ahead(&recipe, &options).unwrap(), source.columns()).unwrap();
        let base = NarxBase::new(task, &recipe).unwrap();
        let fit = Fit {
            recipe: &recipe,
            options: &options,
            base: &base,
            evidence: Evidence::Rows(&source),
            step: 1.0,
            rivals: false,
        };
        let mut notes = Vec::new();
        let partitions = fit.partitions(&mut notes, &Silent).unwrap();
        assert!(notes.is_empty(), "{notes:?}");
        let (cut, folds) = Spans::folds(&source, options.folds, 0).unwrap();
        let partitions_of_fold = fit.anew(&partitions, (&cut, &folds), &Silent).unwrap();
        // Those whose regions follow from where rows lie are made once.
        assert_eq!(partitions_of_fold.iter().map(Vec::len).collect::<Vec<_>>(), [0, 0, 3, 3, 3, 0]);
        // Beside them stands what refinements start from, once.
        assert_eq!(partitions[5].specification, Specification::KMeans(4));
        let listed = &options.partitions;
        assert!(
            start_note(listed, &partitions[5]).unwrap().contains("refined:4")
                && start_note(listed, &partitions[1]).is_none()
        );
        assert_eq!(with_starts(&listed[2..3]), listed[2..3]);
        partitions_of_fold
    }

    /// The largest difference of two rules' numbers, over the largest number; infinite where they are others.
    fn apart(a: &Rule, b: &Rule) -> f64 {
        let numbers = |rule: &Rule| match rule {
            Rule::Linear { weights, offsets } => Some([weights.concat(), offsets.clone()].concat()),
            _ => None,
        };
        match (numbers(a), numbers(b)) {
            (Some(a), Some(b)) if a.len() == b.len() => {
                let largest = a.iter().fold(0.0f64, |largest, v| largest.max(v.abs()));
                a.iter().zip(&b).fold(0.0f64, |apart, (a, b)| apart.max((a - b).abs())) / largest
            }
            _ if a == b => 0.0,
            _ => f64::INFINITY,
        }
    }

    #[test]
    fn held_out_rows_do_not_shape_their_regions() {
        let columns = recording(900);
        let before = with_threads(1, || regions(columns.clone()));
        assert_eq!(before, with_threads(3, || regions(columns.clone())), "the same on any number of threads");
        let whole = source(columns.clone());
        let (cut, folds) = Spans::folds(&whole, 3, 0).unwrap();
        // Other outputs and inputs in the spans of the second fold.
        let mut changed = columns;
        let mut row = 0;
        for (span, &fold) in cut.episodes().iter().zip(&folds) {
            for at in row..row + span.rows {
                if fold == 1 {
                    changed.iter_mut().for_each(|column| column[at] = 3.0 * column[at].sin() - 0.4);
                }
            }
            row += span.rows;
        }
        let after = regions(changed);
        // As many regions as there are modes: a descent to more of them has no one end.
        let (before, after) = (&before[2], &after[2]);
        let apart = [0, 1, 2].map(|fold| apart(&before[fold].rule, &after[fold].rule));
        // Other values give the episode another identity, and sums another order: rounding, which the descent carries on.
        assert!(apart[1] < 1e-6, "{apart:?}");
        assert!(apart[0] > 1e-3 && apart[2] > 1e-3, "the other folds have seen it: {apart:?}");
    }
}
