//! Robots' logs as recordings: clocks, episodes, joins, names, the cache, and refusals. The logs are written here.

mod clocks;
mod columns;
mod joins;
mod kept;
mod logs;
mod many;
mod refusals;
mod splits;
