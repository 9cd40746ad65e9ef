//! Sums that are merged, parted and kept, beside those of one pass.

use super::*;

/// Products in three regions with weights, and Chebyshev moments.
fn systems() -> [System; 2] {
    let errors = vec![derivatives()[0].clone() - Expr::column("y"), Expr::column("z")];
    let partitioned =
        System { partition: Some(voronoi()), weight: Some(Expr::column("w")), ..System::new(mixed(), derivatives()) };
    [partitioned, System::new(monomials(3), derivatives())].map(|system| System {
        also: states(),
        sampled: errors.clone(),
        ..system
    })
}

fn sums(plan: &SystemPlan, source: &MemorySource) -> SystemSums {
    plan.sum_rows(source, &Silent).unwrap()
}

#[test]
fn parts_of_a_plan_are_the_whole() {
    let (source, first) = (lorenz(3, 700, 0.01, 1.0, 0.3), lorenz(1, 700, 0.01, 1.0, 0.3));
    for system in systems() {
        let plan = SystemPlan::new(system, Some(90), &source).unwrap();
        let whole = sums(&plan, &source);
        let id = first.episodes()[0].id;
        let mut of_first = whole.clone();
        of_first.retain(|episode| episode == id);
        assert_eq!(of_first, sums(&plan, &first), "what is left is a pass over the episode alone");
        let mut others = whole.clone();
        others.retain(|episode| episode != id);
        let mut merged = others.clone();
        merged.merge(of_first.clone()).unwrap();
        assert_eq!(merged, whole);
        assert!(merged.merge(of_first).is_err() && merged == whole, "the same rows twice");
        let other_plan = SystemPlan::new(plan.system.clone(), Some(80), &source).unwrap();
        assert!(others.merge(sums(&other_plan, &first)).is_err());
        assert!(whole.are_of(&plan) && plan.empty().are_of(&plan));
    }
    let [a, b] = systems().map(|system| SystemPlan::new(system, Some(90), &source).unwrap());
    assert!(a.is_polynomial() != b.is_polynomial());
    assert!(!sums(&a, &source).are_of(&b) && !sums(&b, &source).are_of(&a));
}

#[test]
fn kept_plan_sums_to_equal_bits() {
    let source = lorenz(2, 700, 0.01, 1.0, 0.3);
    for system in systems() {
        let plan = SystemPlan::new(system.clone(), Some(90), &source).unwrap();
        let bytes = plan.coordinates();
        let again = SystemPlan::of_coordinates(system.clone(), 90, &bytes).unwrap();
        assert_eq!((&again, again.hash(), again.coordinates()), (&plan, plan.hash(), bytes.clone()));
        assert_eq!(sums(&again, &source), sums(&plan, &source));
        let fewer = System { targets: derivatives()[..2].to_vec(), ..system.clone() };
        let longer = [&bytes[..], &[0]].concat();
        for (system, bytes) in [(fewer, &bytes[..]), (system.clone(), &longer), (system.clone(), &[]), (system, &[7])] {
            let refused = SystemPlan::of_coordinates(system, 90, bytes);
            assert!(matches!(refused, Err(SystemError::Coordinates)), "{refused:?}");
        }
    }
}

#[test]
fn chunks_joined_keep_the_totals() {
    let source = lorenz(2, 700, 0.01, 1.0, 0.3);
    for system in systems() {
        let plan = SystemPlan::new(system, Some(90), &source).unwrap();
        let whole = sums(&plan, &source);
        let mut compact = whole.clone();
        compact.compact();
        let [small, large] = [&compact, &whole].map(|sums| SystemScan::new(&plan, sums).unwrap());
        assert_eq!((small.units().len(), large.units().len()), (2, 16));
        for region in 0..small.regions() {
            assert_eq!((small.rows(region), small.ranges(region)), (large.rows(region), large.ranges(region)));
            assert!(coefficient_error(&small.root(region), &large.root(region)) < 1e-10);
        }
    }
}

#[test]
fn errors_of_differences_are_sampled_by_chunk() {
    let source = lorenz(2, 700, 0.01, 1.0, 0.3);
    for system in systems() {
        // Chunks of no more rows than are sampled: all rows are.
        let wanted = sampled_mean_squares(&system.sampled, &source).unwrap();
        let scan = scan(&SystemPlan::new(system, Some(90), &source).unwrap(), &source);
        assert_close(&scan.sampled_mean_squares(|_| 1.0), &wanted, 1e-12);
        let half = scan.sampled_mean_squares(|unit| f64::from(u8::from(unit < 8)));
        assert!(half != wanted && half.iter().all(|square| *square > 0.0));
        assert_eq!(scan.sampled_mean_squares(|_| 0.0), scan.sampled_mean_squares(|_| 1.0));
    }
    let plain = scan(&SystemPlan::new(System::new(mixed(), derivatives()), None, &source).unwrap(), &source);
    assert!(plain.sampled_mean_squares(|_| 1.0).is_empty());
}
