//! Simulated photographs of a printed sheet by a camera with known parameters. Shares no code with
//! the code under test except the row threads: lens inversion and texture lookup are separate
//! implementations.

#![allow(dead_code, reason = "each test file uses some of it")]

use crate::srgb;
use glam::{DMat3, DQuat, DVec2, DVec3};
use locard::parallel::{over_rows, processors};

/// A pinhole camera of 640 by 480 px with Brown and Conrady's distortion, and the codes of sRGB.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    pub focal_px: f64,
    pub centre_px: DVec2,
    pub k1: f64,
    pub k2: f64,
    pub p1: f64,
    pub p2: f64,
    /// Readout time from the first row to the last, s.
    pub readout_s: f64,
}

pub const SIZE: (u32, u32) = (640, 480);

pub const CAMERA: Camera = Camera {
    focal_px: 560.0,
    centre_px: DVec2::new(323.0, 236.0),
    k1: -0.21,
    k2: 0.06,
    p1: 0.0011,
    p2: -0.0007,
    readout_s: 0.0,
};

impl Camera {
    /// The camera as the text of a profile.
    pub fn profile(&self) -> String {
        let Self { focal_px: f, centre_px: c, k1, k2, p1, p2, readout_s } = self;
        format!(
            "version = 1\n[camera]\nwidth_px = 640\nheight_px = 480\nfx_px = {f:?}\nfy_px = {f:?}\ncx_px = {:?}\ncy_px = {:?}\nreadout_time_s = {readout_s:?}\n[camera.distortion]\nk1 = {k1:?}\nk2 = {k2:?}\np1 = {p1:?}\np2 = {p2:?}\n",
            c.x, c.y
        )
    }

    /// Projects a ray x/z, y/z, px.
    pub fn project_ray(&self, ray: DVec2) -> DVec2 {
        let r2 = ray.dot(ray);
        let radial = 1.0 + self.k1 * r2 + self.k2 * r2 * r2;
        let x = ray.x * radial + 2.0 * self.p1 * ray.x * ray.y + self.p2 * (r2 + 2.0 * ray.x * ray.x);
        let y = ray.y * radial + self.p1 * (r2 + 2.0 * ray.y * ray.y) + 2.0 * self.p2 * ray.x * ray.y;
        DVec2::new(x, y) * self.focal_px + self.centre_px
    }

    /// Unprojects a position, px, to the ray x/z, y/z.
    fn ray(&self, at: DVec2) -> DVec2 {
        let target = (at - self.centre_px) / self.focal_px;
        let mut ray = target;
        for _ in 0..12 {
            ray += target - (self.project_ray(ray) - self.centre_px) / self.focal_px;
        }
        ray
    }
}

/// Rays through all pixel corners of a camera. Lens inversion takes most of a photograph's time;
/// the rays are computed once for all photographs of a camera.
pub struct Rays {
    camera: Camera,
    /// Row by row, `SIZE.0 + 1` corners each.
    corners: Vec<DVec2>,
}

impl Rays {
    pub fn of(camera: &Camera) -> Self {
        let columns = SIZE.0 as usize + 1;
        let mut corners = vec![DVec2::ZERO; columns * (SIZE.1 as usize + 1)];
        over_rows(&mut corners, columns, processors(), |y, row| {
            row.iter_mut().enumerate().for_each(|(x, ray)| *ray = camera.ray(DVec2::new(x as f64, y as f64)));
        });
        Self { camera: *camera, corners }
    }
}

/// Camera pose: position and axes (x right, y down, z forward) in world coordinates, as columns.
#[derive(Clone, Copy, Debug)]
pub struct CameraPose {
    pub at_m: DVec3,
    pub axes: DMat3,
}

impl CameraPose {
    /// A pose at `at_m` facing `target_m`, rolled about the optical axis.
    pub fn look_at(at_m: DVec3, target_m: DVec3, roll_rad: f64) -> Self {
        let ahead = (target_m - at_m).normalize();
        let side = if ahead.cross(DVec3::Z).length() > 1e-3 { ahead.cross(DVec3::Z) } else { DVec3::X };
        let right = side.normalize();
        let axes = DMat3::from_cols(right, ahead.cross(right), ahead) * DMat3::from_rotation_z(roll_rad);
        Self { at_m, axes }
    }

    /// Projects a world point, px.
    pub fn project(&self, camera: &Camera, point_m: DVec3) -> DVec2 {
        let own = self.axes.transpose() * (point_m - self.at_m);
        camera.project_ray(own.truncate() / own.z)
    }

    pub fn quaternion(&self) -> DQuat {
        DQuat::from_mat3(&self.axes)
    }
}

/// A sheet in the world's plane z = 0. The world's origin is `origin_mm` from the sheet's lower
/// left corner.
pub struct Sheet {
    pub width: usize,
    pub height: usize,
    pub codes: Vec<u8>,
    pub dots_per_mm: f64,
    pub origin_mm: DVec2,
}

impl Sheet {
    /// The A4 sheet of `locard board` at 300 dots per inch, from its grey codes.
    pub fn of(width: usize, height: usize, codes: Vec<u8>) -> Self {
        // The tags span 235 mm, starting 12 mm below the upper edge.
        Self {
            width,
            height,
            codes,
            dots_per_mm: 300.0 / 25.4,
            origin_mm: DVec2::new(105.0, 297.0 - 12.0 - 0.5 * 235.0),
        }
    }

    /// Linear light at a position on the sheet, m from the origin; grey outside of it.
    fn light(&self, lights: &[f64], at_m: DVec2) -> f64 {
        let dots = (1e3 * at_m + self.origin_mm) * self.dots_per_mm;
        let (x, y) = (dots.x, self.height as f64 - dots.y);
        if x < 0.0 || y < 0.0 || x >= self.width as f64 || y >= self.height as f64 {
            return 0.12;
        }
        lights[usize::from(self.codes[y as usize * self.width + x as usize])]
    }

    /// Returns the RGB codes of a photograph with `samples`² rays per pixel and noise of standard
    /// deviation `sigma`, codes. `place` is the pose as a function of the time after the middle
    /// row's, s.
    pub fn photograph(
        &self,
        camera: &Camera,
        samples: u32,
        sigma: f64,
        seed: u64,
        place: impl Fn(f64) -> CameraPose + Sync,
    ) -> Vec<u8> {
        self.photograph_by_rays(&Rays::of(camera), samples, sigma, seed, place)
    }

    /// [`Sheet::photograph`] with precomputed rays, interpolated linearly within a pixel.
    pub fn photograph_by_rays(
        &self,
        rays: &Rays,
        samples: u32,
        sigma: f64,
        seed: u64,
        place: impl Fn(f64) -> CameraPose + Sync,
    ) -> Vec<u8> {
        let lights: Vec<f64> = (0..=255).map(|code| 0.02 + 0.86 * srgb::decode(f64::from(code) / 255.0)).collect();
        let width = SIZE.0 as usize;
        let mut codes = vec![0u8; 3 * width * SIZE.1 as usize];
        over_rows(&mut codes, 3 * width, processors(), |y, pixels| {
            let place = place(((y as f64 + 0.5) / f64::from(SIZE.1) - 0.5) * rays.camera.readout_s);
            for (x, pixel) in pixels.chunks_mut(3).enumerate() {
                let at = y * (width + 1) + x;
                let ray = rays.corners[at];
                let (across, down) = (rays.corners[at + 1] - ray, rays.corners[at + width + 1] - ray);
                let mut sum = 0.0;
                for i in 0..samples * samples {
                    let part = DVec2::new(f64::from(i % samples) + 0.5, f64::from(i / samples) + 0.5);
                    let part = part / f64::from(samples);
                    let towards = place.axes * (ray + across * part.x + down * part.y).extend(1.0);
                    let far = -place.at_m.z / towards.z;
                    let hit = (place.at_m + towards * far).truncate();
                    sum += if far > 0.0 { self.light(&lights, hit) } else { 0.3 };
                }
                let light = sum / f64::from(samples * samples);
                let noise = sigma * normal(seed, (y * width + x) as u64);
                pixel.fill((255.0 * srgb::encode(light) + noise).round().clamp(0.0, 255.0) as u8);
            }
        });
        codes
    }
}

/// Approximately normal hash of the arguments: the sum of twelve uniform numbers, mean 0 and
/// variance 1.
fn normal(seed: u64, n: u64) -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ n.wrapping_mul(0xd1b5_4a32_d192_ed03);
    let mut sum = -6.0;
    for _ in 0..12 {
        state ^= state >> 30;
        state = state.wrapping_mul(0xbf58_476d_1ce4_e5b9).wrapping_add(0x94d0_49bb_1331_11eb);
        sum += (state >> 11) as f64 / (1u64 << 53) as f64;
    }
    sum
}
