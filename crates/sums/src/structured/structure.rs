//! Structure of the block matrix B of equations (18) and (19), without its numbers: the coefficients of each task.

use std::ops::Range;

/// The shape of a structured regression.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Structure {
    /// Number of candidate functions of every latent.
    pub functions: Vec<usize>,
    /// The tasks.
    pub tasks: Vec<TaskShape>,
}

/// The shape of one task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TaskShape {
    /// Its latents, in the order of its columns; the target's column follows.
    pub latents: Vec<usize>,
    /// True if one of its columns is constant: scales are then deviations about the mean.
    pub centred: bool,
    /// True for a prior.
    pub prior: bool,
}

impl Structure {
    /// Number of coefficients, p.
    pub fn coefficients(&self) -> usize {
        self.functions.iter().sum()
    }

    /// The coefficients of a latent.
    pub fn range(&self, latent: usize) -> Range<usize> {
        let first = self.functions[..latent].iter().sum();
        first..first + self.functions[latent]
    }

    /// The coefficient that every column of a task belongs to, the target's left out.
    pub fn columns(&self, task: usize) -> Vec<usize> {
        self.tasks[task].latents.iter().flat_map(|&latent| self.range(latent)).collect()
    }

    /// The latent of every coefficient.
    pub fn latent_of(&self) -> Vec<usize> {
        self.functions.iter().enumerate().flat_map(|(latent, &count)| vec![latent; count]).collect()
    }
}
