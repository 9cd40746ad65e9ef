//! Structured multi-task regression: equations that share latent functions (block-sparse bolasso paper, sections 4 to 7). Their sums are those of
//! [`fleetfoot_sums::structured`].

mod assemble;
mod refit;

pub use assemble::{Assembled, Assembly, Tikhonov, assemble};
pub(crate) use assemble::{penalty, scales};
pub use refit::refit;
