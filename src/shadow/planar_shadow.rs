//! The shadow of a group of objects on a receiver plane, as a texture: D = 1 − E_with / E_without
//! for each colour channel.

use std::ops::Range;

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::bounce::{Bounce, ReceiverTexels};
use super::extent::Extent;
use super::mask::{BitSums, Mask, jitter};
use super::occluders::Occluders;
use super::penumbra::blur_penumbra;
use super::receiver_mask::ReceiverMask;
use super::receiver_plane::ReceiverPlane;
use super::room::OccluderMask;
use super::silhouette::SilhouetteMesh;
use super::sky::{CLASSES, PlaneLighting, SampledLamp, SkyRay, class};
use crate::digest::{Digester, Digestible};
use crate::interpolation::bilinear;
use crate::memo::ByAddress;
use crate::parallel::{over_rows, processors};
use crate::quality::Quality;

/// Largest side of a texture, texels.
const MAX_SIDE_TEXELS: f32 = 640.0;
/// Texels along the longest side of the object itself, if the texture has room for them.
const OBJECT_SIDE_TEXELS: f32 = 160.0;
/// Smallest texel, m.
const MIN_TEXEL_M: f32 = 0.00025;
/// Width of the border over which the shadow fades out, as a share of the texture's sides.
const FADE_WIDTH: f32 = 0.08;
/// Smaller shares become 0: a third of an 8-bit code on a bright plane. Shares from twice this on
/// stay as they are.
const MIN_VISIBLE_SHADOW: f32 = 0.003;
/// Smallest share at which the shadow's exact outline on the real surface matters.
const DARK_SHADOW: f32 = 0.05;
/// Side of the blocks for which it is stored whether they hold any shadow.
const BLOCK_TEXELS: usize = 16;
/// Rays in one bit mask.
const RAYS_PER_MASK: usize = 32;
/// Smallest share of the distant light that is divided by, where real objects block nearly all of
/// it.
const MIN_FAR_LIGHT: f32 = 1e-6;
/// Ratio of a preview's texel to a final one's.
const PREVIEW_TEXEL_FACTOR: f32 = 3.0;

/// D over a rectangle of the plane, without its place in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadowTexture {
    /// Outer corner of the first texel, in the plane's axes, m.
    pub low_m: Vec2,
    pub texel_m: f32,
    pub width: u32,
    pub height: u32,
    /// D, the fraction of light removed, by row: 1 without light, 0 without shadow, below 0 where
    /// objects reflect more light onto the plane than they block.
    pub removed: Vec<[f32; 3]>,
    /// Bounds of D ≠ 0.
    pub visible_bounds: UvRect,
    /// Bounds of D above the dark share.
    pub dark_bounds: UvRect,
    /// Whether each block holds any shadow, by row.
    blocks: Vec<bool>,
}

/// A rectangle of a texture, relative to its sides; of size 0 if it is empty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvRect {
    pub low: DVec2,
    pub high: DVec2,
}

impl UvRect {
    pub const NONE: Self = Self { low: DVec2::ZERO, high: DVec2::ZERO };

    pub fn is_empty(&self) -> bool {
        self.low.cmpge(self.high).any()
    }
}

/// Soft threshold at the smallest visible share.
fn soft_threshold(share: f32) -> f32 {
    share * (share.abs() / MIN_VISIBLE_SHADOW - 1.0).clamp(0.0, 1.0)
}

/// Light at a texel.
#[derive(Clone, Debug, Default)]
struct TexelLight {
    /// Light that the objects block, by class of rays.
    blocked: [Vec3; CLASSES],
    /// Light without the objects.
    unshadowed: Vec3,
    /// True if an object is vertically above.
    is_below_object: bool,
}

/// Real surroundings of a receiver plane.
#[derive(Clone, Copy, Debug, Default)]
pub struct RealOcclusion<'a> {
    /// Rays that real objects block. `None` for none.
    pub blocked: Option<&'a OccluderMask>,
    /// Surfaces to which the planar shadow applies. `None` for everywhere.
    pub receiver: Option<&'a ReceiverMask>,
}

/// A shadow texture on a plane in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarShadow {
    pub plane: ReceiverPlane,
    pub texture: ByAddress<ShadowTexture>,
    /// The plane belongs to a real object beside, not to the support.
    pub is_beside: bool,
}

/// Bounds and blocks follow from `removed`; `is_beside` does not change the light.
impl Digestible for PlanarShadow {
    fn digest(&self, into: &mut Digester) {
        let Self { plane, texture, is_beside: _ } = self;
        let ShadowTexture { low_m, texel_m, width, height, removed, visible_bounds: _, dark_bounds: _, blocks: _ } =
            &**texture;
        into.add(plane);
        into.add(low_m);
        into.add(texel_m);
        into.add(width);
        into.add(height);
        into.add_numbers(removed);
    }
}

impl ShadowTexture {
    /// The texture of occluders over a rectangle of their plane. A preview has larger texels; with
    /// a [`PlaneLighting::sparse`] sky it takes a twentieth of the time.
    pub fn new(
        occluders: &Occluders,
        extent: Extent,
        sky: &PlaneLighting,
        real: RealOcclusion<'_>,
        quality: Quality,
    ) -> Self {
        let RealOcclusion { blocked, receiver } = real;
        let larger = if quality.is_preview() { PREVIEW_TEXEL_FACTOR } else { 1.0 };
        let size = extent.high - extent.low;
        let object_size = occluders.bounds().map_or(size.max_element(), |(low, high, _)| (high - low).max_element());
        let texel_m =
            larger * (object_size / OBJECT_SIDE_TEXELS).max(size.max_element() / MAX_SIDE_TEXELS).max(MIN_TEXEL_M);
        let (width, height) = ((size.x / texel_m).ceil().max(1.0) as u32, (size.y / texel_m).ceil().max(1.0) as u32);
        let mut texels = vec![TexelLight::default(); width as usize * height as usize];
        let silhouette = SilhouetteMesh::of(occluders);
        let mut texture = Self::empty(extent.low, texel_m, width, height);
        // A band of rows for each thread. The result does not depend on the bands.
        let rows = (height as usize).div_ceil(processors()).max(1);
        over_rows(&mut texels, width as usize * rows, processors(), |band, texels| {
            let first = band * rows;
            texture.fill(texels, first..first + texels.len() / width as usize, &silhouette, sky, blocked);
        });
        let lowest_m = occluders.corners.iter().map(|corner| corner.z).fold(f32::INFINITY, f32::min);
        let min_height = if lowest_m > texel_m && lowest_m.is_finite() { lowest_m / texel_m } else { 0.0 };
        let is_below_object: Vec<bool> = texels.iter().map(|texel| texel.is_below_object).collect();
        let mut blocked_light: Vec<Vec3> = texels.iter().map(|texel| texel.blocked[0]).collect();
        for (class, angle_rad) in sky.angles_rad().into_iter().enumerate().filter(|(_, angle_rad)| *angle_rad > 0.0) {
            let mut of_class: Vec<Vec3> = texels.iter().map(|texel| texel.blocked[class]).collect();
            blur_penumbra(&mut of_class, width as usize, &is_below_object, min_height, angle_rad);
            blocked_light.iter_mut().zip(of_class).for_each(|(sum, blocked)| *sum += blocked);
        }
        let ratio = |(i, (texel, blocked_light)): (usize, (&TexelLight, &Vec3))| {
            let share = *blocked_light / texel.unshadowed.max(Vec3::splat(1e-12));
            let fade = texture.border_fade(i % width as usize, i / width as usize);
            (share.clamp(Vec3::ZERO, Vec3::ONE) * fade).to_array()
        };
        texture.removed = texels.iter().zip(&blocked_light).enumerate().map(ratio).collect();
        let at = |place_m: Vec2| texture.at_texel(texture.texel_of(place_m).as_dvec2());
        let Self { low_m, texel_m, width, height, .. } = texture;
        // Objects do not reflect light that real objects block: at the first object's origin, or on
        // a facet behind the centre of all objects.
        let objects_at =
            receiver.and_then(|_| occluders.bounds()).map_or(Vec2::ZERO, |(low, high, _)| 0.5 * (low + high));
        let unblocked = blocked.map(|blocked| blocked.unblocked(sky, objects_at));
        let receiver_texels = ReceiverTexels {
            low_m,
            texel_m,
            width,
            height,
            removed: &at,
            is_below_object: &is_below_object,
            min_height,
        };
        let bounce = Bounce::new(&receiver_texels, occluders, unblocked.as_ref().unwrap_or(sky), receiver);
        let mut removed = std::mem::take(&mut texture.removed);
        over_rows(&mut removed, width as usize, processors(), |y, row| {
            for (x, removed) in row.iter_mut().enumerate() {
                let all = match blocked {
                    None => sky.light_at(texture.place_m(x, y)),
                    Some(_) => texels[y * width as usize + x].unshadowed,
                };
                let reflected = bounce.at(x, y) / all.max(sky.light.max(Vec3::splat(1e-12)) * MIN_FAR_LIGHT)
                    * texture.border_fade(x, y);
                let share = (Vec3::from(*removed) - reflected).max(Vec3::NEG_ONE);
                let share = share * receiver.map_or(1.0, |receiver| receiver.weight(texture.place_m(x, y)));
                *removed = share.to_array().map(soft_threshold);
            }
        });
        texture.removed = removed;
        [texture.visible_bounds, texture.dark_bounds] =
            [0.0, DARK_SHADOW].map(|threshold| texture.bounds_above(threshold));
        texture.blocks = texture.blocks();
        texture
    }

    /// Size in memory, bytes.
    pub fn size_bytes(&self) -> usize {
        std::mem::size_of_val(self.removed.as_slice()) + self.blocks.len()
    }

    /// A texture without any shadow.
    pub fn empty(low_m: Vec2, texel_m: f32, width: u32, height: u32) -> Self {
        let [visible_bounds, dark_bounds] = [UvRect::NONE; 2];
        let (removed, blocks) = (Vec::new(), Vec::new());
        Self { low_m, texel_m, width, height, removed, visible_bounds, dark_bounds, blocks }
    }

    fn blocks(&self) -> Vec<bool> {
        let width = self.width as usize;
        let in_row = width.div_ceil(BLOCK_TEXELS);
        let mut blocks = vec![false; in_row * (self.height as usize).div_ceil(BLOCK_TEXELS)];
        for (y, row) in self.removed.chunks_exact(width).enumerate() {
            for (x, texels) in row.chunks(BLOCK_TEXELS).enumerate() {
                blocks[y / BLOCK_TEXELS * in_row + x] |= texels.iter().any(|removed| *removed != [0.0; 3]);
            }
        }
        blocks
    }

    /// True if there is no shadow between two positions, texels, also after interpolation.
    pub fn is_unshadowed(&self, low: DVec2, high: DVec2) -> bool {
        let block = |at: f64| (at.max(0.0) / BLOCK_TEXELS as f64) as usize;
        let last = |side: u32| (side as usize).div_ceil(BLOCK_TEXELS).saturating_sub(1);
        let range = |low: f64, high: f64, side: u32| {
            let (first, end) = (block(low - 1.0), block(high + 1.0).min(last(side)));
            if high + 1.0 < 0.0 || low - 1.0 > f64::from(side) { 0..0 } else { first..end + 1 }
        };
        let (columns, rows) = (range(low.x, high.x, self.width), range(low.y, high.y, self.height));
        let in_row = (self.width as usize).div_ceil(BLOCK_TEXELS);
        !rows.into_iter().any(|y| self.blocks[y * in_row..][columns.clone()].contains(&true))
    }

    /// Bounds of |D| above a threshold, with a margin of a texel.
    fn bounds_above(&self, threshold: f32) -> UvRect {
        let size = DVec2::new(self.width.into(), self.height.into());
        let (mut low, mut high) = (size, DVec2::ZERO);
        for (y, row) in self.removed.chunks_exact(self.width as usize).enumerate() {
            let is_beyond = |removed: &[f32; 3]| removed.iter().any(|share| share.abs() > threshold);
            let ends = row.iter().position(is_beyond).zip(row.iter().rposition(is_beyond));
            if let Some((first, last)) = ends {
                low = low.min(DVec2::new(first as f64, y as f64));
                high = high.max(DVec2::new(last as f64, y as f64));
            }
        }
        if low.cmpgt(high).any() {
            return UvRect::NONE;
        }
        UvRect { low: (low - 1.0).max(DVec2::ZERO) / size, high: (high + 2.0).min(size) / size }
    }

    /// Position of a place on the plane, texels.
    pub fn texel_of(&self, place_m: Vec2) -> Vec2 {
        (place_m - self.low_m) / self.texel_m
    }

    fn fill(
        &self,
        texels: &mut [TexelLight],
        rows: Range<usize>,
        silhouette: &SilhouetteMesh,
        sky: &PlaneLighting,
        blocked: Option<&OccluderMask>,
    ) {
        let (width, rows_from) = (self.width as usize, rows.start);
        texels.iter_mut().for_each(|texel| texel.unshadowed = sky.light);
        let mut mask = Mask::new(width, rows.clone());
        mask.rasterize(0, silhouette, |c| Some(self.texel_of(c.truncate())));
        texels.iter_mut().zip(&mask.bits).for_each(|(texel, word)| texel.is_below_object = *word != 0);
        for (n, rays) in sky.rays.chunks(RAYS_PER_MASK).enumerate() {
            mask.clear();
            for (bit, ray) in (0..).zip(rays) {
                let jitter = jitter(n * RAYS_PER_MASK + bit as usize);
                mask.rasterize(bit, silhouette, |c| Some(self.texel_of(c.truncate() - ray.slope * c.z) + jitter));
            }
            if let Some(blocked) = blocked.filter(|blocked| blocked.blocks_any(n)) {
                let all = BitSums::of(&rays.iter().map(|ray| ray.light).collect::<Vec<_>>());
                for (i, (texel, word)) in texels.iter_mut().zip(&mut mask.bits).enumerate() {
                    let blocked_bits = blocked.rays(n, self.place_m(i % width, rows_from + i / width));
                    if blocked_bits != 0 {
                        *word &= !blocked_bits;
                        texel.unshadowed = (texel.unshadowed - all.sum(blocked_bits)).max(Vec3::ZERO);
                    }
                }
            }
            for of in (0..CLASSES).filter(|of| rays.iter().any(|ray| class(ray.angle_rad) == *of)) {
                let light = |ray: &SkyRay| if class(ray.angle_rad) == of { ray.light } else { Vec3::ZERO };
                let sums = BitSums::of(&rays.iter().map(light).collect::<Vec<_>>());
                for (texel, word) in texels.iter_mut().zip(&mask.bits).filter(|(_, word)| **word != 0) {
                    texel.blocked[of] += sums.sum(*word);
                }
            }
        }
        for (number, lamp) in sky.lamps.iter().enumerate() {
            let place_m = |i: usize| self.place_m(i % width, rows_from + i / width);
            let real = |n: usize, i: usize| blocked.map_or(0, |blocked| blocked.lamp(number, n, place_m(i)));
            let fractions = self.lamp_fractions(lamp, &mut mask, silhouette, real);
            for (i, [blocked_share, unblocked_share]) in fractions.into_iter().enumerate() {
                let light = lamp.light_at(place_m(i));
                texels[i].unshadowed += light * unblocked_share;
                texels[i].blocked[class(lamp.angle_rad())] += light * blocked_share;
            }
        }
    }

    /// For each texel of the mask's rows, the fraction of a lamp that virtual objects block and
    /// real ones do not, and the fraction that real ones do not block. `real` returns the bit mask
    /// of 32 points that real objects block.
    fn lamp_fractions(
        &self,
        lamp: &SampledLamp,
        mask: &mut Mask,
        silhouette: &SilhouetteMesh,
        real: impl Fn(usize, usize) -> u32,
    ) -> Vec<[f32; 2]> {
        let mut counts = vec![[0u32; 2]; mask.bits.len()];
        for (n, points) in lamp.points_m.chunks(RAYS_PER_MASK).enumerate() {
            mask.clear();
            for (bit, point) in (0..).zip(points) {
                let jitter = jitter(n * RAYS_PER_MASK + bit as usize);
                mask.rasterize(bit, silhouette, |c| {
                    let below = point.z - c.z;
                    let along = c.z / below;
                    (below > 0.02 * point.z)
                        .then(|| self.texel_of(c.truncate() + (c.truncate() - point.truncate()) * along) + jitter)
                });
            }
            for (i, ([blocked_count, unblocked_count], word)) in counts.iter_mut().zip(&mask.bits).enumerate() {
                let real_bits = real(n, i);
                *blocked_count += (word & !real_bits).count_ones();
                *unblocked_count += points.len() as u32 - real_bits.count_ones();
            }
        }
        counts.into_iter().map(|counts| counts.map(|count| count as f32 / lamp.points_m.len() as f32)).collect()
    }

    fn place_m(&self, x: usize, y: usize) -> Vec2 {
        self.low_m + self.texel_m * (Vec2::new(x as f32, y as f32) + 0.5)
    }

    /// Fade at the border: 1 inside the planar shadow, smoothly 0 at its outermost texels.
    fn border_fade(&self, x: usize, y: usize) -> f32 {
        let towards = |at: usize, side: u32| {
            let from_edge = (at as f32).min(side as f32 - 1.0 - at as f32) / (FADE_WIDTH * side as f32);
            let t = from_edge.clamp(0.0, 1.0);
            t * t * (3.0 - 2.0 * t)
        };
        towards(x, self.width) * towards(y, self.height)
    }

    /// D interpolated at a position in texels, the same as in the shader; 0 outside the planar
    /// shadow.
    pub fn at_texel(&self, at: DVec2) -> Vec3 {
        let size = DVec2::new(self.width.into(), self.height.into());
        if at.cmplt(DVec2::ZERO).any() || at.cmpgt(size).any() {
            return Vec3::ZERO;
        }
        let middle = (at - 0.5).clamp(DVec2::ZERO, size - 1.0);
        let (x, y) = (middle.x as usize, middle.y as usize);
        let texel = |x: usize, y: usize| {
            let (x, y) = (x.min(self.width as usize - 1), y.min(self.height as usize - 1));
            Vec3::from(self.removed[y * self.width as usize + x])
        };
        let f = (middle - middle.floor()).as_vec2();
        bilinear([texel(x, y), texel(x + 1, y), texel(x, y + 1), texel(x + 1, y + 1)], f.to_array())
    }
}

impl PlanarShadow {
    /// World position at coordinates relative to the texture's sides.
    pub fn at(&self, across: f64, down: f64) -> DVec3 {
        let texture = &self.texture;
        let size = Vec2::new(texture.width as f32, texture.height as f32).as_dvec2() * f64::from(texture.texel_m);
        self.plane.at(texture.low_m.as_dvec2() + size * DVec2::new(across, down))
    }

    /// D at a point of the plane.
    pub fn removed_at(&self, point: DVec3) -> Vec3 {
        let place = self.plane.plane_from_world().transform_point3(point).truncate();
        self.texture.at_texel((place - self.texture.low_m.as_dvec2()) / f64::from(self.texture.texel_m))
    }
}
