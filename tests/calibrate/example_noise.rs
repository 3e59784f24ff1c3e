//! Noise by example that `locard calibrate noise` writes beside a profile.

use std::path::{Path, PathBuf};

use crate::program::{refused, stdout_of};
use crate::random::Random;
use locard::coding::PictureCoding;
use locard::profile::Rig;

const SIDE: u32 = 208;

/// Frames of a camera at rest: left half dark with σ 2, right half bright with σ 5.
fn frames(folder: &Path, count: u32) -> Vec<PathBuf> {
    let mut random = Random::new(4);
    let mut frame = |index: u32| {
        let picture = image::RgbImage::from_fn(SIDE, SIDE, |x, _| {
            let (level, sigma) = if x < SIDE / 2 { (60.0, 2.0) } else { (180.0, 5.0) };
            image::Rgb([(); 3].map(|()| (level + sigma * random.normal()).round() as u8))
        });
        let file = folder.join(format!("{index}.png"));
        picture.save(&file).unwrap();
        file
    };
    (0..count).map(&mut frame).collect()
}

#[test]
fn resting_frames_give_a_profile_whose_model_fits_uncoded_pictures() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    std::fs::create_dir(path("rest")).unwrap();
    frames(&temp.path().join("rest"), 4);
    let (rest, profile) = (path("rest"), path("camera.toml"));
    let arguments = ["calibrate", "noise", &rest, "-o", &profile];

    let text = stdout_of(&arguments);
    assert!(text.contains("noise by example, from 4 frames at rest: 4 parts of 0.2 Mpx"), "{text}");
    assert!(text.contains("camera.locnoise: 0.") && text.contains("hold the camera still for two seconds"), "{text}");
    let written = std::fs::read_to_string(&profile).unwrap();
    assert!(written.contains("\nexample = \"camera.locnoise\"\n"), "{written}");
    let example = Rig::of_file(Path::new(&profile)).unwrap().noise.unwrap().example.unwrap();
    assert_eq!(example.model.numbers.coding.difference(&PictureCoding::UNROUNDED), None);

    assert!(refused(&arguments).contains("[camera.noise] already"));
    let again = stdout_of(&[&arguments[..], &["--force", "--no-example"]].concat());
    let written = std::fs::read_to_string(&profile).unwrap();
    assert!(!again.contains("example") && !written.contains("example"), "{again}{written}");
    // The file of an earlier calibration is not replaced without a word.
    std::fs::remove_file(&profile).unwrap();
    let text = refused(&arguments);
    assert!(text.contains("camera.locnoise: exists already"), "{text}");
    assert!(!Path::new(&profile).exists());
}

#[test]
fn pair_without_its_model_file_is_refused_with_its_name() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let noisy = frames(temp.path(), 1).remove(0);
    let mean = image::RgbImage::from_fn(SIDE, SIDE, |x, _| image::Rgb([if x < SIDE / 2 { 60 } else { 180 }; 3]));
    mean.save(path("mean.png")).unwrap();
    let profile = path("pair.toml");
    let text = stdout_of(&["calibrate", "noise", noisy.to_str().unwrap(), "--mean", &path("mean.png"), "-o", &profile]);
    assert!(text.contains("from frames with a clean picture: 1 part of 0.0 Mpx"), "{text}");
    std::fs::remove_file(path("pair.locnoise")).unwrap();
    let text = refused(&[
        "composite",
        "recordings/demo",
        "--scene",
        "scenes/demo.toml",
        "--profile",
        &profile,
        "-o",
        &path("v.mkv"),
    ]);
    assert!(
        text.contains("pair.toml: [camera.noise] example: ") && text.contains("pair.locnoise: cannot be read"),
        "{text}"
    );
}
