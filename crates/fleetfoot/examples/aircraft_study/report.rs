//! The figures as text.

use std::time::Duration;

use super::{
    errors::Errors,
    hidden::{Hidden, median},
    selection::Aircraft,
    tables::functions,
};

/// Where the time went, all aircraft together.
#[derive(Debug, Default)]
pub(crate) struct Times {
    pub(crate) flights: Duration,
    pub(crate) scan: Duration,
    pub(crate) select: Duration,
}

/// One aircraft in a line.
pub(crate) fn line(aircraft: &Aircraft) -> String {
    let truth = |j: &usize| aircraft.truth[*j] != 0.0;
    let support = &aircraft.selection.support;
    let matches = support.iter().copied().filter(|j| truth(j)).count();
    let cross = &aircraft.cross_validation;
    format!(
        "aircraft {:>2}: {} rows, lambda {:.1e} (best {:.1e}, one standard error {:.1e}), {} of {} true functions and {} others selected; kkt {:.0e}, \
         {} replicates finished by coordinate descent, {} short of their tolerance",
        aircraft.number,
        aircraft.rows,
        aircraft.lambda,
        cross.best_lambda(),
        cross.one_standard_error_lambda(),
        matches,
        aircraft.truth.iter().filter(|value| **value != 0.0).count(),
        support.len() - matches,
        aircraft.selection.worst_kkt,
        aircraft.selection.stalled,
        aircraft.selection.unconverged,
    )
}

/// Figure 2.
pub(crate) fn frequencies(fleet: &[Aircraft]) {
    println!("\nFigure 2: selection frequencies, mean over {} aircraft; aircraft that select; * is true", fleet.len());
    let mut last = "";
    for (j, (latent, text)) in functions().iter().enumerate() {
        if *latent != last {
            println!("{latent}");
            last = latent;
        }
        let mean = fleet.iter().map(|a| a.selection.frequency[j]).sum::<f64>() / fleet.len().max(1) as f64;
        let selected = fleet.iter().filter(|a| a.selection.support.contains(&j)).count();
        let mark = if fleet.iter().any(|a| a.truth[j] != 0.0) { '*' } else { ' ' };
        println!("  {mark} {text:<16} {mean:>6.3} {selected:>4}  {}", "#".repeat((mean * 40.0).round() as usize));
    }
    let p = functions().len();
    let agree = |j: usize| fleet.iter().filter(|a| a.selection.support.contains(&j)).count();
    let same = (0..p).filter(|&j| [0, fleet.len()].contains(&agree(j))).count();
    println!("{same} of {p} functions are selected for all aircraft or for none");
    println!(
        "True functions that are missed, and what the selected ones leave of them (relative length, the largest of the aircraft):"
    );
    for (j, (_, text)) in functions().iter().enumerate() {
        let left: Vec<f64> =
            fleet.iter().flat_map(|a| &a.missed).filter(|(k, _)| *k == j).map(|(_, left)| *left).collect();
        if !left.is_empty() {
            let most = left.iter().fold(0.0f64, |most, &left| most.max(left));
            println!("  {text:<16} missed by {:>2} aircraft, {most:.1e} left", left.len());
        }
    }
}

/// Figure 3.
pub(crate) fn errors(left: &Errors) {
    println!("\nFigure 3: flights left out, medians of the mean squared errors");
    println!("                            V' m^2/s^4  gamma' rad^2/s^2     m' kg^2/s^2");
    let row = |name: &str, of: &dyn Fn(usize) -> Vec<f64>| {
        let medians: Vec<String> = (0..3).map(|k| format!("{:>15.4e}", median(&mut of(k)))).collect();
        println!("{name:<24} {}", medians.join(" "));
    };
    row(&format!("bolasso, {} flights", left.flights.len()), &|k| left.flights.iter().map(|f| f.bolasso[k]).collect());
    let both = || left.flights.iter().filter(|f| f.nonlinear.is_some());
    row(&format!("bolasso, {} of them", both().count()), &|k| both().map(|f| f.bolasso[k]).collect());
    row("nonlinear, the same", &|k| both().filter_map(|f| f.nonlinear.map(|e| e[k])).collect());
    println!(
        "{} refits {:.2} s; {} fits of nonlinear least squares {:.1} s, {} not converged",
        left.flights.len(),
        left.bolasso_time.as_secs_f64(),
        both().count(),
        left.nonlinear_time.as_secs_f64(),
        left.unconverged
    );
}

/// Figure 5.
pub(crate) fn hidden(estimates: &[Hidden]) {
    println!(
        "\nFigure 5: latents over the true ones (medians), rows with negative drag, errors of the derivatives (rms)"
    );
    println!(
        "{:<40} {:>6} {:>6} {:>6} {:>6} {:>9}   V' m/s^2  gamma' rad/s    m' kg/s  lambda    functions",
        "", "T", "D", "L", "Isp", "D < 0"
    );
    for hidden in estimates {
        let [t, d, l, i] = hidden.over_true;
        let [v, g, m] = hidden.errors;
        let lambda = hidden.lambda.map_or_else(|| "-".into(), |lambda| format!("{lambda:.1e}"));
        println!(
            "{:<40} {t:>6.3} {d:>6.3} {l:>6.3} {i:>6.3} {:>8.2}% {v:>10.5} {g:>13.3e} {m:>10.5}  {lambda:<8} {:>8}",
            hidden.method,
            100.0 * hidden.negative_drag as f64 / hidden.rows.max(1) as f64,
            hidden.functions
        );
    }
}

/// Rows, time and memory.
pub(crate) fn times(fleet: &[Aircraft], times: &Times) {
    let rows: u64 = fleet.iter().map(|aircraft| aircraft.rows).sum();
    println!(
        "\n{rows} rows of {} aircraft: flying {:.1} s, scanning {:.1} s, choosing lambda and bolasso {:.1} s{}",
        fleet.len(),
        times.flights.as_secs_f64(),
        times.scan.as_secs_f64(),
        times.select.as_secs_f64(),
        peak().map_or_else(String::new, |peak| format!("; peak memory {} MiB", peak / 1024))
    );
}

/// Peak resident set size in KiB, where the system tells it.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix("kB")?.trim().parse().ok())
}
