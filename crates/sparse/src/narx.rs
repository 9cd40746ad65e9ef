//! Nonlinear autoregression with inputs: `y(k) = F(y(k-1), ..., y(k-ny), u(k-1), ..., u(k-nu))`, F a polynomial (Leontaritis and Billings 1985; Billings 2013,
//! chapters 2 and 3).
//!
//! A [`NarxLibrary`] lays out the candidates of the largest order asked for. One scan of them answers every smaller order: its candidates are some of the columns
//! of the same statistic, and all orders are compared on the same rows ([`search_orders`]).

mod library;
mod order;
mod search;
#[cfg(test)]
mod tests;

pub use library::{Addend, NarxLibrary};
pub use order::NarxOrder;
pub use search::{NarxFold, OrderChoice, OrderOptions, OrderScore, OrderSearch, search_orders};
