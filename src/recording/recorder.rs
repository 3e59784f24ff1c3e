//! Writes a recording in Locard's own format while frames arrive.
//!
//! Pictures are files; their list lines, and those of poses and exposures, are committed together:
//! at once for the first frame, then at least every half second of the frames' time. A frame with
//! incomplete data is held back. A line is written after everything it references is on disk, so a
//! killed program or a power cut costs that half second, and leaves at most one line without an
//! end, which the reader drops. If the disk is full, the recording ends with the last frame whose
//! line fits.

use std::io;
use std::path::{Path, PathBuf};

use glam::DVec3;

pub use super::folder::{Folder, List, Store};

use super::folder::PICTURES;
use super::write::{
    self, CameraFile, Covariance, Description, ExposureList, FILE_NAME, FrameFiles, Line, LiveMetadata, PoseFile,
};
use super::{FrameCamera, RecordingError, listing};
use crate::frame::FrameExposure;
use crate::text::reason;

/// Interval of commits in the frames' time, seconds.
const COMMIT_INTERVAL_S: f64 = 0.5;
/// Maximum number of uncommitted frames, whatever their times.
const MAX_PENDING_FRAMES: usize = 64;

const PROFILE: &str = "camera.toml";

/// Metadata of a recording before its first frame.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingInfo {
    /// Nominal frame interval, seconds.
    pub interval_s: f64,
    /// Maximum interval across which poses are interpolated, seconds.
    pub max_gap_s: f64,
    pub up: Option<DVec3>,
    /// True if the plane through the world's origin, perpendicular to `up`, is a surface.
    pub has_floor: bool,
    pub camera: Option<String>,
    pub delivered: Option<String>,
    /// True if every frame has an exposure, false if none has.
    pub has_exposure: bool,
    /// True if frames may have individual cameras and lenses.
    pub has_cameras: bool,
    /// The camera's profile, as text.
    pub profile: Option<String>,
}

/// Errors that end a recording.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    #[error("{}: exists already, and is kept; name a new folder", path.display())]
    Exists { path: PathBuf },
    #[error("{}: cannot be written: {}", path.display(), reason(source))]
    Write { path: PathBuf, source: io::Error },
    #[error("the frame at {time_s} s does not come after the one before it")]
    Backwards { time_s: f64 },
    #[error("the recording has ended: its disk was full")]
    Ended,
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// A frame whose picture is written, but not its list line.
#[derive(Clone, Debug)]
struct PendingFrame {
    time_s: f64,
    name: String,
    exposure_s: Option<f64>,
    /// `None` until it is set.
    opacity: Option<f64>,
    camera: Option<FrameCamera>,
}

/// A recording in progress. Dropping it commits its contents.
#[derive(Debug)]
pub struct Recorder<S: Store> {
    store: S,
    path: PathBuf,
    frames: usize,
    last_s: f64,
    pending: Vec<PendingFrame>,
    /// True once a frame's line is written.
    has_frames: bool,
    /// Content of `recording.toml`.
    description: String,
    has_exposure: bool,
    has_cameras: bool,
    poses: Vec<Line>,
    covariances: Vec<Covariance>,
    /// True once the list of covariances is not empty.
    has_covariances: bool,
    failed: bool,
}

impl Recorder<Folder> {
    /// Creates a recording in a new or empty folder.
    pub fn create(path: &Path, about: &RecordingInfo) -> Result<Self, RecorderError> {
        let failed = |source| RecorderError::Write { path: path.to_owned(), source };
        if std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some()) || path.is_file() {
            return Err(RecorderError::Exists { path: path.to_owned() });
        }
        let was_there = path.is_dir();
        let begun = std::fs::create_dir_all(path.join(PICTURES)).and_then(|()| Folder::new(path)).map_err(failed);
        let begun = begun.and_then(|folder| Self::begin(folder, path, about));
        if begun.is_err() {
            discard(path, was_there);
        }
        begun
    }
}

/// Removes the files of a recording without frames; a folder that existed before is kept.
/// Recordings, and other files, are not touched.
pub fn discard(path: &Path, was_there: bool) {
    if path.join(FILE_NAME).exists() {
        return;
    }
    for name in List::ALL.map(List::file_name).into_iter().chain([PROFILE]) {
        let _ = std::fs::remove_file(path.join(name));
    }
    // Including pictures of frames that were never listed.
    let pictures = std::fs::read_dir(path.join(PICTURES)).into_iter().flatten().flatten();
    pictures.for_each(|picture| _ = std::fs::remove_file(picture.path()));
    // Fails on folders that are not empty.
    let _ = std::fs::remove_dir(path.join(PICTURES));
    if !was_there {
        let _ = std::fs::remove_dir(path);
    }
}

impl<S: Store> Recorder<S> {
    /// Begins a recording; `path` is for error messages. The description is written after the first
    /// frame, so a folder with a description can always be opened.
    pub fn begin(mut store: S, path: &Path, about: &RecordingInfo) -> Result<Self, RecorderError> {
        let failed = |source| RecorderError::Write { path: path.to_owned(), source };
        let description = write::description(about.description())?.to_string();
        let mut begin = || -> io::Result<()> {
            let [frames, poses, exposures, cameras] = lists(&[], &[], false)?;
            store.append([&poses, &exposures, "", if about.has_cameras { &cameras } else { "" }, &frames])?;
            if let Some(profile) = &about.profile {
                store.file(Path::new(PROFILE), profile.as_bytes())?;
            }
            store.sync()?;
            store.sync()
        };
        begin().map_err(failed)?;
        Ok(Self {
            store,
            path: path.to_owned(),
            frames: 0,
            last_s: f64::NEG_INFINITY,
            pending: Vec::new(),
            has_frames: false,
            description,
            has_exposure: about.has_exposure,
            has_cameras: about.has_cameras,
            poses: Vec::new(),
            covariances: Vec::new(),
            has_covariances: false,
            failed: false,
        })
    }

    /// Number of written pictures.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Adds a frame by its encoded picture: a PNG or a JPEG, by its extension. Times ascend. Its
    /// opacity ([`crate::frame::Frame::opacity`]) may be [set](Self::set_opacity) later. After
    /// an error nothing more is written, and earlier frames are kept.
    pub fn frame(
        &mut self,
        time_s: f64,
        ending: &str,
        bytes: &[u8],
        exposure_s: Option<f64>,
        opacity: Option<f64>,
    ) -> Result<(), RecorderError> {
        if self.failed {
            return Err(RecorderError::Ended);
        }
        if time_s.is_nan() || time_s <= self.last_s {
            return Err(RecorderError::Backwards { time_s });
        }
        let name = format!("{PICTURES}/{:06}.{ending}", self.frames);
        if let Err(source) = self.store.file(Path::new(&name), bytes) {
            self.make_room();
            return Err(RecorderError::Write { path: self.path.join(name), source });
        }
        self.last_s = time_s;
        self.frames += 1;
        self.pending.push(PendingFrame { time_s, name, exposure_s, opacity, camera: None });
        self.commit_if_due()
    }

    /// Sets the opacity of the pending frame with this time, if there is one.
    pub fn set_opacity(&mut self, time_s: f64, opacity: f64) -> Result<(), RecorderError> {
        if let Some(pending) = self.pending.iter_mut().find(|pending| pending.time_s == time_s) {
            pending.opacity.get_or_insert(opacity);
        }
        self.commit_if_due()
    }

    /// Sets the camera of the pending frame with this time. It is listed if
    /// [`RecordingInfo::has_cameras`].
    pub fn camera(&mut self, time_s: f64, camera: FrameCamera) {
        if let Some(pending) = self.pending.iter_mut().find(|pending| pending.time_s == time_s) {
            pending.camera = Some(camera);
        }
    }

    fn commit_if_due(&mut self) -> Result<(), RecorderError> {
        let complete_count = self.complete_count();
        let Some((first, last)) = complete_count.checked_sub(1).map(|last| (&self.pending[0], &self.pending[last]))
        else {
            return Ok(());
        };
        let is_due =
            !self.has_frames || last.time_s - first.time_s >= COMMIT_INTERVAL_S || complete_count >= MAX_PENDING_FRAMES;
        if is_due { self.commit() } else { Ok(()) }
    }

    /// Number of pending frames before the first incomplete one.
    fn complete_count(&self) -> usize {
        self.pending.iter().take_while(|pending| pending.opacity.is_some()).count()
    }

    /// Adds a pose. The caller ensures ascending times.
    pub fn pose(&mut self, line: Line) {
        self.poses.push(line);
    }

    /// Adds the covariance of a pose; the list is created with the first one.
    pub fn covariance(&mut self, covariance: Covariance) {
        self.covariances.push(covariance);
    }

    /// Commits everything, except incomplete frames.
    pub fn commit(&mut self) -> Result<(), RecorderError> {
        if self.failed {
            return Ok(());
        }
        let complete_count = self.complete_count();
        if let Err(source) = self.write(complete_count) {
            self.make_room();
            return Err(RecorderError::Write { path: self.path.clone(), source });
        }
        if complete_count > 0 && !self.has_frames {
            let described = self.store.file(Path::new(FILE_NAME), self.description.as_bytes());
            if let Err(source) = described.and_then(|()| self.store.sync()) {
                self.failed = true;
                return Err(RecorderError::Write { path: self.path.join(FILE_NAME), source });
            }
        }
        self.pending.drain(..complete_count);
        self.poses.clear();
        self.has_covariances |= !self.covariances.is_empty();
        self.covariances.clear();
        self.has_frames |= complete_count > 0;
        Ok(())
    }

    /// Writes the lines of a number of frames, and of all poses.
    fn write(&mut self, frames: usize) -> io::Result<()> {
        // A list begins with its header line.
        let lists = lists(&self.pending[..frames], &self.poses, self.has_exposure)?;
        let [frames, poses, exposures, cameras] =
            lists.each_ref().map(|text| text.split_once('\n').map_or("", |(_, lines)| lines));
        let covariances = match self.covariances.as_slice() {
            [] => String::new(),
            some => write::covariances(some, !self.has_covariances),
        };
        self.store.sync()?;
        let cameras = if self.has_cameras { cameras } else { "" };
        self.store.append([poses, exposures, &covariances, cameras, frames])
    }

    /// Ends a recording on a full disk: the last pictures, and incomplete frames, are removed until
    /// the lines fit.
    fn make_room(&mut self) {
        self.failed = true;
        let complete_count = self.complete_count();
        while self.pending.len() > complete_count || self.write(self.pending.len()).is_err() {
            let Some(PendingFrame { name, .. }) = self.pending.pop() else { return };
            self.frames -= 1;
            let _ = self.store.remove(Path::new(&name));
        }
        self.pending.clear();
        self.poses.clear();
    }

    /// Ends the recording, and returns its number of frames. Missing data of incomplete frames is
    /// omitted.
    pub fn finish(mut self) -> Result<usize, RecorderError> {
        self.end()?;
        Ok(self.frames)
    }

    fn end(&mut self) -> Result<(), RecorderError> {
        self.pending.iter_mut().for_each(|pending| _ = pending.opacity.get_or_insert(1.0));
        self.commit()
    }
}

impl<S: Store> Drop for Recorder<S> {
    fn drop(&mut self) {
        let _ = self.end();
    }
}

/// Content of the first lists, with their headers.
fn lists(frames: &[PendingFrame], poses: &[Line], has_exposure: bool) -> io::Result<[String; 4]> {
    let listed = frames.iter().map(|pending| (pending.time_s, pending.name.as_str(), pending.opacity.unwrap_or(1.0)));
    let listed = listing::write_frames(listed).map_err(io::Error::other)?;
    let exposure = |pending: &PendingFrame| {
        let exposure = FrameExposure { time_s: pending.exposure_s, ..FrameExposure::default() };
        (pending.time_s, exposure)
    };
    let exposures: Vec<_> = frames.iter().filter(|_| has_exposure).map(exposure).collect();
    let cameras = write::cameras(frames.iter().filter_map(|pending| Some((pending.time_s, pending.camera.as_ref()?))));
    Ok([listed, write::trajectory(poses), write::exposures(&exposures), cameras])
}

impl RecordingInfo {
    fn description(&self) -> Description {
        let file = |list: List| PathBuf::from(list.file_name());
        Description {
            version: 1,
            name: None,
            up: self.up.map(|up| up.to_array()),
            floor: self.has_floor && self.up.is_some(),
            frames: FrameFiles { list: Some(file(List::Frames)), ..FrameFiles::default() },
            poses: PoseFile {
                trajectory: Some(file(List::Poses)),
                max_gap_s: Some(self.max_gap_s),
                ..PoseFile::default()
            },
            depth: None,
            exposure: self.has_exposure.then(|| ExposureList { list: file(List::Exposure) }),
            camera: (self.profile.is_some() || self.has_cameras).then(|| CameraFile {
                profile: self.profile.as_ref().map(|_| PROFILE.into()),
                kind: None,
                list: self.has_cameras.then(|| file(List::Cameras)),
            }),
            live: Some(LiveMetadata {
                interval_s: self.interval_s,
                camera: self.camera.clone(),
                delivered: self.delivered.clone(),
            }),
        }
    }
}
