//! Warnings that do not stop a run.

use std::fmt;
use std::ops::Range;

use super::Shot;
use crate::compositor::FrameStats;
use crate::words::count;

/// Something odd or unknown. Displays as a line for a person.
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// Warnings of the recording and the scene.
    Recording(String),
    Scene(String),
    /// Frames without a pose, which are passed through.
    MissingPoses(String),
    /// The frames' exposure is unknown. `has_times`: whether their times mean anything.
    UnknownExposure {
        has_times: bool,
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
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Recording(text) | Self::Scene(text) | Self::MissingPoses(text) => f.write_str(text),
            Self::Idle(text) => f.write_str(text),
            Self::UnknownExposure { has_times } => {
                f.write_str(match has_times {
                    true => "nothing says how long the frames were exposed: half the frame interval is taken",
                    false => "the pictures bear no times, so that nothing is blurred by motion",
                })?;
                f.write_str("; --set camera.exposure.time_s=SECONDS sets an exposure")
            }
            Self::UnknownNoise => f.write_str(
                "nothing says how noisy this camera is: objects are drawn without noise, and look too clean beside it; \
                 `locard calibrate noise` measures it from pictures of a scene at rest, with --moving from the recording \
                 itself",
            ),
            Self::NothingHides { number, frames, first, because } => {
                let of = format!("{number} of {}", count(*frames, "frame"));
                write!(f, "nothing real hides objects in {of}, though there is depth (frame {first}: {because})")
            }
            Self::NothingSeen => f.write_str(
                "no object of the scene is in the picture: `locard inspect RECORDING --frame N` says where the camera is \
                 and looks, `locard inspect SCENE` where the objects are",
            ),
        }
    }
}

impl Note {
    /// Notes on frames that were composited.
    pub fn of_frames(stats: &[FrameStats]) -> Vec<Self> {
        let mut notes = Vec::new();
        let mut lacking = stats.iter().filter_map(|s| Some((s.frame, s.no_occlusion.as_ref()?)));
        if let Some((first, because)) = lacking.next() {
            let (number, because) = (1 + lacking.count(), because.clone());
            notes.push(Self::NothingHides { number, frames: stats.len(), first, because });
        }
        if stats.iter().all(|s| !s.objects_in_sight && s.no_pose.is_none()) {
            notes.push(Self::NothingSeen);
        }
        notes
    }
}

impl Shot {
    /// Notes to show before a range of frames is composited as set.
    pub fn notes(&self, range: Range<usize>) -> Vec<Note> {
        let mut notes: Vec<_> = self.recording.warnings.iter().cloned().map(Note::Recording).collect();
        notes.extend(self.recording.missing_poses(range).map(Note::MissingPoses));
        notes.extend(self.scene.warnings.iter().cloned().map(Note::Scene));
        if self.lacks_exposure() {
            notes.push(Note::UnknownExposure { has_times: self.recording.kind.has_times() });
        }
        let camera = self.camera();
        if camera.noise.is_none() && !self.is_plain() {
            notes.push(Note::UnknownNoise);
        }
        notes.extend(self.settings.idle(&camera).into_iter().map(Note::Idle));
        notes
    }
}
