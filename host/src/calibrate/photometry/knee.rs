//! Up to where the camera is linear.
//!
//! # Design
//! Near the full well the response bends by a law of its own, of which one number over the whole range says nothing. Each
//! pixel of a frame of the series is compared with what it showed in shorter ones: bright pixels with dimmer ones of the
//! same frame, and of the same band where these are lit one after the other, so that no lamp counts. Pixels are put into classes by what they should show, not by what they do: noise would bend the
//! line. The camera is linear up to the first class that deviates; where the series is not bright enough it is taken to be so up
//! to [`ASSUMED`], from which on data sheets by EMVA 1288 let it bend, and numbers above count as saturated.

use super::camera::{Times, moments};

/// Share of the range up to which a camera is taken to be linear if nothing shows it.
const ASSUMED: f64 = 0.88;
/// No larger share is trusted, however linear: pixels behind a number differ.
const MOST: f64 = 0.97;
/// Classes begin at this share of the range and are this wide.
const FIRST: f64 = 0.73;
const WIDTH: f64 = 0.03;
/// Pixels of these shares are what bright ones are compared with.
const DIM: std::ops::Range<f64> = 0.25..0.7;
/// Frames that are this much shorter tell what a pixel should show.
const SHORTER: f64 = 0.6;
/// Fewest pixels of a class, and of what it is compared with.
const FEWEST: usize = 20;
/// Deviation that counts, relative, if it is more than this many standard errors.
const BENT: f64 = 1.5e-3;
const CLEAR: f64 = 4.0;

/// Share of the range above the dark level up to which the camera is linear once `linear` has corrected signals above it.
/// `dark` is the level without light and its slope over time.
pub(super) fn linear_to(
    series: &[Times],
    (dark_dn, dark_dn_per_s): (f64, f64),
    range: f64,
    linear: impl Fn(f64) -> f64,
) -> f64 {
    let bands = series[0].lamp.len();
    let signals: Vec<(f64, Vec<f64>)> = series
        .iter()
        .map(|times| {
            let light = |(at, dn): (usize, f64)| {
                let lamp = times.beside_the_first(at % bands);
                (linear(dn - dark_dn) - dark_dn_per_s * times.exposure_s) / lamp
            };
            let (mean, _) = moments(&times.lit);
            (
                times.exposure_s * times.lamp[0],
                mean.into_iter().enumerate().map(light).collect(),
            )
        })
        .collect();
    let classes = ((1.0 - FIRST) / WIDTH).ceil() as usize;
    // Relative deviations of all frames, by class.
    let mut deviations: Vec<Vec<f64>> = vec![Vec::new(); classes];
    for ((time, shown), band) in signals
        .iter()
        .flat_map(|of_time| (0..bands).map(move |band| (of_time, band)))
    {
        let shorter = || signals.iter().filter(|(other, _)| *other < SHORTER * time);
        let squares: f64 = shorter().map(|(other, _)| other * other).sum();
        if squares <= 0.0 {
            continue;
        }
        // What each pixel should show, and by how much it shows more.
        let of_band = shown.iter().enumerate().skip(band).step_by(bands);
        let pixels = of_band.filter_map(|(pixel, shown)| {
            let rate = shorter().map(|(other, all)| other * all[pixel]).sum::<f64>() / squares;
            let expected = rate * time;
            (expected > DIM.start * range).then(|| (expected / range, shown / expected - 1.0))
        });
        let (dim, bright): (Vec<_>, Vec<_>) = pixels.partition(|(fill, _)| *fill < DIM.end);
        if dim.len() < FEWEST {
            continue;
        }
        let usual = dim.iter().map(|(_, more)| more).sum::<f64>() / dim.len() as f64;
        for (fill, more) in bright.iter().filter(|(fill, _)| (FIRST..1.0).contains(fill)) {
            let class = ((fill - FIRST) / WIDTH) as usize;
            deviations[class.min(classes - 1)].push(more - usual);
        }
    }
    let mut trusted = ASSUMED;
    for (class, all) in deviations.iter().enumerate() {
        let from = FIRST + class as f64 * WIDTH;
        if all.len() < FEWEST {
            if from + WIDTH > ASSUMED {
                break;
            }
            continue;
        }
        let count = all.len() as f64;
        let mean = all.iter().sum::<f64>() / count;
        let variance = all.iter().map(|one| (one - mean).powi(2)).sum::<f64>() / (count - 1.0);
        if mean.abs() > BENT.max(CLEAR * (variance / count).sqrt()) {
            return trusted.min(from);
        }
        trusted = trusted.max((from + WIDTH).min(MOST));
    }
    trusted
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    const RANGE: f64 = 4000.0;

    /// What is found of a camera that shows the share `shown` of a signal by its share of the range, of pixels whose brightest
    /// come to the share `brightest`, under a lamp that flickers.
    fn found(brightest: f64, shown: impl Fn(f64) -> f64) -> f64 {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(8);
        let mut normal = || -> f64 { rng.sample(StandardNormal) };
        let frames: Vec<(f64, Vec<Vec<u16>>)> = (0..8)
            .map(|step| {
                let time = 0.5_f64.powi(7 - step);
                let one = |lamp: f64, normal: &mut dyn FnMut() -> f64| {
                    (0..4000)
                        .map(|pixel| {
                            let fill = brightest * time * lamp * (0.4 + 0.6 * f64::from(pixel) / 4000.0);
                            let signal = RANGE * fill * shown(fill);
                            (64.0 + signal + (1.0 + 0.02 * signal).sqrt() * normal()).round() as u16
                        })
                        .collect::<Vec<u16>>()
                };
                let all = (0..4)
                    .map(|_| {
                        let lamp = 1.0 + 0.004 * normal();
                        one(lamp, &mut normal)
                    })
                    .collect();
                (time, all)
            })
            .collect();
        let series: Vec<Times> = frames
            .iter()
            .map(|(time, lit)| Times {
                exposure_s: *time,
                lit: lit.iter().map(Vec::as_slice).collect(),
                black: Vec::new(),
                dark: Vec::new(),
                lamp: vec![1.0],
            })
            .collect();
        linear_to(&series, (64.0, 0.0), RANGE, |signal| signal)
    }

    #[test]
    fn a_bend_ends_what_is_trusted_and_a_flickering_lamp_is_none() {
        let bent = |from: f64, loss: f64| {
            move |fill: f64| 1.0 - loss * ((fill - from).max(0.0) / (1.0 - from)).powi(2)
        };
        // A series that goes all the way sees that there is none, or where it is.
        let straight = found(0.99, |_| 1.0);
        assert!(straight > 0.95, "{straight}");
        for (from, loss) in [(0.89, 0.03), (0.92, 0.03), (0.85, 0.01)] {
            let to = found(0.99, bent(from, loss));
            // What deviates by less than is told may be a little above.
            let lost = 1.0 - bent(from, loss)(to);
            assert!(to < 0.96 && lost < 2.0 * BENT, "{from} {loss}: {to}");
        }
        // One that does not cannot say, and a camera that bends early is believed.
        assert!((found(0.8, |_| 1.0) - ASSUMED).abs() < 1e-9);
        let early = found(0.87, bent(0.7, 0.05));
        assert!((0.72..0.85).contains(&early), "{early}");
    }
}
