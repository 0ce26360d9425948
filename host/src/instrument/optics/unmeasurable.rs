//! Why a direction cannot be measured, or a pixel sees no direction.

/// Reason why there is no measurement; a value that is stored and printed, never a NaN.
///
/// Where several apply, the first in this order is given: below horizon, hole, beyond rim, occluded, outside
/// image, off sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, thiserror::Error)]
#[repr(u8)]
pub enum Unmeasurable {
    /// The light would go through the hole around the mirror's vertex.
    #[error("hole")]
    Hole = 1,
    /// The light would pass below the mirror's rim.
    #[error("beyond rim")]
    BeyondRim = 2,
    /// No pixel of the image looks there.
    #[error("outside image")]
    OutsideImage = 3,
    /// The wire that holds the sample is in the way.
    #[error("occluded")]
    Occluded = 4,
    /// The direction is below the sample's surface.
    #[error("below horizon")]
    BelowHorizon = 5,
    /// The viewing ray meets the sample plane beside the sample, or calibration has not seen the standard there.
    #[error("off sample")]
    OffSample = 6,
}

impl Unmeasurable {
    /// All reasons in the order of their codes.
    pub const ALL: [Unmeasurable; 6] = [
        Unmeasurable::Hole,
        Unmeasurable::BeyondRim,
        Unmeasurable::OutsideImage,
        Unmeasurable::Occluded,
        Unmeasurable::BelowHorizon,
        Unmeasurable::OffSample,
    ];

    /// Number of the reason in files, 1 to 6; 0 stands for "measurable".
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The reason with the number `code`, or nothing for 0 and numbers that mean nothing.
    pub fn from_code(code: u8) -> Option<Unmeasurable> {
        Self::ALL.into_iter().find(|reason| reason.code() == code)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_codes_are_those_of_the_files() {
        let names = Unmeasurable::ALL
            .map(|reason| (reason.code(), reason.to_string()))
            .map(|(c, n)| format!("{c} {n}"));
        let expected = [
            "1 hole",
            "2 beyond rim",
            "3 outside image",
            "4 occluded",
            "5 below horizon",
            "6 off sample",
        ];
        assert_eq!(names, expected);
    }

    #[test]
    fn a_code_names_its_reason_and_other_codes_none() {
        for code in 0..=u8::MAX {
            let reason = Unmeasurable::from_code(code);
            assert_eq!(
                reason.map(Unmeasurable::code),
                (1..=6).contains(&code).then_some(code)
            );
        }
    }
}
