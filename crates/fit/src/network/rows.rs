//! The rows that train, in memory, with their place in cross-validation.

use fleetfoot_data::{Progress, Source, checkpoint};
use fleetfoot_learn::{Shape, Table, Window};
use fleetfoot_library::{DesignRows, Expr};
use fleetfoot_model::Prediction;
use fleetfoot_pwa::{Options, Problem};
use fleetfoot_stats::{Fold, FoldLayout, FoldRule, scan::Columns};

use super::{options::NetworkOptions, window};
use crate::error::Error;

/// Rows that are read at once.
const BLOCK: usize = 1 << 14;

/// Rows of functions and targets.
pub(super) struct Rows {
    pub(super) table: Table,
    /// Functions of the library that vary: the inputs.
    pub(super) inputs: Vec<usize>,
    /// Steps of the recurrent cell among the inputs, where there is a cell.
    pub(super) window: Option<Window>,
    /// Predictions of persistence, rows x targets; NaN where it predicts nothing.
    pub(super) persistence: Vec<f64>,
    pub(super) folds: Vec<Fold>,
    /// Number of folds, and which rows they hold out, in words; 0 where there are none.
    pub(super) count: u16,
    pub(super) rule: String,
    /// Complete rows, of which these are an even share.
    pub(super) complete: usize,
}

impl Rows {
    /// Reads the complete rows, an even share of them where there are more than `most`.
    pub(super) fn read(
        problem: &Problem,
        (options, network): (&Options, &NetworkOptions),
        most: usize,
        source: &dyn Source,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let fitted = || problem.equations.iter().filter(|equation| equation.target.is_some());
        let targets: Vec<Expr> = fitted().filter_map(|equation| equation.target.clone()).collect();
        let before: Vec<Expr> = fitted()
            .map(|equation| match equation.prediction {
                Prediction::Next => Expr::column(equation.subject.as_str()),
                _ => Expr::number(0.0),
            })
            .collect();
        let has_persistence: Vec<bool> = fitted()
            .map(|equation| {
                let is_angle = problem.columns.iter().any(|column| column.name == equation.subject && column.angle);
                match equation.prediction {
                    // That an angle stays is no matter of the difference of two numbers.
                    Prediction::Next => !is_angle,
                    Prediction::Difference | Prediction::Derivative => true,
                    Prediction::Value => false,
                }
            })
            .collect();
        let groups: [&[Expr]; 3] = [&problem.library, &targets, &before];
        let columns = Columns::compile(&groups, None, source)?;
        let (p, q) = (problem.library.len(), targets.len());
        let halo = columns.halo();
        let episodes = source.episodes();
        let layout = match options.folds {
            0 | 1 => None,
            folds => {
                let lengths = episodes.iter().map(|episode| (episode.id, episode.rows));
                let purge = options.gap(halo.before + halo.after);
                Some(
                    FoldLayout::new(FoldRule::Count(folds.into()), lengths, purge)
                        .map_err(fleetfoot_pwa::Error::from)?,
                )
            }
        };
        let total = source.rows().max(1);
        let taken = |row: usize| {
            let share = |row: usize| (row as u128 * most as u128 / total as u128) as usize;
            most >= total || share(row) < share(row + 1)
        };
        progress.stage("rows");
        let (mut values, mut persistence, mut folds) = (Vec::new(), Vec::new(), Vec::new());
        let (mut rows, mut complete, mut before) = (DesignRows::default(), 0, 0);
        for (at, episode) in episodes.iter().enumerate() {
            let pieces = match &layout {
                Some(layout) => layout.pieces(episode.id, episode.rows),
                None => vec![(0..episode.rows, Fold::default())],
            };
            for (piece, fold) in pieces {
                for first in piece.clone().step_by(BLOCK) {
                    checkpoint();
                    let range = first..(first + BLOCK).min(piece.end);
                    let block = source.read(at, range.clone(), halo)?;
                    let tile = columns.evaluate(&block, episode, 0..range.len(), &mut rows);
                    let tile = tile.map_err(fleetfoot_pwa::Error::from)?;
                    let (current, previous) = (tile.columns(0..2), tile.columns(2..3));
                    complete += tile.len();
                    for (k, &row) in tile.index().iter().enumerate() {
                        if taken(before + first + row) {
                            values.extend(current.iter().map(|column| column[k]));
                            let known = previous.iter().zip(&has_persistence);
                            persistence.extend(known.map(|(column, has)| if *has { column[k] } else { f64::NAN }));
                            folds.push(fold);
                        }
                    }
                }
            }
            before += episode.rows;
            progress.advance(episode.rows, total);
        }
        let inputs = varying(&values, p, p + q);
        if inputs.is_empty() {
            return Err(Error::too_few_rows(
                folds.len() as u64,
                2,
                "no function of the library varies on these rows: a network has nothing to read".into(),
            ));
        }
        let kept: Vec<usize> = inputs.iter().copied().chain(p..p + q).collect();
        let values = values.chunks_exact(p + q).flat_map(|row| kept.iter().map(|&column| row[column])).collect();
        let table = Table::new(inputs.len(), q, values)?;
        let (count, rule) = layout.map_or((0, String::new()), |layout| (layout.folds(), layout.in_words()));
        let window = network.cell.map(|cell| {
            let read: Vec<Expr> = inputs.iter().map(|&input| problem.library[input].clone()).collect();
            Window { cell, steps: window::steps(&read) }
        });
        if window.as_ref().is_some_and(|window| window.steps.is_empty()) {
            return Err(window::missing());
        }
        Ok(Self { table, inputs, window, persistence, folds, count, rule, complete })
    }

    /// A network of these rows.
    pub(super) fn shape(&self, hidden: &[usize], options: &NetworkOptions) -> Shape {
        Shape {
            inputs: self.table.inputs(),
            hidden: hidden.to_vec(),
            activation: options.activation,
            window: self.window.clone(),
        }
    }

    /// Rows that train for a fold, and those that it holds out; all rows and none for `None`.
    pub(super) fn split(&self, held: Option<u16>) -> [Vec<usize>; 2] {
        let rows = || self.folds.iter().enumerate();
        let Some(held) = held else { return [rows().map(|(row, _)| row).collect(), Vec::new()] };
        let train = rows().filter(|(_, fold)| fold.trains(held)).map(|(row, _)| row).collect();
        [train, rows().filter(|(_, fold)| fold.held_out == held).map(|(row, _)| row).collect()]
    }
}

/// Columns, of the first `p` of `width`, that have two values at least.
fn varying(values: &[f64], p: usize, width: usize) -> Vec<usize> {
    let varies = |column: &usize| {
        let mut column_values = values.iter().skip(*column).step_by(width);
        let first = column_values.next();
        column_values.any(|value| Some(value) != first)
    };
    (0..p).filter(varies).collect()
}
