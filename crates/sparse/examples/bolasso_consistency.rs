//! Theorem 7.1 of the block-sparse bolasso paper (Bach 2008) as an experiment: how often the lasso and the bolasso select the true columns, and no others,
//! against the number of rows, at lambda = 1 / sqrt(n).
//!
//! `cargo run --release --example bolasso_consistency -p fleetfoot-sparse`

use std::error::Error;

use fleetfoot_data::{Column, MemorySource, Silent};
use fleetfoot_library::Expr;
use fleetfoot_sparse::{
    bolasso::{BootstrapOptions, bach_lambda, row_bootstrap},
    lars::{LarsOptions, lars},
    structured::{Assembly, Banks, Candidates, Plan, Regression, Task, Term},
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const COLUMNS: usize = 16;
const TRIALS: u64 = 200;

fn main() -> Result<(), Box<dyn Error>> {
    println!("y = x0 + x1 + noise, {COLUMNS} columns, {TRIALS} trials; share with exactly the two true columns");
    for correlated in [false, true] {
        println!(
            "\n{}",
            if correlated { "x2 two thirds of x0 and of x1: irrepresentable" } else { "independent columns" }
        );
        println!("{:>6} {:>7} {:>12} {:>12} {:>12}", "n", "lasso", "bolasso 32", "bolasso 128", "bolasso 512");
        for n in [25, 50, 100, 200, 400, 800, 1600, 3200] {
            let mut right = [0.0; 4];
            for trial in 0..TRIALS {
                let found = select(n, 10_000 * n as u64 + trial, correlated)?;
                right.iter_mut().zip(found).for_each(|(right, found)| *right += f64::from(u8::from(found)));
            }
            let [lasso, small, usual, large] = right.map(|right| right / TRIALS as f64);
            println!("{n:>6} {lasso:>7.3} {small:>12.3} {usual:>12.3} {large:>12.3}");
        }
    }
    Ok(())
}

/// Whether the lasso, and the bolasso with 32, 128 and 512 replicates, select the true columns.
fn select(n: usize, seed: u64, correlated: bool) -> Result<[bool; 4], Box<dyn Error>> {
    let (source, regression) = rows(n, seed, correlated);
    let assembly = Assembly { weights: vec![1.0], ..Assembly::default() };
    let plan = Plan::new(regression, Vec::new(), 4096, &source)?;
    let lambda = bach_lambda(1.0, n as f64);
    let roots = Banks::new(&plan.scan(&source, &Silent)?, |_| true).total();
    let assembled = plan.regression.structure().assemble(&roots, &assembly)?;
    let path =
        lars(&assembled.problem, &assembled.penalty, &LarsOptions { lambda_min: lambda, ..LarsOptions::default() })?;
    let lasso = path.at(&assembled.problem, lambda)?.support;
    let mut right = [lasso == [0, 1]; 4];
    for (right, replicates) in right[1..].iter_mut().zip([32, 128, 512]) {
        let options = BootstrapOptions { replicates, seed, ..BootstrapOptions::new(lambda) };
        *right = row_bootstrap(&plan, &assembly, &source, &options, &Silent)?.support == [0, 1];
    }
    Ok(right)
}

fn rows(n: usize, seed: u64, correlated: bool) -> (MemorySource, Regression) {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut gaussian = || {
        let (u, v): (f64, f64) = (random.random(), random.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    };
    let names: Vec<String> = (0..COLUMNS).map(|j| format!("x{j}")).chain(["y".to_owned()]).collect();
    let mut values = vec![Vec::new(); COLUMNS + 1];
    for _ in 0..n {
        let mut row: Vec<f64> = (0..COLUMNS).map(|_| gaussian()).collect();
        if correlated {
            row[2] = (2.0 * row[0] + 2.0 * row[1] + row[2]) / 3.0;
        }
        row.push(row[0] + row[1] + gaussian());
        values.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
    }
    let mut source = MemorySource::new(names.iter().map(Column::float).collect());
    source.push_uniform("rows", 1.0, values);
    let functions = names[..COLUMNS].iter().map(|name| Expr::column(name.as_str())).collect();
    let terms = vec![Term { latent: 0, coefficient: Expr::number(1.0) }];
    let task = Task { name: "y".into(), target: Expr::column("y"), terms, prior: false };
    let latents = vec![Candidates { name: "f".into(), functions }];
    (source, Regression { latents, tasks: vec![task], weight: None })
}
