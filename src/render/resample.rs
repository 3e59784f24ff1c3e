//! Resamples a curved camera's picture from cube faces.
//!
//! Each pixel is the mean of subsamples, one for each covered texel of the faces and at least nine,
//! each interpolated bilinearly. Faces are drawn slightly wider than 90°, so that no neighbour is
//! needed at their seams.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::camera::curved::CurvedCamera;
use crate::camera::{Distortion, Geometry, Intrinsics};
use crate::interpolation::bilinear_weights;
use crate::parallel::{over_rows, processors};
use crate::pixels::{LinearImage, Rect};

/// Texels of a face beyond its 90°, on each side.
const MARGIN_PX: u32 = 2;

/// A pinhole with a field of view of 90° in both directions over `face_px`, plus a margin.
pub fn square_view(face_px: u32) -> Geometry {
    let (side, half) = (face_px + 2 * MARGIN_PX, 0.5 * f64::from(face_px));
    let centre = half + f64::from(MARGIN_PX);
    let intrinsics = Intrinsics {
        width_px: side,
        height_px: side,
        fx_px: half,
        fy_px: half,
        cx_px: centre,
        cy_px: centre,
        ..Intrinsics::default()
    };
    Geometry::new(intrinsics, Distortion::default())
}
/// Maximum side of a face, px: half a gigabyte.
const MAX_FACE_PX: u32 = 8192;
const MIN_FACE_PX: u32 = 64;
/// Subsamples per side of a pixel.
const SUBSAMPLES_PER_SIDE: std::ops::RangeInclusive<f64> = 3.0..=32.0;

/// A cube face around the camera, by viewing direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CubeFace {
    Front,
    Back,
    Left,
    Right,
    Up,
    Down,
}

impl CubeFace {
    pub const ALL: [Self; 6] = [Self::Front, Self::Back, Self::Left, Self::Right, Self::Up, Self::Down];

    /// The face's x, y and z axes (right, down, forward) in the camera's.
    pub fn axes(self) -> [DVec3; 3] {
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        match self {
            Self::Front => [x, y, z],
            Self::Back => [-x, y, -z],
            Self::Left => [z, y, -x],
            Self::Right => [-z, y, x],
            Self::Up => [x, z, -y],
            Self::Down => [x, -z, y],
        }
    }

    /// The rotation from the camera's axes to the face's.
    pub fn face_from_camera(self) -> DQuat {
        let [x, y, z] = self.axes();
        DQuat::from_mat3(&DMat3::from_cols(x, y, z).transpose())
    }

    /// The face that contains a direction.
    fn of(d: DVec3) -> Self {
        let a = d.abs();
        if a.z >= a.x && a.z >= a.y {
            if d.z > 0.0 { Self::Front } else { Self::Back }
        } else if a.x >= a.y {
            if d.x > 0.0 { Self::Right } else { Self::Left }
        } else if d.y > 0.0 {
            Self::Down
        } else {
            Self::Up
        }
    }
}

/// Assembles a picture from faces.
#[derive(Debug)]
pub struct Resampler<'a> {
    curved: &'a CurvedCamera,
    /// Size of a face's 90°, px.
    face_px: u32,
    needed: Vec<CubeFace>,
}

/// The smallest angle between neighbouring pixels, taking the larger of a pixel's two directions
/// (finer detail is not resolved), and the visible faces.
fn finest_angle_and_faces(curved: &CurvedCamera) -> (f64, Vec<CubeFace>) {
    const STEPS: u32 = 96;
    let size = DVec2::new(curved.width_px.into(), curved.height_px.into());
    let mut finest = f64::INFINITY;
    let mut faces = Vec::new();
    for n in 0..=STEPS * STEPS + 2 * STEPS {
        let at = DVec2::new((n % (STEPS + 1)).into(), (n / (STEPS + 1)).into()) / f64::from(STEPS) * size;
        let Some(d) = curved.unproject(at) else { continue };
        let face = CubeFace::of(d);
        if !faces.contains(&face) {
            faces.push(face);
        }
        let inwards = (0.5 * size - at).signum();
        let step = |to: DVec2| curved.unproject(at + to * inwards).map(|e| e.angle_between(d));
        if let (Some(x), Some(y)) = (step(DVec2::X), step(DVec2::Y)) {
            finest = finest.min(x.max(y));
        }
    }
    (finest, faces)
}

/// Required and available side of the faces, px, if the available side loses detail.
pub fn limits(curved: &CurvedCamera) -> Option<(u32, u32)> {
    let needed_px = lossless_face_px(curved).ceil() as u32;
    (needed_px > MAX_FACE_PX).then_some((needed_px, MAX_FACE_PX))
}

/// Side of a face that preserves all detail of a picture, px.
fn lossless_face_px(curved: &CurvedCamera) -> f64 {
    // A face is coarsest in its centre: side/2 texels per radian. Two texels per pixel.
    4.0 / finest_angle_and_faces(curved).0
}

impl<'a> Resampler<'a> {
    pub fn new(curved: &'a CurvedCamera) -> Self {
        let needed_px = lossless_face_px(curved).ceil();
        let face_px = needed_px.clamp(MIN_FACE_PX.into(), MAX_FACE_PX.into()) as u32;
        Self { curved, face_px, needed: finest_angle_and_faces(curved).1 }
    }

    pub fn needs(&self, face: CubeFace) -> bool {
        self.needed.contains(&face)
    }

    pub fn face_geometry(&self) -> Geometry {
        square_view(self.face_px)
    }

    /// Adds a face's contribution to the picture. All faces together complete it.
    pub fn add(&self, face: CubeFace, drawn: &FaceImage, sum: &mut LinearImage) {
        let row_length = sum.width as usize;
        let [right, down, forward] = face.axes();
        let half = 0.5 * f64::from(self.face_px);
        let centre = half + f64::from(MARGIN_PX);
        let place = |d: DVec3| DVec2::new(d.dot(right), d.dot(down)) / d.dot(forward) * half + centre;
        over_rows(&mut sum.rgba, row_length, processors(), |y, row| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let at = DVec2::new(x as f64, y as f64);
                let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
                    .map(|c| self.curved.unproject(at + DVec2::from(c)));
                let places = match corners {
                    [Some(a), Some(b), Some(c), Some(d)] => {
                        let wide = a.angle_between(b).max(a.angle_between(c)).max(a.angle_between(d));
                        // No subsample of the pixel is farther from the corner than `wide`; faces
                        // end at 54.7°.
                        if a.angle_between(forward) > 0.96 + 2.0 * wide {
                            continue;
                        }
                        // Directions far from the face's axis do not project onto it.
                        let before = [a, b, c, d].into_iter().all(|d| d.dot(forward) > 0.3);
                        if before && is_outside([a, b, c, d].map(place), drawn.rect) {
                            continue;
                        }
                        // At the face's border, texels are twice as fine.
                        (2.0 * wide * half).ceil()
                    }
                    _ => 8.0,
                };
                let places = places.clamp(*SUBSAMPLES_PER_SIDE.start(), *SUBSAMPLES_PER_SIDE.end()) as u32;
                let mut mean = [0.0f32; 4];
                for n in 0..places * places {
                    let inside =
                        DVec2::new(f64::from(n % places) + 0.5, f64::from(n / places) + 0.5) / f64::from(places);
                    let Some(d) = self.curved.unproject(at + inside) else { continue };
                    if CubeFace::of(d) != face {
                        continue;
                    }
                    let texel = sample(drawn, place(d));
                    (0..4).for_each(|c| mean[c] += texel[c]);
                }
                let share = 1.0 / (places * places) as f32;
                (0..4).for_each(|c| pixel[c] += mean[c] * share);
            }
        });
    }
}

/// True if a pixel with these corners on a face is outside the drawn rectangle, with a margin of
/// about its own size.
fn is_outside(corners: [DVec2; 4], rect: Rect) -> bool {
    let low = corners.into_iter().fold(DVec2::INFINITY, DVec2::min);
    let high = corners.into_iter().fold(DVec2::NEG_INFINITY, DVec2::max);
    let around = 2.0 + (high - low);
    let (low, high) = (low - around, high + around);
    high.x < f64::from(rect.x0)
        || high.y < f64::from(rect.y0)
        || low.x > f64::from(rect.x1)
        || low.y > f64::from(rect.y1)
}

/// Bilinear sample, px with pixel centres at +0.5.
fn sample(drawn: &FaceImage, at: DVec2) -> [f32; 4] {
    let (width, corner) = (drawn.width as usize, (at - 0.5).floor());
    let f = (at - 0.5 - corner).as_vec2();
    let first = corner.y as usize * width + corner.x as usize;
    let mut sum = [0.0; 4];
    for (offset, weight) in [0, 1, width, width + 1].into_iter().zip(bilinear_weights(f.to_array())) {
        // The margin contains all subsamples; rounding may exceed it by a negligible amount.
        let texel = drawn.rgba.get(first + offset).copied().unwrap_or_default();
        (0..4).for_each(|c| sum[c] += texel[c].to_f32() * weight);
    }
    sum
}

/// A drawn picture in 16-bit floats, as read back from the GPU.
pub struct FaceImage {
    pub width: u32,
    /// Empty outside this rectangle.
    pub rect: Rect,
    pub rgba: Vec<[half::f16; 4]>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::curved::CurvedProjection;
    use std::f64::consts::PI;

    #[test]
    fn cube_faces_are_rotations_with_the_named_direction() {
        for face in CubeFace::ALL {
            let [x, y, z] = face.axes();
            assert_eq!(x.cross(y), z, "{face:?}");
            assert_eq!(CubeFace::of(z), face);
            assert!((face.face_from_camera() * z - DVec3::Z).length() < 1e-12);
        }
    }

    #[test]
    fn only_visible_faces_are_drawn_at_the_required_resolution() {
        let fisheye = |degrees: f64| CurvedCamera {
            curve: CurvedProjection::Fisheye { fov_rad: degrees.to_radians() },
            width_px: 180,
            height_px: 180,
        };
        assert_eq!(Resampler::new(&fisheye(60.0)).needed, [CubeFace::Front]);
        assert_eq!(Resampler::new(&fisheye(180.0)).needed.len(), 5);
        // 57.3 px per radian along the radius, up to π/2 times that across it far out; in between
        // on diagonals.
        let needed_px = lossless_face_px(&fisheye(180.0));
        assert!((4.0 * 57.29..4.0 * 72.0).contains(&needed_px), "{needed_px}");
        let all = CurvedCamera {
            curve: CurvedProjection::Environment { fov_rad: DVec2::new(2.0 * PI, PI) },
            width_px: 360,
            height_px: 180,
        };
        assert_eq!(Resampler::new(&all).needed.len(), 6);
    }
}
