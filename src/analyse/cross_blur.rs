//! Two frames of the same things, each blurred by its own motion: by how long an exposure both blurs are explained.
//!
//! A frame J is the sharp picture blurred along its flow v_J (px/s) for the exposure T, and so is a frame I along v_I. I seen
//! from J's place is W. Blurring J along v_I and W along v_J for the same s,
//!
//!   A_s = box(J, s·v_I),   B_s = box(W, s·v_J),
//!
//! gives two equal pictures at s = T (blurs commute), and at no other s if the flows differ. The curve is the mean over
//! patches of 1 − (ΣAB)² / (ΣA²·ΣB²), in light, between Gaussians of 1.2 and 3 px. Noise is in A² and in B² but not in AB, and the
//! more of it the shorter the blur: noise of the camera's σ and correlation, warped and blurred alike, is taken off both.
//!
//! What shift is left between J and W is taken out patch by patch (Lucas and Kanade 1981; symmetric blurs have no phase).
//! Not modelled: motion that changes during an exposure, flow that changes within 16 px, things that move, a response other
//! than the camera's own.

use glam::{DMat2, DVec2};

use super::blurred::{Blurred, between};
use super::boxes::{BLOCK, Block, PIXELS, Tried, boxes, part};
use super::eye::Eye;
use super::mesh::Mesh;
use super::pyramid::Plane;
use super::robust::median;

/// Side of what is judged by one correlation, px.
const PATCH: usize = 64;
/// Of a patch's blocks, at least so many must be sound.
const LEAST_BLOCKS: usize = 10;
/// A patch counts whose curve falls below this, with at least this share of the median patch's contrast.
const ALIKE: f64 = 0.35;
const CONTRAST: f64 = 0.5;
const LEAST_PATCHES: usize = 4;
/// Patches of a pair at most: those with most contrast.
const MOST_PATCHES: usize = 40;
/// No shift is longer, px.
const FARTHEST_PX: f64 = 3.0;

/// What a pair says.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Mean of 1 − correlation², by exposure tried.
    pub values: Vec<f64>,
    pub patches: usize,
    /// By how much the flows differ, px/s: √‖Σv_J·v_Jᵀ − Σv_I·v_Iᵀ‖ / n.
    pub apart: f64,
}

#[derive(Clone, Default)]
struct Sums {
    both: Vec<f64>,
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

/// The pair's curve; `None` where too little of J is seen in I, or looks alike.
pub fn compared(eye: &Eye, i: &Blurred, j: &Blurred, tried: Tried) -> Option<Curve> {
    let mut mesh = Mesh::new(eye, i, j);
    let (w, h) = (j.light.width, j.light.height);
    let mut patches: Vec<(usize, usize, f64)> = Vec::new();
    for y in (0..(h + 1).saturating_sub(PATCH)).step_by(PATCH) {
        for x in (0..(w + 1).saturating_sub(PATCH)).step_by(PATCH) {
            let sound = blocks(x, y).filter(|(x, y)| mesh.block(*x, *y).is_some()).count();
            if sound >= LEAST_BLOCKS {
                let rows = j.band.values.chunks(w).skip(y).take(PATCH);
                let power: f32 = rows.map(|row| row[x..x + PATCH].iter().map(|v| v * v).sum::<f32>()).sum();
                patches.push((x, y, power.into()));
            }
        }
    }
    if patches.len() < LEAST_PATCHES {
        return None;
    }
    patches.sort_by(|a, b| b.2.total_cmp(&a.2).then((a.1, a.0).cmp(&(b.1, b.0))));
    patches.truncate(MOST_PATCHES);
    let band = between(&mesh.warped(&i.light));
    let shifts: Vec<(DVec2, DVec2)> = patches.iter().filter_map(|p| shift(&mesh, &j.band, &band, p.0, p.1)).collect();
    if shifts.len() < LEAST_PATCHES {
        return None;
    }
    mesh.shifted(&shifts);
    let band = between(&mesh.warped(&i.light));
    let noise = i.noise.as_ref().map(|noise| between(&mesh.warped(noise)));
    let (mut own, mut other, mut seen) = (DMat2::ZERO, DMat2::ZERO, 0.0);
    let mut all = Vec::new();
    let (mut a, mut b) = (Vec::new(), Vec::new());
    for (x, y, _) in &patches {
        let none = vec![0.0; tried.count];
        let mut sums = Sums { both: none.clone(), a: none.clone(), b: none, blocks: 0 };
        for (x, y) in blocks(*x, *y) {
            let Some(node) = mesh.block(x, y) else { continue };
            if boxes(&j.band, x, y, node.other, tried, &mut a).is_none()
                || boxes(&band, x, y, node.own, tried, &mut b).is_none()
            {
                continue;
            }
            for s in 0..tried.count {
                sums.both[s] += dot(&a[s], &b[s]);
                sums.a[s] += dot(&a[s], &a[s]);
                sums.b[s] += dot(&b[s], &b[s]);
            }
            if let (Some(of_j), Some(of_i)) = (&j.noise_band, &noise) {
                boxes(of_j, x, y, node.other, tried, &mut a)?;
                boxes(of_i, x, y, node.own, tried, &mut b)?;
                for s in 0..tried.count {
                    sums.a[s] -= dot(&a[s], &a[s]);
                    sums.b[s] -= dot(&b[s], &b[s]);
                }
            }
            sums.blocks += 1;
            let outer = |v: DVec2| DMat2::from_cols(v * v.x, v * v.y);
            (own, other, seen) = (own + outer(node.own), other + outer(node.other), seen + 1.0);
        }
        if sums.blocks >= LEAST_BLOCKS {
            all.push(sums);
        }
    }
    judged(&all, tried).map(|(values, patches)| {
        let off = (own - other) * (1.0 / seen);
        let apart = off.to_cols_array().iter().map(|v| v * v).sum::<f64>().powf(0.25);
        Curve { values, patches, apart }
    })
}

fn blocks(x: usize, y: usize) -> impl Iterator<Item = (usize, usize)> {
    const SIDE: usize = PATCH / BLOCK;
    (0..SIDE * SIDE).map(move |n| (x + n % SIDE * BLOCK, y + n / SIDE * BLOCK))
}

/// The mean over the patches that have contrast and look alike.
fn judged(all: &[Sums], tried: Tried) -> Option<(Vec<f64>, usize)> {
    let power = |sums: &Sums| (sums.a[0] * sums.b[0]).max(0.0).sqrt();
    let mut powers: Vec<f64> = all.iter().map(power).collect();
    let least = CONTRAST * median(&mut powers);
    let curve = |sums: &Sums| -> Option<Vec<f64>> {
        let value = |s: usize| {
            let (a, b) = (sums.a[s], sums.b[s]);
            (a > 0.0 && b > 0.0).then(|| 1.0 - sums.both[s].max(0.0).powi(2) / (a * b))
        };
        (0..tried.count).map(value).collect()
    };
    let kept: Vec<Vec<f64>> = all
        .iter()
        .filter(|sums| power(sums) > least)
        .filter_map(curve)
        .filter(|curve| curve.iter().copied().fold(f64::MAX, f64::min) < ALIKE)
        .collect();
    if kept.len() < LEAST_PATCHES {
        return None;
    }
    let mean = |s: usize| kept.iter().map(|curve| curve[s]).sum::<f64>() / kept.len() as f64;
    Some(((0..tried.count).map(mean).collect(), kept.len()))
}

/// How W must be moved to fit J there: the patch's middle, and px.
fn shift(mesh: &Mesh, j: &Plane, w: &Plane, x: usize, y: usize) -> Option<(DVec2, DVec2)> {
    let mut by = DVec2::ZERO;
    let (mut here, mut there) = ([0.0; PIXELS], [0.0; PIXELS]);
    let (mut left, mut right) = ([0.0; PIXELS], [0.0; PIXELS]);
    let (mut up, mut down) = ([0.0; PIXELS], [0.0; PIXELS]);
    for _ in 0..4 {
        let (mut xx, mut xy, mut yy, mut gx, mut gy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (x, y) in blocks(x, y).filter(|(x, y)| mesh.block(*x, *y).is_some()) {
            if part(j, x, y, DVec2::ZERO, &mut here).is_none() || part(w, x, y, by, &mut there).is_none() {
                continue;
            }
            part(w, x, y, by - DVec2::X, &mut left)?;
            part(w, x, y, by + DVec2::X, &mut right)?;
            part(w, x, y, by - DVec2::Y, &mut up)?;
            part(w, x, y, by + DVec2::Y, &mut down)?;
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
    (by.length() < FARTHEST_PX).then(|| (DVec2::new(x as f64 + half, y as f64 + half), by))
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::analyse::state::State;
    use crate::camera::{Curve as Response_, Geometry, NoiseBin, NoiseProfile, Response};
    use crate::fit::twist;
    use crate::frame::{Frame, FrameExposure};
    use crate::pixels::{DepthMap, Pixels};

    const SIZE: (u32, u32) = (320, 256);
    const FOCAL_PX: f64 = 400.0;
    const WALL_M: f64 = 2.0;
    const TRIED: Tried = Tried { step_s: 0.001, count: 36 };

    /// A wall of waves, at 2 m before a camera that does not turn: what it shows blurred while the picture flows for some
    /// time (s), exactly. A wave's mean over v·T is sin(k·v·T/2) / (k·v·T/2) of it.
    fn frame(index: usize, flow: DVec2, exposure_s: f64, noise: f64) -> (Frame, State) {
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
        let frame = Frame {
            index,
            timestamp_s: 0.0,
            pixels: Pixels::from_u16(SIZE.0, SIZE.1, codes).unwrap(),
            depth: Some(DepthMap { width: SIZE.0, height: SIZE.1, depth_m, timestamp_s: 0.0 }),
            exposure: FrameExposure::default(),
            presence: 1.0,
            beside: Vec::new(),
            surfels: Default::default(),
        };
        // What is seen moves against the camera.
        let way = DVec3::new(-flow.x, -flow.y, 0.0) * WALL_M / FOCAL_PX;
        (frame, State { world_from_camera: DAffine3::IDENTITY, twist: twist::twist(way, DVec3::ZERO) })
    }

    fn scattered_numbers(seed: u64) -> impl FnMut() -> f64 {
        let mut n = seed << 32;
        move || {
            n += 1;
            (crate::analyse::view::scattered(n) >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    fn curve(own: DVec2, other: DVec2, exposure_s: f64, noise: f64, profile: Option<&NoiseProfile>) -> Option<Curve> {
        let eye = Eye::new(Geometry::pinhole(SIZE.0, SIZE.1, FOCAL_PX));
        let response = Response { curve: Response_::Linear, ..Response::default() };
        let blurred = |index: usize, flow: DVec2| {
            let (frame, state) = frame(index, flow, exposure_s, noise);
            let depth = frame.depth.as_ref().unwrap().depth_m.clone();
            Blurred::new(&eye, &frame, (state, twist::Twist::zeros()), depth, &response, profile)
        };
        compared(&eye, &blurred(0, other), &blurred(1, own), TRIED)
    }

    fn least_ms(curve: &Curve) -> f64 {
        let v = &curve.values;
        let k = (1..v.len() - 1).min_by(|a, b| v[*a].total_cmp(&v[*b])).unwrap();
        k as f64 + 0.5 * (v[k - 1] - v[k + 1]) / (v[k - 1] - 2.0 * v[k] + v[k + 1])
    }

    #[test]
    fn two_motions_before_a_wall_agree_at_the_exposure() {
        for (exposure_s, own, other) in [
            (0.010, DVec2::new(600.0, 0.0), DVec2::new(0.0, 200.0)),
            (0.020, DVec2::new(300.0, 250.0), DVec2::new(0.0, 0.0)),
            (0.005, DVec2::new(0.0, 900.0), DVec2::new(500.0, 0.0)),
        ] {
            let found = curve(own, other, exposure_s, 0.0, None).unwrap();
            let off = least_ms(&found) / (1e3 * exposure_s) - 1.0;
            assert!(off.abs() < 0.03, "{exposure_s}: {} ms, {:?}", least_ms(&found), found.values);
            // By hand: of two flows across each other √‖diag(v², −u²)‖ = ⁴√(v⁴ + u⁴).
            if own.x * own.y == 0.0 {
                let expected = (own.length().powi(4) + other.length().powi(4)).powf(0.25);
                assert!((found.apart / expected - 1.0).abs() < 0.01, "{} {expected}", found.apart);
            }
        }
    }

    #[test]
    fn one_motion_twice_says_nothing() {
        let flow = DVec2::new(400.0, 100.0);
        let found = curve(flow, flow, 0.01, 0.0, None).unwrap();
        assert!(found.apart < 1.0 && found.values.iter().all(|value| *value < 0.01), "{:?}", found.values);
    }

    #[test]
    fn noise_that_is_known_is_taken_off() {
        // White noise of σ = 0.02, 5.1 codes of 255, in waves of 0.012.
        let (own, other) = (DVec2::new(900.0, 0.0), DVec2::new(0.0, 300.0));
        let bins = vec![NoiseBin { code: 128.0, sigma: 5.1 }];
        let bins = [bins.clone(), bins.clone(), bins];
        let profile = NoiseProfile { bins, channel_correlation: [0.0; 3], neighbour_correlation: [0.0; 2] };
        let without = curve(own, other, 0.005, 0.02, None).unwrap();
        let with = curve(own, other, 0.005, 0.02, Some(&profile)).unwrap();
        let floor = |curve: &Curve| curve.values.iter().copied().fold(f64::MAX, f64::min);
        assert!(floor(&without) > 0.02, "{:?}", without.values);
        assert!(floor(&with).abs() < 0.25 * floor(&without), "{} {}", floor(&with), floor(&without));
        assert!((least_ms(&with) - 5.0).abs() < 0.25, "{} ms", least_ms(&with));
    }
}
