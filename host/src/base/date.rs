//! Days of the Gregorian calendar, as certificates have them.

use std::fmt::{self, Display};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;
use toml::value::Datetime;

/// Seconds since the beginning of 1970 of a moment as RFC 3339 writes it, such as `2027-03-14T10:00:00Z`; `None` of anything else.
#[must_use]
pub fn unix_s(text: &str) -> Option<i64> {
    let moment = OffsetDateTime::parse(text, &Rfc3339).ok()?;
    Some(moment.unix_timestamp())
}

/// A day, written `2027-03-14` (ISO 8601); later days are greater.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Date(time::Date);

/// What is no day.
#[derive(Debug, thiserror::Error)]
#[error("expected a day such as 2027-03-14, found {0}")]
pub struct DateError(String);

impl Date {
    /// The day, in universal time, so many seconds after the beginning of 1970.
    #[must_use]
    pub fn of_unix_s(seconds: u64) -> Self {
        let moment = OffsetDateTime::UNIX_EPOCH.saturating_add(time::Duration::seconds(seconds as i64));
        Self(moment.date())
    }
}

impl Display for Date {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (year, month, day) = self.0.to_calendar_date();
        write!(f, "{year:04}-{:02}-{day:02}", u8::from(month))
    }
}

impl FromStr for Date {
    type Err = DateError;

    fn from_str(text: &str) -> Result<Self, DateError> {
        let none = || DateError(crate::base::text::shown(text));
        let Datetime {
            date: Some(date),
            time: None,
            offset: None,
        } = text.parse().map_err(|_| none())?
        else {
            return Err(none());
        };
        let month = time::Month::try_from(date.month).map_err(|_| none())?;
        let day = time::Date::from_calendar_date(date.year.into(), month, date.day);
        day.map(Self).map_err(|_| none())
    }
}

impl TryFrom<String> for Date {
    type Error = DateError;

    fn try_from(text: String) -> Result<Self, DateError> {
        text.parse()
    }
}

impl From<Date> for String {
    fn from(date: Date) -> Self {
        date.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_follow_each_other_as_the_calendar_has_them() {
        for (days, text) in [
            (0, "1970-01-01"),
            (59, "1970-03-01"),
            (789, "1972-02-29"),
            (11_016, "2000-02-29"),
            (20_088, "2024-12-31"),
            (20_089, "2025-01-01"),
            (47_541, "2100-03-01"),
        ] {
            let date = Date::of_unix_s(days * 86_400 + 86_399);
            assert_eq!(date.to_string(), text);
            assert_eq!(text.parse::<Date>().unwrap(), date);
        }
        // Each is a day that there is, and later than the one before.
        let mut before = Date::of_unix_s(0);
        for days in 1..60_000 {
            let date = Date::of_unix_s(days * 86_400);
            assert!(
                date > before && date.to_string().parse::<Date>().unwrap() == date,
                "{date}"
            );
            before = date;
        }
    }

    #[test]
    fn moments_are_read_as_they_are_written() {
        assert_eq!(unix_s("1970-01-02T00:00:00Z"), Some(86_400));
        assert_eq!(unix_s("2024-02-29T12:34:56Z"), Some(1_709_210_096));
        assert_eq!(unix_s("2024-02-30T12:34:56Z").or(unix_s("yesterday")), None);
    }

    #[test]
    fn what_is_no_day_is_refused() {
        for bad in [
            "",
            "2025",
            "2025-02-29",
            "2025-13-01",
            "14.3.2025",
            "2025-03-14T10:00:00",
            "2025-03-14T10:00:00Z",
            "10:00:00",
            "2025-3-4",
        ] {
            assert!(bad.parse::<Date>().is_err(), "{bad}");
        }
    }
}
