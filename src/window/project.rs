//! The edited state of a shot (camera, settings and scene) with its undo history, and the files
//! that store it.

mod analysis;
mod light;
mod locate;
mod save;
mod save_targets;
mod scan;
mod scene;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::History;
use super::file_watch::{WatchStamp, stamp};
use locard_engine::camera::{Geometry, NoiseProfile};
use locard_engine::compositor::{ON, Settings};
use locard_engine::live::LiveSpec;
use locard_engine::params::{ParamError, Params, Value, called, title};
use locard_engine::profile::{ParameterValues, Rig, ShotSettings};
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::scene::{self as scenes, LoadedModels, MissingModels, SceneFile};
use locard_engine::shot::{ResolvedSettings, Shot, ShotError, ShotOptions};
use locard_engine::tracking::PoseTrack;

pub use save::{Draft, SaveError, WrittenFile};
pub use save_targets::ProfileScope;
pub use scan::PlacedScan;

/// The state that edits change and undo restores.
#[derive(Clone, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Edit {
    pub rig: Rig,
    pub settings: Settings,
    pub scene: SceneFile,
    /// The A/B comparison variant.
    pub other: Option<Box<ComparisonVariant>>,
    /// Parameters, as `table.name`, that the scene's own settings no longer pin to a value equal to
    /// the profile's.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub unpinned: BTreeSet<String>,
}

/// The variant of an A/B comparison: another camera and other settings. A is shown on the left.
#[derive(Clone, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct ComparisonVariant {
    pub rig: Rig,
    pub settings: Settings,
    /// True if the variant is A and B is edited.
    pub is_a: bool,
}

impl Edit {
    pub fn look(&self) -> ParameterValues<'_> {
        ParameterValues { rig: &self.rig, settings: &self.settings }
    }

    /// True if saving both writes the same values.
    fn has_same_saved_values(&self, other: &Self) -> bool {
        self.rig == other.rig
            && self.settings == other.settings
            && self.scene == other.scene
            && self.unpinned == other.unpinned
    }
}

/// Source of a parameter's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    Default,
    /// The recording or a profile.
    File,
    /// Pinned by the scene's own settings, although a file or the default has the same value.
    Scene,
    User,
}

/// A shot with the history of its edits.
#[derive(Debug)]
pub struct Project {
    shot: Shot,
    history: History<Edit>,
    /// Values by the recording, the profiles and the analysis, without the scene's own settings.
    baseline: ResolvedSettings,
    saved: Edit,
    /// Settings in the scene file, and whether they are out of date.
    scene_settings: ShotSettings,
    scene_is_stale: bool,
    /// Settings that were in the scene file until they were unpinned; undo restores them.
    unpinned: ShotSettings,
    /// Settings of the scene file that [`ShotOptions::sets`] overrides. They remain in the file.
    overridden: ShotSettings,
    /// Values without any file.
    defaults: ResolvedSettings,
    pub profile: Option<PathBuf>,
    pub scene: Option<PathBuf>,
    /// Source of the frames while the recording is still arriving.
    pub camera: Option<LiveSpec>,
    scene_text: Option<scenes::Document>,
    /// The description that the shot's scene was loaded from.
    loaded_scene: SceneFile,
    /// All models loaded so far.
    models: LoadedModels,
    /// Why the shot's scene differs from the edited one.
    problem: Option<String>,
    /// Increases with every change; identifies the content of a picture.
    version: u64,
    /// Increases with every change of the scene's content.
    scene_version: u64,
    /// The version of the last change of the variant, and the variant at that version.
    variant_version: u64,
    last_variant: Option<Box<ComparisonVariant>>,
    /// State of the files when they were last read or written.
    stamps: BTreeMap<PathBuf, WatchStamp>,
}

impl Project {
    /// Opens a recording with the given files, as [`Shot::open`].
    pub fn open(recording: &Path, options: &OpenOptions, shot_options: &ShotOptions) -> Result<Self, ShotError> {
        let before = stamp(recording);
        let mut project = Self::of(Recording::open(recording, options)?, shot_options)?;
        project.stamps.extend([recording.to_owned(), project.shot.recording.path.clone()].map(|path| (path, before)));
        Ok(project)
    }

    /// Like [`Project::open`], for a recording that is already open.
    pub fn of(recording: Recording, options: &ShotOptions) -> Result<Self, ShotError> {
        // Taken before reading, so that a change in between is noticed.
        let files = [options.profile.as_deref(), options.scene.as_deref()].into_iter().flatten();
        let stamps: BTreeMap<_, _> = files.map(|path| (path.to_owned(), stamp(path))).collect();
        let shot = Shot::of(recording, &ShotOptions { missing_models: MissingModels::StandIn, ..options.clone() })?;
        // A model that is opened alone keeps its own coordinates, which no scene file can express.
        let is_file = |path: &&PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
        let scene_text = options.scene.as_ref().filter(is_file).map(|path| scenes::document::read(path)).transpose()?;
        let mut scene = scene_text.as_ref().map_or_else(SceneFile::default, |text| text.value().clone());
        // Settings are edited with the camera and effects; `scene_draft` rebuilds this table.
        let scene_settings = std::mem::take(&mut scene.settings);
        let scene_settings = ShotSettings::read(&scene_settings, options.scene.as_deref().unwrap_or(Path::new("")))?;
        let edit = Edit {
            rig: shot.rig.clone(),
            settings: shot.settings.clone(),
            scene,
            other: None,
            unpinned: BTreeSet::new(),
        };
        Ok(Self {
            history: History::new(edit.clone()),
            baseline: shot.baseline()?,
            saved: edit.clone(),
            overridden: scene_settings.overridden(edit.look()),
            scene_settings,
            scene_is_stale: false,
            unpinned: ShotSettings::default(),
            defaults: ResolvedSettings::default(),
            profile: options.profile.clone(),
            scene: options.scene.clone(),
            camera: None,
            scene_text,
            loaded_scene: edit.scene.clone(),
            models: LoadedModels::default(),
            problem: None,
            shot,
            version: 0,
            scene_version: 0,
            variant_version: 0,
            last_variant: None,
            stamps,
        })
    }

    /// State of a file before it was read or after it was written; `None` if it did not exist.
    pub fn stamp(&self, path: &Path) -> WatchStamp {
        self.stamps.get(path).copied().flatten()
    }

    /// The shot to composite.
    pub fn shot(&self) -> &Shot {
        &self.shot
    }

    pub fn edit(&self) -> &Edit {
        self.history.current()
    }

    /// True for the frozen last seconds of a camera.
    pub fn is_frozen(&self) -> bool {
        self.camera.is_some() && !self.shot.recording.is_live()
    }

    /// Adds a frame with its camera, and updates the poses known so far
    /// ([`Recording::push_live_frame`]).
    pub fn arrive(&mut self, frame: usize, timestamp_s: f64, track: PoseTrack, camera: Option<Geometry>) {
        Arc::make_mut(&mut self.shot.recording).push_live_frame(frame, timestamp_s, track, camera);
    }

    /// Continues with another recording by the same camera in the same world.
    pub fn replace_recording(&mut self, recording: Arc<Recording>) {
        self.stamps.insert(recording.path.clone(), stamp(&recording.path));
        self.shot.recording = recording;
        self.version += 1;
    }

    /// Changes with every edit.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// Changes with every change of the variant.
    pub fn variant_version(&self) -> u64 {
        self.variant_version
    }

    /// Changes with the scene's models or light.
    pub fn scene_version(&self) -> u64 {
        self.scene_version
    }

    pub fn history(&self) -> &History<Edit> {
        &self.history
    }

    /// Why the picture does not show the current state.
    pub fn problem(&self) -> Option<&str> {
        self.problem.as_deref()
    }

    /// The state in the files.
    pub fn saved(&self) -> &Edit {
        &self.saved
    }

    pub fn is_saved(&self) -> bool {
        self.edit().has_same_saved_values(&self.saved) && !self.scene_is_stale
    }

    /// Like [`Project::is_saved`], without the uncommitted change.
    pub fn is_committed_saved(&self) -> bool {
        self.history.committed().has_same_saved_values(&self.saved) && !self.scene_is_stale
    }

    /// True if the settings in the scene file are out of date since a profile was written.
    pub fn scene_is_stale(&self) -> bool {
        self.scene_is_stale
    }

    /// Ends a drag: the next change is a new history step.
    pub fn close_step(&mut self) {
        self.history.close();
    }

    /// Removes the open history step of that name. Returns false if there is none.
    pub fn remove_open_step(&mut self, what: &str) -> bool {
        let done = self.history.remove_open_step(what);
        if done {
            self.update_shot();
        }
        done
    }

    /// Sets a parameter of the camera or an effect.
    pub fn set(&mut self, table: &str, name: &str, value: &Value) -> Result<(), ParamError> {
        self.set_in(self.edit().clone(), table, name, value)
    }

    /// Like [`Project::set`]. If the value equals the profile's, it is removed from the scene's own
    /// settings.
    pub fn reset(&mut self, table: &str, name: &str, value: &Value) -> Result<(), ParamError> {
        let mut edit = self.edit().clone();
        if self.is_pinned(table, name) {
            edit.unpinned.insert(full_name(table, name));
        }
        self.set_in(edit, table, name, value)
    }

    fn set_in(&mut self, mut edit: Edit, table: &str, name: &str, value: &Value) -> Result<(), ParamError> {
        match edit.rig.set(&mut edit.settings, table, name, value) {
            Some(done) => done?,
            None => {
                let (table, name) = (table.to_owned(), name.to_owned());
                return Err(ParamError::UnknownName { names: "no such table".to_owned(), table, name });
            }
        }
        if table == edit.rig.exposure.table() {
            // As with `--set`, an exposure that the user or the scene sets overrides each frame's
            // own.
            let by_files = self.baseline.settings.overrule_recorded_exposure;
            edit.settings.overrule_recorded_exposure = by_files;
            let is_set = self.settings_of(edit.look(), &edit.unpinned).has_table(table);
            edit.settings.overrule_recorded_exposure = by_files || is_set;
        }
        let changed = tables(&edit.rig, &edit.settings).into_iter().find(|params| params.table() == table);
        let what = changed.map_or_else(|| name.to_owned(), |params| called(params, name));
        self.change(&what, edit);
        Ok(())
    }

    /// Sets the camera's noise in one step.
    pub fn set_noise(&mut self, noise: NoiseProfile) {
        let mut edit = self.edit().clone();
        edit.rig.noise = Some(noise);
        self.change("Camera: noise", edit);
        self.close_step();
    }

    /// Sets the camera's focal lengths, principal point and distortion in one step.
    pub fn set_geometry(&mut self, geometry: &Geometry) {
        let mut edit = self.edit().clone();
        edit.rig.set_geometry(geometry);
        self.change("Camera: calibrated", edit);
        self.close_step();
    }

    /// Value of a parameter.
    pub fn value(&self, table: &str, name: &str) -> Option<Value> {
        value(self.edit().look(), table, name)
    }

    /// Switches an effect on or off.
    pub fn switch(&mut self, effect: &str, on: bool) {
        let mut edit = self.edit().clone();
        if edit.settings.switch(effect, on).is_ok() {
            self.change(&format!("{}: {}", title(effect), if on { "on" } else { "off" }), edit);
            self.close_step();
        }
    }

    /// Resets an effect's switch to the recording's and profile's state, and removes it from the
    /// scene's own settings, in one step.
    pub fn reset_switch(&mut self, effect: &str) -> Result<(), ParamError> {
        let on = self.baseline.settings.is_on(effect);
        self.reset(effect, ON, &Value::Bool(on))?;
        self.close_step();
        Ok(())
    }

    /// Starts an A/B comparison with the current state as A and B edited from here on, or ends it
    /// and keeps the edited state.
    pub fn compare(&mut self, on: bool) {
        let mut edit = self.edit().clone();
        let copy = ComparisonVariant { rig: edit.rig.clone(), settings: edit.settings.clone(), is_a: true };
        edit.other = on.then(|| Box::new(copy));
        self.change(if on { "A and B compared" } else { "comparing ended" }, edit);
        self.close_step();
    }

    /// Exchanges the edited state and the variant.
    pub fn swap_variant(&mut self) {
        let mut edit = self.edit().clone();
        let Some(other) = &mut edit.other else { return };
        std::mem::swap(&mut edit.rig, &mut other.rig);
        std::mem::swap(&mut edit.settings, &mut other.settings);
        other.is_a = !other.is_a;
        let what = if other.is_a { "B edited" } else { "A edited" };
        self.change(what, edit);
        self.close_step();
    }

    /// Copies the edited state to the variant.
    pub fn copy_to_other(&mut self) {
        let mut edit = self.edit().clone();
        let Some(other) = &mut edit.other else { return };
        (other.rig, other.settings) = (edit.rig.clone(), edit.settings.clone());
        let what = if other.is_a { "B copied to A" } else { "A copied to B" };
        self.change(what, edit);
        self.close_step();
    }

    /// The shot of the variant.
    pub fn variant_shot(&self) -> Option<Shot> {
        let other = self.edit().other.as_ref()?;
        let mut shot = self.shot.clone();
        (shot.rig, shot.settings) = (other.rig.clone(), other.settings.clone());
        let look = ParameterValues { rig: &other.rig, settings: &other.settings };
        shot.set_settings_of_scene(&self.settings_of(look, &self.edit().unpinned));
        Some(shot)
    }

    /// The value by the recording, the profiles and the analysis.
    pub fn baseline_value(&self, table: &str, name: &str) -> Option<Value> {
        value(self.baseline.values(), table, name)
    }

    pub fn origin(&self, table: &str, name: &str) -> Origin {
        let (now, opened) = (self.value(table, name), self.baseline_value(table, name));
        if now != opened {
            Origin::User
        } else if now != value(self.defaults.values(), table, name) {
            Origin::File
        } else {
            Origin::Default
        }
    }

    fn change(&mut self, what: &str, to: Edit) {
        self.history.change(what, to);
        self.update_shot();
    }

    /// Returns the name of the undone step.
    pub fn undo(&mut self) -> Option<String> {
        let name = self.history.undo().map(str::to_owned);
        self.update_shot();
        name
    }

    pub fn redo(&mut self) -> Option<String> {
        let name = self.history.redo().map(str::to_owned);
        self.update_shot();
        name
    }

    /// Moves to a step of the history.
    pub fn go_to(&mut self, step: usize) {
        self.history.go_to(step);
        self.update_shot();
    }
}

/// A parameter's name in files and for `--set`.
fn full_name(table: &str, name: &str) -> String {
    format!("{table}.{name}")
}

/// All parameter tables, in the order of the light path.
pub fn tables<'a>(rig: &'a Rig, settings: &'a Settings) -> Vec<&'a dyn Params> {
    rig.tables().into_iter().chain(settings.tables()).collect()
}

fn value(of: ParameterValues<'_>, table: &str, name: &str) -> Option<Value> {
    tables(of.rig, of.settings).into_iter().find(|params| params.table() == table)?.get(name)
}
