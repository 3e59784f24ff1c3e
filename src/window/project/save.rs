//! The files that store a project. Drafts are plain values, so that another thread can read and
//! write the files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::file_kind::FileKind;
use super::super::file_watch::{WatchStamp, stamp};
use super::light::panorama_of_analysis;
use super::save_targets::{ProfileScope, ProfileValues};
use super::{Edit, Project, tables};
use locard_engine::analyse::panorama_beside;
use locard_engine::camera::NoiseProfile;
use locard_engine::compositor::{ON, Settings};
use locard_engine::profile::{self, ParameterValues, ProfileError, Rig, ShotSettings};
use locard_engine::recording::Recording;
use locard_engine::scene::{self, SceneError, SceneFile};
use locard_engine::shot::{EstimatedParam, ResolvedSettings};
use locard_engine::sink::SinkError;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};

/// Why saving failed.
#[derive(Debug, thiserror::Error)]
pub enum SaveError {
    #[error(transparent)]
    Profile(#[from] ProfileError),
    #[error(transparent)]
    Sink(#[from] SinkError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error("{}: {reason}", path.display())]
    Text { path: PathBuf, reason: String },
    #[error("{}: another program has changed it meanwhile", .0.display())]
    Changed(PathBuf),
}

/// A file to write, with the state at this moment.
#[derive(Debug)]
pub struct Draft {
    path: PathBuf,
    /// Required state of the file; with `None` it is overwritten in any state.
    expected_state: Option<WatchStamp>,
    content: DraftContent,
}

#[derive(Debug)]
enum DraftContent {
    Profile(Box<ProfileDraft>),
    Scene(Box<SceneDraft>),
}

#[derive(Debug)]
struct ProfileDraft {
    recording: Arc<Recording>,
    /// The state at this moment, and the values that the profile results in.
    edit: Edit,
    by_profile: ResolvedSettings,
    values: ProfileValues,
    /// Results of an analysis, which do not belong to the camera.
    estimates: Vec<EstimatedParam>,
    estimated_noise: Option<NoiseProfile>,
    from: Option<PathBuf>,
}

#[derive(Debug)]
struct SceneDraft {
    text: String,
    /// Without its settings, which are stored separately.
    scene: SceneFile,
    settings: ShotSettings,
    edit: Edit,
    from: PathBuf,
    panorama: Option<PanoramaCopy>,
}

/// The panorama of an analysis that lights the scene, and the copy that a saved scene refers to.
#[derive(Debug)]
struct PanoramaCopy {
    from: PathBuf,
    to: PathBuf,
}

impl PanoramaCopy {
    /// A file beside the scene file, named after it. A different panorama that already exists is
    /// not replaced.
    fn of(scene: &SceneFile, file: &Path) -> Option<Self> {
        let from = panorama_of_analysis(scene, file)?;
        let to = panorama_beside(file);
        let stem = to.file_stem()?.to_string_lossy().into_owned();
        let others = (2..).map(|n| to.with_file_name(format!("{stem}-{n}.hdr")));
        let is_free = |to: &PathBuf| !to.exists() || read_panorama(to).ok() == read_panorama(&from).ok();
        let to = std::iter::once(to.clone()).chain(others).find(is_free)?;
        Some(Self { from, to })
    }

    /// Makes a scene refer to the copy if it refers to the analysis' panorama.
    fn put_into(&self, scene: &mut SceneFile, file: &Path) {
        if panorama_of_analysis(scene, file).as_ref() == Some(&self.from) {
            scene.light.environment = self.to.file_name().map(|name| name.to_string_lossy().into_owned());
        }
    }

    /// Returns the file if it did not exist before.
    fn write(&self) -> Result<Option<&Path>, SaveError> {
        let failed = |error: std::io::Error| SaveError::Text {
            path: self.from.clone(),
            reason: format!("the panorama: {error}"),
        };
        let bytes = read_panorama(&self.from).map_err(failed)?;
        if self.to.exists() {
            return Ok(None);
        }
        write_atomically(&self.to, false, |writer| std::io::Write::write_all(writer, &bytes))?;
        Ok(Some(&self.to))
    }
}

fn read_panorama(path: &Path) -> std::io::Result<Vec<u8>> {
    /// Largest panorama of an analysis, bytes.
    const MAX_BYTES: u64 = 1 << 22;
    file::read(path, MAX_BYTES)
}

/// A file that has been written.
#[derive(Debug)]
pub struct WrittenFile {
    pub path: PathBuf,
    stamp: WatchStamp,
    content: DraftContent,
}

impl WrittenFile {
    /// Kind of file, for messages.
    pub fn kind(&self) -> &'static str {
        match self.content {
            DraftContent::Profile(_) => "profile",
            DraftContent::Scene(_) => "scene",
        }
    }
}

impl Draft {
    /// Refuses to overwrite changes by another program since the file was read.
    pub fn unless_changed(self, state: WatchStamp) -> Self {
        Self { expected_state: Some(state), ..self }
    }

    /// Writes the file completely, or leaves it as it was.
    pub fn write(self) -> Result<WrittenFile, SaveError> {
        let Self { path, expected_state: known, content } = self;
        if known.is_some_and(|known| stamp(&path) != known) {
            return Err(SaveError::Changed(path));
        }
        let text = match &content {
            DraftContent::Profile(draft) => {
                // A new file starts as a copy of the open profile.
                let from = draft.from.as_ref().filter(|from| !path.exists() && from.exists());
                profile_text(
                    &draft.recording,
                    draft.by_profile.values(),
                    ProfileFiles { from: from.unwrap_or(&path), to: &path },
                    &draft.estimates,
                    draft.estimated_noise.as_ref(),
                )?
            }
            DraftContent::Scene(_) if is_other_kind(&path) => {
                let reason = "the file is not a scene, and is kept: choose another name".to_owned();
                return Err(SaveError::Text { path, reason });
            }
            DraftContent::Scene(draft) => draft.text.clone(),
        };
        let panorama = if let DraftContent::Scene(draft) = &content { draft.panorama.as_ref() } else { None };
        let document = panorama.map(PanoramaCopy::write).transpose()?.flatten();
        let written = write_atomically(&path, true, |writer| std::io::Write::write_all(writer, text.as_bytes()));
        written.inspect_err(|_| document.into_iter().for_each(|document| _ = std::fs::remove_file(document)))?;
        Ok(WrittenFile { stamp: stamp(&path), path, content })
    }
}

/// True if an existing file is a profile or a recording's description instead of a scene.
fn is_other_kind(path: &Path) -> bool {
    matches!(FileKind::of(path), FileKind::Recording | FileKind::Profile) && scene::document::read(path).is_err()
}

/// The file whose text a profile starts from, and the file to which it is written.
#[derive(Clone, Copy, Debug)]
struct ProfileFiles<'a> {
    from: &'a Path,
    to: &'a Path,
}

/// Sets the values in the profile's text that differ from the recording's own camera and from that
/// text. For a recording without a camera the text includes a complete one. Values equal to those
/// `estimates` of an analysis are left out.
fn profile_text(
    recording: &Recording,
    now: ParameterValues<'_>,
    files: ProfileFiles<'_>,
    estimates: &[EstimatedParam],
    estimated_noise: Option<&NoiseProfile>,
) -> Result<String, SaveError> {
    let ProfileFiles { from: path, to } = files;
    let (mut rig, mut settings) = (Rig::default(), Settings::default());
    if let Some(own) = &recording.camera_profile {
        rig.read(own, &mut settings)?;
    }
    if let Some(geometry) = &recording.geometry {
        rig.lay_over(geometry);
    }
    let mut document = if path.exists() {
        let failed = |source| ProfileError::Read { path: path.to_owned(), source };
        let bytes = file::read(path, MAX_DOCUMENT_BYTES).map_err(failed)?;
        let text = String::from_utf8(bytes).map_err(|_| SaveError::Text {
            path: path.to_owned(),
            reason: "the file is not text, so it is not a profile: nothing was saved".to_owned(),
        })?;
        rig.read_text(&text, path, &mut settings)?;
        if path != to && profile::is_calibration(path, &text) {
            // The calibration of another program becomes a profile.
            let mut document = profile::ProfileFile::new("");
            rig.camera().geometry.iter().for_each(|geometry| document.set_geometry(geometry, ""));
            document
        } else {
            profile::ProfileFile::parse(&text, path)?
        }
    } else {
        profile::ProfileFile::new("")
    };
    document.relocate(path, to);
    // A complete camera also includes values equal to the default.
    let is_complete = now.rig.missing_keys().is_empty();
    for name in rig.missing_keys().into_iter().filter(|_| is_complete && now.rig.gives_geometry()) {
        document.set_param(&now.rig.intrinsics, name);
    }
    // A profile cannot express that its exposure overrides each frame's own.
    settings.overrule_recorded_exposure = now.settings.overrule_recorded_exposure;
    let changes = ShotSettings::between(ParameterValues { rig: &rig, settings: &settings }, now);
    for params in tables(now.rig, now.settings) {
        let table = params.table();
        for spec in params.specs().into_iter().filter(|spec| changes.has(table, spec.name)) {
            let is_same_param = |estimates: &&EstimatedParam| (estimates.table, estimates.name) == (table, spec.name);
            if estimates.iter().find(is_same_param).map(|estimates| &estimates.value) != params.get(spec.name).as_ref()
            {
                document.set_param(params, spec.name);
            }
        }
    }
    for effect in now.settings.effects().map(|effect| effect.table()).filter(|effect| changes.has(effect, ON)) {
        document.switch(effect, now.settings.is_on(effect));
    }
    match changes.noise() {
        // It stays the analysis's.
        Some(noise) if noise.is_some() && noise == estimated_noise => {}
        Some(Some(noise)) => document.set_noise(noise, "`'s method, from places picked in the window.", to),
        Some(None) => document.remove_noise(),
        None => {}
    }
    Ok(document.to_string())
}

impl Project {
    /// Values to write into a profile, whose comments and other keys stay. A missing file is
    /// created.
    pub fn profile_draft(&self, path: &Path, scope: ProfileScope) -> Draft {
        let values = self.profile_values(scope);
        let draft = ProfileDraft {
            recording: Arc::clone(&self.shot.recording),
            edit: self.edit().clone(),
            by_profile: self.by_profile(&values),
            values,
            estimates: self.shot.estimates(),
            estimated_noise: self.shot.estimated_noise().cloned(),
            from: self.profile.clone(),
        };
        Draft { path: path.to_owned(), expected_state: None, content: DraftContent::Profile(Box::new(draft)) }
    }

    /// Returns a function that formats the whole camera and all settings as a profile for the file
    /// `to`, for another thread.
    pub fn profile_text(&self, to: &Path) -> impl FnOnce() -> Result<String, SaveError> + Send + 'static {
        let (recording, edit) = (Arc::clone(&self.shot.recording), self.edit().clone());
        let path = self.profile.clone().unwrap_or_default();
        let to = to.to_owned();
        move || profile_text(&recording, edit.look(), ProfileFiles { from: &path, to: &to }, &[], None)
    }

    /// The scene file with its comments and order. In another folder it refers to the same models.
    pub fn scene_draft(&mut self, path: &Path) -> Result<Draft, SaveError> {
        let from = self.scene_path();
        let mut scene = relocated(&self.edit().scene, &from, path);
        // A panorama that the file already named is kept on purpose.
        let panorama = PanoramaCopy::of(&scene, path)
            .filter(|_| scene.light.environment != relocated(&self.saved.scene, &from, path).light.environment);
        if let Some(panorama) = &panorama {
            panorama.put_into(&mut scene, path);
        }
        let failed =
            |error: &dyn std::fmt::Display| SaveError::Text { path: path.to_owned(), reason: error.to_string() };
        let settings = self.file_settings(self.edit());
        let with_settings = SceneFile { settings: settings.to_toml(path), ..scene.clone() };
        let text = match &mut self.scene_text {
            Some(text) => {
                text.set(with_settings).map_err(|e| failed(&e))?;
                text.to_string()
            }
            None => {
                let document = scene::Document::new(with_settings).map_err(|e| failed(&e))?;
                self.scene_text.insert(document).to_string()
            }
        };
        let draft = SceneDraft { text, scene, settings, edit: self.edit().clone(), from, panorama };
        Ok(Draft { path: path.to_owned(), expected_state: None, content: DraftContent::Scene(Box::new(draft)) })
    }

    /// Marks a written draft as the saved state.
    pub fn written(&mut self, written: WrittenFile) {
        let WrittenFile { path, stamp, content } = written;
        self.stamps.insert(path.clone(), stamp);
        match content {
            DraftContent::Profile(draft) => {
                self.mark_profile_written(&draft.values, &draft.edit);
                self.shot.replace_profile(&path, &draft.values.from_baseline);
                let own = self.shot_settings();
                self.shot.set_settings_of_scene(&own);
                self.profile = Some(path);
            }
            DraftContent::Scene(draft) => {
                let SceneDraft { scene, settings, edit, from, panorama, .. } = *draft;
                let named = self.loaded_scene.file_names().map(str::to_owned).collect::<Vec<_>>();
                let relocate = |scene: &mut SceneFile| {
                    *scene = relocated(scene, &from, &path);
                    panorama.iter().for_each(|panorama| panorama.put_into(scene, &path));
                };
                self.history.change_all(|edit| relocate(&mut edit.scene));
                relocate(&mut self.loaded_scene);
                self.mark_scene_written(settings, &edit);
                self.saved = Edit { scene, other: self.saved.other.take(), ..edit };
                self.relocate_missing(&from, &named, &path);
                self.scene = Some(path);
            }
        }
    }

    /// Updates the names of missing files after the scene file has moved. `named` has the previous
    /// names.
    fn relocate_missing(&mut self, from: &Path, named: &[String], to: &Path) {
        if self.shot.scene.missing.is_empty() {
            return;
        }
        let sibling = |file: &Path, name: &str| file.parent().unwrap_or(Path::new("")).join(name);
        for missing in &mut Arc::make_mut(&mut self.shot.scene).missing {
            let mut names = named.iter().zip(self.loaded_scene.file_names());
            if let Some((_, now)) = names.find(|(before, _)| sibling(from, before) == missing.file) {
                missing.file = sibling(to, now);
            }
        }
    }

    /// Writes all values into a profile, synchronously.
    pub fn save_profile(&mut self, path: &Path) -> Result<(), SaveError> {
        let written = self.profile_draft(path, ProfileScope::All).write()?;
        self.written(written);
        Ok(())
    }

    /// Writes the scene file, synchronously.
    pub fn save_scene(&mut self, path: &Path) -> Result<(), SaveError> {
        let written = self.scene_draft(path)?.write()?;
        self.written(written);
        Ok(())
    }
}

/// A scene for a moved scene file, which refers to the same models and panorama.
fn relocated(scene: &SceneFile, from: &Path, to: &Path) -> SceneFile {
    let folder = |path: &Path| std::path::absolute(path).ok().and_then(|path| Some(path.parent()?.to_owned()));
    let mut scene = scene.clone();
    let (Some(old), Some(new)) = (folder(from), folder(to)) else { return scene };
    if old != new {
        scene.file_names_mut().for_each(|name| *name = scene::relative(&old.join(&*name), to));
    }
    scene
}
