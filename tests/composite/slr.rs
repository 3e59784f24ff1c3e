//! The virtual SLR compared with a real one, and `locard meter`.

use crate::common;
use crate::program::{refused, stdout_of};
use locard::camera::{Film, ThinLens};
use locard::recording::{OpenOptions, Recording};

fn json(arguments: &[&str]) -> serde_json::Value {
    serde_json::from_str(&stdout_of(&[arguments, &["--json"]].concat())).unwrap()
}

fn number(value: &serde_json::Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// The photographer's settings against geometry reconstructed from the pictures: a Nikon D60 has
/// 23.6 mm of film along the longer side. The remaining differences are focus (the nearer, the
/// narrower) and EXIF's rounding to whole millimetres.
#[test]
fn angle_of_view_from_exif_agrees_with_the_reconstruction() {
    let Some(folder) = common::data("lund-door-dslr") else { return };
    let recording = Recording::open(&folder, &OpenOptions::default()).unwrap();
    let film = "aps-c".parse::<Film>().unwrap().turned_for(recording.width, recording.height);
    assert_eq!((film.width_mm(), film.height_mm()), (15.7, 23.6));
    for frame in 0..recording.frame_count() {
        let exposure = recording.exposure[frame];
        let photo = exposure.photo;
        assert_eq!((photo.f_number, photo.time_s, photo.iso), (Some(4.8), Some(1.0 / 125.0), Some(400.0)));
        // Pictures on a nominal clock have no motion blur.
        assert_eq!(exposure.time_s, None);
        let lens = ThinLens::new(photo.focal_length_m.unwrap(), photo.f_number.unwrap(), f64::INFINITY).unwrap();
        let i = &recording.geometry_at_frame(frame).unwrap().intrinsics;
        let angle_rad = lens.angle_of_view_rad(film.height_mm());
        let found_rad = 2.0 * (0.5 * f64::from(i.height_px) / i.fy_px).atan();
        let (of_angle, of_focal_length) =
            (angle_rad / found_rad - 1.0, lens.fx_px(film.height_mm(), i.height_px) / i.fy_px - 1.0);
        println!("frame {frame}: angle {:.2} %, focal length {:.2} %", 100.0 * of_angle, 100.0 * of_focal_length);
        assert!(of_angle.abs() < 0.03 && of_focal_length.abs() < 0.03);
    }
}

#[test]
fn door_is_metered_from_its_picture() {
    let Some(folder) = common::data("lund-door-dslr") else { return };
    let folder = folder.to_str().unwrap();
    let report = json(&["meter", folder, "--frame", "0"]);
    assert_eq!(report["settings"]["text"], "f/4.8, 1/125 s, ISO 400");
    // The over-exposure is the ratio of the picture's mean to a grey card's.
    let mean = number(&report["scene"]["mean_light"]);
    assert!((number(&report["over_ev"]) - (mean / 0.18).log2()).abs() < 1e-9);
    // Daylight in the shade.
    let lux = number(&report["scene"]["illuminance_lx"]);
    assert!((500.0..5000.0).contains(&lux), "{lux} lx");
    let proposals = report["proposals"].as_array().unwrap();
    let modes: Vec<_> = proposals.iter().map(|p| p["mode"].as_str().unwrap()).collect();
    assert_eq!(modes, ["p", "a", "s", "m"]);
    for proposal in proposals {
        assert!(number(&proposal["over_ev"]).abs() <= 1.0 / 6.0 + 1e-6, "{proposal}");
    }
    let text = stdout_of(&["meter", folder, "--frame", "0"]);
    assert!(text.contains("settings   f/4.8, 1/125 s, ISO 400: EV 11.5") && text.contains("\nm manual "), "{text}");
}

#[test]
fn metering_follows_the_sunny_sixteen_rule() {
    // 81920 lx are EV 15 at ISO 100, for which f/16 at 1/125 s is right.
    let sunny =
        ["meter", "recordings/demo", "--frame", "0", "--lux", "81920", "--aperture", "16", "--shutter", "1/125"];
    let report = json(&[&sunny[..], &["--iso", "100"]].concat());
    assert!((number(&report["scene"]["ev"]) - 15.0).abs() < 1e-9);
    assert!((number(&report["settings"]["ev"]) - 15.0).abs() < 1e-9 && number(&report["over_ev"]).abs() < 1e-9);
    assert_eq!(report["scene"]["source"], "given");
    for (i, text) in [(1, "f/16, 1/125 s, ISO 100"), (2, "f/16, 1/125 s, ISO 100"), (3, "f/16, 1/125 s, ISO 100")] {
        assert_eq!(report["proposals"][i]["settings"]["text"], text);
    }
    // Two stops faster film: two stops over, and half the time twice.
    let fast = json(&[&sunny[..], &["--iso", "400"]].concat());
    assert!((number(&fast["over_ev"]) - 2.0).abs() < 1e-9);
    assert_eq!(fast["proposals"][1]["settings"]["text"], "f/16, 1/500 s, ISO 400");
    // f/32 would be right, but the lens ends at f/22.
    assert_eq!(fast["proposals"][2]["settings"]["text"], "f/22, 1/125 s, ISO 400");
    assert!((number(&fast["proposals"][2]["over_ev"]) - 1.0).abs() < 1e-9);
    assert_eq!(fast["proposals"][3]["settings"]["text"], "f/16, 1/125 s, ISO 100");
    let text = stdout_of(&[&sunny[..], &["--iso", "100", "--compensation", "-1"]].concat());
    assert!(text.contains("exposed    correctly") && text.contains("a aperture f/16, 1/250 s"), "{text}");
}

#[test]
fn missing_and_invalid_meter_inputs_are_named() {
    // The demonstration's camera is a pinhole: no f-number, so no light.
    let error = refused(&["meter", "recordings/demo", "--frame", "0"]);
    assert!(
        error.contains("the f-number of frame 0 is in neither EXIF nor a profile") && error.contains("--lux"),
        "{error}"
    );
    assert_eq!(error.lines().count(), 1, "{error}");
    // With an f-number the picture suffices; with only the light, all modes but aperture priority
    // do.
    let set = ["meter", "recordings/demo", "--frame", "0", "--set", "camera.lens.f_number=4"];
    assert_eq!(json(&set)["scene"]["source"], "picture");
    let lit = json(&["meter", "recordings/demo", "--frame", "0", "--lux", "500"]);
    assert_eq!(lit["missing"].as_array().unwrap().len(), 1);
    let modes: Vec<_> = lit["proposals"].as_array().unwrap().iter().map(|p| p["mode"].as_str().unwrap()).collect();
    assert_eq!(modes, ["p", "s"]);
    for (arguments, named) in [
        (&["--frame", "72"][..], "72 frames, numbered 0 to 71"),
        (&["--frame", "-1"], "--frame <N>': expected the number of a frame"),
        // An invalid lens is refused before missing inputs are.
        (&["--frame", "0", "--set", "camera.lens.blades=2"], "camera.lens.blades"),
        (&["--frame", "0", "--shutter", "0"], "more than 0 and up to 60 s"),
        (&["--frame", "0", "--aperture", "-2"], "0.5 to 256"),
        (&["--frame", "0", "--iso", "50"], "100 to 25600"),
        (&["--frame", "0", "--lux", "0"], "more than 0"),
        (&["--frame", "0", "--set", "camera.lens.f_number=0"], "0.5 to 256"),
    ] {
        let error = refused(&[&["meter", "recordings/demo"], arguments].concat());
        assert!(error.contains(named), "{error}");
    }
}
