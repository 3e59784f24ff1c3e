//! Writes a recording of our own format while it is seen.
//!
//! Pictures are files; their lines, the poses' and the exposures' follow together: at once for the first, then at least
//! every half second of the frames' time. A frame of which something is still to be told waits for it. A line is written after what it names is on the disk, so that a program that is killed and a power cut
//! cost that half second, and leave at most one line without an end, which the reader drops. If the disk is full, the
//! recording ends with the last frame whose line finds room.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::write::{self, CameraFile, Description, ExposureList, FILE_NAME, FrameFiles, Line, LiveFacts, PoseFile};
use super::{RecordingError, listing};
use crate::frame::FrameExposure;
use crate::words::reason;

/// Lines follow their pictures after so much of the frames' time, seconds.
const HELD_S: f64 = 0.5;
/// And after so many pictures, whatever their times say.
const MOST_HELD: usize = 64;

const PICTURES: &str = "frames";
const PROFILE: &str = "camera.toml";

/// The lists of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum List {
    Frames,
    Poses,
    Exposure,
}

impl List {
    pub const ALL: [Self; 3] = [Self::Frames, Self::Poses, Self::Exposure];

    pub fn file_name(self) -> &'static str {
        match self {
            Self::Frames => "frames.txt",
            Self::Poses => "poses.txt",
            Self::Exposure => "exposure.txt",
        }
    }
}

/// What is known of a recording before its first frame.
#[derive(Clone, Debug, PartialEq)]
pub struct About {
    /// From a frame to the next, seconds.
    pub interval_s: f64,
    /// Longest interval across which poses are interpolated, seconds.
    pub max_gap_s: f64,
    pub up: Option<DVec3>,
    /// Whether the plane through the world's origin, across `up`, is a surface.
    pub has_floor: bool,
    pub camera: Option<String>,
    pub delivered: Option<String>,
    /// Whether every frame has an exposure, else none.
    pub has_exposure: bool,
    /// The camera's profile, as text.
    pub profile: Option<String>,
}

/// Where a recording is written: a folder, or in a test one that is full.
pub trait Store {
    /// Writes a new file. What is left of one that fails is removed.
    fn file(&mut self, name: &Path, bytes: &[u8]) -> io::Result<()>;
    /// Removes a file that was written.
    fn remove(&mut self, name: &Path) -> io::Result<()>;
    /// Appends whole lines to each of [`List::ALL`], and returns once they are on the disk. If that fails, none of them
    /// is there.
    fn append(&mut self, lines: [&str; 3]) -> io::Result<()>;
    /// Returns once all files are on the disk.
    fn sync(&mut self) -> io::Result<()>;
}

/// Why a recording has ended.
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

/// A frame whose picture is written, and its line is not.
#[derive(Clone, Debug)]
struct Held {
    time_s: f64,
    name: String,
    exposure_s: Option<f64>,
    /// `None` until it is told.
    presence: Option<f64>,
}

/// A recording that is being written. Dropped, it keeps what it has.
#[derive(Debug)]
pub struct Recorder<S: Store> {
    store: S,
    path: PathBuf,
    frames: usize,
    last_s: f64,
    held: Vec<Held>,
    /// Whether a frame's line is written.
    has_frames: bool,
    has_exposure: bool,
    poses: Vec<Line>,
    failed: bool,
}

impl Recorder<Folder> {
    /// Begins a recording in a new or empty folder.
    pub fn create(path: &Path, about: &About) -> Result<Self, RecorderError> {
        let failed = |source| RecorderError::Write { path: path.to_owned(), source };
        if std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some()) || path.is_file() {
            return Err(RecorderError::Exists { path: path.to_owned() });
        }
        std::fs::create_dir_all(path.join(PICTURES)).map_err(failed)?;
        Self::begin(Folder::new(path).map_err(failed)?, path, about)
    }
}

impl<S: Store> Recorder<S> {
    /// Begins a recording; `path` is named in errors. The description comes last: without it there is no recording.
    pub fn begin(mut store: S, path: &Path, about: &About) -> Result<Self, RecorderError> {
        let failed = |source| RecorderError::Write { path: path.to_owned(), source };
        let description = write::description(about.description())?.to_string();
        let mut begin = || -> io::Result<()> {
            store.append(lists(&[], &[], false)?.each_ref().map(String::as_str))?;
            if let Some(profile) = &about.profile {
                store.file(Path::new(PROFILE), profile.as_bytes())?;
            }
            store.sync()?;
            store.file(Path::new(FILE_NAME), description.as_bytes())?;
            store.sync()
        };
        begin().map_err(failed)?;
        Ok(Self {
            store,
            path: path.to_owned(),
            frames: 0,
            last_s: f64::NEG_INFINITY,
            held: Vec::new(),
            has_frames: false,
            has_exposure: about.has_exposure,
            poses: Vec::new(),
            failed: false,
        })
    }

    /// Frames whose pictures were written.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Adds a frame by its picture's file: a PNG or a JPEG, by its ending. Times ascend. Its presence
    /// ([`crate::frame::Frame::presence`]) may be [told](Self::settle) later. After an error nothing is written any more,
    /// and the frames before it stay.
    pub fn frame(
        &mut self,
        time_s: f64,
        ending: &str,
        bytes: &[u8],
        exposure_s: Option<f64>,
        presence: Option<f64>,
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
        self.held.push(Held { time_s, name, exposure_s, presence });
        self.commit_if_due()
    }

    /// Tells the presence of the frame of a time, if it is one that waits for it.
    pub fn settle(&mut self, time_s: f64, presence: f64) -> Result<(), RecorderError> {
        if let Some(held) = self.held.iter_mut().find(|held| held.time_s == time_s) {
            held.presence.get_or_insert(presence);
        }
        self.commit_if_due()
    }

    fn commit_if_due(&mut self) -> Result<(), RecorderError> {
        let settled = self.settled();
        let Some((first, last)) = settled.checked_sub(1).map(|last| (&self.held[0], &self.held[last])) else {
            return Ok(());
        };
        let is_due = !self.has_frames || last.time_s - first.time_s >= HELD_S || settled >= MOST_HELD;
        if is_due { self.commit() } else { Ok(()) }
    }

    /// How many of the frames that are held wait for nothing.
    fn settled(&self) -> usize {
        self.held.iter().take_while(|held| held.presence.is_some()).count()
    }

    /// Adds a pose. Times ascend; the caller sees to it.
    pub fn pose(&mut self, line: Line) {
        self.poses.push(line);
    }

    /// Writes all that is held, except frames that wait for something.
    pub fn commit(&mut self) -> Result<(), RecorderError> {
        if self.failed {
            return Ok(());
        }
        let settled = self.settled();
        if let Err(source) = self.write(settled) {
            self.make_room();
            return Err(RecorderError::Write { path: self.path.clone(), source });
        }
        self.held.drain(..settled);
        self.poses.clear();
        self.has_frames |= settled > 0;
        Ok(())
    }

    /// Writes the lines of so many frames, and of all poses.
    fn write(&mut self, frames: usize) -> io::Result<()> {
        // A list's first line is its head.
        let lists = lists(&self.held[..frames], &self.poses, self.has_exposure)?;
        let lines = lists.each_ref().map(|text| text.split_once('\n').map_or("", |(_, lines)| lines));
        self.store.sync()?;
        self.store.append(lines)
    }

    /// Ends a recording on a full disk: what is held is written at the cost of its last pictures, if the lines find no
    /// room, and of those that wait for something.
    fn make_room(&mut self) {
        self.failed = true;
        let settled = self.settled();
        while self.held.len() > settled || self.write(self.held.len()).is_err() {
            let Some(Held { name, .. }) = self.held.pop() else { return };
            self.frames -= 1;
            let _ = self.store.remove(Path::new(&name));
        }
        self.held.clear();
        self.poses.clear();
    }

    /// Ends the recording, and says how many frames it has. Those that wait for something are as if nothing were to be said.
    pub fn finish(mut self) -> Result<usize, RecorderError> {
        self.end()?;
        Ok(self.frames)
    }

    fn end(&mut self) -> Result<(), RecorderError> {
        self.held.iter_mut().for_each(|held| _ = held.presence.get_or_insert(1.0));
        self.commit()
    }
}

impl<S: Store> Drop for Recorder<S> {
    fn drop(&mut self) {
        let _ = self.end();
    }
}

/// The texts of the lists, with their heads.
fn lists(frames: &[Held], poses: &[Line], has_exposure: bool) -> io::Result<[String; 3]> {
    let listed = frames.iter().map(|held| (held.time_s, held.name.as_str(), held.presence.unwrap_or(1.0)));
    let listed = listing::write_frames(listed).map_err(io::Error::other)?;
    let exposure = |held: &Held| {
        let exposure = FrameExposure { time_s: held.exposure_s, ..FrameExposure::default() };
        (held.time_s, exposure)
    };
    let exposures: Vec<_> = frames.iter().filter(|_| has_exposure).map(exposure).collect();
    Ok([listed, write::trajectory(poses), write::exposures(&exposures)])
}

impl About {
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
                time_offset_s: None,
                max_gap_s: Some(self.max_gap_s),
            },
            depth: None,
            exposure: self.has_exposure.then(|| ExposureList { list: file(List::Exposure) }),
            camera: self.profile.as_ref().map(|_| CameraFile { profile: Some(PROFILE.into()), kind: None }),
            live: Some(LiveFacts {
                interval_s: self.interval_s,
                camera: self.camera.clone(),
                delivered: self.delivered.clone(),
            }),
        }
    }
}

/// A folder on a disk.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    lists: [(File, u64); 3],
    unsynced: Vec<File>,
}

impl Folder {
    /// In a folder that exists.
    pub fn new(path: &Path) -> io::Result<Self> {
        let open = |list: List| File::create_new(path.join(list.file_name()));
        let [frames, poses, exposure] = List::ALL.map(open);
        let lists = [(frames?, 0), (poses?, 0), (exposure?, 0)];
        Ok(Self { path: path.to_owned(), lists, unsynced: Vec::new() })
    }
}

impl Store for Folder {
    fn file(&mut self, name: &Path, bytes: &[u8]) -> io::Result<()> {
        let path = self.path.join(name);
        let mut file = OpenOptions::new().write(true).create_new(true).open(&path)?;
        if let Err(error) = file.write_all(bytes) {
            drop(file);
            let _ = std::fs::remove_file(&path);
            return Err(error);
        }
        self.unsynced.push(file);
        Ok(())
    }

    fn remove(&mut self, name: &Path) -> io::Result<()> {
        std::fs::remove_file(self.path.join(name))
    }

    fn append(&mut self, lines: [&str; 3]) -> io::Result<()> {
        let written = self.lists.iter_mut().zip(lines).try_for_each(|((file, _), lines)| {
            file.write_all(lines.as_bytes())?;
            file.sync_data()
        });
        for ((file, length), lines) in self.lists.iter_mut().zip(lines) {
            if written.is_ok() {
                *length += lines.len() as u64;
            } else {
                file.set_len(*length)?;
                file.seek(SeekFrom::Start(*length))?;
            }
        }
        written
    }

    fn sync(&mut self) -> io::Result<()> {
        let has_new = !self.unsynced.is_empty();
        for file in self.unsynced.drain(..) {
            file.sync_data()?;
        }
        // The names of new files. Not every system can.
        if has_new && cfg!(unix) {
            for folder in [self.path.join(PICTURES), self.path.clone()] {
                File::open(folder)?.sync_all()?;
            }
        }
        Ok(())
    }
}
