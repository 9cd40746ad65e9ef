//! Chosen rows become a tile of columns.

use super::screen::{Lane, TILE};

/// Writes `rows[chosen[i]][j]` to `out[j][i]`, for at most `TILE` chosen rows.
#[inline(always)]
pub(super) fn gather(rows: &[f32], dimensions: usize, chosen: &[u32], out: &mut [Lane]) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx512f") {
        // SAFETY: the processor has the features that the function is compiled for.
        unsafe { avx512::gather(rows, dimensions, chosen, out) };
        return;
    }
    gather_plainly(rows, dimensions, chosen, out);
}

fn gather_plainly(rows: &[f32], dimensions: usize, chosen: &[u32], out: &mut [Lane]) {
    for (i, &row) in chosen.iter().enumerate().take(TILE) {
        let row = &rows[row as usize * dimensions..][..dimensions];
        for j in 0..dimensions {
            out[j].0[i] = row[j];
        }
    }
}

/// Asks for chosen rows, of four-byte values, to be in the cache soon: scattered rows defeat the hardware's guesses.
#[inline(always)]
pub(super) fn prefetch<T>(rows: &[T], dimensions: usize, chosen: &[u32]) {
    #[cfg(target_arch = "x86_64")]
    for &row in chosen {
        let row = &rows[row as usize * dimensions..][..dimensions];
        for line in row.chunks(16) {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            // SAFETY: a prefetch has no effect but on speed, and the address is that of a value.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(line.as_ptr().cast()) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (rows, dimensions, chosen);
}

#[cfg(target_arch = "x86_64")]
mod avx512 {
    use std::arch::x86_64::*;

    use super::{Lane, TILE};

    /// Sixteen rows by sixteen columns at a time, one row a register, transposed in registers.
    #[target_feature(enable = "avx512f")]
    pub(super) fn gather(rows: &[f32], dimensions: usize, chosen: &[u32], out: &mut [Lane]) {
        for (quarter, chosen) in chosen.chunks(16).enumerate().take(TILE / 16) {
            for from in (0..dimensions).step_by(16) {
                let width = (dimensions - from).min(16);
                let mut lines = [_mm512_setzero_ps(); 16];
                for (line, &row) in lines.iter_mut().zip(chosen) {
                    let at = row as usize * dimensions + from;
                    *line = load(&rows[at..at + width]);
                }
                transpose(&mut lines);
                for (line, lane) in lines.iter().zip(&mut out[from..from + width]) {
                    let target: &mut [f32] = &mut lane.0[16 * quarter..16 * quarter + 16];
                    // SAFETY: the target is sixteen values long.
                    unsafe { _mm512_storeu_ps(target.as_mut_ptr(), *line) };
                }
            }
        }
    }

    /// Up to sixteen values; missing ones are zero.
    #[target_feature(enable = "avx512f")]
    #[inline]
    fn load(values: &[f32]) -> __m512 {
        let mask = if values.len() >= 16 { u16::MAX } else { (1u16 << values.len()) - 1 };
        // SAFETY: lanes outside the mask are not read, and the mask covers values of the slice only.
        unsafe { _mm512_maskz_loadu_ps(mask, values.as_ptr()) }
    }

    /// Transposes a 16 x 16 matrix: pairs of rows, of pairs, of quarters, of halves.
    #[target_feature(enable = "avx512f")]
    #[inline]
    fn transpose(r: &mut [__m512; 16]) {
        let mut t = *r;
        for i in 0..8 {
            t[2 * i] = _mm512_unpacklo_ps(r[2 * i], r[2 * i + 1]);
            t[2 * i + 1] = _mm512_unpackhi_ps(r[2 * i], r[2 * i + 1]);
        }
        // Now r[4 q + c] holds, in each quarter of 128 bits, column 4 quarter + c of the four rows 4 q...
        for q in 0..4 {
            let pair = |a: __m512, b: __m512| {
                let (a, b) = (_mm512_castps_pd(a), _mm512_castps_pd(b));
                (_mm512_castpd_ps(_mm512_unpacklo_pd(a, b)), _mm512_castpd_ps(_mm512_unpackhi_pd(a, b)))
            };
            (r[4 * q], r[4 * q + 1]) = pair(t[4 * q], t[4 * q + 2]);
            (r[4 * q + 2], r[4 * q + 3]) = pair(t[4 * q + 1], t[4 * q + 3]);
        }
        // ... and the quarters of four registers are transposed in two steps.
        for c in 0..4 {
            let low = _mm512_shuffle_f32x4::<0x88>(r[c], r[4 + c]);
            let high = _mm512_shuffle_f32x4::<0xdd>(r[c], r[4 + c]);
            let low_rest = _mm512_shuffle_f32x4::<0x88>(r[8 + c], r[12 + c]);
            let high_rest = _mm512_shuffle_f32x4::<0xdd>(r[8 + c], r[12 + c]);
            t[c] = _mm512_shuffle_f32x4::<0x88>(low, low_rest);
            t[4 + c] = _mm512_shuffle_f32x4::<0x88>(high, high_rest);
            t[8 + c] = _mm512_shuffle_f32x4::<0xdd>(low, low_rest);
            t[12 + c] = _mm512_shuffle_f32x4::<0xdd>(high, high_rest);
        }
        *r = t;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_stored_at_its_index() {
        for d in [1, 3, 8, 15, 16, 17, 40] {
            let rows: Vec<f32> = (0..200 * d).map(|i| i as f32 + 0.25).collect();
            for count in [1, 15, 16, 17, 63, 64] {
                let chosen: Vec<u32> = (0..count).map(|i| (i * 37 % 200) as u32).collect();
                let mut out = vec![Lane([f32::NAN; TILE]); d];
                gather(&rows, d, &chosen, &mut out);
                let mut plain = vec![Lane([f32::NAN; TILE]); d];
                gather_plainly(&rows, d, &chosen, &mut plain);
                for (i, &row) in chosen.iter().enumerate() {
                    for j in 0..d {
                        let expected = rows[row as usize * d + j];
                        assert_eq!([out[j].0[i], plain[j].0[i]], [expected; 2], "d {d} row {i} column {j}");
                    }
                }
            }
        }
    }
}
