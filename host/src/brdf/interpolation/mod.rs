//! Interpolation between captured images.
//!
//! # Design
//! A captured image holds f for one incident direction and all outgoing ones. What lies between incident directions is
//! made from the images around, and the question is *where* each of them is read ([`Rule`]):
//!
//! - *direct*: at the outgoing direction that is asked for. Right for diffuse materials; a highlight cross-fades.
//! - *half vector*: at the outgoing direction that has the same half vector with the image's own incident direction, so
//!   that a highlight moves.
//! - *turned*: as either, after the pair was turned about the normal to the azimuth of the image: exact along φ for
//!   isotropic materials.
//!
//! All of them are also read with the two directions exchanged (Helmholtz reciprocity), from the images around the
//! outgoing direction: the captures are used twice.
//!
//! No rule is best everywhere. How wrong each of these *branches* is, is found from the captures themselves: each image
//! is predicted from those around it as if it had not been captured (`learn`), region by region ([`Regions`]). A
//! look-up is the mean of the branches, weighted by the inverse fourth power of their errors in that region ([`Blend`]),
//! which all but chooses the best one and changes smoothly from one to another.
//!
//! [`Table`] interpolates captures in memory; [`crate::brdf::Brdf`] does the same with those of a file.

mod answering;
mod blend;
mod captures;
mod lanes;
mod leave_one_out;
mod lookup;
mod packed;
mod prepared;
mod region;
mod rule;
mod table;
#[cfg(test)]
mod tests;
mod walk;

/// Weight of all that was read, of 1, with which a look-up has a value: half of it. What lies halfway between a ring that was captured and
/// one that was not has exactly that, and rounding must not decide pixel by pixel.
pub(crate) const ENOUGH: f32 = 0.499;

pub(crate) use answering::{Answering, Desk};
pub use blend::{BRANCHES, Blend, BranchErrors};
pub(crate) use captures::{Captures, Cells, Image, ImageOf, Readable};
pub(crate) use leave_one_out::learn;
pub(crate) use lookup::{Lookup, captured, look_up};
pub(crate) use packed::{BLOCK, Layout, Packed, PackedCell};
pub(crate) use prepared::filled;
pub use region::{REGIONS, Regions};
pub(crate) use rule::Captured;
pub use rule::{RULES, Rule};
pub use table::Table;
pub(crate) use walk::walk;

use serde::Serialize;

/// How values between captured directions are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// Linear in all four angles.
    Direct,
    /// Linear in the incident direction at constant half vector.
    HalfVector,
    /// What leave-one-out errors recommend, region by region, reciprocity included.
    Blended,
}

impl Interpolation {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Direct, Self::HalfVector, Self::Blended];

    /// That of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|one| one.name() == name)
    }

    /// Its name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::HalfVector => "half-vector",
            Self::Blended => "blended",
        }
    }
}
