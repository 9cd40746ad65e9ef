//! Fig. 5: how the robot runs at each speed of the belt.

use fleetfoot::demo::{Gait, PHASE_BINS, phase_of};
use serde::Serialize;

use crate::{
    heatmap::HeatMap,
    table::{number, ratio, table},
};

pub(super) fn to_text(gaits: &[Gait]) -> String {
    let header = [
        "belt [m/s]",
        "stride [Hz]",
        "speed [m/s]",
        "no slip, eq. (2) [m/s]",
        "speed / no slip",
        "mean phase [rad]",
        "gathered",
        "tripod",
    ];
    let rows = gaits
        .iter()
        .map(|gait| {
            vec![
                format!("{:.3}", gait.belt_speed),
                format!("{:.2}", gait.stride_frequency),
                format!("{:.3}", gait.speed),
                format!("{:.3}", gait.no_slip_speed),
                ratio(gait.speed / gait.no_slip_speed),
                format!("{:+.2}", gait.mean_phase),
                format!("{:.2}", gait.concentration),
                format!("{:.0} %", 100.0 * gait.tripod),
            ]
        })
        .collect();
    let density = |bin: usize, run: usize| PHASE_BINS as f64 * gaits[run].phases[bin] as f64 / gaits[run].rows as f64;
    let map = HeatMap {
        title: "probability density of the leg phase over that of even phases, by speed of the belt",
        value: &density,
        columns: PHASE_BINS,
        rows: gaits.len(),
        row_label: &|run| format!("{:.3} m/s", gaits[run].belt_speed),
        below: &format!("{:<22}{:^4}{:>22}", "-pi", "0", "pi"),
    };
    format!(
        "Fig. 5. Leg phase alpha_l - alpha_r + pi: 0 is the alternating tripod. `gathered` is the length of the mean of exp(i phase), `tripod` the \
         share of rows within pi/4 of it (even phases: 25 %)\n{}\n\n{}\n{}",
        table(&header, rows),
        map.text(),
        summary(gaits)
    )
}

/// Summary of the gait: tripod phases, stride frequency and slip beside the paper's.
fn summary(gaits: &[Gait]) -> String {
    let Some(best) = gaits.iter().max_by(|a, b| a.tripod.total_cmp(&b.tripod)) else { return String::new() };
    let slower = gaits.iter().filter(|gait| gait.speed < gait.no_slip_speed).count();
    let ends = gaits.first().zip(gaits.last());
    let strides = ends.map_or(String::new(), |(slow, fast)| {
        format!(
            "stride frequency goes from {:.2} Hz at {:.2} m/s to {:.2} Hz at {:.2} m/s; ",
            slow.stride_frequency, slow.belt_speed, fast.stride_frequency, fast.belt_speed
        )
    });
    format!(
        "most of the alternating tripod: {:.0} % of the rows at {:.2} m/s, {:.1} Hz (the paper: 0.25 m/s, about 5 Hz)\n\
         {strides}slower than without slip in {slower} of {} runs, by {} % in the mean",
        100.0 * best.tripod,
        best.belt_speed,
        best.stride_frequency,
        gaits.len(),
        number(
            100.0 * gaits.iter().map(|gait| 1.0 - gait.speed / gait.no_slip_speed).sum::<f64>() / gaits.len() as f64
        ),
    )
}

/// Fig. 5 for programs: the phases of the bins' centres, and the runs.
#[derive(Serialize)]
pub(super) struct GaitReport<'a> {
    phase_bins: Vec<f64>,
    runs: &'a [Gait],
}

impl<'a> GaitReport<'a> {
    pub(super) fn new(gaits: &'a [Gait]) -> Self {
        Self { phase_bins: (0..PHASE_BINS).map(phase_of).collect(), runs: gaits }
    }
}
