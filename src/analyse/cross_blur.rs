//! Exposure time by cross-blurring two frames of the same scene, each blurred by its own motion.
//!
//! A frame J is the sharp picture blurred along its flow v_J (px/s) for the exposure T, and so is a
//! frame I along v_I. W is I, warped to J. Blurring J along v_I and W along v_J for the same s,
//!
//!   A_s = box(J, s·v_I),   B_s = box(W, s·v_J),
//!
//! gives two equal pictures at s = T (blurs commute), and at no other s if the flows differ. The
//! curve is the mean over patches of 1 − (ΣAB)² / (ΣA²·ΣB²), in linear light, in the band between
//! Gaussians of 1.2 and 3 px. Noise adds to A² and B² but not to AB, and the more the shorter the
//! blur. Therefore the energy of synthetic noise with the camera's σ and correlation, warped and
//! blurred in the same way, is subtracted from both.
//!
//! Residual shifts between J and W are removed patch by patch (Lucas and Kanade 1981; symmetric
//! blurs have no phase). Not modelled: motion that changes during an exposure, flow that changes
//! within 16 px, moving objects, a response that is not the camera's.

use crate::fit::quantile::upper_median;
use glam::{DMat2, DVec2};

use super::blur_frame::{BlurFrame, band_pass};
use super::box_blur::{BLOCK, Block, ExposureGrid, PIXELS, box_blurred, sample_block};
use super::camera_model::CameraModel;
use super::warp_mesh::WarpMesh;
use crate::grey_image::GreyImage;

/// Side of a patch with one correlation, px.
const PATCH: usize = 64;
/// Smallest number of valid blocks in a patch.
const MIN_BLOCKS: usize = 10;
/// Largest minimum of an accepted patch's curve, and its smallest contrast by the median patch's.
const MAX_MINIMUM: f64 = 0.35;
const MIN_CONTRAST: f64 = 0.5;
const MIN_PATCHES: usize = 4;
/// Largest number of patches in a pair: those with the most contrast.
const MAX_PATCHES: usize = 40;
/// Longest shift of a patch, px.
const MAX_SHIFT_PX: f64 = 3.0;

/// Dissimilarity of a pair by exposure.
#[derive(Clone, Debug)]
pub struct BlurCurve {
    /// Mean of 1 − correlation², for each exposure of the grid.
    pub values: Vec<f64>,
    pub patches: usize,
    /// Difference of the flows, px/s: √(‖Σv_J·v_Jᵀ − Σv_I·v_Iᵀ‖ / n).
    pub flow_difference_px_s: f64,
}

#[derive(Clone, Default)]
struct PatchSums {
    ab: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
    blocks: usize,
}

fn dot(a: &Block, b: &Block) -> f64 {
    let mut lanes = [0.0f32; 16];
    for (a, b) in a.as_chunks::<16>().0.iter().zip(b.as_chunks::<16>().0) {
        for (lane, (a, b)) in lanes.iter_mut().zip(a.iter().zip(b)) {
            *lane += a * b;
        }
    }
    lanes.iter().map(|v| f64::from(*v)).sum()
}

/// The pair's curve; `None` where too little of J is visible in I, or too few patches match.
pub fn compare(model: &CameraModel, i: &BlurFrame, j: &BlurFrame, grid: ExposureGrid) -> Option<BlurCurve> {
    let mut mesh = WarpMesh::new(model, i, j);
    let (w, h) = (j.light.width, j.light.height);
    let mut patches: Vec<(usize, usize, f64)> = Vec::new();
    for y in (0..(h + 1).saturating_sub(PATCH)).step_by(PATCH) {
        for x in (0..(w + 1).saturating_sub(PATCH)).step_by(PATCH) {
            let valid = blocks(x, y).filter(|(x, y)| mesh.block(*x, *y).is_some()).count();
            if valid >= MIN_BLOCKS {
                let rows = j.band.values.chunks(w).skip(y).take(PATCH);
                let power: f32 = rows.map(|row| row[x..x + PATCH].iter().map(|v| v * v).sum::<f32>()).sum();
                patches.push((x, y, power.into()));
            }
        }
    }
    if patches.len() < MIN_PATCHES {
        return None;
    }
    patches.sort_by(|a, b| b.2.total_cmp(&a.2).then((a.1, a.0).cmp(&(b.1, b.0))));
    patches.truncate(MAX_PATCHES);
    let band = band_pass(&mesh.warped(&i.light));
    let shifts: Vec<(DVec2, DVec2)> = patches.iter().filter_map(|p| shift(&mesh, &j.band, &band, p.0, p.1)).collect();
    if shifts.len() < MIN_PATCHES {
        return None;
    }
    mesh.apply_shifts(&shifts);
    let band = band_pass(&mesh.warped(&i.light));
    let noise = i.noise.as_ref().map(|noise| band_pass(&mesh.warped(noise)));
    let (mut own, mut other, mut blocks_used) = (DMat2::ZERO, DMat2::ZERO, 0.0);
    let mut all = Vec::new();
    let (mut a, mut b) = (Vec::new(), Vec::new());
    for (x, y, _) in &patches {
        let none = vec![0.0; grid.count];
        let mut sums = PatchSums { ab: none.clone(), a: none.clone(), b: none, blocks: 0 };
        for (x, y) in blocks(*x, *y) {
            let Some(node) = mesh.block(x, y) else { continue };
            if box_blurred(&j.band, x, y, node.other, grid, &mut a).is_none()
                || box_blurred(&band, x, y, node.own, grid, &mut b).is_none()
            {
                continue;
            }
            for s in 0..grid.count {
                sums.ab[s] += dot(&a[s], &b[s]);
                sums.a[s] += dot(&a[s], &a[s]);
                sums.b[s] += dot(&b[s], &b[s]);
            }
            if let (Some(of_j), Some(of_i)) = (&j.noise_band, &noise) {
                box_blurred(of_j, x, y, node.other, grid, &mut a)?;
                box_blurred(of_i, x, y, node.own, grid, &mut b)?;
                for s in 0..grid.count {
                    sums.a[s] -= dot(&a[s], &a[s]);
                    sums.b[s] -= dot(&b[s], &b[s]);
                }
            }
            sums.blocks += 1;
            let outer = |v: DVec2| DMat2::from_cols(v * v.x, v * v.y);
            (own, other) = (own + outer(node.own), other + outer(node.other));
            blocks_used += 1.0;
        }
        if sums.blocks >= MIN_BLOCKS {
            all.push(sums);
        }
    }
    mean_curve(&all, grid).map(|(values, patches)| {
        let difference = (own - other) * (1.0 / blocks_used);
        let flow_difference_px_s = difference.to_cols_array().iter().map(|v| v * v).sum::<f64>().powf(0.25);
        BlurCurve { values, patches, flow_difference_px_s }
    })
}

/// Corners of a patch's blocks.
fn blocks(x: usize, y: usize) -> impl Iterator<Item = (usize, usize)> {
    const SIDE: usize = PATCH / BLOCK;
    (0..SIDE * SIDE).map(move |n| (x + n % SIDE * BLOCK, y + n / SIDE * BLOCK))
}

/// The mean curve over the patches with contrast whose curve has a low minimum, and their number.
fn mean_curve(all: &[PatchSums], grid: ExposureGrid) -> Option<(Vec<f64>, usize)> {
    let power = |sums: &PatchSums| (sums.a[0] * sums.b[0]).max(0.0).sqrt();
    let min_power = MIN_CONTRAST * upper_median(all.iter().map(power)).unwrap_or(0.0);
    let curve = |sums: &PatchSums| -> Option<Vec<f64>> {
        let value = |s: usize| {
            let (a, b) = (sums.a[s], sums.b[s]);
            (a > 0.0 && b > 0.0).then(|| 1.0 - sums.ab[s].max(0.0).powi(2) / (a * b))
        };
        (0..grid.count).map(value).collect()
    };
    let kept: Vec<Vec<f64>> = all
        .iter()
        .filter(|sums| power(sums) > min_power)
        .filter_map(curve)
        .filter(|curve| curve.iter().copied().fold(f64::MAX, f64::min) < MAX_MINIMUM)
        .collect();
    if kept.len() < MIN_PATCHES {
        return None;
    }
    let mean = |s: usize| kept.iter().map(|curve| curve[s]).sum::<f64>() / kept.len() as f64;
    Some(((0..grid.count).map(mean).collect(), kept.len()))
}

/// Shift of W that aligns it to J in a patch, px, after the patch's middle.
fn shift(mesh: &WarpMesh, j: &GreyImage, w: &GreyImage, x: usize, y: usize) -> Option<(DVec2, DVec2)> {
    let mut by = DVec2::ZERO;
    let (mut here, mut there) = ([0.0; PIXELS], [0.0; PIXELS]);
    let (mut left, mut right) = ([0.0; PIXELS], [0.0; PIXELS]);
    let (mut up, mut down) = ([0.0; PIXELS], [0.0; PIXELS]);
    for _ in 0..4 {
        let (mut xx, mut xy, mut yy, mut gx, mut gy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (x, y) in blocks(x, y).filter(|(x, y)| mesh.block(*x, *y).is_some()) {
            if sample_block(j, x, y, DVec2::ZERO, &mut here).is_none()
                || sample_block(w, x, y, by, &mut there).is_none()
            {
                continue;
            }
            sample_block(w, x, y, by - DVec2::X, &mut left)?;
            sample_block(w, x, y, by + DVec2::X, &mut right)?;
            sample_block(w, x, y, by - DVec2::Y, &mut up)?;
            sample_block(w, x, y, by + DVec2::Y, &mut down)?;
            for p in 0..PIXELS {
                let (sx, sy) = (0.5 * (right[p] - left[p]), 0.5 * (down[p] - up[p]));
                let r = here[p] - there[p];
                xx += sx * sx;
                xy += sx * sy;
                yy += sy * sy;
                gx += sx * r;
                gy += sy * r;
            }
        }
        let [xx, xy, yy, gx, gy] = [xx, xy, yy, gx, gy].map(f64::from);
        let determinant = xx * yy - xy * xy;
        if determinant <= 0.01 * (xx + yy).powi(2) / 4.0 {
            return None;
        }
        let step = DVec2::new(yy * gx - xy * gy, xx * gy - xy * gx) / determinant;
        by += step.clamp_length_max(1.0);
        if step.length() < 0.01 {
            break;
        }
    }
    let half = (PATCH / 2) as f64;
    (by.length() < MAX_SHIFT_PX).then(|| (DVec2::new(x as f64 + half, y as f64 + half), by))
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::analyse::state::CameraState;
    use crate::camera::{Curve as Response_, Geometry, NoiseBin, NoiseProfile, Response};
    use crate::fit::twist;
    use crate::frame::Frame;
    use crate::pixels::{DepthMap, Pixels};

    const SIZE: (u32, u32) = (320, 256);
    const FOCAL_PX: f64 = 400.0;
    const WALL_M: f64 = 2.0;
    const TRIED: ExposureGrid = ExposureGrid { step_s: 0.001, count: 36 };

    /// A wall with waves, 2 m in front of a camera that does not turn, with exact motion blur by a
    /// flow for an exposure time. The mean of a wave over v·T is sin(k·v·T/2) / (k·v·T/2) of it.
    fn frame(index: usize, flow: DVec2, exposure_s: f64, noise: f64) -> (Frame, CameraState) {
        let mut draws = scattered_numbers(7);
        let waves: Vec<(DVec2, f64, f64)> = (0..60)
            .map(|_| {
                let (turn, length) = (std::f64::consts::TAU * draws(), 0.15 + 1.0 * draws());
                let k = DVec2::from_angle(turn) * length;
                let half = 0.5 * k.dot(flow) * exposure_s;
                let left = if half.abs() < 1e-9 { 1.0 } else { half.sin() / half };
                (k, std::f64::consts::TAU * draws(), left)
            })
            .collect();
        let mut noisy = scattered_numbers(100 + index as u64);
        let codes = (0..SIZE.0 * SIZE.1)
            .flat_map(|i| {
                let at = DVec2::new(f64::from(i % SIZE.0), f64::from(i / SIZE.0));
                let light: f64 = waves.iter().map(|(k, phase, left)| left * (k.dot(at) + phase).cos()).sum();
                let shaken = noise * (12.0f64.sqrt()) * (noisy() - 0.5);
                [((0.5 + 0.012 * light + shaken) * 65535.0) as u16; 3]
            })
            .collect();
        let depth_m = vec![WALL_M as f32; (SIZE.0 * SIZE.1) as usize];
        let depth = DepthMap { width: SIZE.0, height: SIZE.1, depth_m, timestamp_s: 0.0 };
        let pixels = Pixels::from_u16(SIZE.0, SIZE.1, codes).unwrap();
        let frame = Frame { depth: Some(depth.into()), ..Frame::new(index, 0.0, pixels) };
        // The picture moves against the camera.
        let way = DVec3::new(-flow.x, -flow.y, 0.0) * WALL_M / FOCAL_PX;
        (frame, CameraState { world_from_camera: DAffine3::IDENTITY, twist: twist::twist(way, DVec3::ZERO) })
    }

    fn scattered_numbers(seed: u64) -> impl FnMut() -> f64 {
        let mut n = seed << 32;
        move || {
            n += 1;
            (crate::analyse::view::scattered(n) >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    fn curve(
        own: DVec2,
        other: DVec2,
        exposure_s: f64,
        noise: f64,
        profile: Option<&NoiseProfile>,
    ) -> Option<BlurCurve> {
        let model = CameraModel::new(Geometry::pinhole(SIZE.0, SIZE.1, FOCAL_PX));
        let response = Response { curve: Response_::Linear, ..Response::default() };
        let blurred = |index: usize, flow: DVec2| {
            let (frame, state) = frame(index, flow, exposure_s, noise);
            let depth = frame.depth.as_ref().unwrap().depth_m.clone();
            BlurFrame::new(&model, &frame, (state, twist::Twist::zeros()), depth, &response, profile)
        };
        compare(&model, &blurred(0, other), &blurred(1, own), TRIED)
    }

    fn minimum_ms(curve: &BlurCurve) -> f64 {
        let v = &curve.values;
        let k = (1..v.len() - 1).min_by(|a, b| v[*a].total_cmp(&v[*b])).unwrap();
        k as f64 + 0.5 * (v[k - 1] - v[k + 1]) / (v[k - 1] - 2.0 * v[k] + v[k + 1])
    }

    #[test]
    fn curve_of_two_motions_has_its_minimum_at_the_exposure() {
        for (exposure_s, own, other) in [
            (0.010, DVec2::new(600.0, 0.0), DVec2::new(0.0, 200.0)),
            (0.020, DVec2::new(300.0, 250.0), DVec2::new(0.0, 0.0)),
            (0.005, DVec2::new(0.0, 900.0), DVec2::new(500.0, 0.0)),
        ] {
            let curve = curve(own, other, exposure_s, 0.0, None).unwrap();
            let error = minimum_ms(&curve) / (1e3 * exposure_s) - 1.0;
            assert!(error.abs() < 0.03, "{exposure_s}: {} ms, {:?}", minimum_ms(&curve), curve.values);
            // By hand: for perpendicular flows √‖diag(v², −u²)‖ = ⁴√(v⁴ + u⁴).
            if own.x * own.y == 0.0 {
                let expected = (own.length().powi(4) + other.length().powi(4)).powf(0.25);
                assert!(
                    (curve.flow_difference_px_s / expected - 1.0).abs() < 0.01,
                    "{} {expected}",
                    curve.flow_difference_px_s
                );
            }
        }
    }

    #[test]
    fn curve_of_two_equal_motions_is_flat() {
        let flow = DVec2::new(400.0, 100.0);
        let curve = curve(flow, flow, 0.01, 0.0, None).unwrap();
        assert!(
            curve.flow_difference_px_s < 1.0 && curve.values.iter().all(|value| *value < 0.01),
            "{:?}",
            curve.values
        );
    }

    #[test]
    fn known_noise_is_subtracted() {
        // White noise of σ = 0.02, 5.1 codes of 255, in waves of 0.012.
        let (own, other) = (DVec2::new(900.0, 0.0), DVec2::new(0.0, 300.0));
        let bins = vec![NoiseBin { code: 128.0, sigma: 5.1 }];
        let bins = [bins.clone(), bins.clone(), bins];
        let profile =
            NoiseProfile { example: None, bins, channel_correlation: [0.0; 3], neighbour_correlation: [0.0; 2] };
        let without = curve(own, other, 0.005, 0.02, None).unwrap();
        let with = curve(own, other, 0.005, 0.02, Some(&profile)).unwrap();
        let floor = |curve: &BlurCurve| curve.values.iter().copied().fold(f64::MAX, f64::min);
        assert!(floor(&without) > 0.02, "{:?}", without.values);
        assert!(floor(&with).abs() < 0.25 * floor(&without), "{} {}", floor(&with), floor(&without));
        assert!((minimum_ms(&with) - 5.0).abs() < 0.25, "{} ms", minimum_ms(&with));
    }
}
