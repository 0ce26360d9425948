//! Integer units of the wire and the firmware, as types that cannot be mixed up.

use core::fmt;
use core::ops::{Add, AddAssign, Sub};

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// A time or a duration in cycles of the controller's clock, which [`crate::Info::clock_hz`] reports.
///
/// 64 bits last for 4,600 years at 125 MHz; on the wire small values are short (varint).
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Schema,
)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Ticks(#[serde(with = "crate::varint")] pub u64);

impl Ticks {
    /// No time at all.
    pub const ZERO: Self = Self(0);

    /// `self − other`, or zero if `other` is later.
    #[must_use]
    pub const fn saturating_sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }

    /// `self + other`, or `None` past the end of the range.
    #[must_use]
    pub const fn checked_add(self, other: Self) -> Option<Self> {
        match self.0.checked_add(other.0) {
            Some(ticks) => Some(Self(ticks)),
            None => None,
        }
    }

    /// This duration in microseconds of a clock of `clock_hz`, rounded down.
    #[must_use]
    pub const fn to_micros(self, clock_hz: u32) -> u64 {
        (self.0 as u128 * 1_000_000 / clock_hz as u128) as u64
    }
}

impl Add for Ticks {
    type Output = Self;
    fn add(self, rhs: Self) -> Self {
        Self(self.0 + rhs.0)
    }
}

impl AddAssign for Ticks {
    fn add_assign(&mut self, rhs: Self) {
        self.0 += rhs.0;
    }
}

impl Sub for Ticks {
    type Output = Self;
    fn sub(self, rhs: Self) -> Self {
        Self(self.0 - rhs.0)
    }
}

impl fmt::Display for Ticks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ticks", self.0)
    }
}

/// A duration in microseconds, where the clock's tick would be needlessly fine (time-outs).
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Schema,
)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Micros(pub u32);

impl Micros {
    /// The dead-man time that a host asks for unless told otherwise: longer than any pause of a desktop host.
    pub const DEFAULT_DEAD_MAN: Self = Self(2_000_000);

    /// The same duration in ticks of a clock of `clock_hz`.
    #[must_use]
    pub const fn to_ticks(self, clock_hz: u32) -> Ticks {
        Ticks((self.0 as u128 * clock_hz as u128 / 1_000_000) as u64)
    }
}

/// Index of a fired step since the start of its run, counted over all cycles.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Schema,
)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct StepId(#[serde(with = "crate::varint")] pub u64);

impl fmt::Display for StepId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "step {}", self.0)
    }
}

/// One host's conversation with the controller; drawn by the controller at [`crate::Request::Hello`].
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Schema,
)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct SessionId(pub u32);

/// Number of a request within its session; grows with every new request, stays for a retry.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Schema,
)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Seq(pub u32);
