//! The group penalty as certificates see it.

use super::block::Block;
use crate::shape::Shape;

/// All blocks of a problem at one lambda (in units of the target's deviation).
pub(super) struct AtLambda<'a> {
    pub(super) blocks: &'a [Block],
    /// The block of every column (p).
    pub(super) of: &'a [Option<usize>],
    pub(super) lambda: f64,
}

impl Shape for AtLambda<'_> {
    fn value(&self, delta: &[f64]) -> f64 {
        self.blocks.iter().map(|block| block.at(self.lambda).value(&block.coefficients(delta))).sum()
    }

    fn limit(&self, j: usize) -> f64 {
        let Some(block) = self.of[j].map(|at| &self.blocks[at]) else { return f64::INFINITY };
        let rule = block.at(self.lambda);
        let unit = block.columns.binary_search(&j).map_or(1.0, |at| block.units[at]);
        unit * (rule.l1 + rule.group)
    }

    fn goals(&self, delta: &[f64], gradient: &[f64]) -> Vec<f64> {
        let mut goals = gradient.to_vec();
        for block in self.blocks {
            let gradients = block.gradients(gradient);
            let goals_of_block = block.at(self.lambda).goals(&block.coefficients(delta), &gradients);
            for (at, &j) in block.columns.iter().enumerate() {
                // Remaining columns are left as they are, to the last bit.
                if goals_of_block[at] != gradients[at] {
                    goals[j] = block.units[at] * goals_of_block[at];
                }
            }
        }
        goals
    }

    fn violation(&self, delta: &[f64], gradient: &[f64]) -> f64 {
        let violation = |block: &Block| {
            let (v, gradient) = (block.coefficients(delta), block.gradients(gradient));
            block.at(self.lambda).violation(&v, &gradient)
        };
        self.blocks.iter().map(violation).fold(0.0, f64::max)
    }

    fn feasible(&self, gradient: &[f64]) -> f64 {
        self.blocks.iter().fold(1.0, |scale: f64, block| {
            // Without a penalty only a gradient of zero is feasible: any other is infinitely far.
            let critical = block.critical(gradient, |_| 0.0);
            if critical > self.lambda { scale.min(self.lambda / critical) } else { scale }
        })
    }

    fn slack(&self, scale: f64, delta: &[f64], gradient: &[f64]) -> f64 {
        let slack = |block: &Block| {
            let (v, gradient) = (block.coefficients(delta), block.gradients(gradient));
            let along: f64 = v.iter().zip(&gradient).map(|(v, gradient)| v * gradient).sum();
            (block.at(self.lambda).value(&v) - scale * along).max(0.0)
        };
        self.blocks.iter().map(slack).sum()
    }
}
