//! Segmentation (paper, II-E.1): the rule of every partition, for all rows and for the training rows of every fold.
//!
//! Standardisation and clustering belong to the training rows, so a partition that depends on them is made anew for every fold.

use std::collections::{BTreeMap, btree_map::Entry};

use fleetfoot_data::{Progress, Stages};
use fleetfoot_library::Expr;
use fleetfoot_model::{Partition, Rule};
use fleetfoot_stats::Moments;

use crate::{
    Error, Finding, KMeansOptions, Options, PartitionNote, Points, Problem, SampleMethod, Specification, Start, Within,
    continuous::{Ties, borders},
    kmeans,
    lattice::Lattice,
    refined::{Ground, Open, Refined, Sample},
    rows::Rows,
    segmentation::{Candidate, Segmentation},
    survey::Survey,
    tree::Grown,
};

/// Makes all partitions; `places` are the regressors that the partition columns are, where maps meet at borders. The one-region partition always comes first: it is the prior, the fallback and the yardstick of the others.
pub(crate) fn segment(
    (problem, places): (&Problem, &[usize]),
    options: &Options,
    rows: &Rows,
    survey: &Survey,
    progress: &dyn Progress,
) -> Result<Segmentation, Error> {
    let mut result = Segmentation::of_cells(Vec::new());
    let folds = if options.folds > 1 { options.folds } else { 0 };
    let mut made: Vec<Vec<Made>> = options.partitions.iter().map(|_| Vec::new()).collect();
    for held in std::iter::once(None).chain((0..folds).map(Some)) {
        // Data that refinements share exist for one training set at a time.
        let mut maker =
            Maker { problem, options, rows, survey, held, grounds: BTreeMap::new(), grown: BTreeMap::new() };
        let fold = held.map(|fold| Stages::fold(progress, fold.into(), folds.into()));
        let progress = fold.as_ref().map_or(progress, |fold| fold as &dyn Progress);
        let lattice = maker.lattice(folds, progress)?;
        if held.is_none() {
            result.notes.extend(lattice.as_ref().and_then(Lattice::note));
        }
        for (specification, made) in options.partitions.iter().zip(&mut made) {
            let wanted = match specification {
                Specification::Null | Specification::Average => false,
                Specification::Labels { within: Within::Whole, .. } => held.is_none(),
                _ => true,
            };
            if wanted {
                let mut partitions = match (specification.joined(), &lattice) {
                    (Some(k), Some(lattice)) => not_joined_yet(k, specification, lattice),
                    _ => {
                        progress.stage(&format!("partition {specification}"));
                        maker.make(specification, progress)?
                    }
                };
                partitions.ties = options.continuous.then(|| maker.ties(&partitions.partition.rule, places));
                made.push(partitions);
            }
        }
        result.lattices.extend(lattice);
    }
    for (specification, made) in options.partitions.iter().zip(made) {
        result.add(specification, made, usize::from(folds));
    }
    Ok(result)
}

/// A partition whose cells will be joined when their rows are summed.
fn not_joined_yet(k: usize, specification: &Specification, lattice: &Lattice) -> Made {
    let rule = Rule::Joined { cells: lattice.rule.clone(), regions: Vec::new() };
    let count = lattice.count();
    let partition = Partition { specification: specification.to_string(), rule, ..lattice.partition.clone() };
    let few = || PartitionNote::new(specification, Finding::FewCells { cells: count });
    Made { partition, label: None, note: (count < k).then(few), objective: Vec::new(), ties: None, open: None }
}

impl Segmentation {
    /// Adds the partitions of a specification: on all rows, then on the training rows of every fold, or for all of them
    /// if there is one only.
    fn add(&mut self, specification: &Specification, made: Vec<Made>, folds: usize) {
        let first = if made.is_empty() { 0 } else { self.partitions.len() };
        let place = |fold: usize| if made.len() > 1 { first + 1 + fold } else { first };
        let by_fold = (0..folds).map(place).collect();
        let (mut objective, mut ties) = (Vec::new(), Vec::new());
        for (at, made) in made.into_iter().enumerate() {
            if at == 0 {
                self.notes.extend(made.note);
                objective = made.objective;
            }
            ties.extend(made.ties);
            self.open.extend(made.open.map(|open| (self.partitions.len(), open)));
            self.partitions.push(made.partition);
            self.labels.push(made.label);
            self.sets.push(at);
        }
        self.candidates.push(Candidate { specification: specification.clone(), full: first, by_fold, ties, objective });
    }
}

/// A partition of one training set.
struct Made {
    partition: Partition,
    label: Option<usize>,
    note: Option<PartitionNote>,
    objective: Vec<f64>,
    ties: Option<Ties>,
    open: Option<Open>,
}

/// Makes the partitions of one training set.
struct Maker<'a> {
    problem: &'a Problem,
    options: &'a Options,
    rows: &'a Rows,
    survey: &'a Survey,
    held: Option<u16>,
    /// Shared start of all refinements, once it is made: of all rows, or of those of a label (its column, its number).
    grounds: BTreeMap<Option<(usize, usize)>, Ground>,
    /// The same of trees.
    grown: BTreeMap<Option<(usize, usize)>, Grown>,
}

impl Maker<'_> {
    /// Centres and scales of the partition columns, over the training rows.
    fn units(&self) -> (Vec<f64>, Vec<f64>) {
        let moments = self.survey.training_moments(self.held).unwrap_or_else(|| Moments::new(self.rows.partition));
        let scale = (0..self.rows.partition)
            .map(|column| match moments.deviation(column) {
                // A column that never changes separates nothing.
                deviation if deviation > 1e-12 * moments.mean[column].abs() => deviation,
                _ => 1.0,
            })
            .collect();
        (moments.mean, scale)
    }

    /// Those of columns whose values people shall read.
    fn as_they_are(&self) -> (Vec<f64>, Vec<f64>) {
        (vec![0.0; self.rows.partition], vec![1.0; self.rows.partition])
    }

    /// Cells for the partitions that are joined of cells, where there are any.
    fn lattice(&mut self, folds: u16, progress: &dyn Progress) -> Result<Option<Lattice>, Error> {
        let Some(regions) = self.options.partitions.iter().filter_map(Specification::joined).max() else {
            return Ok(None);
        };
        progress.stage(&format!("cells of lattice:{regions}"));
        let (centre, scale) = self.units();
        let ground = self.ground(None, (&centre, &scale));
        let borders = ground.map_or(Ok(Rule::Whole), |ground| ground.borders(progress))?;
        let columns = self.problem.partition_columns.clone();
        let partition = Partition { columns, centre, scale, ..Partition::whole() };
        let training = self.example_rows(None);
        let of = |column: &Vec<f64>| training.iter().map(|&row| column[row]).collect();
        let places: Vec<Vec<f64>> = self.survey.examples.columns[..self.rows.partition].iter().map(of).collect();
        let (rows, shape) = (self.survey.counts.complete as usize, (self.rows.regressors, self.rows.targets));
        let made = (partition, &borders);
        Lattice::new((rows, &places), shape, (regions, folds), made, self.options.seed, progress).map(Some)
    }

    fn make(&mut self, specification: &Specification, progress: &dyn Progress) -> Result<Made, Error> {
        let (mut centre, mut scale) = if specification.is_tree() { self.as_they_are() } else { self.units() };
        let mut columns = self.problem.partition_columns.clone();
        let runs = self.survey.kept.training_runs(self.held);
        let (mut objective, mut open) = (Vec::new(), None);
        let (rule, label, note) = match specification {
            Specification::Null | Specification::Average | Specification::Lattice(_) => (Rule::Whole, None, None),
            Specification::ZScore(radius) => (Rule::Ball { radius: *radius }, None, None),
            Specification::ZBox(half) => (Rule::Box { half: *half }, None, None),
            Specification::KMeans(k) => {
                let (rule, note) = self.cluster(*k, &runs, |_| true, &centre, &scale, progress)?;
                (rule, None, note)
            }
            Specification::Refined(k) => {
                let refined = self.refine(*k, None, (&centre, &scale), progress)?;
                (objective, open) = (refined.0.objective, refined.0.open);
                (refined.0.rule, None, refined.1)
            }
            Specification::Tree(depth) => {
                let (rule, note) = self.cut(*depth, None, progress)?;
                (rule, None, note)
            }
            Specification::Labels { column, within } => {
                let index = self.rows.labels.iter().position(|name| name == column).unwrap_or(0);
                let values = self.survey.labels[index].clone();
                let mut note = None;
                let mut rules = Vec::with_capacity(values.len());
                for (number, &value) in values.iter().enumerate() {
                    let (rule, more) = match within {
                        Within::Whole => (Rule::Whole, None),
                        Within::KMeans(k) => {
                            let labels = &self.survey.kept.columns[self.rows.partition + index];
                            let of_label = |row: usize| labels[row] == value;
                            let (rule, note) = self.cluster(*k, &runs, of_label, &centre, &scale, progress)?;
                            let name = self.rows.label_columns[index].label(value);
                            (rule, note.map(|note| note.within(&format!("{column} {name}"))))
                        }
                        Within::Refined(k) => {
                            let of = Some((index, number));
                            let (refined, note) = self.refine(*k, of, (&centre, &scale), progress)?;
                            let name = self.rows.label_columns[index].label(value);
                            (refined.rule, note.map(|note| note.within(&format!("{column} {name}"))))
                        }
                        Within::Tree(depth) => self.cut(*depth, Some((index, number)), progress)?,
                    };
                    note = note.or(more);
                    rules.push(rule);
                }
                columns.push(Expr::column(column.as_str()));
                centre.push(0.0);
                scale.push(1.0);
                let names = values.iter().map(|&value| self.rows.label_columns[index].label(value)).collect();
                (Rule::Labels { values, names, rules, unseen: self.options.unseen }, Some(index), note)
            }
        };
        let specification = specification.to_string();
        let partition = Partition { specification, columns, centre, scale, rule, ..Partition::whole() };
        Ok(Made { partition, label, note, objective, ties: None, open })
    }

    /// Free numbers of maps that meet at the borders of a rule.
    fn ties(&self, rule: &Rule, places: &[usize]) -> Ties {
        let (centre, scale) = self.units();
        let rows = self.example_rows(None);
        let columns: Vec<Vec<f64>> = self.survey.examples.columns[..self.rows.partition]
            .iter()
            .map(|column| rows.iter().map(|&row| column[row]).collect())
            .collect();
        Ties::new(rule.count(), borders(rule, &columns, (&centre, &scale)), places, (&centre, &scale))
    }

    /// Kept training rows that regions are refined on: all, or those of a label.
    fn example_rows(&self, label: Option<(usize, usize)>) -> Vec<usize> {
        let kept = &self.survey.examples;
        let wanted = |row: &usize| {
            label.is_none_or(|(column, number)| {
                kept.columns[self.rows.example_width() + column][*row] == self.survey.labels[column][number]
            })
        };
        kept.training_runs(self.held).into_iter().flatten().filter(wanted).collect()
    }

    /// Sample that the kept rows are, with their share of all rows; `None` if all are kept. Maps that meet are tied at
    /// the borders of the sample.
    fn sample(&self) -> Option<Sample> {
        let (kept, all) = (self.survey.examples.rows(), self.survey.counts.complete);
        let count = self.options.partitions.iter().filter(|one| matches!(one, Specification::Refined(_))).count();
        let borders = count * (1 + usize::from(self.options.folds));
        (kept < all && !self.options.continuous).then(|| Sample { share: kept as f64 / all as f64, borders })
    }

    /// Regions that fit the dynamics of the kept training rows, all or those of a label.
    fn refine(
        &mut self,
        k: usize,
        label: Option<(usize, usize)>,
        units: (&[f64], &[f64]),
        progress: &dyn Progress,
    ) -> Result<(Refined, Option<PartitionNote>), Error> {
        let sample = if label.is_none() { self.sample() } else { None };
        let Some(ground) = self.ground(label, units) else {
            return Ok((Refined { rule: Rule::Whole, objective: Vec::new(), open: None }, None));
        };
        let refined = ground.refine(k, sample, progress)?;
        let (count, name) = (refined.rule.count(), Specification::Refined(k));
        let (kept, all) = (self.survey.examples.rows(), self.survey.counts.complete);
        let note = if count < k {
            Some(Finding::FewRegions { regions: count })
        } else if self.survey.examples_lack_memory {
            Some(Finding::Sampled { method: SampleMethod::Refined, kept, all })
        } else {
            None
        };
        let note = note.map(|finding| PartitionNote::new(name, finding));
        Ok((refined, note))
    }

    /// The kept training rows, all or those of a label, for refinements; `None` where none weigh anything.
    fn ground(&mut self, label: Option<(usize, usize)>, units: (&[f64], &[f64])) -> Option<&mut Ground> {
        let rows = if self.grounds.contains_key(&label) { Vec::new() } else { self.example_rows(label) };
        match self.grounds.entry(label) {
            Entry::Occupied(known) => Some(known.into_mut()),
            Entry::Vacant(place) => {
                let shape = (self.rows.partition, self.rows.regressors, self.rows.targets);
                let columns = &self.survey.examples.columns[..self.rows.example_width()];
                Some(place.insert(Ground::new(columns, shape, units, &rows, self.options.seed)?))
            }
        }
    }

    /// A tree of cuts that fit the dynamics of the kept training rows, all or those of a label.
    fn cut(
        &mut self,
        depth: usize,
        label: Option<(usize, usize)>,
        progress: &dyn Progress,
    ) -> Result<(Rule, Option<PartitionNote>), Error> {
        let rows = if self.grown.contains_key(&label) { Vec::new() } else { self.example_rows(label) };
        let grown = match self.grown.entry(label) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => {
                let shape = (self.rows.partition, self.rows.regressors, self.rows.targets);
                let columns = &self.survey.examples.columns[..self.rows.example_width()];
                let Some(grown) = Grown::new(columns, shape, &rows) else { return Ok((Rule::Whole, None)) };
                place.insert(grown)
            }
        };
        let rule = grown.rule(depth, progress)?;
        let (kept, all) = (self.survey.examples.rows(), self.survey.counts.complete);
        let sampled = Finding::Sampled { method: SampleMethod::Grown, kept, all };
        let note = || PartitionNote::new(Specification::Tree(depth), sampled);
        Ok((rule, self.survey.examples_lack_memory.then(note)))
    }

    /// k-means on the kept training rows that `wanted` selects.
    fn cluster(
        &self,
        k: usize,
        runs: &[std::ops::Range<usize>],
        wanted: impl Fn(usize) -> bool,
        centre: &[f64],
        scale: &[f64],
        progress: &dyn Progress,
    ) -> Result<(Rule, Option<PartitionNote>), Error> {
        let mut points = Points::new(self.rows.partition);
        for run in runs {
            let mut from = run.start;
            // Runs of wanted rows are appended without a copy of their own.
            while from < run.end {
                let start = (from..run.end).find(|&row| wanted(row)).unwrap_or(run.end);
                let end = (start..run.end).find(|&row| !wanted(row)).unwrap_or(run.end);
                let columns: Vec<&[f64]> =
                    self.survey.kept.columns[..self.rows.partition].iter().map(|column| &column[start..end]).collect();
                points.append(&columns, centre, scale)?;
                from = end;
            }
        }
        if points.rows() == 0 {
            return Ok((Rule::Whole, None));
        }
        let options = KMeansOptions { k, max_iterations: self.options.iterations, ..KMeansOptions::default() };
        let start = match &self.options.start {
            Some(centroids) => Start::Centroids(centroids),
            None => Start::PlusPlus { seed: self.options.seed, restarts: self.options.restarts },
        };
        let kmeans = kmeans(&points, start, &options, progress)?;
        let clusters = kmeans.centroids.len() / self.rows.partition.max(1);
        let kept = self.survey.kept.rows();
        let all = self.survey.counts.complete;
        let finding = if clusters < k {
            Some(Finding::FewPositions { positions: clusters })
        } else if !kmeans.converged {
            Some(Finding::NotConverged { iterations: kmeans.iterations })
        } else if kept < all {
            Some(Finding::Sampled { method: SampleMethod::Clustered, kept, all })
        } else {
            None
        };
        let note = finding.map(|finding| PartitionNote::new(Specification::KMeans(k), finding));
        Ok((
            Rule::voronoi(kmeans.centroids.chunks_exact(self.rows.partition.max(1)).map(<[f64]>::to_vec).collect()),
            note,
        ))
    }
}
