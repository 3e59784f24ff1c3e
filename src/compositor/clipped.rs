//! Shadows on receiver pixels that clip.
//!
//! A code at the camera's white is a lower bound of the light: L ≥ V, with V the light of that
//! code. The shadow ratio s scales the true radiance L, and the camera clips the result again:
//!
//!   V' = min(V, L̂·s),   L̂ = max(V, g·R).
//!
//! R is the radiance of the surface in frames that do not clip there
//! ([`SurfaceRadiance`](crate::shadow::SurfaceRadiance)), g this frame's gain. Where R is a bound
//! itself, or unknown, L̂ is the largest known lower bound.
//!
//! The camera's white has no colour of its own: three clipped channels contain neither the
//! surface's nor the light's. So a pixel of which all channels clip is darkened as little as its
//! channels allow, and equally in all channels:
//!
//!   V'_c/V_c = max over channels of min(1, L̂·s/V).
//!
//! Cameras compress light below their white. So L̂ rises from V to its value between the codes 240
//! and 250 of 255, and channels are equalized over the same range. On a saturated colour only one
//! or two channels clip, and L̂ would change the hue between the lit and the shadowed part: it
//! rises to its value as the smallest channel rises from 200 to 240. Below that, V is used for L.
//!
//! The result is stored as the fraction of the recorded light that is removed. Mixing, noise and
//! layer files treat it like that of any other pixel.
//!
//! Not modelled: the colour of a clipped surface in a shadow; the true radiance of saturated
//! colours of which a channel clips; the radiance above its largest lower bound of a surface that
//! clips in every frame, which makes its shadow too dark; the radiance of photographs that sum
//! frames and of recordings without depth or without an analysis, where V is the only bound.

use super::dirty_tiles::dirty_tiles;
use crate::camera::{Geometry, Response};
use crate::depth::Rays;
use crate::frame::RelativeBrightness;
use crate::gpu::{PassRecorder, Shader, ShaderEntry, half_texels};
use crate::parallel::{over_rows, processors};
use crate::pixels::CLIP_LEVEL;
use crate::pixels::{Codes, Pixels, Rect};
use crate::pose::Pose;
use crate::render::COLOR;
use crate::shadow::{LazyRadiance, RadianceSampler};

use super::shadow_mask::ShadowMask;

/// Code from which on the camera compresses light below its white, as a fraction of the largest
/// code.
const SHOULDER_LEVEL: f32 = 240.0 / 255.0;
/// Smallest channel below which a clipped colour counts as saturated, as a fraction of the largest
/// code.
const SATURATED_LEVEL: f32 = 200.0 / 255.0;
/// Largest ratio of the true radiance to the recorded light. Brighter surfaces are lamps, which
/// receive no shadow.
const MAX_EXCESS: f32 = 16.0;

crate::uniform! {
    struct ClippedUniform { part_px: [f32; 2], in_light: [i32; 2], light_size: [i32; 2] }
}

/// The radiance of surfaces, with the frame's geometry to look it up by pixel.
pub struct FrameRadiance<'a> {
    pub radiance: &'a LazyRadiance,
    /// The frame's depth over a rectangle of its picture, m, 0 if unknown.
    pub depth_m: (&'a [f32], Rect),
    pub rays: &'a Rays,
    /// The camera's pose at a time from the middle row's, s.
    pub pose_at: &'a (dyn Fn(f64) -> Pose + Sync),
    pub brightness: RelativeBrightness,
}

/// The clipped light of a part of the picture.
struct ClippedLight {
    rect: Rect,
    /// Ratio of the true radiance to the recorded light, 0 for channels that do not clip; and the
    /// degree to which all channels clip.
    excess: Vec<[f32; 4]>,
}

/// Limits the light that shadows remove from clipped pixels of `part`.
pub fn limit_clipped_shadow(
    recorder: &mut PassRecorder,
    shadow_mask: ShadowMask,
    part: Rect,
    (pixels, response, geometry): (&Pixels, &Response, &Geometry),
    frame_radiance: Option<&FrameRadiance<'_>>,
) -> ShadowMask {
    let rects = dirty_tiles(part, &shadow_mask.pieces);
    let Some(light) = ClippedLight::new(pixels, response, geometry, &rects, frame_radiance) else { return shadow_mask };
    let size = (light.rect.width(), light.rect.height());
    let texture = recorder.pool.lend_to_write(&recorder.gpu, size, COLOR);
    texture.write(&recorder.gpu, size.0, size.1, &half_texels(&light.excess));
    let uniform = ClippedUniform {
        part_px: [part.width() as f32, part.height() as f32],
        in_light: [part.x0 - light.rect.x0, part.y0 - light.rect.y0],
        light_size: [size.0 as i32, size.1 as i32],
    };
    let in_part = |rect: &Rect| [rect.x0 - part.x0, rect.y0 - part.y0, rect.x1 - part.x0, rect.y1 - part.y0];
    let quads: Vec<[i32; 4]> = rects.iter().map(in_part).collect();
    let list = recorder.storage(bytemuck::cast_slice(&quads));
    let pass = recorder.pass(Shader::Clipped, ShaderEntry::with_vertex("part", "main")).uniform("clipped", &uniform);
    let pass = pass.texture("shadow_mask", &shadow_mask.texture).texture("excess", &texture).buffer("parts", list);
    let [texture] = pass.tiles(quads.len() as u32).draw([COLOR], (part.width(), part.height()));
    ShadowMask { texture, ..shadow_mask }
}

/// Degree to which a code, as a fraction of the largest one, clips: 0 to 1.
fn clipping(code: f32) -> f32 {
    ((code - SHOULDER_LEVEL) / (CLIP_LEVEL - SHOULDER_LEVEL)).clamp(0.0, 1.0)
}

impl ClippedLight {
    /// Clipped light of the pixels in the rectangles. `None` if none clips.
    fn new(
        pixels: &Pixels,
        response: &Response,
        geometry: &Geometry,
        rects: &[Rect],
        frame_radiance: Option<&FrameRadiance<'_>>,
    ) -> Option<Self> {
        let picture = Rect::full(pixels.width, pixels.height);
        let beyond = if geometry.is_equirectangular() { pixels.width as i32 } else { 0 };
        let bounds = Rect { x0: picture.x0 - beyond, x1: picture.x1 + beyond, ..picture };
        let rects: Vec<Rect> =
            rects.iter().map(|rect| rect.intersection(&bounds)).filter(|rect| !rect.is_empty()).collect();
        let max_code = pixels.max_code();
        let first = (SHOULDER_LEVEL * max_code as f32).round() as u32 + 1;
        let clips = |x: i32, y: i32| {
            let codes = pixels.at(x.rem_euclid(picture.x1) as u32, y as u32);
            codes.iter().any(|code| *code >= first).then_some(codes)
        };
        // The bounds of the clipped pixels.
        let rows = rects.iter().flat_map(|rect| (rect.y0..rect.y1).map(move |y| (*rect, y)));
        let searched = rows.filter(|(rect, y)| has_code_from(pixels, *y, *rect, first, beyond > 0));
        let rect = searched.fold(Rect::new(0, 0, 0, 0), |around, (rect, y)| {
            let clips = |x: &i32| clips(*x, y).is_some();
            let ends = (rect.x0..rect.x1).find(clips).zip((rect.x0..rect.x1).rfind(clips));
            ends.map_or(around, |(x0, x1)| around.union(&Rect::new(x0, y, x1 + 1, y + 1)))
        });
        if rect.is_empty() {
            return None;
        }
        let light: Vec<f32> =
            (first..=max_code).map(|code| response.decode(f64::from(code) / f64::from(max_code)) as f32).collect();
        let mut excess = vec![[0.0f32; 4]; rect.width() as usize * rect.height() as usize];
        if let Some(radiance) = frame_radiance {
            let rows = rect.intersection(&picture);
            radiance.rays.prepare(rows.y0..rows.y1);
        }
        over_rows(&mut excess, rect.width() as usize, processors(), |row, excess| {
            let y = rect.y0 + row as i32;
            let mut row_inputs = frame_radiance.map(|radiance| {
                let pose = (radiance.pose_at)(geometry.row_time_s(f64::from(y) + 0.5));
                (radiance, pose, radiance.radiance.sampler())
            });
            let columns = rects.iter().filter(|rect| (rect.y0..rect.y1).contains(&y)).flat_map(|rect| rect.x0..rect.x1);
            for (x, codes) in columns.filter_map(|x| Some((x, clips(x, y)?))) {
                let radiance = row_inputs
                    .as_mut()
                    .and_then(|(radiance, pose, sampler)| radiance.at((x, y), pose, picture, sampler));
                let degree = codes.map(|code| clipping(code as f32 / max_code as f32));
                let smallest = codes.into_iter().min().unwrap_or(0) as f32 / max_code as f32;
                let paleness = ((smallest - SATURATED_LEVEL) / (SHOULDER_LEVEL - SATURATED_LEVEL)).clamp(0.0, 1.0);
                let texel = &mut excess[(x - rect.x0) as usize];
                for c in (0..3).filter(|c| degree[*c] > 0.0) {
                    let own = light[(codes[c].max(first) - first) as usize];
                    let true_light = radiance.map_or(own, |radiance| radiance[c].clamp(own, MAX_EXCESS * own));
                    texel[c] = 1.0 + paleness * degree[c] * (true_light / own - 1.0);
                }
                texel[3] = degree[0].min(degree[1]).min(degree[2]);
            }
        });
        Some(Self { rect, excess })
    }
}

/// Whether a row of a rectangle may contain a code of at least `first`. Always true for a 360°
/// picture.
fn has_code_from(pixels: &Pixels, y: i32, rect: Rect, first: u32, is_equirectangular: bool) -> bool {
    if is_equirectangular {
        return true;
    }
    let start = 3 * (y as usize * pixels.width as usize + rect.x0 as usize);
    let length = 3 * rect.width() as usize;
    // A maximum is vectorized.
    match &pixels.codes {
        Codes::U8(codes) => {
            u32::from(codes[start..start + length].iter().fold(0, |largest, code| largest.max(*code))) >= first
        }
        Codes::U16(codes) => {
            u32::from(codes[start..start + length].iter().fold(0, |largest, code| largest.max(*code))) >= first
        }
    }
}

impl FrameRadiance<'_> {
    /// Linear radiance of a pixel in this frame's exposure, or a lower bound of it. `None` if
    /// unknown.
    fn at(
        &self,
        (x, y): (i32, i32),
        pose: &Pose,
        picture: Rect,
        sampler: &mut RadianceSampler<'_>,
    ) -> Option<[f32; 3]> {
        let (depth_m, rect) = self.depth_m;
        if !rect.contains(x, y) || !picture.contains(x, y) {
            return None;
        }
        let z = depth_m[(y - rect.y0) as usize * rect.width() as usize + (x - rect.x0) as usize];
        let ray = self.rays.row(y as usize)?.get(x as usize)?;
        let point = ray.map(|along| f64::from(z * along));
        let radiance = (z > 0.0 && point.iter().all(|p| p.is_finite()))
            .then(|| sampler.at(pose.inverse_transform_point(point.into())))??;
        let share = |at: i32, size: i32| (at as f32 + 0.5) / size as f32;
        let here = self.brightness.spatial_gain.at([share(x, picture.x1), share(y, picture.y1)]).exp2();
        let gain = self.brightness.factors.map(|factor| factor as f32 * here);
        Some(std::array::from_fn(|c| gain[c] * radiance[c]))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::camera::Curve;
    use crate::frame::{NODES, SpatialGain};
    use crate::shadow::{SurfaceRadiance, SurfaceSample};

    const PICTURE: Rect = Rect { x0: 0, y0: 0, x1: 8, y1: 6 };

    fn linear() -> Response {
        Response { curve: Curve::Linear, ..Response::default() }
    }

    /// Clipped light of a grey picture with one other pixel, at column 3 of row 2.
    fn light_of(codes: [u8; 3], radiance: Option<&FrameRadiance<'_>>) -> Option<ClippedLight> {
        let pixel = |i: usize| if i == 2 * 8 + 3 { codes } else { [90; 3] };
        let pixels = Pixels::from_u8(8, 6, (0..48).flat_map(pixel).collect()).unwrap();
        ClippedLight::new(&pixels, &linear(), &Geometry::pinhole(8, 6, 8.0), &[PICTURE], radiance)
    }

    #[test]
    fn clipped_light_without_other_frames_is_that_of_the_code() {
        assert!(light_of([240; 3], None).is_none());
        let light = light_of([255, 245, 100], None).unwrap();
        assert_eq!((light.rect, light.excess.as_slice()), (Rect::new(3, 2, 4, 3), [[1.0, 1.0, 0.0, 0.0]].as_slice()));
        assert_eq!(light_of([255, 250, 251], None).unwrap().excess, [[1.0; 4]]);
        let half = light_of([255, 245, 251], None).unwrap().excess[0];
        assert!((half[3] - 0.5).abs() < 1e-5, "{half:?}");
    }

    #[test]
    fn clipped_light_known_from_other_frames_is_their_radiance_times_the_gain() {
        // A wall at 1 m of radiance (1.2, 0.9, 0.3) at the usual exposure, with a corner that no
        // frame shows.
        let places =
            (-50..50).flat_map(|x| (-50..50).map(move |y| DVec3::new(0.01 * f64::from(x), 0.01 * f64::from(y), 1.0)));
        let sample = |at_m: DVec3| SurfaceSample { at_m, light: [1.2, 0.9, 0.3], is_clipped: [false; 3] };
        let samples: Vec<_> = places.filter(|at| at.x > -0.3).map(sample).collect();
        let radiance = LazyRadiance::new(Box::new(|| SurfaceRadiance::of(samples.into_iter())));
        let brightness =
            RelativeBrightness { factors: [1.5, 1.2, 1.0], median_s: None, spatial_gain: SpatialGain([1.0; NODES]) };
        let depth_m = vec![1.0; 48];
        let rays = Rays::new(&Geometry::pinhole(8, 6, 8.0));
        let excess = |codes: [u8; 3], x_m: f64| {
            let pose_at = move |_| Pose::from_camera_in_world(DVec3::X * x_m, glam::DQuat::IDENTITY);
            let radiance = FrameRadiance {
                radiance: &radiance,
                depth_m: (&depth_m, PICTURE),
                rays: &rays,
                pose_at: &pose_at,
                brightness,
            };
            light_of(codes, Some(&radiance)).unwrap().excess[0]
        };
        // Vignetting doubles the factors here. Green clips by half; blue's radiance is below its
        // code.
        let expected = [3.6, 1.0 + 0.5 * (2.16 * 255.0 / 245.0 - 1.0), 1.0];
        let excess_of_light = excess([255, 245, 251], 0.0);
        assert!((0..3).all(|c| (excess_of_light[c] - expected[c]).abs() < 1e-3), "{excess_of_light:?} {expected:?}");
        assert_eq!(excess([255, 245, 251], -0.9)[..3], [1.0; 3]);
        // A colour of half paleness, and a saturated one.
        let [half, none] = [220, 180].map(|blue| excess([255, 245, blue], 0.0)[0]);
        assert!((half - 2.3).abs() < 1e-3 && none == 1.0, "{half} {none}");
    }
}
