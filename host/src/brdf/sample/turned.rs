//! A sample that lies turned in its holder.

use glam::{DMat3, DVec3};

use super::{Outgoing, Sample};

/// A material whose +x lies at an azimuth of the frame in which it is asked.
#[derive(Debug)]
pub struct Turned {
    sample: Box<dyn Sample>,
    /// From the frame in which it is asked to its own axes.
    to_own: DMat3,
}

/// The same under one incident direction.
struct Lit<'a> {
    to_own: DMat3,
    lobe: Box<dyn Outgoing + 'a>,
}

impl Turned {
    /// `sample` with its +x at `azimuth_rad` (radians, from the frame's +x towards its +y).
    #[must_use]
    pub fn new(sample: Box<dyn Sample>, azimuth_rad: f64) -> Self {
        let to_own = DMat3::from_rotation_z(-azimuth_rad);
        Self { sample, to_own }
    }
}

impl Sample for Turned {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        Box::new(Lit {
            to_own: self.to_own,
            lobe: self.sample.incident(self.to_own * wi),
        })
    }

    fn is_isotropic(&self) -> bool {
        self.sample.is_isotropic()
    }
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        self.lobe.f(self.to_own * wo)
    }

    fn across(&self, wo: DVec3) -> [f64; 3] {
        self.lobe.across(self.to_own * wo)
    }
}
