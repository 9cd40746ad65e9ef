//! A system from the statistics of separate tasks, as a file of statistics holds them.

use fleetfoot_data::packed_row;
use fleetfoot_library::Expr;
use fleetfoot_stats::{Bank, Gram, Preconditioner};

use crate::structured::{Regression, Scanned};

use super::{
    SystemError, SystemScan, Unit,
    ranges::{EMPTY, widen},
    statistic::{Region, Sums},
};

impl SystemScan {
    /// The statistic of a system whose equations were scanned as tasks, `target_t = f_t(x)`, each with the same candidate functions.
    ///
    /// The products of two targets are not in it: the covariance of two equations' residuals is NaN.
    ///
    /// # Errors
    /// There is no task, one is not of that form, or its statistic has other coordinates.
    pub fn of_tasks(scanned: &Scanned, regression: &Regression) -> Result<Self, SystemError> {
        let functions = functions(regression)?;
        let p = functions.len();
        let parts: Vec<&Preconditioner> = scanned.tasks.iter().map(|task| &task.preconditioner).collect();
        let fits = |part: &Preconditioner| part.regressors() == p && part.targets() == 1;
        let preconditioner = Preconditioner::joined(&parts)
            .filter(|_| parts.len() == regression.tasks.len() && parts.iter().all(|part| fits(part)));
        let preconditioner = preconditioner.ok_or(SystemError::TaskCoordinates)?;
        let (mut units, mut grams) = (Vec::new(), Vec::new());
        let mut streams: Vec<_> = scanned.tasks.iter().map(|task| task.stats.iter()).collect();
        loop {
            let members: Vec<_> = streams.iter_mut().filter_map(Iterator::next).collect();
            let Some((key, first)) = members.first() else {
                break;
            };
            if members.len() < streams.len() || members.iter().any(|(other, _)| other != key) {
                return Err(SystemError::TaskCoordinates);
            }
            if first.rows > 0 {
                units.push(Unit { episode: key.episode, chunk: key.chunk, rows: first.rows });
                grams.push(joined(&members.iter().map(|(_, gram)| *gram).collect::<Vec<_>>(), p));
            }
        }
        let mut ranges = vec![EMPTY; p];
        let latent = regression.first(regression.tasks[0].terms[0].latent);
        scanned.ranges.values().for_each(|some| widen(&mut ranges, &some[latent..latent + p]));
        Ok(Self {
            functions: p,
            constant: functions.iter().position(|function| function.as_number() == Some(1.0)),
            regions: vec![Region { members: (0..units.len()).collect(), sums: Sums::Grams(Bank::new(&grams)), ranges }],
            units,
            preconditioner,
            also: scanned.also.total(|_| true).unwrap_or_else(|| Gram::new(0)),
            counts: scanned.counts(),
            unassigned: 0,
        })
    }
}

/// The functions that all tasks share.
fn functions(regression: &Regression) -> Result<&[Expr], SystemError> {
    let mut shared: Option<&[Expr]> = None;
    for task in &regression.tasks {
        let functions = match task.terms.as_slice() {
            [term] if !task.prior && term.coefficient.as_number() == Some(1.0) => {
                regression.latents[term.latent].functions.as_slice()
            }
            _ => return Err(SystemError::TaskShape { task: task.name.clone() }),
        };
        if **shared.get_or_insert(functions) != *functions {
            return Err(SystemError::TaskShape { task: task.name.clone() });
        }
    }
    shared.ok_or(SystemError::NoTarget)
}

/// One statistic of the p regressors and all targets from those of every target.
fn joined(parts: &[&Gram], p: usize) -> Gram {
    let mut gram = Gram::new(p + parts.len());
    (gram.rows, gram.weight) = (parts[0].rows, parts[0].weight);
    gram.mean[..p].copy_from_slice(&parts[0].mean[..p]);
    gram.scatter[..packed_row(p)].copy_from_slice(&parts[0].scatter[..packed_row(p)]);
    for (target, part) in (p..).zip(parts) {
        gram.mean[target] = part.mean[p];
        let entries = &mut gram.scatter[packed_row(target)..packed_row(target + 1)];
        entries[..p].copy_from_slice(&part.scatter[packed_row(p)..packed_row(p) + p]);
        entries[p..target].fill(f64::NAN);
        entries[target] = part.get(p, p);
    }
    gram
}
