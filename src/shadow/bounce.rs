//! Indirect light that objects reflect onto their receiver plane: one bounce.
//!
//! The radiance of a Lambertian surface is that of a white one in its place, times its albedo ρ.
//! The radiance of a white place on the plane is the mean incident radiance over cosine-distributed
//! directions. Each of K such directions that hits an object contributes ρ·E(n)/K, where E(n) is
//! the radiance of a white surface with the object's normal n:
//!
//! - by distant light, Σ light·max(n·(slope, 1), 0), since a ray's light on the plane contains the
//!   cosine to the plane's normal and (slope, 1) is its direction divided by that cosine; by lamps
//!   according to their distance;
//! - by the plane, which has the form factor (1 − n_z)/2: the plane's light times a mean albedo,
//!   minus the light that the object itself blocks in front of the surface.
//!
//! A facet is finite. Distant light and lamps behind it reach a surface past its rectangle
//! ([`ReceiverMask::is_hit`]), and its form factor is smaller accordingly.
//!
//! Not modelled: occlusion between objects; the plane's own colour; further bounces; mirrors.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::mask::{jitter, spans};
use super::occluders::Occluders;
use super::penumbra::blur_penumbra;
use super::receiver_mask::ReceiverMask;
use super::sky::{BackLight, EnvSample, PlaneLighting, disc};
use crate::interpolation::bilinear;
use crate::parallel::{over_rows, processors};

/// Directions from each place on the plane.
const DIRECTIONS: usize = 64;
/// Ratio of a texel of indirect light to one of the planar shadow. Indirect light varies slowly.
const TEXEL_RATIO: u32 = 3;
/// Albedo of the plane. Concrete, wood and carpets have 0.1 to 0.6.
const PLANE_ALBEDO: f32 = 0.35;
/// Triangle index of a direction without a hit.
const NO_HIT: u32 = u32::MAX;

/// The texels of a receiver plane.
pub struct ReceiverTexels<'a> {
    pub low_m: Vec2,
    pub texel_m: f32,
    pub width: u32,
    pub height: u32,
    /// Fraction of the light that the same objects block at a place.
    pub removed: &'a (dyn Fn(Vec2) -> Vec3 + Sync),
    /// True for texels vertically below an object, row by row; empty if unknown.
    pub is_below_object: &'a [bool],
    /// Smallest height of the objects above the plane, texels.
    pub min_height: f32,
}

/// Indirect light on a planar shadow's plane, as the radiance of white, at a lower resolution.
#[derive(Debug)]
pub struct Bounce {
    width: usize,
    height: usize,
    light: Vec<Vec3>,
}

impl Bounce {
    pub fn new(
        texels: &ReceiverTexels<'_>,
        occluders: &Occluders,
        sky: &PlaneLighting,
        receiver: Option<&ReceiverMask>,
    ) -> Self {
        let [width, height] = [texels.width, texels.height].map(|side| side.div_ceil(TEXEL_RATIO) as usize);
        let faces: Vec<FaceLight> =
            (0..occluders.triangles.len()).map(|n| FaceLight::of(occluders, n, sky, receiver)).collect();
        let mut light = vec![Vec3::ZERO; width * height];
        let rows = height.div_ceil(processors()).max(1);
        over_rows(&mut light, width * rows, processors(), |band, light| {
            let first = band * rows;
            let inputs = BounceInputs { texels, occluders, sky, faces: &faces, width };
            inputs.fill(light, first..first + light.len() / width);
        });
        // Each direction samples a patch of the unit disc, of 1/K of its area.
        let min_height = texels.min_height / TEXEL_RATIO as f32;
        blur_penumbra(
            &mut light,
            width,
            &texels.is_below_object_coarse(width, height),
            min_height,
            (DIRECTIONS as f32).sqrt().recip(),
        );
        Self { width, height, light }
    }

    /// Reflected light at a texel of the planar shadow.
    pub fn at(&self, x: usize, y: usize) -> Vec3 {
        let place = |at: usize| ((at as f32 + 0.5) / TEXEL_RATIO as f32 - 0.5).max(0.0);
        let (across, down) = (place(x), place(y));
        let (left, above) = (across as usize, down as usize);
        let texel = |x: usize, y: usize| self.light[y.min(self.height - 1) * self.width + x.min(self.width - 1)];
        let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| texel(left + dx, above + dy));
        bilinear(corners, [across - left as f32, down - above as f32])
    }
}

impl ReceiverTexels<'_> {
    fn is_below_object_coarse(&self, width: usize, height: usize) -> Vec<bool> {
        let mut coarse = vec![false; width * height];
        for (y, row) in self.is_below_object.chunks(self.width.max(1) as usize).enumerate() {
            for (x, _) in row.iter().enumerate().filter(|(_, stands)| **stands) {
                coarse[y / TEXEL_RATIO as usize * width + x / TEXEL_RATIO as usize] = true;
            }
        }
        coarse
    }
}

/// A triangle's incident light.
#[derive(Clone, Copy, Debug)]
struct FaceLight {
    normal: Vec3,
    /// Radiance of white by distant light.
    far: Vec3,
    /// Fraction of the view below the plane that the receiver covers: 1 but for a facet.
    covered: f32,
}

impl FaceLight {
    fn of(occluders: &Occluders, triangle: usize, sky: &PlaneLighting, receiver: Option<&ReceiverMask>) -> Self {
        let [a, b, c] = occluders.triangles[triangle].map(|i| occluders.corners[i as usize]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let far = sky.rays.iter().map(|ray| ray.light * normal.dot(ray.slope.extend(1.0)).max(0.0)).sum();
        let own = Self { normal, far, covered: 1.0 };
        match (&sky.back_light, receiver) {
            (Some(back_light), Some(receiver)) => own.with_back_light(back_light, receiver, (a + b + c) / 3.0),
            _ => own,
        }
    }

    /// This bounce with light from behind a facet that passes its sides.
    fn with_back_light(self, back_light: &BackLight, receiver: &ReceiverMask, from: Vec3) -> Self {
        let (mut total, mut covered, mut far) = (0.0, 0.0, self.far);
        for EnvSample { towards, light, solid_sr } in back_light.far.iter().copied() {
            let cosine = self.normal.dot(towards).max(0.0);
            let is_hit = receiver.is_hit(from, towards);
            total += cosine * solid_sr;
            covered += if is_hit { cosine * solid_sr } else { 0.0 };
            far += if is_hit { Vec3::ZERO } else { light * cosine };
        }
        let lamps = back_light.lamps.iter().filter(|lamp| !receiver.is_hit(from, lamp.at_m - from));
        far += lamps.map(|lamp| lamp.light_on(from, self.normal)).sum::<Vec3>();
        Self { far, covered: if total > 0.0 { covered / total } else { 1.0 }, ..self }
    }
}

/// Inputs of a band of indirect light.
struct BounceInputs<'a> {
    texels: &'a ReceiverTexels<'a>,
    occluders: &'a Occluders,
    sky: &'a PlaneLighting,
    faces: &'a [FaceLight],
    width: usize,
}

impl BounceInputs<'_> {
    fn fill(&self, light: &mut [Vec3], rows: Range<usize>) {
        let side_m = self.texels.texel_m * TEXEL_RATIO as f32;
        let (mut nearest, mut places) = (vec![(f32::INFINITY, NO_HIT); light.len()], Vec::new());
        for (n, at) in disc(DIRECTIONS).enumerate() {
            let slope = at / (1.0 - at.length_squared()).max(1e-6).sqrt();
            let jitter = jitter(n);
            nearest.fill((f32::INFINITY, NO_HIT));
            places.clear();
            let corners = self.occluders.corners.iter();
            places.extend(corners.map(|c| (c.truncate() - slope * c.z - self.texels.low_m) / side_m + jitter));
            for (triangle, corners) in (0..).zip(&self.occluders.triangles) {
                self.rasterize(&mut nearest, &rows, &places, triangle, corners);
            }
            for (i, (height_m, triangle)) in nearest.iter().enumerate().filter(|(_, (_, n))| *n != NO_HIT) {
                let texel = Vec2::new((i % self.width) as f32, (rows.start + i / self.width) as f32) + 0.5;
                let below_m = self.texels.low_m + side_m * (texel - jitter);
                let point_m = (below_m + slope * *height_m).extend(*height_m);
                light[i] += self.reflected(*triangle as usize, point_m, slope) / DIRECTIONS as f32;
            }
        }
    }

    /// Rasterizes a triangle: the lowest height wins at the centres of texels.
    fn rasterize(
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

    /// Radiance of a point on a triangle in the direction of the plane, along a slope.
    fn reflected(&self, triangle: usize, point_m: Vec3, slope: Vec2) -> Vec3 {
        let FaceLight { normal, far, covered } = self.faces[triangle];
        // Back faces are dark.
        if normal.dot(slope.extend(1.0)) >= 0.0 {
            return Vec3::ZERO;
        }
        let lamps: Vec3 = self.sky.lamps.iter().map(|lamp| lamp.light_on(point_m, normal)).sum();
        let in_front_m = (point_m + normal * point_m.z).truncate();
        let unblocked = 1.0 - (self.texels.removed)(in_front_m);
        let floor = PLANE_ALBEDO * 0.5 * (1.0 - normal.z) * covered * unblocked * self.sky.light_at(in_front_m);
        self.occluders.colors[triangle] * (far + lamps + floor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::Quality;
    use crate::scene::{Environment, Lighting};
    use crate::shadow::extent::Extent;
    use crate::shadow::planar_shadow::RealOcclusion;
    use crate::shadow::sky::{EnvironmentImage, rays};
    use crate::shadow::{ReceiverPlane, ShadowTexture};
    use glam::DVec3;

    const HEIGHT_M: f32 = 2.0;

    /// The shadow in front of a wall along x of some albedo, at y < 0.
    fn shadow_in_front_of_a_wall(albedo: f32, distance_m: f32) -> f32 {
        let lighting = Lighting { environment: Environment::Uniform(Vec3::ONE), ..Lighting::default() };
        let plane = ReceiverPlane::new(DVec3::ZERO, DVec3::Z);
        let sky = PlaneLighting::new(
            &lighting,
            rays(&lighting, &EnvironmentImage::new(&lighting.environment), &plane),
            &plane,
            None,
        );
        let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        let occluders = Occluders {
            corners: vec![corner(-9.0, 0.0), corner(9.0, 0.0), corner(9.0, HEIGHT_M), corner(-9.0, HEIGHT_M)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            colors: vec![Vec3::splat(albedo); 2],
            ..Occluders::default()
        };
        let extent = Extent { low: Vec2::splat(-5.0), high: Vec2::splat(5.0) };
        let texture = ShadowTexture::new(&occluders, extent, &sky, RealOcclusion::default(), Quality::Final);
        texture.at_texel(texture.texel_of(Vec2::new(0.0, -distance_m)).as_dvec2()).y
    }

    #[test]
    fn indirect_light_of_a_wall_matches_its_form_factor() {
        // Form factor of a long wall of some height at some distance.
        let form_factor = |height: f32, distance: f32| 0.5 * (1.0 - distance / height.hypot(distance));
        for distance_m in [0.8, 1.2, 2.0] {
            let black = shadow_in_front_of_a_wall(0.0, distance_m);
            assert!((black - form_factor(HEIGHT_M, distance_m)).abs() < 0.02, "{distance_m}: {black}");
            // Strips of the wall: half of the view of each is sky, the other half floor, which the
            // wall darkens.
            let strips = (0..500).map(|n| HEIGHT_M * n as f32 / 500.0).map(|low| {
                let visible_part = form_factor(low + HEIGHT_M / 500.0, distance_m) - form_factor(low, distance_m);
                let floor = 0.5 * PLANE_ALBEDO * (1.0 - form_factor(HEIGHT_M, low));
                0.8 * visible_part * (0.5 + floor)
            });
            let expected = black - strips.sum::<f32>();
            let white = shadow_in_front_of_a_wall(0.8, distance_m);
            assert!((white - expected).abs() < 0.015, "{distance_m}: {white} for {expected}, {black} without");
        }
        // The back of the one-sided wall reflects nothing.
        let behind = [0.0, 0.8].map(|albedo| shadow_in_front_of_a_wall(albedo, -0.8));
        assert!((behind[0] - behind[1]).abs() < 1e-3, "{behind:?}");
    }
}
