//! Geometry of the instrument: which pixel of camera or projector looks in which direction at the sample.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `ellipsoid` | the mirror: points, normals, reflection, the map from focus to focus |
//! | `figure` | where a real mirror is not that |
//! | `wire` | the strip that the sample holder hides |
//! | `frame` | sample frame ↔ mirror frame |
//! | `pinhole` | pixel ↔ ray, with Brown–Conrady distortion |
//! | `view` | one device in the rig: pixel ↔ direction at the sample, by tracing |
//! | `inverse` | the pixel that sees a given direction |
//! | `solid_angle` | solid angle at the sample of a pixel |
//! | `map` | all pixels of a view at once |
//! | `tiles` | those pixels of a view that are asked for |
//! | `table` | any position of a view, fast, with a stated error |
//! | `spread` | parallax and blur of a pixel |
//! | `patch` | what part of the sample a pixel sees or a spot lights |
//! | `unmeasurable` | why there is no direction or no pixel |
//!
//! All geometry is `f64`; lengths are metres, angles radians, image positions pixels with the centre of the
//! first pixel at 0.5. Directions are unit vectors in the sample frame that point away from the surface.

mod ellipsoid;
mod figure;
mod footprint;
mod frame;
mod inverse;
mod map;
mod obstacle;
mod patch;
mod pinhole;
mod solid_angle;
mod spread;
mod table;
mod tiles;
mod unmeasurable;
mod view;
mod wire;

pub use ellipsoid::{Ellipsoid, reflect};
pub use figure::Figure;
pub use frame::SampleFrame;
pub use map::DirectionMap;
pub use obstacle::Outline;
pub(crate) use obstacle::WIDEST_DEG;
pub use patch::{LitPatch, Patch};
pub use pinhole::Pinhole;
pub use solid_angle::cone_sr;
pub use spread::Spread;
pub use table::DirectionTable;
pub use tiles::DirectionTiles;
pub use unmeasurable::Unmeasurable;
pub use view::{Trace, View};
pub use wire::WireStrip;

#[cfg(test)]
mod tests;
