//! Rollouts of any model: programs evaluated over a batch of trajectories, one value a trajectory.

use fleetfoot_library::Leaf;

use crate::{
    End, Method, Outside, RolloutOptions, Simulator, Trajectory, compiled::Workspace, controller::Drive,
    integrate::runge_kutta_mean, kernel::within, run::Run,
};

/// The columns of a batch over time: row `history + k` holds the values at step k, one a trajectory.
struct Columns {
    count: usize,
    history: usize,
    values: Vec<Vec<f64>>,
    /// Seconds since the start of the episode.
    seconds: Vec<f64>,
}

impl Columns {
    fn at(&self, column: usize, step: i64) -> &[f64] {
        row(&self.values[column], self.count, self.history as i64 + step)
    }

    fn at_mut(&mut self, column: usize, step: usize) -> &mut [f64] {
        let from = (self.history + step) * self.count;
        &mut self.values[column][from..from + self.count]
    }
}

fn row(values: &[f64], count: usize, index: i64) -> &[f64] {
    &values[index as usize * count..][..count]
}

/// States and time of a stage within a step.
struct Stage<'a> {
    step: usize,
    /// States x trajectories; `None` at the beginning of the step.
    states: Option<&'a [f64]>,
    /// Seconds since the beginning of the step, one a trajectory.
    offset: &'a [f64],
}

/// Memory of a batch.
struct Batch<'a> {
    simulator: &'a Simulator,
    runs: &'a [Run<'a>],
    columns: Columns,
    workspace: Workspace,
    /// Lags at which `time()` is used, and its values there for the present stage.
    time_lags: Vec<i32>,
    end: Vec<End>,
    steps: Vec<usize>,
    left: Vec<Option<usize>>,
    /// Of trajectories with gains, the states before they were corrected, one step after the other.
    uncorrected: Vec<Vec<f64>>,
    regions: Vec<u32>,
    /// The controllers of a closed loop, one a trajectory; none in an open loop.
    drives: Vec<Drive<'a>>,
    /// True if regressors are held within the training range.
    hold: bool,
}

/// Simulates a batch of complete windows.
pub(crate) fn simulate(simulator: &Simulator, runs: &[Run<'_>], options: &RolloutOptions) -> Vec<Trajectory> {
    if runs.is_empty() {
        return Vec::new();
    }
    let mut batch = Batch::new(simulator, runs, options);
    for step in 0..options.horizon {
        if batch.end.iter().all(|end| *end != End::Horizon) {
            break;
        }
        batch.step(step, options);
    }
    batch.finish(options.horizon)
}

impl<'a> Batch<'a> {
    fn new(simulator: &'a Simulator, runs: &'a [Run<'a>], options: &RolloutOptions) -> Self {
        let horizon = options.horizon;
        let (count, history) = (runs.len(), simulator.history());
        let length = history + horizon + 1 + simulator.ahead();
        let mut columns =
            Columns { count, history, values: vec![Vec::new(); simulator.columns.len()], seconds: Vec::new() };
        let back = history as i64;
        let states = simulator.states.iter().map(|state| (state.column, -back, 1));
        let recorded = simulator
            .recorded
            .iter()
            .map(|&(column, most, least)| (column, -i64::from(most), horizon as i64 - i64::from(least)));
        for (column, from, to) in states.chain(recorded) {
            let values = &mut columns.values[column];
            values.resize(length * count, 0.0);
            for (b, run) in runs.iter().enumerate() {
                let first = (back + from) as usize;
                for (k, &value) in run.window.values(column, from, to).iter().enumerate() {
                    values[(first + k) * count + b] = value;
                }
            }
        }
        for (b, run) in runs.iter().enumerate() {
            for (state, &value) in simulator.states.iter().zip(run.beginning.unwrap_or_default()) {
                columns.at_mut(state.column, 0)[b] = value;
            }
        }
        let mut drives = Vec::new();
        if let Some(driver) = &simulator.driver {
            for &(column, most) in &driver.drives {
                let values = &mut columns.values[column];
                values.resize(length * count, 0.0);
                for (b, run) in runs.iter().enumerate() {
                    for (k, &value) in run.window.values(column, -i64::from(most), 1).iter().enumerate() {
                        values[(history + k - most as usize) * count + b] = value;
                    }
                }
            }
            drives.extend(runs.iter().map(|run| driver.start(run.window, horizon)));
        }
        let leaves = simulator.compiled.functions.leaves().iter().chain(simulator.compiled.rights.leaves());
        let mut time_lags: Vec<i32> =
            leaves.filter_map(|leaf| if let Leaf::Time { lag } = *leaf { Some(lag) } else { None }).collect();
        time_lags.sort_unstable();
        time_lags.dedup();
        if !time_lags.is_empty() {
            columns.seconds.resize(length * count, 0.0);
            for (b, run) in runs.iter().enumerate() {
                let block = run.block();
                for k in 0..history + horizon + simulator.ahead() {
                    let stamp = block.time[run.window.at + k - history];
                    columns.seconds[k * count + b] = (stamp - block.start) as f64 * 1e-9;
                }
            }
        }
        Self {
            simulator,
            runs,
            columns,
            workspace: Workspace::default(),
            time_lags,
            end: vec![End::Horizon; count],
            steps: vec![horizon; count],
            left: vec![None; count],
            uncorrected: vec![Vec::new(); count],
            regions: Vec::with_capacity(horizon * count),
            drives,
            hold: options.outside == Outside::Hold,
        }
    }

    /// Right sides at a stage: states x trajectories.
    fn slopes(&mut self, stage: &Stage<'_>) -> Vec<f64> {
        let Self { simulator, columns, workspace, time_lags, hold, .. } = self;
        let (count, step) = (columns.count, stage.step as i64);
        let times: Vec<Vec<f64>> = time_lags
            .iter()
            .map(|&lag| {
                let seconds = row(&columns.seconds, count, columns.history as i64 + step - i64::from(lag));
                seconds.iter().zip(stage.offset).map(|(t, offset)| t + offset).collect()
            })
            .collect();
        let leaf = |leaf: Leaf| -> &[f64] {
            match leaf {
                Leaf::Time { lag } => &times[time_lags.binary_search(&lag).unwrap_or(0)],
                Leaf::Column { column, lag } => {
                    let state = simulator.states.iter().position(|state| state.column == column);
                    match (stage.states, state, lag) {
                        (Some(states), Some(state), 0) => &states[state * count..][..count],
                        _ => columns.at(column, step - i64::from(lag)),
                    }
                }
            }
        };
        simulator.compiled.evaluate_within(count, &leaf, *hold, workspace);
        let mut slopes = vec![0.0; simulator.states.len() * count];
        for (slope, output) in slopes.chunks_exact_mut(count).zip(workspace.outputs.chunks_exact(workspace.stride)) {
            slope.copy_from_slice(&output[..count]);
        }
        slopes
    }

    fn step(&mut self, step: usize, options: &RolloutOptions) {
        let count = self.columns.count;
        self.correct(step);
        self.drive(step);
        let zero = vec![0.0; count];
        let mut slopes = self.slopes(&Stage { step, states: None, offset: &zero });
        self.look_around(step);
        let seconds: Vec<f64> = self.runs.iter().map(|run| run.step(step)).collect();
        let continuous = self.simulator.states.iter().any(|state| state.advance.continuous);
        if options.method == Method::Rk4 && continuous {
            self.refine(step, &seconds, &mut slopes);
        }
        let mut next = vec![0.0; slopes.len()];
        for (s, state) in self.simulator.states.iter().enumerate() {
            let x = self.columns.at(state.column, step as i64);
            let x0 = self.columns.at(state.column, 0);
            for b in 0..count {
                let value = state.advance.next(x[b], slopes[s * count + b], seconds[b]);
                next[s * count + b] = value;
                let near = (value - x0[b]).abs() <= state.limit(self.runs[b].divergence, x0[b]);
                if !near && self.end[b] == End::Horizon {
                    self.end[b] = End::Diverged;
                    self.steps[b] = step;
                }
            }
        }
        for b in 0..count {
            self.simulator.geometry.retract(&mut next, |s| s * count + b);
        }
        for (s, state) in self.simulator.states.iter().enumerate() {
            for b in 0..count {
                // A trajectory that has ended goes on from its start, so that it stays finite.
                if self.end[b] != End::Horizon {
                    next[s * count + b] = self.columns.at(state.column, 0)[b];
                }
            }
            self.columns.at_mut(state.column, step + 1).copy_from_slice(&next[s * count..(s + 1) * count]);
        }
    }

    /// Moves the states of trajectories with gains towards their measurements.
    fn correct(&mut self, step: usize) {
        for (b, run) in self.runs.iter().enumerate().filter(|(_, run)| !run.gains.is_empty()) {
            let states = &self.simulator.states;
            let simulated: Vec<f64> =
                states.iter().map(|state| self.columns.at(state.column, step as i64)[b]).collect();
            for (place, state) in states.iter().enumerate() {
                self.columns.at_mut(state.column, step)[b] =
                    run.corrected(self.simulator.moved(), place, step, |s| simulated[s]);
            }
            self.uncorrected[b].extend(simulated);
        }
    }

    /// Sets the inputs that the controllers drive.
    fn drive(&mut self, step: usize) {
        let Some(driver) = &self.simulator.driver else { return };
        for (b, drive) in self.drives.iter_mut().enumerate() {
            if self.end[b] != End::Horizon {
                continue;
            }
            let (columns, simulator) = (&self.columns, self.simulator);
            drive.step(step, self.runs[b].time[step], |state| {
                columns.at(simulator.states[state].column, step as i64)[b]
            });
            for (&(column, _), &input) in driver.drives.iter().zip(&drive.inputs) {
                self.columns.at_mut(column, step)[b] = input;
            }
        }
    }

    /// Notes regions, missing regions and rows outside of the training ranges.
    fn look_around(&mut self, step: usize) {
        let count = self.columns.count;
        let regions = self.workspace.regions.get(self.simulator.reported);
        let none: Vec<bool> =
            (0..count).map(|b| self.workspace.regions.iter().any(|regions| regions[b] == u32::MAX)).collect();
        for b in 0..count {
            let region = regions.map_or(0, |regions| regions[b]);
            self.regions.push(region);
            if self.end[b] != End::Horizon {
                continue;
            }
            if none[b] {
                self.end[b] = End::NoRegion;
                self.steps[b] = step;
            } else if self.left[b].is_none() && !self.inside(b) {
                self.left[b] = Some(step);
                if self.runs[b].ends_outside {
                    self.end[b] = End::LeftDomain;
                    self.steps[b] = step;
                }
            }
        }
    }

    /// Returns true if the regressors of every latent are within the ranges of their region.
    fn inside(&self, b: usize) -> bool {
        self.simulator.compiled.groups.iter().all(|group| {
            let Some(ranges) = &group.ranges else { return true };
            let region = self.workspace.regions.get(group.regions).map_or(0, |regions| regions[b]);
            let mut features = vec![0.0; ranges.width];
            for (j, feature) in features[..group.kept.len()].iter_mut().enumerate() {
                *feature = self.workspace.values[(group.first + j) * self.workspace.stride + b];
            }
            let at = region as usize * ranges.width;
            within(pulp::Scalar, &features, &ranges.low[at..at + ranges.width], &ranges.high[at..at + ranges.width])
        })
    }

    /// Replaces the slopes of the continuous states by the mean of the four Runge-Kutta stages.
    fn refine(&mut self, step: usize, seconds: &[f64], slopes: &mut [f64]) {
        let count = self.columns.count;
        let mut stages = [slopes.to_vec(), Vec::new(), Vec::new(), Vec::new()];
        for stage in 1..4 {
            let fraction = if stage == 3 { 1.0 } else { 0.5 };
            let offset: Vec<f64> = seconds.iter().map(|h| h * fraction).collect();
            let mut states = vec![0.0; slopes.len()];
            for (s, state) in self.simulator.states.iter().enumerate() {
                let x = self.columns.at(state.column, step as i64);
                for b in 0..count {
                    let slope = if state.advance.continuous { stages[stage - 1][s * count + b] } else { 0.0 };
                    states[s * count + b] = offset[b].mul_add(slope, x[b]);
                }
            }
            stages[stage] = self.slopes(&Stage { step, states: Some(&states), offset: &offset });
        }
        for (s, state) in self.simulator.states.iter().enumerate() {
            if state.advance.continuous {
                for i in s * count..(s + 1) * count {
                    slopes[i] = runge_kutta_mean([stages[0][i], stages[1][i], stages[2][i], stages[3][i]]);
                }
            }
        }
    }

    fn finish(mut self, horizon: usize) -> Vec<Trajectory> {
        let count = self.columns.count;
        let mut drives = std::mem::take(&mut self.drives).into_iter();
        (0..count)
            .map(|b| {
                let steps = self.steps[b].min(horizon);
                let shown = self.simulator.shown();
                let mut states = Vec::with_capacity((steps + 1) * shown.len());
                for k in 0..=steps {
                    match self.uncorrected[b].chunks_exact(self.simulator.states.len()).nth(k) {
                        Some(values) => states.extend_from_slice(&values[..shown.len()]),
                        None => states.extend(shown.iter().map(|state| self.columns.at(state.column, k as i64)[b])),
                    }
                }
                Trajectory {
                    start: self.runs[b].start,
                    time: self.runs[b].time[..=steps].to_vec(),
                    states,
                    inputs: drives.next().map_or_else(Vec::new, |drive| drive.finish(steps)),
                    regions: (0..steps).map(|k| self.regions[k * count + b]).collect(),
                    end: self.end[b],
                    left_domain: self.left[b],
                }
            })
            .collect()
    }
}
