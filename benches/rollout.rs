//! Rollouts: 1,000 starts x 200 Euler steps of a piecewise-affine model with K = 50, 16 states, 2 inputs, beside vectorised numpy.
//!
//! Two models, because the search for the region is skipped while a state is known to be inside its cell:
//! - `gait`: oscillations of 5 Hz in steps of 1 ms, like the log of a running robot. The main case.
//! - `jumps`: the same a hundred times as fast: nearly every step needs a search. The worst case.
//!
//! Bias: numpy gets contiguous arrays in its own layout before the clock starts, and the fastest of four ways to write the step counts. Ours is
//! timed as a user calls it: starts checked, rows read from the source, inputs gathered, divergence and ranges watched, trajectories returned. Both
//! allocate their result within the clock, and both use all threads (numpy through its BLAS).

use std::{error::Error, path::Path};

use fleetfoot_benches::{
    best_of,
    hybrid::{COLUMNS, DT, INPUTS, REGIONS, STATES, model, recording},
    peak_rss_mib, peer, product_rate, read_f64, write_f64,
};
use fleetfoot_data::{MemorySource, Silent, Source, thread_count, with_threads};
use fleetfoot_dynamics::{Method, RolloutOptions, Simulator, Start, Starts, Step, Trajectory};
use fleetfoot_model::{Model, Rule};

const STARTS: usize = 1_000;
const STEPS: usize = 200;

fn main() -> Result<(), Box<dyn Error>> {
    println!(
        "rollouts, {STARTS} starts x {STEPS} Euler steps, K = {REGIONS}, {STATES} states, {INPUTS} inputs, {} threads",
        thread_count()
    );
    let rate = product_rate();
    let (map, search) = (COLUMNS * STATES, STATES * REGIONS);
    println!("f64 products of faer on one thread: {rate:.1} GFMA/s");
    println!(
        "floor of a step on one thread: map {:.1} ns, search {:.1} ns, both {:.1} ns",
        map as f64 / rate,
        search as f64 / rate,
        (map + search) as f64 / rate
    );
    case("gait", 5.0)?;
    case("jumps", 500.0)
}

fn case(name: &str, hertz: f64) -> Result<(), Box<dyn Error>> {
    let model = model(hertz);
    let source = recording(hertz);
    let simulator = Simulator::new(&model)?;
    assert!(simulator.is_affine());
    let mut options = RolloutOptions::new(STEPS);
    options.method = Method::Euler;
    options.step = Step::Seconds(DT);
    let needed = simulator.needed_rows(STEPS);
    let starts = Starts::Random { count: STARTS, seed: 7 }.choose(&source, STEPS, needed.before, needed.after)?;
    let run = || simulator.trajectories(&source, &starts, &options, &Silent);
    let (one_thread, _) = with_threads(1, || best_of(15, run));
    let (seconds, trajectories) = best_of(25, run);
    let trajectories: Vec<Trajectory> = trajectories?.into_iter().flatten().collect();
    let steps = (STARTS * STEPS) as f64;
    assert_eq!(trajectories.iter().map(Trajectory::steps).sum::<usize>(), STARTS * STEPS, "no trajectory ends early");
    let changes: usize =
        trajectories.iter().map(|t| t.regions.windows(2).filter(|pair| pair[0] != pair[1]).count()).sum();
    println!("\n{name}: the region changes every {:.1} steps", steps / changes as f64);
    println!("{:<22} {:>9} {:>9} {:>7} {:>9}", "", "ms", "ns/step", "ratio", "peak MiB");
    let row = |title: &str, s: f64, ratio: f64, peak: f64| {
        println!("{title:<22} {:>9.2} {:>9.1} {ratio:>7.1} {peak:>9.0}", s * 1e3, s * 1e9 / steps);
    };
    row("fleetfoot", seconds, 1.0, peak_rss_mib());
    row("fleetfoot, one thread", one_thread, one_thread / seconds, peak_rss_mib());

    let folder = tempfile::tempdir()?;
    write_problem(folder.path(), &model, &source, &starts)?;
    let numbers: Vec<String> =
        [STARTS, STEPS, STATES, INPUTS, REGIONS].iter().map(ToString::to_string).chain([DT.to_string()]).collect();
    let mut arguments = vec![folder.path()];
    arguments.extend(numbers.iter().map(Path::new));
    match peer("rollout.py", &arguments) {
        Err(reason) => println!("numpy                  absent: {reason}"),
        Ok(answer) => {
            let number = |key: &str| answer[key].as_f64().unwrap_or(f64::NAN);
            let label = format!(
                "numpy {} ({})",
                answer["version"].as_str().unwrap_or("?"),
                answer["variant"].as_str().unwrap_or("?")
            );
            row(&label, number("seconds"), number("seconds") / seconds, number("peak"));
            println!("its variants, s: {}", answer["all"]);
            let theirs = read_f64(&folder.path().join("numpy.f64"))?;
            let ours: Vec<f64> = trajectories.iter().flat_map(|t| t.states.iter().copied()).collect();
            assert_eq!(ours.len(), theirs.len());
            let largest = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            println!("largest difference of a state: {largest:.1e}");
            assert!(largest < 1e-9, "the answers differ");
        }
    }
    Ok(())
}

fn write_problem(folder: &Path, model: &Model, source: &MemorySource, starts: &[Start]) -> Result<(), Box<dyn Error>> {
    let partition = &model.partitions[0];
    let Rule::Linear { weights, offsets } = &partition.rule else {
        return Err("not a Voronoi partition".into());
    };
    let mut theta = Vec::new();
    for region in 0..REGIONS {
        for latent in &model.latents {
            theta.extend((0..latent.map.features()).map(|j| latent.map.coefficient(region, j)));
            theta.push(latent.map.constant(region));
        }
    }
    let (mut first, mut inputs) = (Vec::new(), Vec::new());
    for start in starts {
        let block = source.read(start.episode, start.row..start.row + STEPS, Default::default())?;
        first.extend((0..STATES).map(|i| block.core(i)[0]));
        inputs.extend((0..STEPS).flat_map(|k| (STATES..COLUMNS).map(move |i| (k, i))).map(|(k, i)| block.core(i)[k]));
    }
    for (name, values) in [
        ("theta", &theta),
        ("start", &first),
        ("inputs", &inputs),
        ("centre", &partition.centre),
        ("scale", &partition.scale),
        ("weights", &weights.concat()),
        ("offsets", offsets),
    ] {
        write_f64(&folder.join(format!("{name}.f64")), values)?;
    }
    Ok(())
}
