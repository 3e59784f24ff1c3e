//! Warnings that do not stop a run.

use std::fmt;
use std::ops::Range;
use std::path::PathBuf;

use glam::DVec3;

use super::{AnalysisState, Shot, SupportGap};
use crate::compositor::FrameStats;
use crate::frame::Frame;
use crate::scene::{LightingOrigin, Scene, overlaps, size_warning};
use crate::text::{count, millimetres, number, shown};

/// A warning. Displays as a line for the user.
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// Warnings of the recording and the scene.
    Recording(String),
    Scene(String),
    /// An analysis exists but is not used: its folder, and the reason.
    Analysis(PathBuf, String),
    /// Estimates of the analysis that are invalid for the recording as it was opened.
    StaleEstimates(PathBuf, String),
    /// Frames without a pose, which are passed through.
    MissingPoses(String),
    /// The frames' exposure is unknown. `has_times`: whether their times are meaningful.
    UnknownExposure {
        has_times: bool,
    },
    /// The scene file's unit differs from the recording's, m.
    OtherUnit {
        of_scene: f64,
        holds: f64,
    },
    /// The camera's noise is unknown.
    UnknownNoise,
    /// Objects far from the place for which the light was estimated: their names, and the largest
    /// distance.
    FarFromLight {
        names: Vec<String>,
        distance_m: f64,
    },
    /// Settings of an effect without any result.
    Idle(&'static str),
    /// Depth that occluded nothing, in `number` of `frames` frames.
    NothingHides {
        number: usize,
        frames: usize,
        first: usize,
        because: String,
    },
    /// Frames with the pattern for noise, because the examples do not fit them.
    NoExampleNoise {
        number: usize,
        frames: usize,
        first: usize,
        because: String,
    },
    /// Noise by example of pictures of another camera or setting: the difference of the first such
    /// frame.
    OtherNoise(String),
    /// No object was in any picture.
    NothingSeen,
    /// An object whose model has an implausible size in metres.
    OddSize(String),
    /// Two objects share volume.
    Overlap(String),
    /// The number of further overlaps.
    MoreOverlaps(usize),
    /// An object above the surface of a frame's depth, or below it (negative).
    Gap {
        name: String,
        gap_m: f64,
        frame: usize,
    },
}

/// A warning with its objects.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectIssue {
    /// Indices into [`crate::scene::Scene::objects`].
    pub objects: Vec<usize>,
    pub note: Note,
}

/// Distance from the place of the estimated light up to which it holds, m: the white level is
/// measured on surfaces within 0.8 to 2 m.
const LIGHT_REACH_M: f64 = 1.2;

/// Further overlaps are only counted.
const MAX_REPORTED_OVERLAPS: usize = 8;

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Recording(text) | Self::Scene(text) | Self::MissingPoses(text) | Self::Overlap(text) => {
                f.write_str(text)
            }
            Self::OddSize(text) => f.write_str(text),
            Self::Idle(text) => f.write_str(text),
            Self::Analysis(folder, problem) => {
                write!(f, "{} is not used: {problem}; analyse the recording again", folder.display())
            }
            Self::StaleEstimates(folder, which) => write!(f, "{}: {which}", folder.display()),
            Self::UnknownExposure { has_times } => {
                f.write_str(if *has_times {
                    "the exposure time of the frames is unknown: half the frame interval is assumed, at most 1/60 s"
                } else {
                    "the pictures have no timestamps, so nothing is blurred by motion"
                })?;
                f.write_str("; the camera's exposure time overrides this (--set camera.exposure.time_s=SECONDS)")
            }
            Self::OtherUnit { of_scene, holds } => {
                let (of_scene, holds) = (number(*of_scene), number(*holds));
                write!(
                    f,
                    "the scene file's metres_per_unit = {of_scene} is left out: the recording's unit is {holds} m"
                )
            }
            Self::UnknownNoise => f.write_str(
                "this camera's noise is unknown: objects are drawn without noise and look too clean; measure the noise \
                 (`locard calibrate noise` from pictures of a scene at rest, with --moving from the recording itself)",
            ),
            Self::FarFromLight { names, distance_m } => {
                let names = names.iter().map(|name| shown(name)).collect::<Vec<_>>().join(", ");
                write!(
                    f,
                    "{names}: up to {distance_m:.1} m from the place of the measured light; objects do not follow if \
                     the room is darker or brighter there (`locard light --white` measures the light at something \
                     white beside them)"
                )
            }
            Self::NothingHides { number, frames, first, because } => {
                let of = format!("{number} of {}", count(*frames, "frame"));
                write!(
                    f,
                    "real things do not occlude objects in {of}, although there is depth (frame {first}: \
                           {because})"
                )
            }
            Self::NoExampleNoise { number, frames, first, because } => {
                let of = format!("{number} of {}", count(*frames, "frame"));
                write!(
                    f,
                    "the examples of the camera's noise do not fit {of}, whose noise is a pattern (frame {first}: \
                     {because}; `locard calibrate noise` from the same camera's frames makes examples that fit)"
                )
            }
            Self::OtherNoise(mismatch) => write!(
                f,
                "{mismatch}: another camera or setting? calibrate from this camera (`locard calibrate noise`), or use \
                 `noise.method = \"pattern\"`"
            ),
            Self::MoreOverlaps(more) => {
                write!(f, "{} of objects overlap", count(*more, "more pair"))
            }
            Self::Gap { name, gap_m, frame } => {
                let (name, far) = (shown(name), millimetres(gap_m.abs()));
                let how = if *gap_m > 0.0 { "hovers" } else { "is sunk" };
                let whence = if *gap_m > 0.0 { "over" } else { "into" };
                write!(f, "{name} {how} {far} {whence} the surface in the depth of frame {frame}")
            }
            Self::NothingSeen => f.write_str(
                "no object of the scene is in the picture (`locard inspect RECORDING --frame N` shows the camera's \
                 position and direction, `locard inspect SCENE` the objects' positions)",
            ),
        }
    }
}

impl Note {
    /// Notes on frames that were composited.
    pub fn of_frames(stats: &[FrameStats]) -> Vec<Self> {
        let mut tally = FrameCounts::default();
        stats.iter().for_each(|stats| tally.add(stats));
        tally.notes()
    }
}

/// Counts over composited frames, for warnings; of constant size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameCounts {
    frames: usize,
    /// Frames in which depth occluded nothing; the first of them, and the reason.
    hides_nothing: usize,
    first: Option<(usize, String)>,
    /// Frames without their noise by example; the first of them, and the reason.
    no_example_noise: usize,
    first_without_example: Option<(usize, String)>,
    /// The first mismatch of a frame with its noise by example.
    first_mismatch: Option<String>,
    /// Whether an object may have been visible.
    shows: bool,
}

impl FrameCounts {
    pub fn add(&mut self, stats: &FrameStats) {
        self.frames += 1;
        self.shows |= stats.objects_in_sight || stats.no_pose.is_some();
        if let Some(because) = &stats.no_occlusion {
            self.hides_nothing += 1;
            self.first.get_or_insert_with(|| (stats.frame, because.clone()));
        }
        if let Some(mismatch) = &stats.example_mismatch {
            self.first_mismatch.get_or_insert_with(|| mismatch.clone());
        }
        if let Some(because) = &stats.no_example_noise {
            self.no_example_noise += 1;
            self.first_without_example.get_or_insert_with(|| (stats.frame, because.clone()));
        }
    }

    /// Number of frames that were added.
    pub fn frames(&self) -> usize {
        self.frames
    }

    pub fn notes(&self) -> Vec<Note> {
        let (number, frames) = (self.hides_nothing, self.frames);
        let hides_nothing =
            self.first.clone().map(|(first, because)| Note::NothingHides { number, frames, first, because });
        let no_example = self.first_without_example.clone().map(|(first, because)| Note::NoExampleNoise {
            number: self.no_example_noise,
            frames,
            first,
            because,
        });
        let other_noise = self.first_mismatch.clone().map(Note::OtherNoise);
        hides_nothing
            .into_iter()
            .chain(no_example)
            .chain(other_noise)
            .chain((!self.shows).then_some(Note::NothingSeen))
            .collect()
    }
}

/// The objects of a scene with the footage's light that are far from the place of that light.
fn far_from_light_note(place_m: DVec3, scene: &Scene) -> Option<Note> {
    let objects = scene.objects.iter().filter(|object| !object.parts.is_empty());
    let distances = objects.map(|object| (object, object.world_from_model.translation.distance(place_m)));
    let is_lit_by_footage = scene.lighting_origin != LightingOrigin::Scene;
    let far: Vec<_> = distances.filter(|(_, distance_m)| is_lit_by_footage && *distance_m > LIGHT_REACH_M).collect();
    let distance_m = far.iter().map(|(_, distance_m)| *distance_m).reduce(f64::max)?;
    Some(Note::FarFromLight { names: far.iter().map(|(object, _)| object.name.clone()).collect(), distance_m })
}

impl Shot {
    /// Warnings to show before a range of frames is composited.
    pub fn notes(&self, range: Range<usize>) -> Vec<Note> {
        let mut notes: Vec<_> = self.recording.warnings.iter().cloned().map(Note::Recording).collect();
        notes.extend(self.unused_analysis_note());
        notes.extend(self.stale_estimates());
        let coverage = self.recording.site().and_then(|site| self.site_coverage(site, range.clone()));
        notes.extend(
            coverage.filter(|covered| *covered == 0.0).map(|_| {
                Note::Scene("no frame shows the scan: check its unit and its place (`locard site`)".to_owned())
            }),
        );
        notes.extend(self.recording.missing_poses(range).map(Note::MissingPoses));
        notes.extend(self.scene.warnings.iter().cloned().map(Note::Scene));
        notes.extend(self.site_problem.iter().cloned().map(Note::Scene));
        let scan = self.recording.site().map(|site| &site.scan);
        notes.extend(scan.iter().flat_map(|scan| scan.warnings.iter().cloned().map(Note::Scene)));
        let holds = self.recording.metres_per_unit;
        if let Some(of_scene) = self.scene.metres_per_unit.filter(|of_scene| *of_scene != holds) {
            notes.push(Note::OtherUnit { of_scene, holds });
        }
        notes.extend(self.unknown_exposure());
        let camera = self.camera();
        if camera.noise.is_none() && !self.is_plain() {
            notes.push(Note::UnknownNoise);
        }
        notes.extend(self.settings.ineffective_settings(&camera).into_iter().map(Note::Idle));
        notes.extend(self.far_from_light());
        notes.extend(self.overlap_notes());
        notes
    }

    /// The warning that objects are far from the place for which the light was estimated.
    pub fn far_from_light(&self) -> Option<Note> {
        let AnalysisState::Used(_, findings) = &self.analysis else { return None };
        let light = findings.light.as_ref().filter(|light| light.claimed && self.lighting_matches_unit())?;
        far_from_light_note(light.place_m?.into(), &self.scene)
    }

    /// The warning that an analysis exists but is not used.
    pub fn unused_analysis_note(&self) -> Option<Note> {
        match &self.analysis {
            AnalysisState::Unfit(folder, problem) => Some(Note::Analysis(folder.clone(), problem.clone())),
            _ => None,
        }
    }

    /// Estimates of the analysis in use that are invalid for the present recording.
    pub fn stale_estimates(&self) -> Vec<Note> {
        let AnalysisState::Used(folder, findings) = &self.analysis else { return Vec::new() };
        let of_unit = (!self.lighting_matches_unit()).then(|| {
            let (was, is) = (number(findings.made_with.metres_per_unit), number(self.recording.metres_per_unit));
            format!(
                "light left out, found with a unit of {was} m, which is {is} m now: analyse the recording again with \
                 --metres-per-unit {is}"
            )
        });
        findings.left_out.iter().cloned().chain(of_unit).map(|why| Note::StaleEstimates(folder.clone(), why)).collect()
    }

    /// The warning of an unknown exposure on which effects may depend.
    pub fn unknown_exposure(&self) -> Option<Note> {
        self.lacks_exposure().then(|| Note::UnknownExposure { has_times: self.recording.kind.has_times() })
    }

    /// Notes on objects that stand inside each other.
    pub fn overlap_notes(&self) -> Vec<Note> {
        let pairs = overlaps(&self.scene);
        let mut notes: Vec<_> =
            pairs.iter().take(MAX_REPORTED_OVERLAPS).map(|o| Note::Overlap(o.message(&self.scene))).collect();
        if pairs.len() > MAX_REPORTED_OVERLAPS {
            notes.push(Note::MoreOverlaps(pairs.len() - MAX_REPORTED_OVERLAPS));
        }
        notes
    }

    /// Objects with problems: implausible sizes, overlaps, and gaps to the surface of a frame's
    /// depth.
    pub fn object_issues(&self, frame: &Frame) -> Vec<ObjectIssue> {
        let overlaps = overlaps(&self.scene).into_iter();
        let overlaps =
            overlaps.map(|o| ObjectIssue { objects: o.objects.to_vec(), note: Note::Overlap(o.message(&self.scene)) });
        let sizes = self.scene.objects.iter().enumerate().filter_map(|(object, of)| {
            let note = Note::OddSize(size_warning(&self.scene, of)?);
            Some(ObjectIssue { objects: vec![object], note })
        });
        let gaps = self.support_gaps(frame).into_iter().filter_map(|SupportGap { object, gap_m }| {
            let (name, gap_m, frame) = (self.scene.objects[object].name.clone(), gap_m?, frame.index);
            Some(ObjectIssue { objects: vec![object], note: Note::Gap { name, gap_m, frame } })
        });
        // Skip stand-ins: their size is not the model's.
        let is_known = |wrong: &ObjectIssue| !wrong.objects.iter().any(|object| self.scene.objects[*object].is_missing);
        sizes.chain(overlaps).chain(gaps).filter(is_known).collect()
    }

    /// Warnings of objects that hover or are sunk in every one of three frames: the first of a
    /// range, the middle one and the last. Those frames are decoded; unreadable ones are skipped.
    pub fn support_gap_notes(&self, range: Range<usize>) -> Vec<Note> {
        if range.is_empty() || self.scene.objects.is_empty() || !self.recording.has_depth() {
            return Vec::new();
        }
        let mut frames = vec![range.start, range.start + range.len() / 2, range.end - 1];
        frames.dedup();
        let frames: Vec<Frame> = frames.into_iter().filter_map(|frame| self.read(frame).ok()).collect();
        let checked: Vec<_> = frames.iter().map(|frame| (frame.index, self.support_gaps(frame))).collect();
        (0..self.scene.objects.len())
            .filter_map(|object| {
                let of =
                    |support_gaps: &[SupportGap]| support_gaps.iter().find(|s| s.object == object).map(|s| s.gap_m);
                let measured: Vec<_> = checked.iter().filter_map(|(frame, all)| Some((*frame, of(all)?))).collect();
                let gaps: Option<Vec<_>> = measured.iter().map(|(frame, gap)| Some((*frame, (*gap)?))).collect();
                let gaps = gaps
                    .filter(|gaps| gaps.iter().all(|(_, gap)| *gap > 0.0) || gaps.iter().all(|(_, gap)| *gap < 0.0))?;
                let (frame, gap_m) = gaps.into_iter().min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
                Some(Note::Gap { name: self.scene.objects[object].name.clone(), gap_m, frame })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Object, Part};
    use glam::DAffine3;

    #[test]
    fn objects_far_from_the_light_are_named_with_the_largest_distance() {
        let object = |name: &str, x: f64| Object {
            name: name.to_owned(),
            parts: vec![Part { mesh: 0, world_from_mesh: DAffine3::IDENTITY }],
            world_from_model: DAffine3::from_translation(DVec3::new(x, 0.0, 0.0)),
            ..Object::default()
        };
        let objects = vec![object("near", 1.1), object("chair", -1.5), object("door", 4.0)];
        let scene = Scene { objects, lighting_origin: LightingOrigin::Default, ..Scene::default() };
        let note = far_from_light_note(DVec3::ZERO, &scene).unwrap();
        let names = vec!["chair".to_owned(), "door".to_owned()];
        assert_eq!(note, Note::FarFromLight { names, distance_m: 4.0 });
        assert!(note.to_string().starts_with("chair, door: up to 4.0 m from the place"));
        // A scene's own light holds everywhere.
        let own = Scene { lighting_origin: LightingOrigin::Scene, ..scene };
        assert_eq!(far_from_light_note(DVec3::ZERO, &own), None);
    }
}
