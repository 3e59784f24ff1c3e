//! The estimates of an analysis: `analysis.toml`, and their lines of text.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::dependencies::Dependencies;
use super::depth_clock::DepthOffset;
use super::example_noise_findings::ExampleNoiseFindings;
use super::light_findings::LightFindings;
use super::noise_findings::NoiseFindings;
use super::registration_result::{MAX_READOUT_SIGMA_S, Registration, Verdict};
use super::rig_offset::RigOffset;
use super::shutter::{ExposureRun, ExposureRuns};
use super::spatial_gain::SpatialGainFit;
use super::spread::PointSpreadEstimate;
use super::surfel_file::SurfelMap;
use super::tone::ToneBand;
use crate::camera::Geometry;
use crate::fit::twist::{self, Twist};
use crate::text::fixed;

/// Values of [`PoseFindings::poses`].
const REFINED: &str = "refined";
const RIGHT: &str = "right";
const REFUSED: &str = "refused";
const RECORDED_POSES: &str = "kept";
/// Explanation of the residuals of held-out pairs.
const HELD_OUT_EXPLANATION: &str =
    "agreement of alignments with each other; `locard verify` measures slides in the picture";

/// `analysis.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Findings {
    pub version: u32,
    /// SHA-256 of the recording ([`fingerprint`](super::inputs::fingerprint)).
    pub recording: String,
    pub frames: usize,
    /// The reason for which there is no gain. It precedes the tables, as TOML requires.
    pub gain_why: Option<String>,
    /// Estimates that do not hold for the recording as it was opened, and a remedy; one sentence
    /// per reason.
    #[serde(skip)]
    pub left_out: Vec<String>,
    #[serde(default)]
    pub made_with: Dependencies,
    pub registration: PoseFindings,
    pub gain: Option<GainFindings>,
    /// Gain that varies within the picture; `None` where it is unknown.
    pub across: Option<SpatialGainFit>,
    pub shutter: Option<ShutterFindings>,
    pub spread: Option<SharpnessFindings>,
    /// `None` if the camera's noise was known otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseFindings>,
    /// `None` in analyses of earlier versions.
    #[serde(default, alias = "noise_example", skip_serializing_if = "Option::is_none")]
    pub example_noise: Option<ExampleNoiseFindings>,
    /// Advice; it is not applied.
    pub tone: Option<Tone>,
    pub light: Option<LightFindings>,
    /// `None` without surfels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surfels: Option<SurfelFindings>,
    /// The camera of the analysis, with the estimated readout time.
    pub camera: Geometry,
}

/// Result of registration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseFindings {
    /// `refined`, `right`, `kept` or `refused`.
    pub poses: String,
    pub why: Option<String>,
    pub links: usize,
    pub missing_links: usize,
    /// Median residual of held-out frame pairs by recorded and by refined poses, px. The
    /// alignment's own bias affects poses and alignment alike, so the residual is smaller than the
    /// poses' error in the picture.
    pub recorded_px: Option<f64>,
    pub refined_px: Option<f64>,
    /// If only the motion is refined: root mean square difference of the displacements within half
    /// a frame interval, px.
    pub motion_px: Option<f64>,
    /// Added to frame times to look up recorded poses, with one standard deviation.
    pub clock_s: Option<f64>,
    pub clock_sigma_s: Option<f64>,
    /// Hand-eye offset, appended to recorded poses, in the camera's axes.
    pub hand_eye_turn_deg: Option<[f64; 3]>,
    pub hand_eye_way_m: Option<[f64; 3]>,
    /// One standard deviation by the scatter of links.
    pub readout_sigma_s: Option<f64>,
    /// One standard deviation by the spread between parts of the recording.
    #[serde(default)]
    pub readout_parts_sigma_s: Option<f64>,
    /// Added to the depth maps' times.
    pub depth_later_s: f64,
    pub depth_later_sigma_s: Option<f64>,
    /// Numbers of lines in the files of poses and links.
    #[serde(default)]
    pub pose_lines: usize,
    #[serde(default)]
    pub link_lines: usize,
}

/// Surfels fused from all depth maps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfelFindings {
    pub count: usize,
    /// SHA-256 of their file, hexadecimal.
    pub sha256: String,
}

impl SurfelFindings {
    pub fn of(map: &SurfelMap) -> Self {
        Self { count: map.surfels.len(), sha256: map.fingerprint() }
    }
}

/// Gain of each frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GainFindings {
    pub pairs: usize,
    /// Root mean square log ratio of held-out pairs, without and with the gains subtracted.
    pub recorded: f64,
    pub left: f64,
    /// Ratio of the brightest to the darkest frame, stops.
    pub range_ev: f64,
    /// True if frames differ by more than the footage's noise. The gains are then applied.
    pub is_followed: bool,
}

/// Exposure time of the frames, by their motion blur.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShutterFindings {
    /// The reason for which there are no runs.
    pub why: Option<String>,
    /// Frames with a distinct estimate of their own: number, and exposure, s.
    #[serde(alias = "heard", default, skip_serializing_if = "Vec::is_empty")]
    pub samples: Vec<(usize, f64)>,
    /// Runs of frames in order; each frame is in one. Empty if the exposure is unknown.
    pub runs: Vec<ExposureRun>,
    /// Nominal frame interval of a format without times, s. Exposures are known as fractions of it
    /// only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nominal_interval_s: Option<f64>,
}

/// Point spread of the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SharpnessFindings {
    /// Standard deviation of the Gaussian point spread of lens and sensor, px; `None` where it is
    /// unknown.
    pub sigma_px: Option<f64>,
    /// Interval of σ with a confidence of two thirds.
    pub between_px: Option<[f64; 2]>,
    /// Number of measured straight edges.
    pub edges: Option<usize>,
    /// Histogram of the edges by σ, with bins of [`EDGE_BIN_PX`](super::spread::EDGE_BIN_PX); the
    /// last one includes all wider edges.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub edges_by_px: Vec<u32>,
    /// The reason for which σ is unknown.
    pub why: Option<String>,
}

/// Check of the assumed response against the footage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tone {
    /// The reason for which there are no bands.
    pub why: Option<String>,
    /// Slopes by code, in order; empty if unknown.
    #[serde(default)]
    pub bands: Vec<ToneBand>,
}

impl Tone {
    pub fn of(bands: Result<Vec<ToneBand>, String>) -> Self {
        match bands {
            Ok(bands) => Self { why: None, bands },
            Err(why) => Self { why: Some(why), bands: Vec::new() },
        }
    }

    /// True if the slope of a band contradicts the assumed response.
    pub fn differs(&self) -> bool {
        self.bands.iter().any(ToneBand::differs)
    }
}

impl fmt::Display for Tone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Some(first), Some(last)) = (self.bands.first(), self.bands.last()) else {
            return write!(f, "unknown: {}", self.why.as_deref().unwrap_or("no reason was recorded"));
        };
        if !self.differs() {
            let max_deviation = self.bands.iter().map(|band| (band.slope - 1.0).abs()).fold(0.0, f64::max);
            let (from, to, max_deviation) = (first.from, last.to, fixed(100.0 * max_deviation, 0));
            return write!(f, "the response fits from code {from} to {to}, within {max_deviation} %");
        }
        let slopes = self.bands.iter().filter(|band| band.differs()).map(|band| {
            let (from, to, slope, sigma) = (band.from, band.to, fixed(band.slope, 2), fixed(band.sigma, 2));
            format!("{slope} ± {sigma} times as much in codes {from} to {to}")
        });
        let slopes = slopes.collect::<Vec<_>>().join(", ");
        write!(
            f,
            "with this response, light changes {slopes} as in middle codes, but it must change equally: the camera's \
             response differs (camera.response). This is only advice"
        )
    }
}

impl ShutterFindings {
    pub fn of(runs: Result<ExposureRuns, String>, nominal_interval_s: Option<f64>) -> Self {
        match runs {
            Ok(ExposureRuns { runs, samples }) => {
                let samples = samples.iter().map(|sample| (sample.frame, sample.exposure_s)).collect();
                Self { why: None, samples, runs, nominal_interval_s }
            }
            Err(why) => Self { why: Some(why), samples: Vec::new(), runs: Vec::new(), nominal_interval_s: None },
        }
    }

    /// Numbers with their unit: milliseconds, or the frame interval for recordings without times.
    pub fn shown(&self, numbers: impl Fn(&dyn Fn(f64) -> String) -> String) -> String {
        match self.nominal_interval_s {
            None => format!("{} ms", numbers(&|s| fixed(1e3 * s, 2))),
            Some(interval_s) => format!("{} of the frame interval", numbers(&|s| fixed(s / interval_s, 3))),
        }
    }

    fn about(&self, run: &ExposureRun) -> String {
        let time = self.shown(|n| format!("{} ± {}", n(run.exposure_s), n(run.sigma_s)));
        format!("{time}, by the blur of {} frames", run.samples)
    }

    /// Checks that the runs cover all frames without gaps.
    pub fn check(&self, frames: usize) -> Result<(), String> {
        let mut next = 0;
        for run in &self.runs {
            if run.from != next || run.to <= run.from || run.to > frames {
                return Err(format!("[[shutter.runs]]: from {} to {}; from {next} is expected", run.from, run.to));
            }
            if !(run.exposure_s > 0.0 && run.exposure_s <= 1.0) {
                let estimate_s = run.exposure_s;
                return Err(format!(
                    "[[shutter.runs]]: exposure_s is {estimate_s}; above 0 and at most 1 s is expected"
                ));
            }
            next = run.to;
        }
        if !self.runs.is_empty() && next != frames {
            return Err(format!("[[shutter.runs]]: the last ends at {next}, there are {frames} frames"));
        }
        Ok(())
    }

    /// The exposure of each frame, s; empty if unknown.
    pub fn of_frames(&self) -> Vec<f64> {
        self.runs.iter().flat_map(|run| (run.from..run.to).map(|_| run.exposure_s)).collect()
    }
}

impl PoseFindings {
    /// True if refined poses replace the recorded ones.
    pub fn is_refined(&self) -> bool {
        self.poses == REFINED
    }

    /// True if registration failed.
    pub fn is_refused(&self) -> bool {
        self.poses == REFUSED
    }

    /// Recorded poses that could not be checked, with the reason.
    pub fn unchecked(why: String) -> Self {
        Self {
            poses: RECORDED_POSES.to_owned(),
            why: Some(why),
            links: 0,
            missing_links: 0,
            recorded_px: None,
            refined_px: None,
            motion_px: None,
            clock_s: None,
            clock_sigma_s: None,
            hand_eye_turn_deg: None,
            hand_eye_way_m: None,
            readout_sigma_s: None,
            readout_parts_sigma_s: None,
            depth_later_s: 0.0,
            depth_later_sigma_s: None,
            pose_lines: 0,
            link_lines: 0,
        }
    }

    /// True if the recorded poses are right.
    pub fn is_right(&self) -> bool {
        self.poses == RIGHT
    }

    pub fn of(registration: &Registration) -> Self {
        let (poses, why) = match &registration.verdict {
            Verdict::Refined => (REFINED, None),
            Verdict::Right => (RIGHT, None),
            Verdict::Kept(why) => (RECORDED_POSES, Some(why.clone())),
            Verdict::Refused(why) => (REFUSED, Some(why.clone())),
        };
        let of_offset = |of: fn(&RigOffset) -> f64| registration.rig_offset.as_ref().map(of);
        let hand_eye = registration.rig_offset.map(|offset| offset.hand_eye).filter(|by| *by != Twist::zeros());
        Self {
            poses: poses.to_owned(),
            why,
            links: registration.links,
            missing_links: registration.missing,
            recorded_px: registration.held_out_px.map(|px| px.0),
            refined_px: registration.held_out_px.map(|px| px.1),
            motion_px: registration.motion_px,
            clock_s: of_offset(|offset| offset.clock_s),
            clock_sigma_s: of_offset(|offset| offset.clock_sigma_s),
            hand_eye_turn_deg: hand_eye.map(|by| twist::rotation_vector(&by).to_array().map(f64::to_degrees)),
            hand_eye_way_m: hand_eye.map(|by| twist::translation(&by).to_array()),
            readout_sigma_s: registration.readout_sigma_s,
            readout_parts_sigma_s: registration.readout_parts_sigma_s,
            depth_later_s: registration.depth_later_s(),
            depth_later_sigma_s: registration.depth.map(|DepthOffset { sigma_s, .. }| sigma_s),
            pose_lines: 0,
            link_lines: registration.held_out.len(),
        }
    }
}

impl SharpnessFindings {
    pub fn of(estimate: Result<PointSpreadEstimate, String>) -> Self {
        match estimate {
            Ok(PointSpreadEstimate { sigma_px, between_px, edges, by_px }) => Self {
                sigma_px: Some(sigma_px),
                between_px: Some(between_px),
                edges: Some(edges),
                edges_by_px: by_px,
                why: None,
            },
            Err(why) => Self { sigma_px: None, between_px: None, edges: None, edges_by_px: Vec::new(), why: Some(why) },
        }
    }
}

impl fmt::Display for SharpnessFindings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let px = |px: f64| fixed(px, 2);
        match (self.sigma_px, self.between_px, self.edges) {
            (Some(sigma), Some([low, high]), Some(edges)) => {
                write!(f, "σ {} px, {} to {} ({edges} edges)", px(sigma), px(low), px(high))
            }
            _ => write!(f, "unknown: {}", self.why.as_deref().unwrap_or("no reason was recorded")),
        }
    }
}

impl fmt::Display for GainFindings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.is_followed {
            return write!(f, "steady within ln {} ({} pairs)", fixed(self.recorded, 4), self.pairs);
        }
        write!(
            f,
            "{} stops from the darkest to the brightest frame; left of ln {} is {} ({} pairs)",
            fixed(self.range_ev, 2),
            fixed(self.recorded, 3),
            fixed(self.left, 4),
            self.pairs
        )
    }
}

impl fmt::Display for SpatialGainFit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { recorded, left, max_ev, is_followed } = self;
        let (recorded, left) = (fixed(*recorded, 4), fixed(*left, 4));
        if *is_followed {
            write!(
                f,
                "parts of a picture up to {} stops brighter or darker; left of ln {recorded} is {left}",
                fixed(*max_ev, 2)
            )
        } else {
            write!(f, "pictures change alike everywhere, within ln {recorded} ({left} if parts were followed)")
        }
    }
}

impl fmt::Display for PoseFindings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let px = |value: Option<f64>| value.map_or("unknown".to_owned(), |px| format!("{} px", fixed(px, 2)));
        let (recorded, refined) = (px(self.recorded_px), px(self.refined_px));
        match self.poses.as_str() {
            REFINED => write!(
                f,
                "refined: they agree with the alignment of held-out frame pairs to {refined}, the recorded ones to {recorded} \
                 ({HELD_OUT_EXPLANATION})"
            ),
            RIGHT => {
                write!(
                    f,
                    "kept as recorded: they agree with the alignment of held-out frame pairs to {recorded}, refined ones to \
                     {refined} ({HELD_OUT_EXPLANATION})"
                )
            }
            _ => write!(f, "kept as recorded: {}", self.why.as_deref().unwrap_or("no reason was recorded")),
        }
    }
}

impl Findings {
    /// One standard deviation of the readout time: the larger of the scatter's and the parts'.
    pub fn readout_uncertainty_s(&self) -> Option<f64> {
        let registration = &self.registration;
        registration.readout_sigma_s.into_iter().chain(registration.readout_parts_sigma_s).reduce(f64::max)
    }

    /// The estimated readout time, if it is certain.
    pub fn readout_s(&self) -> Option<f64> {
        let is_sure = self.registration.readout_sigma_s.is_some_and(|sigma_s| sigma_s < MAX_READOUT_SIGMA_S);
        (self.registration.is_refined() && is_sure).then_some(self.camera.intrinsics.readout_time_s)
    }

    /// The reason for which there is no gain.
    pub fn no_gain(&self) -> &str {
        self.gain_why.as_deref().unwrap_or("too few surfaces are seen twice")
    }

    /// One line per estimate, with its name.
    pub fn lines(&self) -> Vec<(&'static str, String)> {
        let r = &self.registration;
        let mut lines = vec![("poses", r.to_string())];
        if r.links + r.missing_links > 0 {
            lines.push(("links", format!("{}, {} more did not fit", r.links, r.missing_links)));
        }
        if let Some(px) = r.motion_px {
            let px = fixed(px, 2);
            lines.push((
                "motion",
                format!("by the pictures: {px} px from the recorded poses' motion in half a frame interval"),
            ));
        }
        let ms = |s: f64| fixed(1e3 * s, 1);
        // Estimates of a failed registration are not listed.
        if let (Some(clock_s), Some(sigma_s), false) = (r.clock_s, r.clock_sigma_s, r.is_refused()) {
            let way = if clock_s < 0.0 { "earlier" } else { "later" };
            lines.push(("clock", format!("poses {} ms {way} fit best, ± {} ms", ms(clock_s.abs()), ms(sigma_s))));
        }
        if let (Some(turn), Some(way), false) = (r.hand_eye_turn_deg, r.hand_eye_way_m, r.is_refused()) {
            let all = |values: [f64; 3], by: f64, digits| values.map(|v| fixed(by * v, digits)).join(", ");
            let (turn, way) = (all(turn, 1.0, 2), all(way, 1e3, 1));
            lines.push(("hand-eye", format!("rotated by {turn}°, {way} mm from the recorded position")));
        }
        let sigma = self.readout_uncertainty_s().map_or(String::new(), |s| format!(", ± {} ms", ms(s)));
        lines.push(("readout", format!("{} ms{sigma}", ms(self.camera.intrinsics.readout_time_s))));
        if let Some(sigma_s) = r.depth_later_sigma_s {
            let way = if r.depth_later_s < 0.0 { "earlier" } else { "later" };
            let by = ms(r.depth_later_s.abs());
            lines.push(("depth", format!("{by} ms {way} than its timestamps, ± {} ms", ms(sigma_s))));
        }
        if let Some(shutter) = &self.shutter {
            lines.extend(shutter.why.iter().map(|why| ("exposure", format!("unknown: {why}"))));
            let run_text = |run: &ExposureRun| match shutter.runs.len() {
                1 => shutter.about(run),
                _ => format!("frames {} to {}, {}", run.from, run.to - 1, shutter.about(run)),
            };
            lines.extend(shutter.runs.iter().map(|run| ("exposure", run_text(run))));
        }
        let gain = self.gain.as_ref().map(GainFindings::to_string);
        lines.push(("gain", gain.unwrap_or_else(|| format!("unknown: {}", self.no_gain()))));
        lines.extend(self.across.iter().map(|across| ("across", across.to_string())));
        lines.extend(self.spread.iter().map(|spread| ("spread", spread.to_string())));
        lines.extend(self.noise.iter().map(|noise| ("noise", noise.to_string())));
        lines.extend(self.example_noise.iter().map(|example| ("examples", example.to_string())));
        lines.extend(self.tone.iter().map(|tone| ("tone", tone.to_string())));
        lines.extend(self.light.iter().flat_map(LightFindings::lines));
        lines.extend(self.surfels.iter().map(|fused| {
            ("surfaces", format!("{} surfels of the room, where the depth of single frames has holes", fused.count))
        }));
        lines
    }
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.lines().iter().try_for_each(|(name, text)| writeln!(f, "{name:<11}{text}"))
    }
}
