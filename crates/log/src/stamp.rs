//! Time stamps to nanoseconds, with all digits of the file.

use fleetfoot_data::ScalarBuffer;

use crate::{TimeUnit, table::MISSING};

/// Powers of ten, all that there are: to compute them was most of what a stamp cost.
const POWERS: [i128; 39] = {
    let mut powers = [1; 39];
    let mut at = 1;
    while at < powers.len() {
        powers[at] = 10 * powers[at - 1];
        at += 1;
    }
    powers
};

/// Decimal text in `unit` to nanoseconds, rounded to the nearest; `None` when it is not a decimal number or out of range.
///
/// The digits never pass through `f64`: `1700000000.123456789` seconds keeps its last nine.
pub(crate) fn parse_decimal(text: &[u8], unit: TimeUnit) -> Option<i64> {
    let (negative, digits) = match text {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        rest => (false, rest),
    };
    // mantissa * 10^scale nanoseconds; digits beyond the 27th are far below a nanosecond for every stamp in range.
    let (mut mantissa, mut scale, mut seen, mut point) = (0i128, unit.exponent(), false, false);
    let mut at = 0;
    while at < digits.len() {
        match digits[at] {
            digit @ b'0'..=b'9' => {
                seen = true;
                if mantissa < POWERS[27] {
                    mantissa = mantissa * 10 + i128::from(digit - b'0');
                    scale -= i32::from(point);
                } else if !point {
                    return None;
                }
            }
            b'.' if !point => point = true,
            b'e' | b'E' if seen => {
                let exponent: i32 = std::str::from_utf8(&digits[at + 1..]).ok()?.parse().ok()?;
                scale = scale.checked_add(exponent)?;
                break;
            }
            _ => return None,
        }
        at += 1;
    }
    if !seen {
        return None;
    }
    let magnitude = match scale {
        0 => mantissa,
        1.. => mantissa.checked_mul(*POWERS.get(usize::try_from(scale).ok()?)?)?,
        -38..0 => {
            let divisor = POWERS[scale.unsigned_abs() as usize];
            (mantissa + divisor / 2) / divisor
        }
        _ => 0,
    };
    let signed = if negative { -magnitude } else { magnitude };
    i64::try_from(signed).ok().filter(|&stamp| stamp != MISSING)
}

/// A float in `unit` to nanoseconds, rounded once; [`MISSING`] for NaN, infinities and what nanoseconds cannot hold.
pub(crate) fn from_f64(value: f64, unit: TimeUnit) -> i64 {
    // The whole part is scaled as an integer: one product of the whole number would round at epoch size.
    let whole = value.trunc();
    if whole.is_nan() || whole.abs() >= 9.3e18 {
        return MISSING;
    }
    let scale = unit.nanoseconds();
    let fraction = ((value - whole) * scale as f64).round() as i64;
    (whole as i64).checked_mul(scale).and_then(|stamp| stamp.checked_add(fraction)).unwrap_or(MISSING)
}

/// An integer in `unit` to nanoseconds; [`MISSING`] when nanoseconds cannot hold it.
pub(crate) fn from_i64(value: i64, unit: TimeUnit) -> i64 {
    value.checked_mul(unit.nanoseconds()).unwrap_or(MISSING)
}

/// Nanoseconds in seconds, split so that the fraction keeps its digits as far as f64 goes: the same number from every format.
pub(crate) fn seconds(stamp: i64) -> f64 {
    const SECOND: i64 = 1_000_000_000;
    (stamp / SECOND) as f64 + (stamp % SECOND) as f64 / SECOND as f64
}

/// Seconds of a week, and those from 1970 to the first week of GPS.
const WEEK: i64 = 604_800;
const GPS_EPOCH: i64 = 315_964_800;

/// The begin of a week of GPS, in GPS time; [`MISSING`] when nanoseconds cannot hold it. Weeks come as if they were seconds.
pub(crate) fn gps_week(weeks: i64) -> i64 {
    let begin = weeks.checked_mul(WEEK).filter(|_| weeks != MISSING);
    begin.and_then(|begin| begin.checked_add(from_i64(GPS_EPOCH, TimeUnit::Seconds))).unwrap_or(MISSING)
}

/// The sums of the stamps that several columns tell, row by row: a date and the time of the day, seconds and the nanoseconds beyond, or, with
/// `gps_weeks`, weeks of GPS and the time of the week. Empty without columns.
pub(crate) fn sum(mut parts: impl Iterator<Item = ScalarBuffer<i64>>, gps_weeks: bool) -> ScalarBuffer<i64> {
    let first = parts.next().unwrap_or_else(|| Vec::new().into());
    let first = if gps_weeks { first.iter().map(|&weeks| gps_week(weeks)).collect::<Vec<_>>().into() } else { first };
    parts.fold(first, |sum, part| {
        let add = |(&a, &b): (&i64, &i64)| {
            if a == MISSING || b == MISSING { MISSING } else { a.checked_add(b).unwrap_or(MISSING) }
        };
        sum.iter().zip(part.iter()).map(add).collect::<Vec<_>>().into()
    })
}

/// A date with a time of day (ISO 8601, a space for the `T` accepted, fractional seconds, `Z`, an offset, or none for UTC), or a plain date.
pub(crate) fn parse_date(text: &[u8]) -> Option<i64> {
    // The cheapest test that rejects numbers: a date has its first dash or slash after the year.
    if text.len() < 8 || !matches!(text.get(4), Some(b'-' | b'/')) {
        return None;
    }
    let mut buffer = [0u8; 48];
    let copy = buffer.get_mut(..text.len())?;
    copy.copy_from_slice(text);
    for byte in copy.iter_mut().take(10) {
        if *byte == b'/' {
            *byte = b'-';
        }
    }
    let text = std::str::from_utf8(copy).ok()?;
    let nanoseconds = match text.parse::<jiff::Timestamp>() {
        Ok(stamp) => stamp.as_nanosecond(),
        Err(_) => {
            let civil: jiff::civil::DateTime = text.parse().ok()?;
            civil.to_zoned(jiff::tz::TimeZone::UTC).ok()?.timestamp().as_nanosecond()
        }
    };
    i64::try_from(nanoseconds).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(text: &str) -> Option<i64> {
        parse_decimal(text.as_bytes(), TimeUnit::Seconds)
    }

    #[test]
    fn decimal_text_keeps_every_digit() {
        assert_eq!(seconds("1700000000.123456789"), Some(1_700_000_000_123_456_789));
        assert_eq!(seconds("0.1"), Some(100_000_000));
        assert_eq!(seconds("-2.5"), Some(-2_500_000_000));
        assert_eq!(seconds("0.00100002405831736"), Some(1_000_024));
        assert_eq!(seconds("1e-3"), Some(1_000_000));
        assert_eq!(seconds("1.5E2"), Some(150_000_000_000));
        assert_eq!(seconds("7"), Some(7_000_000_000));
        assert_eq!(seconds("5e-10"), Some(1));
        assert_eq!(seconds("1e-300"), Some(0));
        assert_eq!(parse_decimal(b"12.5", TimeUnit::Microseconds), Some(12_500));
        assert_eq!(parse_decimal(b"1700000000123456789", TimeUnit::Nanoseconds), Some(1_700_000_000_123_456_789));
        for bad in ["", ".", "-", "1.2.3", "abc", "1e", "1e400", "99999999999", "0x10", "1e2147483647", "1 2"] {
            assert_eq!(seconds(bad), None, "{bad}");
        }
    }

    #[test]
    fn floats_round_once() {
        assert_eq!(from_f64(0.1, TimeUnit::Seconds), 100_000_000);
        let epoch = 1_700_000_000.25_f64;
        assert_eq!(from_f64(epoch, TimeUnit::Seconds), 1_700_000_000_250_000_000);
        assert_eq!(from_f64(-1.5, TimeUnit::Milliseconds), -1_500_000);
        for bad in [f64::NAN, f64::INFINITY, 1e300, -1e19, 1e12] {
            assert_eq!(from_f64(bad, TimeUnit::Seconds), MISSING);
        }
        assert_eq!(from_i64(i64::MAX, TimeUnit::Seconds), MISSING);
        let parts = [vec![i64::MAX, 5, MISSING], vec![1, 6, 1]].map(ScalarBuffer::from);
        assert_eq!(sum(parts.into_iter(), false)[..], [MISSING, 11, MISSING]);
    }

    #[test]
    fn weeks_of_gps_begin_in_1980() {
        // 2024-03-03, a Sunday.
        assert_eq!(gps_week(2304 * 1_000_000_000), 1_709_424_000_000_000_000);
        assert_eq!((gps_week(MISSING), gps_week(i64::MAX)), (MISSING, MISSING));
    }

    #[test]
    fn dates_of_many_habits() {
        let expected = Some(1_311_427_389_000_000_000);
        for text in [
            "2011-07-23 13:23:09",
            "2011-07-23T13:23:09Z",
            "2011/07/23 13:23:09",
            "2011-07-23T15:23:09+02:00",
            "2011-07-23 13:23:09.000",
        ] {
            assert_eq!(parse_date(text.as_bytes()), expected, "{text}");
        }
        assert_eq!(parse_date(b"2011-07-23T13:23:09.123456789Z"), Some(1_311_427_389_123_456_789));
        assert_eq!(parse_date(b"2011-07-23"), Some(1_311_379_200_000_000_000));
        for bad in ["25:00:00", "12:0x:00", "12345678", "2011-13-01 00:00:00", "yesterday", "2011-07-23 25:00:00", ""] {
            assert_eq!(parse_date(bad.as_bytes()), None, "{bad}");
        }
    }
}
