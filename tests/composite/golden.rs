//! Approved pictures that the program must reproduce.
//!
//! They were made by Mesa's llvmpipe. `LOCARD_GOLDEN=write scripts/test composite::golden` makes
//! them anew; inspect each before committing it. If one differs, `LOCARD_TEST_OUT=FOLDER` stores
//! the new picture.

use std::path::Path;

use crate::gpu;
use crate::shot;
use image::{Rgb, RgbImage};
use locard::compositor::Settings;
use locard::params::Value;
use locard::pixels::{Codes, Pixels, Rect};

/// Tolerances for other drivers: the share of codes of virtual pixels more than 1 apart, and the
/// mean difference over the whole crop. The same driver changes nothing. Drivers may place coverage
/// samples, choose mipmap levels and round differently: SwiftShader has 0.06 and 0.10 against
/// llvmpipe, at silhouettes and in print. Another seed, no noise, no blur, a sun 8 % dimmer or an
/// object displaced by 5 mm change a share of 0.5 or more.
const MAX_DIFFERENT_SHARE: f64 = 0.12;
const MAX_MEAN_DIFFERENCE: f64 = 0.25;

/// A crop of a frame.
struct Crop {
    made: RgbImage,
    camera: RgbImage,
}

/// A crop of a composited frame of the demonstration.
fn picture(scene: &str, frame: usize, crop: Rect, settings: Settings) -> Crop {
    let mut shot = shot::demo(scene);
    shot.settings = settings;
    let cut = |pixels: &Pixels| {
        let Codes::U8(codes) = &pixels.codes else { panic!("8 bits expected") };
        let whole = RgbImage::from_raw(pixels.width, pixels.height, codes.clone()).unwrap();
        image::imageops::crop_imm(&whole, crop.x0 as u32, crop.y0 as u32, crop.width(), crop.height()).to_image()
    };
    let done = shot::composited(&gpu::gpu(), &shot, frame..frame + 1).remove(0);
    Crop { made: cut(&done.pixels), camera: cut(&shot.read(frame).unwrap().pixels) }
}

fn check(name: &str, Crop { made, camera }: Crop) {
    let path = format!("tests/golden/{name}.png");
    if std::env::var("LOCARD_GOLDEN").as_deref() == Ok("write") {
        made.save(&path).unwrap();
    }
    let golden = image::open(&path).unwrap().into_rgb8();
    assert!(std::fs::metadata(&path).unwrap().len() < 60_000, "{path} is too large");
    assert_eq!(golden.dimensions(), made.dimensions(), "{path}");
    let pixels = || golden.pixels().zip(made.pixels()).zip(camera.pixels());
    let apart = |(g, m): (&Rgb<u8>, &Rgb<u8>)| [0, 1, 2].map(|c| g[c].abs_diff(m[c]));
    let all: Vec<u8> = pixels().flat_map(|(pair, _)| apart(pair)).collect();
    let virtual_ones: Vec<u8> =
        pixels().filter(|((g, m), c)| g != c || m != c).flat_map(|(pair, _)| apart(pair)).collect();
    let share = virtual_ones.iter().filter(|&&d| d > 1).count() as f64 / virtual_ones.len() as f64;
    let mean = all.iter().map(|&d| f64::from(d)).sum::<f64>() / all.len() as f64;
    println!("{name}: {share:.3} of {} codes differ by more than 1; mean {mean:.3}", virtual_ones.len());
    let fits = share <= MAX_DIFFERENT_SHARE && mean <= MAX_MEAN_DIFFERENCE && virtual_ones.len() > 1000;
    if !fits && let Some(folder) = std::env::var_os("LOCARD_TEST_OUT") {
        made.save(Path::new(&folder).join(format!("{name}.png"))).unwrap();
    }
    assert!(fits, "{path}: {share:.3} of {} codes differ by more than 1; mean {mean:.3}", virtual_ones.len());
}

// Slow: bakes the light of the whole demonstration scene at full resolution.
#[test]
fn evidence_on_the_stool_matches_the_golden_picture() {
    let crop = Rect::new(280, 270, 440, 375);
    check("evidence", picture("scenes/demo.toml", 62, crop, Settings::default()));
    let mut plain = Settings::default();
    plain.plain();
    check("evidence-plain", picture("scenes/demo.toml", 62, crop, plain));
}

#[test]
fn evidence_during_a_pan_matches_the_golden_picture() {
    let crop = Rect::new(425, 215, 565, 315);
    check("turning", picture("scenes/demo.toml", 31, crop, Settings::default()));
    let copies = gpu::settings(&[("motion_blur", "method", Value::Text("copies".to_owned()))]);
    check("turning-copies", picture("scenes/demo.toml", 31, crop, copies));
}

#[test]
fn evidence_behind_the_ball_matches_the_golden_picture() {
    let settings =
        gpu::settings(&[("edge_blend", "impact", Value::Number(1.0)), ("noise", "magnification", Value::Number(2.0))]);
    check("behind", picture("tests/golden/behind.toml", 10, Rect::new(350, 100, 480, 185), settings));
}
