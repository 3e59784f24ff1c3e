//! Case card, records of photographs and photo log, by the program.

use std::path::Path;

use crate::program::{locard, refused};
use crate::tier;

const CASE: &str =
    "case_number = \"2026-0142\"\ndate = \"30 Nov 2026\"\nplace = \"Office\"\nphotographer = \"K. Meier\"\n";

fn done(arguments: &[&str]) -> String {
    let output = locard(arguments);
    assert!(output.status.success(), "{arguments:?}: {output:?}");
    String::from_utf8(output.stderr).unwrap()
}

// Slow: takes a photograph of the demonstration.
#[test]
fn series_of_card_and_photograph_is_logged_with_its_faults() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(path("case.toml"), CASE).unwrap();
    std::fs::create_dir(path("series")).unwrap();
    done(&["case-card", &path("case.toml"), "-o", &path("series/a.png")]);
    let photo = ["photo", "recordings/demo", "--scene", "scenes/demo.toml", "--frame", "71", "--lux", "300", "-q"];
    let settings = ["--width", "320", "--only", "motion_blur", "--aperture", "8", "--shutter", "1/15", "--iso", "100"];
    let photograph = path("series/b.jpg");
    let aim = ["--aim", "marker 2", "-o", &photograph];
    done(&[&photo[..], &settings, &aim, tier::no_shadows()].concat());

    let record = std::fs::read_to_string(path("series/b.jpg.record.json")).unwrap();
    let record: serde_json::Value = serde_json::from_str(&record).unwrap();
    let view = &record["photograph"]["view"];
    assert_eq!((&record["version"], &record["photograph"]["number"]), (&1.into(), &2.into()));
    assert_eq!(
        (&view["frame"], &view["support"], &view["subject"]["name"]),
        (&71.into(), &"tripod".into(), &"marker 2".into())
    );
    // log2(300 lx · ISO 100 / 250) − log2(8² · 16): 1/15 stands for 1/16 s.
    let off_ev = view["exposure_deviation_ev"].as_f64().unwrap();
    assert!((off_ev + 3.093).abs() < 0.001, "{off_ev}");
    // The camera of the demonstration points 44° to 46° below the horizon in all frames.
    let angle_deg = view["subject"]["angle_deg"].as_f64().unwrap();
    assert!((43.0..48.0).contains(&angle_deg), "{angle_deg}");
    let objects = view["objects"].as_array().unwrap();
    let kinds: Vec<_> = objects.iter().map(|object| object["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["marker", "scale", "evidence", "evidence", "evidence", "marker", "scale"]);
    assert!(objects.iter().all(|object| (0.0..=1.0).contains(&object["share"].as_f64().unwrap())));

    let faults = done(&["photo-log", &path("series"), "-o", &path("log")]);
    assert!(faults.contains("series: case 3 (marker 2) has no close-up"), "{faults}");
    assert!(faults.contains("2, b.jpg: underexposed by"), "{faults}");
    let csv = std::fs::read_to_string(path("log.csv")).unwrap();
    assert!(csv.lines().count() == 3 && csv.contains("1,a.png,") && csv.contains("case card 2026-0142"), "{csv}");
    let page = std::fs::read_to_string(path("log.html")).unwrap();
    assert_eq!(page.matches("data:image/jpeg;base64,").count(), 2);
    let text = refused(&["photo-log", &path("series"), "-o", &path("log")]);
    assert!(text.contains("exists already"), "{text}");
}

#[test]
fn card_and_log_without_their_inputs_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(path("case.toml"), CASE.replace("K. Meier", "")).unwrap();
    let text = refused(&["case-card", &path("case.toml"), "-o", &path("a.jpg")]);
    assert!(text.contains("photographer is empty") && !Path::new(&path("a.jpg")).exists(), "{text}");
    let text = refused(&["photo-log", temp.path().to_str().unwrap(), "-o", &path("log")]);
    assert!(text.contains("no photograph with a record") && !Path::new(&path("log.csv")).exists(), "{text}");
    let text = refused(&["photo-log", &path("none.jpg"), "-o", &path("log")]);
    assert!(text.contains("none.jpg: does not exist"), "{text}");
}
