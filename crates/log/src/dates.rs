//! Dates and times of day as people and spreadsheets write them: `29/09/2020 13:45`, `04.05.2021 09:00`, `12:00:01.5`, `0 days 00:00:01.5`.

use crate::stamp;

/// Nanoseconds of a second, and seconds of a day.
const SECOND: i64 = 1_000_000_000;
const DAY: i64 = 86_400;

/// English months, by the letters that tell them.
const MONTHS: [&str; 12] = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];

/// The order of day and month in dates with slashes or dashes. With dots the day comes first; four digits in front are the year.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DateOrder {
    /// `4/25/2021`
    MonthFirst,
    /// `25/4/2021`
    DayFirst,
}

/// Steps back and nanoseconds passed of dates that are read in one order.
type Rank = (usize, i64);

/// The orders in which the dates of a column can be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fit {
    /// Both, with the same stamps.
    Same,
    /// This one alone.
    Only,
    /// Both, with different stamps: the ranks with the month first and with the day first.
    Either(Rank, Rank),
}

impl DateOrder {
    /// The other one.
    pub(crate) fn other(self) -> Self {
        match self {
            Self::MonthFirst => Self::DayFirst,
            Self::DayFirst => Self::MonthFirst,
        }
    }

    /// For messages.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::MonthFirst => "month first",
            Self::DayFirst => "day first",
        }
    }

    /// The order in which a column's dates are written, as far as these cells determine it.
    ///
    /// If both orders fit, the one is chosen in which the dates do not go back, and span less time.
    pub(crate) fn of<'a>(cells: impl Iterator<Item = &'a [u8]> + Clone) -> (Self, Fit) {
        let stamps = |order| cells.clone().map(|cell| parse(cell, order)).collect::<Option<Vec<i64>>>();
        match (stamps(Self::MonthFirst), stamps(Self::DayFirst)) {
            (None, Some(_)) => (Self::DayFirst, Fit::Only),
            (Some(_), None) => (Self::MonthFirst, Fit::Only),
            (None, None) => (Self::MonthFirst, Fit::Same),
            (Some(month), Some(day)) => {
                let rank = |stamps: &[i64]| {
                    let back = stamps.windows(2).filter(|pair| pair[1] < pair[0]).count();
                    let ends = stamps.iter().min().zip(stamps.iter().max());
                    (back, ends.map_or(0, |(first, last)| last.saturating_sub(*first)))
                };
                let (month_rank, day_rank) = (rank(&month), rank(&day));
                let fit = if month == day { Fit::Same } else { Fit::Either(month_rank, day_rank) };
                (Self::better(month_rank, day_rank), fit)
            }
        }
    }

    fn better(month: Rank, day: Rank) -> Self {
        if day < month { Self::DayFirst } else { Self::MonthFirst }
    }

    /// The order of the files that leave both open: that of the other files, or, where all leave it open, the better one for all; `None` where the others
    /// differ.
    pub(crate) fn common(files: &[(Self, Fit)]) -> Option<Self> {
        let mut certain = files.iter().filter(|(_, fit)| *fit == Fit::Only).map(|(order, _)| *order);
        if let Some(first) = certain.next() {
            return certain.all(|order| order == first).then_some(first);
        }
        let add = |(back, time): Rank, more: Rank| (back + more.0, time.saturating_add(more.1));
        let ranks = files.iter().filter_map(|(_, fit)| match fit {
            Fit::Either(month, day) => Some((*month, *day)),
            _ => None,
        });
        let (month, day) = ranks.reduce(|(a, b), (month, day)| (add(a, month), add(b, day)))?;
        Some(Self::better(month, day))
    }
}

/// Nanoseconds since 1970 of a date with or without a time of day; of a time alone since midnight, of days and a time since their begin.
pub(crate) fn parse(text: &[u8], order: DateOrder) -> Option<i64> {
    parse_in(text, Some(order))
}

/// The same; without an order, dates whose form needs one are none.
fn parse_in(text: &[u8], order: Option<DateOrder>) -> Option<i64> {
    let text = text.trim_ascii();
    // Length or first letter rule out most other cells, which are numbers or words.
    if text.len() < 6 || text.len() > 40 || !text.first().is_some_and(|first| first.is_ascii_digit() || *first == b'-')
    {
        return None;
    }
    stamp::parse_date(text).or_else(|| std::str::from_utf8(text).ok().and_then(|text| written(text, order)))
}

/// The same in whichever order of day and month the text is a date.
pub(crate) fn parse_any(text: &[u8]) -> Option<i64> {
    parse(text, DateOrder::MonthFirst).or_else(|| parse(text, DateOrder::DayFirst))
}

/// The same for dates that are read one by one: forms in which day and month could change places are refused, whatever their numbers.
pub(crate) fn parse_certain(text: &[u8]) -> Option<i64> {
    parse_in(text, None)
}

fn written(text: &str, order: Option<DateOrder>) -> Option<i64> {
    if let Some((days, time)) = text.split_once(" days ").or_else(|| text.split_once(" day ")) {
        let days: i64 = days.parse().ok()?;
        let time = time_of_day(time.trim().trim_start_matches('+'), true)?;
        return days.checked_mul(DAY * SECOND)?.checked_add(time);
    }
    let (date, time) = match text.split_once([' ', 'T', ',']) {
        Some((date, time)) => (date, time.trim()),
        None => (text, ""),
    };
    if date.contains(':') {
        return if time.is_empty() { time_of_day(date, true) } else { time_of_day(text, false) };
    }
    let midnight = stamp::parse_date(calendar(date, order, !time.is_empty())?.as_bytes())?;
    let (time, zone) = zone(time);
    let since = if time.is_empty() { 0 } else { time_of_day(time, false)? };
    midnight.checked_add(since)?.checked_sub(zone?)
}

/// A date as `2021-05-04`.
fn calendar(date: &str, order: Option<DateOrder>, timed: bool) -> Option<String> {
    let separator = date.chars().find(|c| matches!(c, '/' | '.' | '-'))?;
    let parts: Vec<&str> = date.split(separator).collect();
    let [first, second, third] = parts[..] else { return None };
    let number = |text: &str, digits: usize| {
        let is_number = (1..=digits).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_digit());
        if is_number { text.parse::<u32>().ok() } else { None }
    };
    let month_name = |text: &str| {
        let short = text.get(..3)?.to_ascii_lowercase();
        MONTHS.iter().position(|month| *month == short).map(|place| place as u32 + 1)
    };
    let (year, month, day) = if first.len() == 4 {
        (number(first, 4)?, number(second, 2)?, number(third, 2)?)
    } else {
        let year = match third.len() {
            4 => number(third, 4)?,
            // Two digits could be a version's; with a time they are a year's.
            2 if timed => number(third, 2).map(|year| if year < 70 { 2000 + year } else { 1900 + year })?,
            _ => return None,
        };
        match (month_name(second), separator, order) {
            (Some(month), ..) => (year, month, number(first, 2)?),
            (None, '.', _) | (None, _, Some(DateOrder::DayFirst)) => (year, number(second, 2)?, number(first, 2)?),
            (None, _, Some(DateOrder::MonthFirst)) => (year, number(first, 2)?, number(second, 2)?),
            (None, _, None) => return None,
        }
    };
    Some(format!("{year:04}-{month:02}-{day:02}"))
}

/// A time without its zone, and the zone's offset in nanoseconds; `None` for a zone that is not known.
fn zone(time: &str) -> (&str, Option<i64>) {
    for name in ["Z", "UTC", "GMT"] {
        if let Some(time) = time.strip_suffix(name) {
            return (time.trim_end(), Some(0));
        }
    }
    let Some(at) = time.rfind(['+', '-']) else { return (time, Some(0)) };
    let digits: String = time[at + 1..].chars().filter(|c| *c != ':').collect();
    let minutes = match (digits.len(), digits.parse::<i64>()) {
        (2, Ok(hours)) => Some(hours * 60),
        (4, Ok(both)) => Some(both / 100 * 60 + both % 100),
        _ => None,
    };
    let sign = if time[at..].starts_with('-') { -1 } else { 1 };
    (time[..at].trim_end(), minutes.map(|minutes| sign * minutes * 60 * SECOND))
}

/// `9:05`, `09:05:01.25`, `9:05:01 PM`; alone also `05:01.2` (minutes and seconds), and hours beyond a day.
fn time_of_day(text: &str, alone: bool) -> Option<i64> {
    let lower = text.to_ascii_lowercase();
    let (time, half) = match (lower.strip_suffix("am"), lower.strip_suffix("pm")) {
        (Some(time), _) => (time.trim_end(), Some(0)),
        (_, Some(time)) => (time.trim_end(), Some(12)),
        _ => (lower.as_str(), None),
    };
    let parts: Vec<&str> = time.split(':').collect();
    let whole = |text: &str| {
        let is_number = (1..=4).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_digit());
        if is_number { text.parse::<i64>().ok() } else { None }
    };
    let (hours, minutes, seconds) = match parts[..] {
        [hours, minutes, seconds] => (whole(hours)?, whole(minutes)?, seconds),
        [minutes, seconds] if alone && half.is_none() && seconds.contains(['.', ',']) => (0, whole(minutes)?, seconds),
        [hours, minutes] if !alone || half.is_some() => (whole(hours)?, whole(minutes)?, "0"),
        _ => return None,
    };
    let hours = match half {
        Some(later) if (1..=12).contains(&hours) => hours % 12 + later,
        Some(_) => return None,
        None if hours < 24 || alone => hours,
        None => return None,
    };
    let seconds = stamp::parse_decimal(seconds.replace(',', ".").as_bytes(), crate::TimeUnit::Seconds)?;
    let is_sound = minutes < 60 && (0..61 * SECOND).contains(&seconds);
    is_sound.then(|| (hours * 3600 + minutes * 60) * SECOND + seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(text: &str, order: DateOrder) -> Option<f64> {
        parse(text.as_bytes(), order).map(stamp::seconds)
    }

    #[test]
    fn dates_of_spreadsheets() {
        use DateOrder::{DayFirst, MonthFirst};
        let may_4 = 1_620_086_400.0;
        for (text, expected) in [
            ("04.05.2021 09:00", may_4 + 9.0 * 3600.0),
            ("4.5.2021 9:00:30,5", may_4 + 9.0 * 3600.0 + 30.5),
            ("4.5.21 09:00", may_4 + 9.0 * 3600.0),
            ("04-May-2021 21:00:00", may_4 + 21.0 * 3600.0),
            ("2021/5/4 0:00", may_4),
            ("2021-05-04 00:00:01", may_4 + 1.0),
            ("04.05.2021 09:00 UTC", may_4 + 9.0 * 3600.0),
            ("04.05.2021 09:00+02:00", may_4 + 7.0 * 3600.0),
            ("04.05.2021", may_4),
            ("12:00:01.5", 43_201.5),
            ("25:00:01", 90_001.0),
            ("1:02.5", 62.5),
            ("0 days 00:00:00.050000", 0.05),
            ("-1 days +23:59:59.95", -0.05),
            ("2 days 00:00:01", 172_801.0),
        ] {
            for order in [DayFirst, MonthFirst] {
                assert_eq!(seconds(text, order), Some(expected), "{text}");
            }
        }
        assert_eq!(seconds("4/5/2021 12:30 AM", DayFirst), Some(may_4 + 1800.0));
        assert_eq!(seconds("5/4/2021 12:30:00 PM", MonthFirst), Some(may_4 + 12.5 * 3600.0));
        assert_eq!((seconds("29/09/2020 13:45", MonthFirst), seconds("09-29-2020 13:45", DayFirst)), (None, None));
        assert_eq!(seconds("29/09/2020 13:45", DayFirst), Some(1_601_387_100.0));
        for text in ["1.2.3", "1.5.21", "192.168.1.10", "12:30", "1/2", "30.02.2021", "04.05.2021 25:00", "a:b:c", "-5"]
        {
            assert_eq!(seconds(text, DayFirst), None, "{text}");
        }
    }

    #[test]
    fn the_order_of_day_and_month_follows_from_all_dates() {
        let order = |texts: &[&str]| DateOrder::of(texts.iter().map(|text| text.as_bytes()));
        assert_eq!(order(&["1/1/2021 0:00", "1/13/2021 0:00"]), (DateOrder::MonthFirst, Fit::Only));
        assert_eq!(order(&["01/02/2020 10:00", "29/09/2020 13:45"]), (DateOrder::DayFirst, Fit::Only));
        // Midnight passed: the next day, not the next month.
        assert_eq!(order(&["04/05/2021 23:59", "05/05/2021 00:00"]).0, DateOrder::DayFirst);
        assert_eq!(order(&["04/05/2021 23:59", "04/06/2021 00:00"]).0, DateOrder::MonthFirst);
        assert_eq!(order(&["2021-01-02 00:00", "2021-01-03 00:00"]), (DateOrder::MonthFirst, Fit::Same));
    }

    #[test]
    fn dates_are_certain_by_their_form() {
        for text in ["04/04/2021 09:00", "05/04/2021 09:00", "13/05/2021 09:00", "05-13-2021", "4/4/21 9:00"] {
            assert_eq!(parse_certain(text.as_bytes()), None, "{text}");
        }
        for text in
            ["2021-04-05 09:00:00", "2021/4/5 0:00", "05.04.2021", "05-Apr-2021", "09:00:01.5", "2 days 00:00:01"]
        {
            assert!(parse_certain(text.as_bytes()).is_some(), "{text}");
        }
    }
}
