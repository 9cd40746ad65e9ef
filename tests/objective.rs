//! `--objective steps:N`: coefficients fitted to simulations, and the model of one step beside them.

use std::fs;

use crate::runner::*;

/// Noise of deviation one that is the same everywhere.
fn noise(key: u64) -> f64 {
    let uniform = |i: u64| {
        let mut z = (key * 12 + i).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ (z >> 31)) as f64 / u64::MAX as f64
    };
    (0..12).map(uniform).sum::<f64>() - 6.0
}

/// An oscillator, x(k+1) = 0.95 x + 0.2 v, v(k+1) = -0.25 x + 0.9 v + 0.3 u, measured with noise of deviation `sigma`.
fn oscillator(rows: u64, seed: u64, sigma: f64) -> String {
    let mut state = [1.0, 0.5];
    let mut text = String::from("t,x,v,u\n");
    for k in 0..rows {
        let key = seed * 100_000 + 10 * k;
        let u = noise(key);
        let (x, v) = (state[0] + sigma * noise(key + 1), state[1] + sigma * noise(key + 2));
        text.push_str(&format!("{:.2},{x:?},{v:?},{u:?}\n", k as f64 * 0.05));
        state = [0.95 * state[0] + 0.2 * state[1], -0.25 * state[0] + 0.9 * state[1] + 0.3 * u];
    }
    text
}

fn folder(sigma: f64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for seed in 0..6 {
        fs::write(folder.path().join(format!("run{seed}.csv")), oscillator(400, seed, sigma)).expect("a log");
    }
    folder
}

const LOGS: [&str; 6] = ["run0.csv", "run1.csv", "run2.csv", "run3.csv", "run4.csv", "run5.csv"];

fn fit(folder: &Path, method: &str, options: &str) -> Run {
    let columns = if method == "narx" { "--outputs x,v --inputs u" } else { "--states x,v --inputs u --predict next" };
    let mut arguments: Vec<&str> = vec!["fit", method];
    arguments.extend(columns.split(' ').chain(options.split(' ')).chain(["--time", "t"]).chain(LOGS));
    fleetfoot(folder, &arguments)
}

fn pairs(report: &serde_json::Value, name: &str) -> [f64; 2] {
    [0, 1].map(|i| report[name][i].as_f64().unwrap_or(f64::NAN))
}

/// On a linear system that is measured with noise, every method gets better rollouts by simulations. The written model
/// has their coefficients, and its recipe the objective.
#[test]
fn every_method_simulates_noisy_states_better() {
    let folder = folder(0.3);
    for (method, options) in [
        ("pwa", "--folds 0"),
        ("sindy", "--library poly(1) --threshold 0"),
        ("narx", "--lags-out 1 --lags-in 1 --degree 1 --terms all"),
    ] {
        let one_step = fit(folder.path(), method, &format!("{options} -o one.json")).ok();
        assert!(!one_step.out.contains("Simulation error"), "{}", one_step.out);
        let output = fit(folder.path(), method, &format!("{options} --objective steps:10 -o steps.json --json")).ok();
        assert!(
            output.err.contains("--objective steps:10: at most") && output.err.contains("passes"),
            "{}",
            output.err
        );
        let report = &output.json()["objective"];
        let [before, after] = pairs(report, "rollouts_over_persistence");
        assert!(after < before && report["written"] == true, "{method}: {report}");
        let cost = pairs(report, "cost");
        assert!(cost[1] < cost[0] && report["converged"] == true, "{method}: {report}");
        let read = |name: &str| -> serde_json::Value {
            serde_json::from_str(&fs::read_to_string(folder.path().join(name)).expect("a model")).expect("JSON")
        };
        let (one_step, steps) = (read("one.json"), read("steps.json"));
        assert_ne!(one_step["model"]["latents"], steps["model"]["latents"]);
        if method == "pwa" {
            residuals_are_those_of_the_rows(&steps["model"], |_| 0);
        }
        let recipe = steps["model"]["training"]["recipe"].as_str().expect("a recipe");
        assert!(recipe.contains("objective = \"steps:10\""), "{recipe}");
        let text = fit(folder.path(), method, &format!("{options} --objective steps:10 -o again.json")).ok();
        assert!(text.out.contains("The model fitted to simulations is written"), "{}", text.out);
        assert_eq!(fs::read(folder.path().join("again.json")).ok(), fs::read(folder.path().join("steps.json")).ok());
    }
}

/// A free run is as long as the held-out part, whole logs here. Its coefficients are nearer to the truth than those of
/// one step, which noise in the states shrinks.
#[test]
fn free_runs_span_the_held_out_rows() {
    let folder = folder(0.3);
    for (method, options) in [
        ("pwa", "--folds 0"),
        ("sindy", "--library poly(1) --threshold 0"),
        ("narx", "--lags-out 1 --lags-in 1 --degree 1 --terms all"),
    ] {
        fit(folder.path(), method, &format!("{options} -o one.json")).ok();
        let output = fit(folder.path(), method, &format!("{options} --objective free-run -o free.json --json")).ok();
        assert!(output.err.contains("--objective free-run: at most"), "{}", output.err);
        assert!(output.err.contains("rollouts of as many steps as they have room for"), "{}", output.err);
        let report = &output.json()["objective"];
        // A rollout of n steps needs one row before its start and n behind it, of 400.
        assert_eq!((report["steps"].as_u64(), report["segments"].as_u64()), (Some(398), Some(6)), "{method}: {report}");
        let [before, after] = pairs(report, "rollouts_over_persistence");
        assert!(after < before && report["written"] == true, "{method}: {report}");
        let read = |name: &str| -> serde_json::Value {
            serde_json::from_str(&fs::read_to_string(folder.path().join(name)).expect("a model")).expect("JSON")
        };
        let (one_step, free) = (read("one.json"), read("free.json"));
        let recipe = free["model"]["training"]["recipe"].as_str().expect("a recipe");
        assert!(recipe.contains("objective = \"free-run\""), "{recipe}");
        let off = |model: &serde_json::Value| -> f64 {
            let model = &model["model"];
            let library = model["libraries"][0].as_array().expect("functions");
            let of = |t: usize, name: &str| {
                let at = library.iter().position(|function| *function == name);
                at.and_then(|at| model["latents"][t]["coefficients"][0][at].as_f64()).unwrap_or(f64::NAN)
            };
            let truth = [[0.95, 0.2, 0.0], [-0.25, 0.9, 0.3]];
            let squares =
                (0..2).flat_map(|t| ["x", "v", "u"].into_iter().enumerate().map(move |(j, name)| (t, j, name)));
            squares.map(|(t, j, name)| (of(t, name) - truth[t][j]).powi(2)).sum::<f64>().sqrt()
        };
        assert!(off(&free) < 0.5 * off(&one_step), "{method}: {} {}", off(&free), off(&one_step));
    }
    let short = folder.path().join("short.csv");
    fs::write(&short, oscillator(14, 9, 0.3)).expect("a log");
    let text = "fit pwa --states x,v --inputs u --predict next --folds 0 --time t --objective free-run short.csv";
    fleetfoot(folder.path(), &text.split(' ').collect::<Vec<_>>()).fails(&["--objective free-run", "longer logs"]);
}

/// The models of folds may choose terms that reach further back than those of all rows: the free run is as long as the shortest has room for. The held-out error is of the
/// model that is written.
#[test]
fn free_runs_suit_models_of_all_folds() {
    let folder = tempfile::tempdir().expect("a folder");
    for run in 0..6 {
        let (mut x, mut inputs, mut text) = (1.0, vec![0.0; 8], String::from("t,x,u\n"));
        for k in 0..103_u64 {
            let key = run * 100_000 + 10 * k;
            inputs.push(noise(key));
            let (now, late) = (inputs[inputs.len() - 1], inputs[inputs.len() - 8]);
            text.push_str(&format!("{:.2},{x:?},{now:?}\n", k as f64 * 0.05));
            x = 0.8 * x + 0.3 * now + 0.1 * late + 0.4 * noise(key + 1);
        }
        fs::write(folder.path().join(format!("run{run}.csv")), text).expect("a log");
    }
    let text = "fit narx --outputs x --inputs u --time t --lags-out 2 --lags-in 8 --degree 1 --objective";
    let fit = |objective: &str, more: &[&str]| {
        let mut arguments: Vec<&str> = text.split(' ').chain([objective]).chain(LOGS).collect();
        arguments.extend(more);
        fleetfoot(folder.path(), &arguments)
    };
    let report = fit("free-run", &["--json"]).ok().json();
    let steps = report["objective"]["steps"].as_u64().unwrap_or(0);
    assert!((90..=95).contains(&steps), "{steps} steps, 7 rows before them, of 103");
    assert_eq!(report["objective"]["written"] == true, report["held_out"].is_null(), "{report}");
    let message = fit("steps:100", &[]).fails(&["objective steps:100", "ask for fewer steps"]);
    assert!(!message.contains("--horizon"), "{message}");
}

/// The residual covariances of the written coefficients, computed without a pass, are those of the rows in their regions.
fn residuals_are_those_of_the_rows(model: &serde_json::Value, region: impl Fn(&[f64]) -> usize) {
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let (latents, regions) = (&model["latents"], model["partitions"][0]["regions"].as_array().expect("regions"));
    let mut moments = vec![[0.0; 3]; regions.len()];
    let mut rows = vec![0.0; regions.len()];
    for seed in 0..6 {
        let text = oscillator(400, seed, 0.3);
        let row =
            |line: &str| line.split(',').skip(1).map(|value| value.parse().expect("a number")).collect::<Vec<f64>>();
        let log: Vec<Vec<f64>> = text.lines().skip(1).map(row).collect();
        for pair in log.windows(2) {
            let at = region(&pair[0]);
            let error = |t: usize| {
                let coefficients = latents[t]["coefficients"][at].as_array().expect("coefficients");
                let map: f64 = coefficients.iter().zip(&pair[0]).map(|(a, x)| number(a) * x).sum();
                pair[1][t] - map - number(&latents[t]["constants"][at])
            };
            let [a, b] = [error(0), error(1)];
            moments[at].iter_mut().zip([a * a, a * b, b * b]).for_each(|(sum, value)| *sum += value);
            rows[at] += 1.0;
        }
    }
    for ((region, moments), rows) in regions.iter().zip(&moments).zip(&rows) {
        assert_eq!(region["rows"].as_f64(), Some(*rows));
        let covariance = region["residual_covariance"].as_array().expect("a covariance");
        for (entry, sum) in covariance.iter().zip(moments) {
            // The logs' numbers are read to the bit; sums of up to 2,394 rows round.
            assert!((number(entry) - sum / rows).abs() < 1e-10, "{entry} {}", sum / rows);
        }
    }
}

/// Rows without noise are those of the model of one step: its rollouts cannot be improved, and it is written.
#[test]
fn worse_simulations_are_not_written() {
    let folder = folder(0.0);
    let output = fit(folder.path(), "pwa", "--folds 0 --objective steps:5 -o steps.json --json").ok();
    fit(folder.path(), "pwa", "--folds 0 -o one.json").ok();
    let report = output.json();
    let read = |name: &str| -> serde_json::Value {
        serde_json::from_str(&fs::read_to_string(folder.path().join(name)).expect("a model")).expect("JSON")
    };
    let [before, _] = pairs(&report["objective"], "rollouts_over_persistence");
    assert!(before < 1e-9 && report["objective"]["written"] == false, "{report}");
    assert_eq!(read("one.json")["model"]["latents"], read("steps.json")["model"]["latents"]);
}

/// A state that never changes has no variance to explain.
#[test]
fn a_constant_state_is_refused() {
    let folder = folder(0.3);
    for log in LOGS {
        let path = folder.path().join(log);
        let text = fs::read_to_string(&path).expect("a log");
        let still = |line: &str| {
            let cells: Vec<&str> = line.split(',').collect();
            if cells[0] == "t" { format!("{line}\n") } else { format!("{},3,{},{}\n", cells[0], cells[2], cells[3]) }
        };
        fs::write(&path, text.lines().map(still).collect::<String>()).expect("a log");
    }
    fit(folder.path(), "sindy", "--library poly(1) --objective steps:20")
        .fails(&["the target next(x) has the same value 3 in all rows", "leave it out"]);
}

/// Bounded maps stay bounded when they are fitted to simulations: the norms of the written maps, in the reported
/// metric, from the files' numbers. The weight of the prior is one that was tried, its rollouts are the reported ones,
/// and threads change no byte.
#[test]
fn simulation_fits_respect_the_bound() {
    let folder = folder(0.3);
    let options = "--folds 0 --partition kmeans:12 --stable=0.99 --objective steps:10 --json";
    let output = fit(folder.path(), "pwa", &format!("{options} -o steps.json")).ok();
    assert!(output.err.contains("--objective steps:10: at most") && !output.err.contains("2000"), "{}", output.err);
    let report = output.json();
    let objective = &report["objective"];
    let ([before, after], cost) = (pairs(objective, "rollouts_over_persistence"), pairs(objective, "cost"));
    assert!(objective["written"] == true && after < before && cost[1] < cost[0], "{objective}");
    let tried = objective["prior_weights"].as_array().expect("weights");
    let candidate =
        tried.iter().find(|candidate| candidate["weight"] == objective["prior_weight"]).expect("the weight");
    assert!(tried.len() == 3 && candidate["rollouts"] == objective["rollouts_over_persistence"][1], "{objective}");
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let metric: Vec<f64> =
        report["candidates"][0]["stability"]["metric"].as_array().expect("a metric").iter().map(number).collect();
    let text = fs::read_to_string(folder.path().join("steps.json")).expect("a model");
    let model: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let mut greatest = 0.0_f64;
    for region in 0..12 {
        let row = |t: usize, j: usize| number(&model["model"]["latents"][t]["coefficients"][region][j]);
        // The greatest root of det(M'PM - s P), which is a quadratic of two states.
        let weight = |i: usize, j: usize| metric[2 * i + j];
        let pairs = || (0..2).flat_map(|i| (0..2).map(move |j| (i, j)));
        let image = |a: usize, b: usize| pairs().map(|(i, j)| row(i, a) * weight(i, j) * row(j, b)).sum::<f64>();
        let determinant = |of: &dyn Fn(usize, usize) -> f64| of(0, 0) * of(1, 1) - of(0, 1).powi(2);
        let (a, c) = (determinant(&weight), determinant(&image));
        let b = image(0, 0) * weight(1, 1) + image(1, 1) * weight(0, 0) - 2.0 * image(0, 1) * weight(0, 1);
        greatest = greatest.max(((b + (b * b - 4.0 * a * c).max(0.0).sqrt()) / (2.0 * a)).sqrt());
    }
    assert!(
        greatest <= 0.99 + 1e-7 && (greatest - number(&objective["bound"]["norm"])).abs() < 1e-6,
        "{greatest} {objective}"
    );
    let partition = &model["model"]["partitions"][0];
    let list = |of: &serde_json::Value| of.as_array().expect("numbers").iter().map(number).collect::<Vec<f64>>();
    let (centre, scale, offsets) =
        (list(&partition["centre"]), list(&partition["scale"]), list(&partition["rule"]["offsets"]));
    let weights: Vec<Vec<f64>> = partition["rule"]["weights"].as_array().expect("weights").iter().map(list).collect();
    residuals_are_those_of_the_rows(&model["model"], |row| {
        let score =
            |i: usize| offsets[i] + (0..2).map(|j| weights[i][j] * (row[j] - centre[j]) / scale[j]).sum::<f64>();
        (0..12).max_by(|&i, &j| score(i).total_cmp(&score(j))).expect("regions")
    });
    let again = fit(folder.path(), "pwa", &format!("{options} --threads 1 -o again.json")).ok();
    assert_eq!(again.json()["objective"], *objective);
    assert_eq!(fs::read(folder.path().join("again.json")).ok(), fs::read(folder.path().join("steps.json")).ok());
    let words = fit(folder.path(), "pwa", &options.replace("--json", "-o words.json")).ok();
    for part in ["The error of one step weighs", "Its regions contract by 0.99"] {
        assert!(words.out.contains(part), "{}", words.out);
    }
}

#[test]
fn impossible_objectives_are_refused_with_the_mend() {
    let folder = folder(0.1);
    for wrong in ["steps:0", "steps:", "many", "steps:1e3"] {
        let output = fit(folder.path(), "pwa", &format!("--objective {wrong}"));
        assert!(output.code == 2 && output.err.contains("one-step, free-run, or steps:N"), "{wrong}: {}", output.err);
    }
    fit(folder.path(), "pwa", "--objective steps:399").fails(&["--objective steps:399", "399 steps", "longer logs"]);
    let recipe = "[states]\nx = {}\nv = {}\n[time]\ncolumn = \"t\"\n[model]\npredict = \"next\"\n";
    fs::write(folder.path().join("robot.toml"), recipe).expect("a recipe");
    fleetfoot(folder.path(), &["scan", "-c", "robot.toml", "run0.csv", "-o", "run.stats"]).ok();
    for method in ["pwa", "sindy"] {
        fleetfoot(folder.path(), &["fit", method, "run.stats", "--objective", "steps:5"])
            .fails(&["steps:5", "fit on the logs"]);
    }
    let dry = fit(folder.path(), "pwa", "--objective steps:5 --dry-run").ok();
    assert!(dry.out.contains("--objective steps:5: at most 141 more passes over the rows"), "{}", dry.out);
}

/// A map that grows is held at the border of the training range, or ends there.
#[test]
fn rollouts_outside_the_domain_are_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let grows = |rows: u32| {
        let row = |k: u32| format!("{:.1},{:?}\n", 0.1 * f64::from(k), (0.1 * f64::from(k)).exp());
        "t,x\n".to_owned() + &(0..rows).map(row).collect::<String>()
    };
    fs::write(folder.path().join("seen.csv"), grows(60)).expect("a log");
    fs::write(folder.path().join("long.csv"), grows(90)).expect("a log");
    let fit = "fit pwa --states x --predict next --folds 0 --time t -o grows.json seen.csv";
    fleetfoot(folder.path(), &fit.split(' ').collect::<Vec<_>>()).ok();
    let rollout = |outside: &str| {
        let text = format!("rollout grows.json long.csv --horizon 50 --starts 1 --outside {outside} --json");
        fleetfoot(folder.path(), &text.split(' ').collect::<Vec<_>>()).ok().json()
    };
    let (tell, end, hold) = (rollout("tell"), rollout("end"), rollout("hold"));
    let ended = |report: &serde_json::Value| report["ended_outside"].as_u64();
    assert_eq!([ended(&tell), ended(&end), ended(&hold)], [Some(0), Some(1), Some(0)]);
    assert!([&tell, &end, &hold].iter().all(|report| report["left_domain"] == 1), "{end}");
    let last = |report: &serde_json::Value| report["model"]["rmse"][49][0].as_f64().expect("an error");
    // The truth goes on to grow: the map does, its value at the border stays, and what has ended stays where it was.
    assert!(
        last(&tell) < 1e-6 * last(&end) && last(&hold) > 1.0 && last(&end) > 1.0,
        "{} {} {}",
        last(&tell),
        last(&end),
        last(&hold)
    );
    let wrong = fleetfoot(folder.path(), &["rollout", "grows.json", "long.csv", "--outside", "stay"]);
    assert!(wrong.code == 2 && wrong.err.contains("hold"), "{}", wrong.err);
}

/// A mass on a spring, measured with noise, with a force on it, `t,x,v,f`.
fn sprung(rows: usize) -> String {
    let mut text = String::from("t,x,v,f\n");
    let (mut x, mut v, mut state) = (0.5_f64, 0.0_f64, 9_u64);
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let mut f = 0.0;
    for row in 0..rows {
        if row % 5 == 0 {
            f = 8.0 * noise();
        }
        text.push_str(&format!("{},{},{},{f}\n", 0.05 * row as f64, x + 0.3 * noise(), v + 0.3 * noise()));
        for _ in 0..50 {
            v += 0.001 * (f - if x > 0.0 { 4.0 } else { 9.0 } * x - 0.1 * v) / 1.5;
            x += 0.001 * v;
        }
    }
    text
}

/// Accuracy of eigenvalues by an arc cosine, which costs half of the digits if two are near each other.
const ROUNDED: f64 = -1e-7;

/// The least eigenvalue of the dissipation inequality of every region for a port f:v, from the files' numbers, in units of its diagonal.
fn dissipated(model: &serde_json::Value, stability: &serde_json::Value) -> Vec<f64> {
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let storage: Vec<f64> = stability["metric"].as_array().unwrap().iter().map(number).collect();
    let shortage = number(&stability["passivity"]["ports"][0]["shortage"]);
    let latents = model["model"]["latents"].as_array().unwrap();
    let regions = latents[0]["coefficients"].as_array().unwrap().len();
    (0..regions)
        .map(|region| {
            let map = |i: usize, j: usize| number(&latents[i]["coefficients"][region][j]);
            let supply = |i: usize, j: usize| match (i, j) {
                (2, 2) => 0.05 * shortage,
                (2, k) | (k, 2) => [0.0, 0.05][k],
                _ => storage[2 * i + j],
            };
            let taken = |i: usize, j: usize| -> f64 {
                (0..2)
                    .flat_map(|a| (0..2).map(move |b| (a, b)))
                    .map(|(a, b)| map(a, i) * storage[2 * a + b] * map(b, j))
                    .sum()
            };
            let unit = |i: usize| supply(i, i).sqrt();
            let left = |i: usize, j: usize| (supply(i, j) - taken(i, j)) / (unit(i) * unit(j));
            // The least root of the characteristic polynomial of a symmetric matrix of three rows (Smith 1961).
            let mean = (left(0, 0) + left(1, 1) + left(2, 2)) / 3.0;
            let off = |i: usize, j: usize| left(i, j) - if i == j { mean } else { 0.0 };
            let square: f64 = (0..3).flat_map(|i| (0..3).map(move |j| (i, j))).map(|(i, j)| off(i, j).powi(2)).sum();
            let size = (square / 6.0).sqrt();
            let determinant = off(0, 0) * (off(1, 1) * off(2, 2) - off(1, 2).powi(2))
                - off(0, 1) * (off(0, 1) * off(2, 2) - off(1, 2) * off(0, 2))
                + off(0, 2) * (off(0, 1) * off(1, 2) - off(1, 1) * off(0, 2));
            let angle = (determinant / (2.0 * size.powi(3))).clamp(-1.0, 1.0).acos() / 3.0;
            mean + 2.0 * size * (angle + 2.0 * std::f64::consts::PI / 3.0).cos()
        })
        .collect()
}

#[test]
fn passive_regions_create_no_energy() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("spring.csv"), sprung(3000)).unwrap();
    let arguments = [
        "fit",
        "pwa",
        "spring.csv",
        "--states=x,v",
        "--inputs=f",
        "--predict=next",
        "--time=t",
        "--partition=kmeans:8",
        "--json",
    ];
    let with = |more: &[&str]| fleetfoot(path, &[&arguments[..], more].concat());
    let free = with(&["-o", "free.json"]).ok().json();
    let report = with(&["-o", "passive.json", "--passive=f:v"]).ok().json();
    let read =
        |name: &str| -> serde_json::Value { serde_json::from_slice(&std::fs::read(path.join(name)).unwrap()).unwrap() };
    let stability = &report["candidates"][0]["stability"];
    let (before, after) = (dissipated(&read("free.json"), stability), dissipated(&read("passive.json"), stability));
    assert!(after.iter().all(|least| *least >= ROUNDED), "{after:?}");
    let broken = before.iter().filter(|least| **least < -1e-3).count();
    assert!(broken >= 3 && stability["moved"].as_u64() >= Some(broken as u64), "{before:?} {stability}");
    let port = &stability["passivity"]["ports"][0];
    assert_eq!((port["input"].as_str(), port["state"].as_str()), (Some("f"), Some("v")));
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    // h/m is 1/30, and twice that is allowed.
    assert!((number(&port["shortage"]) - 1.0 / 15.0).abs() < 0.01, "{port}");
    let candidate = &report["candidates"][0];
    assert_eq!(candidate["free_loss"], free["candidates"][0]["loss"]);
    assert!(number(&candidate["loss"]) < 1.02 * number(&candidate["free_loss"]), "{candidate}");
    // From a statistic to the same numbers, and fitted to simulations within the same set.
    let scan = ["scan", "spring.csv", "-c", "scan.toml", "-o", "spring.stats"];
    std::fs::write(
        path.join("scan.toml"),
        "[states]\nx = { column = \"x\" }\nv = { column = \"v\" }\n[inputs]\nf = \"f\"\n[time]\ncolumn = \"t\"\n[model]\npredict = \"next\"\npartition = \"kmeans:8\"\n",
    )
    .unwrap();
    fleetfoot(path, &scan).ok();
    let summed =
        fleetfoot(path, &["fit", "pwa", "spring.stats", "--passive=f:v", "-o", "summed.json", "--json"]).ok().json();
    let after = dissipated(&read("summed.json"), &summed["candidates"][0]["stability"]);
    assert!(after.iter().all(|least| *least >= ROUNDED), "{after:?}");
    let few: Vec<&str> = arguments
        .iter()
        .map(|argument| if *argument == "--partition=kmeans:8" { "--partition=kmeans:3" } else { argument })
        .collect();
    let steps = ["-o", "steps.json", "--passive=f:v", "--objective=steps:5", "--folds=0"];
    let steps = fleetfoot(path, &[&few[..], &steps].concat()).ok().json();
    let after = dissipated(&read("steps.json"), &steps["candidates"][0]["stability"]);
    // The written model has its bound in the report, too.
    let passive_norm = steps["objective"]["bound"]["passive_norm"].as_f64().expect("a number");
    assert!(passive_norm > 0.5 && passive_norm <= 1.0 + 1e-9, "{passive_norm}");
    assert!(after.iter().all(|least| *least >= ROUNDED), "{after:?}");
    let text = fleetfoot(path, &[&arguments[..8], &["-o", "text.json", "--passive=f:v:0.1"]].concat()).ok().out;
    assert!(text.contains("passive at f:v") && text.contains("0.1000"), "{text}");
    for (more, parts) in [
        (&["--passive=f:w"][..], &["f:w is not a port", "not a state"][..]),
        (&["--passive=g:v"], &["g:v is not a port"]),
        (&["--passive=f:v", "--continuous"], &["--continuous with --passive f:v"]),
    ] {
        with(&[&["-o", "wrong.json"], more].concat()).fails(parts);
    }
    let output = with(&["-o", "wrong.json", "--passive=f"]);
    assert!(output.code == 2 && output.err.contains("force:speed"), "{}", output.err);
    assert!(!path.join("wrong.json").exists());
}
