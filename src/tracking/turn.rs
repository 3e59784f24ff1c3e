//! Rotation of the camera between two pictures, from their pixels.
//!
//! Coarse-to-fine image alignment: the pictures are reduced until the motion is a fraction of a
//! pixel, and each finer level refines the estimate. The rotation R minimizes Σ (B(π(R·ray(p))) −
//! A(p) − c)², c a change of brightness, by Gauss-Newton. A translation is absorbed by the rotation
//! that fits best. Not modelled: lens distortion and readout.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::camera::Intrinsics;
use crate::grey_image::GreyImage;
use crate::interpolation::bilinear;
use crate::pixels::{Codes, Pixels};

/// Approximate width of the finest level, px; a global rotation needs no more.
const FINEST_WIDTH_PX: u32 = 160;
/// Shorter side of the coarsest level, px.
const COARSEST_SIDE_PX: u32 = 12;
const ITERATIONS: usize = 8;
/// Convergence threshold of a step, radians: 0.003 px of the finest level at a wide angle.
const CONVERGENCE_RAD: f64 = 2e-5;
/// Smallest correlation of the aligned pictures.
const MIN_CORRELATION: f64 = 0.5;

/// Image pyramid for alignment.
#[derive(Clone, Debug)]
pub struct ImagePyramid {
    /// Pyramid levels, the finest first, each half as large.
    levels: Vec<GreyImage>,
}

/// Focal lengths and principal point of a level, px.
#[derive(Clone, Copy)]
struct Pinhole {
    focal: DVec2,
    centre: DVec2,
}

impl ImagePyramid {
    /// `None` if a picture is too small.
    pub fn new(pixels: &Pixels) -> Option<Self> {
        let by = (pixels.width / FINEST_WIDTH_PX).max(1);
        let green = |x: u32, y: u32| {
            let at = 3 * (y as usize * pixels.width as usize + x as usize) + 1;
            match &pixels.codes {
                Codes::U8(codes) => f32::from(codes[at]),
                Codes::U16(codes) => f32::from(codes[at]) / 257.0,
            }
        };
        let (width, height) = (pixels.width / by, pixels.height / by);
        let mean = |x: u32, y: u32| {
            let all = (0..by * by).map(|n| green(by * x + n % by, by * y + n / by)).sum::<f32>();
            all / (by * by) as f32
        };
        let values = (0..width * height).map(|n| mean(n % width, n / width)).collect();
        let mut levels = vec![smoothed(&GreyImage { width: width as usize, height: height as usize, values })];
        while let Some(half) = levels.last().and_then(half) {
            levels.push(half);
        }
        (width.min(height) >= COARSEST_SIDE_PX).then_some(Self { levels })
    }

    /// Standard deviation of the brightness, code values.
    pub fn contrast(&self) -> f64 {
        let Some(finest) = self.levels.first() else { return 0.0 };
        let (n, values) = (finest.values.len() as f64, finest.values.iter().map(|value| f64::from(*value)));
        let (sum, squares) = values.fold((0.0, 0.0), |(sum, squares), value| (sum + value, squares + value * value));
        (squares / n - (sum / n).powi(2)).max(0.0).sqrt()
    }

    /// Rotation from this picture's camera to the next one's, as a rotation vector in the camera's
    /// axes, radians. `None` if the pictures do not match.
    pub fn rotation_to(&self, next: &Self, camera: &Intrinsics) -> Option<DVec3> {
        let pinhole = |level: &GreyImage| {
            let scale = level.width as f64 / f64::from(camera.width_px);
            Pinhole {
                focal: scale * DVec2::new(camera.fx_px, camera.fy_px),
                centre: scale * DVec2::new(camera.cx_px, camera.cy_px),
            }
        };
        let mut turn = DQuat::IDENTITY;
        for (a, b) in self.levels.iter().zip(&next.levels).rev() {
            if (a.width, a.height) != (b.width, b.height) {
                return None;
            }
            turn = aligned(a, b, pinhole(a), turn)?;
        }
        let (a, b) = (self.levels.first()?, next.levels.first()?);
        (correlation(a, b, pinhole(a), turn) >= MIN_CORRELATION).then(|| turn.to_scaled_axis())
    }
}

/// Smoothed by a 1 2 1 kernel in both directions, so that gradients cover a level's shift.
fn smoothed(level: &GreyImage) -> GreyImage {
    let (w, h) = (level.width, level.height);
    let blend = |before: f32, here: f32, after: f32| 0.25 * (before + 2.0 * here + after);
    let places = || (0..w * h).map(|n| (n % w, n / w));
    let at = |x: usize, y: usize| level.values[y * w + x];
    let across: Vec<f32> =
        places().map(|(x, y)| blend(at(x.saturating_sub(1), y), at(x, y), at((x + 1).min(w - 1), y))).collect();
    let at = |x: usize, y: usize| across[y * w + x];
    let values =
        places().map(|(x, y)| blend(at(x, y.saturating_sub(1)), at(x, y), at(x, (y + 1).min(h - 1)))).collect();
    GreyImage { width: w, height: h, values }
}

fn half(level: &GreyImage) -> Option<GreyImage> {
    let (width, height) = (level.width / 2, level.height / 2);
    let at = |x: usize, y: usize| level.values[y * level.width + x];
    let mean = |x: usize, y: usize| 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
    let values = (0..width * height).map(|n| mean(2 * (n % width), 2 * (n / width))).collect();
    (width.min(height) >= COARSEST_SIDE_PX as usize).then(|| smoothed(&GreyImage { width, height, values }))
}

/// Bilinear sample in 32 bits, with pixel centres at +0.5; `None` outside.
fn sample(level: &GreyImage, at: DVec2) -> Option<f32> {
    let (x, y) = (at.x - 0.5, at.y - 0.5);
    let (left, top) = (x.floor(), y.floor());
    if left < 0.0 || top < 0.0 || left as usize + 1 >= level.width || top as usize + 1 >= level.height {
        return None;
    }
    let (u, v) = ((x - left) as f32, (y - top) as f32);
    let first = top as usize * level.width + left as usize;
    let corners = [first, first + 1, first + level.width, first + level.width + 1];
    Some(bilinear(corners.map(|at| level.values[at]), [u, v]))
}

/// The pixels inside the border that overlap with `next`: position, value here, value there.
fn overlap(
    level: &GreyImage,
    next: &GreyImage,
    camera: Pinhole,
    turn: DQuat,
) -> impl Iterator<Item = ((usize, DVec2), f64, f64)> {
    let (w, h) = (level.width, level.height);
    let turn = DMat3::from_quat(turn);
    (1..h - 1).flat_map(move |y| (1..w - 1).map(move |x| (x, y))).filter_map(move |(x, y)| {
        let place = (DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - camera.centre) / camera.focal;
        let ray = turn * place.extend(1.0);
        let other = sample(next, camera.focal * ray.truncate() / ray.z + camera.centre).filter(|_| ray.z > 0.0)?;
        let at = y * w + x;
        Some(((at, place), level.values[at].into(), other.into()))
    })
}

/// The rotation that aligns `next` with this level. `None` if the overlap is too small, or
/// without gradients.
fn aligned(level: &GreyImage, next: &GreyImage, camera: Pinhole, mut turn: DQuat) -> Option<DQuat> {
    let min_pixels = (level.width * level.height / 4) as f64;
    let slope = |at: usize| {
        let slope = |step: usize| 0.5 * f64::from(level.values[at + step] - level.values[at - step]);
        camera.focal * DVec2::new(slope(1), slope(level.width))
    };
    for _ in 0..ITERATIONS {
        // Normal equations with the brightness eliminated: all sums are about their means.
        let (mut n, mut sum_j, mut sum_off) = (0.0, DVec3::ZERO, 0.0);
        let (mut jj, mut j_off) = (DMat3::ZERO, DVec3::ZERO);
        for ((at, DVec2 { x, y }), here, there) in overlap(level, next, camera, turn) {
            let DVec2 { x: right, y: down } = slope(at);
            // A rotation ω moves the point (x, y) by (−xy·ωx + (1 + x²)·ωy − y·ωz, −(1 + y²)·ωx
            // + xy·ωy + x·ωz).
            let j = DVec3::new(
                -right * x * y - down * (1.0 + y * y),
                right * (1.0 + x * x) + down * x * y,
                down * x - right * y,
            );
            let off = here - there;
            n += 1.0;
            sum_j += j;
            sum_off += off;
            jj += DMat3::from_cols(j * j.x, j * j.y, j * j.z);
            j_off += j * off;
        }
        if n < min_pixels {
            return None;
        }
        let jj = jj - DMat3::from_cols(sum_j * sum_j.x, sum_j * sum_j.y, sum_j * sum_j.z) * (1.0 / n);
        let scale = jj.x_axis.x * jj.y_axis.y * jj.z_axis.z;
        if !(jj.determinant() > 1e-6 * scale && scale > 0.0) {
            return None;
        }
        let step = jj.inverse() * (j_off - sum_j * (sum_off / n));
        // A level corrects less than its pixel size.
        let step = step.clamp_length_max(1.0 / camera.focal.min_element());
        turn = (turn * DQuat::from_scaled_axis(step)).normalize();
        if step.length() < CONVERGENCE_RAD {
            break;
        }
    }
    Some(turn)
}

/// Correlation over the overlap.
fn correlation(level: &GreyImage, next: &GreyImage, camera: Pinhole, turn: DQuat) -> f64 {
    let (mut n, mut a, mut b, mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (_, here, there) in overlap(level, next, camera, turn) {
        n += 1.0;
        (a, b) = (a + here, b + there);
        (aa, bb, ab) = (aa + here * here, bb + there * there, ab + here * there);
    }
    let spread = (aa - a * a / n) * (bb - b * b / n);
    if spread > 0.0 { (ab - a * b / n) / spread.sqrt() } else { 0.0 }
}
#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: (u32, u32, f64) = (640, 480, 520.0);

    fn camera() -> Intrinsics {
        let (width_px, height_px, focal) = CAMERA;
        Intrinsics {
            width_px,
            height_px,
            fx_px: focal,
            fy_px: focal,
            cx_px: 330.0,
            cy_px: 236.0,
            ..Intrinsics::default()
        }
    }

    /// A rotated camera's view of waves of many lengths in all directions, code values.
    fn picture_of(camera_from_world: DQuat, brighter: f64) -> ImagePyramid {
        let c = camera();
        let back = camera_from_world.inverse();
        let wave = |d: DVec3, k: f64, axis: DVec3, phase: f64| (k * d.dot(axis) + phase).sin();
        let code = |x: u32, y: u32| {
            let at = (DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - DVec2::new(c.cx_px, c.cy_px)) / c.fx_px;
            let d = (back * at.extend(1.0)).normalize();
            let all = wave(d, 9.0, DVec3::new(1.0, 0.3, 0.2), 0.4)
                + wave(d, 23.0, DVec3::new(-0.2, 1.0, 0.5), 1.7)
                + wave(d, 57.0, DVec3::new(0.8, -0.6, 0.3), 2.9)
                + wave(d, 71.0, DVec3::new(0.5, 0.9, -0.4), 0.1);
            (110.0 + brighter + 22.0 * all).round() as u8
        };
        let codes = (0..c.height_px).flat_map(|y| (0..c.width_px).map(move |x| (x, y)));
        let codes = codes.flat_map(|(x, y)| [code(x, y); 3]).collect();
        ImagePyramid::new(&Pixels::from_u8(c.width_px, c.height_px, codes).unwrap()).unwrap()
    }

    #[test]
    fn known_rotation_is_estimated_about_every_axis_and_in_another_light() {
        let first = picture_of(DQuat::IDENTITY, 0.0);
        for turn in [
            DVec3::ZERO,
            DVec3::new(0.001, -0.002, 0.003),
            DVec3::new(0.05, 0.0, 0.0),
            DVec3::new(-0.03, 0.08, 0.02),
            DVec3::new(0.0, 0.0, 0.15),
        ] {
            let next = picture_of(DQuat::from_scaled_axis(turn), 12.0);
            let rotation = first.rotation_to(&next, &camera()).unwrap();
            // 0.04 px of the picture.
            assert!((rotation - turn).length() < 8e-5, "{turn} {rotation}");
        }
    }

    #[test]
    fn different_pictures_have_no_rotation() {
        let first = picture_of(DQuat::IDENTITY, 0.0);
        assert_eq!(first.rotation_to(&picture_of(DQuat::from_rotation_y(1.5), 0.0), &camera()), None, "another view");
        let (width, height) = (640, 480);
        let flat = Pixels::from_u8(width, height, vec![90; 3 * 640 * 480]).unwrap();
        let flat = ImagePyramid::new(&flat).unwrap();
        assert_eq!(flat.rotation_to(&flat, &camera()), None, "no gradients");
        let small = Pixels::from_u8(320, 240, vec![90; 3 * 320 * 240]).unwrap();
        assert_eq!(first.rotation_to(&ImagePyramid::new(&small).unwrap(), &camera()), None, "another size");
        assert!(ImagePyramid::new(&Pixels::from_u8(30, 8, vec![0; 720]).unwrap()).is_none());
    }
}
