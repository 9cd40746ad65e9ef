//! A plan of moments as bytes: the definition of its basis, from which everything else follows.

use super::{AffineMap, PolynomialError, PolynomialPlan, check_size};

/// Counts in front: variables, degree, targets.
const COUNTS: usize = 3;

impl PolynomialPlan {
    /// Bytes of the basis, the centres and the condition of the pilot, little-endian.
    pub fn to_bytes(&self) -> Vec<u8> {
        let counts = [self.variables(), self.degree(), self.targets()];
        let numbers = self.map.values().chain(&self.target_centre).chain([&self.condition]);
        let counts = counts.into_iter().flat_map(|count| (count as u64).to_le_bytes());
        counts.chain(numbers.flat_map(|value| value.to_le_bytes())).collect()
    }

    /// Reads what [`PolynomialPlan::to_bytes`] wrote, for `targets` targets.
    ///
    /// The plan takes memory by the number of its functions, which a reader should know from elsewhere: `variables` and `degree` are those of the bytes, or
    /// there is no plan.
    ///
    /// # Errors
    /// Bytes of another length, shape or version; numbers that are not finite; a plan that is too large.
    pub fn from_bytes(bytes: &[u8], variables: usize, degree: usize, targets: usize) -> Result<Self, PolynomialError> {
        check_size(variables, degree)?;
        let (words, rest) = bytes.as_chunks::<8>();
        let slopes = variables * (variables - 1) / 2;
        let length = targets.checked_add(COUNTS + 2 * variables + slopes + 1);
        if !rest.is_empty() || length != Some(words.len()) {
            return Err(PolynomialError::Bytes);
        }
        let (counts, numbers) = words.split_at(COUNTS);
        let expected = [variables, degree, targets].map(|count| (count as u64).to_le_bytes());
        let numbers: Vec<f64> = numbers.iter().map(|word| f64::from_le_bytes(*word)).collect();
        let [basis @ .., condition] = numbers.as_slice() else { return Err(PolynomialError::Bytes) };
        if counts != expected || basis.iter().any(|value| !value.is_finite()) || condition.is_nan() {
            return Err(PolynomialError::Bytes);
        }
        let (map, centre) = basis.split_at(2 * variables + slopes);
        let mut plan = Self::of_map(degree, AffineMap::of_values(map, variables), centre.to_vec());
        plan.condition = *condition;
        Ok(plan)
    }
}

impl PartialEq for PolynomialPlan {
    /// Returns true if rows give the same sums under both plans.
    fn eq(&self, other: &Self) -> bool {
        self.to_bytes() == other.to_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Keyed, PolynomialMoments};

    fn columns() -> Vec<Vec<f64>> {
        (0..3).map(|k| (0..300).map(|i| (0.37 * f64::from(i * (k + 1))).sin() + f64::from(k)).collect()).collect()
    }

    #[test]
    fn read_plan_sums_to_equal_bits() {
        let columns = columns();
        let [x, y, z] = [0, 1, 2].map(|k| columns[k].as_slice());
        let plan = PolynomialPlan::from_pilot(&[x, y], &[z], 3).unwrap();
        let again = PolynomialPlan::from_bytes(&plan.to_bytes(), 2, 3, 1).unwrap();
        assert_eq!((again.to_bytes(), again.condition()), (plan.to_bytes(), plan.condition()));
        let sums = |plan: &PolynomialPlan| {
            let mut moments = plan.moments();
            moments.add(plan, &mut plan.scratch(), &[x, y], &[z], None);
            moments
        };
        assert_eq!(sums(&again), sums(&plan));
        let mut kept = Keyed::new("plan");
        let key = crate::Key {
            episode: fleetfoot_data::EpisodeId(3),
            chunk: 1,
            fold: crate::Fold::default(),
            partition: 0,
            region: 0,
        };
        kept.insert(key, sums(&plan)).unwrap();
        let read = Keyed::<PolynomialMoments>::from_bytes("plan", &kept.to_bytes()).unwrap();
        assert_eq!(read, kept);
    }

    #[test]
    fn other_bytes_are_refused() {
        let columns = columns();
        let plan = PolynomialPlan::from_pilot(&[&columns[0]], &[&columns[1]], 2).unwrap();
        let bytes = plan.to_bytes();
        let read = |bytes: &[u8], shape: [usize; 3]| PolynomialPlan::from_bytes(bytes, shape[0], shape[1], shape[2]);
        assert!(read(&bytes, [1, 2, 1]).is_ok());
        for shape in [[2, 2, 1], [1, 3, 1], [1, 2, 2], [0, 2, 1], [1, 0, 1], [40, 9, 1], [1, 2, usize::MAX]] {
            assert!(read(&bytes, shape).is_err(), "{shape:?}");
        }
        assert_eq!(read(&bytes[..bytes.len() - 1], [1, 2, 1]), Err(PolynomialError::Bytes));
        let mut broken = bytes.clone();
        broken[COUNTS * 8..COUNTS * 8 + 8].copy_from_slice(&f64::NAN.to_le_bytes());
        assert_eq!(read(&broken, [1, 2, 1]), Err(PolynomialError::Bytes));
    }
}
