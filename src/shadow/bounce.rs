//! Light that things throw back onto the floor on which they stand.
//!
//! A matt surface is as bright as a white one in its place, times its reflectance ρ. A white matt place on the floor shows the
//! mean of what it sees, over directions that are spread by the cosine. So each of K such directions that meets a thing brings
//! ρ·E(n)/K, where E(n) is what a white matt surface of the thing's normal n would show:
//!
//! - of far light, Σ light·max(n·(slope, 1), 0), since a ray's light on the floor has the cosine to the floor's normal in it
//!   and (slope, 1) is its direction divided by that cosine; of lamps by their distance;
//! - of the floor, which fills the lower share (1 − n_z)/2 of the view: the floor's light times a middle reflectance, less what
//!   the thing itself takes from it before the surface.
//!
//! A facet is finite. Distant light and lamps behind it reach a surface past its rectangle ([`ReceiverMask::hides`]), and it covers
//! less of the surface's view behind the plane accordingly.
//!
//! Not modelled: what things take of each other's light; the floor's own colour; light that is thrown to and fro more often;
//! mirrors.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::mask::{jitter, spans};
use super::occluders::Occluders;
use super::receiver_mask::ReceiverMask;
use super::sky::{Behind, EnvSample, Sky, disc};
use super::spread::spread;
use crate::parallel::{over_rows, processors};

/// Directions in which the floor looks.
const DIRECTIONS: usize = 64;
/// Texels of a shadow map for each of the light that comes back: it changes slowly.
const COARSER: u32 = 3;
/// What floors throw back: of concrete, wood and carpets 0.1 to 0.6.
const FLOOR: f32 = 0.35;
/// Nothing is hit.
const NONE: u32 = u32::MAX;

/// A piece of floor, as a shadow map shows it.
pub struct Ground<'a> {
    pub low_m: Vec2,
    pub texel_m: f32,
    pub width: u32,
    pub height: u32,
    /// The share of the light that the same things take at a place.
    pub taken: &'a (dyn Fn(Vec2) -> Vec3 + Sync),
    /// Whether things stand over each texel, row by row; empty if nobody knows.
    pub stands_on: &'a [bool],
    /// How high they are over it at least, texels.
    pub over: f32,
}

/// Light that comes back onto a shadow map's floor, as a white matt surface shows it; coarser than the shadow map.
#[derive(Debug)]
pub struct Bounce {
    width: usize,
    height: usize,
    light: Vec<Vec3>,
}

impl Bounce {
    pub fn new(ground: &Ground<'_>, occluders: &Occluders, sky: &Sky, within: Option<&ReceiverMask>) -> Self {
        let [width, height] = [ground.width, ground.height].map(|side| side.div_ceil(COARSER) as usize);
        let faces: Vec<Face> = (0..occluders.triangles.len()).map(|n| Face::of(occluders, n, sky, within)).collect();
        let mut light = vec![Vec3::ZERO; width * height];
        let rows = height.div_ceil(processors()).max(1);
        over_rows(&mut light, width * rows, processors(), |band, light| {
            let first = band * rows;
            let lit = Lit { ground, occluders, sky, faces: &faces, width };
            lit.fill(light, first..first + light.len() / width);
        });
        // Each direction stands for a patch: of a disc of radius 1 the share of one.
        let over = ground.over / COARSER as f32;
        spread(&mut light, width, &ground.stands_on_coarse(width, height), over, (DIRECTIONS as f32).sqrt().recip());
        Self { width, height, light }
    }

    /// At a texel of the shadow map.
    pub fn at(&self, x: usize, y: usize) -> Vec3 {
        let place = |at: usize| ((at as f32 + 0.5) / COARSER as f32 - 0.5).max(0.0);
        let (across, down) = (place(x), place(y));
        let (left, above) = (across as usize, down as usize);
        let texel = |x: usize, y: usize| self.light[y.min(self.height - 1) * self.width + x.min(self.width - 1)];
        let row = |y: usize| texel(left, y).lerp(texel(left + 1, y), across - left as f32);
        row(above).lerp(row(above + 1), down - above as f32)
    }
}

impl Ground<'_> {
    fn stands_on_coarse(&self, width: usize, height: usize) -> Vec<bool> {
        let mut coarse = vec![false; width * height];
        for (y, row) in self.stands_on.chunks(self.width.max(1) as usize).enumerate() {
            for (x, _) in row.iter().enumerate().filter(|(_, stands)| **stands) {
                coarse[y / COARSER as usize * width + x / COARSER as usize] = true;
            }
        }
        coarse
    }
}

/// A triangle's normal, what a white matt surface there shows of far light, and the share of what is below the plane that the floor
/// fills: all of it, but for a facet's, past which light comes too.
#[derive(Clone, Copy, Debug)]
struct Face {
    normal: Vec3,
    far: Vec3,
    filled: f32,
}

impl Face {
    fn of(occluders: &Occluders, triangle: usize, sky: &Sky, within: Option<&ReceiverMask>) -> Self {
        let [a, b, c] = occluders.triangles[triangle].map(|i| occluders.corners[i as usize]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let far = sky.rays.iter().map(|ray| ray.light * normal.dot(ray.slope.extend(1.0)).max(0.0)).sum();
        let own = Self { normal, far, filled: 1.0 };
        match (&sky.behind, within) {
            (Some(behind), Some(within)) => own.beside(behind, within, (a + b + c) / 3.0),
            _ => own,
        }
    }

    /// With light from behind a facet that goes past it.
    fn beside(self, behind: &Behind, within: &ReceiverMask, from: Vec3) -> Self {
        let (mut seen, mut filled, mut far) = (0.0, 0.0, self.far);
        for EnvSample { towards, light, solid_sr } in behind.far.iter().copied() {
            let cosine = self.normal.dot(towards).max(0.0);
            let is_hidden = within.hides(from, towards);
            seen += cosine * solid_sr;
            filled += if is_hidden { cosine * solid_sr } else { 0.0 };
            far += if is_hidden { Vec3::ZERO } else { light * cosine };
        }
        let lamps = behind.lamps.iter().filter(|lamp| !within.hides(from, lamp.at_m - from));
        far += lamps.map(|lamp| lamp.light_on(from, self.normal)).sum::<Vec3>();
        Self { far, filled: if seen > 0.0 { filled / seen } else { 1.0 }, ..self }
    }
}

/// What is looked at from the floor.
struct Lit<'a> {
    ground: &'a Ground<'a>,
    occluders: &'a Occluders,
    sky: &'a Sky,
    faces: &'a [Face],
    width: usize,
}

impl Lit<'_> {
    fn fill(&self, light: &mut [Vec3], rows: Range<usize>) {
        let side_m = self.ground.texel_m * COARSER as f32;
        let (mut nearest, mut places) = (vec![(f32::INFINITY, NONE); light.len()], Vec::new());
        for (n, at) in disc(DIRECTIONS).enumerate() {
            let slope = at / (1.0 - at.length_squared()).max(1e-6).sqrt();
            let jitter = jitter(n);
            nearest.fill((f32::INFINITY, NONE));
            places.clear();
            let corners = self.occluders.corners.iter();
            places.extend(corners.map(|c| (c.truncate() - slope * c.z - self.ground.low_m) / side_m + jitter));
            for (triangle, corners) in (0..).zip(&self.occluders.triangles) {
                self.nearer(&mut nearest, &rows, &places, triangle, corners);
            }
            for (i, (height_m, triangle)) in nearest.iter().enumerate().filter(|(_, (_, n))| *n != NONE) {
                let texel = Vec2::new((i % self.width) as f32, (rows.start + i / self.width) as f32) + 0.5;
                let below_m = self.ground.low_m + side_m * (texel - jitter);
                let point_m = (below_m + slope * *height_m).extend(*height_m);
                light[i] += self.thrown(*triangle as usize, point_m, slope) / DIRECTIONS as f32;
            }
        }
    }

    /// Keeps the lowest height at which a triangle is met, over the middles of texels.
    fn nearer(
        &self,
        nearest: &mut [(f32, u32)],
        rows: &Range<usize>,
        places: &[Vec2],
        triangle: u32,
        corners: &[u32; 3],
    ) {
        let [a, b, c] = corners.map(|i| places[i as usize]);
        let heights = corners.map(|i| self.occluders.corners[i as usize].z);
        let area = (b - a).perp_dot(c - a);
        if area == 0.0 {
            return;
        }
        let [to_b, to_c] = [heights[1] - heights[0], heights[2] - heights[0]];
        let per_texel =
            Vec2::new(to_b * (c.y - a.y) - to_c * (b.y - a.y), to_c * (b.x - a.x) - to_b * (c.x - a.x)) / area;
        let width = self.width;
        spans([a, b, c], width, rows, |texels| {
            let y = (rows.start + texels.start / width) as f32 + 0.5;
            for i in texels {
                let at = Vec2::new((i % width) as f32 + 0.5, y);
                let height_m = heights[0] + per_texel.dot(at - a);
                if height_m < nearest[i].0 {
                    nearest[i] = (height_m, triangle);
                }
            }
        });
    }

    /// How bright a triangle is seen at a point of it, from below along a slope.
    fn thrown(&self, triangle: usize, point_m: Vec3, slope: Vec2) -> Vec3 {
        let Face { normal, far, filled } = self.faces[triangle];
        // Inside of things it is dark.
        if normal.dot(slope.extend(1.0)) >= 0.0 {
            return Vec3::ZERO;
        }
        let lamps: Vec3 = self.sky.lamps.iter().map(|lamp| lamp.light_on(point_m, normal)).sum();
        let before_m = (point_m + normal * point_m.z).truncate();
        let left = 1.0 - (self.ground.taken)(before_m);
        let floor = FLOOR * 0.5 * (1.0 - normal.z) * filled * left * self.sky.light_at(before_m);
        self.occluders.colors[triangle] * (far + lamps + floor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::Quality;
    use crate::scene::{Environment, Lighting};
    use crate::shadow::extent::Extent;
    use crate::shadow::shadow_map::Real;
    use crate::shadow::sky::{Around, rays};
    use crate::shadow::{Floor, ShadowTexture};
    use glam::DVec3;

    const HEIGHT_M: f32 = 2.0;

    /// A wall along x of a reflectance, seen from below y = 0.
    fn taken_before_a_wall(reflectance: f32, distance_m: f32) -> f32 {
        let lighting = Lighting { environment: Environment::Uniform(Vec3::ONE), ..Lighting::default() };
        let floor = Floor::new(DVec3::ZERO, DVec3::Z);
        let sky = Sky::new(&lighting, rays(&lighting, &Around::new(&lighting.environment), &floor), &floor, None);
        let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        let occluders = Occluders {
            corners: vec![corner(-9.0, 0.0), corner(9.0, 0.0), corner(9.0, HEIGHT_M), corner(-9.0, HEIGHT_M)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            colors: vec![Vec3::splat(reflectance); 2],
            ..Occluders::default()
        };
        let extent = Extent { low: Vec2::splat(-5.0), high: Vec2::splat(5.0) };
        let shares = ShadowTexture::new(&occluders, extent, &sky, Real::default(), Quality::Final);
        shares.at_texel(shares.texel_of(Vec2::new(0.0, -distance_m)).as_dvec2()).y
    }

    #[test]
    fn a_wall_gives_back_as_much_as_it_is_seen_and_lit() {
        // The share of a place's view, by the cosine, that a long wall of some height at some distance fills.
        let filled = |height: f32, distance: f32| 0.5 * (1.0 - distance / height.hypot(distance));
        for distance_m in [0.8, 1.2, 2.0] {
            let black = taken_before_a_wall(0.0, distance_m);
            assert!((black - filled(HEIGHT_M, distance_m)).abs() < 0.02, "{distance_m}: {black}");
            // Strips of the wall: half of what each sees is sky, the other half floor, which the wall darkens.
            let strips = (0..500).map(|n| HEIGHT_M * n as f32 / 500.0).map(|low| {
                let seen = filled(low + HEIGHT_M / 500.0, distance_m) - filled(low, distance_m);
                let floor = 0.5 * FLOOR * (1.0 - filled(HEIGHT_M, low));
                0.8 * seen * (0.5 + floor)
            });
            let wanted = black - strips.sum::<f32>();
            let white = taken_before_a_wall(0.8, distance_m);
            assert!((white - wanted).abs() < 0.015, "{distance_m}: {white} for {wanted}, {black} without");
        }
        // Behind it nobody sees a lit side: the wall has one side only.
        let behind = [0.0, 0.8].map(|reflectance| taken_before_a_wall(reflectance, -0.8));
        assert!((behind[0] - behind[1]).abs() < 1e-3, "{behind:?}");
    }
}
