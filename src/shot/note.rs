//! Warnings that do not stop a run.

use std::fmt;
use std::ops::Range;
use std::path::PathBuf;

use super::{AnalysisState, Shot, Standing};
use crate::compositor::FrameStats;
use crate::frame::Frame;
use crate::scene::{overlaps, size_warning};
use crate::text::{count, millimetres, number, shown};

/// Something odd or unknown. Displays as a line for a person.
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// Warnings of the recording and the scene.
    Recording(String),
    Scene(String),
    /// What `locard analyse` found is there and not used: where, and why.
    Analysis(PathBuf, String),
    /// Estimates of it that do not hold for the recording as it was opened.
    StaleEstimates(PathBuf, String),
    /// Frames without a pose, which are passed through.
    MissingPoses(String),
    /// The frames' exposure is unknown. `has_times`: whether their times mean anything.
    UnknownExposure {
        has_times: bool,
    },
    /// The scene file's length of a unit is not the one that holds, metres.
    OtherUnit {
        of_scene: f64,
        holds: f64,
    },
    /// The camera's noise is not known.
    UnknownNoise,
    /// Settings of an effect that do nothing.
    Idle(&'static str),
    /// Depth that hid nothing, in `number` of `frames` frames.
    NothingHides {
        number: usize,
        frames: usize,
        first: usize,
        because: String,
    },
    /// No object was in any picture.
    NothingSeen,
    /// An object whose model is hardly in metres.
    OddSize(String),
    /// Two objects share volume.
    Overlap(String),
    /// There are more of these.
    MoreOverlaps(usize),
    /// An object hovers over what a frame's depth shows, or, below 0, is sunk into it.
    Gap {
        name: String,
        gap_m: f64,
        frame: usize,
    },
}

/// A note with the objects that it is about.
#[derive(Clone, Debug, PartialEq)]
pub struct Wrong {
    /// Indices into [`crate::scene::Scene::objects`].
    pub objects: Vec<usize>,
    pub note: Note,
}

/// More overlaps are only counted.
const MOST_OVERLAPS: usize = 8;

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Recording(text) | Self::Scene(text) | Self::MissingPoses(text) | Self::Overlap(text) => f.write_str(text),
            Self::OddSize(text) => f.write_str(text),
            Self::Idle(text) => f.write_str(text),
            Self::Analysis(folder, problem) => {
                write!(f, "{} is not used: {problem}; analyse the recording again", folder.display())
            }
            Self::StaleEstimates(folder, which) => write!(f, "{}: {which}", folder.display()),
            Self::UnknownExposure { has_times } => {
                f.write_str(match has_times {
                    true => "nothing says how long the frames were exposed: half the frame interval is taken, at most 1/60 s",
                    false => "the pictures bear no times, so that nothing is blurred by motion",
                })?;
                f.write_str("; the camera's exposure time says otherwise (--set camera.exposure.time_s=SECONDS)")
            }
            Self::OtherUnit { of_scene, holds } => {
                let (of_scene, holds) = (number(*of_scene), number(*holds));
                write!(f, "the scene file's metres_per_unit = {of_scene} is left out: the recording's unit is {holds} m")
            }
            Self::UnknownNoise => f.write_str(
                "nothing says how noisy this camera is: objects are drawn without noise, and look too clean beside it; \
                 calibrate it (`locard calibrate noise` from pictures of a scene at rest, with --moving from the recording \
                 itself)",
            ),
            Self::NothingHides { number, frames, first, because } => {
                let of = format!("{number} of {}", count(*frames, "frame"));
                write!(f, "nothing real hides objects in {of}, though there is depth (frame {first}: {because})")
            }
            Self::MoreOverlaps(more) => {
                write!(f, "{} of objects stand inside each other", count(*more, "more pair"))
            }
            Self::Gap { name, gap_m, frame } => {
                let (name, far) = (shown(name), millimetres(gap_m.abs()));
                let how = if *gap_m > 0.0 { "hovers" } else { "is sunk" };
                let whence = if *gap_m > 0.0 { "over" } else { "into" };
                write!(f, "{name} {how} {far} {whence} the surface that the depth of frame {frame} shows")
            }
            Self::NothingSeen => f.write_str(
                "no object of the scene is in the picture (`locard inspect RECORDING --frame N` says where the camera is \
                 and looks, `locard inspect SCENE` where the objects are)",
            ),
        }
    }
}

impl Note {
    /// Notes on frames that were composited.
    pub fn of_frames(stats: &[FrameStats]) -> Vec<Self> {
        let mut tally = Tally::default();
        stats.iter().for_each(|stats| tally.add(stats));
        tally.notes()
    }
}

/// What notes need to know of frames that were composited, however many they are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    frames: usize,
    /// In so many depth hid nothing; the first of them, and why.
    hides_nothing: usize,
    first: Option<(usize, String)>,
    /// Objects may have been seen.
    shows: bool,
}

impl Tally {
    pub fn add(&mut self, stats: &FrameStats) {
        self.frames += 1;
        self.shows |= stats.objects_in_sight || stats.no_pose.is_some();
        if let Some(because) = &stats.no_occlusion {
            self.hides_nothing += 1;
            self.first.get_or_insert_with(|| (stats.frame, because.clone()));
        }
    }

    /// How many frames were added.
    pub fn frames(&self) -> usize {
        self.frames
    }

    pub fn notes(&self) -> Vec<Note> {
        let (number, frames) = (self.hides_nothing, self.frames);
        let hides_nothing =
            self.first.clone().map(|(first, because)| Note::NothingHides { number, frames, first, because });
        hides_nothing.into_iter().chain((!self.shows).then_some(Note::NothingSeen)).collect()
    }
}

impl Shot {
    /// Notes to show before a range of frames is composited as set.
    pub fn notes(&self, range: Range<usize>) -> Vec<Note> {
        let mut notes: Vec<_> = self.recording.warnings.iter().cloned().map(Note::Recording).collect();
        notes.extend(self.unfit_analysis());
        notes.extend(self.stale_estimates());
        notes.extend(self.recording.missing_poses(range).map(Note::MissingPoses));
        notes.extend(self.scene.warnings.iter().cloned().map(Note::Scene));
        let holds = self.recording.metres_per_unit;
        if let Some(of_scene) = self.scene.metres_per_unit.filter(|of_scene| *of_scene != holds) {
            notes.push(Note::OtherUnit { of_scene, holds });
        }
        notes.extend(self.unknown_exposure());
        let camera = self.camera();
        if camera.noise.is_none() && !self.is_plain() {
            notes.push(Note::UnknownNoise);
        }
        notes.extend(self.settings.idle(&camera).into_iter().map(Note::Idle));
        notes.extend(self.overlap_notes());
        notes
    }

    /// That there is an analysis, and why it is not used.
    pub fn unfit_analysis(&self) -> Option<Note> {
        match &self.analysis {
            AnalysisState::Unfit(folder, problem) => Some(Note::Analysis(folder.clone(), problem.clone())),
            _ => None,
        }
    }

    /// Estimates of the analysis in use that do not hold for the recording as it is now.
    pub fn stale_estimates(&self) -> Vec<Note> {
        let AnalysisState::Used(folder, findings) = &self.analysis else { return Vec::new() };
        let of_unit = (!self.has_light_of_its_unit()).then(|| {
            let (was, is) = (number(findings.made_with.metres_per_unit), number(self.recording.metres_per_unit));
            format!(
                "light left out, found with a unit of {was} m, which is {is} m now: analyse the recording again with \
                 --metres-per-unit {is}"
            )
        });
        findings.left_out.iter().cloned().chain(of_unit).map(|why| Note::StaleEstimates(folder.clone(), why)).collect()
    }

    /// Whether nothing says how long the frames were exposed, though it might matter.
    pub fn unknown_exposure(&self) -> Option<Note> {
        self.lacks_exposure().then(|| Note::UnknownExposure { has_times: self.recording.kind.has_times() })
    }

    /// Notes on objects that stand inside each other.
    pub fn overlap_notes(&self) -> Vec<Note> {
        let found = overlaps(&self.scene);
        let mut notes: Vec<_> =
            found.iter().take(MOST_OVERLAPS).map(|o| Note::Overlap(o.message(&self.scene))).collect();
        if found.len() > MOST_OVERLAPS {
            notes.push(Note::MoreOverlaps(found.len() - MOST_OVERLAPS));
        }
        notes
    }

    /// What stands wrong: inside something else, or, as a frame's depth shows, over or in the ground.
    pub fn wrongs(&self, frame: &Frame) -> Vec<Wrong> {
        let overlaps = overlaps(&self.scene).into_iter();
        let overlaps =
            overlaps.map(|o| Wrong { objects: o.objects.to_vec(), note: Note::Overlap(o.message(&self.scene)) });
        let sizes = self.scene.objects.iter().enumerate().filter_map(|(object, of)| {
            let note = Note::OddSize(size_warning(&self.scene, of)?);
            Some(Wrong { objects: vec![object], note })
        });
        let gaps = self.standing(frame).into_iter().filter_map(|Standing { object, gap_m }| {
            let (name, gap_m, frame) = (self.scene.objects[object].name.clone(), gap_m?, frame.index);
            Some(Wrong { objects: vec![object], note: Note::Gap { name, gap_m, frame } })
        });
        // Skip stand-ins: their size is not the model's.
        let is_known = |wrong: &Wrong| !wrong.objects.iter().any(|object| self.scene.objects[*object].is_missing);
        sizes.chain(overlaps).chain(gaps).filter(is_known).collect()
    }

    /// Notes on objects that hover or are sunk wherever they are seen: in the first frame of a range, the middle one and the
    /// last. Those frames are decoded; what cannot be read says nothing.
    pub fn standing_notes(&self, range: Range<usize>) -> Vec<Note> {
        if range.is_empty() || self.scene.objects.is_empty() || !self.recording.has_depth() {
            return Vec::new();
        }
        let mut frames = vec![range.start, range.start + range.len() / 2, range.end - 1];
        frames.dedup();
        let frames: Vec<Frame> = frames.into_iter().filter_map(|frame| self.read(frame).ok()).collect();
        let looked: Vec<_> = frames.iter().map(|frame| (frame.index, self.standing(frame))).collect();
        (0..self.scene.objects.len())
            .filter_map(|object| {
                let of = |standing: &[Standing]| standing.iter().find(|s| s.object == object).map(|s| s.gap_m);
                let seen: Vec<_> = looked.iter().filter_map(|(frame, all)| Some((*frame, of(all)?))).collect();
                let claimed: Option<Vec<_>> = seen.iter().map(|(frame, gap)| Some((*frame, (*gap)?))).collect();
                let claimed = claimed
                    .filter(|gaps| gaps.iter().all(|(_, gap)| *gap > 0.0) || gaps.iter().all(|(_, gap)| *gap < 0.0))?;
                let (frame, gap_m) = claimed.into_iter().min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
                Some(Note::Gap { name: self.scene.objects[object].name.clone(), gap_m, frame })
            })
            .collect()
    }
}
