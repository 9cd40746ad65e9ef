//! Many coefficients at once: the active set is guessed whole, and exchanged in blocks until the optimality conditions hold.

use faer::Mat;
use fleetfoot_data::checkpoint;

use crate::{
    cholesky::GrowingFactor,
    descent::{Small, violation},
};

/// Columns from which on exchanges of blocks are cheaper than sweeps.
pub(crate) const MANY: usize = 64;
/// Exchanges that may pass without fewer columns to exchange.
const TRIES: usize = 3;
/// Columns that join the factor at once: between them it can be stopped.
const AT_ONCE: usize = 256;
/// One in this many active columns may leave a factor before a new one is cheaper.
const SHARE: usize = 8;

/// The factor of the active columns, which is carried from lambda to lambda.
#[derive(Default)]
pub(crate) struct Pivots {
    factor: GrowingFactor,
    /// The columns of the problem in the order of the factor.
    order: Vec<usize>,
    /// Weight of the squares within the factor.
    l2: f64,
}

impl Pivots {
    /// Minimises from the signs of `delta` on; the rounds that it took, or `None` and `delta` as it was where they do not lead to the solution.
    ///
    /// Block principal pivoting (Júdice and Pires 1994; Kim and Park 2011, section 3): with the signs s on the active columns S the coefficients are those of
    /// `M_SS d_S = b_S - limit s`; those of another sign leave at once, and all that break their bounds enter; fewer of them where columns would depend
    /// on each other, or where the exchanges go in circles. `working` are the columns of the problem that
    /// those of `small` are, `l2` is the weight of the squares in its matrix.
    pub(crate) fn minimise(
        &mut self,
        small: &Small,
        (working, l2): (&[usize], f64),
        delta: &mut [f64],
        tolerance: f64,
        most: usize,
    ) -> Option<usize> {
        if small.violation(delta, &small.gradient(delta)) <= tolerance {
            return Some(0);
        }
        if self.l2 != l2 {
            *self = Self { l2, ..Self::default() };
        }
        let before = delta.to_vec();
        let mut side: Vec<f64> = delta.iter().map(|&value| if value == 0.0 { 0.0 } else { value.signum() }).collect();
        let (mut fewest, mut tries) = (usize::MAX, TRIES);
        // Number that may enter at once, number that may ever enter again, and the last exchange.
        let (mut room, mut ceiling, mut last) = (usize::MAX, usize::MAX, Exchange::default());
        for round in 1..=most {
            checkpoint();
            let active: Vec<usize> = (0..side.len()).filter(|&j| side[j] != 0.0 || !small.watched(j)).collect();
            if !self.follow(small, working, &active) {
                // More than there are rows, say: fewer of those that broke their bounds, or from the beginning.
                room = last.entering.len().min(room) / 2;
                if room > 0 {
                    last.apply(room, &mut side);
                } else if last.side.is_empty() && side.iter().any(|&side| side != 0.0) {
                    side.fill(0.0);
                } else {
                    break;
                }
                continue;
            }
            delta.fill(0.0);
            self.step(small, working, &side, delta, &small.target);
            let mut gradient = small.gradient(delta);
            last = Exchange::of(small, delta, &gradient, tolerance, &side);
            let changed = last.changes;
            if changed == 0 {
                // Rounding error of the factor.
                self.step(small, working, &side, delta, &gradient);
                gradient = small.gradient(delta);
                if small.violation(delta, &gradient) <= tolerance {
                    return Some(round);
                }
                break;
            }
            if changed < fewest {
                (fewest, tries) = (changed, TRIES);
            } else if room < last.entering.len() {
                // Columns without room to enter are no sign of cycling.
            } else if tries > 0 {
                tries -= 1;
            } else {
                (ceiling, tries) = (last.entering.len().min(ceiling) / 2, TRIES);
                if ceiling == 0 {
                    break;
                }
            }
            room = room.saturating_mul(2).min(ceiling);
            last.apply(room, &mut side);
        }
        *self = Self { l2, ..Self::default() };
        delta.copy_from_slice(&before);
        None
    }

    /// Adds to the active coefficients what their conditions ask for at this gradient.
    fn step(&self, small: &Small, working: &[usize], side: &[f64], delta: &mut [f64], gradient: &[f64]) {
        let local = places(working);
        let order: Vec<usize> = self.order.iter().map(|&column| local[column]).collect();
        let wanted: Vec<f64> = order.iter().map(|&j| gradient[j] - small.limit[j] * side[j]).collect();
        order.iter().zip(self.factor.solve(&wanted)).for_each(|(&j, step)| delta[j] += step);
    }

    /// Makes the factor that of the active columns; false where they depend on each other.
    fn follow(&mut self, small: &Small, working: &[usize], active: &[usize]) -> bool {
        let local = places(working);
        let place = |column: usize| local.get(column).copied().unwrap_or(usize::MAX);
        let mut wanted = vec![false; working.len()];
        active.iter().for_each(|&j| wanted[j] = true);
        let leaves = |column: usize| place(column) == usize::MAX || !wanted[place(column)];
        let leaving: Vec<usize> = (0..self.order.len()).filter(|&at| leaves(self.order[at])).collect();
        if SHARE * leaving.len() > self.order.len() || !self.factor.remove(&leaving) {
            *self = Self { l2: self.l2, ..Self::default() };
        } else {
            self.order.retain(|&column| !leaves(column));
        }
        self.order.iter().for_each(|&column| wanted[place(column)] = false);
        let joining: Vec<usize> = active.iter().copied().filter(|&j| wanted[j]).collect();
        let level = 8.0 * f64::EPSILON * (small.columns() + 1) as f64;
        for some in joining.chunks(AT_ONCE) {
            checkpoint();
            let entries = |rows: &[usize]| {
                let mut entries = Mat::zeros(rows.len(), some.len());
                for (k, &j) in some.iter().enumerate() {
                    let column = small.matrix.column(j);
                    entries.col_as_slice_mut(k).iter_mut().zip(rows).for_each(|(entry, &i)| *entry = column[i]);
                }
                entries
            };
            let kept: Vec<usize> = self.order.iter().map(|&column| place(column)).collect();
            if !self.factor.append(entries(&kept), entries(some), level) {
                return false;
            }
            self.order.extend(some.iter().map(|&j| working[j]));
        }
        true
    }
}

/// Place of every column of the problem in the working set; `usize::MAX` where it has none, as far as there are such.
fn places(working: &[usize]) -> Vec<usize> {
    let mut places = vec![usize::MAX; working.iter().max().map_or(0, |last| last + 1)];
    working.iter().enumerate().for_each(|(at, &column)| places[column] = at);
    places
}

/// Columns of the wrong sign, which go, and those that break their bounds, which enter.
#[derive(Default)]
struct Exchange {
    /// The signs of those that stay.
    side: Vec<f64>,
    /// Those that enter, with their signs, the largest violation first.
    entering: Vec<(f64, usize, f64)>,
    changes: usize,
}

impl Exchange {
    fn of(small: &Small, delta: &mut [f64], gradient: &[f64], tolerance: f64, side: &[f64]) -> Self {
        let mut state = Self { side: side.to_vec(), ..Self::default() };
        for j in (0..side.len()).filter(|&j| small.watched(j)) {
            if side[j] != 0.0 {
                if side[j] * delta[j] <= 0.0 {
                    (state.side[j], delta[j]) = (0.0, 0.0);
                    state.changes += 1;
                }
                continue;
            }
            let violation = violation(small.signs[j], small.limit[j], 0.0, gradient[j]);
            if violation > tolerance {
                state.entering.push((violation, j, gradient[j].signum()));
            }
        }
        state.changes += state.entering.len();
        state.entering.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        state
    }

    /// The signs when at most so many have entered.
    fn apply(&self, room: usize, side: &mut [f64]) {
        side.copy_from_slice(&self.side);
        self.entering.iter().take(room).for_each(|&(_, j, sign)| side[j] = sign);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{kernel::Slab, penalty::Sign};

    /// `1/2 d'M d - b'd + limit |d|` with M of condition about 60.
    fn problem(columns: usize, limit: f64, sign: Sign) -> Small {
        let rows = 2 * columns;
        let mut x = Slab::from_fn(rows, columns, |i, j| ((i * (2 * j + 3) + 7 * j) as f64 * 0.731).sin());
        let y: Vec<f64> = (0..x.stride()).map(|i| if i < rows { (0.37 * (i * i) as f64).cos() } else { 0.0 }).collect();
        x.fill_columns(1, |_, column| {
            let length = crate::kernel::norm(&*column);
            column.iter_mut().for_each(|value| *value /= length);
            Vec::<()>::new()
        });
        let mut target = vec![0.0; Slab::zeros(columns, 0).stride()];
        x.products(&y, &mut target[..columns]);
        let mut matrix = Slab::zeros(columns, columns);
        for j in 0..columns {
            x.products(x.column(j), &mut matrix.column_mut(j)[..columns]);
        }
        Small { matrix, target, limit: vec![limit; columns], signs: vec![sign; columns] }
    }

    #[test]
    fn block_and_sweep_paths_agree() {
        for sign in [Sign::Free, Sign::NonNegative] {
            let (mut pivots, mut delta) = (Pivots::default(), vec![0.0; 90]);
            // Not all columns, so that places and columns differ.
            let working: Vec<usize> = (0..90).map(|at| 3 * at + 1).collect();
            let mut count = 0;
            for limit in [1.0, 0.4, 0.2, 0.1, 0.03, 0.01, 0.3] {
                let small = problem(90, limit, sign);
                let mut swept = delta.clone();
                assert!(small.minimise(&mut swept, 1e-12, 10_000).0);
                let rounds = pivots.minimise(&small, (&working, 0.0), &mut delta, 1e-12, 100);
                count += usize::from(rounds.is_some());
                if rounds.is_none() {
                    delta.copy_from_slice(&swept);
                }
                assert!(small.violation(&delta, &small.gradient(&delta)) <= 1e-12);
                assert!(delta.iter().zip(&swept).all(|(a, b)| (a - b).abs() < 1e-10), "{sign:?} {limit}");
            }
            assert!(count > 4, "{count}");
        }
    }

    #[test]
    fn dependent_columns_are_left_to_the_sweeps() {
        let mut small = problem(70, 0.0, Sign::Free);
        // The last column is the first.
        for j in 0..69 {
            let value = small.matrix.column(j)[0];
            small.matrix.column_mut(j)[69] = value;
            small.matrix.column_mut(69)[j] = value;
        }
        small.matrix.column_mut(69)[69] = 1.0;
        small.target[69] = small.target[0];
        let mut delta = vec![0.0; 70];
        let working: Vec<usize> = (0..70).collect();
        assert_eq!(Pivots::default().minimise(&small, (&working, 0.0), &mut delta, 1e-12, 100), None);
        assert!(delta.iter().all(|&value| value == 0.0));
    }
}
