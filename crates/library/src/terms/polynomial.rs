//! Full polynomial libraries, recognised in a list of functions.

use std::collections::{HashMap, HashSet};

use crate::{Expr, simplify::Monomial};

use super::Terms;

/// All monomials of total degree 1 to `degree` of some variables.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PolynomialLibrary {
    /// The variables, in the order in which they first stand in the functions.
    pub variables: Vec<Expr>,
    /// The total degree.
    pub degree: usize,
    /// For each function in order, the exponents of the variables.
    pub exponents: Vec<Vec<u8>>,
}

impl PolynomialLibrary {
    /// The polynomial library of `functions`; `None` unless they are exactly all monomials of total degree 1..=d of
    /// some variables. Each must occur once and without a number in front; the order of the list and the brackets of
    /// products do not matter.
    ///
    /// A variable is any expression that is no product, quotient or power itself. The constant must not be in the list.
    pub fn of(functions: &[Expr]) -> Option<Self> {
        let mut index: HashMap<Expr, usize> = HashMap::new();
        let mut variables = Vec::new();
        let (mut powers, mut degree) = (Vec::with_capacity(functions.len()), 0u32);
        for function in functions {
            let product = Monomial::of(function);
            if product.factor() != 1.0 || product.powers.is_empty() {
                return None;
            }
            let mut raised = Vec::with_capacity(product.powers.len());
            let mut total = 0u32;
            for (base, exponent) in product.powers {
                let exponent = u8::try_from(exponent).ok()?;
                total += u32::from(exponent);
                let at = *index.entry(base.canonical()).or_insert_with(|| {
                    variables.push(base);
                    variables.len() - 1
                });
                raised.push((at, exponent));
            }
            degree = degree.max(total);
            powers.push(raised);
        }
        // As many distinct monomials as there are of this degree and less: then they are these.
        if variables.is_empty() || crate::library::monomials(variables.len(), degree) != Some(functions.len()) {
            return None;
        }
        let dense = |powers: &Vec<(usize, u8)>| {
            let mut exponents = vec![0u8; variables.len()];
            for &(at, exponent) in powers {
                exponents[at] = exponents[at].checked_add(exponent)?;
            }
            Some(exponents)
        };
        let exponents: Vec<Vec<u8>> = powers.iter().map(dense).collect::<Option<_>>()?;
        let distinct: HashSet<&Vec<u8>> = exponents.iter().collect();
        (distinct.len() == functions.len()).then(|| Self { degree: degree as usize, variables, exponents })
    }
}

impl Terms {
    /// The functions as a full polynomial library, if they are one: see [`PolynomialLibrary::of`]. The constant is not looked at.
    pub fn as_polynomial(&self) -> Option<PolynomialLibrary> {
        PolynomialLibrary::of(&self.functions)
    }
}

impl crate::Library {
    /// The functions as a full polynomial library, if they are one: see [`PolynomialLibrary::of`].
    pub fn as_polynomial(&self) -> Option<PolynomialLibrary> {
        PolynomialLibrary::of(self.functions())
    }
}
