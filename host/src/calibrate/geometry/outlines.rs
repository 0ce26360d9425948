//! Polygons of directions around pixels of an image: obstacles of the calibrated rig.

use glam::DVec2;

use crate::instrument::frame_format::pixel_centre;
use crate::instrument::optics::{Outline, View, WIDEST_DEG};
use crate::instrument::parts::Obstacle;

/// The pixels of an image of so many with `width` columns that touch `pixel`, and itself.
pub(super) fn around(pixel: usize, width: usize, pixels: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (pixel % width, pixel / width);
    let (right, bottom) = ((x + 1).min(width - 1), (y + 1).min(pixels / width - 1));
    (y.saturating_sub(1)..=bottom)
        .flat_map(move |y| (x.saturating_sub(1)..=right).map(move |x| y * width + x))
}

/// The pixels that are set, by what belongs together, corners included.
pub(super) fn connected(is_set: &[bool], width: usize) -> Vec<Vec<usize>> {
    let mut is_taken = vec![false; is_set.len()];
    let mut components = Vec::new();
    for pixel in 0..is_set.len() {
        if is_taken[pixel] || !is_set[pixel] {
            continue;
        }
        let (mut component, mut open) = (Vec::new(), vec![pixel]);
        is_taken[pixel] = true;
        while let Some(at) = open.pop() {
            component.push(at);
            for beside in around(at, width, is_set.len()) {
                if is_set[beside] && !is_taken[beside] {
                    is_taken[beside] = true;
                    open.push(beside);
                }
            }
        }
        components.push(component);
    }
    components
}

/// Obstacles with this `name` around pixels of an image `width` wide that the `camera` took, each list of which belongs together.
pub(super) fn outlines(name: &str, components: &[Vec<usize>], width: usize, camera: &View) -> Vec<Obstacle> {
    let obstacle = |number: usize, hull: &[DVec2]| Obstacle {
        name: format!("{name} {}", number + 1),
        outline_deg: hull
            .iter()
            .filter_map(|at| camera.from_f1(at.x, at.y))
            .map(|w| [w.z.clamp(-1.0, 1.0).acos(), w.y.atan2(w.x)].map(f64::to_degrees))
            .collect(),
    };
    let is_narrow =
        |hull: &[DVec2]| Outline::of(&obstacle(0, hull)).reach_rad() < WIDEST_DEG.to_radians() / 2.0;
    let mut all = Vec::new();
    for (number, component) in components.iter().enumerate() {
        let pixels: Vec<DVec2> = component
            .iter()
            .map(|pixel| pixel_centre(*pixel, width))
            .collect();
        let outlines = hulls(pixels, &is_narrow);
        let outlines = outlines.iter().map(|hull| obstacle(number, hull));
        all.extend(outlines.filter(|outline| outline.outline_deg.len() >= 3));
    }
    all
}

/// Convex polygons around `pixels`, each with a pixel to spare, none of which is mostly empty, or wide where there is more than a few.
fn hulls(mut pixels: Vec<DVec2>, is_narrow: &dyn Fn(&[DVec2]) -> bool) -> Vec<Vec<DVec2>> {
    // A pixel reaches half a pixel from its centre.
    const REACH_PX: f64 = 1.5;
    let corners = [
        DVec2::new(-1.0, -1.0),
        DVec2::new(1.0, -1.0),
        DVec2::ONE,
        DVec2::new(-1.0, 1.0),
    ];
    let hull = convex(
        pixels
            .iter()
            .flat_map(|at| corners.map(|corner| *at + REACH_PX * corner))
            .collect(),
    );
    let (low, high) = (
        pixels.iter().copied().reduce(DVec2::min).unwrap_or_default(),
        pixels.iter().copied().reduce(DVec2::max).unwrap_or_default(),
    );
    let size = high - low + 2.0 * REACH_PX;
    // What a straight strip of so many pixels needs.
    let needed = pixels.len() as f64 + 2.0 * (size.x + size.y) * REACH_PX;
    if area(&hull) <= 1.5 * needed && is_narrow(&hull) || pixels.len() < 4 {
        return vec![hull];
    }
    let across = if size.x > size.y { DVec2::X } else { DVec2::Y };
    pixels.sort_by(|a, b| a.dot(across).total_cmp(&b.dot(across)));
    let second = pixels.split_off(pixels.len() / 2);
    let mut all = hulls(pixels, is_narrow);
    all.extend(hulls(second, is_narrow));
    all
}

/// The convex hull of `points`, counterclockwise where y points up (A. M. Andrew, *Another efficient algorithm for convex hulls in two
/// dimensions*, 1979).
fn convex(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let chain = |points: &mut dyn Iterator<Item = &DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..] {
                if (b - a).perp_dot(*point - a) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(*point);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut points.iter());
    hull.extend(chain(&mut points.iter().rev()));
    hull
}

fn area(polygon: &[DVec2]) -> f64 {
    let sides = polygon.iter().zip(polygon.iter().cycle().skip(1));
    sides.map(|(a, b)| a.perp_dot(*b)).sum::<f64>().abs() / 2.0
}
