//! Pinhole projection with Brown–Conrady distortion: pixel ↔ ray in the device's own frame.
//!
//! The device looks along its +z, u grows along +x and v along +y. Image coordinates (x, y) are the ray's
//! (X/Z, Y/Z), of a mirrored image (−X/Z, Y/Z); distortion moves them, the focal length and the principal point make pixels of them.
//!
//! # Design
//! The distortion polynomial is meant for the image only: farther out it may fold back, so that a ray far
//! outside would land inside the image. [`Pinhole`] knows the largest radius that the image needs and takes
//! rays beyond it as outside.

use glam::{DMat2, DVec2, DVec3};

use crate::instrument::parts::Lens;

/// Newton steps before the inverse of the distortion is given up.
const MAX_STEPS: usize = 50;
/// Largest error of the inverse, in units of the focal length.
const TOLERANCE: f64 = 1e-14;
/// Points probed along each side of the image for the radius that it needs.
const BORDER_PROBES: u32 = 32;

/// Projection of a camera or projector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    width_px: u32,
    height_px: u32,
    focal_px: f64,
    centre_px: DVec2,
    /// 1, or (−1, 1) of a mirrored image.
    handedness: DVec2,
    /// k1, k2, p1, p2, k3; nothing when all are zero.
    distortion: Option<[f64; 5]>,
    /// Square of the largest undistorted radius in the image, with a margin; infinite without distortion.
    field_squared: f64,
    covers_image: bool,
}

impl Pinhole {
    /// The projection that a rig's lens describes.
    pub fn of(lens: &Lens) -> Pinhole {
        let mut pinhole = Pinhole {
            width_px: lens.width_px,
            height_px: lens.height_px,
            focal_px: lens.focal_px,
            centre_px: DVec2::from_array(lens.centre_px),
            handedness: if lens.mirrored {
                DVec2::new(-1.0, 1.0)
            } else {
                DVec2::ONE
            },
            distortion: lens
                .distortion
                .iter()
                .any(|&k| k != 0.0)
                .then_some(lens.distortion),
            field_squared: f64::INFINITY,
            covers_image: true,
        };
        if pinhole.distortion.is_some() {
            pinhole.measure_field();
        }
        pinhole
    }

    /// Width of the image, pixels.
    pub fn width_px(&self) -> u32 {
        self.width_px
    }

    /// Height of the image, pixels.
    pub fn height_px(&self) -> u32 {
        self.height_px
    }

    /// Whether the distortion can be undone everywhere in the image.
    pub fn covers_image(&self) -> bool {
        self.covers_image
    }

    /// Whether the position lies on the image: 0 ≤ u < width and 0 ≤ v < height.
    pub fn contains(&self, pixel: DVec2) -> bool {
        (0.0..f64::from(self.width_px)).contains(&pixel.x)
            && (0.0..f64::from(self.height_px)).contains(&pixel.y)
    }

    /// Where the image coordinates `xy` go by distortion (Brown 1966, in the form that `OpenCV` writes).
    pub fn distort(&self, xy: DVec2) -> DVec2 {
        self.distort_with_jacobian(xy).0
    }

    /// Image coordinates that distortion moves to `xy`, to 10⁻¹⁴; nothing where there are none.
    pub fn undistort(&self, xy: DVec2) -> Option<DVec2> {
        if self.distortion.is_none() {
            return Some(xy);
        }
        let mut guess = xy;
        for _ in 0..MAX_STEPS {
            let (moved, jacobian) = self.distort_with_jacobian(guess);
            // Beyond the fold of the polynomial the inverse is another branch than the lens.
            let one_to_one = jacobian.determinant() > 0.0;
            if !one_to_one {
                return None;
            }
            let step = jacobian.inverse() * (xy - moved);
            guess += step;
            if step.length() <= TOLERANCE {
                return Some(guess);
            }
        }
        None
    }

    /// Pixel of a ray in the device's frame, on or off the image; nothing behind the device or outside of
    /// the part that the distortion describes.
    pub fn project(&self, ray: DVec3) -> Option<DVec2> {
        let xy = image_coordinates(ray)? * self.handedness;
        (xy.length_squared() <= self.field_squared).then(|| self.distort(xy) * self.focal_px + self.centre_px)
    }

    /// Ray (x, y, 1) of a pixel in the device's frame, not of unit length; nothing where distortion cannot
    /// be undone.
    pub fn ray(&self, pixel: DVec2) -> Option<DVec3> {
        let xy = self.undistort((pixel - self.centre_px) / self.focal_px)?;
        Some((xy * self.handedness).extend(1.0))
    }

    fn distort_with_jacobian(&self, xy: DVec2) -> (DVec2, DMat2) {
        let Some([k1, k2, p1, p2, k3]) = self.distortion else {
            return (xy, DMat2::IDENTITY);
        };
        let (x, y) = (xy.x, xy.y);
        let rr = x * x + y * y;
        let radial = 1.0 + rr * (k1 + rr * (k2 + rr * k3));
        // d radial / d(r²), so that ∂radial/∂x = 2x · slope.
        let slope = k1 + rr * (2.0 * k2 + rr * 3.0 * k3);
        let moved = DVec2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (rr + 2.0 * x * x),
            y * radial + p1 * (rr + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = 2.0 * x * y * slope + 2.0 * (p1 * x + p2 * y);
        let jacobian = DMat2::from_cols(
            DVec2::new(radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, cross),
            DVec2::new(cross, radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x),
        );
        (moved, jacobian)
    }

    /// Finds the radius that the image needs and whether the distortion is one to one within it.
    fn measure_field(&mut self) {
        let size_px = DVec2::new(f64::from(self.width_px), f64::from(self.height_px));
        let mut needed = 0.0_f64;
        for probe in 0..=BORDER_PROBES {
            let t = f64::from(probe) / f64::from(BORDER_PROBES);
            for at in [
                DVec2::new(t, 0.0),
                DVec2::new(t, 1.0),
                DVec2::new(0.0, t),
                DVec2::new(1.0, t),
            ] {
                match self.ray(at * size_px) {
                    Some(ray) => needed = needed.max(ray.x.hypot(ray.y)),
                    None => self.covers_image = false,
                }
            }
        }
        // The border is probed coarsely; the margin covers what lies between the probes.
        self.field_squared = (needed * 1.001).powi(2);
        for ring in 0..=BORDER_PROBES {
            for spoke in 0..BORDER_PROBES {
                let radius = needed * f64::from(ring) / f64::from(BORDER_PROBES);
                let angle_rad = f64::from(spoke) / f64::from(BORDER_PROBES) * std::f64::consts::TAU;
                let jacobian = self
                    .distort_with_jacobian(DVec2::from_angle(angle_rad) * radius)
                    .1;
                self.covers_image &= jacobian.determinant() > 0.0;
            }
        }
    }
}

/// Image coordinates (X/Z, Y/Z) of a ray in the device's frame; nothing behind the device.
pub(super) fn image_coordinates(ray: DVec3) -> Option<DVec2> {
    (ray.z > 0.0).then(|| DVec2::new(ray.x, ray.y) / ray.z)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn lens(distortion: [f64; 5]) -> Lens {
        Lens {
            width_px: 640,
            height_px: 480,
            focal_px: 700.0,
            centre_px: [315.0, 244.0],
            distortion,
            offset_m: [0.0; 3],
            rotation_deg: [0.0; 3],
            mirrored: false,
            pupil_m: 0.0,
        }
    }

    proptest! {
        #[test]
        fn undistorting_undoes_distorting(
            x in -0.45..0.45_f64, y in -0.35..0.35_f64,
            k1 in -0.3..0.3_f64, k2 in -0.1..0.1_f64, p1 in -0.01..0.01_f64, p2 in -0.01..0.01_f64,
        ) {
            let pinhole = Pinhole::of(&lens([k1, k2, p1, p2, 0.02]));
            let xy = DVec2::new(x, y);
            let back = pinhole.undistort(pinhole.distort(xy)).expect("within the lens's field");
            prop_assert!((back - xy).length() < 2e-14);
        }

        #[test]
        fn a_ray_goes_through_its_pixel(u in 0.0..640.0_f64, v in 0.0..480.0_f64, mirrored: bool) {
            let lens = Lens { mirrored, ..lens([-0.2, 0.05, 0.002, -0.003, 0.01]) };
            let pinhole = Pinhole::of(&lens);
            let pixel = DVec2::new(u, v);
            let back = pinhole.project(pinhole.ray(pixel).expect("in the image")).expect("in front");
            prop_assert!((back - pixel).length() < 1e-10);
        }
    }

    #[test]
    fn the_jacobian_is_the_derivative() {
        let pinhole = Pinhole::of(&lens([-0.2, 0.05, 0.02, -0.03, 0.1]));
        let (xy, h) = (DVec2::new(0.3, -0.2), 1e-6);
        let jacobian = pinhole.distort_with_jacobian(xy).1;
        for (axis, column) in [(DVec2::X, jacobian.x_axis), (DVec2::Y, jacobian.y_axis)] {
            let slope = (pinhole.distort(xy + h * axis) - pinhole.distort(xy - h * axis)) / (2.0 * h);
            assert!((slope - column).length() < 1e-9);
        }
    }

    #[test]
    fn distortion_follows_the_published_polynomial() {
        // x = 0.3, y = -0.2: r² = 0.13; each coefficient by itself, worked out by hand.
        let at = |distortion| Pinhole::of(&lens(distortion)).distort(DVec2::new(0.3, -0.2));
        let close = |found: DVec2, x: f64, y: f64| (found - DVec2::new(x, y)).length() < 1e-15;
        assert!(close(at([0.1, 0.0, 0.0, 0.0, 0.0]), 0.3 * 1.013, -0.2 * 1.013));
        assert!(close(
            at([0.0, 0.1, 0.0, 0.0, 0.0]),
            0.3 * 1.001_69,
            -0.2 * 1.001_69
        ));
        assert!(close(at([0.0, 0.0, 0.1, 0.0, 0.0]), 0.3 - 0.012, -0.2 + 0.021));
        assert!(close(at([0.0, 0.0, 0.0, 0.1, 0.0]), 0.3 + 0.031, -0.2 - 0.012));
        assert!(close(
            at([0.0, 0.0, 0.0, 0.0, 0.1]),
            0.3 * 1.000_219_7,
            -0.2 * 1.000_219_7
        ));
    }

    #[test]
    fn the_principal_point_looks_straight_ahead() {
        let pinhole = Pinhole::of(&lens([0.0; 5]));
        assert_eq!(pinhole.project(DVec3::Z), Some(DVec2::new(315.0, 244.0)));
        assert_eq!(
            pinhole.project(DVec3::new(0.1, 0.0, 1.0)),
            Some(DVec2::new(385.0, 244.0))
        );
        assert_eq!(pinhole.project(-DVec3::Z), None);
    }

    #[test]
    fn a_mirrored_image_runs_the_other_way() {
        let pinhole = Pinhole::of(&Lens {
            mirrored: true,
            ..lens([0.0; 5])
        });
        let at = pinhole.project(DVec3::new(0.1, 0.05, 1.0)).unwrap();
        assert!((at - DVec2::new(245.0, 279.0)).length() < 1e-12, "{at}");
    }

    #[test]
    fn a_ray_beyond_the_fold_is_not_in_the_image() {
        // Barrel distortion folds at r = √(1/(3·0.3)) ≈ 1.05: x = 1.7 would come back to about 0.23.
        let pinhole = Pinhole::of(&lens([-0.3, 0.0, 0.0, 0.0, 0.0]));
        assert!(pinhole.covers_image());
        assert!(pinhole.distort(DVec2::new(1.7, 0.0)).x < 0.3);
        assert_eq!(pinhole.project(DVec3::new(1.7, 0.0, 1.0)), None);
    }

    #[test]
    fn a_fold_inside_the_image_is_noticed() {
        assert!(!Pinhole::of(&lens([-3.0, 0.0, 0.0, 0.0, 0.0])).covers_image());
    }

    #[test]
    fn the_first_pixel_belongs_to_the_image_and_the_far_edge_does_not() {
        let pinhole = Pinhole::of(&lens([0.0; 5]));
        for (u, v, inside) in [
            (0.0, 0.0, true),
            (0.5, 479.999, true),
            (640.0, 10.0, false),
            (10.0, 480.0, false),
            (-1e-9, 1.0, false),
            (f64::NAN, 1.0, false),
        ] {
            assert_eq!(pinhole.contains(DVec2::new(u, v)), inside, "{u} {v}");
        }
    }
}
