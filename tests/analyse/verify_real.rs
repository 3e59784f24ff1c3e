//! Virtual objects compared with real ones by `verify`: correct, as recorded, and with one fault
//! for each line.

use std::path::Path;

use crate::program::locard;
use crate::{common, findings};

/// A line of the report: its name, the value for the recorded data, and its verdict.
struct Line {
    name: String,
    recorded: f64,
    verdict: String,
}

fn lines(arguments: &[&str]) -> Vec<Line> {
    let output = locard(arguments);
    let text = String::from_utf8(output.stdout).unwrap();
    println!("{text}{}", String::from_utf8_lossy(&output.stderr));
    let line = |line: &str| Line {
        name: line.split(' ').next().unwrap().to_owned(),
        recorded: line
            .split_once("recorded ")
            .map_or(f64::NAN, |(_, value)| value.split(' ').next().unwrap().parse().unwrap_or(f64::NAN)),
        verdict: line.rsplit(": ").next().unwrap().to_owned(),
    };
    let lines: Vec<Line> = text
        .lines()
        .filter(|line| !["pairs", "noise", " "].iter().any(|start| line.starts_with(start)))
        .map(line)
        .collect();
    let names: Vec<&str> = lines.iter().map(|line| line.name.as_str()).collect();
    assert_eq!(names, ["registration", "gain", "blur", "sharpness", "slide", "worse"], "{text}");
    let is_well = lines.iter().all(|line| line.verdict != "FAIL");
    assert_eq!(output.status.success(), is_well, "{text}");
    lines
}

#[test]
#[ignore = "full tier: all frames of a real recording, judged twice; lib::verify::blur::tests::ratio_is_virtual_blur_by_real_blur is its small form, for blur alone"]
fn kinect_footage_passes_and_each_fault_fails_its_own_line() {
    let Some((shot, analysis)) = findings::kinect() else { return };
    let (out, folder) = (tempfile::tempdir().unwrap(), common::data("tum-fr1-rpy").unwrap());
    let analysis_folder = out.path().join("analysis");
    analysis.write(&analysis_folder, &shot.recording).unwrap();
    let [folder, analysis] = [folder.to_str().unwrap(), analysis_folder.to_str().unwrap()].map(str::to_owned);
    let profile = ["--profile", "profiles/tum-fr1.toml", "--quiet"];
    let by = ["--analysis", analysis.as_str()];
    let verified =
        |more: &[&str]| lines(&[&["verify", folder.as_str(), "--every", "60"], &profile[..], &by[..], more].concat());
    let report = verified(&[]);
    assert!(report.iter().all(|line| line.verdict == "pass"));
    // With the recorded poses and gain off, evidence is displaced and differs in brightness.
    let of = |name: &str| report.iter().find(|line| line.name == name).unwrap().recorded;
    assert!(of("registration") > 0.7 && of("gain") > 1.5 && (0.8..1.25).contains(&of("blur")) && of("slide") > 1.0);
    // Half a stop too bright; an exposure time longer than the real one; a lens softer than the
    // real one; refined poses that sway by 3 cm, 5 times a second.
    let wrong = ["exposure.ev=0.5", "camera.exposure.time_s=0.033", "point_spread.sigma_px=1.1"];
    let sets: Vec<&str> = wrong.iter().flat_map(|set| ["--set", set]).collect();
    let path = Path::new(&analysis).join("poses.txt");
    let swayed = |line: &str| {
        let mut numbers: Vec<f64> = line.split(' ').map(|number| number.parse().unwrap()).collect();
        numbers[1] += 0.03 * (10.0 * std::f64::consts::PI * numbers[0]).sin();
        numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
    };
    let text = std::fs::read_to_string(&path).unwrap();
    let line = |line: &str| if line.starts_with('#') { line.to_owned() } else { swayed(line) };
    std::fs::write(&path, text.lines().map(|text| line(text) + "\n").collect::<String>()).unwrap();
    let failing = verified(&sets);
    assert!(failing.iter().all(|line| line.verdict == "FAIL"));
}
