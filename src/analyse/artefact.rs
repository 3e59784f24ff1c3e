//! What an analysis found, as a folder: `analysis.toml`, and beside it `frames.txt` and `poses.txt`. Frames read it and nothing
//! else of the recording's neighbours, so any range of frames keeps its bits.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::depth_clock::DepthLater;
use super::global::Global;
use super::inputs;
use super::registration::{Registration, Verdict};
use super::shutter::Run;
use super::spread::PointSpread;
use super::track::{self, Stop};
use crate::camera::Geometry;
use crate::document::{self, Document};
use crate::fit::twist;
use crate::frame::SeenBrightness;
use crate::recording::{Recording, Refinement};
use crate::source::file::{self, MOST_DOCUMENT};
use crate::tracking::text::{self, TextError};
use crate::tracking::tum::{Line, parse_lines, write_trajectory};
use crate::tracking::{NotAscending, PoseTrack, median_interval_s};
use crate::words::{fixed, reason};

pub const FILE_NAME: &str = "analysis.toml";
const FRAMES: &str = "frames.txt";
const POSES: &str = "poses.txt";
/// All that an analysis consists of.
pub const FILES: [&str; 3] = [FILE_NAME, FRAMES, POSES];
/// The poses were replaced.
const REFINED: &str = "refined";
/// Another version is made anew.
const VERSION: u32 = 1;

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

/// An analysis.
#[derive(Clone, Debug, PartialEq)]
pub struct Analysis {
    pub findings: Findings,
    /// In place of the recording's own, by the frames' own times; `None` if that is kept.
    pub track: Option<PoseTrack>,
    /// The track as it is written, which would not follow from the track to the last bit.
    lines: Vec<Line>,
    /// One per frame: how much brighter it is than the recording's median, factors on light (red, green, blue). Empty if the
    /// footage does not tell.
    pub gains: Vec<[f64; 3]>,
}

/// Why there is no analysis.
#[derive(Debug, thiserror::Error)]
pub enum AnalysisError {
    #[error("{}: cannot be read: {reason}", file.display())]
    Unread { file: PathBuf, reason: String },
    #[error("{}: {problem}", file.display())]
    Content { file: PathBuf, problem: String },
    #[error(transparent)]
    Text(#[from] TextError),
}

/// Where a recording's analysis lies: beside it, of its name with `.analysis`.
pub fn beside(recording: &Path) -> PathBuf {
    let whole = recording.canonicalize().unwrap_or_else(|_| recording.to_owned());
    let folder = if whole.is_file() { whole.parent().map(Path::to_owned).unwrap_or_default() } else { whole };
    let mut name = folder.file_name().unwrap_or_default().to_owned();
    name.push(".analysis");
    folder.with_file_name(name)
}

impl Analysis {
    /// `gains`: ln, one per frame, of those that could be compared.
    pub fn new(
        recording: &Recording,
        camera: &Geometry,
        registration: &Registration,
        gain: Option<Gained>,
        gains: &[Option<[f64; 3]>],
        exposed: Result<Vec<Run>, String>,
        spread: Result<PointSpread, String>,
    ) -> Self {
        let mut camera = camera.clone();
        camera.intrinsics.readout_time_s = registration.readout_s;
        let stop = |n: usize| {
            let state = registration.states[n]?;
            Some(Stop {
                time_s: recording.timestamps_s[n],
                state,
                repeats: registration.repeats.get(n).copied().unwrap_or(false),
            })
        };
        let lines: Vec<Line> = if registration.verdict == Verdict::Refined {
            let stops: Vec<Stop> = (0..recording.frame_count()).filter_map(stop).collect();
            let usual_s = recording.frame_interval_s;
            let poses = track::poses(&stops, usual_s, track::MOST_INTERVALS * usual_s);
            poses.iter().map(|(time_s, pose)| Line::new(*time_s, pose)).collect()
        } else {
            Vec::new()
        };
        let findings = Findings {
            version: VERSION,
            recording: inputs::fingerprint(recording),
            frames: recording.frame_count(),
            registration: Registered::of(registration),
            gain,
            shutter: Some(match exposed {
                Ok(runs) => Shuttered { why: None, runs },
                Err(why) => Shuttered { why: Some(why), runs: Vec::new() },
            }),
            spread: Some(Sharpness::of(spread)),
            camera,
        };
        // They ascend.
        let track = track_of(&lines).ok().filter(|_| !lines.is_empty());
        Self { findings, track, lines, gains: filled(gains) }
    }

    pub fn read(folder: &Path) -> Result<Self, AnalysisError> {
        let path = folder.join(FILE_NAME);
        let unread = |file: &Path, error: &std::io::Error| AnalysisError::Unread {
            file: file.to_owned(),
            reason: reason(error),
        };
        let content = |file: &Path, problem: String| AnalysisError::Content { file: file.to_owned(), problem };
        let text = file::read_text(&path, MOST_DOCUMENT).map_err(|error| unread(&path, &error))?;
        let version: Version = document::read(&text).map_err(|problem| content(&path, problem.to_string()))?;
        if version.version != VERSION {
            let found = version.version;
            return Err(content(
                &path,
                format!("version {found}; this program makes and reads version {VERSION}: analyse again"),
            ));
        }
        let findings: Findings = document::read(&text).map_err(|problem| content(&path, problem.to_string()))?;
        if let Some(shutter) = &findings.shutter {
            shutter.check(findings.frames).map_err(|problem| content(&path, problem))?;
        }
        let (mut lines, mut track) = (Vec::new(), None);
        if findings.registration.poses == REFINED {
            let path = folder.join(POSES);
            lines = parse_lines(&text::read(&path)?, &path)?.0;
            track = Some(track_of(&lines).map_err(|error| content(&path, error.to_string()))?);
        }
        let gains = if findings.gain.as_ref().is_some_and(|gain| gain.is_followed) {
            read_gains(&folder.join(FRAMES), findings.frames)?
        } else {
            Vec::new()
        };
        Ok(Self { findings, track, lines, gains })
    }

    /// The files, by name.
    pub fn files(&self, recording: &Recording) -> Result<Vec<(&'static str, String)>, AnalysisError> {
        let problem = |problem: document::Problem| AnalysisError::Content {
            file: FILE_NAME.into(),
            problem: problem.to_string(),
        };
        let document = Document::new(self.findings.clone()).map_err(problem)?;
        let head =
            "# What the footage says of itself, by `locard analyse`. Frames are composited by it while it lies here.\n";
        let mut files = vec![];
        if !self.lines.is_empty() {
            files.push((POSES, write_trajectory(&self.lines)));
        }
        if !self.gains.is_empty() {
            let line = |(n, [r, g, b]): (usize, &[f64; 3])| format!("{n} {} {r} {g} {b}\n", recording.timestamps_s[n]);
            let lines: String = self.gains.iter().enumerate().map(line).collect();
            files.push((
                FRAMES,
                format!("# frame timestamp red green blue: brighter than usual by these factors\n{lines}"),
            ));
        }
        // Last, since it tells an analysis.
        files.push((FILE_NAME, format!("{head}{document}")));
        Ok(files)
    }

    /// What a recording takes over from it. `usual_s`: [`SeenBrightness::usual_s`].
    pub fn refinement(&self, usual_s: Option<f64>) -> Refinement {
        let registered = &self.findings.registration;
        Refinement {
            track: self.track.clone(),
            depth_later_s: if self.track.is_some() { registered.depth_later_s } else { 0.0 },
            seen: self.gains.iter().map(|factors| SeenBrightness { factors: *factors, usual_s }).collect(),
            blurred_s: self.findings.shutter.as_ref().map_or(Vec::new(), |shutter| shutter.of_frames()),
        }
    }

    /// Whether it is of this recording, seen by this camera; otherwise why not.
    pub fn fits(&self, recording: &Recording, camera: &Geometry) -> Result<(), String> {
        let Findings { frames, recording: made_from, camera: of, .. } = &self.findings;
        if *frames != recording.frame_count() {
            return Err(format!("it is of {frames} frames, the recording has {}", recording.frame_count()));
        }
        if *made_from != inputs::fingerprint(recording) {
            return Err("the recording is another now than when it was made".to_owned());
        }
        let same = |of: &Geometry| {
            let (i, j) = (&of.intrinsics, &camera.intrinsics);
            [(i.fx_px, j.fx_px), (i.fy_px, j.fy_px), (i.cx_px, j.cx_px), (i.cy_px, j.cy_px)]
                .iter()
                .all(|(a, b)| (a - b).abs() < 1e-6)
                && of.distortion == camera.distortion
        };
        if !same(of) {
            return Err(format!(
                "it was made for another camera (fx {} px, now {} px, or another distortion)",
                fixed(of.intrinsics.fx_px, 2),
                fixed(camera.intrinsics.fx_px, 2)
            ));
        }
        Ok(())
    }
}

/// Poses farther apart than a dropped frame or two leave them are not joined.
fn track_of(lines: &[Line]) -> Result<PoseTrack, NotAscending> {
    let times_s: Vec<f64> = lines.iter().map(|line| line.time_s).collect();
    let most_s = (track::MOST_INTERVALS + 0.5) * median_interval_s(&times_s).unwrap_or_default();
    PoseTrack::new(lines.iter().map(|line| (line.time_s, line.pose())).collect(), most_s)
}

#[derive(Deserialize)]
struct Version {
    version: u32,
}

impl Shuttered {
    /// Whether runs follow each other from the first frame to the last.
    fn check(&self, frames: usize) -> Result<(), String> {
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
    fn of_frames(&self) -> Vec<f64> {
        self.runs.iter().flat_map(|run| (run.from..run.to).map(|_| run.exposure_s)).collect()
    }
}

impl Registered {
    fn of(found: &Registration) -> Self {
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
    fn of(found: Result<PointSpread, String>) -> Self {
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

/// Factors on light; a frame that could not be compared lies between its neighbours. Empty if none could.
fn filled(gains: &[Option<[f64; 3]>]) -> Vec<[f64; 3]> {
    let known: Vec<(usize, [f64; 3])> = gains.iter().enumerate().filter_map(|(n, g)| Some((n, (*g)?))).collect();
    let (Some(first), Some(last)) = (known.first(), known.last()) else { return Vec::new() };
    let at = |n: usize| {
        let after = known.partition_point(|k| k.0 < n);
        let (a, b) = (known[after.saturating_sub(1).min(known.len() - 1)], known.get(after).copied().unwrap_or(*last));
        let a = if after == 0 { *first } else { a };
        let share = if b.0 > a.0 { (n - a.0) as f64 / (b.0 - a.0) as f64 } else { 0.0 };
        [0, 1, 2].map(|c| (a.1[c] + share * (b.1[c] - a.1[c])).exp())
    };
    (0..gains.len()).map(at).collect()
}

fn read_gains(path: &Path, frames: usize) -> Result<Vec<[f64; 3]>, AnalysisError> {
    let whole = text::read_listing(path)?;
    let mut gains = Vec::new();
    for (at, record) in text::records(&whole) {
        let wrong = |problem: String| TextError::line(path, at, problem);
        let mut rest = record;
        let number = text::number(&mut rest, "frame").map_err(wrong)?;
        text::number(&mut rest, "timestamp").map_err(wrong)?;
        let mut gain = [0.0; 3];
        for (gain, name) in gain.iter_mut().zip(["red", "green", "blue"]) {
            *gain = text::number(&mut rest, name).map_err(wrong)?;
            if *gain <= 0.0 {
                return Err(wrong(format!("{name} is {gain}; a factor above 0 is expected")).into());
            }
        }
        text::end(rest).map_err(wrong)?;
        if number != gains.len() as f64 {
            return Err(wrong(format!("frame {number} stands where {} is expected", gains.len())).into());
        }
        gains.push(gain);
    }
    if gains.len() != frames {
        let problem = format!("{} frames are listed, there are {frames}", gains.len());
        return Err(AnalysisError::Content { file: path.to_owned(), problem });
    }
    Ok(gains)
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
