//! Values of channels that show some of each other, taken apart.
//!
//! # Design
//! Of the values of all channels at a cell, which [`Crosstalk`] mixed, the inverse makes those of the primaries. Noise of channels is
//! independent. What the shares are uncertain by counts as much as the channels differ: nothing for a grey sample.

use glam::{Mat3, Vec3};

use super::lit::place;
use crate::hemisphere::disk::Disk;
use crate::instrument::calibration::{COLOURS, Crosstalk};
use crate::instrument::optics::View;

/// How the values of an image are taken apart.
pub(super) struct Colours {
    /// Of each cell: what makes primaries of channels, and the squares of that.
    cells: Vec<[Mat3; 2]>,
    /// Variances of what channels show of primaries, relative.
    variance: Mat3,
}

impl Colours {
    /// Of cells of `disk` that a `camera` with this crosstalk sees.
    pub(super) fn new(crosstalk: Crosstalk, camera: &View, disk: Disk) -> Self {
        let of = |cell: usize| {
            let at = disk.direction(cell).and_then(|w| camera.pixel(w).ok());
            let apart = at.map_or(Mat3::IDENTITY, |at| {
                let [x, y] = place(camera, at);
                crosstalk.at(x, y).inverse().as_mat3()
            });
            [apart, squares(apart)]
        };
        let uncertainty = Mat3::from_cols_array_2d(
            &crosstalk
                .standard_uncertainty
                .map(|row| row.map(|uncertainty| uncertainty as f32)),
        );
        Self {
            cells: (0..disk.len()).map(of).collect(),
            variance: squares(uncertainty.transpose()),
        }
    }

    /// Takes the values `f` and their standard uncertainties `sigma` by noise apart, [cell, channel]; what is uncertain of that goes into
    /// `mixed`.
    pub(super) fn take_apart(&self, f: &mut [f32], sigma: &mut [f32], mixed: &mut [f32]) {
        let values = f
            .as_chunks_mut::<COLOURS>()
            .0
            .iter_mut()
            .zip(sigma.as_chunks_mut::<COLOURS>().0)
            .zip(mixed.as_chunks_mut::<COLOURS>().0);
        for (((f, sigma), mixed), [apart, squared]) in values.zip(&self.cells) {
            let found = *apart * Vec3::from(*f);
            let variance = Vec3::from(*sigma) * Vec3::from(*sigma);
            *sigma = (*squared * variance).map(f32::sqrt).to_array();
            for (channel, mixed) in mixed.iter_mut().enumerate() {
                let apart = found - found[channel];
                *mixed = self.variance.row(channel).dot(apart * apart).sqrt();
            }
            *f = found.to_array();
        }
    }
}

/// The square of each element.
fn squares(of: Mat3) -> Mat3 {
    Mat3::from_cols_array(&of.to_cols_array().map(|element| element * element))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instrument::rig::Rig;

    #[test]
    fn what_channels_show_of_each_other_is_taken_apart_and_what_is_uncertain_grows_with_colour() {
        let rig = Rig::load("rcg-3").unwrap().with_image_size(32).unwrap();
        let (camera, disk) = (View::camera(&rig), Disk::new(8));
        let crosstalk = Crosstalk {
            shares: [
                [[0.96, -0.01], [0.04, 0.01], [0.0, 0.0]],
                [[0.02, 0.0], [0.96, 0.0], [0.02, 0.0]],
                [[0.0, 0.0], [0.05, 0.0], [0.95, 0.0]],
            ],
            standard_uncertainty: [[1e-3; 3]; 3],
        };
        let colours = Colours::new(crosstalk, &camera, disk);
        for (true_f, mixed_2) in [([0.2; 3], 0.0), ([0.3, 0.1, 0.02], 1e-3 * 0.08_f32.hypot(0.28))] {
            let (mut f, mut sigma, mut mixed) =
                (Vec::new(), vec![1e-3; disk.len() * 3], vec![0.0; disk.len() * 3]);
            for cell in 0..disk.len() {
                let at = disk.direction(cell).and_then(|w| camera.pixel(w).ok());
                let shown = at.map_or(glam::DMat3::IDENTITY, |at| {
                    let [x, y] = place(&camera, at);
                    crosstalk.at(x, y)
                });
                f.extend((shown.as_mat3() * Vec3::from(true_f)).to_array());
            }
            colours.take_apart(&mut f, &mut sigma, &mut mixed);
            for (values, mixed) in f.as_chunks::<3>().0.iter().zip(mixed.as_chunks::<3>().0) {
                assert!(
                    Vec3::from(*values).abs_diff_eq(Vec3::from(true_f), 1e-6),
                    "{values:?}"
                );
                assert!((mixed[2] - mixed_2).abs() < 1e-6, "{mixed:?}");
            }
            // The inverse makes a little more of noise.
            assert!(sigma.iter().all(|sigma| (1e-3..1.1e-3).contains(sigma)));
        }
    }
}
