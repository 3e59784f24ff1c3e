//! Depth of small scans, beside ray casting.

use std::path::Path;
use std::sync::Arc;

use glam::{DQuat, DVec2, DVec3, Vec3};

use super::scan_file::ScanGeometry;
use super::{ScannedSite, SiteScan};
use crate::camera::{Distortion, Geometry, Intrinsics, LensModel};
use crate::hash::pcg3d;
use crate::pixels::DepthMap;
use crate::pose::Pose;

/// Three uniform numbers from −0.5 to 0.5.
fn random(n: usize) -> [f64; 3] {
    pcg3d([n as u32, 7, 11]).map(|bits| f64::from(bits) / f64::from(u32::MAX) - 0.5)
}

fn site(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>, origin: DVec3) -> ScannedSite {
    let geometry = ScanGeometry { origin, positions, triangles, metres_per_unit: None, up: None, warnings: Vec::new() };
    ScannedSite::new(Arc::new(SiteScan::of_geometry(Path::new("test"), geometry, None)), Pose::IDENTITY)
}

/// Points on a rectangle around a center, spanned by two half sides, with noise along its normal.
fn rectangle(center: DVec3, u: DVec3, v: DVec3, count: usize, noise_m: f64) -> Vec<Vec3> {
    let normal = u.cross(v).normalize();
    let point = |n: usize| {
        let [a, b, c] = random(n);
        (center + 2.0 * a * u + 2.0 * b * v + noise_m * 3.46 * c * normal).as_vec3()
    };
    (0..count).map(point).collect()
}

fn at(map: &DepthMap, x: usize, y: usize) -> f32 {
    map.depth_m[y * map.width as usize + x]
}

const BOX_CORNERS: [[f32; 3]; 8] = [
    [-1.0, -0.5, -0.5],
    [1.0, -0.5, -0.5],
    [-1.0, 0.5, -0.5],
    [1.0, 0.5, -0.5],
    [-1.0, -0.5, 0.5],
    [1.0, -0.5, 0.5],
    [-1.0, 0.5, 0.5],
    [1.0, 0.5, 0.5],
];
const BOX_TRIANGLES: [[u32; 3]; 12] = [
    [0, 1, 3],
    [0, 3, 2],
    [4, 7, 5],
    [4, 6, 7],
    [0, 5, 1],
    [0, 4, 5],
    [2, 3, 7],
    [2, 7, 6],
    [0, 2, 6],
    [0, 6, 4],
    [1, 7, 3],
    [1, 5, 7],
];

fn box_site(origin: DVec3) -> ScannedSite {
    site(BOX_CORNERS.map(Vec3::from).to_vec(), BOX_TRIANGLES.to_vec(), origin)
}

/// Distance along a ray to the box, in lengths of the direction.
fn box_hit(eye: DVec3, direction: DVec3) -> Option<f64> {
    let half = DVec3::new(1.0, 0.5, 0.5);
    let (a, b) = ((-half - eye) / direction, (half - eye) / direction);
    let (enters, leaves) = (a.min(b).max_element(), a.max(b).min_element());
    match enters {
        _ if enters > leaves || leaves <= 0.0 => None,
        _ if enters > 0.0 => Some(enters),
        _ => Some(leaves),
    }
}

#[test]
fn view_cuts_away_surfaces_near_the_camera() {
    let origin = DVec3::new(1000.0, -2000.0, 50.0);
    let site = box_site(origin);
    let pose = Pose::look_at(origin - 3.0 * DVec3::Y, origin, DVec3::Z).unwrap();
    let middle_m =
        // The ray passes through the diagonal that two triangles share.
        |min_distance_m| at(&site.scan.view(&Geometry::pinhole(33, 33, 30.0), &pose, min_distance_m), 16, 16);
    let [whole_m, cut_m] = [0.0, 3.0].map(middle_m);
    assert!((whole_m - 2.5).abs() < 1e-3 && (cut_m - 3.5).abs() < 1e-3, "{whole_m} {cut_m}");
}

#[test]
fn depth_of_a_mesh_is_that_of_ray_casting_through_every_lens() {
    let distorted = |model, k: [f64; 4], focal_px: f64| {
        let intrinsics = Intrinsics {
            width_px: 96,
            height_px: 72,
            fx_px: focal_px,
            fy_px: focal_px,
            cx_px: 47.0,
            cy_px: 37.0,
            ..Intrinsics::default()
        };
        Geometry::new(intrinsics, Distortion { model, k1: k[0], k2: k[1], k3: k[2], k4: k[3], ..Distortion::default() })
    };
    let around = Geometry::new(
        Intrinsics { width_px: 96, height_px: 48, ..Intrinsics::default() },
        Distortion { model: LensModel::Equirectangular, ..Distortion::default() },
    );
    let cameras = [
        Geometry::pinhole(96, 72, 80.0),
        distorted(LensModel::Opencv, [-0.25, 0.08, 0.0, 0.0], 60.0),
        distorted(LensModel::OpencvFisheye, [0.02, -0.01, 0.0, 0.0], 30.0),
        around,
    ];
    let site = box_site(DVec3::ZERO);
    let eyes = [DVec3::new(1.9, -1.4, 1.2), DVec3::new(0.2, 0.1, 0.05)];
    for (n, camera) in cameras.iter().enumerate() {
        for eye in eyes {
            let pose = Pose::look_at(eye, DVec3::new(-0.4, 0.3, -0.1), DVec3::Z).unwrap();
            let map = site.depth(camera, |_| pose, 0.0);
            let (mut wrong, mut hits) = (0, 0);
            for i in 0..map.depth_m.len() {
                let at_px = DVec2::new((i as u32 % map.width) as f64 + 0.5, (i as u32 / map.width) as f64 + 0.5);
                let Some(ray) = camera.depth_ray(at_px) else { continue };
                let expected = box_hit(eye, pose.world_from_camera_rotation() * ray).unwrap_or(0.0);
                let rendered = f64::from(map.depth_m[i]);
                hits += usize::from(expected > 0.0);
                wrong += usize::from((rendered - expected).abs() > 1e-4 * expected.max(1.0));
            }
            assert!(hits > 50, "camera {n}: {hits} rays meet the box");
            // Rays through an edge may meet either side of it.
            assert!(wrong <= hits / 200, "camera {n} from {eye}: {wrong} of {hits} pixels");
        }
    }
}

#[test]
fn points_around_the_camera_are_seen_in_every_direction_of_a_360_degree_picture() {
    let sphere = (0..150_000).map(|n| DVec3::from(random(n)).normalize_or(DVec3::X).as_vec3() * 2.0).collect();
    let around = Geometry::new(
        Intrinsics { width_px: 96, height_px: 48, ..Intrinsics::default() },
        Distortion { model: LensModel::Equirectangular, ..Distortion::default() },
    );
    let map = site(sphere, vec![], DVec3::ZERO).depth(&around, |_| Pose::IDENTITY, 0.0);
    let wrong = map.depth_m.iter().filter(|distance_m| (**distance_m - 2.0).abs() > 0.02).count();
    assert!(wrong < 10, "{wrong} of {} pixels", map.depth_m.len());
}

#[test]
fn rolling_shutter_shows_each_row_from_its_own_pose() {
    let still = Geometry::pinhole(64, 96, 96.0);
    let readout_time_s = 0.02;
    let rolling = Geometry::new(Intrinsics { readout_time_s, ..still.intrinsics.clone() }, still.distortion.clone());
    // A camera that moves along its axis, towards a box.
    let pose = |time_s: f64| Pose::from_camera_in_world(DVec3::new(0.1, 0.1, -3.0 + 10.0 * time_s), DQuat::IDENTITY);
    let map = box_site(DVec3::ZERO).depth(&rolling, pose, 0.0);
    for y in [35, 47, 48, 60] {
        let expected_m = 2.5 - 10.0 * rolling.row_time_s(y as f64 + 0.5);
        // A band of 16 rows has one pose: 8 rows are 1.7 ms.
        assert!((f64::from(at(&map, 32, y)) - expected_m).abs() < 0.018, "row {y}");
    }
    let difference_m = at(&map, 32, 35) - at(&map, 32, 60);
    assert!(difference_m > 0.03, "{difference_m}");
}

#[test]
fn depth_of_a_noisy_wall_is_known_everywhere_and_averages_the_noise() {
    let (noise_m, camera) = (0.004, Geometry::pinhole(80, 60, 80.0));
    let slanted = DVec3::new(3.0, 0.0, 1.0);
    let wall = site(
        rectangle(DVec3::new(0.0, 0.0, 2.5), slanted, DVec3::new(0.0, 2.5, 0.0), 60_000, noise_m),
        vec![],
        DVec3::ZERO,
    );
    let map = wall.depth(&camera, |_| Pose::IDENTITY, 0.0);
    let normal = slanted.cross(DVec3::Y).normalize();
    let error_m = |i: usize| {
        let at_px = DVec2::new((i % 80) as f64 + 0.5, (i / 80) as f64 + 0.5);
        let point = f64::from(map.depth_m[i]) * camera.depth_ray(at_px).unwrap();
        normal.dot(point - DVec3::new(0.0, 0.0, 2.5))
    };
    assert!(map.depth_m.iter().all(|z| *z > 0.0));
    let rms_m = ((0..4800).map(|i| error_m(i).powi(2)).sum::<f64>() / 4800.0).sqrt();
    assert!(rms_m < 0.5 * noise_m, "{rms_m} m");
}

#[test]
fn surface_ends_where_its_points_end_and_the_wall_behind_is_seen_beside_it() {
    let camera = Geometry::pinhole(120, 90, 120.0);
    let mut points = rectangle(DVec3::new(0.0, 0.0, 3.0), 3.0 * DVec3::X, 2.4 * DVec3::Y, 120_000, 0.0);
    // Its edge at x = 0 is in column 60.
    points.extend(rectangle(DVec3::new(-0.5, 0.0, 1.5), 0.5 * DVec3::X, DVec3::Y, 60_000, 0.0));
    let map = site(points, vec![], DVec3::ZERO).depth(&camera, |_| Pose::IDENTITY, 0.0);
    for y in 10..80 {
        let nearer = (0..120).filter(|x| (at(&map, *x, y) - 1.5).abs() < 0.02).max().unwrap();
        assert!((58..=61).contains(&nearer), "row {y}: the edge is at {nearer}");
        let unknown = (50..120).filter(|x| at(&map, *x, y) == 0.0).count();
        assert_eq!(unknown, 0, "row {y}");
        assert!((at(&map, 70, y) - 3.0).abs() < 0.01);
    }
}

#[test]
fn coarser_discs_are_drawn_from_afar_and_finer_ones_nearby() {
    let points = rectangle(DVec3::new(0.0, 0.0, 0.0), DVec3::X, DVec3::Y, 200_000, 0.001);
    let site = site(points, vec![], DVec3::ZERO);
    let super::ScanSurface::Points(octree) = &site.scan.surface else { unreachable!() };
    let levels: std::collections::BTreeSet<u32> = octree.nodes.iter().map(|node| (node.voxel_m * 1e4) as u32).collect();
    assert!(levels.len() >= 3, "{levels:?}");
    // The finest voxels have at least three points in the mean: 200,000 over 4 m².
    assert!(*levels.first().unwrap() >= 60, "{levels:?}");
    let camera = Geometry::pinhole(64, 48, 64.0);
    for distance_m in [0.4, 20.0] {
        let pose = Pose::from_camera_in_world(DVec3::new(0.0, 0.0, -distance_m), DQuat::IDENTITY);
        let z = f64::from(at(&site.depth(&camera, |_| pose, 0.0), 32, 24));
        assert!((z - distance_m).abs() < 0.002, "{z} at {distance_m} m");
    }
}

#[test]
fn lone_points_between_surfaces_are_left_out() {
    let mut points = rectangle(DVec3::new(0.0, 0.0, 2.0), 1.5 * DVec3::X, 1.5 * DVec3::Y, 100_000, 0.0);
    points.extend((0..40).map(|n| {
        let [x, y, z] = random(n);
        DVec3::new(x, y, 1.7 + 0.2 * z).as_vec3()
    }));
    let map = site(points, vec![], DVec3::ZERO).depth(&Geometry::pinhole(80, 60, 80.0), |_| Pose::IDENTITY, 0.0);
    let nearer = map.depth_m.iter().filter(|z| **z < 1.95).count();
    assert!(nearer < 10, "{nearer} pixels in front of the wall");
}

#[test]
fn georeferenced_scan_keeps_its_precision() {
    let origin = DVec3::new(571_234.0, 5_934_321.0, 40.0);
    let camera = Geometry::pinhole(64, 48, 64.0);
    let pose = Pose::look_at(DVec3::new(3.0, -2.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
    let far_pose = Pose::look_at(origin + DVec3::new(3.0, -2.0, 1.0), origin, DVec3::Z).unwrap();
    let (near, far) =
        (box_site(DVec3::ZERO).depth(&camera, |_| pose, 0.0), box_site(origin).depth(&camera, |_| far_pose, 0.0));
    let largest_m = near.depth_m.iter().zip(&far.depth_m).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest_m < 1e-4, "{largest_m} m");
}

#[test]
fn site_in_another_world_is_seen_alike_by_the_camera_of_that_world() {
    let site = box_site(DVec3::ZERO);
    let world_from_other = Pose::new(DQuat::from_rotation_x(0.4), DVec3::new(1.0, -2.0, 0.5));
    let camera = Pose::look_at(DVec3::new(3.0, 1.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
    // camera_from_other = camera_from_world · world_from_other.
    let other =
        Pose::new(camera.rotation * world_from_other.rotation, camera.transform_point(world_from_other.translation_m));
    let geometry = Geometry::pinhole(64, 48, 64.0);
    let [a, b] =
        [site.depth(&geometry, |_| camera, 0.0), site.in_world(&world_from_other).depth(&geometry, |_| other, 0.0)];
    let largest_m = a.depth_m.iter().zip(&b.depth_m).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(a.depth_m.iter().any(|z| *z > 0.0) && largest_m < 1e-4, "{largest_m} m");
}
