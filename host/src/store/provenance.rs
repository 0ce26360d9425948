//! Where a value of the BRDF comes from.
//!
//! # Design
//! One byte per value, so that it can stand beside every direction pair in a file. `Missing` is 0,
//! the fill value of the array: what was never written is missing. The value beside it is NaN then and only then.

/// Origin of one BRDF value; the discriminant is the code in files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Provenance {
    /// No value: not measurable or not measured.
    Missing = 0,
    /// From one exposure.
    Measured = 1,
    /// From several exposures of different length, merged.
    Merged = 2,
    /// Taken over from the exchanged pair of directions (Helmholtz reciprocity).
    Reciprocal = 3,
    /// From neighbours in the same measurement.
    Interpolated = 4,
    /// From a fitted model.
    Modelled = 5,
}

impl Provenance {
    /// All origins in the order of their codes.
    pub const ALL: [Self; 6] = [
        Self::Missing,
        Self::Measured,
        Self::Merged,
        Self::Reciprocal,
        Self::Interpolated,
        Self::Modelled,
    ];

    /// The code in files.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The origin with this code, or `None` for a code that no version has written.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// Whether a value of this origin was measured itself. What is derived from others (exchanged, interpolated, modelled) is
    /// no evidence beside them.
    #[must_use]
    pub const fn is_seen(self) -> bool {
        matches!(self, Self::Measured | Self::Merged)
    }

    /// The word for it in files, tables and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::Measured => "measured",
            Self::Merged => "merged",
            Self::Reciprocal => "reciprocal",
            Self::Interpolated => "interpolated",
            Self::Modelled => "modelled",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_codes_of_files_never_change() {
        let codes: Vec<(u8, &str)> = Provenance::ALL.iter().map(|p| (p.code(), p.name())).collect();
        let expected = [
            (0, "missing"),
            (1, "measured"),
            (2, "merged"),
            (3, "reciprocal"),
            (4, "interpolated"),
            (5, "modelled"),
        ];
        assert_eq!(codes, expected);
    }

    #[test]
    fn every_code_names_its_own_origin_and_no_other_code_does() {
        for code in 0..=u8::MAX {
            assert_eq!(
                Provenance::from_code(code).map(Provenance::code),
                (code < 6).then_some(code)
            );
        }
    }
}
