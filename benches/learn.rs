//! One training pass of a network (values and gradient of all rows, the output layer given): 22 inputs, 2 x 64 tanh, 8 outputs, beside the multiply-adds of the processor.
//!
//! Every row takes three products of each layer (forward, and two backward but for the first layer's). The limit is that of products in registers; `tanh` and the copies of
//! tiles come on top. The pass that solves the output layer is timed too: its products are those of the Gram matrix.

use std::error::Error;

use fleetfoot_benches::{best_of, product_rate};
use fleetfoot_data::{Silent, mix, thread_count};
use fleetfoot_learn::{Activation, Shape, Table, Units, slope, statistic};

const INPUTS: usize = 22;
const TARGETS: usize = 8;
const ROWS: usize = 200_000;

fn main() -> Result<(), Box<dyn Error>> {
    let uniform = |key: usize| (mix(key as u64) >> 11) as f64 * 2f64.powi(-53);
    let values = (0..ROWS * (INPUTS + TARGETS)).map(uniform).collect();
    let table = Table::new(INPUTS, TARGETS, values)?;
    let all: Vec<usize> = (0..ROWS).collect();
    let samples = table.samples(&all, &Units::of(&table, &all)?);
    let shape = Shape { inputs: INPUTS, hidden: vec![64, 64], activation: Activation::Tanh, window: None };
    let parameters = shape.initial(0);
    let (features, threads) = (shape.features(), thread_count() as f64);
    let layers = [INPUTS * 64, 64 * 64].map(|weights| weights as f64);
    let output = (TARGETS * (INPUTS + features)) as f64;
    let products = 3.0 * (layers[0] + layers[1] + output) - layers[0];
    let width = (1 + INPUTS + features + TARGETS) as f64;
    let rate = product_rate();
    println!("{ROWS} rows, {threads} threads, {rate:.1} GFMA/s a thread in large products");
    let (seconds, sums) = best_of(3, || statistic(&shape, &parameters, &samples, &Silent));
    let solved = sums?.solve(1e-6)?;
    let line = |name: &str, seconds: f64, products: f64| {
        let rows = ROWS as f64 / seconds;
        let share = rows * products / (rate * 1e9 * threads);
        println!("{name}: {:.3} M rows/s, {:.0} % of the multiply-adds", rows / 1e6, 100.0 * share);
    };
    line("sums of the output layer", seconds, layers[0] + layers[1] + width * width);
    let tiles: Vec<usize> = (0..samples.tiles()).collect();
    let (seconds, result) = best_of(3, || slope(&shape, &parameters, &solved, (&samples, &tiles), &Silent));
    line("values and gradient", seconds, products);
    assert!(result?.loss.is_finite());
    Ok(())
}
