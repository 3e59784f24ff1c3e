//! Writes the estimates that belong to the camera into its profile: readout, exposure, sharpness.
//! Estimates of the recording (poses, gain) or of the tracking system (clocks) stay in the
//! analysis.

use super::findings::{Findings, SharpnessFindings};
use super::registration_result::MAX_READOUT_SIGMA_S;
use crate::calibrate::sharpness::PARAMETER;
use crate::camera::{CameraExposure, Intrinsics};
use crate::effects::point_spread::sigma_for_measured_px;
use crate::params::Params;
use crate::profile::ProfileFile;
use crate::text::count;

/// Resolution of written values, finer than their uncertainty: units per second, and per pixel.
const UNITS_PER_SECOND: f64 = 1e5;
const UNITS_PER_PIXEL: f64 = 1e3;
/// Parameter that takes precedence over the exposure time.
const SHUTTER_ANGLE: &str = "shutter_angle_deg";

/// Result for one key of a profile.
#[derive(Clone, Debug, PartialEq)]
pub struct AcceptOutcome {
    /// The key with its table.
    pub key: String,
    pub outcome: Outcome,
}

/// Result for one parameter of the profile; values are in the unit of the parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// `before`: the profile's value, which can be the same as `after`.
    Written { before: Option<f64>, after: f64 },
    /// The profile's value is unchanged. The reason.
    Kept(String),
}

/// Writes an analysis's estimates of the camera into its profile.
pub fn accept(findings: &Findings, profile: &mut ProfileFile) -> Vec<AcceptOutcome> {
    let (intrinsics, exposure) = (Intrinsics::default(), CameraExposure::default());
    let time_s = match profile.number(exposure.table(), SHUTTER_ANGLE) {
        Some(_) => Err(format!("the profile has {SHUTTER_ANGLE}, which takes precedence")),
        None => time_s(findings),
    };
    let estimates = [
        (intrinsics.table(), "readout_time_s", readout_s(findings)),
        (PARAMETER.0, PARAMETER.1, sigma_px(findings.spread.as_ref())),
        (exposure.table(), "time_s", time_s),
    ];
    let put = |(table, name, estimates): (&str, &str, Result<f64, String>)| {
        let outcome = match estimates {
            Ok(after) => {
                let before = profile.number(table, name);
                if before != Some(after) {
                    profile.set_number(table, name, after);
                }
                Outcome::Written { before, after }
            }
            Err(why) => Outcome::Kept(why),
        };
        AcceptOutcome { key: format!("{table}.{name}"), outcome }
    };
    estimates.map(put).into()
}

fn rounded(value: f64, parts: f64) -> f64 {
    (value * parts).round() / parts
}

fn readout_s(findings: &Findings) -> Result<f64, String> {
    let why = || {
        if findings.registration.is_refined() {
            "the camera moves too little to determine it"
        } else {
            "it is estimated with the poses, which are as recorded"
        }
    };
    let readout_s = findings.readout_s().ok_or_else(|| why().to_owned())?;
    match findings.readout_uncertainty_s().filter(|sigma_s| *sigma_s > MAX_READOUT_SIGMA_S) {
        Some(sigma_s) => Err(format!("parts of the recording disagree: ± {:.1} ms", 1e3 * sigma_s)),
        None => Ok(rounded(readout_s, UNITS_PER_SECOND)),
    }
}

/// The profile's σ by which rendered edges measure as sharp as the footage's.
fn sigma_px(spread: Option<&SharpnessFindings>) -> Result<f64, String> {
    let unknown = "it was not estimated".to_owned();
    let spread = spread.ok_or_else(|| unknown.clone())?;
    let sigma_px = spread.sigma_px.ok_or_else(|| spread.why.clone().unwrap_or(unknown))?;
    Ok(rounded(sigma_for_measured_px(sigma_px), UNITS_PER_PIXEL))
}

/// The exposure time, if it is the same for all frames.
fn time_s(findings: &Findings) -> Result<f64, String> {
    let shutter = findings.shutter.as_ref();
    if shutter.is_some_and(|shutter| shutter.nominal_interval_s.is_some()) {
        return Err("the recording has no timestamps: it is known only as a fraction of the frame interval".to_owned());
    }
    match shutter.map_or(&[][..], |shutter| &shutter.runs) {
        [run] => Ok(rounded(run.exposure_s, UNITS_PER_SECOND)),
        [] => Err(shutter.and_then(|shutter| shutter.why.clone()).unwrap_or("it was not estimated".to_owned())),
        runs => {
            Err(format!("it varies between frames ({}), and is stored in the analysis", count(runs.len(), "exposure")))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use serde_json::json;

    use super::*;
    use crate::camera::Geometry;

    /// Readout 26.65 ms ± 0.4 ms, σ 0.566 px, exposures of these runs of frames.
    fn findings(poses: &str, runs: &[(usize, usize)]) -> Findings {
        let mut camera = Geometry::pinhole(640, 480, 500.0);
        camera.intrinsics.readout_time_s = 0.0266512;
        let run = |(from, to): &(usize, usize)| json!({ "from": from, "to": to, "exposure_s": 0.019444, "sigma_s": 0.0001, "samples": 8 });
        let registration = json!({
            "poses": poses, "links": 9, "missing_links": 0, "depth_later_s": 0.0, "readout_sigma_s": 0.0004
        });
        let spread = json!({ "sigma_px": 0.566, "between_px": [0.5, 0.6], "edges": 50 });
        let json = json!({
            "version": 2, "recording": "", "frames": 20, "registration": registration, "spread": spread,
            "shutter": { "runs": runs.iter().map(run).collect::<Vec<_>>() }, "camera": camera
        });
        serde_json::from_value(json).unwrap()
    }

    fn taken(findings: &Findings, text: &str) -> (Vec<String>, String) {
        let mut profile = ProfileFile::parse(text, Path::new("p.toml")).unwrap();
        let outcomes = accept(findings, &mut profile).into_iter().map(|accepted| match accepted.outcome {
            Outcome::Written { before, after } => format!("{} {before:?} {after}", accepted.key),
            Outcome::Kept(why) => format!("{} stays: {why}", accepted.key),
        });
        (outcomes.collect(), profile.to_string())
    }

    #[test]
    fn camera_estimates_are_written_and_comments_are_kept() {
        let text = "version = 1\n# a camera\n[camera]\nreadout_time_s = 0.02 # guessed\n[point_spread]\nsigma_px = 1 # by eye\n";
        let (outcomes, written) = taken(&findings("refined", &[(0, 20)]), text);
        // An edge rendered with 0.6 px measures 0.566 px.
        assert_eq!(
            outcomes,
            [
                "camera.readout_time_s Some(0.02) 0.02665",
                "point_spread.sigma_px Some(1.0) 0.6",
                "camera.exposure.time_s None 0.01944"
            ]
        );
        let expected = text.replace("0.02 ", "0.02665 ").replace("= 1 # by eye", "= 0.6 # by eye");
        assert!(written.starts_with(&expected[..60]) && written.contains("sigma_px = 0.6 # by eye\n"), "{written}");
        assert!(written.contains("[camera.exposure]\ntime_s = 0.01944\n"), "{written}");
        ProfileFile::parse(&written, Path::new("p.toml")).unwrap();
    }

    #[test]
    fn values_without_an_estimate_are_kept() {
        let text = "version = 1\n[camera.exposure]\ntime_s = 0.01\n";
        let mut two_runs = findings("right", &[(0, 9), (9, 20)]);
        two_runs.spread = None;
        let (outcomes, written) = taken(&two_runs, text);
        assert_eq!(written, text);
        assert!(
            outcomes.iter().all(|outcome| outcome.contains(" stays: ")) && outcomes[2].contains("2 exposures"),
            "{outcomes:?}"
        );
        // The angle takes precedence over the time.
        let angled = "version = 1\n[camera.exposure]\nshutter_angle_deg = 180\n";
        let (outcomes, written) = taken(&findings("right", &[(0, 20)]), angled);
        assert!(
            outcomes[2].contains("shutter_angle_deg, which takes precedence") && !written.contains("time_s ="),
            "{outcomes:?}"
        );
        // A readout with a large uncertainty.
        let mut unsure = findings("refined", &[(0, 20)]);
        unsure.registration.readout_sigma_s = Some(0.002);
        assert!(taken(&unsure, text).0[0].contains("moves too little"));
        // Scatter is small, and parts differ.
        unsure.registration.readout_sigma_s = Some(0.0004);
        unsure.registration.readout_parts_sigma_s = Some(0.0015);
        assert!(taken(&unsure, text).0[0].contains("parts of the recording disagree: ± 1.5 ms"));
    }
}
