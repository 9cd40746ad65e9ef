//! Latents that equations use, in groups that are one affine map a region each.

use std::collections::BTreeMap;

use fleetfoot_library::{Leaf, Program, UnknownColumn};

use crate::{Basis, Equation, Model};

/// Latents that share a library, a partition and a basis.
#[derive(Debug, Clone, PartialEq)]
pub struct LatentGroup {
    /// Index of the library.
    pub library: usize,
    /// Index of the partition.
    pub partition: usize,
    /// Indices of the latents, ascending.
    pub latents: Vec<usize>,
    /// Functions of the library that are in use, ascending.
    pub functions: Vec<usize>,
    /// The functions that they have beside those of the library.
    pub basis: Option<Basis>,
}

impl LatentGroup {
    /// Places of the basis' inputs among the functions in use; none where the latents do not depend on the basis.
    pub fn inputs(&self) -> Vec<usize> {
        let place = |input: &usize| self.functions.iter().position(|function| function == input);
        self.basis.iter().flat_map(|basis| basis.inputs()).filter_map(place).collect()
    }
}

/// A right side reads a latent at another row.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the equation {equation} reads `{latent}` {lag} rows earlier; latents are known at the current row only")]
pub struct LaggedLatent {
    /// The equation's left side.
    pub equation: String,
    /// The latent.
    pub latent: String,
    /// Rows back in time.
    pub lag: i32,
}

impl Model {
    /// The latents in the right sides of some equations, by library, partition and basis. `names` are those of the
    /// columns and, behind them, of the model's latents.
    ///
    /// Functions that no latent depends on are not in use, except of the library `whole`, if any.
    ///
    /// # Errors
    /// [`UnknownColumn`] and [`LaggedLatent`].
    pub fn latent_groups<E: From<UnknownColumn> + From<LaggedLatent>>(
        &self,
        names: &[&str],
        equations: &[&Equation],
        whole: Option<usize>,
    ) -> Result<Vec<LatentGroup>, E> {
        let needed = self.needed_latents::<E>(names, equations)?;
        let mut bases: Vec<Option<Basis>> = Vec::new();
        let mut members: BTreeMap<(usize, usize, usize), Vec<usize>> = BTreeMap::new();
        for (at, latent) in self.latents.iter().enumerate().filter(|&(at, _)| needed[at]) {
            let basis = latent.map.basis();
            let basis = bases.iter().position(|known| *known == basis).unwrap_or_else(|| {
                bases.push(basis);
                bases.len() - 1
            });
            members.entry((latent.library, latent.partition, basis)).or_default().push(at);
        }
        let group = |((library, partition, basis), latents): ((_, _, usize), Vec<usize>)| {
            let in_use = |&j: &usize| whole == Some(library) || latents.iter().any(|&at| self.latents[at].reads(j));
            let functions: Vec<usize> = (0..self.libraries[library].len()).filter(in_use).collect();
            // A basis without weights is not computed.
            let is_read = |basis: &Basis| basis.inputs().iter().all(|input| functions.contains(input));
            let basis = bases[basis].clone().filter(is_read);
            LatentGroup { library, partition, latents, functions, basis }
        };
        Ok(members.into_iter().map(group).collect())
    }

    fn needed_latents<E: From<UnknownColumn> + From<LaggedLatent>>(
        &self,
        names: &[&str],
        equations: &[&Equation],
    ) -> Result<Vec<bool>, E> {
        let columns = names.len() - self.latents.len();
        let mut needed = vec![false; self.latents.len()];
        for equation in equations {
            let right = Program::compile(std::slice::from_ref(&equation.right), names)?;
            for leaf in right.leaves() {
                match *leaf {
                    Leaf::Column { column, lag } if column >= columns && lag != 0 => {
                        let latent = names[column].to_owned();
                        return Err(LaggedLatent { equation: equation.label(), latent, lag }.into());
                    }
                    Leaf::Column { column, .. } if column >= columns => needed[column - columns] = true,
                    _ => {}
                }
            }
        }
        Ok(needed)
    }
}

/// The partitions of some groups, ascending.
pub fn partitions_in_use(groups: &[LatentGroup]) -> Vec<usize> {
    let mut used: Vec<usize> = groups.iter().map(|group| group.partition).collect();
    used.sort_unstable();
    used.dedup();
    used
}
