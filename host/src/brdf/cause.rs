//! The causes of uncertainty: how each was evaluated, and what has its error in common.
//!
//! # Design
//! Evaluations are those of the GUM (JCGM 100:2008, 3.3): type A by statistics of observations, here of the calibration's frames or of the
//! photon-transfer curve that these gave; type B by other knowledge: a certificate, a tolerance, or a rule for what a model leaves out. What
//! is of type A comes from thousands of pixels, and rules of type B are upper estimates, of which the GUM (G.4.3) takes the degrees of
//! freedom as infinite: so k = 2 is a coverage of 95 % without a table of Student's t.

use serde::Serialize;

/// One cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Cause {
    /// Its name.
    pub name: &'static str,
    /// What input quantity it is of.
    pub quantity: &'static str,
    /// Type of the evaluation of its uncertainty: A, B or both.
    pub evaluation: &'static str,
    /// What has its error in common.
    pub shared_by: &'static str,
}

/// All of them, in the order of the columns of `uncertainty_share`.
pub const KINDS: [Cause; 11] = [
    Cause {
        name: "noise",
        quantity: "light of the pixels: photons, reading, rounding, response of each pixel",
        evaluation: "A",
        shared_by: "cells of the same pixels",
    },
    Cause {
        name: "stray light",
        quantity: "light that came other ways",
        evaluation: "A, B",
        shared_by: "all values of this measurement, as an offset",
    },
    Cause {
        name: "lamp",
        quantity: "light of the lamp, at calibration and since",
        evaluation: "A, B",
        shared_by: "all values of this measurement",
    },
    Cause {
        name: "standard",
        quantity: "reflectance of the standards, by which light and returned light are known",
        evaluation: "B",
        shared_by: "all results by this standard",
    },
    Cause {
        name: "light and throughput",
        quantity: "intensity of the projector's pixels times throughput of the camera's, relative to the standard's image",
        evaluation: "A, B",
        shared_by: "near directions, all results by this calibration",
    },
    Cause {
        name: "seen part",
        quantity: "share of the sample's seen part that is lit",
        evaluation: "A",
        shared_by: "near directions, all results by this calibration",
    },
    Cause {
        name: "directions",
        quantity: "direction of light and view, and lean of the sample",
        evaluation: "A, B",
        shared_by: "near directions, all results by this calibration",
    },
    Cause {
        name: "blur",
        quantity: "mean over spot, pixel and cell in place of the value at a direction",
        evaluation: "B",
        shared_by: "near directions of this sample",
    },
    Cause {
        name: "interreflection",
        quantity: "light that returned onto the sample",
        evaluation: "A, B",
        shared_by: "all values of this measurement",
    },
    Cause {
        name: "crosstalk",
        quantity: "what channels show of each other's light",
        evaluation: "A",
        shared_by: "all results by this calibration",
    },
    Cause {
        name: "polarisation",
        quantity: "degree of polarisation of the light",
        evaluation: "B",
        shared_by: "near directions of this sample",
    },
];
