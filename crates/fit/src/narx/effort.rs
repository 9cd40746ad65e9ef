//! Limit of a search. It counts evaluations and never time, so that the same input gives the same model.

use fleetfoot_recipe::Effort;
use fleetfoot_sparse::narx::NarxOrder;

/// Evaluations spent of the effort.
#[derive(Debug, Clone)]
pub(crate) struct Budget {
    pub(crate) effort: Effort,
    pub(crate) spent: u64,
    /// Orders that were to be tried and were not.
    pub(crate) cut: Vec<NarxOrder>,
}

impl Budget {
    pub(crate) fn new(effort: Effort) -> Self {
        Self { effort, spent: 0, cut: Vec::new() }
    }

    /// The orders, the cheapest first, that are within a share of the limit; the others are kept in mind. `always`: those that are tried whatever they cost.
    pub(crate) fn admit(
        &mut self,
        orders: Vec<NarxOrder>,
        share: f64,
        cost: impl Fn(NarxOrder) -> u64,
        always: impl Fn(NarxOrder) -> bool,
    ) -> Vec<NarxOrder> {
        let limit = (self.effort.limit() as f64 * share) as u64;
        let mut orders: Vec<(bool, u64, NarxOrder)> =
            orders.into_iter().map(|order| (!always(order), cost(order), order)).collect();
        orders.sort();
        orders.dedup();
        let mut admitted = Vec::new();
        for (optional, cost, order) in orders {
            let after = self.spent.saturating_add(cost);
            if optional && after > limit {
                self.cut.push(order);
            } else {
                self.spent = after;
                admitted.push(order);
            }
        }
        admitted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(outputs: usize) -> NarxOrder {
        NarxOrder { outputs, inputs: 1, degree: 1, direct: false, every: 1 }
    }

    #[test]
    fn cheap_jobs_run_first() {
        let mut budget = Budget::new(Effort::Low);
        let cost = |order: NarxOrder| order.outputs as u64 * 60_000_000;
        let orders = || vec![order(3), order(1), order(2), order(1), order(7)];
        let taken = budget.admit(orders(), 1.0, cost, |order| order.outputs == 7);
        // The one that is always tried takes more than there is; nothing else has room.
        assert_eq!((taken, budget.cut.len()), (vec![order(7)], 3));
        let mut budget = Budget::new(Effort::Low);
        assert_eq!(budget.admit(orders(), 1.0, cost, |_| false), [order(1), order(2)]);
        assert_eq!((budget.spent, budget.cut.as_slice()), (180_000_000, &[order(3), order(7)][..]));
        assert_eq!(budget.admit(vec![order(2)], 1.0, cost, |_| false), [order(2)]);
    }
}
