//! Least squares between bounds, by active sets.
//!
//! `minimise |R b - z|^2 subject to low_j <= b_j <= high_j`, R triangular. Coefficients that are held at a bound are constants; least squares gives the others, as far as the
//! first of them reaches its bound, which then holds it. Where all lie within, of those that are held the one is let go whose slope points inwards most, until none does: these are the
//! conditions of the minimum, and as the error falls no set of held coefficients comes twice (Lawson and Hanson 1974, chapter 23, of non-negative coefficients; Stark and Parker
//! 1995, BVLS, of bounds).

use super::{Prepared, Solved};
use crate::threshold::triangle::Triangle;

/// A slope, as a correlation with the target, that is rounding.
const FLAT: f64 = 1e-13;

/// Least squares on a triangle of `columns` within the bounds of a prepared problem, from the coefficients without them; these where they keep the bounds.
pub(super) fn within_bounds(prepared: &Prepared<'_>, triangle: &Triangle, columns: &[usize], free: Solved) -> Solved {
    let inside = |place: usize, value: f64| prepared.within(columns[place], value);
    if free.values.iter().enumerate().all(|(place, &value)| inside(place, value)) {
        return free;
    }
    let mut search = Search::new(prepared, triangle, columns, &free.values);
    // Each round lets one go; more rounds than sets that a search of this size meets are rounding that goes in circles.
    for _ in 0..30 * (columns.len() + 1) {
        search.settle();
        if !search.release() {
            break;
        }
    }
    Solved { values: search.values, confounded: free.confounded }
}

struct Search<'a> {
    prepared: &'a Prepared<'a>,
    triangle: &'a Triangle,
    columns: &'a [usize],
    values: Vec<f64>,
    /// For each coefficient: true if it is held constant.
    held: Vec<bool>,
    /// The last one that was let go, and those that went back at once: their slope was rounding.
    released: Option<usize>,
    barred: Vec<bool>,
}

impl<'a> Search<'a> {
    /// Those that lie beyond a bound are held there.
    fn new(prepared: &'a Prepared<'a>, triangle: &'a Triangle, columns: &'a [usize], free: &[f64]) -> Self {
        let clamped = |(&j, &value): (&usize, &f64)| prepared.clamped(j, value);
        let values: Vec<f64> = columns.iter().zip(free).map(clamped).collect();
        let held = values.iter().zip(free).map(|(value, free)| value != free).collect();
        let barred = vec![false; columns.len()];
        Self { prepared, triangle, columns, values, held, released: None, barred }
    }

    /// Least squares of those that are not held, until all of them lie within their bounds.
    fn settle(&mut self) {
        loop {
            let free: Vec<usize> = (0..self.columns.len()).filter(|&place| !self.held[place]).collect();
            if free.is_empty() {
                return;
            }
            let constants: Vec<f64> =
                self.values.iter().zip(&self.held).map(|(value, held)| if *held { *value } else { 0.0 }).collect();
            let system = self.triangle.less(&constants).select(&free, 0);
            let columns: Vec<usize> = free.iter().map(|&place| self.columns[place]).collect();
            let wanted = self.prepared.solve_free(&system, &columns).values;
            let mut first: Option<(f64, usize)> = None;
            for (&place, &to) in free.iter().zip(&wanted) {
                let bound = self.prepared.clamped(self.columns[place], to);
                if bound != to {
                    let from = self.values[place];
                    let share = ((bound - from) / (to - from)).clamp(0.0, 1.0);
                    if first.is_none_or(|(least, _)| share < least) {
                        first = Some((share, place));
                    }
                }
            }
            let share = first.map_or(1.0, |(share, _)| share);
            if share > 0.0 {
                self.barred.fill(false);
            }
            for (&place, &to) in free.iter().zip(&wanted) {
                let moved = if share < 1.0 { self.values[place] + share * (to - self.values[place]) } else { to };
                self.values[place] = self.prepared.clamped(self.columns[place], moved);
            }
            let Some((_, place)) = first else { return };
            // The value is clamped to the bound that it moved to, above or below.
            self.values[place] =
                self.prepared.clamped(self.columns[place], wanted[free.partition_point(|&at| at < place)]);
            self.held[place] = true;
            if share == 0.0 && self.released == Some(place) {
                self.barred[place] = true;
            }
        }
    }

    /// Lets the one go whose slope points inwards most; false where none does.
    fn release(&mut self) -> bool {
        let left = self.triangle.less(&self.values);
        let size = left_length(self.triangle.z(0));
        let mut best: Option<(f64, usize)> = None;
        for place in (0..self.columns.len()).filter(|&place| self.held[place] && !self.barred[place]) {
            let j = self.columns[place];
            let slope: f64 = (0..=place).map(|i| self.triangle.r(i, place) * left.z(0)[i]).sum();
            let inwards = self.prepared.inwards(j, self.values[place], slope) / self.prepared.length[j];
            if inwards > FLAT * size && best.is_none_or(|(most, _)| inwards > most) {
                best = Some((inwards, place));
            }
        }
        let Some((_, place)) = best else { return false };
        self.held[place] = false;
        self.released = Some(place);
        true
    }
}

fn left_length(z: &[f64]) -> f64 {
    z.iter().map(|z| z * z).sum::<f64>().sqrt()
}
