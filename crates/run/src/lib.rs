//! A model on files: scores, predictions row by row, rollouts, filters, simulations that follow a recording; controllers made of it, and code.

mod control;
mod controller;
mod export;
mod filter;
mod frequency;
mod json;
mod on_files;
mod output;
mod project;
mod resimulate;
mod rows;

pub use control::{ControllerFile, ControllerRecord, LqrRecord, SetPointRecord, control_lqr, control_mpc};
pub use controller::{controller, controller_file, made_controller};
pub use export::{Exported, engine_vectors, export, export_controller, export_filter};
pub use filter::{
    DeviationFrom, Filtered, FilteredRows, SensorReport, SquareReport, TruthReport, filter, filter_of, filter_rows,
};
pub use frequency::{
    Distortion, Frequencies, FrequencyOptions, Line as FrequencyLine, Response as FrequencyResponse, frequency,
};
pub use on_files::{
    PredictedRows, RolledOut, Scored, Written, is_needed, opened_to_roll, predict, predict_rows, roll_rows, rollout,
    score, score_rows,
};
pub use output::layout_files;
pub use project::{Projected, axis, plane_of_rows, project};
pub use resimulate::{Followed, Spread, resimulate};
pub use rows::{ModelRows, Rows, model_rows, read_rows};
