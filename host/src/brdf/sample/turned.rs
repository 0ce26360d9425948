//! A sample that lies turned in its holder.

use glam::DVec3;

use super::{Outgoing, Sample};

/// A material whose +x lies at an azimuth of the frame in which it is asked.
#[derive(Debug)]
pub struct Turned {
    sample: Box<dyn Sample>,
    sin: f64,
    cos: f64,
}

/// The same under one incident direction.
struct Lit<'a> {
    turned: &'a Turned,
    lobe: Box<dyn Outgoing + 'a>,
}

impl Turned {
    /// `sample` with its +x at `azimuth_rad` (radians, from the frame's +x towards its +y).
    #[must_use]
    pub fn new(sample: Box<dyn Sample>, azimuth_rad: f64) -> Self {
        let (sin, cos) = azimuth_rad.sin_cos();
        Self { sample, sin, cos }
    }

    /// A direction as the material's own axes see it.
    fn own(&self, w: DVec3) -> DVec3 {
        let Self { sin, cos, .. } = self;
        DVec3::new(cos * w.x + sin * w.y, cos * w.y - sin * w.x, w.z)
    }
}

impl Sample for Turned {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        Box::new(Lit {
            turned: self,
            lobe: self.sample.incident(self.own(wi)),
        })
    }

    fn is_isotropic(&self) -> bool {
        self.sample.is_isotropic()
    }
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        self.lobe.f(self.turned.own(wo))
    }

    fn across(&self, wo: DVec3) -> [f64; 3] {
        self.lobe.across(self.turned.own(wo))
    }
}
