//! From series, each with stamps of its own, to one table of rows on one clock.
//!
//! A [`Series`] holds the samples of one channel, put in the order of their stamps ([`SeriesBuilder`]) and cut into [`Run`]s where the clock
//! jumped back. [`join()`] takes the stamps of one series, or those of an even grid, and asks every other series for its values at these
//! stamps ([`JoinKind`]). Values are never made up: not across a gap, not before the first sample, not beyond the last.

mod grid;
mod interpolate;
mod joiner;
mod kind;
#[cfg(test)]
mod oracle;
mod overlap;
mod plan;
mod rate;
mod reorder;
mod rows;
mod series;
#[cfg(test)]
mod tests;

pub(crate) use joiner::{Base, join};
pub use kind::JoinKind;
pub(crate) use plan::JoinColumn;
pub(crate) use rate::check_rate;
pub(crate) use rows::{Run, Samples};
pub(crate) use series::{Series, SeriesBuilder};
