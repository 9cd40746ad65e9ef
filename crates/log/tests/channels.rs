//! Robots' logs as recordings: clocks, episodes, joins, names, the cache, and what is refused. The logs are written here.

#[path = "channels/clocks.rs"]
mod clocks;
#[path = "channels/joins.rs"]
mod joins;
#[path = "channels/kept.rs"]
mod kept;
#[path = "channels/logs.rs"]
mod logs;
#[path = "channels/refusals.rs"]
mod refusals;
