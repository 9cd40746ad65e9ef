//! Arguments of simulations.

use std::{path::PathBuf, sync::Arc};

use clap::{Args, ValueEnum};
use fleetfoot::{Error, dynamics::controller::Controller, whole};

use super::{List, ModelData};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Method {
    /// Forward Euler, as in the paper.
    Euler,
    /// Classical fourth-order Runge-Kutta.
    Rk4,
}

/// Scores of simulated paths.
#[derive(Debug, Args)]
pub(crate) struct PathArgs {
    /// States of one unit whose path is compared with the recorded one, separated by commas: `x,y` (default: none).
    #[arg(long, value_name = "STATES")]
    pub(crate) position: Option<List>,
    /// Baseline: a state or rate that follows an expression at once, `vx=vx_ref` or `d(x)/dt=vx_ref`; may be repeated
    /// (default: none).
    #[arg(long, value_name = "STATE=EXPRESSION")]
    pub(crate) reference: Vec<String>,
    /// Steps over which the relative growth of the distance is taken.
    #[arg(long, value_name = "STEPS", default_value_t = 1, requires = "position", value_parser = whole::<usize>(1..=10_000_000))]
    pub(crate) interval: usize,
    /// Steps by which time warping may shift a point (default: a tenth of the horizon).
    #[arg(long, value_name = "STEPS", requires = "position", value_parser = whole::<usize>(0..=10_000_000))]
    pub(crate) band: Option<usize>,
}

impl PathArgs {
    pub(crate) fn options(&self) -> fleetfoot::dynamics::PathOptions {
        fleetfoot::dynamics::PathOptions {
            position: self.position.iter().flat_map(|list| list.0.iter().cloned()).collect(),
            references: self.reference.clone(),
            interval: Some(self.interval),
            band: self.band,
        }
    }
}

/// Source of the inputs of simulations.
#[derive(Debug, Args)]
pub(crate) struct ControllerArgs {
    /// Controller that computes the inputs: a file of `control lqr`, treadmill, or a TOML file with
    /// `kind = "treadmill"` (default: inputs as recorded).
    #[arg(long, value_name = "KIND|FILE")]
    pub(crate) controller: Option<String>,
    /// Settings of the controller, separated by commas: gains (k_x, k_yaw), limits, period and latency in seconds,
    /// columns: x=x,yaw=yaw,speed=belt_speed,u_v=u_v,u_w=u_w (`speed` also a number, m/s); may be repeated.
    #[arg(long, value_name = "KEY=VALUE", requires = "controller")]
    pub(crate) controller_set: Vec<List>,
}

impl ControllerArgs {
    /// The controller's argument as a path.
    pub(crate) fn file(&self) -> Option<PathBuf> {
        self.controller.as_ref().map(PathBuf::from)
    }

    /// The controller, if one is given.
    pub(crate) fn read(&self) -> Result<Option<Arc<dyn Controller>>, Error> {
        let settings: Vec<String> = self.controller_set.iter().flat_map(|list| list.0.iter().cloned()).collect();
        self.controller.as_ref().map(|what| fleetfoot::controller(what, &settings)).transpose()
    }
}

#[derive(Debug, Args)]
pub(crate) struct Rollout {
    #[command(flatten)]
    pub(crate) model: ModelData,
    /// Steps of every trajectory.
    #[arg(long, value_name = "STEPS", default_value_t = 200, value_parser = whole::<usize>(1..=10_000_000))]
    pub(crate) horizon: usize,
    /// Number of trajectories.
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = whole::<usize>(1..=1_000_000_000))]
    pub(crate) starts: usize,
    /// Integration of derivatives.
    #[arg(long, value_enum, default_value = "rk4")]
    pub(crate) method: Method,
    /// Rule for a trajectory with a regressor outside the training range of its region.
    #[arg(long, value_enum, default_value = "tell")]
    pub(crate) outside: OutsideArg,
    #[command(flatten)]
    pub(crate) paths: PathArgs,
    /// Seed of random starts (default: starts are evenly spread).
    #[arg(long, value_name = "SEED")]
    pub(crate) seed: Option<u64>,
    #[command(flatten)]
    pub(crate) controller: ControllerArgs,
    /// File for the trajectories beside their measurements: `*.parquet`, `*.csv`, `*.tsv` or `*.mcap` (default: none).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum OutsideArg {
    /// Count it and continue.
    Tell,
    /// End it there.
    End,
    /// Continue with the regressor held at the limit of the range.
    Hold,
}
