//! Candidates of a NARX model, and the orders that contain them.

use std::collections::HashSet;

use fleetfoot_library::{Expr, Library, LibraryError};

use super::NarxOrder;

/// The functions of lagged outputs and inputs up to some orders, for a target one row ahead.
///
/// The row that a candidate is evaluated at is k - 1, so that `y(k-1)` is the column itself and `y(k-2)` the column one row earlier. Past values of all orders of a library are equally far apart.
#[derive(Debug, Clone, PartialEq)]
pub struct NarxLibrary {
    /// The largest orders; none is within another.
    largest: Vec<NarxOrder>,
    functions: Vec<Expr>,
    /// The least order that has each function.
    needs: Vec<NarxOrder>,
}

/// A function of outputs and inputs of one row, of which a library has every lag.
#[derive(Debug, Clone, PartialEq)]
pub struct Addend {
    /// The function.
    pub function: Expr,
    /// True if the addend reads an output. Its lags then go as far back as those of the outputs, and it is not known at
    /// row k.
    pub outputs: bool,
    /// True if the addend reads anything else: its lags go as far back as those of the inputs.
    pub inputs: bool,
}

const NONE: NarxOrder = NarxOrder { outputs: 0, inputs: 0, degree: 1, direct: false, every: 1 };

impl NarxLibrary {
    /// All monomials of degree 1 to `order.degree` of the lags of `outputs` and `inputs`, in graded lexicographic order; where inputs act at once the input of row k
    /// itself is among the variables.
    ///
    /// # Errors
    /// [`LibraryError::TooLarge`].
    pub fn new(outputs: &[Expr], inputs: &[Expr], order: NarxOrder) -> Result<Self, LibraryError> {
        Self::of_orders(outputs, inputs, &[order])
    }

    /// The monomials that any of the orders has, each once: one statistic for all of them.
    ///
    /// # Errors
    /// [`LibraryError::TooLarge`].
    pub fn of_orders(outputs: &[Expr], inputs: &[Expr], orders: &[NarxOrder]) -> Result<Self, LibraryError> {
        Self::joined(orders, |order| {
            let variables = variables(outputs, inputs, order);
            let expressions: Vec<Expr> = variables.iter().map(|(expression, _)| expression.clone()).collect();
            let functions = Library::polynomial(&expressions, order.degree as u32)?.functions().to_vec();
            let mut needs = Vec::with_capacity(functions.len());
            if !variables.is_empty() {
                let narx_orders: Vec<NarxOrder> = variables.iter().map(|(_, need)| *need).collect();
                (1..=order.degree).for_each(|total| monomials(None, &narx_orders, total, total, &mut needs));
            }
            debug_assert_eq!(needs.len(), functions.len(), "both in graded lexicographic order");
            Ok(functions.into_iter().zip(needs).collect())
        })
    }

    /// Every lag of given functions that any of the orders has; nothing is multiplied, the degree of an order is 1.
    pub fn additive(addends: &[Addend], orders: &[NarxOrder]) -> Self {
        let all = Self::joined(orders, |order| {
            let mut lagged: Vec<(Expr, NarxOrder)> = Vec::new();
            for Addend { function, outputs, inputs } in addends {
                let lags = match (outputs, inputs) {
                    (true, false) => order.outputs,
                    (true, true) => order.outputs.min(order.inputs),
                    (false, _) => order.inputs,
                };
                if order.direct && !outputs {
                    lagged.push((function.shifted(-1), NarxOrder { direct: true, ..NONE }));
                }
                lagged.extend((0..lags).map(|lag| {
                    let reach = |reads: bool| if reads { lag + 1 } else { 0 };
                    let (outputs, inputs) = (reach(*outputs), reach(*inputs || !*outputs));
                    let need = NarxOrder { outputs, inputs, every: order.every, ..NONE };
                    (function.shifted(past(lag, order)), need)
                }));
            }
            Ok::<_, std::convert::Infallible>(lagged)
        });
        match all {
            Ok(library) => library,
            Err(never) => match never {},
        }
    }

    fn joined<E>(
        orders: &[NarxOrder],
        candidates: impl Fn(NarxOrder) -> Result<Vec<(Expr, NarxOrder)>, E>,
    ) -> Result<Self, E> {
        let mut largest: Vec<NarxOrder> = Vec::new();
        for &order in orders {
            if !largest.iter().any(|&other| order.is_within(other)) {
                largest.retain(|other| !other.is_within(order));
                largest.push(order);
            }
        }
        let mut library = Self { largest: largest.clone(), functions: Vec::new(), needs: Vec::new() };
        let mut seen = HashSet::new();
        for order in largest {
            for (function, need) in candidates(order)? {
                if seen.insert(function.clone()) {
                    library.functions.push(function);
                    library.needs.push(need);
                }
            }
        }
        Ok(library)
    }

    /// The candidates; the constant is not among them.
    pub fn functions(&self) -> &[Expr] {
        &self.functions
    }

    /// Columns of an order in a problem whose first column is the constant, the constant among them.
    pub fn columns(&self, order: NarxOrder) -> Vec<usize> {
        let needed = self.needs.iter().enumerate().filter(|(_, need)| need.is_within(order));
        std::iter::once(0).chain(needed.map(|(j, _)| j + 1)).collect()
    }

    /// All orders up to the library's that differ in their candidates, from the smallest on: at least one output lag where there are outputs to lag, no input lag only
    /// where the library has none or the input acts at once. Inputs act at once as they do in the library.
    pub fn orders(&self) -> Vec<NarxOrder> {
        let mut orders = Vec::new();
        for most in &self.largest {
            let least_inputs = usize::from(most.inputs > 0 && !most.direct);
            for degree in 1..=most.degree {
                for outputs in most.outputs.min(1)..=most.outputs {
                    let order = |inputs| NarxOrder { outputs, inputs, degree, ..*most };
                    orders.extend((least_inputs..=most.inputs).map(order));
                }
            }
        }
        orders.sort_by_key(|&order| (self.columns(order).len(), order));
        orders.dedup();
        orders
    }
}

/// Rows from k - 1 back to the past value of this number, the first being 0.
fn past(lag: usize, order: NarxOrder) -> i32 {
    (lag * order.every) as i32
}

/// Lagged outputs, then inputs at once, then lagged inputs, each with the least order that has it.
fn variables(outputs: &[Expr], inputs: &[Expr], order: NarxOrder) -> Vec<(Expr, NarxOrder)> {
    let mut variables: Vec<(Expr, NarxOrder)> = Vec::new();
    for lag in 0..order.outputs {
        let need = NarxOrder { outputs: lag + 1, every: order.every, ..NONE };
        variables.extend(outputs.iter().map(|output| (output.shifted(past(lag, order)), need)));
    }
    if order.direct {
        let need = NarxOrder { direct: true, ..NONE };
        variables.extend(inputs.iter().map(|input| (input.shifted(-1), need)));
    }
    for lag in 0..order.inputs {
        let need = NarxOrder { inputs: lag + 1, every: order.every, ..NONE };
        variables.extend(inputs.iter().map(|input| (input.shifted(past(lag, order)), need)));
    }
    variables
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
