//! Candidates of a polynomial NARX, and which orders have them.

use fleetfoot_library::{Expr, Library, LibraryError};

use super::NarxOrder;

/// The monomials of lagged outputs and inputs up to an order, for a target one row ahead.
///
/// The row that a candidate is evaluated at is k - 1, so that `y(k-1)` is the column itself and `y(k-2)` the column one row earlier.
#[derive(Debug, Clone, PartialEq)]
pub struct NarxLibrary {
    order: NarxOrder,
    direct: bool,
    functions: Vec<Expr>,
    /// The least order that has each function.
    needs: Vec<NarxOrder>,
}

impl NarxLibrary {
    /// All monomials of degree 1 to `order.degree` of the lags of `outputs` and `inputs`, in graded lexicographic order; with `direct` the input of row k itself is
    /// among the variables.
    ///
    /// # Errors
    /// [`LibraryError::TooLarge`].
    pub fn new(outputs: &[Expr], inputs: &[Expr], order: NarxOrder, direct: bool) -> Result<Self, LibraryError> {
        let mut variables: Vec<(Expr, NarxOrder)> = Vec::new();
        let none = NarxOrder { outputs: 0, inputs: 0, degree: 1 };
        for lag in 0..order.outputs {
            let need = NarxOrder { outputs: lag + 1, ..none };
            variables.extend(outputs.iter().map(|output| (output.shifted(lag as i32), need)));
        }
        if direct {
            variables.extend(inputs.iter().map(|input| (input.shifted(-1), none)));
        }
        for lag in 0..order.inputs {
            let need = NarxOrder { inputs: lag + 1, ..none };
            variables.extend(inputs.iter().map(|input| (input.shifted(lag as i32), need)));
        }
        let expressions: Vec<Expr> = variables.iter().map(|(expression, _)| expression.clone()).collect();
        let functions = Library::polynomial(&expressions, order.degree as u32)?.functions().to_vec();
        let mut needs = Vec::with_capacity(functions.len());
        if !variables.is_empty() {
            let own: Vec<NarxOrder> = variables.iter().map(|(_, need)| *need).collect();
            (1..=order.degree).for_each(|total| monomials(None, &own, total, total, &mut needs));
        }
        debug_assert_eq!(needs.len(), functions.len(), "both in graded lexicographic order");
        Ok(Self { order, direct, functions, needs })
    }

    /// The largest order, that of the whole library.
    pub fn order(&self) -> NarxOrder {
        self.order
    }

    /// The candidates; the constant is not among them.
    pub fn functions(&self) -> &[Expr] {
        &self.functions
    }

    /// Columns of a smaller order in a problem whose first column is the constant, the constant among them.
    pub fn columns(&self, order: NarxOrder) -> Vec<usize> {
        let own = self.needs.iter().enumerate().filter(|(_, need)| need.is_within(order));
        std::iter::once(0).chain(own.map(|(j, _)| j + 1)).collect()
    }

    /// All orders up to the library's that differ in their candidates, from the smallest on: at least one output lag where there are outputs to lag, no input lag only
    /// where the library has none or the input acts at once.
    pub fn orders(&self) -> Vec<NarxOrder> {
        let least_inputs = usize::from(self.order.inputs > 0 && !self.direct);
        let mut orders = Vec::new();
        for degree in 1..=self.order.degree {
            for outputs in self.order.outputs.min(1)..=self.order.outputs {
                for inputs in least_inputs..=self.order.inputs {
                    orders.push(NarxOrder { outputs, inputs, degree });
                }
            }
        }
        orders.sort_by_key(|&order| (self.columns(order).len(), order));
        orders
    }
}

/// Appends the needs of all monomials of degree `left` of `variables`, times `head`; `total` is the degree of the whole. The order is that of [`Library::polynomial`].
fn monomials(head: Option<NarxOrder>, variables: &[NarxOrder], left: usize, total: usize, needs: &mut Vec<NarxOrder>) {
    for (i, variable) in variables.iter().enumerate() {
        for exponent in (1..=left).rev() {
            let need = NarxOrder { degree: total, ..head.map_or(*variable, |head| head.union(*variable)) };
            if exponent == left {
                needs.push(need);
            } else if i + 1 < variables.len() {
                monomials(Some(need), &variables[i + 1..], left - exponent, total, needs);
            } else {
                break;
            }
        }
    }
}
