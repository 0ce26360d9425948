//! What is put into the holder: standards that are told apart, and the light trap.

use std::sync::Arc;

use super::capture::{Request, Shows};
use super::interreflection::{check_apart, interreflected};
use super::rank_one::positive;
use crate::brdf::sample::Sample;
use crate::calibrate::CalibrateError;
use crate::calibrate::by_hand::Place;
use crate::hemisphere::direction::from_degrees;
use crate::virtual_rig::Held;
use crate::virtual_rig::setup::SetupError;

/// What is in the holder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum InHolder {
    Standard,
    Second,
    Trap,
}

impl Shows {
    /// The stand, and what stands there.
    pub(super) fn in_holder(self) -> (usize, InHolder) {
        match self {
            Self::Series(_) | Self::Levels | Self::Colours => (0, InHolder::Standard),
            Self::Black(stand) | Self::Directions(stand, _) => (stand, InHolder::Standard),
            Self::SecondBlack | Self::SecondDirections(_) => (0, InHolder::Second),
            Self::Dark(_) => (0, InHolder::Trap),
        }
    }
}

/// Both standards.
pub(super) struct Standards {
    pub(super) first: Held,
    second: Option<Held>,
}

impl Standards {
    /// Those of `request`, as far as they can serve, as they are at this `place`.
    pub(super) fn of(request: &Request, place: Place) -> Result<Self, CalibrateError> {
        let parse = |spec: &str| -> Result<Held, CalibrateError> {
            let sample = crate::brdf::sample::parse(spec).map_err(SetupError::from)?;
            Ok(Held::Sample(Arc::from(sample)))
        };
        let standard = parse(&request.standard)?;
        if let Held::Sample(sample) = &standard {
            check_standard(sample.as_ref(), &request.standard)?;
        }
        let second = request.second_standard.as_deref().map(parse).transpose()?;
        if let (Held::Sample(first), Some((Held::Sample(second), spec))) =
            (&standard, second.as_ref().zip(request.second_standard.as_deref()))
        {
            check_standard(second.as_ref(), spec)?;
            check_apart(interreflected(first.as_ref()), interreflected(second.as_ref()))?;
        }
        let real = |number: usize, held: Held| match held {
            Held::Sample(stated) => Held::Sample(place.standard(number, stated)),
            other => other,
        };
        Ok(Self {
            first: real(0, standard),
            second: second.map(|held| real(1, held)),
        })
    }

    /// What is held.
    pub(super) fn get(&self, what: InHolder) -> &Held {
        match (what, &self.second) {
            (InHolder::Second, Some(second)) => second,
            (InHolder::Trap, _) => &Held::Trap,
            _ => &self.first,
        }
    }
}

/// Refuses a standard that is not above 0 all over, before it costs a capture.
pub(super) fn check_standard(sample: &dyn Sample, spec: &str) -> Result<(), CalibrateError> {
    let directions = || {
        let rings = (0..=8).map(|ring| 10.0 * f64::from(ring));
        rings.flat_map(|theta_deg| (0..8).map(move |turn| from_degrees(theta_deg, 45.0 * f64::from(turn))))
    };
    for wi in directions() {
        let lobe = sample.incident(wi);
        for wo in directions() {
            for f in lobe.f(wo) {
                positive(f, spec, wi, wo)?;
            }
        }
    }
    Ok(())
}
