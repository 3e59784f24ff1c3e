//! Opens a recording or a camera on a background thread, since the headers of all frames are read.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::obstacle::size_text;
use super::project::Project;
use super::recent::DocumentRef;
use super::recovery_search::RecoverableWork;
use super::task::BackgroundTask;
use super::unsaved_work::UnsavedWork;
use locard_engine::live::{self, LiveSpec};
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::shot::{ShotError, ShotOptions};
use locard_engine::text::without_options;
use locard_engine::webcam::CameraError;

/// An opened project, with its camera if it is live.
pub type OpenedProject = (Box<Project>, Option<live::LiveInput>);

/// Reason why nothing was opened.
#[derive(Debug)]
pub struct OpenRefusal {
    pub why: String,
    /// A profile with camera parameters is the remedy.
    pub lacks_camera: bool,
    /// The profile does not fit the recording.
    pub is_unfit_profile: bool,
}

impl OpenRefusal {
    fn plain(error: &dyn std::fmt::Display) -> Self {
        Self { why: without_options(&error.to_string()), lacks_camera: false, is_unfit_profile: false }
    }

    fn of_shot(recording: &Path, error: &ShotError) -> Self {
        let lacks_camera = matches!(error, ShotError::NoCamera { .. } | ShotError::IncompleteCamera { .. });
        let why = without_options(&error.to_string());
        // A scene's error names the scene.
        let is_scenes = matches!(error, ShotError::Scene(_));
        let why = if is_scenes { why } else { format!("{}: not opened: {why}", recording.display()) };
        Self { why, lacks_camera, is_unfit_profile: false }
    }

    /// Refuses a profile for another picture size than the recording's. If `has_camera`, also a
    /// profile without camera parameters, which would replace the current camera.
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
            Err(ShotError::NoCamera { .. } | ShotError::IncompleteCamera { .. }) if has_camera => format!(
                "{name} lacks the camera's focal length or principal point: it was not opened for {recording}, whose \
                 camera is known. Write them into its table [camera.intrinsics], or choose a profile that has them."
            ),
            _ => return Ok(()),
        };
        Err(Self { why, lacks_camera: false, is_unfit_profile: true })
    }
}

/// Result of opening.
#[derive(Debug)]
pub struct OpenResult {
    pub document: DocumentRef,
    pub project: Result<OpenedProject, OpenRefusal>,
    /// Autosaved work that was restored into the project.
    pub recoverable: Option<RecoverableWork>,
    /// The same files were reloaded.
    pub is_reload: bool,
}

/// An open operation in progress.
#[derive(Debug)]
pub struct DocumentOpening {
    document: DocumentRef,
    recoverable: Option<RecoverableWork>,
    is_reload: bool,
    task: BackgroundTask<Result<OpenedProject, OpenRefusal>>,
}

impl DocumentOpening {
    /// `wake` is called from the thread at the end. `left`: autosaved work to restore.
    /// `has_camera`: the same recording is open with known camera parameters.
    pub fn begin(
        document: DocumentRef,
        recoverable: Option<RecoverableWork>,
        has_camera: bool,
        wake: impl FnOnce() + Send + 'static,
    ) -> std::io::Result<Self> {
        Self::of(document, recoverable, has_camera, None, None, wake)
    }

    /// A recording in `open_already` is reused. `reload`: reloads the files, with the overrides of
    /// the command line; an unfit profile is accepted there, since undo reverts a reload.
    fn of(
        document: DocumentRef,
        recoverable: Option<RecoverableWork>,
        has_camera: bool,
        reload: Option<Vec<String>>,
        open_already: Option<Arc<Recording>>,
        wake: impl FnOnce() + Send + 'static,
    ) -> std::io::Result<Self> {
        let (request, is_reload, sets) = (document.clone(), reload.is_some(), reload.unwrap_or_default());
        let work = recoverable.as_ref().map(|recoverable| UnsavedWork::clone(&recoverable.work));
        let task = BackgroundTask::spawn("opening", wake, move || {
            let (mut project, camera) = match (&request.camera, open_already) {
                (_, Some(recording)) => (project_of(Recording::clone(&recording), &request, sets)?, None),
                (Some(from), None) => open_camera(&request, from)?,
                (None, None) => (open(&request, sets)?, None),
            };
            if let Some(UnsavedWork { edit, history, .. }) = work {
                project.restore(edit, history).map_err(|error| OpenRefusal::plain(&error))?;
            } else if let Some(profile) = request.profile.as_deref().filter(|_| !is_reload && request.camera.is_none())
            {
                OpenRefusal::unfit_profile(&project, profile, has_camera)?;
            }
            Ok((Box::new(project), camera))
        })?;
        Ok(Self { document, recoverable, is_reload, task })
    }

    /// Reloads the open files; a camera continues.
    pub fn reload(project: &Project, wake: impl FnOnce() + Send + 'static) -> std::io::Result<Self> {
        let recording = Some(&project.shot().recording).filter(|recording| recording.is_live()).cloned();
        Self::of(DocumentRef::of(project), None, false, Some(project.shot().sets().to_vec()), recording, wake)
    }

    /// True if autosaved work is restored.
    pub fn recovers(&self) -> bool {
        self.recoverable.is_some()
    }

    /// The recording that is opened.
    pub fn recording_path(&self) -> &Path {
        &self.document.recording
    }

    /// The result, once it exists.
    pub fn take(self) -> Result<OpenResult, Box<Self>> {
        let Some(project) = self.task.take() else { return Err(Box::new(self)) };
        let project = project
            .map_err(|why| OpenRefusal { why, lacks_camera: false, is_unfit_profile: false })
            .and_then(|project| project);
        Ok(OpenResult { document: self.document, project, recoverable: self.recoverable, is_reload: self.is_reload })
    }
}

/// Longest wait for a busy camera, which the previous view may still hold.
const BUSY_TIMEOUT: Duration = Duration::from_secs(1);

/// Opens a camera; it is not started.
fn open_camera(document: &DocumentRef, from: &LiveSpec) -> Result<(Project, Option<live::LiveInput>), OpenRefusal> {
    let profiled = document.profile.as_deref().map(|path| live::camera_of_profile(path, &from.poses)).transpose();
    let profiled = profiled.map_err(|error| OpenRefusal::plain(&error))?;
    let begun = Instant::now();
    let camera = loop {
        match live::open(from, profiled.as_ref()) {
            Err(live::LiveError::Camera(CameraError::Busy { .. })) if begun.elapsed() < BUSY_TIMEOUT => {
                std::thread::sleep(Duration::from_millis(50));
            }
            other => {
                break other.map_err(|error| {
                    let lacks_camera = matches!(error, live::LiveError::NoCamera);
                    let why = format!("{}: not opened: {}", from.name(), without_options(&error.to_string()));
                    OpenRefusal { why, lacks_camera, is_unfit_profile: false }
                })?;
            }
        }
    };
    Ok((project_of(camera.recording(), document, Vec::new())?, Some(camera)))
}

/// A project of a camera's recording, with profile, overrides and scene.
fn project_of(recording: Recording, document: &DocumentRef, sets: Vec<String>) -> Result<Project, OpenRefusal> {
    let shot_options = ShotOptions {
        profile: document.profile.clone(),
        sets,
        scene: document.scene.clone(),
        ..ShotOptions::default()
    };
    let mut project =
        Project::of(recording, &shot_options).map_err(|error| OpenRefusal::of_shot(&document.recording, &error))?;
    project.camera.clone_from(&document.camera);
    Ok(project)
}

/// Opens a recording. Missing profile and scene files are created when saved.
fn open(document: &DocumentRef, sets: Vec<String>) -> Result<Project, OpenRefusal> {
    let there = |path: &Option<std::path::PathBuf>| path.clone().filter(|path| path.exists());
    let shot_options = ShotOptions {
        profile: there(&document.profile),
        sets,
        scene: there(&document.scene),
        ..ShotOptions::default()
    };
    let options = OpenOptions { metres_per_unit: document.metres_per_unit, ..OpenOptions::default() };
    let project = Project::open(&document.recording, &options, &shot_options);
    let mut project = project.map_err(|error| OpenRefusal::of_shot(&document.recording, &error))?;
    project.profile.clone_from(&document.profile);
    Ok(project)
}
