//! Cameras from photographs of a chessboard: simulated ones compared with the truth, real ones with
//! OpenCV.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use crate::common;
use crate::program::{refused, stdout_of};
use crate::random::Random;
use crate::tier;
use glam::{DMat3, DQuat, DVec2, DVec3};
use locard::calibrate::board::{
    BoardDetection, ChessboardError, ChessboardSize, DetectedTarget, TargetChoice, find_chessboard,
};
use locard::calibrate::geometry::{
    CameraCalibration, LensCalibrationError, LensOptions, NamedView, Views, calibrate, views_from_paths,
};
use locard::camera::{Distortion, Geometry, Intrinsics, LensModel, Response};
use locard::compositor::Settings;
use locard::grey_image::GreyImage;
use locard::profile::Rig;

const SIZE: (u32, u32) = (640, 480);
/// Inner corners of the simulated board.
const BOARD: (u32, u32) = (8, 5);

/// A camera with precomputed rays for subsamples of each pixel.
struct Camera {
    geometry: Geometry,
    /// Directions, `SUBSAMPLES`² for each pixel.
    rays: Vec<Option<DVec3>>,
}

const SUBSAMPLES: usize = 3;

impl Camera {
    fn new(geometry: Geometry) -> Self {
        let place = |n: usize| (n as f64 + 0.5) / SUBSAMPLES as f64;
        let (width, height) = (SIZE.0 as usize * SUBSAMPLES, SIZE.1 as usize * SUBSAMPLES);
        let rays =
            (0..width * height).map(|i| geometry.direction(DVec2::new(place(i % width), place(i / width)))).collect();
        Self { geometry, rays }
    }

    /// A photograph of the board in 8-bit codes: unevenly lit, blurred by 0.7 px, with noise of
    /// `sigma` codes.
    fn photograph(&self, stand: &(DMat3, DVec3), sigma: f64, seed: u64) -> GreyImage {
        let (rotation, translation) = stand;
        let inverse = rotation.transpose();
        let eye = inverse * -*translation;
        let (columns, rows) = (f64::from(BOARD.0), f64::from(BOARD.1));
        let value = |ray: &Option<DVec3>| {
            let Some(ray) = ray.map(|ray| inverse * ray) else { return 90.0 };
            let far = -eye.z / ray.z;
            let p = eye + far * ray;
            // Corners are at integers from 0; the squares extend one farther, the paper's margin
            // another half.
            let within = |v: f64, n: f64, more: f64| v > -1.0 - more && v < n + more;
            match far > 0.0 {
                true if within(p.x, columns, 0.0) && within(p.y, rows, 0.0) => {
                    let dark = (p.x.floor() + p.y.floor()).rem_euclid(2.0) == 0.0;
                    // The light falls off across the board.
                    (if dark { 25.0 } else { 215.0 }) * (0.75 - 0.04 * p.x - 0.02 * p.y).clamp(0.2, 1.0)
                }
                true if within(p.x, columns, 0.5) && within(p.y, rows, 0.5) => 160.0,
                _ => 90.0,
            }
        };
        let sharp = GreyImage::from_fn(SIZE.0 as usize, SIZE.1 as usize, |x, y| {
            let all = (0..SUBSAMPLES * SUBSAMPLES).map(|i| {
                value(
                    &self.rays[(SUBSAMPLES * y + i / SUBSAMPLES) * SUBSAMPLES * SIZE.0 as usize
                        + SUBSAMPLES * x
                        + i % SUBSAMPLES],
                )
            });
            (all.sum::<f64>() / (SUBSAMPLES * SUBSAMPLES) as f64) as f32
        });
        let mut picture = sharp.blurred(0.7);
        let mut random = Random::new(seed);
        for value in &mut picture.values {
            *value = (f64::from(*value) + sigma * random.normal()).clamp(0.0, 255.0).round() as f32;
        }
        picture
    }
}

/// Poses in which the board is well visible: tilted in all directions, near and far, in the middle
/// and near the border.
fn stands(geometry: &Geometry, count: usize, seed: u64) -> Vec<(DMat3, DVec3)> {
    let mut random = Random::new(seed);
    let mut between = |low: f64, high: f64| low + (high - low) * random.uniform();
    (0..count)
        .map(|n| {
            let around = n as f64 * 2.399_963;
            let tilt = between(0.15, 0.75);
            let rotation = DQuat::from_axis_angle(DVec3::new(around.cos(), around.sin(), 0.0), tilt)
                * DQuat::from_rotation_z(between(-0.5, 0.5));
            let rotation = DMat3::from_quat(rotation);
            // The board's centre is on the ray of a pixel.
            let at = DVec2::new(between(0.3, 0.7) * f64::from(SIZE.0), between(0.3, 0.7) * f64::from(SIZE.1));
            let wide = f64::from(SIZE.0) / geometry.intrinsics.fx_px;
            let middle = geometry.direction(at).unwrap() * between(9.0, 17.0) / wide;
            let own = DVec3::new(0.5 * f64::from(BOARD.0 - 1), 0.5 * f64::from(BOARD.1 - 1), 0.0);
            (rotation, middle - rotation * own)
        })
        .collect()
}

fn brown() -> Geometry {
    let intrinsics = Intrinsics {
        width_px: SIZE.0,
        height_px: SIZE.1,
        fx_px: 610.0,
        fy_px: 606.0,
        cx_px: 331.0,
        cy_px: 228.0,
        ..Intrinsics::default()
    };
    Geometry::new(
        intrinsics,
        Distortion { k1: -0.28, k2: 0.11, p1: 0.0012, p2: -0.0008, k3: -0.03, ..Distortion::default() },
    )
}

fn fisheye() -> Geometry {
    let model = LensModel::OpencvFisheye;
    let intrinsics = Intrinsics { fx_px: 265.0, fy_px: 266.0, cx_px: 315.0, cy_px: 247.0, ..brown().intrinsics };
    Geometry::new(
        intrinsics,
        Distortion { model, k1: 0.04, k2: -0.015, k3: 0.004, k4: -0.001, ..Distortion::default() },
    )
}

fn truth(geometry: &Geometry, name: &str) -> f64 {
    let (i, d) = (&geometry.intrinsics, &geometry.distortion);
    match name {
        "fx_px" => i.fx_px,
        "fy_px" => i.fy_px,
        "cx_px" => i.cx_px,
        "cy_px" => i.cy_px,
        "k1" => d.k1,
        "k2" => d.k2,
        "k3" => d.k3,
        "k4" => d.k4,
        "p1" => d.p1,
        "p2" => d.p2,
        other => panic!("{other}"),
    }
}

fn named_view(n: usize, detection: BoardDetection) -> NamedView {
    NamedView { name: format!("{n}.png"), detection }
}

/// Error of each parameter in units of its standard deviation.
fn normalized_errors(calibrated: &CameraCalibration, geometry: &Geometry) -> Vec<(&'static str, f64)> {
    let one = |p: &locard::calibrate::geometry::Parameter| (p.name, (p.value - truth(geometry, p.name)) / p.sigma);
    calibrated.parameters.iter().map(one).collect()
}

// Slow: two cameras photograph sixteen boards each, and all corners are searched.
#[test]
fn camera_is_recovered_from_simulated_photographs() {
    for geometry in [brown(), fisheye()] {
        let model = geometry.distortion.model;
        let camera = Camera::new(geometry);
        for seed in 0..tier::fast_or_full(1, 3) {
            let mut views = Vec::new();
            for (n, stand) in stands(&camera.geometry, 16, 11 + seed).iter().enumerate() {
                let picture = camera.photograph(stand, 2.0, 1000 * seed + n as u64);
                let detection = find_chessboard(&picture, None);
                // Distance to the true corner.
                if let Ok(detection) = &detection {
                    let own: Vec<DVec2> = corners(stand).filter_map(|p| camera.geometry.project(p)).collect();
                    for at in &detection.corners_px {
                        let nearest = own.iter().map(|own| own.distance(*at)).fold(f64::INFINITY, f64::min);
                        assert!(nearest < 0.6, "seed {seed}, view {n}: a corner is {nearest} px off");
                    }
                }
                views.extend(detection.ok().map(|detection| named_view(n, detection)));
            }
            assert!(views.len() >= 14, "{model:?}, seed {seed}: only {} views", views.len());
            let calibrated = calibrate(SIZE, views, Vec::new(), &LensOptions::default()).unwrap();
            println!(
                "{model:?} {seed}: {}\n{:?}",
                calibrated.deviations(),
                normalized_errors(&calibrated, &camera.geometry)
            );
            assert_eq!(calibrated.geometry.distortion.model, model);
            assert!(calibrated.rms_px < 0.15, "{}", calibrated.rms_px);
            for (name, off) in normalized_errors(&calibrated, &camera.geometry) {
                assert!(off.abs() < 3.0, "{model:?}, seed {seed}: {name} is {off} deviations off\n{calibrated}");
            }
        }
    }
}

fn corners(stand: &(DMat3, DVec3)) -> impl Iterator<Item = DVec3> {
    let (rotation, translation) = *stand;
    let places =
        (0..BOARD.1).flat_map(|row| (0..BOARD.0).map(move |column| DVec3::new(column.into(), row.into(), 0.0)));
    places.map(move |place| rotation * place + translation)
}

/// Simulated corner detections, with normal errors of σ px in x and y.
fn simulated_detection(
    geometry: &Geometry,
    stand: &(DMat3, DVec3),
    sigma_px: f64,
    random: &mut Random,
) -> BoardDetection {
    let (mut board, mut corners_px) = (Vec::new(), Vec::new());
    for (n, corner) in corners(stand).enumerate() {
        let error = sigma_px * DVec2::new(random.normal(), random.normal());
        if let Some(at) = geometry.project(corner) {
            board.push(DVec2::new((n as u32 % BOARD.0).into(), (n as u32 / BOARD.0).into()));
            corners_px.push(at + error);
        }
    }
    BoardDetection { board, corners_px, target: DetectedTarget::Chessboard(ChessboardSize::new(BOARD.0, BOARD.1)) }
}

/// Over many seeds the errors match the reported deviations, neither smaller nor larger.
#[test]
fn deviations_match_the_actual_errors() {
    let geometry = brown();
    let (mut squares, mut count) = (0.0, 0.0);
    for seed in 0..tier::fast_or_full(8, 20) {
        let mut random = Random::new(500 + seed);
        let stands = stands(&geometry, 15, seed);
        let views = stands
            .iter()
            .enumerate()
            .map(|(n, s)| named_view(n, simulated_detection(&geometry, s, 0.2, &mut random)))
            .collect();
        let calibrated = calibrate(SIZE, views, Vec::new(), &LensOptions::default()).unwrap();
        // √2 of σ, since a residual has two components.
        assert!((calibrated.rms_px - 0.2 * 2f64.sqrt()).abs() < 0.03, "{}", calibrated.rms_px);
        for (_, off) in normalized_errors(&calibrated, &geometry) {
            squares += off * off;
            count += 1.0;
        }
    }
    // The larger of two estimates counts for each parameter, so the mean is a little below 1.
    let mean = squares / count;
    assert!((0.45..1.3).contains(&mean), "{mean} over {count}");
}

/// Boards bent by a twelfth of a square cause errors shared by all corners of a view. Even with few
/// views the deviations match the errors.
#[test]
fn deviations_include_bent_boards() {
    let geometry = brown();
    let (mut squares, mut count) = (0.0, 0.0);
    for seed in 0..16 {
        let mut random = Random::new(300 + seed);
        let views = stands(&geometry, 4, 40 + seed).into_iter().enumerate().map(|(n, (rotation, translation))| {
            let mut detection = simulated_detection(&geometry, &(rotation, translation), 0.1, &mut random);
            let bend = if n % 2 == 0 { 0.08 } else { 0.02 };
            for (place, at) in detection.board.iter().zip(&mut detection.corners_px) {
                let bent = place.extend(bend * (place.x / 3.5 - 1.0).powi(2));
                let way = |point: DVec3| geometry.project(rotation * point + translation).unwrap();
                *at += way(bent) - way(place.extend(0.0));
            }
            named_view(n, detection)
        });
        let Ok(calibrated) = calibrate(SIZE, views.collect(), Vec::new(), &LensOptions::default()) else { continue };
        for (_, off) in normalized_errors(&calibrated, &geometry) {
            squares += off * off;
            count += 1.0;
        }
    }
    let mean = squares / count;
    println!("{mean:.2} over {count}");
    assert!(count > 100.0 && (0.1..2.0).contains(&mean), "{mean} over {count}");
}

/// The last radial coefficient is kept if it is significant, and left at 0 otherwise: one in twenty
/// zero coefficients seems to be more than two deviations from 0.
#[test]
fn last_coefficient_is_kept_if_it_is_significant() {
    for (k3, count, expected) in [(0.25, 10, 6..7), (0.0, 4, 0..3)] {
        let geometry =
            Geometry::new(brown().intrinsics, Distortion { k1: -0.1, k2: 0.02, k3, ..Distortion::default() });
        let mut kept = 0;
        for seed in 0..6 {
            let mut random = Random::new(900 + seed);
            let stands = stands(&geometry, count, seed);
            let views = stands
                .iter()
                .enumerate()
                .map(|(n, s)| named_view(n, simulated_detection(&geometry, s, 0.05, &mut random)))
                .collect();
            let calibrated = calibrate(SIZE, views, Vec::new(), &LensOptions::default()).unwrap();
            let last = calibrated.parameters.last().unwrap();
            kept += usize::from(last.value != 0.0);
            assert!((last.value - k3).abs() < 4.0 * last.sigma, "seed {seed}: {calibrated}");
            let left = calibrated.notes.iter().any(|note| note.starts_with("k3 is left at 0"));
            assert_eq!(left, last.value == 0.0, "{calibrated}");
        }
        assert!(expected.contains(&kept), "k3 = {k3}: kept in {kept} of 6");
    }
}

/// Misread corners, a view with another zoom and a misread board are reported and left out, without
/// harm to the rest.
#[test]
fn foreign_views_are_rejected_or_have_little_effect() {
    let geometry = brown();
    let mut random = Random::new(77);
    let stands = stands(&geometry, 14, 3);
    let mut views: Vec<NamedView> = stands
        .iter()
        .enumerate()
        .map(|(n, s)| named_view(n, simulated_detection(&geometry, s, 0.1, &mut random)))
        .collect();
    for (n, view) in views.iter_mut().enumerate() {
        view.detection.corners_px[(7 * n) % 40] += DVec2::new(6.0, -4.0);
    }
    let zoomed = Intrinsics { fx_px: 700.0, fy_px: 695.0, ..geometry.intrinsics.clone() };
    views[5].detection =
        simulated_detection(&Geometry::new(zoomed, geometry.distortion.clone()), &stands[5], 0.1, &mut random);
    for at in &mut views[9].detection.corners_px[..20] {
        *at += DVec2::new(9.0, 0.0);
    }
    let calibrated = calibrate(SIZE, views, Vec::new(), &LensOptions::default()).unwrap();
    let names: Vec<&str> = calibrated.refused.iter().map(|refused| refused.name.as_str()).collect();
    assert!(
        names.contains(&"9.png") && calibrated.refused[0].reason.contains("does not fit the other views"),
        "{names:?}"
    );
    assert!((calibrated.geometry.intrinsics.fx_px / 610.0 - 1.0).abs() < 0.005, "{calibrated}");
    assert!((calibrated.geometry.distortion.k1 / -0.28 - 1.0).abs() < 0.05, "{calibrated}");
}

#[test]
fn too_few_views_name_the_requirement() {
    let geometry = brown();
    let mut random = Random::new(1);
    let two: Vec<NamedView> = stands(&geometry, 2, 3)
        .iter()
        .enumerate()
        .map(|(n, s)| named_view(n, simulated_detection(&geometry, s, 0.1, &mut random)))
        .collect();
    let error = calibrate(SIZE, two, Vec::new(), &LensOptions::default()).unwrap_err();
    assert!(error.to_string().starts_with("2 views of 2 can be used; 3 with the board tilted differently"), "{error}");
    // Boards that face the camera do not determine their distance.
    let facing: Vec<_> = (0..5).map(|n| (DMat3::IDENTITY, DVec3::new(-3.0 - 0.3 * f64::from(n), -2.0, 12.0))).collect();
    let flat =
        facing.iter().enumerate().map(|(n, s)| named_view(n, simulated_detection(&geometry, s, 0.1, &mut random)));
    match calibrate(SIZE, flat.collect(), Vec::new(), &LensOptions::default()) {
        Ok(calibrated) => assert!(calibrated.missing.iter().any(|m| m.to_string().contains("tilted")), "{calibrated}"),
        Err(error) => {
            assert!(matches!(error, LensCalibrationError::Undetermined | LensCalibrationError::Unexplained), "{error}")
        }
    }
    let blank = GreyImage::from_fn(300, 200, |x, y| ((x * 7 + y * 13) % 11) as f32);
    assert_eq!(find_chessboard(&blank, None), Err(ChessboardError::None));
    for (width, height) in [(0, 0), (1, 1), (5, 3), (3, 400)] {
        assert_eq!(
            find_chessboard(&GreyImage::from_fn(width, height, |x, _| x as f32), None),
            Err(ChessboardError::None)
        );
    }
}

/// A part of the board, a wrong size, a board half of which is in the sun.
#[test]
fn partial_board_is_detected_and_a_larger_one_is_refused() {
    let camera = Camera::new(brown());
    let facing = (DMat3::from_quat(DQuat::from_rotation_y(0.3)), DVec3::new(-3.5, -2.0, 9.0));
    let mut picture = camera.photograph(&facing, 1.0, 4);
    let whole = find_chessboard(&picture, Some(ChessboardSize::new(5, 8))).unwrap();
    assert_eq!((whole.corners_px.len(), whole.target), (40, DetectedTarget::Chessboard(ChessboardSize::new(8, 5))));
    assert!(matches!(find_chessboard(&picture, Some(ChessboardSize::new(6, 5))), Err(ChessboardError::Larger { .. })));
    for y in 0..SIZE.1 as usize {
        let row = &mut picture.values[y * SIZE.0 as usize..(y + 1) * SIZE.0 as usize];
        row[330..].iter_mut().for_each(|value| *value = 40.0);
    }
    let part = find_chessboard(&picture, Some(ChessboardSize::new(8, 5))).unwrap();
    assert!((15..30).contains(&part.corners_px.len()) && part.target.corners() <= 25, "{:?}", part.target);
}

fn photos() -> Option<Vec<PathBuf>> {
    common::data("chessboard/camera_cal").map(|folder| vec![folder])
}

/// OpenCV 5.0, whole boards alone: rms 0.853, fx 1159.1, k1 −0.2577.
#[test]
fn real_photographs_match_opencv() {
    let Some(paths) = photos() else { return };
    let go_on = &mut |_, _| ControlFlow::Continue(());
    let (paths, counts) = if tier::is_full() {
        (paths, (18, 2))
    } else {
        // Every second photograph, one of which has another size.
        let mut files: Vec<PathBuf> = std::fs::read_dir(&paths[0]).unwrap().map(|file| file.unwrap().path()).collect();
        files.sort();
        (files.into_iter().step_by(2).collect(), (9, 1))
    };
    let Views { size, views, refused } =
        views_from_paths(&paths, &TargetChoice::Any, &Response::default(), go_on).unwrap();
    assert_eq!(size, (1280, 720));
    assert_eq!((views.len(), refused.len()), counts, "{refused:?}");
    assert!(refused.iter().all(|refused| refused.reason.contains("is 1281x721 px where most are 1280x720")));
    let calibrated = calibrate(size, views, refused, &LensOptions::default()).unwrap();
    let (i, d) = (&calibrated.geometry.intrinsics, &calibrated.geometry.distortion);
    assert!(calibrated.rms_px <= 0.9, "{}", calibrated.rms_px);
    assert!((i.fx_px / 1159.1 - 1.0).abs() < 0.02 && (i.fy_px / 1154.5 - 1.0).abs() < 0.02, "{calibrated}");
    assert!((d.k1 / -0.2577 - 1.0).abs() < 0.05, "{calibrated}");
    assert!((i.cx_px - 669.6).abs() < 15.0 && (i.cy_px - 388.1).abs() < 15.0, "{calibrated}");
    assert_eq!(calibrated.target, DetectedTarget::Chessboard(ChessboardSize::new(9, 6)));
}

fn path(path: &Path) -> String {
    path.display().to_string()
}

#[test]
fn profile_takes_the_lens_and_keeps_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let camera = Camera::new(brown());
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    for (n, stand) in stands(&camera.geometry, 6, 11).iter().enumerate() {
        let picture = camera.photograph(stand, 1.0, n as u64);
        let codes = picture.values.iter().map(|v| *v as u8).collect();
        image::GrayImage::from_raw(SIZE.0, SIZE.1, codes).unwrap().save(photos.join(format!("{n}.png"))).unwrap();
    }
    image::GrayImage::new(80, 60).save(photos.join("dark.png")).unwrap();
    let [profile, residuals] = ["mine.toml", "residuals.png"].map(|name| path(&folder.path().join(name)));
    let mine = "# my camera\nversion = 1\n\n[camera] # a webcam\nfilm_width_mm = 5.5 # by its data sheet\n\n[noise]\nscale = 1.5\n";
    std::fs::write(&profile, mine).unwrap();
    let photos = path(&photos);
    let arguments = [
        "calibrate",
        "camera",
        &photos,
        "--board",
        "8x5",
        "--square-mm",
        "20",
        "-o",
        &profile,
        "--residuals",
        &residuals,
    ];
    let message = stdout_of(&arguments);
    assert!(
        message.contains("dark.png: no chessboard is seen") && message.contains("6 views of a board of 8x5 corners, "),
        "{message}"
    );
    assert!(message.contains("missing    6 views so far") && message.contains(" mm away"), "{message}");
    let written = std::fs::read_to_string(&profile).unwrap();
    for line in ["# my camera", "film_width_mm = 5.5 # by its data sheet", "scale = 1.5", "[camera] # a webcam"] {
        assert!(written.contains(line), "{line} is gone:\n{written}");
    }
    assert_eq!(written.matches("# By `locard calibrate camera`, from 6 views").count(), 1, "{written}");
    let mut rig = Rig::default();
    rig.read(Path::new(&profile), &mut Settings::default()).unwrap();
    let geometry = rig.camera().geometry.unwrap();
    assert!((geometry.intrinsics.fx_px / 610.0 - 1.0).abs() < 0.02, "{written}");
    assert_eq!(geometry.intrinsics.film_width_mm, 5.5);
    assert_eq!(image::image_dimensions(&residuals).unwrap(), (1400, 1090));

    // An existing file is kept without `--force`; with it the comment is not duplicated.
    let text = refused(&arguments);
    assert!(text.contains("has a lens already") && std::fs::read_to_string(&profile).unwrap() == written, "{text}");
    stdout_of(&[&arguments[..], &["--force"]].concat());
    assert_eq!(std::fs::read_to_string(&profile).unwrap(), written);
    for (extra, message) in [
        (["--board", "2x9"], "3 to 200 each"),
        (["--board", "none.toml"], "there is no such file; expected the inner corners"),
        (["--square-mm", "-1"], "0.01 to 100000 mm"),
        (["--model", "equirectangular"], "opencv or opencv_fisheye"),
    ] {
        let text = refused(&[&["calibrate", "camera", &photos, "-o", &profile], &extra[..]].concat());
        assert!(text.contains(message), "{text}");
    }
    let text = refused(&["calibrate", "camera", &photos, "--board", "6x4", "-o", &profile, "--force"]);
    assert!(text.contains("0 views of 7 can be used") && text.contains("more than the board's 6x4"), "{text}");
    let text = refused(&["calibrate", "camera", &path(&folder.path().join("none.png")), "-o", &profile, "--force"]);
    assert!(text.contains("none.png: cannot be read: there is no such file"), "{text}");
    assert_eq!(std::fs::read_to_string(&profile).unwrap(), written);
}
