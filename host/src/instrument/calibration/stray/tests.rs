use super::*;

fn found(halo: [f64; WIDTHS.len()], ghost: Option<GhostFound>) -> Stray {
    Stray {
        halo: vec![halo.into()],
        halo_uncertainty: 0.05,
        ghost,
        direct: vec![vec![0.0; CAMERA_TERMS * PROJECTOR_TERMS]],
        direct_uncertainty: 0.0,
    }
}

/// Pixels of the left quarter of an image of this size, which are dark.
fn left_quarter(size: usize) -> Vec<u32> {
    let all = 0..(size * size) as u32;
    all.filter(|pixel| *pixel as usize % size < size / 4).collect()
}

#[test]
fn a_halo_is_the_sum_of_its_gaussians() {
    let size = 64;
    for (place, width) in WIDTHS.into_iter().enumerate() {
        let halo = Halo::new(size, size);
        let mut image = vec![Vec4::ZERO; size * size];
        image[20 * size + 30] = Vec4::splat(1000.0);
        let mut out = vec![Vec4::ZERO; size * size];
        halo.add(place, &image, Vec4::ONE, &mut out, &mut halo::Room::default());
        let sigma_px = width * 32.0;
        let gauss = |x: f64, y: f64| {
            let scale = 1000.0 / (std::f64::consts::TAU * sigma_px * sigma_px);
            scale * (-(x * x + y * y) / (2.0 * sigma_px * sigma_px)).exp()
        };
        let peak = gauss(0.0, 0.0);
        for (pixel, found) in out.iter().enumerate() {
            let (x, y) = ((pixel % size) as f64 - 30.0, (pixel / size) as f64 - 20.0);
            // Below two pixels it is averaged over them.
            let tolerance = if sigma_px < 2.0 { 0.3 } else { 0.04 };
            let off = (f64::from(found.x) - gauss(x, y)).abs() / peak;
            assert!(off < tolerance, "{width}: {x} {y}: {off}");
        }
        let sum: f64 = out.iter().map(|found| f64::from(found.x)).sum();
        assert!(width > 0.1 || (sum / 1000.0 - 1.0).abs() < 0.02, "{width}: {sum}");
    }
}

#[test]
fn an_image_loses_what_was_added() {
    let size = 48;
    let ghost = GhostFound {
        share: vec![0.03],
        standard_uncertainty: 0.001,
        shift: [0.13, -0.21],
    };
    let mut found = found([0.002, 0.001, 0.001, 0.001, 0.002, 0.001, 0.003], Some(ghost));
    found.direct[0][0] = 2e-3;
    let removal = Removal::new(&found, (&LampFound::default(), 0), (size, size), Vec::new());
    let truth: Vec<Vec4> = (0..size * size)
        .map(|pixel| {
            let (x, y) = ((pixel % size) as f32 - 20.0, (pixel / size) as f32 - 25.0);
            Vec4::splat(5000.0 * (-(x * x + y * y) / 20.0).exp() + 100.0)
        })
        .collect();
    let (mut spread, mut room) = (Vec::new(), Room::default());
    removal.spread(&truth, &mut spread, &mut room.halo);
    let mut lit = [0.0; PROJECTOR_TERMS];
    lit[0] = 500.0;
    let shown: Vec<Vec4> = truth
        .iter()
        .zip(&spread)
        .map(|(s, a)| *s + *a + Vec4::splat(500.0 * 2e-3 * 0.1))
        .collect();
    removal.find(&shown, &lit, 0.1, 65535.0, &mut room);
    for ((truth, shown), stray) in truth.iter().zip(&shown).zip(&room.stray) {
        let left = (shown - stray - truth).x;
        assert!(left.abs() < 0.2, "{left} of {}", truth.x);
    }
    // The ghost stands out by some 150.
    assert!(room.doubt.iter().all(|doubt| doubt.x < 60.0));
}

#[test]
fn light_beyond_saturation_is_told_by_what_is_dark() {
    let size = 48;
    let found = found([0.0, 0.0, 0.0, 0.002, 0.0, 0.0, 0.004], None);
    let dark = left_quarter(size);
    let removal = Removal::new(&found, (&LampFound::default(), 0), (size, size), dark);
    let background = |pixel: usize| if pixel % size < 12 { 0.0 } else { 200.0 };
    let mut truth: Vec<Vec4> = (0..size * size)
        .map(|pixel| Vec4::splat(background(pixel)))
        .collect();
    let lobe = [24 * size + 30, 24 * size + 31, 25 * size + 30];
    for pixel in lobe {
        truth[pixel] = Vec4::splat(400_000.0);
    }
    let (mut spread, mut room) = (Vec::new(), Room::default());
    removal.spread(&truth, &mut spread, &mut room.halo);
    let shown: Vec<Vec4> = truth
        .iter()
        .zip(&spread)
        .map(|(s, a)| {
            let all = *s + *a;
            Vec4::select(all.cmpge(Vec4::splat(65_000.0)), Vec4::NAN, all)
        })
        .collect();
    removal.find(&shown, &[0.0; PROJECTOR_TERMS], 0.1, 65_000.0, &mut room);
    for pixel in (0..size * size).filter(|pixel| !lobe.contains(pixel)) {
        let left = (shown[pixel] - room.stray[pixel] - truth[pixel]).x;
        let doubt = room.doubt[pixel].x;
        assert!(
            left.abs() < 0.5 + 2.0 * doubt && doubt < 3.0,
            "{pixel}: {left} ± {doubt}, {}",
            spread[pixel].x
        );
    }
    // Without what is dark nobody knows.
    let blind = Removal::new(&found, (&LampFound::default(), 0), (size, size), Vec::new());
    blind.find(&shown, &[0.0; PROJECTOR_TERMS], 0.1, 65_000.0, &mut room);
    assert!(room.doubt[0].x.is_infinite());
}

#[test]
fn one_saturated_pixel_makes_no_image_worthless() {
    let size = 48;
    // So little that dark pixels hardly see it.
    let found = found([0.0, 0.0, 0.0, 2e-4, 0.0, 0.0, 1e-4], None);
    let removal = Removal::new(
        &found,
        (&LampFound::default(), 0),
        (size, size),
        left_quarter(size),
    );
    let mut shown = vec![Vec4::splat(200.0); size * size];
    for pixel in left_quarter(size) {
        // Noise of a digital number.
        shown[pixel as usize] = Vec4::splat(if pixel % 2 == 0 { 1.0 } else { -1.0 });
    }
    shown[24 * size + 30] = Vec4::NAN;
    let mut room = Room::default();
    removal.find(&shown, &[0.0; PROJECTOR_TERMS], 0.1, 65_000.0, &mut room);
    for (pixel, doubt) in room.doubt.iter().enumerate() {
        assert!(doubt.x < 20.0, "{pixel}: {}", doubt.x);
    }
}

/// Pixels a side of the images of a sample whose lamp is watched, and their exposure time, seconds.
const SIZE: usize = 48;
const EXPOSURE_S: f64 = 0.1;
/// What flickers in them.
const FLICKER: f32 = 0.005;
/// Frames whose means flicker as much apart.
const COUNTS: [usize; 2] = [2, 2];

/// A sample beside pixels that are dark, and watch the lamp.
struct Watched {
    found: Stray,
    removal: Removal,
    /// Direct light: four parts of what watches the lamp, a fifth of one of black pixels.
    direct: Vec<Vec4>,
}

impl Watched {
    fn new() -> Self {
        let found = found([0.0, 0.0, 0.001, 0.001, 0.0, 0.001, 0.003], None);
        let mut light = vec![0.0; super::super::lamp::WATCH_TERMS];
        (light[0], light[1], light[2]) = (5000.0, 1200.0, -900.0);
        let lamp = LampFound {
            flicker: f64::from(FLICKER),
            monitor: Some(super::super::lamp::Monitor {
                side: 4,
                light: vec![light],
                standard_uncertainty: 3e-4,
            }),
        };
        let direct = |pixel: usize| {
            let [x, y] = crate::instrument::frame_format::place_of_pixel(pixel, SIZE, SIZE);
            Vec4::new((420.0 * (5.0 + 1.2 * y - 0.9 * x)) as f32, 0.0, 0.0, 0.0)
        };
        Self {
            // Lit twice as wide as in the calibration: four times the light.
            removal: Removal::new(&found, (&lamp, 8), (SIZE, SIZE), left_quarter(SIZE)),
            direct: (0..SIZE * SIZE).map(direct).collect(),
            found,
        }
    }

    fn is_on_sample(pixel: usize) -> bool {
        pixel % SIZE >= 16
    }

    /// A frame with a spot, with so bright a lamp.
    fn shown(&self, lamp: f32, spot: f32) -> Vec<Vec4> {
        let of = |pixel: usize| {
            let (x, y) = ((pixel % SIZE) as f32 - 30.0, (pixel / SIZE) as f32 - 20.0);
            let lobe = spot * (-(x * x + y * y) / 8.0).exp();
            let light = if Self::is_on_sample(pixel) {
                8000.0 + lobe
            } else {
                0.0
            };
            Vec4::new(light, 0.0, 0.0, 0.0)
        };
        let image: Vec<Vec4> = (0..SIZE * SIZE).map(of).collect();
        let (mut spread, mut room) = (Vec::new(), Room::default());
        self.removal.spread(&image, &mut spread, &mut room.halo);
        let all = image.iter().zip(&spread).zip(&self.direct);
        all.map(|((s, a), d)| (*s + *a + *d) * lamp).collect()
    }

    /// Of that what watches the lamp.
    fn of_watching(&self, lamp: f32) -> Vec<Vec4> {
        let of = |direct: &Vec4| *direct * (lamp * 4.0 / 4.2);
        self.direct.iter().map(of).collect()
    }

    /// And all others, with nothing lit.
    fn of_others(&self) -> Vec<Vec4> {
        let all = self.shown(1.0, 0.0).into_iter().zip(self.of_watching(1.0));
        all.map(|(all, own)| all - own).collect()
    }
}

#[test]
fn the_lamp_of_a_frame_is_told_by_what_is_dark_beside_stray_light() {
    let watched = Watched::new();
    let removal = &watched.removal;
    let black = watched.shown(1.0, 0.0);
    let mut room = Room::default();
    for (light, spot) in [(1.0_f32, 20_000.0), (1.008, 20_000.0), (0.992, 500_000.0)] {
        let frame: Vec<Vec4> = watched
            .shown(light, spot)
            .into_iter()
            .zip(&black)
            .map(|(lit, black)| {
                let is_full = lit.cmpge(Vec4::splat(60_000.0));
                Vec4::select(is_full, Vec4::NAN, lit - *black)
            })
            .collect();
        removal.find(&frame, &[0.0; PROJECTOR_TERMS], EXPOSURE_S, 60_000.0, &mut room);
        let told = removal.told(
            |pixel| frame[pixel] - room.stray[pixel],
            |pixel| black[pixel],
            |pixel| room.doubt[pixel],
        );
        let level = removal.level(told, Default::default());
        let (found, uncertainty) = (level.light[0], level.uncertainty[0]);
        assert!(
            (found - light).abs() < 1e-4 + 3.0 * uncertainty && uncertainty < 1.5e-3,
            "{light} {spot}: {level:?}"
        );
    }
    // Where nothing watches it is near 1, and nobody says more.
    let blind = Removal::new(
        &watched.found,
        (&LampFound::default(), 0),
        (SIZE, SIZE),
        Vec::new(),
    );
    let told = blind.told(|_| Vec4::NAN, |_| Vec4::ZERO, |_| Vec4::ZERO);
    let level = blind.level(told, Default::default());
    assert!(
        (level.light[0] - 1.0).abs() < 1e-9 && (level.uncertainty[0] - 3e-3).abs() < 1e-6,
        "{level:?}"
    );
}

#[test]
fn bands_that_are_lit_in_turn_have_lamps_of_their_own() {
    const LAMPS: [f32; 3] = [1.004, 0.996, 1.0];
    let watched = Watched::new();
    let mut removal = Watched::new().removal;
    for weight in &mut removal.weights {
        *weight = Vec4::new(weight.x, weight.x, weight.x, 0.0);
    }
    let black = watched.shown(1.0, 0.0);
    let told = |removal: &Removal| {
        let told = removal.told(
            |pixel| black[pixel].x * Vec4::new(LAMPS[0] - 1.0, LAMPS[1] - 1.0, LAMPS[2] - 1.0, 0.0),
            |pixel| black[pixel].x * Vec4::new(1.0, 1.0, 1.0, 0.0),
            |_| Vec4::ZERO,
        );
        removal.level(told, Default::default())
    };
    let together = told(&removal);
    removal.bands = 3;
    let in_turn = told(&removal);
    for (lane, lamp) in LAMPS.into_iter().enumerate() {
        assert!((together.light[lane] - 1.0).abs() < 1e-4, "{together:?}");
        assert!((in_turn.light[lane] - lamp).abs() < 1e-4, "{in_turn:?}");
    }
}

#[test]
fn the_lamp_of_black_frames_is_told_by_what_watches_it_however_black_light_flickers() {
    let watched = Watched::new();
    let others = watched.of_others();
    let level = |watching: &[Vec4], others: &[Vec4]| {
        let compared = watched
            .removal
            .level_of_watching(watching, others, COUNTS, EXPOSURE_S);
        compared.unwrap()
    };
    for (light, brighter) in [(1.0_f32, 0.0_f32), (0.95, 0.004), (1.2, -0.004)] {
        let own = watched.of_watching(light).into_iter().zip(&others);
        let watching: Vec<Vec4> = own.map(|(own, other)| own + *other * brighter).collect();
        let level = level(&watching, &others);
        assert!((level.light - light).abs() < 1e-3 * light, "{light}: {level:?}");
        assert!(level.uncertainty < 1e-3, "{light}: {level:?}");
    }
    // Black light that shines as smoothly passes for it.
    let smooth = watched.of_watching(0.05);
    let own = watched.of_watching(1.0).into_iter().zip(&smooth);
    let watching: Vec<Vec4> = own.map(|(own, other)| own + *other * FLICKER).collect();
    let level = level(&watching, &smooth);
    assert!((level.light - 1.0).abs() < 3.0 * level.uncertainty, "{level:?}");
    assert!(level.uncertainty < 0.1 * FLICKER, "{level:?}");
    let blind = Removal::new(
        &watched.found,
        (&LampFound::default(), 0),
        (SIZE, SIZE),
        Vec::new(),
    );
    assert_eq!(
        blind.level_of_watching(&watching, &others, COUNTS, EXPOSURE_S),
        None
    );
}
