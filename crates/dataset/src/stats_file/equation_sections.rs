//! The equations of a statistic as sections of its file.

use fleetfoot_stats::{Keyed, Sum};
use fleetfoot_sums::system::{SystemPlan, SystemSums};
use fleetfoot_task::SettledDifference;

use super::{
    equation_records::{DifferenceRecord, EpisodeSumsRecord, EquationsRecord, GroupRecord, WeakRecord},
    records::{record, to_bytes},
};
use crate::{
    statistic_error::StatisticError,
    stats_file::{EquationGroup, EquationStatistic, container::Sections},
};

/// The sums of a section, of whatever shape.
pub(super) fn sums<S: Sum>(sections: &mut Sections<'_>, name: &str, plan: &str) -> Result<Keyed<S>, StatisticError> {
    let bytes = sections.next(name)?;
    let place = format!("section `{name}`");
    Keyed::from_bytes(plan, bytes).map_err(|error| sections.damaged(&place, &error.to_string()))
}

/// Sections of every group of equations.
pub(super) const GROUP_SECTIONS: [&str; 5] = ["products", "moments", "measured", "sampled", "rows"];

impl EquationGroup {
    /// The bytes of [`GROUP_SECTIONS`].
    pub(super) fn sections(&self) -> [Vec<u8>; 5] {
        let SystemSums { grams, moments, also, sampled, episodes } = &self.sums;
        let rows = to_bytes(&EpisodeSumsRecord::all(episodes));
        [grams.to_bytes(), moments.to_bytes(), also.to_bytes(), sampled.to_bytes(), rows]
    }
}

impl EquationStatistic {
    pub(super) fn record(&self) -> Result<EquationsRecord, StatisticError> {
        let difference = |settled: &Option<SettledDifference>| settled.as_ref().map(DifferenceRecord::new);
        let weak = |group: &EquationGroup| group.plan.system.weak.as_ref().map(WeakRecord::new).transpose();
        Ok(EquationsRecord {
            differences: self.differences.iter().map(difference).collect(),
            weak: self.groups.iter().map(weak).collect::<Result<_, _>>()?,
            groups: self.groups.iter().map(|group| GroupRecord::new(&group.plan)).collect::<Result<_, _>>()?,
        })
    }
}

/// The groups of equations that follow their record.
pub(super) fn systems(
    sections: &mut Sections<'_>,
    equations: EquationsRecord,
) -> Result<EquationStatistic, StatisticError> {
    let damaged = |problem: String| sections.damaged("section `systems`", &problem);
    let settled = |one: Option<DifferenceRecord>| one.map(DifferenceRecord::into_settled).transpose();
    let differences = equations.differences.into_iter().map(settled).collect::<Result<_, _>>().map_err(damaged)?;
    let weak = equations.weak.into_iter().chain(std::iter::repeat_with(|| None));
    let plans = equations.groups.into_iter().zip(weak).map(|(group, weak)| group.into_plan(weak));
    let plans: Vec<SystemPlan> = plans.collect::<Result<_, _>>().map_err(damaged)?;
    let mut groups = Vec::with_capacity(plans.len());
    for plan in plans {
        let hash = plan.hash();
        let [products, moments, measured, sampled, rows] = GROUP_SECTIONS;
        let sums = SystemSums {
            grams: sums(sections, products, &hash)?,
            moments: sums(sections, moments, &hash)?,
            also: sums(sections, measured, &hash)?,
            sampled: sums(sections, sampled, &hash)?,
            episodes: EpisodeSumsRecord::into_episodes(record(sections, rows)?),
        };
        groups.push(EquationGroup { plan, sums });
    }
    Ok(EquationStatistic { differences, groups })
}

/// Expressions that cannot be kept in a file.
pub fn refuse_unprintable(statistic: &EquationStatistic) -> Result<(), StatisticError> {
    statistic.record().map(|_| ())
}
