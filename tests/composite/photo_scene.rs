//! Virtual objects in a photograph: at each of its moments, and behind real surfaces.

use std::borrow::Borrow;

use crate::board::{DEPTH_M, FOCAL_PX, board, sideways};
use crate::gpu;
use glam::DVec3;
use locard::camera::{Camera, Opening, SummedExposure};
use locard::compositor::{Compositor, Settings};
use locard::depth::{DepthGrid, Proxies, reprojected_at_frame};
use locard::frame::Frame;
use locard::params::Value;
use locard::photo::{Framing, PhotoExposure, RealPart, Standpoint, SummedFrameOcclusion, take};
use locard::pixels::{DepthMap, Pixels};
use locard::plane::Plane;
use locard::scene::Scene;
use locard::tracking::PoseTrack;

/// Conditions of a photograph besides the picture.
struct PhotoConditions<'a> {
    camera: Camera,
    settings: Settings,
    track: &'a PoseTrack,
    summed: &'a [SummedExposure],
    depth: Option<&'a DepthMap>,
    opening: Option<Opening>,
    time_s: f64,
}

impl PhotoConditions<'_> {
    /// Takes the photograph. Also returns the reported progress shares.
    fn photo(&self, scene: Scene, pixels: Pixels) -> (Pixels, Vec<f64>) {
        self.photo_of(scene, &[(1.0, pixels)], &[])
    }

    /// [`Self::photo`] of several weighted frames, with the occluding depth of each.
    fn photo_of(
        &self,
        scene: Scene,
        frames: &[(f64, impl Borrow<Pixels>)],
        hiding: &[(f64, DepthGrid)],
    ) -> (Pixels, Vec<f64>) {
        let recorded = self.camera.geometry.clone().unwrap();
        let framing = Framing::new(&recorded, None, None, f64::INFINITY, None).unwrap();
        let gpu = gpu::gpu();
        let mut compositor = Compositor::new(gpu.clone(), scene);
        let real = RealPart::new(frames, &self.camera.response, &framing.framed, framing.size(), [0.0; 2]);
        let depth_m = self.depth.and_then(|map| reprojected_at_frame(&recorded, map, self.track, 0.0));
        let standpoint = Standpoint {
            camera: &self.camera,
            settings: &self.settings,
            recorded: &recorded,
            track: self.track,
            interval_s: 0.1,
            frame: 3,
            timestamp_s: 0.0,
            exposure: Default::default(),
            opacity: 1.0,
            summed: self.summed,
            depth_m: depth_m.as_deref(),
            summed_occlusion: hiding,
        };
        let exposed = PhotoExposure { opening: self.opening, time_s: self.time_s, over_ev: 0.0, iso_ratio: 1.0 };
        let mut progress = Vec::new();
        let told_all = |share| {
            progress.push(share);
            true
        };
        let taken = take(&mut compositor, &standpoint, &framing, real, &exposed, told_all).unwrap();
        (taken.pixels, progress)
    }
}

/// Three frames a tenth of a second apart, 10 ms each: the virtual part appears three times, as the
/// real one does.
#[test]
fn slow_shutter_exposes_objects_and_footage_at_the_same_moments() {
    let summed = [-0.1, 0.0, 0.1].map(|time_s| SummedExposure { time_s, exposure_s: 0.01, weight: 1.0 / 3.0 });
    let of = PhotoConditions {
        camera: gpu::camera(&gpu::pinhole(160, 60, FOCAL_PX), 0.02),
        settings: Settings::default(),
        track: &sideways([400.0, 0.0]),
        summed: &summed,
        depth: None,
        opening: None,
        time_s: 0.3,
    };
    // 12 px wide, displaced by 40 px each time, blurred over 4.
    let (taken, _) = of.photo(board([6.0, 20.0], 0.5), gpu::grey(160, 60, 0));
    let light = |x: u32| of.camera.response.decode(f64::from(taken.at(x, 30)[0]) / 255.0);
    let full = light(80);
    assert!((full - 0.5 / 3.0).abs() < 0.01, "{full}");
    for x in 20..140u32 {
        let beside = [40.0, 80.0, 120.0].map(|at: f64| (f64::from(x) + 0.5 - at).abs());
        let nearest = beside.into_iter().fold(f64::INFINITY, f64::min);
        // Covered all the time up to 4 px from the middle, never from 8 px on.
        let expected = full * ((8.0 - nearest) / 4.0).clamp(0.0, 1.0);
        assert!((light(x) - expected).abs() < 0.06 * full + 0.002, "{x}: {}, by hand {expected}", light(x));
    }
}

/// A screen whose edge moves 40 px from frame to frame, in front of a board that moves 20. Where
/// the edge is on one side for a share of the time, the board is visible for that share.
#[test]
fn object_behind_a_moving_edge_is_visible_for_a_share_of_the_exposure() {
    let times = [-0.1, 0.0, 0.1];
    let summed = times.map(|time_s| SummedExposure { time_s, exposure_s: 0.01, weight: 1.0 / 3.0 });
    let geometry = gpu::pinhole(160, 60, FOCAL_PX);
    let track = sideways([200.0, 0.0]);
    let frames = times.map(|t| {
        // At half of the board's distance it moves twice as fast.
        let is_screen = |i: u32| f64::from(i % 160) < 80.0 + 400.0 * t;
        let codes = (0..160 * 60).flat_map(|i| [if is_screen(i) { 10 } else { 120 }; 3]).collect();
        let depth_m = (0..160 * 60).map(|i| if is_screen(i) { 0.5 } else { 1.5 } * DEPTH_M as f32).collect();
        let depth = DepthMap { width: 160, height: 60, depth_m, timestamp_s: t };
        Frame { depth: Some(depth.into()), ..gpu::frame(3, t, Pixels::from_u8(160, 60, codes).unwrap()) }
    });
    let depth = frames[1].depth.as_ref().unwrap();
    // With a lens, the screen's circles of confusion are 2 px wide.
    let lens =
        Opening { diameter_m: 2.0 * DEPTH_M / FOCAL_PX, focus_distance_m: DEPTH_M, blades: 0, rotation_rad: 0.0 };
    for opening in [None, Some(lens)] {
        let of = PhotoConditions {
            camera: gpu::camera(&geometry, 0.01),
            settings: Settings::default(),
            track: &track,
            summed: &summed,
            depth: Some(depth),
            opening,
            time_s: 0.3,
        };
        let response = &of.camera.response;
        let framing = Framing::new(&geometry, None, None, f64::INFINITY, None).unwrap();
        let none = Proxies::default();
        let hiding = SummedFrameOcclusion::new(&geometry, &track, &framing, response, (depth, &none, &[]));
        let hiding: Vec<_> = frames.iter().map(|frame| (frame.timestamp_s, hiding.of(frame).unwrap())).collect();
        let pixels = frames.each_ref().map(|frame| (1.0 / 3.0, frame.pixels.clone()));
        let (taken, _) = of.photo_of(board([70.0, 20.0], 0.5), &pixels, &hiding);
        let decoded = |code: f64| response.decode(code / 255.0);
        for (columns, visible_share) in [(46..74, 1.0 / 3.0), (86..114, 2.0 / 3.0)] {
            let real = (1.0 - visible_share) * decoded(10.0) + visible_share * decoded(120.0);
            let expected = 0.5 * visible_share + (1.0 - visible_share) * real;
            for x in columns {
                let light = decoded(taken.at(x, 30)[1].into());
                assert!((light - expected).abs() < 0.01, "{opening:?}, {x}: {light}, by hand {expected}");
            }
        }
    }
}

#[test]
fn long_exposure_reports_its_progress() {
    let of = PhotoConditions {
        camera: gpu::camera(&gpu::pinhole(160, 60, FOCAL_PX), 0.02),
        settings: gpu::settings(&[("motion_blur", "method", Value::Text("reference".to_owned()))]),
        track: &sideways([400.0, 0.0]),
        summed: &[],
        depth: None,
        opening: None,
        time_s: 0.2,
    };
    let (_, progress) = of.photo(board([6.0, 20.0], 0.5), gpu::grey(160, 60, 0));
    // The picture is one tile. Its blur of 80 px takes two moments a pixel; progress is reported
    // every 32 moments and for the rest.
    assert_eq!(progress, [0.0, 1.0 / 6.0, 2.0 / 6.0, 3.0 / 6.0, 4.0 / 6.0, 5.0 / 6.0]);
}

/// A black object in front of a wall with depth at its border and in one pixel in fifty: without a
/// lens too, it occludes the board completely.
#[test]
fn surface_with_sparse_depth_occludes_completely() {
    const SIZE: (usize, usize) = (320, 240);
    let inside = |x: usize, y: usize| (100..160).contains(&x) && (80..200).contains(&y);
    let places = || (0..SIZE.0 * SIZE.1).map(|i| (i % SIZE.0, i / SIZE.0));
    let codes = places().flat_map(|(x, y)| [if inside(x, y) { 10 } else { 120 }; 3]).collect();
    let pixels = Pixels::from_u8(SIZE.0 as u32, SIZE.1 as u32, codes).unwrap();
    let rim = |x: usize, y: usize| !(inside(x - 1, y) && inside(x + 1, y) && inside(x, y - 1) && inside(x, y + 1));
    let measured = |(x, y): (usize, usize)| match inside(x, y) {
        false => 1.5 * DEPTH_M as f32,
        true if rim(x, y) || (x % 10 == 0 && y % 5 == 0) => 0.5 * DEPTH_M as f32,
        true => 0.0,
    };
    let depth_m = places().map(measured).collect();
    let depth = DepthMap { width: SIZE.0 as u32, height: SIZE.1 as u32, depth_m, timestamp_s: 0.0 };
    let of = PhotoConditions {
        camera: gpu::camera(&gpu::pinhole(SIZE.0 as u32, SIZE.1 as u32, FOCAL_PX), 0.0),
        settings: Settings::default(),
        track: &sideways([0.0, 0.0]),
        summed: &[],
        depth: Some(&depth),
        opening: None,
        time_s: 0.0,
    };
    // From 60 px left of the middle to 60 px right of it.
    let (taken, _) = of.photo(board([60.0, 60.0], 0.9), pixels);
    for (x, y) in places().filter(|(x, y)| (104..216).contains(x) && (64..176).contains(y)) {
        // The point spread mixes a pixel or two at the edges.
        if (x as i32 - 160).abs() < 3 || (y as i32 - 80).abs() < 3 {
            continue;
        }
        let green = taken.at(x as u32, y as u32)[1];
        assert_eq!(green < 100, inside(x, y), "{x} {y}: {green}");
    }
}

#[test]
fn wall_occludes_an_object_only_beyond_the_depth_tolerance() {
    const GREY: u8 = 60;
    let tolerance_m = 0.02;
    let shown = |before_board_m: f64| {
        let wall_m = (DEPTH_M - before_board_m) as f32;
        let depth = DepthMap { width: 160, height: 60, depth_m: vec![wall_m; 160 * 60], timestamp_s: 0.0 };
        let of = PhotoConditions {
            camera: gpu::camera(&gpu::pinhole(160, 60, FOCAL_PX), 0.0),
            settings: gpu::settings(&[("depth", "tolerance_m", Value::Number(tolerance_m))]),
            track: &sideways([0.0, 0.0]),
            summed: &[],
            depth: Some(&depth),
            opening: None,
            time_s: 0.0,
        };
        let (taken, _) = of.photo(board([30.0, 15.0], 0.5), gpu::grey(160, 60, GREY));
        // The board without its blended edge.
        let places = (20..40).flat_map(|y| (55..105).map(move |x| (x, y)));
        places.filter(|&(x, y)| taken.at(x, y)[1] > u32::from(GREY) + 40).count()
    };
    // The wall is nearer than the board by half of the tolerance, and by one and a half.
    assert_eq!([0.5, 1.5].map(|share| shown(share * tolerance_m)), [20 * 50, 0]);
}

/// A table measured with a ripple of 12 mm amplitude occludes parts of a board that lies on it,
/// unless its plane is known.
#[test]
fn flat_object_on_a_table_of_rippled_depth_is_fully_visible() {
    const GREY: u8 = 60;
    let wave_m = |i: u32| 0.012 * (0.4 * f64::from(i % 160)).sin();
    let depth_m: Vec<f32> = (0..160 * 60).map(|i| (DEPTH_M + wave_m(i)) as f32).collect();
    let depth = DepthMap { width: 160, height: 60, depth_m, timestamp_s: 0.0 };
    let support = Plane { point_m: DVec3::new(0.0, 0.0, DEPTH_M), normal: DVec3::NEG_Z };
    let geometry = gpu::pinhole(160, 60, FOCAL_PX);
    let shown = |support: Option<Plane>, frames: usize| {
        let track = sideways([0.0, 0.0]);
        let summed: Vec<SummedExposure> = (0..frames)
            .map(|n| SummedExposure { time_s: 0.1 * n as f64, exposure_s: 0.01, weight: 1.0 / frames as f64 })
            .collect();
        let of = PhotoConditions {
            camera: gpu::camera(&geometry, 0.01),
            settings: gpu::settings(&[("depth", "tolerance_m", Value::Number(0.004))]),
            track: &track,
            summed: if frames > 1 { &summed } else { &[] },
            depth: Some(&depth),
            opening: None,
            time_s: 0.01,
        };
        let mut scene = board([30.0, 15.0], 0.5);
        scene.objects[0].support = support;
        let (framing, none) = (Framing::new(&geometry, None, None, f64::INFINITY, None).unwrap(), Proxies::default());
        let planes: Vec<Plane> = support.into_iter().collect();
        let hiding =
            SummedFrameOcclusion::new(&geometry, &track, &framing, &of.camera.response, (&depth, &none, &planes));
        let pixels = gpu::grey(160, 60, GREY);
        let frame = |n: usize| gpu::frame(n, 0.1 * n as f64, pixels.clone());
        let hides: Vec<_> = (0..frames).filter_map(|n| Some((0.1 * n as f64, hiding.of(&frame(n))?))).collect();
        assert_eq!(hides.len(), frames);
        let all: Vec<_> = (0..frames).map(|_| (1.0 / frames as f64, pixels.clone())).collect();
        let (taken, _) = of.photo_of(scene, &all, if frames > 1 { &hides } else { &[] });
        let places = (20..40).flat_map(|y| (55..105).map(move |x| (x, y)));
        places.filter(|&(x, y)| taken.at(x, y)[1] > u32::from(GREY) + 40).count()
    };
    for frames in [1, 2] {
        assert_eq!(shown(Some(support), frames), 20 * 50, "{frames} frames");
        // By hand a ripple is nearer by more than 4 mm for (π − 2·asin(1/3))/2π = 39 % of its
        // length. Smoothing the depth reduces that; widening near surfaces by a pixel on each side
        // increases it.
        let in_waves = shown(None, frames);
        assert!((20 * 50 * 45 / 100..20 * 50 * 75 / 100).contains(&in_waves), "{frames} frames: {in_waves}");
    }
}
