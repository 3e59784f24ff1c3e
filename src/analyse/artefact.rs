//! An analysis as a folder: `analysis.toml`, and beside it `frames.txt`, `across.txt`, `poses.txt`,
//! `links.txt`, the light of the room as `environment.hdr` and its surfaces as `surfels.ply`.
//! Compositing depends on it and on the frame only, so any range of frames gives the same bits.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::dependencies::Dependencies;
use super::example_noise_findings::{ExampleNoiseEstimate, ExampleNoiseFile};
use super::findings::{Findings, GainFindings, PoseFindings, SharpnessFindings, ShutterFindings, SurfelFindings, Tone};
use super::inputs;
use super::light::RoomLight;
use super::light_findings::{EnvironmentFit, LightFindings};
use super::noise_findings::NoiseFindings;
use super::recorded_motion::{RecordedMotion, moves_as_recorded};
use super::registration_result::{HeldOutResidual, Registration, Verdict};
use super::shutter::ExposureRuns;
use super::spatial_gain::{MAX_EV, SpatialGainFit};
use super::spread::PointSpreadEstimate;
use super::surfel_file::SurfelMap;
use super::times;
use super::tone::ToneBand;
use super::track::{self, TrackKnot};
use crate::camera::Geometry;
use crate::document::{self, TomlDocument};
use crate::frame::{NODES_ACROSS, NODES_DOWN, RelativeBrightness, SpatialGain, Surfel};
use crate::recording::{Recording, Refinement};
use crate::scene::Lighting;
use crate::sink::SinkError;
use crate::source::file::{self, MAX_DOCUMENT_BYTES};
use crate::text::{fixed, reason};
use crate::tracking::records::{self, TextError};
use crate::tracking::tum::{Line, parse_lines, write_trajectory};
use crate::tracking::{NotAscending, PoseTrack, median_interval_s};

pub const FILE_NAME: &str = "analysis.toml";
const FRAMES: &str = "frames.txt";
const ACROSS: &str = "across.txt";
const POSES: &str = "poses.txt";
const LINKS: &str = "links.txt";
pub const ENVIRONMENT: &str = "environment.hdr";
pub const SUPPORTS: &str = "supports.toml";
const SURFELS: &str = "surfels.ply";
const EXAMPLE_NOISE: &str = "noise.locnoise";
const MAX_EXAMPLE_NOISE_BYTES: u64 = 1 << 28;
/// All files of an analysis's folder.
pub const FILES: [&str; 10] =
    [FILE_NAME, FRAMES, ACROSS, POSES, LINKS, ENVIRONMENT, SURFELS, EXAMPLE_NOISE, SUPPORTS, times::FILE];
/// Version of the format. Analyses of other versions are not read.
pub const VERSION: u32 = 13;

/// An analysis.
#[derive(Clone, Debug, PartialEq)]
pub struct Analysis {
    pub findings: Findings,
    /// Replaces the recording's track, by the frames' times; `None` if that is kept. If only the
    /// motion is refined, it goes through the recorded poses of the frames.
    pub track: Option<PoseTrack>,
    /// The lines of the track's file, which cannot be reproduced from the track to the last bit.
    lines: Vec<Line>,
    /// Gain of each frame: factors on light by the recording's median (red, green, blue). Empty if
    /// unknown or steady.
    pub gains: Vec<[f64; 3]>,
    /// Gain within each frame. Empty if unknown or uniform.
    pub across: Vec<SpatialGain>,
    /// Residuals of the held-out links. Empty if there are none.
    pub held_out: Vec<HeldOutResidual>,
    /// Panorama of the room's light without its lamps; `None` if unknown.
    pub environment: Option<EnvironmentFit>,
    /// Surfels fused from all depth maps; `None` without a depth sensor, or if the poses were
    /// refused.
    pub surfels: Option<SurfelMap>,
    /// Noise by example; `None` without one.
    pub example_noise: Option<ExampleNoiseFile>,
}

/// All estimates except for the registration.
pub struct Estimates<'a> {
    pub gain: Result<GainFindings, String>,
    /// ln, one per frame; `None` for frames that could not be compared.
    pub gains: &'a [Option<[f64; 3]>],
    pub across: Option<(Vec<SpatialGain>, SpatialGainFit)>,
    pub exposure: Result<ExposureRuns, String>,
    pub spread: Result<PointSpreadEstimate, String>,
    /// `None` if the camera's noise is known otherwise.
    pub noise: Option<NoiseFindings>,
    pub example_noise: ExampleNoiseEstimate,
    pub tone: Result<Vec<ToneBand>, String>,
    pub light: Result<RoomLight, String>,
    pub surfels: Vec<Surfel>,
}

/// Why an analysis could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum AnalysisError {
    #[error("{}: cannot be read: {reason}", file.display())]
    Unread { file: PathBuf, reason: String },
    #[error("{}: {problem}", file.display())]
    Content { file: PathBuf, problem: String },
    #[error(transparent)]
    Text(#[from] TextError),
    #[error("{}: cannot be written: {reason}", folder.display())]
    Unwritten { folder: PathBuf, reason: String },
    #[error(transparent)]
    Sink(#[from] SinkError),
    #[error(
        "{}: contains {other}, which does not belong to an analysis, so nothing was written; move it elsewhere, or \
         choose another folder (--output)",
        folder.display()
    )]
    Others { folder: PathBuf, other: String },
}

/// Default folder of a recording's analysis: beside it, of its name with `.analysis`.
pub fn default_folder(recording: &Path) -> PathBuf {
    let whole = recording.canonicalize().unwrap_or_else(|_| recording.to_owned());
    let folder = if whole.is_file() { whole.parent().map(Path::to_owned).unwrap_or_default() } else { whole };
    let mut name = folder.file_name().unwrap_or_default().to_owned();
    name.push(".analysis");
    folder.with_file_name(name)
}

/// The SHA-256 of a folder's `analysis.toml`, hexadecimal, as `sha256sum` gives it; `None` if it
/// cannot be read.
pub fn digest(folder: &Path) -> Option<String> {
    let text = std::fs::read(folder.join(FILE_NAME)).ok()?;
    Some(inputs::hex(&Sha256::digest(text)))
}

impl Analysis {
    pub fn new(
        recording: &Recording,
        camera: &Geometry,
        registration: &Registration,
        estimates: Estimates<'_>,
    ) -> Self {
        let Estimates { gain, gains, across, exposure, spread, noise, example_noise, tone, light, surfels } = estimates;
        let ExampleNoiseEstimate { findings: example_findings, file } = example_noise;
        let example_noise = ExampleNoiseFile::of(file, Path::new(EXAMPLE_NOISE)).ok();
        let surfels = SurfelMap::of(&surfels);
        let (across, fitted) = across.unzip();
        let across = across.filter(|_| fitted.is_some_and(|fitted| fitted.is_followed)).unwrap_or_default();
        let mut camera = camera.clone();
        camera.intrinsics.readout_time_s = registration.readout_s;
        let moves_alone = registration.motion_px.is_some();
        let knot = |n: usize| {
            let state = registration.states[n]?;
            Some(TrackKnot {
                time_s: recording.timestamps_s[n],
                state,
                is_alone: moves_alone || registration.repeats.get(n).copied().unwrap_or(false),
            })
        };
        let lines: Vec<Line> = if registration.verdict == Verdict::Refined || moves_alone {
            let knots: Vec<TrackKnot> = (0..recording.frame_count()).filter_map(knot).collect();
            let usual_s = recording.frame_interval_s;
            let way = registration.rig_offset.filter(|_| !moves_alone && moves_as_recorded(recording)).map(|offset| {
                RecordedMotion { track: &recording.track, later_s: offset.clock_s, hand_eye: offset.hand_eye }
            });
            let poses = track::poses(&knots, usual_s, track::MAX_GAP_INTERVALS * usual_s, way.as_ref());
            poses.iter().map(|(time_s, pose)| Line::new(*time_s, pose)).collect()
        } else {
            Vec::new()
        };
        let environment = light.as_ref().ok().and_then(|light| EnvironmentFit::of(&light.panorama));
        let nominal_interval_s = (!recording.kind.has_times()).then_some(recording.frame_interval_s);
        let findings = Findings {
            version: VERSION,
            recording: inputs::fingerprint(recording),
            frames: recording.frame_count(),
            left_out: Vec::new(),
            made_with: Dependencies::of(recording),
            registration: PoseFindings { pose_lines: lines.len(), ..PoseFindings::of(registration) },
            gain_why: gain.as_ref().err().cloned(),
            gain: gain.ok(),
            across: fitted,
            shutter: Some(ShutterFindings::of(exposure, nominal_interval_s)),
            spread: Some(SharpnessFindings::of(spread)),
            noise,
            example_noise: Some(example_findings),
            tone: Some(Tone::of(tone)),
            light: Some(LightFindings::of(&light, environment.as_ref())),
            surfels: surfels.as_ref().map(SurfelFindings::of),
            camera,
        };
        // They ascend.
        let track = track_of(&lines).ok().filter(|_| !lines.is_empty());
        let (gains, held_out) = (gain_factors(gains), registration.held_out.clone());
        Self { findings, track, lines, gains, across, held_out, environment, surfels, example_noise }
    }

    /// The track, if its poses are refined.
    pub fn refined(&self) -> Option<&PoseTrack> {
        self.track.as_ref().filter(|_| self.findings.registration.is_refined())
    }

    /// Drops the refined poses and everything that depends on them: the readout time, the delay of
    /// depth, and surfels that they placed.
    pub fn without_registration(self) -> Self {
        let surfels = self.surfels.filter(|_| self.track.is_none());
        Self { track: None, surfels, ..self }
    }

    pub fn read(folder: &Path) -> Result<Self, AnalysisError> {
        let path = folder.join(FILE_NAME);
        let unread = |file: &Path, error: &std::io::Error| AnalysisError::Unread {
            file: file.to_owned(),
            reason: reason(error),
        };
        let content = |file: &Path, problem: String| AnalysisError::Content { file: file.to_owned(), problem };
        let text = file::read_text(&path, MAX_DOCUMENT_BYTES).map_err(|error| unread(&path, &error))?;
        let version: Version = document::read(&text).map_err(|problem| content(&path, problem.to_string()))?;
        if version.version != VERSION {
            let file_version = version.version;
            return Err(content(
                &path,
                format!("version {file_version}; this program makes and reads version {VERSION}"),
            ));
        }
        let findings: Findings = document::read(&text).map_err(|problem| content(&path, problem.to_string()))?;
        if let Some(shutter) = &findings.shutter {
            shutter.check(findings.frames).map_err(|problem| content(&path, problem))?;
        }
        if let Some(noise) = &findings.noise {
            noise.check().map_err(|problem| content(&path, problem))?;
        }
        let (mut lines, mut track) = (Vec::new(), None);
        if findings.registration.is_refined() || findings.registration.motion_px.is_some() {
            let path = folder.join(POSES);
            lines = parse_lines(&records::read(&path)?, &path)?.0;
            check_line_count(lines.len(), findings.registration.pose_lines, "poses").map_err(|e| content(&path, e))?;
            track = Some(track_of(&lines).map_err(|error| content(&path, error.to_string()))?);
        }
        let gains = if findings.gain.as_ref().is_some_and(|gain| gain.is_followed) {
            read_gains(&folder.join(FRAMES), findings.frames)?
        } else {
            Vec::new()
        };
        let across = match findings.across {
            Some(across) if across.is_followed => read_across(&folder.join(ACROSS), findings.frames)?,
            _ => Vec::new(),
        };
        let held_out = match findings.registration.recorded_px {
            Some(_) => {
                let (path, expected) = (folder.join(LINKS), findings.registration.link_lines);
                let links = read_links(&path, findings.frames)?;
                check_line_count(links.len(), expected, "links").map_err(|problem| content(&path, problem))?;
                links
            }
            None => Vec::new(),
        };
        let environment = match findings.light.as_ref().filter(|light| light.panorama.is_some()) {
            Some(light) => {
                light.check().map_err(|problem| content(&path, problem))?;
                let path = folder.join(ENVIRONMENT);
                let fingerprint = light.panorama.as_deref().unwrap_or_default();
                Some(EnvironmentFit::read(&path, fingerprint).map_err(|problem| content(&path, problem))?)
            }
            None => None,
        };
        let surfels = match &findings.surfels {
            Some(fused) => {
                let path = folder.join(SURFELS);
                Some(SurfelMap::read(&path, &fused.sha256).map_err(|problem| content(&path, problem))?)
            }
            None => None,
        };
        let example_noise = match findings.example_noise.as_ref().and_then(|example| example.sha256.as_ref()) {
            Some(sha256) => {
                let path = folder.join(EXAMPLE_NOISE);
                let bytes = file::read(&path, MAX_EXAMPLE_NOISE_BYTES).map_err(|error| unread(&path, &error))?;
                if inputs::hex(&Sha256::digest(&bytes)) != *sha256 {
                    let problem = "this is not the noise that was found; analyse the recording again".to_owned();
                    return Err(content(&path, problem));
                }
                Some(ExampleNoiseFile::of(bytes, &path).map_err(|problem| content(&path, problem))?)
            }
            None => None,
        };
        Ok(Self { findings, track, lines, gains, across, held_out, environment, surfels, example_noise })
    }

    /// The files, by name.
    pub fn files(&self, recording: &Recording) -> Result<Vec<(&'static str, Vec<u8>)>, AnalysisError> {
        let problem = |problem: document::Problem| AnalysisError::Content {
            file: FILE_NAME.into(),
            problem: problem.to_string(),
        };
        let document = TomlDocument::new(self.findings.clone()).map_err(problem)?;
        let head =
            "# Estimates from the footage, by `locard analyse`. Compositing uses them as long as this file exists.\n";
        let mut files: Vec<(&'static str, Vec<u8>)> = vec![];
        if !self.lines.is_empty() {
            files.push((POSES, write_trajectory(&self.lines).into_bytes()));
        }
        if !self.gains.is_empty() {
            let line = |(n, [r, g, b]): (usize, &[f64; 3])| format!("{n} {} {r} {g} {b}\n", recording.timestamps_s[n]);
            let lines: String = self.gains.iter().enumerate().map(line).collect();
            files.push((
                FRAMES,
                format!("# frame timestamp red green blue: brighter than usual by these factors\n{lines}").into_bytes(),
            ));
        }
        if !self.across.is_empty() {
            let nodes = |across: &SpatialGain| across.0.iter().map(|node| format!(" {node}")).collect::<String>();
            let line = |(n, across): (usize, &SpatialGain)| format!("{n}{}\n", nodes(across));
            let lines: String = self.across.iter().enumerate().map(line).collect();
            let head = format!(
                "# frame, then the brightness at each grid point relative to the frame's gain, stops, row by row: \
                 {NODES_ACROSS} points in each of {NODES_DOWN} rows\n"
            );
            files.push((ACROSS, (head + &lines).into_bytes()));
        }
        if self.findings.registration.recorded_px.is_some() {
            let line = |m: &HeldOutResidual| format!("{} {} {} {}\n", m.from, m.to, m.recorded_px, m.refined_px);
            let lines: String = self.held_out.iter().map(line).collect();
            files.push((
                LINKS,
                format!(
                    "# from to recorded refined: residuals of the poses against the alignment of held-out pairs, \
                         px\n{lines}"
                )
                .into_bytes(),
            ));
        }
        files.extend(self.environment.as_ref().map(|around| (ENVIRONMENT, around.hdr.to_vec())));
        files.extend(self.surfels.as_ref().map(|map| (SURFELS, map.ply.to_vec())));
        files.extend(self.example_noise.as_ref().map(|file| (EXAMPLE_NOISE, file.bytes.to_vec())));
        // Last, because its opacity marks a complete analysis.
        files.push((FILE_NAME, format!("{head}{document}").into_bytes()));
        Ok(files)
    }

    /// The room's light, for a scene without light of its own.
    pub fn lighting(&self) -> Option<Lighting> {
        self.findings.light.as_ref()?.lighting(self.environment.as_ref()?)
    }

    /// The estimates that are applied to a recording. `median_s`: [`RelativeBrightness::median_s`].
    pub fn refinement(&self, median_s: Option<f64>) -> Refinement {
        let registered = &self.findings.registration;
        let brightness = |(n, factors): (usize, &[f64; 3])| RelativeBrightness {
            factors: *factors,
            median_s,
            spatial_gain: self.across.get(n).copied().unwrap_or_default(),
        };
        Refinement {
            track: self.track.clone(),
            depth_later_s: if self.track.is_some() { registered.depth_later_s } else { 0.0 },
            brightness: self.gains.iter().enumerate().map(brightness).collect(),
            blur_estimate_s: self.findings.shutter.as_ref().map_or(Vec::new(), |shutter| shutter.of_frames()),
            surfels: self.surfels.as_ref().map_or_else(Arc::default, |map| Arc::clone(&map.surfels)),
        }
    }

    /// Checks that the analysis was made from this recording and for this camera.
    pub fn fits(&self, recording: &Recording, camera: &Geometry) -> Result<(), String> {
        let Findings { frames, recording: made_from, .. } = &self.findings;
        if *frames != recording.frame_count() {
            return Err(format!("it was made from {frames} frames, but the recording has {}", recording.frame_count()));
        }
        if *made_from != inputs::fingerprint(recording) {
            return Err("the recording has changed since it was made".to_owned());
        }
        self.fits_camera(camera)
    }

    /// Checks that the analysis was made for this camera.
    pub fn fits_camera(&self, camera: &Geometry) -> Result<(), String> {
        let of = &self.findings.camera;
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

/// The track of the lines. Gaps by more than two dropped frames are not interpolated.
fn track_of(lines: &[Line]) -> Result<PoseTrack, NotAscending> {
    let times_s: Vec<f64> = lines.iter().map(|line| line.time_s).collect();
    let max_gap_s = (track::MAX_GAP_INTERVALS + 0.5) * median_interval_s(&times_s).unwrap_or_default();
    PoseTrack::new(lines.iter().map(|line| (line.time_s, line.pose())).collect(), max_gap_s)
}

#[derive(Deserialize)]
struct Version {
    version: u32,
}

/// Factors on light from ln. Frames without a gain are interpolated between their neighbours. Empty
/// if no frame has one.
pub fn gain_factors(gains: &[Option<[f64; 3]>]) -> Vec<[f64; 3]> {
    let measured: Vec<(usize, [f64; 3])> = gains.iter().enumerate().filter_map(|(n, g)| Some((n, (*g)?))).collect();
    let (Some(first), Some(last)) = (measured.first(), measured.last()) else { return Vec::new() };
    let at = |n: usize| {
        let after = measured.partition_point(|k| k.0 < n);
        let (a, b) =
            (measured[after.saturating_sub(1).min(measured.len() - 1)], measured.get(after).copied().unwrap_or(*last));
        let a = if after == 0 { *first } else { a };
        let share = if b.0 > a.0 { (n - a.0) as f64 / (b.0 - a.0) as f64 } else { 0.0 };
        [0, 1, 2].map(|c| (a.1[c] + share * (b.1[c] - a.1[c])).exp())
    };
    (0..gains.len()).map(at).collect()
}

/// Checks the number of a file's lines.
fn check_line_count(length: usize, written: usize, of: &str) -> Result<(), String> {
    if length == written { Ok(()) } else { Err(format!("it has {length} {of}, {written} were written")) }
}

fn read_gains(path: &Path, frames: usize) -> Result<Vec<[f64; 3]>, AnalysisError> {
    read_frames(path, frames, |rest| {
        records::number(rest, "timestamp")?;
        let mut gain = [0.0; 3];
        for (gain, name) in gain.iter_mut().zip(["red", "green", "blue"]) {
            *gain = records::number(rest, name)?;
            if *gain <= 0.0 {
                return Err(format!("{name} is {gain}; a factor above 0 is expected"));
            }
        }
        Ok(gain)
    })
}

fn read_across(path: &Path, frames: usize) -> Result<Vec<SpatialGain>, AnalysisError> {
    read_frames(path, frames, |rest| {
        let mut across = SpatialGain::default();
        for node in &mut across.0 {
            let stops = records::number(rest, "stops")?;
            if stops.abs() > MAX_EV {
                return Err(format!("{stops} stops; from -{MAX_EV} to {MAX_EV} are expected"));
            }
            *node = stops as f32;
        }
        Ok(across)
    })
}

/// Reads a file with one line per frame, in order, which begins with its number.
fn read_frames<T>(
    path: &Path,
    frames: usize,
    of: impl Fn(&mut &str) -> Result<T, String>,
) -> Result<Vec<T>, AnalysisError> {
    let whole = records::read_listing(path)?;
    let mut all = Vec::new();
    for (at, record) in records::records(&whole) {
        let wrong = |problem: String| TextError::line(path, at, problem);
        let mut rest = record;
        let number = records::number(&mut rest, "frame").map_err(wrong)?;
        let one = of(&mut rest).map_err(wrong)?;
        records::end(rest).map_err(wrong)?;
        if number != all.len() as f64 {
            return Err(wrong(format!("found frame {number} where frame {} is expected", all.len())).into());
        }
        all.push(one);
    }
    if all.len() != frames {
        let problem = format!("{} frames are listed, there are {frames}", all.len());
        return Err(AnalysisError::Content { file: path.to_owned(), problem });
    }
    Ok(all)
}

fn read_links(path: &Path, frames: usize) -> Result<Vec<HeldOutResidual>, AnalysisError> {
    let whole = records::read_listing(path)?;
    let mut links = Vec::new();
    for (at, record) in records::records(&whole) {
        let wrong = |problem: String| TextError::line(path, at, problem);
        let mut rest = record;
        let mut numbers = [0.0; 4];
        for (number, name) in numbers.iter_mut().zip(["from", "to", "recorded", "refined"]) {
            *number = records::number(&mut rest, name).map_err(wrong)?;
        }
        records::end(rest).map_err(wrong)?;
        let [from, to, recorded_px, refined_px] = numbers;
        let is_frame = |n: f64| n >= 0.0 && n.fract() == 0.0 && n < frames as f64;
        if !(is_frame(from) && is_frame(to) && recorded_px >= 0.0 && refined_px >= 0.0) {
            let problem = format!("two of the {frames} frames and two lengths are expected");
            return Err(wrong(problem).into());
        }
        links.push(HeldOutResidual { from: from as usize, to: to as usize, recorded_px, refined_px });
    }
    Ok(links)
}
