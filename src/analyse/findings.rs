//! What an analysis found, in numbers: `analysis.toml`, and the lines in which it is told.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::depth_clock::DepthLater;
use super::global::Global;
use super::registration::{Registration, Verdict};
use super::shutter::Run;
use super::spread::PointSpread;
use crate::camera::Geometry;
use crate::fit::twist;
use crate::words::fixed;

/// The poses were replaced.
const REFINED: &str = "refined";

/// `analysis.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Findings {
    pub version: u32,
    /// SHA-256 of the recording ([`inputs::fingerprint`]).
    pub recording: String,
    pub frames: usize,
    pub registration: Registered,
    pub gain: Option<Gained>,
    pub shutter: Option<Shuttered>,
    pub spread: Option<Sharpness>,
    /// For which it was made. Its readout time is the one that was found.
    pub camera: Geometry,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Registered {
    /// `refined`, `right` or `refused`.
    pub poses: String,
    pub why: Option<String>,
    pub links: usize,
    pub missing_links: usize,
    /// What links that took no part say is wrong, median, px.
    pub recorded_px: Option<f64>,
    pub refined_px: Option<f64>,
    /// Added to frame times to look up recorded poses, with one standard deviation.
    pub clock_s: Option<f64>,
    pub clock_sigma_s: Option<f64>,
    /// What recorded poses lack, in the camera's axes.
    pub hand_eye_turn_deg: Option<[f64; 3]>,
    pub hand_eye_way_m: Option<[f64; 3]>,
    pub readout_sigma_s: Option<f64>,
    /// Added to the depth maps' times.
    pub depth_later_s: f64,
    pub depth_later_sigma_s: Option<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gained {
    pub pairs: usize,
    /// Root mean square of ln of what pairs that took no part see, as recorded and with the gains.
    pub recorded: f64,
    pub left: f64,
    /// The brightest frame by the darkest, stops.
    pub range_ev: f64,
    /// Whether frames differ by more than the footage's noise, and are followed.
    pub is_followed: bool,
}

/// How long frames were exposed, by their motion blur.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shuttered {
    /// Why nothing is known.
    pub why: Option<String>,
    /// In order; each frame lies in one. Empty if nothing is known.
    pub runs: Vec<Run>,
}

/// How sharp the camera is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sharpness {
    /// Standard deviation of the Gaussian that lens and sensor make, px; `None` where the footage does not tell.
    pub sigma_px: Option<f64>,
    /// In two cases of three it lies between these.
    pub between_px: Option<[f64; 2]>,
    /// Straight edges that were measured.
    pub edges: Option<usize>,
    /// Why it is not known.
    pub why: Option<String>,
}

impl Shuttered {
    pub fn of(found: Result<Vec<Run>, String>) -> Self {
        match found {
            Ok(runs) => Self { why: None, runs },
            Err(why) => Self { why: Some(why), runs: Vec::new() },
        }
    }

    /// Whether runs follow each other from the first frame to the last.
    pub fn check(&self, frames: usize) -> Result<(), String> {
        let mut next = 0;
        for run in &self.runs {
            if run.from != next || run.to <= run.from || run.to > frames {
                return Err(format!("[[shutter.runs]]: from {} to {}; from {next} is expected", run.from, run.to));
            }
            if !(run.exposure_s > 0.0 && run.exposure_s <= 1.0) {
                let found = run.exposure_s;
                return Err(format!("[[shutter.runs]]: exposure_s is {found}; above 0 and at most 1 s is expected"));
            }
            next = run.to;
        }
        if !self.runs.is_empty() && next != frames {
            return Err(format!("[[shutter.runs]]: the last ends at {next}, there are {frames} frames"));
        }
        Ok(())
    }

    /// Of each frame, s; empty if nothing is known.
    pub fn of_frames(&self) -> Vec<f64> {
        self.runs.iter().flat_map(|run| (run.from..run.to).map(|_| run.exposure_s)).collect()
    }
}

impl Registered {
    /// Whether the poses were replaced.
    pub fn is_refined(&self) -> bool {
        self.poses == REFINED
    }

    pub fn of(found: &Registration) -> Self {
        let (poses, why) = match &found.verdict {
            Verdict::Refined => (REFINED, None),
            Verdict::Right => ("right", None),
            Verdict::Refused(why) => ("refused", Some(why.clone())),
        };
        let global = |of: fn(&Global) -> f64| found.global.as_ref().map(of);
        Self {
            poses: poses.to_owned(),
            why,
            links: found.links,
            missing_links: found.missing,
            recorded_px: found.held_out_px.map(|px| px.0),
            refined_px: found.held_out_px.map(|px| px.1),
            clock_s: global(|g| g.clock_s),
            clock_sigma_s: global(|g| g.clock_sigma_s),
            hand_eye_turn_deg: found.global.map(|g| twist::turn(&g.hand_eye).to_array().map(f64::to_degrees)),
            hand_eye_way_m: found.global.map(|g| twist::way(&g.hand_eye).to_array()),
            readout_sigma_s: found.readout_sigma_s,
            depth_later_s: found.depth_later_s(),
            depth_later_sigma_s: found.depth.map(|DepthLater { sigma_s, .. }| sigma_s),
        }
    }
}

impl Sharpness {
    pub fn of(found: Result<PointSpread, String>) -> Self {
        match found {
            Ok(PointSpread { sigma_px, between_px, edges }) => {
                Self { sigma_px: Some(sigma_px), between_px: Some(between_px), edges: Some(edges), why: None }
            }
            Err(why) => Self { sigma_px: None, between_px: None, edges: None, why: Some(why) },
        }
    }
}

impl fmt::Display for Sharpness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let px = |px: f64| fixed(px, 2);
        match (self.sigma_px, self.between_px, self.edges) {
            (Some(sigma), Some([low, high]), Some(edges)) => {
                writeln!(f, "spread     σ {} px, {} to {} ({edges} edges)", px(sigma), px(low), px(high))
            }
            _ => writeln!(f, "spread     unknown: {}", self.why.as_deref().unwrap_or("nothing can be said")),
        }
    }
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let r = &self.registration;
        let px = |value: Option<f64>| value.map_or("unknown".to_owned(), |px| format!("{} px", fixed(px, 2)));
        match (r.poses.as_str(), &r.why) {
            (REFINED, _) => writeln!(
                f,
                "poses      refined: links that took no part miss by {}, {} as recorded",
                px(r.refined_px),
                px(r.recorded_px)
            )?,
            ("right", _) => writeln!(
                f,
                "poses      kept as recorded: links that took no part miss by {}, {} if refined",
                px(r.recorded_px),
                px(r.refined_px)
            )?,
            (_, why) => {
                writeln!(f, "poses      kept as recorded: {}", why.as_deref().unwrap_or("nothing can be said"))?
            }
        }
        writeln!(f, "links      {}, {} more did not fit", r.links, r.missing_links)?;
        let ms = |s: f64| fixed(1e3 * s, 1);
        if let (Some(clock_s), Some(sigma_s)) = (r.clock_s, r.clock_sigma_s) {
            writeln!(
                f,
                "clock      poses {} ms {} fit best, ± {} ms",
                ms(clock_s.abs()),
                if clock_s < 0.0 { "earlier" } else { "later" },
                ms(sigma_s)
            )?;
        }
        if let (Some(turn), Some(way)) = (r.hand_eye_turn_deg, r.hand_eye_way_m) {
            let all = |values: [f64; 3], by: f64, digits| values.map(|v| fixed(by * v, digits)).join(", ");
            writeln!(
                f,
                "hand-eye   turned by {}°, {} mm away from where the poses say",
                all(turn, 1.0, 2),
                all(way, 1e3, 1)
            )?;
        }
        let sigma = r.readout_sigma_s.map_or(String::new(), |s| format!(", ± {} ms by scatter", ms(s)));
        writeln!(f, "readout    {} ms{sigma}", ms(self.camera.intrinsics.readout_time_s))?;
        if let Some(sigma_s) = r.depth_later_sigma_s {
            writeln!(
                f,
                "depth      {} ms {} than it says, ± {} ms",
                ms(r.depth_later_s.abs()),
                if r.depth_later_s < 0.0 { "earlier" } else { "later" },
                ms(sigma_s)
            )?;
        }
        if let Some(shutter) = &self.shutter {
            if let Some(why) = &shutter.why {
                writeln!(f, "exposure   unknown: {why}")?;
            }
            for run in &shutter.runs {
                let of = if shutter.runs.len() > 1 {
                    format!("frames {} to {}, ", run.from, run.to - 1)
                } else {
                    String::new()
                };
                let (time, sigma) = (fixed(1e3 * run.exposure_s, 2), fixed(1e3 * run.sigma_s, 2));
                writeln!(f, "exposure   {of}{time} ms, ± {sigma} ms, by the blur of {} frames", run.heard)?;
            }
        }
        match &self.gain {
            Some(g) if !g.is_followed => {
                writeln!(f, "gain       steady within ln {} ({} pairs)", fixed(g.recorded, 4), g.pairs)
            }
            Some(g) => writeln!(
                f,
                "gain       {} stops from the darkest to the brightest frame; left of ln {} is {} ({} pairs)",
                fixed(g.range_ev, 2),
                fixed(g.recorded, 3),
                fixed(g.left, 4),
                g.pairs
            ),
            None => writeln!(f, "gain       unknown: too few surfaces are seen twice"),
        }?;
        self.spread.as_ref().map_or(Ok(()), |spread| spread.fmt(f))
    }
}
