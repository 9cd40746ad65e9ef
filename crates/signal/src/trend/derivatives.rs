//! Derivatives of values that lie on polynomials piece by piece.

/// Value, first and, from degree 2 on, second derivative at every point, of the polynomials of `degree` through it and its neighbours: of the one about it where the degree is even, the
/// mean of the two where it is odd. Where the points lie on one polynomial of the degree they are its own.
pub(super) fn local_derivatives(times: &[f64], values: &[f64], degree: usize) -> Vec<Vec<f64>> {
    let n = times.len();
    let at = |row: usize| {
        let window = |first: usize| {
            let first = first.min(n - degree - 1);
            newton(&times[first..=first + degree], &values[first..=first + degree], times[row])
        };
        let before = window(row.saturating_sub(degree.div_ceil(2)));
        let after = window(row.saturating_sub(degree / 2));
        [0.5 * (before[0] + after[0]), 0.5 * (before[1] + after[1])]
    };
    let derivatives: Vec<[f64; 2]> = (0..n).map(at).collect();
    let list = |k: usize| derivatives.iter().map(|values| values[k]).collect();
    let mut lists = vec![values.to_vec(), list(0)];
    if degree > 1 {
        lists.push(list(1));
    }
    lists
}

/// First and second derivative at a time of the polynomial through up to four points (Newton's form).
fn newton(times: &[f64], values: &[f64], at: f64) -> [f64; 2] {
    let n = times.len();
    let mut divided = [0.0; 4];
    divided[..n].copy_from_slice(values);
    for order in 1..n {
        for i in (order..n).rev() {
            divided[i] = (divided[i] - divided[i - 1]) / (times[i] - times[i - order]);
        }
    }
    // Horner, with its derivatives.
    let (mut value, mut first, mut second) = (divided[n - 1], 0.0, 0.0);
    for i in (0..n - 1).rev() {
        let t = at - times[i];
        second = second * t + 2.0 * first;
        first = first * t + value;
        value = value * t + divided[i];
    }
    [first, second]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_have_their_derivatives_at_uneven_stamps() {
        let times = [0.0, 0.3, 1.0, 1.1, 2.0, 2.6, 3.0];
        for degree in 1..=3_i32 {
            let values = times.map(|t: f64| 1.0 - t + t.powi(degree));
            let lists = local_derivatives(&times, &values, degree as usize);
            for (row, t) in times.iter().enumerate() {
                let slope = f64::from(degree) * t.powi(degree - 1) - 1.0;
                assert!((lists[1][row] - slope).abs() < 1e-12, "{degree} {row}: {} {slope}", lists[1][row]);
                if degree > 1 {
                    let second = f64::from(degree * (degree - 1)) * t.powi(degree - 2);
                    assert!((lists[2][row] - second).abs() < 1e-11, "{degree} {row}");
                }
            }
        }
    }
}
