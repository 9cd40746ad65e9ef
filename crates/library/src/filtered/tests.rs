//! Filters beside closed forms, and the laws that any way of reading obeys.

use fleetfoot_data::{Block, Column, Halo, MemorySource, ScalarBuffer, Source, mix};
use proptest::prelude::*;

use super::*;
use crate::{FilterKind, Scope};

fn parse(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).unwrap()
}

/// One episode of a column `x`, stamps in nanoseconds.
fn source(episodes: &[(Vec<i64>, Vec<f64>)]) -> MemorySource {
    let mut source = MemorySource::new(vec![Column { unit: Some("N".into()), ..Column::float("x") }]);
    for (stamps, x) in episodes {
        source.push("e", ScalarBuffer::from(stamps.clone()), vec![ScalarBuffer::from(x.clone())]);
    }
    source
}

/// Rows of uneven steps, of about `period` seconds.
fn uneven(rows: usize, period: f64, seed: u64) -> Vec<i64> {
    let step = |row: usize| {
        (period * 1e9 * (0.5 + (mix(mix(seed).wrapping_add(row as u64)) >> 11) as f64 / (1u64 << 53) as f64)) as i64
    };
    (0..rows).scan(7_000_000_000, |at, row| Some(std::mem::replace(at, *at + step(row)))).collect()
}

fn seconds(stamps: &[i64]) -> Vec<f64> {
    stamps.iter().map(|stamp| (stamp - stamps[0]) as f64 * 1e-9).collect()
}

/// The column of a filter at all rows of the first episode.
fn column(source: &MemorySource, text: &str) -> Vec<f64> {
    let filtered = Filtered::of(source, &[parse(text)]).unwrap();
    let block = filtered.read(0, 0..source.episodes()[0].rows, Halo::default()).unwrap();
    block.core(filtered.column_index(text).unwrap()).to_vec()
}

#[test]
fn a_lag_answers_a_step_with_an_exponential() {
    let stamps = uneven(20_000, 1e-3, 1);
    // 0 at the first row, then held at 2 from there on: x[k] holds from row k.
    let x: Vec<f64> = (0..20_000).map(|row| if row == 0 { 0.0 } else { 2.0 }).collect();
    let data = source(&[(stamps.clone(), x)]);
    let t = seconds(&stamps);
    for tau in [1e-4, 0.0716, 3.0, 500.0] {
        let y = column(&data, &format!("lag1(x, {tau})"));
        let slope = column(&data, &format!("lag1_slope(x, {tau})"));
        for row in 1..t.len() {
            let share = (t[row] - t[1]) / tau;
            assert!((y[row] - 2.0 * -(-share).exp_m1()).abs() < 1e-13, "{tau} {row}");
            let exact = -2.0 * share / tau * (-share).exp();
            assert!((slope[row] - exact).abs() < 1e-11 / tau, "{tau} {row}: {} {exact}", slope[row]);
        }
    }
}

/// Amplitude and phase of a first-order lag, once the start has died out. Between rows the input is held: half a step later.
#[test]
fn a_lag_turns_and_damps_a_sine() {
    let (dt, tau, omega) = (1e-4_f64, 0.05_f64, 30.0_f64);
    let x: Vec<f64> = (0..30_000).map(|row| (omega * dt * row as f64).sin()).collect();
    let mut data = MemorySource::new(vec![Column::float("x")]);
    data.push_uniform("e", dt, vec![x]);
    let y = column(&data, "lag1(x, 0.05)");
    // The exact response of the sampled recursion, (1 - a)/(z - a) at z = exp(i omega dt), and the continuous one that it tends to.
    let a = (-dt / tau).exp();
    let (re, im) = ((omega * dt).cos() - a, (omega * dt).sin());
    let (gain, phase) = ((1.0 - a) / re.hypot(im), -im.atan2(re));
    assert!((gain - 1.0 / (1.0 + (omega * tau).powi(2)).sqrt()).abs() < 1e-5);
    assert!((phase + (omega * tau).atan() + 0.5 * omega * dt).abs() < 1e-5);
    for (row, y) in y.iter().enumerate().skip(20_000) {
        assert!((y - gain * (omega * dt * row as f64 + phase).sin()).abs() < 1e-11, "{row}");
    }
}

#[test]
fn delay_shifts_ramp_and_keeps_slope() {
    let stamps = uneven(3_000, 1e-2, 5);
    let t = seconds(&stamps);
    let data = source(&[(stamps, t.iter().map(|t| 1.0 - 3.0 * t).collect())]);
    for d in [0.0, 1e-3, 0.25, 11.0] {
        let (y, slope) = (column(&data, &format!("delay(x, {d})")), column(&data, &format!("delay_slope(x, {d})")));
        let there = column(&data, &format!("present(x, {d})"));
        for row in 0..t.len() {
            if t[row] < d {
                assert!(y[row].is_nan() && slope[row].is_nan() && there[row].is_nan(), "{d} {row}");
                continue;
            }
            assert!((y[row] - (1.0 - 3.0 * (t[row] - d))).abs() < 1e-12, "{d} {row}");
            // Of the only row there is at first, none.
            assert!((slope[row] - 3.0).abs() < 1e-9 || (row, d) == (0, 0.0), "{d} {row} {}", slope[row]);
            assert_eq!(there[row], 0.0);
        }
    }
    // A whole number of even steps: the rows themselves, and the mean of the slopes on both sides.
    let mut even = MemorySource::new(vec![Column::float("x")]);
    even.push_uniform("e", 0.01, vec![(0..50).map(|row| f64::from(row * row)).collect()]);
    let (y, slope) = (column(&even, "delay(x, 0.03)"), column(&even, "delay_slope(x, 0.03)"));
    assert!((4..50).all(|row| y[row] == ((row - 3) * (row - 3)) as f64));
    assert!((4..50).all(|row| (slope[row] + 200.0 * (row - 3) as f64).abs() < 1e-9), "{slope:?}");
}

#[test]
fn missing_values_start_a_lag_again_and_break_a_delay() {
    let x = vec![1.0, 5.0, f64::NAN, 3.0, 4.0, 4.0, f64::INFINITY, 2.0];
    let mut data = MemorySource::new(vec![Column::float("x")]);
    data.push_uniform("e", 1.0, vec![x]);
    let gain = 1.0 - (-0.5_f64).exp();
    let y = column(&data, "lag1(x, 2)");
    assert!([2, 6].iter().all(|&row| y[row].is_nan()));
    assert_eq!((y[0], y[1], y[3], y[4], y[7]), (1.0, 1.0, 3.0, 3.0, 2.0));
    assert!((y[5] - (3.0 + gain)).abs() < 1e-15);
    let y = column(&data, "delay(x, 1)");
    assert!(y[0].is_nan() && y[3].is_nan() && y[7].is_nan());
    assert_eq!([y[1], y[2], y[4], y[5], y[6]], [1.0, 5.0, 3.0, 4.0, 4.0]);
    let there = column(&data, "present(x, 1)");
    assert_eq!(
        there.iter().map(|v| v.is_finite()).collect::<Vec<_>>(),
        [false, true, false, false, true, true, false, false]
    );
}

#[test]
fn slopes_are_the_derivatives_of_the_values() {
    let stamps = uneven(9_000, 1e-2, 9);
    let x: Vec<f64> = seconds(&stamps).iter().map(|t| (3.0 * t).sin() + 0.3 * (17.0 * t).cos()).collect();
    let data = source(&[(stamps, x)]);
    let at = |text: &str, tau: f64| {
        let expr = parse(text).substituted(|name| (name == "tau").then(|| Expr::number(tau)));
        let filtered = Filtered::of(&data, std::slice::from_ref(&expr)).unwrap();
        let names: Vec<&str> = filtered.columns().iter().map(|column| column.name.as_str()).collect();
        let program = crate::Program::compile(&[expr], &names).unwrap();
        let block = filtered.read(0, 0..9_000, Halo::default()).unwrap();
        let mut out = vec![0.0; 8_000];
        program.evaluate_block(&block, 900..8_900, &mut out, 8_000, &mut Default::default());
        out
    };
    for text in [
        "lag1(x, tau)",
        "lag1(lag1(x, 2*tau), tau)",
        "lag(lag1(x*tau, tau), 3)^2",
        "lag1(lead(x, 2), tau^2)*tau",
        "lag1(delay(x, tau), tau)",
    ] {
        let exact = at(&parse(text).sensitivity("tau").to_string(), 0.31);
        let step = 1e-7;
        let (up, down) = (at(text, 0.31 + step), at(text, 0.31 - step));
        let scale = exact.iter().fold(0.0_f64, |largest, v| largest.max(v.abs()));
        // A delay's slope jumps where it crosses a row: there the quotient is between both.
        let far =
            (0..exact.len()).filter(|&k| ((up[k] - down[k]) / (2.0 * step) - exact[k]).abs() > 1e-5 * scale).count();
        assert!(far * 50 < exact.len() && (far == 0 || text.contains("delay")), "{text}: {far}");
    }
}

#[test]
fn filters_that_cannot_be_are_refused() {
    let data = source(&[(uneven(10, 1e-2, 3), vec![0.0; 10])]);
    let error = |text: &str| Filtered::of(&data, &[parse(text)]).err().unwrap();
    assert!(matches!(error("lag1(x, tau)"), FilterError::NoValue { name, .. } if name == "tau"));
    for text in ["lag1(x, 0)", "lag1(x, -1)", "lag1(x, nan)", "lag1_slope(x, inf)", "delay(x, -0.1)", "present(x, inf)"]
    {
        assert!(matches!(error(text), FilterError::Range { .. }), "{text}");
    }
    let missing = error("1 + lag1(lag1(z, 1), 2)");
    assert!(missing.to_string().contains("there is no column `z`"), "{missing}");
    // Columns of the source are not made anew, and keep their properties.
    let filtered = Filtered::of(&data, &[parse("lag1(lag1(x, 1), 2)")]).unwrap();
    let again = Filtered::of(&filtered, &[parse("lag1(lag1(x, 1), 2)*lag1(x, 1)")]).unwrap();
    assert_eq!(again.columns(), filtered.columns());
    assert_eq!(filtered.columns()[2].unit.as_deref(), Some("N"));
    assert!(filtered.read(0, 5..11, Halo::default()).is_err());
    let kept = Filtered::over(Box::new(data.clone()), &parse("lag1(x, 1)").filters()).unwrap();
    assert_eq!(kept.columns(), &filtered.columns()[..2]);
}

/// All rows with every filter, as bits.
fn bits(block: &Block, from: usize, length: usize) -> Vec<Vec<u64>> {
    let bits = |column: &ScalarBuffer<f64>| column[from..from + length].iter().map(|value| value.to_bits()).collect();
    block.columns.iter().map(bits).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Any rows with any halo, in any order, cold or warm: the bits of reading each episode whole.
    #[test]
    fn a_value_depends_on_its_row_alone(
        seed in any::<u64>(),
        rows in prop::collection::vec(1usize..30_000, 1..3),
        reads in prop::collection::vec((0usize..2, 0.0..1.0f64, 0usize..5_000, 0usize..40, 0usize..40), 1..6),
        tau in prop_oneof![Just(1e-3), 0.01..1.0f64, Just(1e3)],
        delay in prop_oneof![Just(0.0), 0.0..0.3f64, Just(40.0)],
    ) {
        let random = |row: usize, key: u64| (mix(mix(seed ^ key).wrapping_add(row as u64)) >> 11) as f64 / (1u64 << 53) as f64;
        let values = |rows: usize, key: u64| (0..rows).map(|row| if random(row, key + 9) < 1e-4 { f64::NAN } else { random(row, key) }).collect();
        let episodes: Vec<_> = rows.iter().enumerate().map(|(key, &rows)| (uneven(rows, 1e-3, seed ^ key as u64), values(rows, 20 + key as u64))).collect();
        let data = source(&episodes);
        let texts = [
            format!("lag1(x, {tau})"), format!("lag1_slope(lead(x, 2), {tau})"), format!("lag1(lag1(x^2, {tau}) - lag(x, 3), 0.02)"),
            format!("delay(x, {delay})"), format!("delay_slope(lag1(x, {tau}), {delay})"), format!("present(x, {delay})"),
            format!("lag1(delay(x, {delay}), {tau})"),
        ];
        let exprs: Vec<Expr> = texts.iter().map(|text| parse(text)).collect();
        let whole = Filtered::of(&data, &exprs).unwrap();
        let alone: Vec<Block> = (0..rows.len()).map(|e| whole.read(e, 0..rows[e], Halo::default()).unwrap()).collect();
        let cold = Filtered::of(&data, &exprs).unwrap();
        for (episode, place, length, before, after) in reads {
            let episode = episode % rows.len();
            let from = (place * rows[episode] as f64) as usize;
            let to = (from + length).min(rows[episode]);
            let block = cold.read(episode, from..to, Halo { before, after }).unwrap();
            let plain = data.read(episode, from..to, Halo { before, after }).unwrap();
            prop_assert_eq!((block.first, block.before, block.rows, block.after), (plain.first, plain.before, plain.rows, plain.after));
            prop_assert_eq!(&block.time, &plain.time);
            let count = block.time.len();
            prop_assert_eq!(bits(&block, 0, count), bits(&alone[episode], from - block.before, count));
        }
        // No episode knows of another.
        let last = rows.len() - 1;
        let single = source(&episodes[last..]);
        let single = Filtered::of(&single, &exprs).unwrap().read(0, 0..rows[last], Halo::default()).unwrap();
        prop_assert_eq!(bits(&single, 0, rows[last]), bits(&alone[last], 0, rows[last]));
    }
}

#[test]
fn names_are_definitions() {
    let expr = parse("lag1( m1 ,tau )^2 + delay(lag1(`motor 2`*2, tau), d/2)");
    assert_eq!(expr.to_string(), "lag1(m1, tau)^2 + delay(lag1(`motor 2`*2, tau), d/2)");
    assert_eq!(parse(&expr.to_string()), expr);
    assert_eq!(parse("lag1(m1,tau)^2"), Expr::column("lag1(m1, tau)").powi(2));
    let filter = Filter::of("delay(lag1(`motor 2`*2, tau), d/2)").unwrap();
    assert_eq!((filter.kind, filter.input.to_string()), (FilterKind::Delay, "lag1(`motor 2`*2, tau)".into()));
    assert_eq!(expr.sources().iter().map(|name| &**name).collect::<Vec<_>>(), ["m1", "tau", "motor 2", "d"]);
    for name in [
        "lag1(m1,tau)",
        "lag1(m1, tau) ",
        "lag1",
        "lag1(m1)",
        "lag2(m1, tau)",
        "lag1(m1, tau)(",
        "lag1((m1), tau)",
        "lag1(m1, time())",
    ] {
        assert_eq!(Filter::of(name), None, "{name}");
    }
    // Whatever a column is called, it is read back.
    let odd = Expr::column("lag1(m1,tau)");
    assert_eq!((odd.to_string(), parse(&odd.to_string())), ("`lag1(m1,tau)`".to_owned(), odd));
}

#[test]
fn filters_are_substituted_shifted_and_differentiated() {
    let expr = parse("lag(lag1(m1, tau), 2)*tau");
    assert_eq!(expr, parse("lag1(m1, tau)").shifted(2) * Expr::column("tau"));
    let number = expr.substituted(|name| (name == "tau").then(|| Expr::number(0.0716)));
    assert_eq!(number, parse("lag(lag1(m1, 0.0716), 2)*0.0716"));
    assert_eq!(
        parse("lag1(a, tau)").substituted(|name| (name == "a").then(|| parse("b + lag(c, 1)"))),
        parse("lag1(b + lag(c, 1), tau)")
    );
    assert_eq!(
        parse("lag1(a, tau)").substituted(|name| (name == "lag1(a, tau)").then(|| Expr::column("y"))),
        parse("y")
    );
    for (text, slope) in [
        ("lag1(m1, tau)^2", "2*lag1(m1, tau)*lag1_slope(m1, tau)"),
        ("lag1(m1, 2*tau)", "lag1_slope(m1, 2*tau)*2"),
        ("delay(tau*u, d)", "delay(u, d)"),
        ("lag1(tau, d)", "1"),
        ("lag1(u, d)", "0"),
        ("present(u, tau)", "0"),
    ] {
        assert_eq!(parse(text).sensitivity("tau"), parse(slope).simplified(), "{text}");
    }
    assert_eq!(parse("lag1(m1, tau)").derivative("tau"), Expr::number(0.0));
    assert_eq!(parse("lag1(m1, tau)^2").derivative("lag1(m1, tau)"), parse("2*lag1(m1, tau)"));
}

#[test]
fn scope_limits_arguments_of_filters() {
    let mut scope = Scope::new(["motor", "tau"]);
    scope.define_all([("m", "motor/65535"), ("lagged", "lag1(m, tau)"), ("twice", "lag1(lagged, tau)")]).unwrap();
    assert_eq!(
        Expr::parse("twice + lag(lagged, 1)", &scope).unwrap().to_string(),
        "lag1(lag1(motor/65535, tau), tau) + lag(lag1(motor/65535, tau), 1)"
    );
    let error = |text: &str| Expr::parse(text, &scope).unwrap_err().to_string();
    assert!(error("lag1(m, rate)").contains("unknown column or alias `rate`"));
    assert!(error("lag1(m)").contains("takes 2 argument(s)"));
    for text in ["lag1(m, lag(tau, 1))", "delay(m, time())", "delay(m, lag1(m, tau))"] {
        assert!(error(text).contains("does not change with time"), "{text}");
    }
    let deep = |levels: usize| format!("{}m{}", "lag1(".repeat(levels), ", tau)".repeat(levels));
    assert!(Expr::parse(&deep(8), &scope).is_ok());
    assert!(error(&deep(9)).contains("at most 8 levels"));
    // Aliases cannot make one that could not be read again.
    let chain: Vec<(String, String)> =
        (0..40).map(|k| (format!("a{}", k + 1), format!("delay(a{k} + a{k}, tau)"))).collect();
    scope.define("a0", Expr::column("motor"));
    assert!(scope.define_all(chain).unwrap_err().to_string().contains("is too large"));
}
