//! `fleetfoot prepare`.

use std::collections::{BTreeMap, BTreeSet};

use fleetfoot::{
    Error, Recipe,
    clocks::AlignedClock,
    prepare::{
        BodyReport, ChannelReport, JointReport, Places, PrepareReport, PrepareRequest, RejectedPoses, prepare as run,
    },
};

use super::{Context, files, flags};
use crate::{
    args::Prepare,
    table::{count, number, seconds, table},
};

pub(crate) fn prepare(arguments: &Prepare, context: &Context) -> Result<(), Error> {
    let mut recipe = Recipe::read(&arguments.recipe)?;
    flags::apply_time(&mut recipe, &arguments.time)?;
    recipe.override_with(arguments.prepare.clone());
    recipe.cache = flags::cache(&arguments.time.channels, &arguments.output);
    let files = files(&arguments.data)?;
    let request = PrepareRequest { folder: arguments.output.clone(), force: arguments.force };
    let bar = context.bar();
    let prepared = run(&recipe, &request, &files, &bar);
    bar.finish();
    let prepared = prepared?;
    context.notes(&prepared.report.notes);
    context.print(prepared.to_json(), || to_text(&prepared.report));
    let folder = arguments.output.display();
    context.say(format!(
        "wrote {} and {} recipe in {folder}; next: fleetfoot fit sindy -c {} {folder}",
        count(prepared.files.len(), "clean episode"),
        if prepared.files.len() == 1 { "its" } else { "their" },
        prepared.recipe.display()
    ));
    Ok(())
}

/// Preparation of one channel over all pieces.
#[derive(Default)]
struct Row<'a> {
    pieces: Vec<&'a ChannelReport>,
}

impl Row<'_> {
    fn rows(&self, of: impl Fn(&ChannelReport) -> &Places) -> usize {
        self.pieces.iter().map(|piece| of(piece).rows).sum()
    }

    /// Smoothing methods of the pieces.
    fn methods(&self) -> Vec<&str> {
        let methods: BTreeSet<&str> = self.pieces.iter().map(|piece| piece.method.as_str()).collect();
        methods.into_iter().collect()
    }

    /// The least and the greatest of the pieces, or the one that they share.
    fn span(&self, of: impl Fn(&ChannelReport) -> Option<f64>) -> String {
        let mut values: Vec<f64> = self.pieces.iter().filter_map(|piece| of(piece)).collect();
        values.sort_by(f64::total_cmp);
        match (values.first(), values.last()) {
            (Some(low), Some(high)) if number(*low) == number(*high) => number(*low),
            (Some(low), Some(high)) => format!("{} to {}", number(*low), number(*high)),
            _ => "-".into(),
        }
    }

    fn cells(&self, channel: &str) -> Vec<String> {
        let left_out = |of: fn(&ChannelReport) -> &Places| self.rows(of).to_string();
        vec![
            channel.to_owned(),
            self.methods().join(", "),
            self.pieces.iter().map(|piece| piece.missing).sum::<usize>().to_string(),
            left_out(|piece| &piece.saturated),
            left_out(|piece| &piece.stuck),
            left_out(|piece| &piece.hampel),
            left_out(|piece| &piece.rejected),
            left_out(|piece| &piece.left_empty),
            self.span(|piece| piece.noise),
            // Penalties of two splines are no span.
            if self.methods().len() > 1 { "-".into() } else { self.span(|piece| piece.lambda) },
            self.span(|piece| Some(piece.smoothed)),
        ]
    }
}

fn to_text(report: &PrepareReport) -> String {
    let mut rows: BTreeMap<&str, Row<'_>> = BTreeMap::new();
    for channel_report in report.pieces().flat_map(|piece| &piece.channels) {
        rows.entry(&channel_report.channel).or_default().pieces.push(channel_report);
    }
    let header = [
        "channel",
        "method",
        "missing",
        "saturated",
        "stuck",
        "Hampel",
        "rejected",
        "left empty",
        "noise",
        "lambda",
        "smoothed over, s",
    ];
    let cells = rows.iter().map(|(channel, row)| row.cells(channel)).collect();
    let ends = [
        (report.episodes.iter().map(|episode| episode.clipped).sum::<usize>(), "clipped"),
        (
            report.episodes.iter().map(|episode| episode.untold.rows).sum(),
            "before, between or after the sensors' readings",
        ),
        (report.episodes.iter().map(|episode| episode.out_of_bounds.rows).sum(), "out of bounds"),
        (report.episodes.iter().map(|episode| episode.too_short.rows).sum(), "in pieces that are too short"),
    ];
    let ends: String = ends.iter().filter(|(rows, _)| *rows > 0).map(|(rows, why)| format!(", {rows} {why}")).collect();
    let doubts: String = rows.iter().flat_map(|(channel, row)| doubts(channel, row)).collect();
    let channels = if rows.is_empty() { String::new() } else { format!("{}\n", table(&header, cells)) };
    format!(
        "{} rows of {}{ends}\n{} rows in {} written, smoothed over {} at most\n{channels}{}{}{}{}{}{}{doubts}",
        report.rows,
        count(report.episodes.len(), "episode"),
        report.written,
        count(report.pieces().count(), "piece"),
        seconds(report.smoothed),
        report.body.as_ref().map(body).unwrap_or_default(),
        joints(&report.joints),
        topics(&rows),
        clocks(report),
        report.clocks.iter().map(aligned).collect::<String>(),
        left_out(report),
    )
}

/// Calibration that fusion estimated for a body's sensors, with its standard deviations.
fn body(fused: &BodyReport) -> String {
    let list = |values: &[f64]| values.iter().map(|value| number(*value)).collect::<Vec<_>>().join(", ");
    let with = |values: &[f64], deviations: &[f64]| match deviations.iter().any(|deviation| *deviation > 0.0) {
        true => format!("{} (deviations {})", list(values), list(deviations)),
        false => format!("{}, as given", list(values)),
    };
    let gravity = match fused.gravity_deviation.iter().any(|deviation| *deviation > 0.0) {
        true => format!(" (deviations of its direction {} rad)", list(&fused.gravity_deviation)),
        false => ", as given".into(),
    };
    let rejected = |of: fn(&RejectedPoses) -> &Places| fused.rejected.iter().map(|log| of(log).rows).sum::<usize>();
    // Without an accelerometer gravity is not felt.
    let (gravity, moved) = match fused.jerk {
        None => (
            format!("  gravity   {} m/s^2{gravity}\n", list(&fused.gravity)),
            format!("force {} m/s^2/sqrt(Hz)", list(&fused.imu_noise[1])),
        ),
        Some(jerk) => (String::new(), format!("jerk {} m/s^3/sqrt(Hz)", number(jerk))),
    };
    let noise = if fused.noise_fitted { noise_text(fused) } else { String::new() };
    format!(
        "fused {}: {} positions and {} attitudes left out, {} without readings\n  lever     {} m\n  mounting  {}\n  delay     {} s\n{gravity}  noise     rate {} rad/s/sqrt(Hz), {moved}, position {} m, attitude {} rad, {}\n{noise}",
        count(fused.poses, "pose"),
        rejected(|log| &log.positions),
        rejected(|log| &log.attitudes),
        fused.outside,
        with(&fused.lever, &fused.lever_deviation),
        with(&fused.mounting, &fused.mounting_deviation),
        with(&[fused.delay], &[fused.delay_deviation]),
        list(&fused.imu_noise[0]),
        number(fused.pose_noise[0]),
        number(fused.pose_noise[1]),
        if fused.noise_fitted { "estimated from the residuals" } else { "as given" },
    )
}

/// Noise beside the densities: deviation of single readings and random walk of biases, with their standard deviations.
fn noise_text(body: &BodyReport) -> String {
    let axes = |which: usize, unit: &str| {
        let (values, deviations) = (body.reading_noise[which], body.reading_noise_deviation[which]);
        let axis = |(value, deviation): (&Option<f64>, &Option<f64>)| match (value, deviation) {
            (Some(value), Some(deviation)) => format!("{} +- {}", number(*value), number(*deviation)),
            _ => "unknown".into(),
        };
        let known = values.iter().flatten().count() > 0;
        known.then(|| format!("{} {unit}", values.iter().zip(&deviations).map(axis).collect::<Vec<_>>().join(", ")))
    };
    let readings =
        [axes(0, "rad/s").map(|axes| format!("rate {axes}")), axes(1, "m/s^2").map(|axes| format!("force {axes}"))];
    let readings = readings.into_iter().flatten().collect::<Vec<_>>().join(", ");
    let walk = |which: usize, unit: &str| match body.imu_walk_deviation[which] {
        Some(0.0) => None,
        Some(deviation) => Some(format!("{} +- {} {unit}", number(body.imu_walk[which]), number(deviation))),
        None => Some(format!("{} {unit} (not identifiable from this recording)", number(body.imu_walk[which]))),
    };
    let walks = [
        walk(0, "rad/s^2/sqrt(Hz)").map(|walk| format!("bias of the rate {walk}")),
        walk(1, "m/s^3/sqrt(Hz)").map(|walk| format!("of the force {walk}")),
    ];
    let walks = walks.into_iter().flatten().collect::<Vec<_>>().join(", ");
    let line = |name: &str, text: String| if text.is_empty() { text } else { format!("  {name:<9} {text}\n") };
    line("readings", readings) + &line("walks", walks)
}

/// The topics at whose own samples states were smoothed, where these are not the rows.
fn topics(rows: &BTreeMap<&str, Row<'_>>) -> String {
    let mut topics: BTreeMap<&str, (Vec<&str>, usize)> = BTreeMap::new();
    for (channel, row) in rows {
        if let Some(topic) = row.pieces.iter().find_map(|piece| piece.topic.as_deref()) {
            let entry = topics.entry(topic).or_default();
            entry.0.push(channel);
            entry.1 = row.pieces.iter().map(|piece| piece.samples).sum();
        }
    }
    let line = |(topic, (channels, samples)): (&&str, &(Vec<&str>, usize))| {
        format!("from {} of {topic}, read off at the rows: {}\n", count(*samples, "sample"), channels.join(", "))
    };
    topics.iter().map(line).collect()
}

/// Calibration that fusion estimated for joints, one row per sensor.
fn joints(all: &[JointReport]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let with_deviation = |value: f64, deviation: f64| match deviation > 0.0 {
        true => format!("{} ({})", number(value), number(deviation)),
        false => number(value),
    };
    let header = ["joint", "sensor", "readings", "left out", "noise", "delay, s", "bias", "jerk", "smoothed over, s"];
    let row = |joint: &JointReport, at: usize| {
        let sensor = &joint.sensors[at];
        vec![
            joint.joint.clone(),
            sensor.sensor.clone(),
            sensor.readings.to_string(),
            sensor.rejected.iter().map(|log| log.rows).sum::<usize>().to_string(),
            number(sensor.noise),
            with_deviation(sensor.delay, sensor.delay_deviation),
            with_deviation(sensor.bias, sensor.bias_deviation),
            number(joint.jerk),
            number(joint.smoothed),
        ]
    };
    let rows = all.iter().flat_map(|joint| (0..joint.sensors.len()).map(move |at| row(joint, at)));
    let together: String = all
        .iter()
        .flat_map(|joint| joint.correlations.iter().map(move |pair| (joint, pair)))
        .map(|(joint, pair)| {
            let [first, second] = &pair.sensors;
            format!(
                "errors of `{first}` and `{second}` of {} have a correlation of {:.2}\n",
                joint.joint, pair.correlation
            )
        })
        .collect();
    format!("{}\n{together}", table(&header, rows.collect()))
}

/// Clock estimates of episodes whose stamps were evened out.
fn clocks(report: &PrepareReport) -> String {
    let lines = report.episodes.iter().filter_map(|episode| episode.clock.as_ref().map(|clock| (episode, clock)));
    lines
        .map(|(episode, clock)| {
            format!(
                "clock of {}: {:.9} s a sample, jitter {}, {} missing\n",
                episode.episode,
                clock.period,
                seconds(clock.jitter),
                count(clock.missing as usize, "sample")
            )
        })
        .collect()
}

/// Offset and drift of another computer's clock.
fn aligned(clock: &AlignedClock) -> String {
    if clock.by == "given" {
        return format!("clock {}: {} ahead, as given\n", clock.clock, seconds(clock.offset));
    }
    let ppm = |skew: f64| format!("{:.3}", 1e6 * skew);
    let evidence = match (clock.unexplained, clock.edges) {
        (Some(share), _) => {
            let errors = clock.left_out.map_or(0, |left_out| left_out.iter().sum());
            let errors =
                if errors > 0 { format!(", {} left out", count(errors, "gross error")) } else { String::new() };
            format!("motion, {:.2} % unexplained{errors}", 100.0 * share)
        }
        (_, edges) => count(edges.unwrap_or(0), "edge"),
    };
    format!(
        "clock {} of {}: {:.6} s ahead ({:.6} to {:.6}) at {:.1} s, {} ppm fast ({} to {}), by {evidence}\n",
        clock.clock,
        clock.log,
        clock.offset,
        clock.offset_interval[0],
        clock.offset_interval[1],
        clock.at,
        ppm(clock.skew),
        ppm(clock.skew_interval[0]),
        ppm(clock.skew_interval[1]),
    )
}

/// Rejected values in a row from which on they are no single gross errors.
const BURST: usize = 5;

/// A line of what is left out in a row, if it is.
fn burst(of: &str, what: &str, all: usize, longest: &Places, mend: &str) -> Option<String> {
    (longest.longest >= BURST).then(|| {
        format!(
            "{of}: up to {} of {all} {what} are consecutive: a burst of errors, or motion that the curve does not follow (an impact, a slip); --json lists the places, {mend}\n",
            longest.longest
        )
    })
}

/// Notes on sensor readings that fusion left out.
fn left_out(report: &PrepareReport) -> String {
    let most = |places: &mut dyn Iterator<Item = &Places>| {
        places.max_by_key(|place| place.longest).cloned().unwrap_or_default()
    };
    let rows = |places: &mut dyn Iterator<Item = &Places>| places.map(|place| place.rows).sum();
    let of_body = report.body.iter().flat_map(|body| {
        let positions = || body.rejected.iter().map(|log| &log.positions);
        let attitudes = || body.rejected.iter().map(|log| &log.attitudes);
        let mend = "gate = 0 in [body] keeps all readings";
        [
            burst("body", "positions left out", rows(&mut positions()), &most(&mut positions()), mend),
            burst("body", "attitudes left out", rows(&mut attitudes()), &most(&mut attitudes()), mend),
        ]
    });
    let of_joints = report.joints.iter().flat_map(|joint| joint.sensors.iter().map(move |sensor| (joint, sensor)));
    let of_joints = of_joints.map(|(joint, sensor)| {
        let mend = format!("gate = 0 in [joint.{}] keeps all readings", joint.joint);
        let (all, longest) = (rows(&mut sensor.rejected.iter()), most(&mut sensor.rejected.iter()));
        burst(&format!("`{}` of {}", sensor.sensor, joint.joint), "readings left out", all, &longest, &mend)
    });
    of_body.chain(of_joints).flatten().collect()
}

/// Notes on channels that need a look.
fn doubts(channel: &str, row: &Row<'_>) -> Vec<String> {
    let pieces = |is: fn(&ChannelReport) -> bool| row.pieces.iter().filter(|piece| is(piece)).count();
    let most = |of: fn(&ChannelReport) -> &Places| {
        row.pieces.iter().map(|piece| of(piece)).max_by_key(|places| places.longest)
    };
    let mut doubts = Vec::new();
    let through_all = pieces(|piece| piece.through_all);
    if through_all > 0 {
        doubts.push(format!(
            "`{channel}`: the spline interpolates every sample in {} and rejects none: either the channel has no noise, or its samples are too far apart to separate noise from motion, and the deviations are too small; compare with --method quintic, or give --lambda\n",
            count(through_all, "piece")
        ));
    }
    let gave_up = pieces(|piece| piece.gave_up && !piece.through_all);
    if gave_up > 0 {
        doubts.push(format!(
            "`{channel}`: no sample was rejected in {}: samples off the curve are motion, jumps, or too many; --hampel removes single gross errors\n",
            count(gave_up, "piece")
        ));
    }
    let at_end = pieces(|piece| piece.lambda_at_end && !piece.through_all);
    if at_end > 0 {
        doubts.push(format!(
            "`{channel}`: the smoothing penalty is at an end of its search range in {}: the channel has no noise, is at rest, or is a polynomial; give --lambda\n",
            count(at_end, "piece")
        ));
    }
    if let Some(rejected) = most(|piece| &piece.rejected) {
        let all = row.rows(|piece| &piece.rejected);
        doubts.extend(burst(&format!("`{channel}`"), "rejected values", all, rejected, "--reject 0 keeps all values"));
    }
    if let Some(hangs) = most(|piece| &piece.hangs).filter(|hangs| hangs.rows > 0) {
        doubts.push(format!(
            "`{channel}`: {} repeated before a jump, up to {} in a row, the first at {:.3} s: if the sensor hung there, --stuck 5 leaves such values out\n",
            count(row.rows(|piece| &piece.hangs), "value"),
            hangs.longest,
            hangs.spans.first().map_or(0.0, |span| span[0])
        ));
    }
    doubts
}
