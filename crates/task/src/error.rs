//! Errors of rows that settle a task.

/// Errors of rows that settle a task.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The recipe's words do not fit the recording.
    #[error(transparent)]
    Recipe(#[from] fleetfoot_recipe::Error),
    /// The rows could not be summed.
    #[error(transparent)]
    Rows(#[from] fleetfoot_sums::system::SystemError),
}
