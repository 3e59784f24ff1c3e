//! Estimates of an analysis that no longer hold for the recording as it was opened.
//!
//! | estimate | depends on |
//! |---|---|
//! | gain, gain across the picture, tone, point spread | the recording's files and the camera |
//! | exposure | also whether the frames have times |
//! | poses, clocks, readout | also the unit (with depth in metres), and whether frames have times |
//! | surfels | as the poses |
//! | light | also the unit's length, and up |

use super::artefact::Analysis;
use super::dependencies::Dependencies;
use super::findings::{Findings, PoseFindings, ShutterFindings};
use super::light_findings::LightFindings;
use crate::recording::Recording;
use crate::text::number;

/// Which estimates depend on a changed input, and the reason.
#[derive(Clone, Debug, PartialEq)]
struct Stale {
    registration: bool,
    surfels: bool,
    shutter: bool,
    light: bool,
    why: String,
}

impl Findings {
    /// True if there is no light, or if it holds for this length of the recording's unit, m.
    pub fn is_light_of_unit(&self, metres_per_unit: f64) -> bool {
        let now = Dependencies { metres_per_unit, ..self.made_with.clone() };
        self.made_with.is_metric || self.made_with.has_unit_of(&now) || !self.has_light()
    }

    fn has_light(&self) -> bool {
        self.light.as_ref().is_some_and(|light| light.panorama.is_some())
    }

    /// True if registration depends on lengths: if there are links or refined poses.
    fn is_registered(&self) -> bool {
        self.registration.links + self.registration.missing_links > 0 || self.registration.pose_lines > 0
    }

    fn stale(&self, now: &Dependencies) -> Vec<Stale> {
        let then = &self.made_with;
        let none = Stale { registration: false, surfels: false, shutter: false, light: false, why: String::new() };
        let mut stale = Vec::new();
        if then.has_times != now.has_times {
            stale.push(Stale {
                registration: self.is_registered(),
                surfels: self.surfels.is_some(),
                shutter: self.shutter.as_ref().is_some_and(|shutter| !shutter.runs.is_empty()),
                why: "other frame times than the recording has now: analyse the recording again".to_owned(),
                ..none.clone()
            });
        }
        if !then.has_unit_of(now) {
            let (was, is) = (number(then.metres_per_unit), number(now.metres_per_unit));
            let option = if now.is_metric { String::new() } else { format!(" with --metres-per-unit {is}") };
            stale.push(Stale {
                registration: self.is_registered(),
                surfels: self.surfels.is_some(),
                light: self.has_light(),
                why: format!("a unit of {was} m, which is {is} m now: analyse the recording again{option}"),
                ..none.clone()
            });
        }
        if !then.has_up_of(now) {
            stale.push(Stale {
                light: self.has_light(),
                why: "another up than the recording's now: analyse the recording again".to_owned(),
                ..none
            });
        }
        stale.retain(|stale| stale.registration || stale.surfels || stale.shutter || stale.light);
        stale
    }
}

impl Analysis {
    /// True if all estimates hold for the recording as it was opened.
    pub fn is_current(&self, recording: &Recording) -> bool {
        self.findings.stale(&Dependencies::of(recording)).is_empty()
    }

    /// Drops the estimates that no longer hold. [`Findings::left_out`] lists them with the reasons
    /// and remedies.
    pub fn without_stale(mut self, recording: &Recording) -> Self {
        for stale in self.findings.stale(&Dependencies::of(recording)) {
            let names = [
                (stale.registration, "poses"),
                (stale.surfels, "surfaces"),
                (stale.shutter, "exposure"),
                (stale.light, "light"),
            ];
            let names: Vec<&str> = names.iter().filter(|(is_stale, _)| *is_stale).map(|(_, name)| *name).collect();
            let why = format!("{} left out, found with {}", names.join(", "), stale.why);
            if stale.registration {
                self = self.without_registration();
                self.findings.registration = PoseFindings::unchecked(why.clone());
            }
            if stale.surfels {
                (self.surfels, self.findings.surfels) = (None, None);
            }
            if stale.shutter {
                self.findings.shutter = Some(ShutterFindings::of(Err(why.clone()), None));
            }
            if stale.light {
                self.findings.light = Some(LightFindings::of(&Err(why.clone()), None));
                self.environment = None;
            }
            self.findings.left_out.push(why);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// An analysis of a COLMAP recording with depth: refined poses, an exposure and a light.
    fn findings() -> Findings {
        let mut camera = crate::camera::Geometry::pinhole(640, 480, 500.0);
        camera.intrinsics.readout_time_s = 0.02;
        let registration =
            json!({ "poses": "refined", "links": 9, "missing_links": 0, "depth_later_s": 0.0, "pose_lines": 3 });
        let run = json!({ "from": 0, "to": 20, "exposure_s": 0.01, "sigma_s": 0.001, "samples": 8 });
        let json = json!({
            "version": 11, "recording": "", "frames": 20, "registration": registration, "camera": camera,
            "gain": { "pairs": 3, "recorded": 0.1, "left": 0.01, "range_ev": 1.0, "is_followed": true },
            "shutter": { "runs": [run] }, "light": { "claimed": true, "panorama": "00" },
            "surfels": { "count": 1, "sha256": "00" },
            "made_with": { "metres_per_unit": 0.5, "is_metric": false, "has_times": false, "up": [0.0, 0.0, 1.0] },
        });
        serde_json::from_value(json).unwrap()
    }

    #[test]
    fn estimates_are_stale_only_by_changes_of_their_own_inputs() {
        let findings = findings();
        let same = findings.made_with.clone();
        assert!(findings.stale(&same).is_empty());
        let stale_estimate = |now: Dependencies| {
            let stale = findings.stale(&now);
            assert_eq!(stale.len(), 1, "{stale:?}");
            assert_eq!(stale[0].surfels, stale[0].registration, "both follow the poses");
            ((stale[0].registration, stale[0].shutter, stale[0].light), stale[0].why.clone())
        };
        let (stale, why) = stale_estimate(Dependencies { metres_per_unit: 0.4, ..same.clone() });
        assert_eq!(stale, (true, false, true));
        assert!(why.contains("a unit of 0.5 m, which is 0.4 m now") && why.contains("--metres-per-unit 0.4"), "{why}");
        assert_eq!(stale_estimate(Dependencies { up: Some([0.0, 1.0, 0.0]), ..same.clone() }).0, (false, false, true));
        assert_eq!(stale_estimate(Dependencies { up: None, ..same.clone() }).0, (false, false, true));
        assert_eq!(stale_estimate(Dependencies { has_times: true, ..same.clone() }).0, (true, true, false));
        assert_eq!(stale_estimate(Dependencies { is_metric: true, ..same.clone() }).0, (true, false, true));
        // Without depth nothing was found by a length, and the unit may be any.
        let registration = PoseFindings::unchecked("there is no depth to align them by".to_owned());
        let without = Findings { registration, light: None, surfels: None, ..findings.clone() };
        let shorter = Dependencies { metres_per_unit: 0.4, up: None, ..same };
        assert!(without.stale(&shorter).is_empty());
        // Surfels of poses that nothing was aligned by.
        let surfels = Findings { surfels: findings.surfels.clone(), ..without };
        assert!(surfels.stale(&shorter).iter().any(|stale| stale.surfels && !stale.registration));
    }
}
