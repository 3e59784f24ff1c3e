//! Virtual things beside real ones, judged by the program: as they should be, and with something wrong for each line.

use std::path::Path;

use crate::program::locard;
use crate::{common, found};

/// Each line's name and its verdict.
fn verdicts(arguments: &[&str]) -> Vec<(String, String)> {
    let output = locard(arguments);
    let text = String::from_utf8(output.stdout).unwrap();
    println!("{text}{}", String::from_utf8_lossy(&output.stderr));
    let lines = text.lines().filter(|line| !line.starts_with("pairs"));
    let found: Vec<(String, String)> = lines
        .map(|line| (line.split(' ').next().unwrap().to_owned(), line.rsplit(": ").next().unwrap().to_owned()))
        .collect();
    // What slides and what got worse is judged of an analysis.
    let lines = if arguments.contains(&"--no-analysis") { 4 } else { 6 };
    assert_eq!(found.len(), lines, "{text}");
    let is_well = found.iter().all(|(_, verdict)| verdict != "FAIL");
    assert_eq!(output.status.success(), is_well, "{text}");
    found
}

fn failed(found: &[(String, String)]) -> Vec<&str> {
    found.iter().filter(|(_, verdict)| verdict == "FAIL").map(|(name, _)| name.as_str()).collect()
}

#[test]
fn a_kinects_footage_passes_and_something_wrong_fails_its_own_line() {
    let Some((shot, found)) = found::kinect() else { return };
    let (out, folder) = (tempfile::tempdir().unwrap(), common::data("tum-fr1-rpy").unwrap());
    let analysis = out.path().join("found");
    found.write(&analysis, &shot.recording).unwrap();
    let [folder, analysis] = [folder.to_str().unwrap(), analysis.to_str().unwrap()].map(str::to_owned);
    let profile = ["--profile", "profiles/tum-fr1.toml", "--quiet"];
    let verified =
        |more: &[&str]| verdicts(&[&["verify", folder.as_str(), "--every", "60"], &profile[..], more].concat());
    let by = ["--analysis", analysis.as_str()];
    let found = verified(&by);
    assert!(found.iter().all(|(_, verdict)| verdict == "pass"), "{found:?}");
    // The poses as recorded, and light that nothing follows.
    assert_eq!(failed(&verified(&["--no-analysis"])), ["registration", "gain"]);
    // Too bright by half a stop; exposed for longer than it was; a lens softer than it is.
    let wrong = ["exposure.ev=0.5", "camera.exposure.time_s=0.033", "point_spread.sigma_px=1.1"];
    let sets: Vec<&str> = wrong.iter().flat_map(|set| ["--set", set]).collect();
    assert_eq!(failed(&verified(&[&by[..], &sets].concat())), ["gain", "blur", "sharpness"]);
    // Refined poses that sway by 3 cm and 5 times a second.
    let path = Path::new(&analysis).join("poses.txt");
    let swayed = |line: &str| {
        let mut numbers: Vec<f64> = line.split(' ').map(|number| number.parse().unwrap()).collect();
        numbers[1] += 0.03 * (10.0 * std::f64::consts::PI * numbers[0]).sin();
        numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
    };
    let text = std::fs::read_to_string(&path).unwrap();
    let line = |line: &str| if line.starts_with('#') { line.to_owned() } else { swayed(line) };
    std::fs::write(&path, text.lines().map(|text| line(text) + "\n").collect::<String>()).unwrap();
    let failing = verified(&by);
    assert!(["registration", "slide", "worse"].iter().all(|name| failed(&failing).contains(name)), "{failing:?}");
}
