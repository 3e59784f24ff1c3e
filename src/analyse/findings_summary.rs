//! One line about an analysis, for a message. [`Findings::lines`] has all of it.

use super::findings::{Findings, PoseFindings, ShutterFindings};
use super::light_findings::LightFindings;
use crate::text::fixed;

impl Findings {
    /// Camera path, exposure and light in a few words: "camera path residual 2.90 -> 0.13 px,
    /// exposure 1/52 s, light found".
    pub fn summary(&self) -> String {
        [path(&self.registration), exposure(self.shutter.as_ref()), light(self.light.as_ref())].join(", ")
    }
}

/// Median residual of held-out frame pairs by the recorded and by the refined poses. It is smaller
/// than the poses' error in the picture, so it is not called an error.
fn path(poses: &PoseFindings) -> String {
    let px = |value: f64| fixed(value, 2);
    match (poses.recorded_px, poses.refined_px) {
        (Some(recorded), Some(refined)) if poses.is_refined() => {
            format!("camera path residual {} -> {} px", px(recorded), px(refined))
        }
        (Some(recorded), _) if poses.is_right() => {
            format!("camera path kept as recorded (residual {} px)", px(recorded))
        }
        _ if poses.is_refined() => "camera path refined".to_owned(),
        _ if poses.motion_px.is_some() => "camera path kept as recorded, its motion refined".to_owned(),
        _ => "camera path kept as recorded".to_owned(),
    }
}

/// Shortest and longest exposure time.
fn exposure(shutter: Option<&ShutterFindings>) -> String {
    let Some(shutter) = shutter.filter(|shutter| !shutter.runs.is_empty()) else {
        return "exposure unknown".to_owned();
    };
    let time = |s: f64| match shutter.nominal_interval_s {
        // Recordings without times.
        Some(interval_s) => format!("{} % of the frame interval", fixed(100.0 * s / interval_s, 0)),
        None if s < 0.29 => format!("1/{} s", fixed(1.0 / s, 0)),
        None => format!("{} s", fixed(s, 2)),
    };
    let [shortest, longest] = shutter
        .runs
        .iter()
        .fold([f64::INFINITY, 0.0], |[min_s, max_s], run| [min_s.min(run.exposure_s), max_s.max(run.exposure_s)])
        .map(time);
    if shortest == longest { format!("exposure {shortest}") } else { format!("exposure {shortest} to {longest}") }
}

fn light(light: Option<&LightFindings>) -> String {
    match light {
        Some(light) if light.claimed && light.white_level.is_some() => "light found".to_owned(),
        Some(light) if light.white_level.is_some() => "brightness of the light uncertain".to_owned(),
        _ => "light unknown".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analyse::shutter::{ExposureRun, ExposureRuns};

    fn poses(verdict: &str) -> PoseFindings {
        PoseFindings {
            poses: verdict.to_owned(),
            recorded_px: Some(2.9),
            refined_px: Some(0.13),
            ..PoseFindings::unchecked(String::new())
        }
    }

    #[test]
    fn camera_path_is_summarised_by_its_verdict() {
        assert_eq!(path(&poses("refined")), "camera path residual 2.90 -> 0.13 px");
        assert_eq!(path(&poses("right")), "camera path kept as recorded (residual 2.90 px)");
        assert_eq!(path(&poses("refused")), "camera path kept as recorded");
        let moved = PoseFindings { motion_px: Some(0.2), ..PoseFindings::unchecked(String::new()) };
        assert_eq!(path(&moved), "camera path kept as recorded, its motion refined");
    }

    #[test]
    fn exposure_is_summarised_by_its_range() {
        let run = |exposure_s| ExposureRun { from: 0, to: 1, exposure_s, sigma_s: 0.0, samples: 1 };
        let findings = |times_s: &[f64], interval_s| {
            let runs = times_s.iter().copied().map(run).collect();
            ShutterFindings::of(Ok(ExposureRuns { runs, samples: Vec::new() }), interval_s)
        };
        assert_eq!(exposure(None), "exposure unknown");
        assert_eq!(exposure(Some(&ShutterFindings::of(Err("blur".to_owned()), None))), "exposure unknown");
        assert_eq!(exposure(Some(&findings(&[0.0192], None))), "exposure 1/52 s");
        assert_eq!(exposure(Some(&findings(&[0.02, 0.01], None))), "exposure 1/100 s to 1/50 s");
        assert_eq!(exposure(Some(&findings(&[0.5], None))), "exposure 0.50 s");
        assert_eq!(exposure(Some(&findings(&[0.01], Some(0.04)))), "exposure 25 % of the frame interval");
    }

    #[test]
    fn light_without_an_estimate_is_unknown() {
        assert_eq!(light(None), "light unknown");
        let failed = LightFindings::of(&Err("too few surfaces".to_owned()), None);
        assert_eq!(light(Some(&failed)), "light unknown");
    }
}
