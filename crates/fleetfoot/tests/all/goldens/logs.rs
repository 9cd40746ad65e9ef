//! Small logs of plants, made without elementary functions: the same bytes on every machine.

use std::{
    f64::consts::PI,
    fmt::Write,
    fs,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use fleetfoot::{data::mix, output::write_atomic};

/// Seconds from row to row.
const DT: f64 = 0.01;

/// A number in -1 to 1 that belongs to a seed and a row.
fn noise(seed: u64, row: usize) -> f64 {
    mix(mix(seed).wrapping_add(row as u64)) as f64 / u64::MAX as f64 * 2.0 - 1.0
}

/// A signal that wanders smoothly: noise through two lags of ten rows each.
struct Wander {
    seed: u64,
    row: usize,
    lags: [f64; 2],
}

impl Wander {
    fn new(seed: u64) -> Self {
        Self { seed, row: 0, lags: [noise(seed, 1_000_000), noise(seed, 1_000_001)] }
    }

    fn next(&mut self) -> f64 {
        let [first, second] = &mut self.lags;
        *first += 0.1 * (5.0 * noise(self.seed, self.row) - *first);
        *second += 0.1 * (*first - *second);
        self.row += 1;
        2.0 * *second
    }
}

/// A robot with two regimes: `v' = 3 u - 2 v` below v = 0.5 and `1 + 2 u - 5 v` above; `w' = 0.8 r - 1.5 w + 0.3 v w`; it turns with w and drives with v.
fn robot(run: u64, rows: usize) -> String {
    let (mut speed, mut turn) = (Wander::new(10 * run + 1), Wander::new(10 * run + 2));
    let (mut x, mut v, mut w, mut phi) = (0.0f64, 0.2f64, 0.0f64, 2.0 + run as f64 * 0.3);
    let mut text = String::from("t,x,v,w,phi,u,r,mode,load,dv,dw\n");
    for row in 0..rows {
        let (u, r) = (0.5 + speed.next(), turn.next());
        let slips = v > 0.5;
        let dv = if slips { 1.0 + 2.0 * u - 5.0 * v } else { 3.0 * u - 2.0 * v };
        let dw = 0.8 * r - 1.5 * w + 0.3 * v * w;
        let of = |stream: u64| noise(1000 * run + stream, row);
        let (mode, load) = (if slips { "slip" } else { "grip" }, 0.75 + 0.25 * of(3));
        let (noisy_v, noisy_w) = (v + 1e-3 * of(4), w + 1e-3 * of(5));
        let (noisy_dv, noisy_dw) = (dv + 0.02 * of(6), dw + 0.02 * of(7));
        let t = row as f64 * DT;
        let _ = writeln!(text, "{t},{x},{noisy_v},{noisy_w},{phi},{u},{r},{mode},{load},{noisy_dv},{noisy_dw}");
        (x, v, w, phi) = (x + DT * v, v + DT * dv, w + DT * dw, phi + DT * w);
        phi -= if phi > PI { 2.0 * PI } else { 0.0 };
        phi += if phi <= -PI { 2.0 * PI } else { 0.0 };
    }
    text
}

/// Lorenz's system with measured derivatives, by the classical Runge-Kutta method.
fn lorenz(run: u64, rows: usize) -> String {
    let f = |[x, y, z]: [f64; 3]| [10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z];
    let moved = |x: [f64; 3], k: [f64; 3], h: f64| -> [f64; 3] { std::array::from_fn(|i| x[i] + h * k[i]) };
    let mut x = [-8.0 + run as f64, 8.0, 27.0];
    let mut text = String::from("t,x,y,z,dx,dy,dz\n");
    for row in 0..rows {
        let rates = f(x);
        let of = |i: usize| noise(2000 * (run + 1) + i as u64, row);
        let _ = write!(text, "{}", row as f64 * DT);
        (0..3).for_each(|i| _ = write!(text, ",{}", x[i] + 0.002 * of(i)));
        (0..3).for_each(|i| _ = write!(text, ",{}", rates[i] + 0.1 * of(3 + i)));
        text.push('\n');
        let b = f(moved(x, rates, DT / 2.0));
        let c = f(moved(x, b, DT / 2.0));
        let d = f(moved(x, c, DT));
        x = std::array::from_fn(|i| x[i] + DT / 6.0 * (rates[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
    }
    text
}

/// `v' = u - 0.5 v - 0.3 v |v|`, and `w' = 3 lag(u) - 2 w` behind a lag of 0.07 s.
fn driven(run: u64, rows: usize) -> String {
    let mut input = Wander::new(500 + run);
    let (mut v, mut w, mut lagged) = (0.3f64, 0.0f64, 0.0f64);
    let mut text = String::from("t,v,u,dv,w,dw\n");
    for row in 0..rows {
        let u = 0.3 + 2.0 * input.next();
        let (dv, dw) = (u - 0.5 * v - 0.3 * v * v.abs(), 3.0 * lagged - 2.0 * w);
        let of = |stream: u64| noise(3000 * (run + 1) + stream, row);
        let t = row as f64 * DT;
        let _ = writeln!(text, "{t},{v},{u},{},{w},{}", dv + 0.01 * of(1), dw + 0.01 * of(2));
        (v, w) = (v + DT * dv, w + DT * dw);
        // The exact lag of an input that is straight between rows, to the second order in the step over the lag.
        lagged += (DT / 0.07) / (1.0 + 0.5 * DT / 0.07) * (u - lagged);
    }
    text
}

/// An autoregression with two regimes: `y(k) = 0.1 + 0.6 y(k-1) - 0.3 y(k-2) + 0.8 u(k-1) - 0.2 y(k-1)^2`, above y(k-1) = 0.4 `0.5 y(k-1) + 0.3 u(k-1)`.
fn machine(run: u64, rows: usize) -> String {
    let mut text = String::from("t,y,u\n");
    let (mut before, mut y) = (0.0, 0.1);
    for row in 0..rows {
        let u = noise(700 + run, row);
        let _ = writeln!(text, "{},{y},{u}", row as f64 * 0.1);
        let next = if y > 0.4 { 0.5 * y + 0.3 * u } else { 0.1 + 0.6 * y - 0.3 * before + 0.8 * u - 0.2 * y * y };
        (before, y) = (y, next + 0.005 * noise(800 + run, row));
    }
    text
}

/// Two equations that share a function: `a = T - D`, `b = 2 T` with `T = 3 + x - 0.5 x^2` and `D = 0.7 v`.
fn flight(run: u64, rows: usize) -> String {
    let (mut height, mut speed) = (Wander::new(900 + run), Wander::new(950 + run));
    let mut text = String::from("t,x,v,a,b\n");
    for row in 0..rows {
        let (x, v) = (height.next(), 1.0 + speed.next());
        let thrust = 3.0 + x - 0.5 * x * x;
        let of = |stream: u64| noise(4000 * (run + 1) + stream, row);
        let (a, b) = (thrust - 0.7 * v + 0.05 * of(1), 2.0 * thrust + 0.05 * of(2));
        let _ = writeln!(text, "{},{x},{v},{a},{b}", row as f64 * DT);
    }
    text
}

/// The folder of all logs, written once a process: in the tests' own folder below `target`, as nobody drops what is static. Every process writes the same bytes.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("goldens");
        fs::create_dir_all(&folder).unwrap();
        let write = |name: &str, run: u64, text: String| {
            write_atomic(folder.join(format!("{name}_{run}.csv")), text.as_bytes()).unwrap();
        };
        (0..6).for_each(|run| write("robot", run, robot(run, 300 + 10 * run as usize)));
        (0..4).for_each(|run| write("lorenz", run, lorenz(run, 400)));
        (0..3).for_each(|run| write("driven", run, driven(run, 400)));
        (0..3).for_each(|run| write("machine", run, machine(run, 300)));
        (0..7).for_each(|run| write("flight", run, flight(run, 200 + 10 * run as usize)));
        folder
    })
}

/// Some runs of a plant.
pub(super) fn logs(plant: &str, runs: std::ops::Range<u64>) -> Vec<PathBuf> {
    runs.map(|run| folder().join(format!("{plant}_{run}.csv"))).collect()
}

/// A text without the name of the folder, which is another every time.
pub(super) fn without_folder(text: &str) -> String {
    text.replace(&format!("{}/", folder().display()), "")
}
