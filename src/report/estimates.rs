//! Summary at the top of the report: one verdict per estimate, with its value, interval and reason.

use serde::Serialize;

use crate::analyse::Findings;
use crate::text::fixed;

/// Effect of an estimate on the recorded or given value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Mark {
    /// Replaced by the estimate.
    Changed,
    /// Confirmed.
    Kept,
    /// There is no estimate.
    Refused,
}

/// A row of the summary.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Estimate {
    pub name: &'static str,
    pub mark: Mark,
    pub verdict: &'static str,
    /// The value with its interval; empty if unknown.
    pub value: String,
    /// The reason if it was kept or refused, else empty.
    pub why: String,
}

/// All verdicts. `given_readout_s`: readout time of the given camera.
pub fn estimates(findings: &Findings, given_readout_s: f64) -> Vec<Estimate> {
    let of_poses = [poses(findings), clock(findings), readout(findings, given_readout_s), depth(findings)];
    of_poses
        .into_iter()
        .chain([
            gain(findings),
            spatial_gain(findings),
            exposure(findings),
            sharpness(findings),
            tone(findings),
            light(findings),
            lamps(findings),
        ])
        .collect()
}

fn light(findings: &Findings) -> Estimate {
    let refused = |why: &str| estimate("room's light", Mark::Refused, "unknown", String::new(), why);
    let Some(light) = &findings.light else { return refused("it was not estimated") };
    match (&light.why, light.lines().into_iter().next()) {
        (None, Some((_, value))) => estimate("room's light", Mark::Changed, "found", value, ""),
        (Some(_), Some((_, value))) if light.white_level.is_some() => {
            estimate("room's light", Mark::Kept, "by exposure", value, "")
        }
        (why, _) => refused(why.as_deref().unwrap_or("no reason was recorded")),
    }
}

fn lamps(findings: &Findings) -> Estimate {
    let refused = |why: &str| estimate("lamps", Mark::Refused, "none claimed", String::new(), why);
    let Some(light) = &findings.light else { return refused("they were not estimated") };
    if light.lamps.is_empty() {
        return refused(light.no_lamp.as_deref().or(light.why.as_deref()).unwrap_or("no reason was recorded"));
    }
    let lamps: Vec<String> =
        light.lines().into_iter().filter(|(name, _)| *name == "lamp").map(|(_, text)| text).collect();
    estimate("lamps", Mark::Changed, "found", lamps.join("; "), "")
}

/// Reason for estimates that depend on refined poses.
const WITH_POSES: &str = "estimated with the poses, which are as recorded";

fn estimate(name: &'static str, mark: Mark, verdict: &'static str, value: String, why: impl Into<String>) -> Estimate {
    Estimate { name, mark, verdict, value, why: why.into() }
}

fn poses(findings: &Findings) -> Estimate {
    let r = &findings.registration;
    let px = |value: Option<f64>| value.map_or("?".to_owned(), |px| fixed(px, 2));
    if r.is_refined() {
        let value = format!("{} → {} px", px(r.recorded_px), px(r.refined_px));
        estimate("poses", Mark::Changed, "refined", value, "")
    } else if r.is_right() {
        let value = format!("{} px", px(r.recorded_px));
        estimate(
            "poses",
            Mark::Kept,
            "kept",
            value,
            "the links between frames need no correction beyond their own \
                                                      error",
        )
    } else {
        let (mark, verdict) = if r.is_refused() { (Mark::Refused, "refused") } else { (Mark::Kept, "kept") };
        estimate("poses", mark, verdict, String::new(), r.why.as_deref().unwrap_or("no reason was recorded"))
    }
}

fn clock(findings: &Findings) -> Estimate {
    let r = &findings.registration;
    match r.clock_s.zip(r.clock_sigma_s).filter(|_| r.is_refined()) {
        Some((clock_s, sigma_s)) => estimate("poses' clock", Mark::Changed, "found", later(clock_s, sigma_s), ""),
        None => estimate("poses' clock", Mark::Refused, "as given", String::new(), WITH_POSES),
    }
}

/// A delay with its interval.
fn later(by_s: f64, sigma_s: f64) -> String {
    let ms = |s: f64| fixed(1e3 * s, 1);
    format!("{} ± {} ms {}", ms(by_s.abs()), ms(sigma_s), if by_s < 0.0 { "early" } else { "late" })
}

fn readout(findings: &Findings, given_s: f64) -> Estimate {
    let ms = |s: f64| fixed(1e3 * s, 1);
    let sigma = findings.readout_uncertainty_s().map_or(String::new(), |s| format!(" ± {}", ms(s)));
    match findings.readout_s() {
        Some(found_s) if found_s != given_s => {
            estimate("readout", Mark::Changed, "found", format!("{}{sigma} ms", ms(found_s)), "")
        }
        Some(found_s) => {
            let why = format!("the camera's {} ms fit as well", ms(given_s));
            estimate("readout", Mark::Kept, "kept", format!("{}{sigma} ms", ms(found_s)), why)
        }
        None => {
            let why = if findings.registration.is_refined() {
                "rows do not determine it: the camera moves too little"
            } else {
                WITH_POSES
            };
            estimate("readout", Mark::Refused, "as given", String::new(), why)
        }
    }
}

fn depth(findings: &Findings) -> Estimate {
    let r = &findings.registration;
    let refused = |why: &str| estimate("depth's clock", Mark::Refused, "as given", String::new(), why);
    match r.depth_later_sigma_s {
        _ if !r.is_refined() => refused(WITH_POSES),
        None => refused("too few rims of near things move across the picture"),
        Some(sigma_s) if r.depth_later_s != 0.0 => {
            estimate("depth's clock", Mark::Changed, "found", later(r.depth_later_s, sigma_s), "")
        }
        Some(sigma_s) => {
            let value = format!("± {} ms", fixed(1e3 * sigma_s, 1));
            estimate("depth's clock", Mark::Kept, "kept", value, "depth lies on the picture's edges")
        }
    }
}

fn gain(findings: &Findings) -> Estimate {
    match &findings.gain {
        Some(g) if g.is_followed => {
            estimate("light", Mark::Changed, "followed", format!("{} stops", fixed(g.range_ev, 2)), "")
        }
        Some(g) => {
            let value = format!("± {} stops", fixed(g.recorded / std::f64::consts::LN_2, 3));
            estimate("light", Mark::Kept, "steady", value, "frames are equally bright")
        }
        None => estimate("light", Mark::Refused, "refused", String::new(), findings.no_gain()),
    }
}

fn spatial_gain(findings: &Findings) -> Estimate {
    let name = "light across the picture";
    match &findings.across {
        Some(across) if across.is_followed => {
            let value = format!("up to {} stops", fixed(across.max_ev, 2));
            estimate(name, Mark::Changed, "followed", value, "")
        }
        Some(across) => estimate(name, Mark::Kept, "even", String::new(), across.to_string()),
        None => {
            estimate(name, Mark::Refused, "unknown", String::new(), "frames are equally bright, or cannot be compared")
        }
    }
}

fn exposure(findings: &Findings) -> Estimate {
    let refused = |why: &str| estimate("exposure", Mark::Refused, "refused", String::new(), why);
    let Some(shutter) = &findings.shutter else { return refused("it was not estimated") };
    let value = match shutter.runs.as_slice() {
        [] => return refused(shutter.why.as_deref().unwrap_or("no reason was recorded")),
        [run] => shutter.shown(|n| format!("{} ± {}", n(run.exposure_s), n(run.sigma_s))),
        runs => {
            let (low, high) = runs
                .iter()
                .fold((f64::MAX, 0.0f64), |(low, high), run| (low.min(run.exposure_s), high.max(run.exposure_s)));
            shutter.shown(|n| format!("{} to {}", n(low), n(high)))
        }
    };
    estimate("exposure", Mark::Changed, "found", value, "")
}

fn sharpness(findings: &Findings) -> Estimate {
    let spread = findings.spread.as_ref();
    match spread.and_then(|spread| Some((spread.sigma_px?, spread.between_px?))) {
        Some((sigma, [low, high])) => {
            let px = |px: f64| fixed(px, 2);
            let value = format!("{} px ({} to {})", px(sigma), px(low), px(high));
            estimate("sharpness", Mark::Changed, "found", value, "")
        }
        None => {
            let why = spread.and_then(|spread| spread.why.as_deref()).unwrap_or("it was not estimated");
            estimate("sharpness", Mark::Refused, "refused", String::new(), why)
        }
    }
}

fn tone(findings: &Findings) -> Estimate {
    let refused = |why: &str| estimate("response", Mark::Refused, "unknown", String::new(), why);
    let Some(tone) = &findings.tone else { return refused("it was not estimated") };
    match &tone.why {
        Some(why) => refused(why),
        None if tone.differs() => estimate("response", Mark::Refused, "differs", String::new(), tone.to_string()),
        None => estimate("response", Mark::Kept, "fits", String::new(), tone.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::camera::Geometry;

    fn findings(registration: Value, more: Value) -> Findings {
        let mut camera = Geometry::pinhole(640, 480, 500.0);
        camera.intrinsics.readout_time_s = 0.0267;
        let mut json = json!({
            "version": 2, "recording": "", "frames": 20, "camera": camera,
            "registration": { "poses": "refused", "links": 9, "missing_links": 0, "depth_later_s": 0.0 }
        });
        for (into, from) in [("registration", registration), ("", more)] {
            let into = if into.is_empty() { &mut json } else { &mut json[into] };
            into.as_object_mut().unwrap().extend(from.as_object().unwrap().clone());
        }
        serde_json::from_value(json).unwrap()
    }

    fn verdicts(findings: &Findings, given_readout_s: f64) -> Vec<String> {
        let all = estimates(findings, given_readout_s);
        all.iter().map(|e| format!("{} {} {}", e.name, e.verdict, e.value)).collect()
    }

    #[test]
    fn estimates_have_their_intervals() {
        let registration = json!({
            "poses": "refined", "recorded_px": 2.889, "refined_px": 0.1397, "clock_s": -0.00546, "clock_sigma_s": 0.00036,
            "readout_sigma_s": 0.0002, "depth_later_s": 0.0243, "depth_later_sigma_s": 0.0044
        });
        let run = json!({ "from": 0, "to": 20, "exposure_s": 0.01941, "sigma_s": 0.00042, "samples": 11 });
        let gain = json!({ "pairs": 9, "recorded": 0.18, "left": 0.01, "range_ev": 1.2525, "is_followed": true });
        let spread = json!({ "sigma_px": 0.4386, "between_px": [0.4265, 0.4502], "edges": 420 });
        let findings = findings(registration, json!({ "gain": gain, "spread": spread, "shutter": { "runs": [run] } }));
        assert_eq!(
            verdicts(&findings, 0.02),
            [
                "poses refined 2.89 → 0.14 px",
                "poses' clock found 5.5 ± 0.4 ms early",
                "readout found 26.7 ± 0.2 ms",
                "depth's clock found 24.3 ± 4.4 ms late",
                "light followed 1.25 stops",
                "light across the picture unknown ",
                "exposure found 19.41 ± 0.42 ms",
                "sharpness found 0.44 px (0.43 to 0.45)",
                "response unknown ",
                "room's light unknown ",
                "lamps none claimed "
            ]
        );
        assert_eq!(estimates(&findings, 0.0267)[2].verdict, "kept", "the camera's own");
    }

    #[test]
    fn refused_estimates_have_a_reason_and_no_value() {
        let shutter = json!({ "why": "too even", "runs": [] });
        let refused = findings(json!({ "why": "there is no depth" }), json!({ "shutter": shutter }));
        for estimate in estimates(&refused, 0.0) {
            assert!(
                estimate.mark == Mark::Refused && estimate.value.is_empty() && !estimate.why.is_empty(),
                "{estimate:?}"
            );
        }
        assert_eq!(estimates(&refused, 0.0)[0].why, "there is no depth");
    }
}
