//! The image of the aperture on the texels of a picture, for `layered`.
//!
//! A texel at d from the middle lies on the rim of the image of radius g(d) = |d| / ρ(angle of d).
//! Its share of an image of radius r is approximately the part of its width that lies inside: r·a −
//! g·a + ½ between 0 and 1, where a is the distance of the rim's straight parts from the middle
//! (the apothem; 1 for a circle). The table has g·a for each texel and, for each radius, the rim
//! (about r·a + ½) at which edges are as wide as the aperture's.

use std::f64::consts::{PI, TAU};

use crate::camera::{Aperture, Opening};
use crate::gpu::{Bytes, Gpu, constants};

/// Texels to each side. The same as in shaders/depth_of_field.wgsl.
const REACH: i32 = 13;
/// Number of radii in the table of rims, from 0 up to this one. The same as in
/// shaders/depth_of_field.wgsl.
const RIM_COUNT: usize = 64;
/// Radii in the table of rims per texel.
const RADII_PER_TEXEL: f64 = 4.0;
/// Radius up to which rims are found by counting texels, texels. Larger ones follow from the second
/// moment.
const MAX_COUNTED_RADIUS: f64 = 8.0;

/// The shape of an aperture, without its size and focus: key of its tables.
#[derive(Clone, Debug, PartialEq)]
pub struct Blades {
    blades: u32,
    rotation_rad: f64,
}

impl Blades {
    pub fn of(opening: &Opening) -> Self {
        Self { blades: opening.blades, rotation_rad: opening.rotation_rad }
    }

    /// An opening of this shape.
    pub fn opening(&self) -> Opening {
        let Self { blades, rotation_rad } = *self;
        Opening { diameter_m: 1.0, focus_distance_m: 1.0, blades, rotation_rad }
    }
}

/// The shader's `Aperture`.
pub fn buffer(gpu: &Gpu, blades: &Blades) -> Bytes {
    let opening = &blades.opening();
    let aperture = Aperture::of(opening);
    let rims = rims(&aperture);
    let floats: Vec<f32> = points(&aperture, &[4])
        .chain(points(&aperture, &[3, 9]))
        .chain(rims.windows(2).flatten().copied())
        .chain(places(&aperture).flatten())
        .flatten()
        .chain(shape(opening))
        .map(|v| v as f32)
        .collect();
    Bytes::from(&constants(gpu, "image of the opening", bytemuck::cast_slice(&floats)))
}

/// Angle between the middles of two sides (0 for a circle) and the angle of one of them, rad; the
/// apothem, in radii; the area, in squares of the apothem.
fn shape(opening: &Opening) -> [f64; 4] {
    if opening.blades == 0 {
        return [0.0, 0.0, 1.0, PI];
    }
    let side = TAU / f64::from(opening.blades);
    [side, opening.rotation_rad + 0.5 * side, (0.5 * side).cos(), PI / (0.5 * side) * (0.5 * side).tan()]
}

/// A few points with their centroid at the aperture's middle, so that nothing is shifted.
fn points(aperture: &Aperture, rings: &[u32]) -> impl Iterator<Item = [f64; 2]> {
    let points = aperture.rings(rings);
    let middle = [0, 1].map(|c| points.iter().map(|p| p[c]).sum::<f64>() / points.len() as f64);
    points.into_iter().map(move |p| [p[0] - middle[0], p[1] - middle[1]])
}

/// g·a of a texel.
fn place(aperture: &Aperture, x: f64, y: f64) -> f64 {
    aperture.apothem() * aperture.gauge([x, y])
}

fn square(reach: i32) -> impl Iterator<Item = (f64, f64)> {
    (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |x| (f64::from(x), f64::from(y))))
}

/// Light from a texel at d passed the aperture at −d if it is focused behind the picture, at d if
/// in front of it.
fn places(aperture: &Aperture) -> impl Iterator<Item = [[f64; 2]; 2]> {
    let both = |(x, y): (f64, f64)| [place(aperture, -x, -y), place(aperture, x, y)];
    square(REACH).map(move |(x, y)| [both((x, y)), both((x + 0.5, y + 0.5))])
}

/// The rim at each radius, and the distance of the outermost texels' centres from the middle.
fn rims(aperture: &Aperture) -> Vec<[f64; 2]> {
    let apothem = aperture.apothem();
    let counter = TexelCounter::new(aperture);
    (0..=RIM_COUNT)
        .map(|i| {
            let radius = i as f64 / RADII_PER_TEXEL;
            let rim = if radius < MAX_COUNTED_RADIUS {
                counter.rim(radius, apothem)
            } else {
                // A soft rim of half a texel adds 1/8 to a circle's second moment and removes 1/48.
                (radius * radius - 0.104 / aperture.variance()).sqrt() * apothem + 0.5
            };
            [rim, rim / apothem]
        })
        .collect()
}

/// Finds rims by the share of each texel.
struct TexelCounter {
    reach: i32,
    /// Row by row.
    places: Vec<f64>,
    /// Points spread evenly over the opening, x and y, in radii.
    points: Vec<[f64; 2]>,
}

impl TexelCounter {
    fn new(aperture: &Aperture) -> Self {
        let reach = MAX_COUNTED_RADIUS as i32 + 3;
        let places = square(reach).map(|(x, y)| place(aperture, x, y)).collect();
        Self { reach, places, points: (0..2000).map(|i| aperture.sequence(i)).collect() }
    }

    /// The rim whose edges are as wide as those of an aperture of this radius, by bisection.
    fn rim(&self, radius: f64, apothem: f64) -> f64 {
        let target_width: f64 =
            [0, 1].map(|axis| width(self.points.iter().map(|p| (radius * p[axis], 1.0)))).iter().sum();
        // Large enough that the four texels around a point have a share.
        let (mut low, mut high) = (apothem.max(0.75), (radius + 1.5) * apothem + 0.5);
        for _ in 0..24 {
            let middle = 0.5 * (low + high);
            (low, high) = if self.widths(middle) > target_width { (low, middle) } else { (middle, high) };
        }
        low
    }

    /// Sum of the widths of edges along both axes.
    fn widths(&self, rim: f64) -> f64 {
        let columns = 2 * self.reach + 1;
        let mut sums = [vec![0.0; columns as usize], vec![0.0; columns as usize]];
        for (place, (x, y)) in self.places.iter().zip(square(self.reach)) {
            let share = (rim - place).clamp(0.0, 1.0);
            for (sums, at) in sums.iter_mut().zip([x, y]) {
                sums[(at as i32 + self.reach) as usize] += share;
            }
        }
        sums.iter().map(|sums| width((0..).zip(sums).map(|(i, s)| (f64::from(i - self.reach), *s)))).sum()
    }
}

/// The 10-90 % width, in pixels, of an edge blurred by light at these places with these weights,
/// averaged over positions of the edge between pixels.
fn width(light: impl Iterator<Item = (f64, f64)>) -> f64 {
    const PLACES: usize = 5;
    let light: Vec<_> = light.filter(|(_, weight)| *weight > 0.0).collect();
    let all: f64 = light.iter().map(|(_, weight)| weight).sum();
    let reach = MAX_COUNTED_RADIUS as i32 + 4;
    let width_at = |edge: f64| {
        let profile: Vec<f64> = (-reach..=reach)
            .map(|x| {
                let share = |(at, weight): &(f64, f64)| weight * (f64::from(x) + 0.5 - edge - at).clamp(0.0, 1.0);
                light.iter().map(share).sum::<f64>() / all
            })
            .collect();
        crossing(&profile, 0.9) - crossing(&profile, 0.1)
    };
    (0..PLACES).map(|k| width_at(k as f64 / PLACES as f64)).sum::<f64>() / PLACES as f64
}

/// Position at which a rising profile crosses a level.
fn crossing(profile: &[f64], level: f64) -> f64 {
    let after = profile.iter().position(|v| *v > level).unwrap_or(profile.len() - 1).max(1);
    let (a, b) = (profile[after - 1], profile[after]);
    after as f64 - if b > a { (b - level) / (b - a) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::constant;

    #[test]
    fn table_sizes_equal_the_shaders() {
        let shader = include_str!("../../../shaders/depth_of_field.wgsl");
        let holds = |name| constant(shader, name) as usize;
        let columns = 2 * REACH as usize + 1;
        assert_eq!(
            ["RIM_COUNT", "REACH", "COLUMNS", "PLACES"].map(holds),
            [RIM_COUNT, REACH as usize, columns, columns * columns]
        );
    }
}
