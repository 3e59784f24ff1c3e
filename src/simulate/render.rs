//! Renders linear light: rays per pixel, through the lens and over the exposure.

use glam::{DMat3, DVec2, DVec3};

use crate::camera::{Geometry, LensModel};
use crate::tracking::PoseTrack;

use super::SimulateError;
use super::random::Random;
use super::site::Site;
use crate::parallel::over_rows;

/// A picture before sensor and encoding: linear light (1 is camera white, not clipped above), and
/// depth (z in the camera's axes, metres; in a 360° picture the distance) at pixel centres in the
/// middle of each row's exposure. Both are row by row, 0 where there is nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedPicture {
    pub width: u32,
    pub height: u32,
    pub light: Vec<[f32; 3]>,
    pub depth_m: Vec<f32>,
    /// Longest motion across the picture during one row's exposure, px.
    pub max_blur_px: f64,
}

/// Parameters of one picture.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot {
    /// The middle of the middle row's exposure, seconds.
    pub timestamp_s: f64,
    pub exposure_time_s: f64,
    /// Light samples per pixel. A moving pixel takes two per pixel of its motion, if that is more.
    pub samples: u32,
    /// 0 for a pinhole; otherwise a thin lens focused at `focus_distance_m`.
    pub aperture_diameter_m: f64,
    pub focus_distance_m: f64,
    pub seed: u64,
    /// Key of the sample positions, together with the seed.
    pub frame: u64,
}

/// Golden ratio conjugate. Its multiples modulo 1 fill an interval evenly, whatever their number.
const GOLDEN_RATIO_CONJUGATE: f64 = 0.618_033_988_749_894_9;
/// Maximum number of samples of a moving pixel.
const MAX_SAMPLES: f64 = 4096.0;
/// Interval of evaluated poses, linearly interpolated between, seconds.
const POSE_INTERVAL_S: f64 = 0.000_25;

/// Rays through the corners of all pixels: at z = 1, or of unit length for lenses of 180° or more;
/// 0 outside a fisheye's image circle. Rays inside a pixel are interpolated. The error is below
/// 0.001 px for a lens that bends a line by 0.6 px per 100 px.
#[derive(Clone, Debug)]
pub struct SimulatedLens {
    geometry: Geometry,
    corners: Vec<DVec3>,
}

impl SimulatedLens {
    /// Fails if the distortion has no inverse in the picture.
    pub fn new(geometry: Geometry) -> Result<Self, SimulateError> {
        let (w, h) = (geometry.intrinsics.width_px, geometry.intrinsics.height_px);
        let mut corners = Vec::with_capacity((w as usize + 1) * (h as usize + 1));
        for y in 0..=h {
            for x in 0..=w {
                let at = DVec2::new(x.into(), y.into());
                corners.push(match geometry.distortion.model {
                    LensModel::Opencv | LensModel::OpencvRational | LensModel::Fov | LensModel::StMap => {
                        geometry.unproject(at).ok_or(SimulateError::Lens { x, y })?
                    }
                    _ => geometry.direction(at).unwrap_or_default(),
                });
            }
        }
        Ok(Self { geometry, corners })
    }

    /// True if a pixel lies entirely within the lens's field of view.
    fn is_in_view(&self, x: usize, y: usize) -> bool {
        let stride = self.geometry.intrinsics.width_px as usize + 1;
        [0, 1, stride, stride + 1].iter().all(|corner| self.corners[y * stride + x + corner] != DVec3::ZERO)
    }

    /// Depth per unit of a ray's parameter: the length in a 360° picture, otherwise the component
    /// along the axis, at least 0.
    fn depth_per_t(&self, ray: DVec3) -> f64 {
        match self.geometry.distortion.model {
            LensModel::Opencv | LensModel::OpencvRational | LensModel::Fov | LensModel::StMap => 1.0,
            LensModel::OpencvFisheye | LensModel::ThinPrismFisheye => ray.z.max(0.0),
            LensModel::Equirectangular => ray.length(),
        }
    }

    fn ray(&self, x: usize, y: usize, inside: DVec2) -> DVec3 {
        let stride = self.geometry.intrinsics.width_px as usize + 1;
        let upper = y * stride + x;
        let row = |i: usize| self.corners[i].lerp(self.corners[i + 1], inside.x);
        row(upper).lerp(row(upper + stride), inside.y)
    }
}

/// The camera's position and axes at fixed intervals over one frame.
struct ShutterPoses {
    start_s: f64,
    /// Position in the world and `world_from_camera`.
    poses: Vec<(DVec3, DMat3)>,
}

impl ShutterPoses {
    fn new(track: &PoseTrack, start_s: f64, end_s: f64) -> Self {
        let steps = ((end_s - start_s) / POSE_INTERVAL_S).ceil() as usize + 1;
        let pose = |i: usize| {
            let pose = track.at_or_nearest(start_s + i as f64 * POSE_INTERVAL_S).unwrap_or(crate::pose::Pose::IDENTITY);
            (pose.position_in_world_m(), DMat3::from_quat(pose.world_from_camera_rotation()))
        };
        Self { start_s, poses: (0..=steps).map(pose).collect() }
    }

    fn between(&self, time_s: f64) -> (usize, f64) {
        let at = ((time_s - self.start_s) / POSE_INTERVAL_S).clamp(0.0, (self.poses.len() - 2) as f64);
        (at as usize, at.fract())
    }

    /// Origin and direction in the world of a camera ray at a time.
    fn ray(&self, time_s: f64, ray: DVec3) -> (DVec3, DVec3) {
        let (i, f) = self.between(time_s);
        let ((p0, m0), (p1, m1)) = (self.poses[i], self.poses[i + 1]);
        (p0.lerp(p1, f), (m0 * ray).lerp(m1 * ray, f))
    }

    /// Origin and direction in the world of the ray through a point of the aperture, metres from
    /// its centre along the camera's axes. The ray's z in the camera's axes is unchanged.
    fn ray_through(&self, time_s: f64, ray: DVec3, point_m: DVec2, focus_distance_m: f64) -> (DVec3, DVec3) {
        let (i, f) = self.between(time_s);
        let ((p0, m0), (p1, m1)) = (self.poses[i], self.poses[i + 1]);
        let from = point_m.extend(0.0);
        let ray = ray - from / focus_distance_m;
        (p0.lerp(p1, f) + (m0 * from).lerp(m1 * from, f), (m0 * ray).lerp(m1 * ray, f))
    }

    fn to_camera(&self, time_s: f64, point_in_world: DVec3) -> DVec3 {
        let (i, f) = self.between(time_s);
        let local = |(p, m): (DVec3, DMat3)| m.transpose() * (point_in_world - p);
        local(self.poses[i]).lerp(local(self.poses[i + 1]), f)
    }
}

/// Light, depth and motion of one pixel.
#[derive(Clone, Copy, Default)]
struct ShotPixel {
    light: [f32; 3],
    depth_m: f32,
    blur_px: f64,
}

/// Renders a picture. The result does not depend on the number of threads.
pub fn shoot(
    site: &Site,
    lens: &SimulatedLens,
    track: &PoseTrack,
    snapshot: &Snapshot,
    threads: usize,
) -> SimulatedPicture {
    let g = &lens.geometry;
    let (w, h) = (g.intrinsics.width_px, g.intrinsics.height_px);
    let reach_s = 0.5 * (g.intrinsics.readout_time_s + snapshot.exposure_time_s);
    let shutter = ShutterPoses::new(track, snapshot.timestamp_s - reach_s, snapshot.timestamp_s + reach_s);
    let mut pixels = vec![ShotPixel::default(); w as usize * h as usize];
    over_rows(&mut pixels, w as usize, threads, |y, row| {
        for (x, pixel) in row.iter_mut().enumerate() {
            *pixel = expose(site, lens, &shutter, snapshot, x, y);
        }
    });
    SimulatedPicture {
        width: w,
        height: h,
        light: pixels.iter().map(|p| p.light).collect(),
        depth_m: pixels.iter().map(|p| p.depth_m).collect(),
        max_blur_px: pixels.iter().map(|p| p.blur_px).fold(0.0, f64::max),
    }
}

/// The ray through a pixel's centre in the middle of its row's exposure, in the world.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub time_s: f64,
    pub origin: DVec3,
    pub direction: DVec3,
    /// The camera's x axis.
    pub right: DVec3,
}

/// Evaluates a function for each pixel's central ray; the default outside the lens's field of view.
pub fn map_central_rays<T: Clone + Default + Send>(
    lens: &SimulatedLens,
    track: &PoseTrack,
    snapshot: &Snapshot,
    threads: usize,
    of: impl Fn(&Ray) -> T + Sync,
) -> Vec<T> {
    let i = &lens.geometry.intrinsics;
    let (w, h) = (i.width_px as usize, i.height_px as usize);
    let reach_s = 0.5 * (i.readout_time_s + snapshot.exposure_time_s);
    let shutter = ShutterPoses::new(track, snapshot.timestamp_s - reach_s, snapshot.timestamp_s + reach_s);
    let mut values = vec![T::default(); w * h];
    over_rows(&mut values, w, threads, |y, row| {
        let time_s = snapshot.timestamp_s + lens.geometry.row_time_s(y as f64 + 0.5);
        let right = shutter.ray(time_s, DVec3::X).1;
        for (x, value) in row.iter_mut().enumerate().filter(|(x, _)| lens.is_in_view(*x, y)) {
            let (origin, direction) = shutter.ray(time_s, lens.ray(x, y, DVec2::splat(0.5)));
            *value = of(&Ray { time_s, origin, direction, right });
        }
    });
    values
}

fn expose(
    site: &Site,
    lens: &SimulatedLens,
    shutter: &ShutterPoses,
    snapshot: &Snapshot,
    x: usize,
    y: usize,
) -> ShotPixel {
    if !lens.is_in_view(x, y) {
        return ShotPixel::default();
    }
    // All pixels of a row are exposed at the time of its centre.
    let middle_s = snapshot.timestamp_s + lens.geometry.row_time_s(y as f64 + 0.5);
    let centre = lens.ray(x, y, DVec2::splat(0.5));
    let (origin, direction) = shutter.ray(middle_s, centre);
    let ahead = site.light(origin, direction, middle_s);
    let blur_px = ahead.map_or(0.0, |(_, t)| {
        let seen_at = |time_s| lens.geometry.project(shutter.to_camera(time_s, origin + direction * t));
        let half_s = 0.5 * snapshot.exposure_time_s;
        match (seen_at(middle_s - half_s), seen_at(middle_s + half_s)) {
            (Some(a), Some(b)) => lens.geometry.displacement_px(a, b).length(),
            _ => 0.0,
        }
    });

    // Samples in (x, y, time): time is stratified; x and y follow Roberts' R2 sequence (the
    // generalised golden ratio, 1.3247…), which together with the strata fills all three evenly,
    // randomly shifted per pixel. Points on the aperture: the radius by the golden ratio, the angle
    // random.
    let count = f64::from(snapshot.samples.max(1)).max((2.0 * blur_px).ceil().min(MAX_SAMPLES));
    let mut random = Random::new([snapshot.seed, snapshot.frame, x as u64, y as u64]);
    let shift = DVec2::new(random.uniform(), random.uniform());
    let mut sum = [0.0f32; 3];
    for i in 0..count as u32 {
        let i = f64::from(i);
        let inside = (shift + i * DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_3)).fract();
        let when = (i + random.uniform()) / count - 0.5;
        let (time_s, ray) = (middle_s + when * snapshot.exposure_time_s, lens.ray(x, y, inside));
        let (origin, direction) = if snapshot.aperture_diameter_m > 0.0 {
            // Uniform on the disc: area grows with the radius squared.
            let turn = std::f64::consts::TAU * random.uniform();
            let radius_m = 0.5 * snapshot.aperture_diameter_m * (GOLDEN_RATIO_CONJUGATE * i + shift.x).fract().sqrt();
            shutter.ray_through(time_s, ray, radius_m * DVec2::from_angle(turn), snapshot.focus_distance_m)
        } else {
            shutter.ray(time_s, ray)
        };
        if let Some((light, _)) = site.light(origin, direction, time_s) {
            for (s, l) in sum.iter_mut().zip(light) {
                *s += l;
            }
        }
    }
    ShotPixel {
        light: sum.map(|s| s / count as f32),
        depth_m: ahead.map_or(0.0, |(_, t)| (t * lens.depth_per_t(centre)) as f32),
        blur_px,
    }
}
