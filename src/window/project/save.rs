//! The files that keep a project. What is to be written is put together as plain values, so that another thread reads and
//! writes it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::kind::Kind;
use super::super::watch::{Stamp, stamp};
use super::kept::{ForProfile, ProfileScope};
use super::light::panorama_of_analysis;
use super::{Edit, Project, tables};
use locard_engine::analyse::panorama_beside;
use locard_engine::compositor::{ON, Settings};
use locard_engine::profile::{self, Look, ProfileError, Rig, ShotSettings};
use locard_engine::recording::Recording;
use locard_engine::scene::{self, SceneError, SceneFile};
use locard_engine::shot::Follows;
use locard_engine::sink::SinkError;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file::{self, MOST_DOCUMENT};

/// Why something was not saved.
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

/// A file that is to be written, as all is set at this moment.
#[derive(Debug)]
pub struct Draft {
    path: PathBuf,
    /// The file must still be so; `None`: it is written over whatever is there.
    known: Option<Stamp>,
    what: What,
}

#[derive(Debug)]
enum What {
    Profile(Box<ProfileDraft>),
    Scene(Box<SceneDraft>),
}

#[derive(Debug)]
struct ProfileDraft {
    recording: Arc<Recording>,
    /// What is set at this moment, and what the profile is to give.
    edit: Edit,
    by_profile: Edit,
    values: ForProfile,
    /// By an analysis, and not the camera's own.
    found: Vec<Follows>,
    from: Option<PathBuf>,
}

#[derive(Debug)]
struct SceneDraft {
    text: String,
    /// Without its settings, which stand beside it.
    scene: SceneFile,
    settings: ShotSettings,
    edit: Edit,
    from: PathBuf,
    panorama: Option<Panorama>,
}

/// An analysis' panorama that a scene is lit by, and where the scene has it for itself once it is saved.
#[derive(Debug)]
struct Panorama {
    from: PathBuf,
    to: PathBuf,
}

impl Panorama {
    /// Beside the scene's file, of its name. What lies there and is another panorama stays.
    fn of(scene: &SceneFile, file: &Path) -> Option<Self> {
        let from = panorama_of_analysis(scene, file)?;
        let to = panorama_beside(file);
        let stem = to.file_stem()?.to_string_lossy().into_owned();
        let others = (2..).map(|n| to.with_file_name(format!("{stem}-{n}.hdr")));
        let is_free = |to: &PathBuf| !to.exists() || read_panorama(to).ok() == read_panorama(&from).ok();
        let to = std::iter::once(to.clone()).chain(others).find(is_free)?;
        Some(Self { from, to })
    }

    /// Has a scene name its own, if it names the analysis'.
    fn put_into(&self, scene: &mut SceneFile, file: &Path) {
        if panorama_of_analysis(scene, file).as_ref() == Some(&self.from) {
            scene.light.environment = self.to.file_name().map(|name| name.to_string_lossy().into_owned());
        }
    }

    /// Gives the file where it was not there before.
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
    /// Larger is no analysis', bytes.
    const MOST: u64 = 1 << 22;
    file::read(path, MOST)
}

/// A file that has been written.
#[derive(Debug)]
pub struct Written {
    pub path: PathBuf,
    stamp: Stamp,
    what: What,
}

impl Written {
    /// What it is, in words.
    pub fn what(&self) -> &'static str {
        match self.what {
            What::Profile(_) => "profile",
            What::Scene(_) => "scene",
        }
    }
}

impl Draft {
    /// Refuses to be written over what another program has written since a file was looked at.
    pub fn unless_changed(self, known: Stamp) -> Self {
        Self { known: Some(known), ..self }
    }

    /// Writes the file: it is whole, or as it was.
    pub fn write(self) -> Result<Written, SaveError> {
        let Self { path, known, what } = self;
        if known.is_some_and(|known| stamp(&path) != known) {
            return Err(SaveError::Changed(path));
        }
        let text = match &what {
            What::Profile(draft) => {
                // A new file is a copy of the profile that is open.
                let from = draft.from.as_ref().filter(|from| !path.exists() && from.exists());
                profile_text(&draft.recording, &draft.by_profile, from.unwrap_or(&path), &draft.found)?
            }
            What::Scene(_) if belongs_to_another(&path) => {
                let reason = "the file is no scene, and is kept: choose another name".to_owned();
                return Err(SaveError::Text { path, reason });
            }
            What::Scene(draft) => draft.text.clone(),
        };
        let panorama = if let What::Scene(draft) = &what { draft.panorama.as_ref() } else { None };
        let made = panorama.map(Panorama::write).transpose()?.flatten();
        let written = write_atomically(&path, true, |writer| std::io::Write::write_all(writer, text.as_bytes()));
        written.inspect_err(|_| made.into_iter().for_each(|made| _ = std::fs::remove_file(made)))?;
        Ok(Written { stamp: stamp(&path), path, what })
    }
}

/// Whether a file that is there is no scene, but a profile or a recording's description.
fn belongs_to_another(path: &Path) -> bool {
    matches!(Kind::of(path), Kind::Recording | Kind::Profile) && scene::document::read(path).is_err()
}

/// What differs from the recording's own camera and from the profile's text is set in that text. Where the recording has no
/// camera, the text has all of one. Values that are as an analysis `found` them are left out.
fn profile_text(recording: &Recording, edit: &Edit, path: &Path, found: &[Follows]) -> Result<String, SaveError> {
    let (mut rig, mut settings) = (Rig::default(), Settings::default());
    if let Some(own) = &recording.camera_profile {
        rig.read(own, &mut settings)?;
    }
    if let Some(geometry) = &recording.geometry {
        rig.lay_over(geometry);
    }
    let mut document = match path.exists() {
        true => {
            let failed = |source| ProfileError::Read { path: path.to_owned(), source };
            let bytes = file::read(path, MOST_DOCUMENT).map_err(failed)?;
            let text = String::from_utf8(bytes).map_err(|_| SaveError::Text {
                path: path.to_owned(),
                reason: "the file is no text, so no profile: nothing was saved".to_owned(),
            })?;
            rig.read_text(&text, path, &mut settings)?;
            profile::Document::parse(&text, path)?
        }
        false => profile::Document::new(""),
    };
    // What is as it is by default makes the camera whole all the same.
    let whole = edit.rig.missing_keys().is_empty();
    for name in rig.missing_keys().into_iter().filter(|_| whole && edit.rig.gives_geometry()) {
        document.set_param(&edit.rig.intrinsics, name);
    }
    // A profile cannot say that its exposure overrides each frame's own.
    settings.overrule_recorded_exposure = edit.settings.overrule_recorded_exposure;
    let changes = ShotSettings::between(Look { rig: &rig, settings: &settings }, edit.look());
    for params in tables(&edit.rig, &edit.settings) {
        let table = params.table();
        for spec in params.specs().into_iter().filter(|spec| changes.has(table, spec.name)) {
            let is_here = |found: &&Follows| (found.table, found.name) == (table, spec.name);
            if found.iter().find(is_here).map(|found| &found.value) != params.get(spec.name).as_ref() {
                document.set_param(params, spec.name);
            }
        }
    }
    for effect in edit.settings.effects().map(|effect| effect.table()).filter(|effect| changes.has(effect, ON)) {
        document.switch(effect, edit.settings.is_on(effect));
    }
    match changes.noise() {
        Some(Some(noise)) => document.set_noise(noise, "`'s method, from places picked in the window."),
        Some(None) => document.remove_noise(),
        None => {}
    }
    Ok(document.to_string())
}

impl Project {
    /// Values to be written into a profile, whose comments and other keys stay. A new file is made
    /// where there is none.
    pub fn profile_draft(&self, path: &Path, scope: ProfileScope) -> Draft {
        let values = self.for_profile(scope);
        let draft = ProfileDraft {
            recording: Arc::clone(&self.shot.recording),
            edit: self.edit().clone(),
            by_profile: self.by_profile(&values),
            values,
            found: self.shot.baseline().found.clone(),
            from: self.profile.clone(),
        };
        Draft { path: path.to_owned(), known: None, what: What::Profile(Box::new(draft)) }
    }

    /// The whole camera and all settings as a profile's text, to be put together on another thread.
    pub fn profile_text(&self) -> impl FnOnce() -> Result<String, SaveError> + Send + 'static {
        let (recording, edit) = (Arc::clone(&self.shot.recording), self.edit().clone());
        let path = self.profile.clone().unwrap_or_default();
        move || profile_text(&recording, &edit, &path, &[])
    }

    /// The scene file, whose comments and order stay. In another folder it names the same models.
    pub fn scene_draft(&mut self, path: &Path) -> Result<Draft, SaveError> {
        let from = self.scene_path();
        let mut scene = moved(&self.edit().scene, &from, path);
        // Whoever wrote it into the file meant it.
        let panorama = Panorama::of(&scene, path)
            .filter(|_| scene.light.environment != moved(&self.saved.scene, &from, path).light.environment);
        if let Some(panorama) = &panorama {
            panorama.put_into(&mut scene, path);
        }
        let failed =
            |error: &dyn std::fmt::Display| SaveError::Text { path: path.to_owned(), reason: error.to_string() };
        let settings = self.file_settings(self.edit());
        let whole = SceneFile { settings: settings.to_toml(), ..scene.clone() };
        let text = match &mut self.scene_text {
            Some(text) => {
                text.set(whole).map_err(|e| failed(&e))?;
                text.to_string()
            }
            None => {
                let made = scene::Document::new(whole).map_err(|e| failed(&e))?;
                self.scene_text.insert(made).to_string()
            }
        };
        let draft = SceneDraft { text, scene, settings, edit: self.edit().clone(), from, panorama };
        Ok(Draft { path: path.to_owned(), known: None, what: What::Scene(Box::new(draft)) })
    }

    /// A draft has been written: from now on this is what is saved.
    pub fn written(&mut self, written: Written) {
        let Written { path, stamp, what } = written;
        self.stamps.insert(path.clone(), stamp);
        match what {
            What::Profile(draft) => {
                self.profile_took(&draft.values, &draft.edit);
                self.shot.profile_written(&path, &draft.values.of_opened);
                let own = self.shot_settings();
                self.shot.set_settings_of_scene(&own);
                self.profile = Some(path);
            }
            What::Scene(draft) => {
                let SceneDraft { scene, settings, edit, from, panorama, .. } = *draft;
                let named = self.loaded.file_names().map(str::to_owned).collect::<Vec<_>>();
                let follow = |scene: &mut SceneFile| {
                    *scene = moved(scene, &from, &path);
                    panorama.iter().for_each(|panorama| panorama.put_into(scene, &path));
                };
                self.history.each(|edit| follow(&mut edit.scene));
                [&mut self.opened.scene, &mut self.loaded].into_iter().for_each(follow);
                self.scene_took(settings, &edit);
                self.saved = Edit { scene, other: self.saved.other.take(), ..edit };
                self.move_missing(&from, &named, &path);
                self.scene = Some(path);
            }
        }
    }

    /// The scene file has moved: missing files are named as it names them now. `named` has the
    /// names that the file had.
    fn move_missing(&mut self, from: &Path, named: &[String], to: &Path) {
        if self.shot.scene.missing.is_empty() {
            return;
        }
        let beside = |file: &Path, name: &str| file.parent().unwrap_or(Path::new("")).join(name);
        for missing in &mut Arc::make_mut(&mut self.shot.scene).missing {
            let mut names = named.iter().zip(self.loaded.file_names());
            if let Some((_, now)) = names.find(|(before, _)| beside(from, before) == missing.file) {
                missing.file = beside(to, now);
            }
        }
    }

    /// Writes all that is set into a profile, and waits for it.
    pub fn save_profile(&mut self, path: &Path) -> Result<(), SaveError> {
        let written = self.profile_draft(path, ProfileScope::All).write()?;
        self.written(written);
        Ok(())
    }

    /// Writes the scene file, and waits for it.
    pub fn save_scene(&mut self, path: &Path) -> Result<(), SaveError> {
        let written = self.scene_draft(path)?.write()?;
        self.written(written);
        Ok(())
    }
}

/// A scene whose file moves: its models and its panorama are the same files.
fn moved(scene: &SceneFile, from: &Path, to: &Path) -> SceneFile {
    let folder = |path: &Path| std::path::absolute(path).ok().and_then(|path| Some(path.parent()?.to_owned()));
    let mut scene = scene.clone();
    let (Some(old), Some(new)) = (folder(from), folder(to)) else { return scene };
    if old != new {
        scene.file_names_mut().for_each(|name| *name = scene::relative(&old.join(&*name), to));
    }
    scene
}
