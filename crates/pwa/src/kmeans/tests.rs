//! The fast algorithm against the plain one.

use fleetfoot_data::{Silent, with_threads};
use proptest::prelude::*;

use super::{
    distance::{nearest, squared_distance},
    random::uniform,
    sums::{Quanta, Sums},
    *,
};

fn points(rows: &[Vec<f64>]) -> Points {
    let d = rows[0].len();
    let columns: Vec<Vec<f64>> = (0..d).map(|j| rows.iter().map(|row| row[j]).collect()).collect();
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    Points::from_columns(&columns, &vec![0.0; d], &vec![1.0; d]).unwrap()
}

/// Lloyd's algorithm as it is written down: all distances, all sums, every time.
fn plain(rows: &[Vec<f64>], start: &[f64], iterations: usize) -> (Vec<f64>, Vec<u32>) {
    let d = rows[0].len();
    let largest = rows.iter().flatten().fold(0.0f64, |largest, x| largest.max(x.abs()));
    let mut centroids = start.to_vec();
    let mut labels = vec![u32::MAX; rows.len()];
    for _ in 0..iterations {
        let new: Vec<u32> = rows.iter().map(|row| nearest(row, &centroids).label).collect();
        let stop = new == labels;
        labels = new;
        let mut sums = Sums::new(start.len() / d, d, Quanta::new(rows.len(), largest));
        rows.iter().zip(&labels).for_each(|(row, label)| sums.add(*label as usize, row));
        let distance = |i: usize| squared_distance(&rows[i], &centroids[labels[i] as usize * d..][..d]);
        let mut far: Vec<usize> = (0..rows.len()).filter(|&i| distance(i) > 0.0).collect();
        far.sort_by(|&a, &b| distance(b).total_cmp(&distance(a)));
        let mut far = far.into_iter();
        for empty in (0..start.len() / d).filter(|&k| sums.counts()[k] == 0).collect::<Vec<_>>() {
            if let Some(row) = far.by_ref().find(|&i| sums.counts()[labels[i] as usize] > 1) {
                sums.subtract(labels[row] as usize, &rows[row]);
                sums.add(empty, &rows[row]);
            }
        }
        sums.means(&mut centroids);
        if stop {
            break;
        }
    }
    let labels = rows.iter().map(|row| nearest(row, &centroids).label).collect();
    (centroids, labels)
}

fn check(rows: &[Vec<f64>], start: &[f64], k: usize, iterations: usize) -> Result<(), TestCaseError> {
    let d = rows[0].len();
    let points = points(rows);
    let options = KMeansOptions { k, max_iterations: iterations, tolerance: 0.0 };
    let kmeans = kmeans(&points, Start::Centroids(start), &options, &Silent).unwrap();
    let (centroids, labels) = plain(rows, start, iterations);
    let counts: Vec<u64> = (0..k).map(|k| labels.iter().filter(|label| **label == k as u32).count() as u64).collect();
    let members: Vec<usize> = (0..k).filter(|&k| counts[k] > 0).collect();
    let kept: Vec<f64> = members.iter().flat_map(|&k| centroids[k * d..(k + 1) * d].to_vec()).collect();
    prop_assert_eq!(&kmeans.centroids, &kept);
    prop_assert_eq!(&kmeans.counts, &members.iter().map(|&k| counts[k]).collect::<Vec<_>>());
    let inertia: f64 = rows
        .iter()
        .zip(&labels)
        .map(|(row, label)| squared_distance(row, &centroids[*label as usize * d..][..d]))
        .sum();
    prop_assert!((kmeans.inertia - inertia).abs() <= 1e-12 * inertia);
    // The same rows through the assigner, labels included.
    let assigner = Assigner::new(&centroids, d).unwrap();
    let columns: Vec<Vec<f64>> = (0..d).map(|j| rows.iter().map(|row| row[j]).collect()).collect();
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let (mut assigned, mut distances) = (vec![0; rows.len()], vec![0.0; rows.len()]);
    assigner.assign(&columns, &vec![0.0; d], &vec![1.0; d], &mut assigned, Some(&mut distances)).unwrap();
    prop_assert_eq!(&assigned, &labels);
    for i in 0..rows.len() {
        prop_assert_eq!(distances[i], squared_distance(&rows[i], &centroids[labels[i] as usize * d..][..d]));
    }
    Ok(())
}

/// Rows of kinds that break bounds and screens: blobs, lattices full of ties, duplicates, offsets, outliers.
fn rows(kind: usize, n: usize, d: usize, seed: u64) -> Vec<Vec<f64>> {
    let u = |i: usize, j: usize| uniform(seed, i as u64, j as u64);
    (0..n)
        .map(|i| {
            (0..d)
                .map(|j| match kind {
                    0 => u(i, j) * 4.0 - 2.0,
                    1 => (u(i, j) * 3.0).floor(),
                    2 => u(i % 5, j),
                    3 => 1e6 + 1e-3 * u(i, j),
                    4 => {
                        if i % 97 == 3 {
                            1e7 * u(i, j)
                        } else {
                            u(i, j)
                        }
                    }
                    5 => 10.0 * u(i % 7, j) + u(i, j),
                    _ => 1e-20 * u(i, j),
                })
                .collect()
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]
    #[test]
    fn labels_and_centroids_match_plain_lloyd(
        kind in 0usize..7, n in 1usize..700, d in 1usize..20, k in 1usize..24, iterations in 0usize..30, seed in any::<u64>(), from_rows in any::<bool>(),
    ) {
        let rows = rows(kind, n, d, seed);
        // Starts at rows give ties and duplicates; starts elsewhere give empty clusters.
        let start: Vec<f64> = (0..k * d)
            .map(|at| if from_rows { rows[(at / d * 31) % n][at % d] } else { rows[0][at % d] * 3.0 * uniform(seed, 1 << 40, at as u64) })
            .collect();
        check(&rows, &start, k, iterations)?;
    }
}

#[test]
fn many_clusters_match_plain_lloyd() {
    for (kind, n, d, k) in
        [(0, 20_000, 16, 50), (5, 20_000, 16, 50), (0, 9_000, 3, 200), (1, 9_000, 2, 40), (4, 9_000, 5, 13)]
    {
        let rows = rows(kind, n, d, 3);
        let start: Vec<f64> = (0..k).flat_map(|c| rows[c * 41].clone()).collect();
        check(&rows, &start, k, 25).unwrap();
    }
}

#[test]
fn centroids_do_not_depend_on_threads() {
    let rows = rows(5, 30_000, 6, 11);
    let points = points(&rows);
    let options = KMeansOptions { k: 12, max_iterations: 20, tolerance: 0.0 };
    let run = |threads| {
        with_threads(threads, || kmeans(&points, Start::PlusPlus { seed: 5, restarts: 2 }, &options, &Silent).unwrap())
    };
    let one = run(1);
    for threads in [2, 7] {
        let other = run(threads);
        assert_eq!(one, other);
        assert_eq!(one.inertia.to_bits(), other.inertia.to_bits());
    }
}

#[test]
fn degenerate_shapes() {
    let rows = rows(0, 50, 3, 1);
    let all = points(&rows);
    let fit = |points: &Points, k| {
        let options = KMeansOptions { k, tolerance: 0.0, ..KMeansOptions::default() };
        kmeans(points, Start::PlusPlus { seed: 1, restarts: 3 }, &options, &Silent).unwrap()
    };
    let one = fit(&all, 1);
    for j in 0..3 {
        let mean = rows.iter().map(|row| row[j]).sum::<f64>() / 50.0;
        assert!((one.centroids[j] - mean).abs() < 1e-14);
    }
    assert_eq!((one.counts.as_slice(), one.converged), ([50].as_slice(), true));
    let every = fit(&all, 50);
    assert_eq!((every.counts, every.inertia), (vec![1; 50], 0.0));
    let more = fit(&all, 60);
    assert_eq!((more.counts.len(), more.inertia), (50, 0.0));
    let duplicates: Vec<Vec<f64>> = (0..100).map(|i| vec![f64::from(i % 4)]).collect();
    let few = fit(&points(&duplicates), 9);
    let mut centroids = few.centroids.clone();
    centroids.sort_by(f64::total_cmp);
    assert_eq!((centroids, few.counts, few.inertia), (vec![0.0, 1.0, 2.0, 3.0], vec![25; 4], 0.0));
    let same = fit(&points(&vec![vec![2.5, -1.0]; 10]), 3);
    assert_eq!((same.centroids, same.counts), (vec![2.5, -1.0], vec![10]));
}

#[test]
fn centroids_are_the_means_of_their_rows() {
    let rows = rows(4, 5000, 4, 8);
    let points = points(&rows);
    let options = KMeansOptions { k: 9, max_iterations: 500, tolerance: 0.0 };
    let kmeans = kmeans(&points, Start::PlusPlus { seed: 2, restarts: 1 }, &options, &Silent).unwrap();
    assert!(kmeans.converged);
    let labels: Vec<u32> = rows.iter().map(|row| nearest(row, &kmeans.centroids).label).collect();
    for (k, centroid) in kmeans.centroids.chunks(4).enumerate() {
        let members: Vec<&Vec<f64>> =
            rows.iter().zip(&labels).filter(|(_, label)| **label == k as u32).map(|(row, _)| row).collect();
        assert_eq!(members.len() as u64, kmeans.counts[k]);
        for j in 0..4 {
            let mean = members.iter().map(|row| row[j]).sum::<f64>() / members.len() as f64;
            assert!((centroid[j] - mean).abs() <= 1e-12 * mean.abs().max(1.0), "{} {mean}", centroid[j]);
        }
    }
}

#[test]
fn seeding_prefers_distant_rows() {
    // Seven tight blobs, far apart: greedy k-means++ finds one row of each.
    let rows: Vec<Vec<f64>> =
        (0..7000).map(|i| vec![100.0 * f64::from(i % 7) + uniform(1, i as u64, 0), uniform(1, i as u64, 1)]).collect();
    let points = points(&rows);
    let start = plus_plus::plus_plus(&points, 7, |draw| uniform(42, 0, draw as u64), &Silent).unwrap();
    let mut blobs: Vec<i64> = start.chunks(2).map(|c| (c[0] / 100.0).floor() as i64).collect();
    blobs.sort_unstable();
    assert_eq!(blobs, (0..7).collect::<Vec<_>>());
    let options = KMeansOptions { k: 5, tolerance: 0.0, ..KMeansOptions::default() };
    let run = |restarts| kmeans(&points, Start::PlusPlus { seed: 9, restarts }, &options, &Silent).unwrap().inertia;
    assert!(run(8) <= run(1));
}

#[test]
fn bad_requests_are_refused() {
    let points = points(&rows(0, 20, 2, 1));
    let run = |start, k, tolerance| kmeans(&points, start, &KMeansOptions { k, tolerance, max_iterations: 5 }, &Silent);
    assert!(matches!(run(Start::Centroids(&[0.0; 4]), 0, 0.0), Err(KMeansError::NoClusters)));
    assert!(matches!(run(Start::Centroids(&[0.0; 5]), 2, 0.0), Err(KMeansError::Shape { expected: 4, actual: 5, .. })));
    assert!(matches!(
        run(Start::Centroids(&[0.0, 1.0, f64::NAN, 0.0]), 2, 0.0),
        Err(KMeansError::Centroid { cluster: 1, column: 0, .. })
    ));
    assert!(matches!(run(Start::Centroids(&[0.0; 4]), 2, f64::NAN), Err(KMeansError::Tolerance(_))));
    assert!(matches!(
        kmeans(&Points::new(2), Start::Centroids(&[0.0; 4]), &KMeansOptions::default(), &Silent),
        Err(KMeansError::NoRows)
    ));
    struct Stop;
    impl Progress for Stop {
        fn advance(&self, _: usize, _: usize) {}
        fn cancelled(&self) -> bool {
            true
        }
    }
    let stopped = kmeans(&points, Start::PlusPlus { seed: 1, restarts: 1 }, &KMeansOptions::default(), &Stop);
    assert!(matches!(stopped, Err(KMeansError::Cancelled(_))));
    let assigner = Assigner::new(&[0.0, 0.0, 1.0, 1.0], 2).unwrap();
    let (mut labels, mut distances) = ([0; 3], [0.0; 3]);
    let (x, y) = ([0.1, f64::NAN, 1e200], [0.0, 0.0, 1e200]);
    assigner.assign(&[&x, &y], &[0.0; 2], &[1.0; 2], &mut labels, Some(&mut distances)).unwrap();
    assert_eq!(labels[..2], [0, Assigner::NOWHERE]);
    assert!(distances[1].is_nan() && (distances[0] - 0.01).abs() < 1e-15);
    assert!(assigner.assign(&[&x, &y], &[0.0; 2], &[1.0; 2], &mut labels[..2], None).is_err());
}

#[test]
fn small_problems_converge_to_the_result_of_scikit_learn() {
    let text = include_str!("../../tests/data/kmeans_sklearn.txt");
    let mut lines = text.lines().skip(1);
    let mut cases = 0;
    while let Some(head) = lines.next() {
        let head: Vec<&str> = head.split(' ').collect();
        let [n, d, k, iterations] = [2, 3, 4, 5].map(|i: usize| head[i].parse::<usize>().unwrap());
        let mut matrix = |count: usize| -> Vec<Vec<f64>> {
            lines.by_ref().take(count).map(|line| line.split(' ').map(|x| x.parse().unwrap()).collect()).collect()
        };
        let (rows, start, centroids) = (matrix(n), matrix(k).concat(), matrix(k).concat());
        let tail: Vec<&str> = lines.next().unwrap().split(' ').collect();
        let (inertia, made) = (tail[1].parse::<f64>().unwrap(), tail[3].parse::<usize>().unwrap());
        let options = KMeansOptions { k, max_iterations: iterations, tolerance: 0.0 };
        let kmeans = kmeans(&points(&rows), Start::Centroids(&start), &options, &Silent).unwrap();
        assert_eq!((rows[0].len(), kmeans.centroids.len()), (d, k * d));
        for (ours, theirs) in kmeans.centroids.iter().zip(&centroids) {
            assert!((ours - theirs).abs() <= 1e-9, "{}: {ours} {theirs}", head[1]);
        }
        assert!(kmeans.inertia <= inertia * (1.0 + 1e-12), "{}: {} {inertia}", head[1], kmeans.inertia);
        assert_eq!(kmeans.iterations, made, "{}", head[1]);
        cases += 1;
    }
    assert_eq!(cases, 4);
}
