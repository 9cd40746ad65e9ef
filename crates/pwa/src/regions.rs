//! Segmentation (paper, II-E.1): the rule of every partition, for all rows and for the training rows of every fold.
//!
//! Standardisation and clustering belong to the training rows, so a partition that depends on them is made anew for every fold.

use fleetfoot_data::Progress;
use fleetfoot_library::Expr;
use fleetfoot_model::{Partition, Rule};
use fleetfoot_stats::Moments;

use crate::{Error, KMeansOptions, Options, Points, Problem, Specification, Start, kmeans, rows::Rows, survey::Survey};

/// One kind of partition: made on all rows, and on the training rows of every fold.
pub(crate) struct Candidate {
    pub(crate) specification: Specification,
    /// Index of the partition made on all rows.
    pub(crate) full: usize,
    /// Index of the partition for each fold; the same as `full` where the partition does not depend on the rows.
    pub(crate) by_fold: Vec<usize>,
}

/// All partitions that share the second pass.
pub(crate) struct Segmentation {
    pub(crate) partitions: Vec<Partition>,
    /// Label column (index into [`Rows::labels`]) of each partition that has one.
    pub(crate) labels: Vec<Option<usize>>,
    pub(crate) candidates: Vec<Candidate>,
    /// What the user should know.
    pub(crate) notes: Vec<String>,
}

/// Makes all partitions. The one-region partition always comes first: it is the prior, the fallback and the yardstick of the others.
pub(crate) fn segment(
    problem: &Problem,
    options: &Options,
    rows: &Rows,
    survey: &Survey,
    progress: &dyn Progress,
) -> Result<Segmentation, Error> {
    let mut result = Segmentation {
        partitions: vec![Partition::whole()],
        labels: vec![None],
        candidates: Vec::new(),
        notes: Vec::new(),
    };
    let folds = if options.folds > 1 { options.folds } else { 0 };
    for specification in &options.partitions {
        let mut make = |held: Option<u16>| -> Result<usize, Error> {
            let maker = Maker { problem, options, rows, survey, held };
            let (partition, label, note) = maker.make(specification, progress)?;
            if let (Some(note), None) = (note, held) {
                result.notes.push(note);
            }
            result.partitions.push(partition);
            result.labels.push(label);
            Ok(result.partitions.len() - 1)
        };
        let (full, by_fold) = match specification {
            Specification::Null | Specification::Average => (0, vec![0; usize::from(folds)]),
            Specification::Labels { k: 0 | 1, .. } => {
                let full = make(None)?;
                (full, vec![full; usize::from(folds)])
            }
            _ => (make(None)?, (0..folds).map(|fold| make(Some(fold))).collect::<Result<_, _>>()?),
        };
        result.candidates.push(Candidate { specification: specification.clone(), full, by_fold });
    }
    Ok(result)
}

/// Makes the partitions of one training set.
struct Maker<'a> {
    problem: &'a Problem,
    options: &'a Options,
    rows: &'a Rows,
    survey: &'a Survey,
    held: Option<u16>,
}

impl Maker<'_> {
    fn make(
        &self,
        specification: &Specification,
        progress: &dyn Progress,
    ) -> Result<(Partition, Option<usize>, Option<String>), Error> {
        let moments = self.survey.training_moments(self.held).unwrap_or_else(|| Moments::new(self.rows.partition));
        let mut centre = moments.mean.clone();
        let mut scale: Vec<f64> = (0..self.rows.partition)
            .map(|column| match moments.deviation(column) {
                // A column that never changes separates nothing.
                deviation if deviation > 1e-12 * moments.mean[column].abs() => deviation,
                _ => 1.0,
            })
            .collect();
        let mut columns = self.problem.partition_columns.clone();
        let runs = self.survey.training_runs(self.held);
        let (rule, label, note) = match specification {
            Specification::Null | Specification::Average => (Rule::Whole, None, None),
            Specification::ZScore(radius) => (Rule::Ball { radius: *radius }, None, None),
            Specification::KMeans(k) => {
                let (rule, note) = self.cluster(*k, &runs, |_| true, &centre, &scale, progress)?;
                (rule, None, note)
            }
            Specification::Labels { column, k } => {
                let index = self.rows.labels.iter().position(|name| name == column).unwrap_or(0);
                let values = self.survey.labels[index].clone();
                let mut note = None;
                let mut rules = Vec::with_capacity(values.len());
                for &value in &values {
                    rules.push(if *k > 1 {
                        let of_label = |row: usize| self.survey.kept_labels[index][row] == value;
                        let (rule, more) = self.cluster(*k, &runs, of_label, &centre, &scale, progress)?;
                        note = note.or(more);
                        rule
                    } else {
                        Rule::Whole
                    });
                }
                columns.push(Expr::column(column.as_str()));
                centre.push(0.0);
                scale.push(1.0);
                let names = values.iter().map(|&value| self.rows.label_columns[index].label(value)).collect();
                (Rule::Labels { values, names, rules, unseen: self.options.unseen }, Some(index), note)
            }
        };
        let partition =
            Partition { specification: specification.to_string(), columns, centre, scale, rule, regions: Vec::new() };
        Ok((partition, label, note))
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
    ) -> Result<(Rule, Option<String>), Error> {
        let mut points = Points::new(self.rows.partition);
        for run in runs {
            let mut from = run.start;
            // Runs of wanted rows are appended without a copy of their own.
            while from < run.end {
                let start = (from..run.end).find(|&row| wanted(row)).unwrap_or(run.end);
                let end = (start..run.end).find(|&row| !wanted(row)).unwrap_or(run.end);
                let columns: Vec<&[f64]> = self.survey.kept.iter().map(|column| &column[start..end]).collect();
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
        let found = kmeans(&points, start, &options, progress)?;
        let clusters = found.centroids.len() / self.rows.partition.max(1);
        let kept = self.survey.kept_rows();
        let note = if clusters < k {
            Some(format!("kmeans:{k}: only {clusters} different positions to cluster"))
        } else if !found.converged {
            Some(format!("kmeans:{k}: not converged after {} iterations; raise --iterations", found.iterations))
        } else if kept < self.survey.complete {
            let all = self.survey.complete;
            Some(format!("kmeans:{k}: clustered a sample of {kept} of {all} rows; raise --memory for more"))
        } else {
            None
        };
        Ok((
            Rule::voronoi(found.centroids.chunks_exact(self.rows.partition.max(1)).map(<[f64]>::to_vec).collect()),
            note,
        ))
    }
}
