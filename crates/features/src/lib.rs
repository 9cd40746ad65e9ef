//! No code: the union of the features in which third-party crates are wanted, so that they are compiled once for all selections of the workspace's
//! packages. See `Cargo.toml`.
