//! The filters whose inputs are columns of one source.

use std::{
    ops::Range,
    sync::{Mutex, PoisonError},
};

use fleetfoot_data::{Block, Column, Episode, Error, Halo, ScalarBuffer};

use super::{
    FilterError,
    kernel::{Gain, State, delayed, gains, lag, present},
};
use crate::{Expr, Filter, FilterKind, Program, Scratch, view::evaluate};

/// Rows from one kept state to the next.
const SEGMENT_ROWS: usize = 8_192;

/// Reader of rows of the level below, with a given number of neighbours.
pub(super) type Read<'r> = dyn Fn(Range<usize>, Halo) -> Result<Block, Error> + 'r;

/// Filters over the columns of the level below.
pub(super) struct Level {
    columns: Vec<Column>,
    inputs: Vec<Input>,
    /// Distinct time constants of the lags.
    constants: Vec<f64>,
    lags: Vec<Lag>,
    delays: Vec<Delay>,
    /// Neighbouring rows that the inputs read.
    reach: Halo,
    /// The longest delay, seconds.
    longest: f64,
    /// By episode, the states of the lags at the first rows of its segments, as far as they are known.
    states: Vec<Mutex<Vec<Vec<State>>>>,
}

/// A distinct input, compiled.
struct Input {
    expression: Expr,
    program: Program,
    reads_time: bool,
}

/// The lag of an input: which outputs it has.
struct Lag {
    input: usize,
    constant: usize,
    value: Option<usize>,
    slope: Option<usize>,
}

struct Delay {
    input: usize,
    seconds: f64,
    kind: FilterKind,
    output: usize,
}

/// Rows `from..` of an episode in memory, the inputs evaluated.
struct Window {
    stamps: Vec<i64>,
    inputs: Vec<Vec<f64>>,
    /// For every time constant.
    gains: Vec<Vec<Gain>>,
}

impl Level {
    /// Behind `columns`, the outputs of `filters`.
    pub(super) fn new(columns: Vec<Column>, filters: &[Filter], episodes: usize) -> Result<Self, FilterError> {
        let mut level = Self {
            columns: Vec::new(),
            inputs: Vec::new(),
            constants: Vec::new(),
            lags: Vec::new(),
            delays: Vec::new(),
            reach: Halo::default(),
            longest: 0.0,
            states: (0..episodes).map(|_| Mutex::default()).collect(),
        };
        let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        for (at, filter) in filters.iter().enumerate() {
            let seconds = constant(filter)?;
            let input = level.input(filter, &names)?;
            level.add(filter.kind, input, seconds, columns.len() + at);
        }
        let unit_of = |filter: &Filter| {
            let known = filter.input.as_column().and_then(|name| columns.iter().find(|column| column.name == name));
            let kept = matches!(filter.kind, FilterKind::Lag1 | FilterKind::Delay);
            known.filter(|_| kept).and_then(|column| column.unit.clone())
        };
        let outputs =
            filters.iter().map(|filter| Column { unit: unit_of(filter), ..Column::float(filter.to_string()) });
        let outputs: Vec<Column> = outputs.collect();
        level.columns = columns;
        level.columns.extend(outputs);
        Ok(level)
    }

    fn add(&mut self, kind: FilterKind, input: usize, seconds: f64, output: usize) {
        if !matches!(kind, FilterKind::Lag1 | FilterKind::Lag1Slope) {
            self.longest = self.longest.max(seconds);
            self.delays.push(Delay { input, seconds, kind, output });
            return;
        }
        let constant = position_or_push(&mut self.constants, seconds, |known| *known == seconds);
        let new = Lag { input, constant, value: None, slope: None };
        let at = position_or_push(&mut self.lags, new, |lag| (lag.input, lag.constant) == (input, constant));
        let slot = if kind == FilterKind::Lag1 { &mut self.lags[at].value } else { &mut self.lags[at].slope };
        *slot = Some(output);
    }

    /// The index of a filter's input, compiled when it is new.
    fn input(&mut self, filter: &Filter, names: &[&str]) -> Result<usize, FilterError> {
        if let Some(known) = self.inputs.iter().position(|input| input.expression == filter.input) {
            return Ok(known);
        }
        let expression = filter.input.clone();
        let program = Program::compile(std::slice::from_ref(&expression), names)
            .map_err(|error| FilterError::UnknownColumn { filter: filter.to_string(), error })?;
        let halo = program.halo();
        self.reach.before = self.reach.before.max(halo.before);
        self.reach.after = self.reach.after.max(halo.after);
        let reads_time = program.leaves().iter().any(|leaf| matches!(leaf, crate::Leaf::Time { .. }));
        self.inputs.push(Input { expression, program, reads_time });
        Ok(self.inputs.len() - 1)
    }

    pub(super) fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// The rows with up to `halo` neighbours, as a source gives them.
    pub(super) fn read(
        &self,
        info: &Episode,
        episode: usize,
        rows: Range<usize>,
        halo: Halo,
        below: &Read<'_>,
    ) -> Result<Block, Error> {
        let start = rows.start - halo.before.min(rows.start);
        let end = rows.end + halo.after.min(info.rows - rows.end);
        // Nothing may be asked for behind the last row.
        let segment = start.min(info.rows.saturating_sub(1)) / SEGMENT_ROWS;
        let states = if self.lags.is_empty() { Vec::new() } else { self.states_at(info, episode, segment, below)? };
        let first = if self.lags.is_empty() { start } else { segment * SEGMENT_ROWS };
        let block = self.read_back(info, start, first, end, below)?;
        let from = block.first;
        let window = self.window(&block);
        let mut outputs = vec![Vec::with_capacity(end - start); self.columns.len() - block.columns.len()];
        let slot = |output: usize| output - block.columns.len();
        for (lag_of, state) in self.lags.iter().zip(states) {
            let skip = first - from;
            let (mut value, mut slope) = (Vec::new(), Vec::new());
            let mut row = first;
            lag(&window.inputs[lag_of.input][skip..], &window.gains[lag_of.constant][skip..], state, |state| {
                if row >= start {
                    value.push(state.value);
                    slope.push(state.slope);
                }
                row += 1;
            });
            lag_of.value.into_iter().for_each(|output| outputs[slot(output)].clone_from(&value));
            lag_of.slope.into_iter().for_each(|output| outputs[slot(output)].clone_from(&slope));
        }
        for delay in &self.delays {
            delay.run(&window, start - from..end - from, &mut outputs[slot(delay.output)]);
        }
        let (offset, length) = (block.before + start - from, end - start);
        let mut columns: Vec<ScalarBuffer<f64>> =
            block.columns.iter().map(|column| column.slice(offset, length)).collect();
        columns.extend(outputs.into_iter().map(ScalarBuffer::from));
        Ok(Block {
            first: rows.start,
            before: rows.start - start,
            rows: rows.len(),
            after: end - rows.end,
            start: block.start,
            time: block.time.slice(offset, length),
            columns,
        })
    }

    /// Reads up to row `end` from row `first`, or from as much before `start` as the longest delay needs.
    fn read_back(
        &self,
        info: &Episode,
        start: usize,
        first: usize,
        end: usize,
        below: &Read<'_>,
    ) -> Result<Block, Error> {
        if self.delays.is_empty() || start == end {
            return below(first..end, self.reach);
        }
        let guess = if info.period > 0.0 { (self.longest / info.period).min(1e15) as usize } else { 0 };
        let mut back = guess.saturating_add(guess / 16 + 8);
        loop {
            let from = start.saturating_sub(back).min(first);
            let block = below(from..end, self.reach)?;
            // One row more than the interpolation needs, for the slope at a row.
            let reached = block.stamps().get(1).zip(block.stamps().get(start - from));
            let enough = reached.is_some_and(|(early, stamp)| (stamp - early) as f64 * 1e-9 >= self.longest);
            if from == 0 || enough {
                return Ok(block);
            }
            back = back.saturating_mul(2);
        }
    }

    /// The lags' states at the first row of a segment.
    fn states_at(&self, info: &Episode, episode: usize, segment: usize, below: &Read<'_>) -> Result<Vec<State>, Error> {
        let known = &self.states[episode];
        loop {
            // Not held while reading: a reader may wait for work that needs this very lock.
            let (next, last) = {
                let states = known.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some(state) = states.get(segment) {
                    return Ok(state.clone());
                }
                (states.len(), states.last().cloned())
            };
            let from = next.saturating_sub(1) * SEGMENT_ROWS;
            let to = (next * SEGMENT_ROWS + 1).min(info.rows);
            let window = self.window(&below(from..to, self.reach)?);
            let run = |(at, lag_of): (usize, &Lag)| {
                let x = &window.inputs[lag_of.input];
                let begin = State::starting(x.first().copied().unwrap_or(f64::NAN));
                let mut state = last.as_ref().map_or(begin, |last| last[at]);
                lag(x, &window.gains[lag_of.constant], state, |reached| state = reached);
                state
            };
            let reached: Vec<State> = self.lags.iter().enumerate().map(run).collect();
            let mut states = known.lock().unwrap_or_else(PoisonError::into_inner);
            if states.len() == next {
                states.push(reached);
            }
        }
    }

    /// Evaluates the inputs at the core rows of a block.
    fn window(&self, block: &Block) -> Window {
        let core = block.before..block.before + block.rows;
        let seconds = self.inputs.iter().any(|input| input.reads_time).then(|| block.seconds());
        let mut scratch = Scratch::default();
        let mut input = |input: &Input| evaluate(&input.program, block, seconds.as_deref(), core.clone(), &mut scratch);
        let stamps = block.stamps().to_vec();
        Window {
            inputs: self.inputs.iter().map(&mut input).collect(),
            gains: self.constants.iter().map(|&tau| gains(&stamps, tau)).collect(),
            stamps,
        }
    }
}

impl Delay {
    fn run(&self, window: &Window, rows: Range<usize>, out: &mut Vec<f64>) {
        let (stamps, x) = (window.stamps.as_slice(), window.inputs[self.input].as_slice());
        match self.kind {
            FilterKind::Present => present(stamps, x, rows, self.seconds, |value| out.push(value)),
            FilterKind::DelaySlope => delayed(stamps, x, rows, self.seconds, |_, slope| out.push(slope)),
            _ => delayed(stamps, x, rows, self.seconds, |value, _| out.push(value)),
        }
    }
}

/// The number behind a filter's constant.
fn constant(filter: &Filter) -> Result<f64, FilterError> {
    if let Some(name) = filter.constant.columns().first() {
        return Err(FilterError::NoValue { filter: filter.to_string(), name: name.to_string() });
    }
    let value = filter.constant.value(|_, _| f64::NAN, |_| f64::NAN);
    let (fits, allowed) = match filter.kind {
        FilterKind::Lag1 | FilterKind::Lag1Slope => {
            (value > 0.0 && value.is_finite(), "a time constant is positive and finite")
        }
        _ => (value >= 0.0 && value.is_finite(), "a delay is finite and not negative; `lead` looks ahead"),
    };
    if fits { Ok(value) } else { Err(FilterError::Range { filter: filter.to_string(), value, allowed }) }
}

fn position_or_push<T>(list: &mut Vec<T>, new: T, same: impl Fn(&T) -> bool) -> usize {
    match list.iter().position(same) {
        Some(known) => known,
        None => {
            list.push(new);
            list.len() - 1
        }
    }
}
