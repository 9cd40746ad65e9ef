//! Helpers that the benches share: timing, memory, and the peers, which run in the same process order on the same data.
//!
//! A bench is a program that prints a table. It checks its timed answers against the peer's, and prints the physical
//! limit. The Python that runs the peers is `FLEETFOOT_PYTHON`, else `python3`. A peer that is not installed is
//! reported as absent, never as a number.

pub mod hybrid;

use std::{
    hint::black_box,
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

use faer::{Accum, Mat, Par, linalg::matmul::matmul};

/// Runs `work` `times` times; the fastest run in seconds, and the last result.
pub fn best_of<R>(times: usize, mut work: impl FnMut() -> R) -> (f64, R) {
    let mut best = f64::INFINITY;
    let mut result = None;
    for _ in 0..times.max(1) {
        let start = Instant::now();
        let value = work();
        best = best.min(start.elapsed().as_secs_f64());
        result = Some(value);
    }
    (best, result.expect("at least one run"))
}

/// Multiply-adds per second of a large product on one thread, in units of 1e9.
pub fn product_rate() -> f64 {
    let n = 768;
    let a = Mat::from_fn(n, n, |i, j| ((i * 7 + j) % 13) as f64);
    let mut c = Mat::<f64>::zeros(n, n);
    let (seconds, ()) = best_of(5, || matmul(c.as_mut(), Accum::Replace, a.as_ref(), a.as_ref(), 1.0, Par::Seq));
    (n * n * n) as f64 / seconds / 1e9
}

/// Fused multiply-adds per second of one core, in registers: the physical limit of sums. `None` if there is no loop for
/// the processor.
pub fn fma_rate() -> Option<f64> {
    #[cfg(target_arch = "x86_64")]
    {
        use peak::STEPS;
        if is_x86_feature_detected!("avx512f") {
            // SAFETY: the processor has AVX-512F.
            let (seconds, _) = best_of(300, || black_box(unsafe { peak::avx512() }));
            return Some((12 * 8 * STEPS) as f64 / seconds);
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the processor has AVX2 and FMA.
            let (seconds, _) = best_of(300, || black_box(unsafe { peak::avx2() }));
            return Some((12 * 4 * STEPS) as f64 / seconds);
        }
    }
    None
}

/// The largest resident set of this process so far, MiB; NaN if the system does not report it.
pub fn peak_rss_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok()).map_or(f64::NAN, |kib| kib / 1024.0)
}

/// Runs `work` for a second at least; mean CPU seconds of a run in this thread. NaN if the system does not report them.
///
/// The system counts by the tick of its scheduler, some milliseconds: over so many runs that is nothing. Other tenants of the machine count little here, and much by the clock.
pub fn cpu_of<R>(mut work: impl FnMut() -> R) -> f64 {
    let used = || {
        let status = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
        status.split_whitespace().next().and_then(|field| field.parse::<f64>().ok()).map_or(f64::NAN, |ns| 1e-9 * ns)
    };
    let (start, before, mut runs) = (Instant::now(), used(), 0);
    while runs == 0 || start.elapsed().as_secs_f64() < 1.0 {
        black_box(work());
        runs += 1;
    }
    (used() - before) / f64::from(runs)
}

/// CPU seconds of all threads of this process so far, in hundredths; NaN if the system does not report them.
pub fn cpu_seconds() -> f64 {
    let status = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name in brackets may hold anything; user and system time are the 12th and 13th field behind it.
    let behind = status.rsplit_once(')').map_or("", |(_, behind)| behind);
    let ticks: Vec<f64> = behind.split_whitespace().skip(11).take(2).filter_map(|field| field.parse().ok()).collect();
    if ticks.len() == 2 { (ticks[0] + ticks[1]) / 100.0 } else { f64::NAN }
}

/// Forgets the peak so far, where the system can (Linux), so that making the rows does not count.
pub fn reset_peak_rss() {
    // A system that cannot leaves the peak too high: against us.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// Runs `benches/peers/<script> arguments...`, whose last line of standard output is one JSON value.
///
/// Returns the reason when the peer cannot run here (no Python, package not installed).
pub fn peer(script: &str, arguments: &[&Path]) -> Result<serde_json::Value, String> {
    let python = std::env::var("FLEETFOOT_PYTHON").unwrap_or_else(|_| "python3".into());
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("peers").join(script);
    let output =
        Command::new(&python).arg(&path).args(arguments).output().map_err(|error| format!("{python}: {error}"))?;
    if !output.status.success() {
        let talk = String::from_utf8_lossy(&output.stderr);
        return Err(talk.lines().last().unwrap_or("the peer failed without a word").to_owned());
    }
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(text.lines().last().unwrap_or_default()).map_err(|error| format!("{script}: {error}"))
}

/// Writes values as raw little-endian `f64`, for `numpy.fromfile`.
pub fn write_f64(path: &Path, values: &[f64]) -> std::io::Result<()> {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    std::fs::write(path, bytes)
}

/// Reads a file of [`write_f64`] or `numpy.ndarray.tofile`.
pub fn read_f64(path: &Path) -> std::io::Result<Vec<f64>> {
    let bytes = std::fs::read(path)?;
    Ok(bytes.chunks_exact(8).map(|chunk| f64::from_le_bytes(chunk.try_into().expect("eight bytes"))).collect())
}

#[cfg(target_arch = "x86_64")]
mod peak {
    use std::arch::x86_64::*;

    pub(super) const STEPS: usize = 100_000;

    /// Twelve independent chains of fused multiply-adds in registers; the sum keeps them alive.
    #[target_feature(enable = "avx512f")]
    pub(super) fn avx512() -> f64 {
        let (a, b) = (_mm512_set1_pd(0.999_999_9), _mm512_set1_pd(1e-9));
        let mut sums = [_mm512_set1_pd(1.0); 12];
        for _ in 0..STEPS {
            for sum in &mut sums {
                *sum = _mm512_fmadd_pd(*sum, a, b);
            }
        }
        sums.into_iter().map(|sum| _mm512_reduce_add_pd(sum)).sum()
    }

    #[target_feature(enable = "avx2,fma")]
    pub(super) fn avx2() -> f64 {
        let (a, b) = (_mm256_set1_pd(0.999_999_9), _mm256_set1_pd(1e-9));
        let mut sums = [_mm256_set1_pd(1.0); 12];
        for _ in 0..STEPS {
            for sum in &mut sums {
                *sum = _mm256_fmadd_pd(*sum, a, b);
            }
        }
        sums.into_iter().map(|sum| _mm256_cvtsd_f64(sum)).sum()
    }
}
