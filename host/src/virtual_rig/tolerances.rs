//! How far rigs stray from what they should be: tolerances, and flaws drawn within them.

use rand::RngExt as _;
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::crosstalk::Crosstalk;
use super::figure::Figure;
use super::flaws::{
    BLACK_FIELD, CONTRASTS, Direct, Field, Flaws, Focus, Ghost, Glare, Lamp, Pixels, Pupils, log_uniform,
};
use super::knee::Knee;
use super::lag::Lag;
use super::polarisation::Polarisation;
use super::seating::Seating;
use crate::instrument::rig::{Panel, Rig};

/// How far a drawn truth strays from the nominal rig, as standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// Each coordinate of the optical centres of camera and projector and of the sample's centre, metres.
    pub position_m: f64,
    /// Each rotation of camera, projector, sample and the mirror's edges, degrees.
    pub angle_deg: f64,
    /// Half the range of the fields of throughput and intensity, relative: not a deviation but what is reached.
    pub field: f64,
    /// Light of a lit projector pixel over that of a black one; `None` draws it from [`CONTRASTS`], log-uniformly.
    pub contrast: Option<f64>,
    /// Share of light that is thrown aside; `None` draws it from [`GLARES`](super::GLARES), log-uniformly.
    pub glare: Option<f64>,
    /// Light of the ghost over that of the image; `None` draws it from [`GHOSTS`](super::GHOSTS), log-uniformly.
    pub ghost: Option<f64>,
    /// Radiance of direct light over that of a white sample; `None` draws it between 10⁻⁴ and 3·10⁻³, log-uniformly.
    pub direct: Option<f64>,
    /// Drift of the light in an hour, relative, of either sign; `None` draws it from [`DRIFTS`](super::DRIFTS), log-uniformly.
    pub drift: Option<f64>,
    /// Standard deviation of the light from exposure to exposure, relative; `None` draws it from
    /// [`FLICKERS`](super::FLICKERS), log-uniformly.
    pub flicker: Option<f64>,
    /// By which share the edge of the projector's pupil is dimmer than its middle; `None` draws it from
    /// [`FALLOFFS`](super::FALLOFFS), log-uniformly.
    pub falloff: Option<f64>,
    /// Slope of the mirror's figure error, RMS, radians; `None` draws it from [`FIGURES_RAD`](super::FIGURES_RAD),
    /// log-uniformly.
    pub figure_rad: Option<f64>,
    /// Share of a signal at the full well that the camera does not show; `None` draws it from [`KNEES`](super::KNEES),
    /// log-uniformly.
    pub knee: Option<f64>,
    /// Share of its charge that a green pixel of the camera's mosaic loses to its neighbours; `None` draws it from
    /// [`CROSSTALKS`](super::CROSSTALKS), log-uniformly.
    pub crosstalk: Option<f64>,
    /// Share of a change of light that is left when a pattern counts as settled; `None` draws it from [`LAGS`](super::LAGS),
    /// log-uniformly. Never any with mirrors.
    pub lag: Option<f64>,
    /// Degree of polarisation of the light, and of what the camera prefers; `None` draws both from
    /// [`POLARISATIONS`](super::POLARISATIONS), log-uniformly.
    pub polarisation: Option<f64>,
    /// Standard deviation of the height at which things are seated in the holder, metres; `None` draws it from
    /// [`SEATINGS_M`](super::SEATINGS_M), log-uniformly.
    pub seating_m: Option<f64>,
    /// Standard deviation of how far the flat mirror leans from the tilt that was set, either way, degrees; `None` draws it from
    /// [`TILTS_DEG`](super::TILTS_DEG), log-uniformly.
    pub mirror_deg: Option<f64>,
    /// Standard deviation of where the light of a projector pixel goes, pixels; `None` draws it from [`BLURS_PX`](super::BLURS_PX),
    /// log-uniformly.
    pub blur_px: Option<f64>,
    /// Standard uncertainty of the reflectance of each standard, relative: a certificate of a pressed or sintered PTFE standard
    /// says 0.25 to 0.5 %.
    pub standard: f64,
    /// How the camera's pixels differ.
    pub pixels: PixelTolerances,
}

/// How far the camera's pixels differ; see [`Pixels`]. `None` draws each log-uniformly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelTolerances {
    /// As [`Pixels::prnu`], drawn from [`PRNUS`](super::PRNUS).
    pub prnu: Option<f64>,
    /// As [`Pixels::dsnu_e`], drawn between 0.3 and 3 electrons.
    pub dsnu_e: Option<f64>,
    /// As [`Pixels::hot`], drawn between 10⁻⁵ and 10⁻³.
    pub hot: Option<f64>,
    /// As [`Pixels::row_noise_e`], drawn from [`ROW_NOISES_E`](super::ROW_NOISES_E).
    pub row_noise_e: Option<f64>,
    /// As [`Pixels::wander_e`], drawn from [`WANDERS_E`](super::WANDERS_E).
    pub wander_e: Option<f64>,
}

impl PixelTolerances {
    /// All of it drawn.
    pub const DRAWN: Self = Self {
        prnu: None,
        dsnu_e: None,
        hot: None,
        row_noise_e: None,
        wander_e: None,
    };

    fn drawn(self, seed: u64) -> Pixels {
        let drawn = Pixels::drawn(seed);
        Pixels {
            prnu: self.prnu.unwrap_or(drawn.prnu),
            dsnu_e: self.dsnu_e.unwrap_or(drawn.dsnu_e),
            hot: self.hot.unwrap_or(drawn.hot),
            row_noise_e: self.row_noise_e.unwrap_or(drawn.row_noise_e),
            wander_e: self.wander_e.unwrap_or(drawn.wander_e),
            ..drawn
        }
    }
}

impl Tolerances {
    /// What can be drawn is drawn; nothing else strays.
    pub const DRAWN: Self = Self {
        position_m: 0.0,
        angle_deg: 0.0,
        field: 0.0,
        contrast: None,
        glare: None,
        ghost: None,
        direct: None,
        drift: None,
        flicker: None,
        falloff: None,
        figure_rad: None,
        knee: None,
        crosstalk: None,
        lag: None,
        polarisation: None,
        seating_m: None,
        mirror_deg: None,
        blur_px: None,
        standard: 0.0,
        pixels: PixelTolerances::DRAWN,
    };

    /// Flaws of a rig that should be `nominal`, drawn from `rng`, those of its sensor from `seed`.
    pub(super) fn flaws(self, nominal: &Rig, seed: u64, rng: &mut Xoshiro256PlusPlus) -> Flaws {
        let (throughput, intensity) = (Field::drawn(self.field, rng), Field::drawn(self.field, rng));
        let drawn = log_uniform(CONTRASTS, rng);
        let drawn = nominal.projector.contrast.unwrap_or(drawn);
        let mut flaws = Flaws {
            throughput,
            intensity,
            black_level: self.contrast.unwrap_or(drawn).recip(),
            black: Field::drawn(BLACK_FIELD, rng),
            gamma: 2.2,
            nonlinearity: 0.01,
            interreflection: 0.005,
            standards: [0.0; 2],
            glare: Glare::drawn(rng),
            ghost: Ghost::drawn(rng),
            direct: Direct::drawn(rng),
            lamp: Lamp::default(),
            pixels: self.pixels.drawn(seed),
            pupils: Pupils::default(),
            figure: Figure::drawn(seed),
            knee: Knee::drawn(seed),
            crosstalk: Crosstalk::drawn(seed),
            seating: Seating::drawn(seed),
            focus: Focus::drawn(seed),
            lag: Lag::drawn(seed, nominal.projector.panel),
            polarisation: Polarisation::drawn(seed),
        };
        flaws.standards = std::array::from_fn(|_| {
            let normal: f64 = rng.sample(StandardNormal);
            self.standard * normal
        });
        flaws.glare.share = self.glare.unwrap_or(flaws.glare.share);
        flaws.ghost.share = self.ghost.unwrap_or(flaws.ghost.share);
        flaws.direct.share = self.direct.unwrap_or(flaws.direct.share);
        flaws.lamp = Lamp::drawn(rng);
        let sign = flaws.lamp.drift_per_h.signum();
        flaws.lamp.drift_per_h = self.drift.map_or(flaws.lamp.drift_per_h, |drift| sign * drift);
        flaws.lamp.flicker = self.flicker.unwrap_or(flaws.lamp.flicker);
        flaws.pupils = Pupils::drawn([nominal.camera.lens.pupil_m, nominal.projector.lens.pupil_m], rng);
        flaws.crosstalk.share = self.crosstalk.unwrap_or(flaws.crosstalk.share);
        flaws.knee.loss = self.knee.unwrap_or(flaws.knee.loss);
        if nominal.projector.panel == Panel::LiquidCrystal {
            flaws.lag.share = self.lag.unwrap_or(flaws.lag.share);
        }
        if let Some(degree) = self.polarisation {
            flaws.polarisation = flaws.polarisation.of_degree(degree);
        }
        flaws.seating.height_m = self.seating_m.unwrap_or(flaws.seating.height_m);
        flaws.seating.mirror_deg = self.mirror_deg.unwrap_or(flaws.seating.mirror_deg);
        flaws.focus.blur_px = self.blur_px.unwrap_or(flaws.focus.blur_px);
        flaws.figure.slope_rad = self.figure_rad.unwrap_or(flaws.figure.slope_rad);
        flaws.pupils.falloff = self.falloff.unwrap_or(flaws.pupils.falloff);
        flaws
    }
}
