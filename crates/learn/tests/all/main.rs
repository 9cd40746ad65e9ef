//! Products with the Jacobian against differences, solved cases, the same bits on any number of threads, and what is refused.

mod cells;
mod slopes;
mod training;
