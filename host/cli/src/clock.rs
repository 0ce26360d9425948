//! What time it is: the library has no clock.

use std::time::{SystemTime, UNIX_EPOCH};

use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use crate::failure::Failure;

/// The variable of the environment with the seconds since 1970 that stand for now, for results that are the same to the bit
/// (<https://reproducible-builds.org/specs/source-date-epoch/>).
const EPOCH: &str = "SOURCE_DATE_EPOCH";

/// The time now, UTC, to the second, as RFC 3339 writes it.
///
/// # Errors
/// If the environment says another time that is none.
pub(crate) fn now() -> Result<String, Failure> {
    let seconds = match std::env::var(EPOCH) {
        Ok(text) => text.trim().parse().ok().and_then(written).ok_or(text),
        Err(_) => Ok(real()),
    };
    seconds.map_err(|text| {
        Failure::input(format!(
            "{EPOCH}: expected seconds since 1970, found {}",
            rcg::base::text::shown(&text)
        ))
    })
}

/// As [`now`], by the computer's clock if the environment says no time.
pub(crate) fn now_or_real() -> String {
    now().unwrap_or_else(|_| real())
}

fn real() -> String {
    let seconds = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |since| since.as_secs());
    written(seconds).unwrap_or_default()
}

/// Seconds since 1970 as RFC 3339 writes them; `None` beyond the year 9999.
fn written(seconds: u64) -> Option<String> {
    let moment = OffsetDateTime::from_unix_timestamp(i64::try_from(seconds).ok()?).ok()?;
    moment.format(&Rfc3339).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_are_written_as_utc() {
        assert_eq!(written(0).unwrap(), "1970-01-01T00:00:00Z");
        assert_eq!(written(1_709_210_096).unwrap(), "2024-02-29T12:34:56Z");
        assert_eq!(written(u64::MAX), None);
        assert!(real().as_str() > "2024");
    }
}
