//! Parts of `--objective steps:N`: sensitivities of a rollout by the coefficients beside the same rollout without them,
//! and a refinement of a million rows.
//!
//! **Sensitivities**: segments of 20 steps of a piecewise-affine model with K = 50, 16 states, 2 inputs, all of whose
//! numbers are free (15,200). The tangents S of a segment are 16 x p for the p numbers of its regions, 304 a region. A
//! step multiplies them by the map's 16 x 16: 256 p multiply-adds. The rollout itself takes 1,088 with the search for
//! its region. That is the floor; it leaves out the columns of regions that are not entered yet. Checked against
//! central differences of simulations in the same run.
//!
//! **Refinement**: 1,000,000 rows of the same robot. Of its 16 states eight are derivatives of the others and eight
//! follow five terms each, so that K = 50 has 2,000 coefficients, for which J'J is held whole. The rows are simulated
//! and measured with noise; the fit begins 2 % beside the truth. Its cost has to end at or below that of the truth.
//!
//! No peer has either. Bias: rollouts are timed by the command that a user calls; sensitivities as a pass takes them, with the simulation, the residuals and their derivatives.

use std::{error::Error, time::Instant};

use fleetfoot_benches::{
    best_of, cpu_seconds,
    hybrid::{self, COLUMNS, DT, REGIONS, STATES, model, recording},
    peak_rss_mib, product_rate, reset_peak_rss,
};
use fleetfoot_data::{Block, Column, MemorySource, Silent, Source, thread_count, with_threads};
use fleetfoot_dynamics::{
    Coefficient, Method, Products, RolloutOptions, Segment, Shooting, ShootingOptions, Simulator, Start, Step,
};
use fleetfoot_estimate::{Simulated, SimulationOptions, WHOLE_COEFFICIENTS, simulation_error};
use fleetfoot_library::Expr;
use fleetfoot_model::Model;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const STEPS: usize = 20;
/// Segments of an episode of the recording, and those that are timed with their sensitivities: a short run may find the processor free.
const SEGMENTS: usize = 99;
const TIMED: usize = 11;
/// Episodes and rows of the refinement.
const EPISODES: usize = 50;
const ROWS: usize = 20_000;
/// Measurement noise, over the size of the oscillations.
const NOISE: f64 = 0.01;
/// Trial steps.
const ITERATIONS: usize = 5;
/// Relative distance of the fit's start from the truth.
const BESIDE: f64 = 0.02;

fn main() -> Result<(), Box<dyn Error>> {
    println!(
        "sensitivities and refinement, K = {REGIONS}, {STATES} states, segments of {STEPS} steps, {} threads",
        thread_count()
    );
    let rate = product_rate();
    println!("f64 products of faer on one thread: {rate:.1} GFMA/s");
    for (name, model, hertz) in
        [("gait", model(5.0), 5.0), ("jumps", model(500.0), 500.0), ("gait, five terms", sparse(5.0), 5.0)]
    {
        for method in [Method::Euler, Method::Rk4] {
            sensitivities(name, &model, &recording(hertz), method, rate)?;
        }
    }
    refinement()
}

fn sensitivities(
    name: &str,
    model: &Model,
    source: &MemorySource,
    method: Method,
    rate: f64,
) -> Result<(), Box<dyn Error>> {
    let mut options = ShootingOptions::new(STEPS);
    (options.method, options.divergence) = (method, 1e3);
    let support = Coefficient::support(model);
    let shooting = Shooting::new(model, source, &support, &options)?;
    let plain = Simulator::new(model)?;
    let starts: Vec<Start> = (0..SEGMENTS).map(|i| Start { episode: 0, row: 1 + i * STEPS }).collect();
    let mut rollout = RolloutOptions::new(STEPS);
    (rollout.method, rollout.step) = (method, Step::Median);
    let block = source.read(0, 0..source.episodes()[0].rows, shooting.halo())?;
    let mut width = 0;
    let (with, ()) = with_threads(1, || {
        best_of(25, || {
            width = 0;
            shooting.segments(0, &block, 0..TIMED * STEPS, |segment| width += segment.active.len());
        })
    });
    let (alone, trajectories) =
        with_threads(1, || best_of(40, || plain.trajectories(source, &starts, &rollout, &Silent)));
    assert_eq!(
        trajectories?.into_iter().flatten().map(|trajectory| trajectory.steps()).sum::<usize>(),
        SEGMENTS * STEPS
    );
    let (alone, with) = (alone * 1e9 / (SEGMENTS * STEPS) as f64, with * 1e9 / (TIMED * STEPS) as f64);
    let width = width as f64 / TIMED as f64;
    let stages = if method == Method::Rk4 { 4.0 } else { 1.0 };
    let floor = stages * (STATES * STATES) as f64 * width / rate;
    println!(
        "\n{name}, {method:?}: {} numbers a region, {width:.0} of those that a segment meets, one thread",
        support.len() / REGIONS
    );
    println!("rollout alone          {alone:>9.0} ns/step");
    println!(
        "with sensitivities     {with:>9.0} ns/step, {:.0} times; a number {:.2} ns/step, {:.3} times the rollout",
        with / alone,
        with / width,
        with / width / alone
    );
    println!("floor of full tangents {floor:>9.0} ns/step; {:.1} times that", with / floor);
    products(&shooting, &block, support.len(), alone);
    differences(model, source, &options)
}

/// The product J'J v of a direction of all coefficients, held against the derivatives themselves.
fn products(shooting: &Shooting<'_>, block: &Block, count: usize, alone: f64) {
    let mut random = Pcg64::seed_from_u64(5);
    let direction: Vec<f64> = (0..count).map(|_| random.random_range(-1.0..1.0)).collect();
    let rows = 0..TIMED * STEPS;
    let (seconds, product) = with_threads(1, || {
        best_of(25, || {
            let mut product = Products::new(count);
            shooting.products(0, block, (rows.clone(), 1), Some(&direction), &mut product);
            product
        })
    });
    let mut dense = vec![0.0; count];
    shooting.segments(0, block, rows, |segment| {
        let n = segment.residuals.len();
        let columns = || segment.active.iter().zip(segment.slopes.chunks_exact(n));
        let mut along = vec![0.0; n];
        for (&number, slopes) in columns() {
            along.iter_mut().zip(slopes).for_each(|(sum, slope)| *sum += slope * direction[number]);
        }
        for (&number, slopes) in columns() {
            dense[number] += slopes.iter().zip(&along).map(|(slope, along)| slope * along).sum::<f64>();
        }
    });
    let size = dense.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
    let apart = dense.iter().zip(&product.back).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / size;
    let step = seconds * 1e9 / (TIMED * STEPS) as f64;
    println!("a product J'J v        {step:>9.0} ns/step, {:.1} times the rollout; {apart:.1e} apart", step / alone);
    assert!(apart < 1e-10, "the product is not that of the derivatives");
}

/// The segments of the first episode.
fn segments(
    model: &Model,
    source: &MemorySource,
    coefficients: &[Coefficient],
    options: &ShootingOptions,
) -> Result<Vec<Segment>, Box<dyn Error>> {
    let shooting = Shooting::new(model, source, coefficients, options)?;
    let block = source.read(0, 0..source.episodes()[0].rows, shooting.halo())?;
    let mut collected = Vec::new();
    shooting.segments(0, &block, 0..SEGMENTS * STEPS, |segment| collected.push(segment));
    Ok(collected)
}

/// Holds sensitivities against central differences of simulations, for numbers spread over those that move a segment. A difference across which a step changes its
/// region is none: a hundredth of them may be.
fn differences(model: &Model, source: &MemorySource, options: &ShootingOptions) -> Result<(), Box<dyn Error>> {
    let support = Coefficient::support(model);
    let base = segments(model, source, &support, options)?;
    let mut met: Vec<usize> = base.iter().flat_map(|segment| segment.active.iter().copied()).collect();
    met.sort_unstable();
    met.dedup();
    let (mut errors, size) =
        (Vec::new(), |segment: &Segment| segment.slopes.iter().fold(0.0_f64, |a, b| a.max(b.abs())));
    for &number in met.iter().step_by(met.len() / 24) {
        let value = support[number].value(model);
        let step = 1e-6 * value.abs().max(1.0);
        let moved = |sign: f64| {
            let mut model = model.clone();
            support[number].set(&mut model, value + sign * step);
            segments(&model, source, &[], options)
        };
        for ((base, more), less) in base.iter().zip(moved(1.0)?).zip(moved(-1.0)?) {
            let (n, size) = (base.residuals.len(), size(base));
            let at = base.active.iter().position(|&active| active == number);
            errors.extend((0..n).map(|row| {
                let difference = (more.residuals[row] - less.residuals[row]) / (2.0 * step);
                (at.map_or(0.0, |at| base.slopes[at * n + row]) - difference).abs() / size
            }));
        }
    }
    errors.sort_unstable_by(f64::total_cmp);
    let within = errors[errors.len() * 99 / 100];
    println!(
        "central differences    {:.1e} apart, over the largest of a segment (99 of 100 of {})",
        within,
        errors.len()
    );
    assert!(within < 1e-5, "the sensitivities are not those of the simulations");
    Ok(())
}

/// The robot with as many coefficients as a whole J'J may have. Half of the states are given by the others, which
/// follow themselves, their partner, the next pair and a constant in each region.
fn sparse(hertz: f64) -> Model {
    let mut model = model(hertz);
    let names = hybrid::names();
    let omega = std::f64::consts::TAU * hertz;
    for state in (0..STATES).step_by(2) {
        let equation = &mut model.equations[state];
        let [coordinate, partner] = [state, state + 1].map(|column| Expr::column(names[column].as_str()));
        (equation.right, equation.target) = (omega * partner - 0.1 * omega * coordinate, None);
    }
    let fitted = |name: &str| (1..STATES).step_by(2).any(|state| name == format!("f{state}"));
    model.latents.retain(|latent| fitted(&latent.name));
    for (latent, state) in model.latents.iter_mut().zip((1..STATES).step_by(2)) {
        let kept = [state - 1, state, (state + 1) % STATES, (state + 2) % STATES];
        for coefficients in &mut latent.affine_mut().expect("an affine latent").coefficients {
            let zero = |(column, value): (usize, &mut f64)| *value = if kept.contains(&column) { *value } else { 0.0 };
            coefficients.iter_mut().enumerate().for_each(zero);
        }
    }
    let targets = STATES / 2;
    let training = &mut model.training;
    training.target_mean.truncate(targets);
    training.target_deviation.truncate(targets);
    training.target_covariance.truncate(targets * (targets + 1) / 2);
    for region in &mut model.summaries[0].regions {
        region.residual_covariance.truncate(targets * (targets + 1) / 2);
    }
    model
}

/// Simulated episodes of the model, from beginnings and with inputs of oscillations, measured with noise.
fn measured(model: &Model, hertz: f64) -> Result<MemorySource, Box<dyn Error>> {
    let mut random = Pcg64::seed_from_u64(11);
    let mut asked = MemorySource::new(hybrid::names().into_iter().map(Column::float).collect());
    let mut measured = MemorySource::new(hybrid::names().into_iter().map(Column::float).collect());
    let mut inputs = Vec::new();
    for episode in 0..EPISODES {
        let columns: Vec<Vec<f64>> = (0..COLUMNS)
            .map(|_| {
                let frequency = std::f64::consts::TAU * hertz * random.random_range(0.8..1.2);
                let phase: f64 = random.random_range(0.0..std::f64::consts::TAU);
                (0..ROWS).map(|k| 1.3 * (frequency * DT * k as f64 + phase).sin()).collect()
            })
            .collect();
        inputs.push(columns[STATES..].to_vec());
        asked.push_uniform(format!("run {episode}"), DT, columns);
    }
    let mut options = RolloutOptions::new(ROWS - 2);
    (options.method, options.step) = (Method::Rk4, Step::Median);
    let starts: Vec<Start> = (0..EPISODES).map(|episode| Start { episode, row: 1 }).collect();
    let trajectories = Simulator::new(model)?.trajectories(&asked, &starts, &options, &Silent)?;
    for (episode, (trajectory, inputs)) in trajectories.into_iter().flatten().zip(inputs).enumerate() {
        assert_eq!(trajectory.steps(), ROWS - 2, "the robot keeps running");
        // The sum of twelve uniform numbers is normal enough.
        let mut noise = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let state = |s: usize| trajectory.states[s..].iter().step_by(STATES).map(|x| x + NOISE * noise()).collect();
        let mut columns: Vec<Vec<f64>> = (0..STATES).map(state).collect();
        columns.extend(inputs.into_iter().map(|values| values[1..].to_vec()));
        measured.push_uniform(format!("run {episode}"), DT, columns);
    }
    Ok(measured)
}

fn refinement() -> Result<(), Box<dyn Error>> {
    let hertz = 5.0;
    let truth = sparse(hertz);
    let source = measured(&truth, hertz)?;
    let rows: usize = source.episodes().iter().map(|episode| episode.rows).sum();
    let support = Coefficient::support(&truth);
    assert_eq!(support.len(), WHOLE_COEFFICIENTS);
    let mut random = Pcg64::seed_from_u64(5);
    let mut beside = truth.clone();
    for coefficient in &support {
        coefficient.set(&mut beside, coefficient.value(&truth) * (1.0 + BESIDE * random.random_range(-1.0..1.0)));
    }
    let mut options = SimulationOptions::new(STEPS);
    options.descent.max_iterations = ITERATIONS;
    let cost_of = |model: &Model| -> Result<f64, Box<dyn Error>> {
        let mut one = options.clone();
        one.descent.max_iterations = 0;
        Ok(simulation_error(model, &source, &one, &Silent)?.cost[0])
    };
    println!("\nrefinement of {rows} rows, {} coefficients, {ITERATIONS} trial steps at most", support.len());
    let (started, _) = (Instant::now(), cost_of(&beside)?);
    println!("one pass and its decomposition {:.1} s", started.elapsed().as_secs_f64());
    let best = cost_of(&truth)?;
    reset_peak_rss();
    let (started, cpu) = (Instant::now(), cpu_seconds());
    let refined = simulation_error(&beside, &source, &options, &Silent)?;
    let Simulated { passes, cost, status, gradient, segments, ended, .. } = &refined;
    println!(
        "{passes} passes over {segments} segments in {:.1} s ({:.1} s of processors), peak {:.0} MiB",
        started.elapsed().as_secs_f64(),
        cpu_seconds() - cpu,
        peak_rss_mib()
    );
    println!(
        "cost {:.6} before, {:.6} after, {best:.6} of the truth; {ended:?} segments ended; {status:?}, gradient {gradient:.1e}",
        cost[0], cost[1]
    );
    let apart = |model: &Model| {
        // Regions that hardly a row is in leave theirs free.
        let apart = |c: &Coefficient| (c.value(model) / c.value(&truth) - 1.0).abs();
        let mut apart: Vec<f64> = support.iter().map(apart).collect();
        apart.sort_unstable_by(f64::total_cmp);
        apart[apart.len() / 2]
    };
    println!(
        "coefficients {:.4} from the truth before, {:.4} after, the median",
        apart(&beside),
        apart(&refined.model)
    );
    assert!(cost[1] <= best && cost[1] < cost[0], "the fit is better on its rows than the truth");
    Ok(())
}
