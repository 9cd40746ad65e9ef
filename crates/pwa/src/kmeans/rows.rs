//! k-means on rows that are read range by range: their units, their copy for the iterations, labels and distances in the rows' own units.

use std::{ops::Range, sync::Mutex};

use fleetfoot_data::{Progress, ScalarBuffer, Silent, ensure_memory, parallel_map};

use super::{Assigner, KMeansError, Points, distance::squared_distance, frame::Frame};

/// Rows that are read at a time.
const BLOCK: usize = 16_384;

/// Rows of some columns that can be read from any thread.
pub trait KMeansRows: Sync {
    /// Rows, n.
    fn rows(&self) -> usize;
    /// Columns, d.
    fn dimensions(&self) -> usize;
    /// The columns (d) of a range of rows.
    fn read(&self, rows: Range<usize>) -> Vec<ScalarBuffer<f64>>;
}

/// A shift of each column and one scale for all: distances keep their proportions, and coordinates are near 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Units {
    centre: Vec<f64>,
    /// A power of two, so that dividing by it is exact.
    scale: f64,
}

impl Units {
    /// Means of the columns, and a power of two near the largest distance from them in any column.
    ///
    /// # Errors
    /// No rows, no columns; cancelled.
    pub fn of_rows(rows: &dyn KMeansRows, progress: &dyn Progress) -> Result<Self, KMeansError> {
        let d = rows.dimensions();
        if d == 0 {
            return Err(KMeansError::NoColumns);
        }
        if rows.rows() == 0 {
            return Err(KMeansError::NoRows);
        }
        // Sums of differences from one row: they do not cancel where the values are large and near each other.
        let reference: Vec<f64> = rows.read(0..1).iter().map(|column| column[0]).collect();
        let parts = blocks(rows, progress, |_, columns| {
            let of = |(column, reference): (&ScalarBuffer<f64>, &f64)| {
                let range = column
                    .iter()
                    .fold((0.0_f64, 0.0_f64), |(least, most), x| (least.min(x - reference), most.max(x - reference)));
                (column.iter().map(|x| x - reference).sum::<f64>(), range)
            };
            Ok(columns.iter().zip(&reference).map(of).collect::<Vec<_>>())
        })?;
        let (mut centre, mut largest) = (reference.clone(), 0.0_f64);
        for j in 0..d {
            let shift = parts.iter().map(|part| part[j].0).sum::<f64>() / rows.rows() as f64;
            let least = parts.iter().map(|part| part[j].1.0).fold(0.0, f64::min);
            let most = parts.iter().map(|part| part[j].1.1).fold(0.0, f64::max);
            centre[j] += shift;
            largest = largest.max(shift - least).max(most - shift);
        }
        Ok(Self { centre, scale: power_of_two(largest) })
    }

    /// The same of centroids (k x d, row-major).
    fn of_centroids(centroids: &[f64], d: usize) -> Self {
        let k = centroids.len() / d;
        let column = |j: usize| centroids.iter().skip(j).step_by(d);
        let centre: Vec<f64> = (0..d).map(|j| column(j).map(|x| x / k as f64).sum()).collect();
        let away = |j: usize| column(j).fold(0.0, |most: f64, x| most.max((x - centre[j]).abs()));
        let largest = (0..d).map(away).fold(0.0, f64::max);
        Self { scale: power_of_two(largest), centre }
    }

    /// Centroids (k x d, row-major) in these units.
    pub fn standardise(&self, centroids: &[f64]) -> Vec<f64> {
        centroids.iter().zip(self.centre.iter().cycle()).map(|(x, centre)| (x - centre) / self.scale).collect()
    }

    /// Centroids (k x d, row-major) in the rows' own units.
    pub fn restore(&self, centroids: &[f64]) -> Vec<f64> {
        centroids.iter().zip(self.centre.iter().cycle()).map(|(z, centre)| z * self.scale + centre).collect()
    }

    /// Factor from squared distances in these units to those in the rows' units.
    pub fn area(&self) -> f64 {
        self.scale * self.scale
    }

    fn scales(&self) -> Vec<f64> {
        vec![self.scale; self.centre.len()]
    }
}

/// The power of two that is at most `value`; 1 where there is none.
fn power_of_two(value: f64) -> f64 {
    // The bits of the exponent alone.
    let power = f64::from_bits(value.to_bits() & (0x7ff << 52));
    if power.is_normal() && power > 0.0 { power } else { 1.0 }
}

impl Points {
    /// A copy of all rows in the given units, read in parallel.
    ///
    /// # Errors
    /// As [`Points::append`]; cancelled.
    pub fn of_rows(rows: &dyn KMeansRows, units: &Units, progress: &dyn Progress) -> Result<Self, KMeansError> {
        let (n, d) = (rows.rows(), rows.dimensions());
        // Beside the rows a label, two bounds and a distance of each while they are clustered.
        ensure_memory(
            n.saturating_mul(8 * d + 32),
            &format!("k-means of {n} rows and {d} columns"),
            "cluster fewer rows",
        )?;
        let parts = blocks(rows, progress, |range, columns| {
            let columns: Vec<&[f64]> = columns.iter().map(|column| &column[..]).collect();
            Self::from_columns(&columns, &units.centre, &units.scales()).map_err(|error| match error {
                KMeansError::Value { row, column, value } => {
                    KMeansError::Value { row: range.start + row, column, value }
                }
                other => other,
            })
        })?;
        let mut all = Self::new(rows.dimensions());
        parts.into_iter().for_each(|part| all.join(part));
        Ok(all)
    }
}

/// Rows with their nearest centroids.
#[derive(Debug, Clone, PartialEq)]
pub struct Assigned {
    /// The nearest centroid of each row (n), of equally near ones the first.
    pub labels: Vec<u32>,
    /// Rows of each centroid (k).
    pub counts: Vec<u64>,
    /// Weighted sum of the squared distances, squared units of the rows.
    pub inertia: f64,
}

/// The nearest of `centroids` (k x d, row-major, in the rows' own units) to each row.
///
/// The distances are those of [`distances_to`] to rounding: rows and centroids are shifted alike first. A row has the same label whatever other rows there are.
///
/// # Errors
/// Centroids that have no place or no shape; another number of weights than of rows; a value that is not finite; cancelled.
pub fn assign_rows(
    rows: &dyn KMeansRows,
    centroids: &[f64],
    weights: Option<&[f64]>,
    progress: &dyn Progress,
) -> Result<Assigned, KMeansError> {
    let (n, d) = (rows.rows(), rows.dimensions());
    super::check_centroids(centroids, d)?;
    if let Some(weights) = weights.filter(|weights| weights.len() != n) {
        return Err(KMeansError::Shape { what: "weights", expected: n, actual: weights.len() });
    }
    let units = Units::of_centroids(centroids, d);
    let assigner = Assigner::new(&units.standardise(centroids), d)?;
    let parts = blocks(rows, progress, |range, columns| {
        let columns: Vec<&[f64]> = columns.iter().map(|column| &column[..]).collect();
        let (mut labels, mut squared) = (vec![0; range.len()], vec![0.0; range.len()]);
        assigner.assign(&columns, &units.centre, &units.scales(), &mut labels, Some(&mut squared))?;
        if let Some(row) = labels.iter().position(|&label| label == Assigner::NOWHERE) {
            let column = (0..d).find(|&column| !columns[column][row].is_finite()).unwrap_or(0);
            let value = columns[column][row];
            return Err(KMeansError::Value { row: range.start + row, column, value });
        }
        let inertia: f64 = match weights {
            None => squared.iter().sum(),
            Some(weights) => squared.iter().zip(&weights[range]).map(|(squared, weight)| squared * weight).sum(),
        };
        Ok((labels, inertia))
    })?;
    let mut assigned = Assigned { labels: Vec::with_capacity(n), counts: vec![0; assigner.clusters()], inertia: 0.0 };
    for (labels, inertia) in parts {
        labels.iter().for_each(|&label| assigned.counts[label as usize] += 1);
        assigned.labels.extend(labels);
        assigned.inertia += inertia;
    }
    assigned.inertia *= units.area();
    Ok(assigned)
}

/// Distances of all rows to `centroids` (k x d, row-major, in the rows' own units), row-major into `out` (n x k).
///
/// # Errors
/// Centroids that have no place or no shape; `out` of another length; cancelled.
pub fn distances_to(
    rows: &dyn KMeansRows,
    centroids: &[f64],
    out: &mut [f64],
    progress: &dyn Progress,
) -> Result<(), KMeansError> {
    let d = rows.dimensions();
    super::check_centroids(centroids, d)?;
    let k = centroids.len() / d;
    if out.len() != rows.rows() * k {
        return Err(KMeansError::Shape { what: "places for distances", expected: rows.rows() * k, actual: out.len() });
    }
    let places: Vec<Mutex<&mut [f64]>> = out.chunks_mut(BLOCK * k).map(Mutex::new).collect();
    blocks(rows, progress, |range, columns| {
        let columns: Vec<&[f64]> = columns.iter().map(|column| &column[..]).collect();
        let (centre, scale) = (vec![0.0; d], vec![1.0; d]);
        let frame = Frame::new(d, &columns, &centre, &scale)?;
        let mut values = vec![0.0; range.len() * d];
        frame.each(0..range.len(), |_, _, at, value| values[at] = value);
        let mut out = places[range.start / BLOCK].lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        for (x, out) in values.chunks_exact(d).zip(out.chunks_exact_mut(k)) {
            for (c, out) in centroids.chunks_exact(d).zip(out) {
                *out = squared_distance(x, c).sqrt();
            }
        }
        Ok(())
    })?;
    Ok(())
}

/// Calls `work` with each block of rows and its columns, in parallel; the answers in order.
fn blocks<R: Send>(
    rows: &dyn KMeansRows,
    progress: &dyn Progress,
    work: impl Fn(Range<usize>, &[ScalarBuffer<f64>]) -> Result<R, KMeansError> + Sync,
) -> Result<Vec<R>, KMeansError> {
    let n = rows.rows();
    parallel_map(n.div_ceil(BLOCK), &Silent, |block| {
        if progress.cancelled() {
            return Err(fleetfoot_data::Cancelled.into());
        }
        let range = block * BLOCK..((block + 1) * BLOCK).min(n);
        work(range.clone(), &rows.read(range))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kmeans::{KMeansOptions, kmeans_from, random::uniform};

    struct Table(Vec<Vec<f64>>);

    impl KMeansRows for Table {
        fn rows(&self) -> usize {
            self.0[0].len()
        }

        fn dimensions(&self) -> usize {
            self.0.len()
        }

        fn read(&self, rows: Range<usize>) -> Vec<ScalarBuffer<f64>> {
            self.0.iter().map(|column| column[rows.clone()].to_vec().into()).collect()
        }
    }

    /// Rows around five places, far from zero and of any size.
    fn table(n: usize, d: usize, offset: f64, size: f64) -> Table {
        let value = |i: usize, j: usize| {
            offset + size * (4.0 * uniform(1, (i % 5) as u64, j as u64) + uniform(2, i as u64, j as u64))
        };
        Table((0..d).map(|j| (0..n).map(|i| value(i, j)).collect()).collect())
    }

    fn distance(table: &Table, row: usize, centroid: &[f64]) -> f64 {
        table.0.iter().zip(centroid).map(|(column, c)| (column[row] - c).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn units_shift_and_scale_exactly() {
        for (offset, size) in [(0.0, 1.0), (1e6, 1e-3), (-3.0, 1e-40), (0.0, 1e25)] {
            let table = table(40_000, 3, offset, size);
            let units = Units::of_rows(&table, &Silent).unwrap();
            for (column, centre) in table.0.iter().zip(&units.centre) {
                let mean = column.iter().sum::<f64>() / 40_000.0;
                assert!((mean - centre).abs() <= 1e-12 * mean.abs(), "{mean} {centre}");
            }
            let most = (0..3).flat_map(|j| table.0[j].iter().map(|x| (x - units.centre[j]).abs()).collect::<Vec<_>>());
            let most = most.fold(0.0, f64::max);
            if most > 0.0 {
                assert!(units.scale <= most && most < 2.0 * units.scale, "{most} {}", units.scale);
            }
            let centroids = [table.0[0][0], table.0[1][1], table.0[2][2]];
            let back = units.restore(&units.standardise(&centroids));
            assert!(back.iter().zip(&centroids).all(|(a, b)| (a - b).abs() <= 4e-16 * b.abs()));
        }
    }

    #[test]
    fn read_rows_match_columns() {
        let table = table(40_000, 3, 5.0, 2.0);
        let units = Units::of_rows(&table, &Silent).unwrap();
        let read = Points::of_rows(&table, &units, &Silent).unwrap();
        let columns: Vec<&[f64]> = table.0.iter().map(Vec::as_slice).collect();
        let whole = Points::from_columns(&columns, &units.centre, &units.scales()).unwrap();
        assert_eq!(read.rows(), whole.rows());
        assert!((0..40_000).step_by(7).all(|row| read.row(row) == whole.row(row)));
        let mut bad = table;
        bad.0[1][30_000] = f64::NAN;
        let error = Points::of_rows(&bad, &units, &Silent).unwrap_err();
        assert!(matches!(error, KMeansError::Value { row: 30_000, column: 1, .. }), "{error}");
    }

    #[test]
    fn labels_and_distances_are_the_plain_ones() {
        for (offset, size) in [(0.0, 1.0), (1e5, 1.0), (0.0, 1e-30), (0.0, 1e20)] {
            let (n, d, k) = (20_000, 4, 6);
            let table = table(n, d, offset, size);
            let centroids: Vec<f64> =
                (0..k).flat_map(|c| table.0.iter().map(move |column| column[c * 31]).collect::<Vec<_>>()).collect();
            let weights: Vec<f64> = (0..n).map(|i| uniform(3, i as u64, 0)).collect();
            let assignment = assign_rows(&table, &centroids, Some(&weights), &Silent).unwrap();
            let mut all = vec![0.0; n * k];
            distances_to(&table, &centroids, &mut all, &Silent).unwrap();
            let mut inertia = 0.0;
            for row in 0..n {
                let plain: Vec<f64> = centroids.chunks(d).map(|c| distance(&table, row, c)).collect();
                let least = plain.iter().copied().fold(f64::INFINITY, f64::min);
                assert!(plain[assignment.labels[row] as usize] <= least * (1.0 + 1e-9), "row {row}");
                assert!(all[row * k..][..k].iter().zip(&plain).all(|(a, b)| (a - b).abs() <= 1e-14 * b));
                inertia += weights[row] * least * least;
            }
            assert!((assignment.inertia / inertia - 1.0).abs() < 1e-9, "{} {inertia}", assignment.inertia);
            assert_eq!(assignment.counts.iter().sum::<u64>(), n as u64);
        }
    }

    #[test]
    fn a_weight_is_so_many_equal_rows() {
        let (n, d) = (9_000, 3);
        let table = table(n, d, 100.0, 1.0);
        let times: Vec<usize> = (0..n).map(|i| (uniform(4, i as u64, 0) * 4.0) as usize).collect();
        let repeat = |column: &Vec<f64>| {
            column.iter().zip(&times).flat_map(|(&x, &times)| std::iter::repeat_n(x, times)).collect()
        };
        let repeated = Table(table.0.iter().map(repeat).collect());
        let units = Units::of_rows(&table, &Silent).unwrap();
        let mut weighted = Points::of_rows(&table, &units, &Silent).unwrap();
        weighted.weigh(times.iter().map(|&times| times as f64).collect()).unwrap();
        let plain = Points::of_rows(&repeated, &units, &Silent).unwrap();
        let start: Vec<f64> = (0..7).flat_map(|i| plain.row(i * 3)).collect();
        let options = KMeansOptions { k: 7, max_iterations: 200, tolerance: 0.0 };
        let a = kmeans_from(&weighted, &start, &options, false, &Silent).unwrap();
        let b = kmeans_from(&plain, &start, &options, false, &Silent).unwrap();
        assert!(a.iterations > 3 && a.iterations == b.iterations);
        assert!(a.centroids.iter().zip(&b.centroids).all(|(a, b)| (a - b).abs() < 1e-12));
        assert!((a.inertia / b.inertia - 1.0).abs() < 1e-12);
        for bad in [vec![1.0; n - 1], vec![0.0; n], vec![-1.0; n], vec![f64::NAN; n]] {
            assert!(plain.clone().weigh(bad.clone()).is_err() && weighted.weigh(bad).is_err());
        }
        assert!(weighted.append(&[&[1.0], &[1.0], &[1.0]], &[0.0; 3], &[1.0; 3]).is_err());
    }
}
