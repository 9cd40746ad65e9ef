use faer::Mat;
use proptest::prelude::*;

use super::*;

fn matrix(rows: usize, columns: usize, mut next: impl FnMut() -> f64) -> Mat<f64> {
    Mat::from_fn(rows, columns, |_, _| next())
}

fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = fleetfoot_data::mix(state);
        (state >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
    }
}

/// With every entry free the nearest matrix has the same singular vectors and its singular values cut off: the closed form.
#[test]
fn all_entries_free_cuts_singular_values_off() {
    let mut next = random(7);
    for n in [1, 2, 5, 8] {
        let wanted = matrix(n, n, || 2.0 * next());
        let contraction =
            Contraction { offset: Mat::zeros(n, n), left: Mat::identity(n, n), right: Mat::identity(n, n), bound: 0.8 };
        let Svd { u, s, v } = svd(wanted.as_ref()).unwrap();
        let cut = Mat::from_fn(n, n, |i, j| (0..n).map(|k| u[(i, k)] * s[k].min(0.8) * v[(j, k)]).sum::<f64>());
        let distance = 0.5 * s.iter().map(|s| (s - 0.8).max(0.0).powi(2)).sum::<f64>();
        let zeros = Mat::zeros(n, n);
        for nearest in [
            contraction.nearest(wanted.as_ref(), zeros.as_ref(), 1e-9).unwrap(),
            contraction.nearest_by_long_steps(wanted.as_ref(), zeros.as_ref(), 1e-9).unwrap(),
        ] {
            // f is strongly convex: a gap bounds the squared distance to the minimum.
            assert!((&nearest.values - &cut).norm_l2() <= (2.0 * nearest.gap).sqrt() + 1e-12);
            assert!(nearest.distance >= distance && nearest.distance - distance <= nearest.gap + 1e-14);
            assert!(nearest.gap <= 1e-9 * nearest.distance && nearest.norm <= 0.8);
        }
    }
}

/// y(k+1) = a y(k) + b y(k-1) with a metric in which both the wanted map and the answer are small: the optimum on a grid is no better.
#[test]
fn a_companion_matrix_keeps_its_given_row() {
    let offset = Mat::from_fn(2, 2, |i, j| f64::from(u8::from(i == 1 && j == 0)));
    let M = Mat::from_fn(2, 2, |i, j| [[1.2, -0.5], [1.0, 0.0]][i][j]);
    let P = lyapunov(M.as_ref(), Mat::identity(2, 2).as_ref()).unwrap();
    let T = P.llt(Side::Lower).unwrap().L().transpose().to_owned();
    let inverse = T.as_ref().partial_piv_lu().solve(Mat::<f64>::identity(2, 2));
    let contraction = Contraction {
        offset: &T * &offset * &inverse,
        left: T.subcols(0, 1).to_owned(),
        right: inverse.clone(),
        bound: 1.0,
    };
    let start = Mat::from_fn(2, 1, |i, _| [1.2, -0.5][i]);
    let wanted = Mat::from_fn(2, 1, |i, _| [1.9, -0.85][i]);
    let nearest = contraction.nearest(wanted.as_ref(), start.as_ref(), 1e-8).unwrap();
    let back = &inverse * &nearest.matrix * &T;
    assert!((back[(1, 0)] - 1.0).abs() < 1e-12 && back[(1, 1)].abs() < 1e-12, "the given row stays");
    assert!(spectral_radius(back.as_ref()) <= nearest.norm + 1e-12 && nearest.norm < 1.0);
    for i in -200..=200 {
        for j in -200..=200 {
            let other = Mat::from_fn(2, 1, |k, _| nearest.values[(k, 0)] + [f64::from(i), f64::from(j)][k] * 2e-3);
            let distance = 0.5 * (&other - &wanted).squared_norm_l2();
            if distance < nearest.distance - nearest.gap {
                let norm = svd(contraction.matrix(other.as_ref()).as_ref()).unwrap().s[0];
                assert!(norm > 1.0, "a point of the grid is nearer and within the bound");
            }
        }
    }
}

#[test]
fn contracting_maps_stay_and_bad_starts_are_refused() {
    let contraction =
        Contraction { offset: Mat::zeros(2, 2), left: Mat::identity(2, 2), right: Mat::identity(2, 2), bound: 1.0 };
    let wanted = Mat::from_fn(2, 2, |i, j| if i == j { 0.5 } else { 0.1 });
    assert_eq!(contraction.nearest(wanted.as_ref(), wanted.as_ref(), 1e-8).unwrap().values, wanted);
    let far = Mat::from_fn(2, 2, |_, _| 3.0);
    assert!(contraction.nearest(far.as_ref(), far.as_ref(), 1e-8).is_none());
}

#[test]
fn lyapunov_solution_satisfies_its_equation() {
    let M = Mat::from_fn(3, 3, |i, j| [[0.99, 0.3, 0.0], [-0.1, 0.9, 0.2], [0.0, 0.0, -0.7]][i][j]);
    let W = Mat::<f64>::identity(3, 3);
    let P = lyapunov(M.as_ref(), W.as_ref()).unwrap();
    let left = &P - M.transpose() * &P * &M;
    assert!((&left - &W).norm_max() < 1e-12 * P.norm_max());
    let unstable = Mat::from_fn(2, 2, |i, j| [[1.001, 0.0], [0.5, 0.2]][i][j]);
    assert!(lyapunov(unstable.as_ref(), Mat::identity(2, 2).as_ref()).is_none());
    // A rotation by 90 degrees, stretched.
    let turn = Mat::from_fn(2, 2, |i, j| [[0.0, -1.5], [1.5, 0.0]][i][j]);
    assert!((spectral_radius(turn.as_ref()) - 1.5).abs() < 1e-12);
}

/// A metric whose coordinates nearly agree: near the border Newton's matrix is no more definite than rounding leaves it.
#[test]
fn nearly_equal_coordinates_keep_the_bound() {
    let of = |values: [[f64; 3]; 3]| Mat::from_fn(3, 3, |i, j| values[i][j]);
    let contraction = Contraction {
        offset: Mat::zeros(3, 3),
        left: of([
            [43.87758061481223, -67.68428349001954, 31.947972010006914],
            [-67.97760852835843, 116.0800306165028, -48.522823301500104],
            [-48.839974119953894, 73.5693458831397, -35.67725195766747],
        ]),
        right: of([
            [-0.004018407051456915, -0.0004527043059683148, -0.0029826698840116697],
            [-4.784376364950955e-5, 2.350544837383983e-6, -4.603959676276428e-5],
            [0.003487975897000421, 0.0004067414907985106, 0.002567064776279635],
        ]),
        bound: 1.0,
    };
    let free = of([
        [7758.38646339512, 653.339715410432, -1283.839852457448],
        [-0.4280383770778322, 8093.2591673496245, 678.7432833431908],
        [14.950554911431704, -4.782733772277977, 8957.636747081136],
    ]);
    let start = Mat::zeros(3, 3);
    for tolerance in [1e-3, 1e-8] {
        let nearest = contraction.nearest(free.as_ref(), start.as_ref(), tolerance).unwrap();
        let norm = svd(contraction.matrix(nearest.values.as_ref()).as_ref()).unwrap().s[0];
        // The duality gap is the certificate; rounding leaves none of 1e-8 here.
        assert!(norm < 1.0 && nearest.gap <= 1e-3 * nearest.distance, "{norm} {} {}", nearest.gap, nearest.distance);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// The certificate holds the distance from below: no random feasible point is nearer by more than the gap.
    #[test]
    fn projection_is_nearest_within_gap(seed in 0_u64..10_000, n in 2_usize..6, q in 1_usize..4, s in 1_usize..5) {
        let (q, s) = (q.min(n), s.min(n));
        let mut next = random(seed);
        let contraction = Contraction {
            offset: matrix(n, n, || 0.3 * next()),
            left: matrix(n, q, &mut next),
            right: matrix(s, n, &mut next),
            bound: 1.0,
        };
        let start = contraction.least().unwrap();
        prop_assume!(svd(contraction.matrix(start.as_ref()).as_ref()).unwrap().s[0] < 0.95);
        let wanted = matrix(s, q, || 3.0 * next());
        let nearest = contraction.nearest(wanted.as_ref(), start.as_ref(), 1e-7).unwrap();
        prop_assert!(nearest.norm <= 1.0 && nearest.gap <= 1e-7 * nearest.distance.max(f64::MIN_POSITIVE) || nearest.distance == 0.0);
        for _ in 0..50 {
            let noise = 0.05 * next().abs();
            let mut other = Mat::from_fn(s, q, |b, t| nearest.values[(b, t)] + noise * next());
            let norm = svd(contraction.matrix(other.as_ref()).as_ref()).unwrap().s[0];
            if norm > 1.0 {
                // Towards the answer until it is within: the set is convex.
                for _ in 0..60 {
                    other = Mat::from_fn(s, q, |b, t| 0.5 * (other[(b, t)] + nearest.values[(b, t)]));
                    if svd(contraction.matrix(other.as_ref()).as_ref()).unwrap().s[0] <= 1.0 {
                        break;
                    }
                }
            }
            if svd(contraction.matrix(other.as_ref()).as_ref()).unwrap().s[0] <= 1.0 {
                let distance = 0.5 * (&other - &wanted).squared_norm_l2();
                prop_assert!(distance >= nearest.distance - nearest.gap - 1e-12);
            }
        }
    }
}
