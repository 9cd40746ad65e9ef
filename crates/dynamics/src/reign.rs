//! The best of several models at every horizon (Fig. 8 of Buchan, Haldane, Fearing, "Automatic Identification of
//! Dynamic Piecewise Affine Models for a Running Robot": the Pareto frontier).

use fleetfoot_stats::Estimate;

/// Steps at which one model has the lowest score.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reign {
    /// Index of the model.
    pub model: usize,
    /// First step, from 1.
    pub first: usize,
    /// Last step.
    pub last: usize,
}

/// The lowest score at each step, as spans; `scores` are one list of steps a model. Scores that are no numbers win nothing, and of equal ones the first
/// model's does.
pub fn reigns(scores: &[&[Estimate]]) -> Vec<Reign> {
    let steps = scores.iter().map(|list| list.len()).min().unwrap_or(0);
    let mut reigns: Vec<Reign> = Vec::new();
    for step in 0..steps {
        let finite = (0..scores.len()).filter(|&model| scores[model][step].value.is_finite());
        let Some(best) = finite.min_by(|&a, &b| scores[a][step].value.total_cmp(&scores[b][step].value)) else {
            continue;
        };
        match reigns.last_mut() {
            Some(last) if last.model == best && last.last == step => last.last = step + 1,
            _ => reigns.push(Reign { model: best, first: step + 1, last: step + 1 }),
        }
    }
    reigns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reigns_change_where_the_curves_cross() {
        let list = |values: &[f64]| -> Vec<Estimate> {
            values.iter().map(|&value| Estimate { value, low: value, high: value }).collect()
        };
        let (fine, coarse) = (list(&[0.1, 0.2, 0.5, 0.9, f64::NAN]), list(&[0.2, 0.3, 0.4, 0.9, 0.5]));
        let expected = [(0, 1, 2), (1, 3, 3), (0, 4, 4), (1, 5, 5)];
        let result = reigns(&[&fine, &coarse]);
        assert_eq!(result.iter().map(|r| (r.model, r.first, r.last)).collect::<Vec<_>>(), expected);
        assert!(reigns(&[]).is_empty());
    }
}
