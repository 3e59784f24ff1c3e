//! A recording that is being opened: on a thread of its own, since the headers of all its frames are read.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::autosave::{RecoverableWork, UnsavedWork};
use super::obstacle::size_text;
use super::project::Project;
use super::recent::DocumentRef;
use super::task::BackgroundTask;
use locard_engine::live::{self, LiveSpec};
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::shot::{Given, ShotError};
use locard_engine::text::without_options;
use locard_engine::webcam::CameraError;

/// A project, with the camera of which it is.
pub type Fresh = (Box<Project>, Option<live::LiveInput>);

/// Why nothing was opened.
#[derive(Debug)]
pub struct Refused {
    pub why: String,
    /// A profile says what is lacking.
    pub lacks_camera: bool,
    /// The profile does not fit the recording.
    pub is_unfit_profile: bool,
}

impl Refused {
    fn plain(error: &dyn std::fmt::Display) -> Self {
        Self { why: without_options(&error.to_string()), lacks_camera: false, is_unfit_profile: false }
    }

    fn of_shot(recording: &Path, error: &ShotError) -> Self {
        let lacks_camera = matches!(error, ShotError::NoCamera { .. } | ShotError::PartOfCamera { .. });
        let why = without_options(&error.to_string());
        // A scene's error names the scene.
        let is_scenes = matches!(error, ShotError::Scene(_));
        let why = if is_scenes { why } else { format!("{}: not opened: {why}", recording.display()) };
        Self { why, lacks_camera, is_unfit_profile: false }
    }

    /// Refuses a profile for pictures of another size than the recording's. Where `has_camera`, a profile without a camera
    /// would replace the camera that is open, and is refused too.
    fn unfit_profile(project: &Project, profile: &Path, has_camera: bool) -> Result<(), Self> {
        let name = profile.file_name().unwrap_or(profile.as_os_str()).to_string_lossy();
        let recording = &project.shot().recording.name;
        let why = match project.shot().geometry_at(0) {
            Err(ShotError::Size { camera, frames }) => {
                let (sizes, (width, height)) = (size_text(camera, frames), frames);
                format!(
                    "{sizes}: {name} was not opened for {recording}. Choose a profile for {width}x{height}, or calibrate \
                     this camera."
                )
            }
            Err(ShotError::NoCamera { .. } | ShotError::PartOfCamera { .. }) if has_camera => format!(
                "{name} lacks the camera's focal length or principal point: it was not opened for {recording}, whose \
                 camera is known. Write them into its table [camera.intrinsics], or choose a profile that has them."
            ),
            _ => return Ok(()),
        };
        Err(Self { why, lacks_camera: false, is_unfit_profile: true })
    }
}

/// What came of it.
#[derive(Debug)]
pub struct Done {
    pub document: DocumentRef,
    pub project: Result<Fresh, Refused>,
    /// Work that is taken up with it.
    pub recoverable: Option<RecoverableWork>,
    /// They are the files that are open.
    pub is_again: bool,
}

/// Something is being opened.
#[derive(Debug)]
pub struct Opening {
    document: DocumentRef,
    recoverable: Option<RecoverableWork>,
    is_again: bool,
    task: BackgroundTask<Result<Fresh, Refused>>,
}

impl Opening {
    /// `wake` is called from the thread when it is over. Work that was left goes into what is opened. `has_camera`: the same
    /// recording is open, and its camera is known.
    pub fn begin(
        document: DocumentRef,
        recoverable: Option<RecoverableWork>,
        has_camera: bool,
        wake: impl FnOnce() + Send + 'static,
    ) -> std::io::Result<Self> {
        Self::of(document, recoverable, has_camera, None, None, wake)
    }

    /// A recording that is open already is not opened again. `again` has the values that were given
    /// with files that are read again; undo reverts that, so an unfit profile is not refused
    /// there.
    fn of(
        document: DocumentRef,
        recoverable: Option<RecoverableWork>,
        has_camera: bool,
        again: Option<Vec<String>>,
        open_already: Option<Arc<Recording>>,
        wake: impl FnOnce() + Send + 'static,
    ) -> std::io::Result<Self> {
        let (wanted, is_again, sets) = (document.clone(), again.is_some(), again.unwrap_or_default());
        let work = recoverable.as_ref().map(|recoverable| UnsavedWork::clone(&recoverable.work));
        let task = BackgroundTask::spawn("opening", wake, move || {
            let (mut project, camera) = match (&wanted.camera, open_already) {
                (_, Some(recording)) => (put_to(Recording::clone(&recording), &wanted, sets)?, None),
                (Some(from), None) => open_camera(&wanted, from)?,
                (None, None) => (open(&wanted, sets)?, None),
            };
            if let Some(UnsavedWork { edit, history, .. }) = work {
                project.restore(edit, history).map_err(|error| Refused::plain(&error))?;
            } else if let Some(profile) = wanted.profile.as_deref().filter(|_| !is_again && wanted.camera.is_none()) {
                Refused::unfit_profile(&project, profile, has_camera)?;
            }
            Ok((Box::new(project), camera))
        })?;
        Ok(Self { document, recoverable, is_again, task })
    }

    /// Reads the files that are open again; a camera goes on.
    pub fn again(project: &Project, wake: impl FnOnce() + Send + 'static) -> std::io::Result<Self> {
        let recording = Some(&project.shot().recording).filter(|recording| recording.is_arriving()).cloned();
        Self::of(DocumentRef::of(project), None, false, Some(project.shot().sets().to_vec()), recording, wake)
    }

    /// Whether work that was left goes into it.
    pub fn recovers(&self) -> bool {
        self.recoverable.is_some()
    }

    pub fn what(&self) -> &Path {
        &self.document.recording
    }

    /// What came of it, once it is there.
    pub fn take(self) -> Result<Done, Box<Self>> {
        let Some(project) = self.task.take() else { return Err(Box::new(self)) };
        let project = project
            .map_err(|why| Refused { why, lacks_camera: false, is_unfit_profile: false })
            .and_then(|project| project);
        Ok(Done { document: self.document, project, recoverable: self.recoverable, is_again: self.is_again })
    }
}

/// A camera that was shown until now may need so long to be free.
const PATIENCE: Duration = Duration::from_secs(1);

/// Opens a camera; it is not started.
fn open_camera(document: &DocumentRef, from: &LiveSpec) -> Result<(Project, Option<live::LiveInput>), Refused> {
    let profiled = document.profile.as_deref().map(|path| live::camera_of_profile(path, &from.poses)).transpose();
    let profiled = profiled.map_err(|error| Refused::plain(&error))?;
    let begun = Instant::now();
    let camera = loop {
        match live::open(from, profiled.as_ref()) {
            Err(live::LiveError::Camera(CameraError::Busy { .. })) if begun.elapsed() < PATIENCE => {
                std::thread::sleep(Duration::from_millis(50));
            }
            other => {
                break other.map_err(|error| {
                    let lacks_camera = matches!(error, live::LiveError::NoCamera);
                    let why = format!("{}: not opened: {}", from.name(), without_options(&error.to_string()));
                    Refused { why, lacks_camera, is_unfit_profile: false }
                })?;
            }
        }
    };
    Ok((put_to(camera.recording(), document, Vec::new())?, Some(camera)))
}

/// A camera's recording with what is put to it.
fn put_to(recording: Recording, document: &DocumentRef, sets: Vec<String>) -> Result<Project, Refused> {
    let given = Given { profile: document.profile.clone(), sets, scene: document.scene.clone(), ..Given::default() };
    let mut project =
        Project::of(recording, 1.0, &given).map_err(|error| Refused::of_shot(&document.recording, &error))?;
    project.camera.clone_from(&document.camera);
    Ok(project)
}

/// Opens what is there. A profile that is not there is one that will be made.
fn open(document: &DocumentRef, sets: Vec<String>) -> Result<Project, Refused> {
    let there = |path: &Option<std::path::PathBuf>| path.clone().filter(|path| path.exists());
    let given = Given { profile: there(&document.profile), sets, scene: there(&document.scene), ..Given::default() };
    let options = OpenOptions { metres_per_unit: document.metres_per_unit, ..OpenOptions::default() };
    let project = Project::open(&document.recording, &options, &given);
    let mut project = project.map_err(|error| Refused::of_shot(&document.recording, &error))?;
    project.profile.clone_from(&document.profile);
    Ok(project)
}
