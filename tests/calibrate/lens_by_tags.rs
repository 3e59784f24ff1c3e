//! Cameras from photographs of the sheet of tags. The photographs share no projection code with the
//! calibration.

use std::path::Path;
use std::sync::LazyLock;

use crate::program::{refused, stdout_of};
use crate::sheet::{CAMERA, Camera, CameraPose, Rays, SIZE, Sheet as Printed};
use crate::tier;
use glam::{DVec2, DVec3};
use locard::calibrate::board::{BoardDetector, DetectedTarget, TargetChoice};
use locard::calibrate::geometry::{CameraCalibration, LensOptions, NamedView, calibrate};
use locard::camera::Response;
use locard::pixels::Pixels;
use locard::tags::{Board, Paper, Sheet, picture};

static PRINTED: LazyLock<Printed> = LazyLock::new(|| {
    let picture = picture(&Sheet::new(Paper::A4));
    Printed::of(picture.width() as usize, picture.height() as usize, picture.pixels().map(|p| p[0]).collect())
});

/// A webcam with a wide lens.
const WIDE: Camera = Camera {
    focal_px: 430.0,
    centre_px: DVec2::new(311.0, 247.0),
    k1: -0.31,
    k2: 0.08,
    p1: -0.0008,
    p2: 0.0012,
    readout_s: 0.0,
};

/// Camera poses around the sheet: near and far, tilted in all directions, with the sheet in the
/// middle of the picture or cut off at its border.
fn around(camera: &Camera, n: u32) -> CameraPose {
    let (a, i) = (2.4 * f64::from(n), f64::from(n));
    let tilt = 0.3 + 0.4 * (0.7 * i).sin().abs();
    let far = camera.focal_px / 560.0 * (0.48 + 0.16 * (1.9 * i).sin());
    let at = far * DVec3::new(tilt.sin() * a.cos(), tilt.sin() * a.sin(), tilt.cos());
    let beside = 0.25 * far;
    CameraPose::look_at(at, DVec3::new(beside * (1.3 * i).sin(), beside * (2.1 * i).cos(), 0.0), 0.5 * (0.9 * i).sin())
}

fn photograph(camera: &Camera, rays: &Rays, n: u32) -> Vec<u8> {
    let place = around(camera, n);
    PRINTED.photograph_by_rays(rays, tier::fast_or_full(2, 3), 1.5, n.into(), |_| place)
}

/// Relative error of a parameter.
fn relative_error(calibrated: &CameraCalibration, name: &str, truth: f64) -> f64 {
    calibrated.parameters.iter().find(|parameter| parameter.name == name).unwrap().value / truth - 1.0
}

#[test]
fn camera_is_recovered_from_photographs_of_the_sheet() {
    let numbers = tier::fast_or_full(6..16, 0..16);
    let count = numbers.len();
    for camera in [CAMERA, WIDE] {
        let rays = Rays::of(&camera);
        let mut search = BoardDetector::new(&TargetChoice::Any, &Response::default()).unwrap();
        let (mut views, mut whole, mut furthest, mut sum, mut corners) = (Vec::new(), 0, 0f64, 0.0, 0.0);
        for n in numbers.clone() {
            let pixels = Pixels::from_u8(SIZE.0, SIZE.1, photograph(&camera, &rays, n)).unwrap();
            let Ok(detection) = search.find(&pixels) else { continue };
            whole += usize::from(detection.corners_px.len() == 24);
            for (board, at) in detection.board.iter().zip(&detection.corners_px) {
                let off = at.distance(around(&camera, n).project(&camera, DVec3::new(board.x, -board.y, 0.0)));
                furthest = furthest.max(off);
                (sum, corners) = (sum + off * off, corners + 1.0);
            }
            views.push(NamedView { name: n.to_string(), detection });
        }
        let rms_px = (sum / corners).sqrt();
        println!("{} views, {whole} whole; corners off by {rms_px:.3} px, {furthest:.3} px at most", views.len());
        assert!(views.len() + 2 >= count && (4..count - 2).contains(&whole), "{} views, {whole} whole", views.len());
        assert!(rms_px < 0.1 && furthest < 0.5, "{rms_px:.3} px, {furthest:.3} px");
        let calibrated = calibrate(SIZE, views, Vec::new(), &LensOptions::default()).unwrap();
        println!("{calibrated}");
        assert_eq!((calibrated.target, calibrated.unit_mm), (DetectedTarget::Tags(6), Some(1000.0)));
        // The required accuracy is 2 % and 5 %.
        assert!(relative_error(&calibrated, "fx_px", camera.focal_px).abs() < 0.005, "{calibrated}");
        assert!(relative_error(&calibrated, "fy_px", camera.focal_px).abs() < 0.005, "{calibrated}");
        assert!(relative_error(&calibrated, "k1", camera.k1).abs() < 0.05, "{calibrated}");
        let centre = DVec2::new(calibrated.geometry.intrinsics.cx_px, calibrated.geometry.intrinsics.cy_px);
        assert!(centre.distance(camera.centre_px) < 2.0, "{calibrated}");
        assert!(calibrated.rms_px < 0.15 && (calibrated.rms_px / rms_px - 1.0).abs() < 0.5, "{calibrated}");
    }
}

fn path(path: &Path) -> String {
    path.display().to_string()
}

fn save(codes: Vec<u8>, file: &Path) {
    image::RgbImage::from_raw(SIZE.0, SIZE.1, codes).unwrap().save(file).unwrap();
}

#[test]
fn program_detects_the_photographed_target() {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    let rays = Rays::of(&CAMERA);
    for n in 0..6 {
        save(photograph(&CAMERA, &rays, n), &photos.join(format!("{n}.png")));
    }
    // Squares of 60 px that fill the picture.
    let squares = (0..SIZE.0 * SIZE.1)
        .flat_map(|i| [if (i % SIZE.0 / 60 + i / SIZE.0 / 60).is_multiple_of(2) { 30 } else { 200 }; 3]);
    save(squares.collect(), &photos.join("squares.png"));
    save(vec![128; (3 * SIZE.0 * SIZE.1) as usize], &photos.join("wall.png"));
    let (profile, photos) = (path(&folder.path().join("mine.toml")), path(&photos));
    let stdout = stdout_of(&["calibrate", "camera", &photos, "-o", &profile]);
    for part in [
        "views      6 views of a board of 6 tags, ",
        "squares.png: shows a chessboard where most show printed tags",
        "wall.png: neither printed tags nor a chessboard are seen",
        " of 24 corners, rms ",
        " mm away",
    ] {
        assert!(stdout.contains(part), "{part} is not in\n{stdout}");
    }
    let written = std::fs::read_to_string(&profile).unwrap();
    assert!(written.contains("from 6 views of a board of 6 tags, ") && written.contains("k1 = -0.2"), "{written}");

    // The same tags in a board file with twice their size: the camera is the same.
    let twice = Sheet::new(Paper::A4).board.to_string().replace("version = 1", "version = 1\nscale = 2");
    let file = path(&folder.path().join("twice.toml"));
    std::fs::write(&file, &twice).unwrap();
    let again = stdout_of(&["calibrate", "camera", &photos, "--board", &file, "-o", &profile, "--force"]);
    let line = |stdout: &str, name: &str| stdout.lines().find(|line| line.starts_with(name)).unwrap().to_owned();
    assert_eq!(line(&stdout, "camera.fx_px"), line(&again, "camera.fx_px"));
    assert!(again.contains("squares.png: no tags are seen"), "{again}");
    // Tags of another board.
    std::fs::write(&file, "version = 1\nfamily = \"36h11\"\n[[tags]]\nid = 77\nsize_m = 0.1\ncenter_m = [0, 0]\n")
        .unwrap();
    let text = refused(&["calibrate", "camera", &photos, "--board", &file, "-o", &profile, "--force"]);
    assert!(text.contains("the visible tags are not on the board: 0, 1"), "{text}");
    assert!(Board::parse(&twice).is_ok() && text.lines().count() == 1, "{text}");
    // The board's file is not overwritten.
    let text = refused(&["calibrate", "camera", &photos, "--board", &file, "-o", &file, "--force"]);
    assert!(text.contains("twice.toml"), "{text}");
}
