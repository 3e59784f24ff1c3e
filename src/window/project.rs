//! What a person edits: a shot's camera, settings and scene, as plain values with a past, and the files that keep them.

mod found;
mod kept;
mod light;
mod locate;
mod save;
mod scene;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::History;
use super::watch::{Stamp, stamp};
use locard_engine::camera::{Geometry, NoiseProfile};
use locard_engine::compositor::{ON, Settings};
use locard_engine::live::LiveFrom;
use locard_engine::params::{ParamError, Params, Value, called, title};
use locard_engine::profile::{Look, Rig, ShotSettings};
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::scene::{self as scenes, MissingModels, Models, SceneFile};
use locard_engine::shot::{Given, Shot, ShotError};
use locard_engine::tracking::PoseTrack;

pub use kept::ProfileScope;
pub use save::{Draft, SaveError, Written};

/// Everything that a change changes, and that undo brings back.
#[derive(Clone, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Edit {
    pub rig: Rig,
    pub settings: Settings,
    pub scene: SceneFile,
    /// What it is compared with.
    pub other: Option<Box<Other>>,
    /// Parameters, as `table.name`, that the scene's own settings no longer keep at a value that
    /// equals the profile's.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub unpinned: BTreeSet<String>,
}

/// Another camera and other settings, to compare with. One of the two is called A, and stands at the left.
#[derive(Clone, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Other {
    pub rig: Rig,
    pub settings: Settings,
    /// Whether this one is A, and B is edited.
    pub is_a: bool,
}

impl Edit {
    pub fn look(&self) -> Look<'_> {
        Look { rig: &self.rig, settings: &self.settings }
    }

    /// Whether the same would be saved.
    fn saves_like(&self, other: &Self) -> bool {
        self.rig == other.rig
            && self.settings == other.settings
            && self.scene == other.scene
            && self.unpinned == other.unpinned
    }
}

/// Where a parameter's value comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    Default,
    /// The recording or a profile.
    File,
    /// The scene's own settings, though a file or the default gives the same value.
    Scene,
    Person,
}

/// A shot with the past of its edits.
#[derive(Debug)]
pub struct Project {
    shot: Shot,
    history: History<Edit>,
    /// By the recording, the profiles and the analysis, without the scene's own settings.
    opened: Edit,
    saved: Edit,
    /// The settings that the scene file has, and whether it should have others.
    of_scene: ShotSettings,
    scene_is_stale: bool,
    /// Settings that the scene file had until they were unpinned: undo brings them back.
    unpinned: ShotSettings,
    /// Settings of the scene file that [`Given::sets`] overrides. The file keeps them.
    overridden: ShotSettings,
    /// As it is where nobody says anything.
    defaults: Edit,
    pub profile: Option<PathBuf>,
    pub scene: Option<PathBuf>,
    /// Of the recording, as it was opened.
    pub metres_per_unit: f64,
    /// Where its frames come from as long as the recording is still arriving.
    pub camera: Option<LiveFrom>,
    scene_text: Option<scenes::Document>,
    /// What the shot's scene was loaded from.
    loaded: SceneFile,
    /// Of the scenes so far.
    models: Models,
    /// Why the scene is not that of all that is set.
    problem: Option<String>,
    /// Grows with every change, so that it is known whether a picture is still what is set.
    version: u64,
    /// Grows with every change of what the scene consists of.
    scene_version: u64,
    /// The version at which what is compared with changed last, and what that is.
    other_version: u64,
    other: Option<Box<Other>>,
    /// How the files were when they were read or written.
    stamps: BTreeMap<PathBuf, Stamp>,
}

impl Project {
    /// Opens a recording and what is given with it, as [`Shot::open`].
    pub fn open(recording: &Path, options: &OpenOptions, given: &Given) -> Result<Self, ShotError> {
        let before = stamp(recording);
        let mut project = Self::of(Recording::open(recording, options)?, options.metres_per_unit, given)?;
        project.stamps.extend([recording.to_owned(), project.shot.recording.path.clone()].map(|path| (path, before)));
        Ok(project)
    }

    /// Like [`Project::open`], for a recording that is open.
    pub fn of(recording: Recording, metres_per_unit: f64, given: &Given) -> Result<Self, ShotError> {
        // Before they are read: what is changed in between is noticed.
        let files = [given.profile.as_deref(), given.scene.as_deref()].into_iter().flatten();
        let stamps: BTreeMap<_, _> = files.map(|path| (path.to_owned(), stamp(path))).collect();
        let shot = Shot::of(recording, &Given { missing_models: MissingModels::StandIn, ..given.clone() })?;
        // A model alone stands where its own coordinates put it, which no scene file can say.
        let is_file = |path: &&PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
        let scene_text = given.scene.as_ref().filter(is_file).map(|path| scenes::document::read(path)).transpose()?;
        let mut scene = scene_text.as_ref().map_or_else(SceneFile::default, |text| text.value().clone());
        // Settings are edited with camera and effects; `scene_draft` rebuilds this table.
        let of_scene = std::mem::take(&mut scene.settings);
        let of_scene = ShotSettings::read(&of_scene, given.scene.as_deref().unwrap_or(Path::new("")))?;
        let edit = Edit {
            rig: shot.rig.clone(),
            settings: shot.settings.clone(),
            scene,
            other: None,
            unpinned: BTreeSet::new(),
        };
        let baseline = shot.baseline();
        let opened = Edit { rig: baseline.rig.clone(), settings: baseline.settings.clone(), ..edit.clone() };
        Ok(Self {
            history: History::new(edit.clone()),
            opened,
            saved: edit.clone(),
            overridden: of_scene.overridden(edit.look()),
            of_scene,
            scene_is_stale: false,
            unpinned: ShotSettings::default(),
            defaults: Edit {
                rig: Rig::default(),
                settings: Settings::default(),
                scene: SceneFile::default(),
                other: None,
                unpinned: BTreeSet::new(),
            },
            profile: given.profile.clone(),
            scene: given.scene.clone(),
            metres_per_unit,
            camera: None,
            scene_text,
            loaded: edit.scene.clone(),
            models: Models::default(),
            problem: None,
            shot,
            version: 0,
            scene_version: 0,
            other_version: 0,
            other: None,
            stamps,
        })
    }

    /// How a file was before it was read, or after it was written; `None` for one that was not there.
    pub fn stamp(&self, path: &Path) -> Stamp {
        self.stamps.get(path).copied().flatten()
    }

    /// What is composited now.
    pub fn shot(&self) -> &Shot {
        &self.shot
    }

    pub fn edit(&self) -> &Edit {
        self.history.now()
    }

    /// Whether it stands on a camera's last seconds.
    pub fn is_frozen(&self) -> bool {
        self.camera.is_some() && !self.shot.recording.is_arriving()
    }

    /// A frame has come, with its camera and the poses that are known now ([`Recording::arrive`]).
    pub fn arrive(&mut self, frame: usize, timestamp_s: f64, track: PoseTrack, camera: Option<Geometry>) {
        Arc::make_mut(&mut self.shot.recording).arrive(frame, timestamp_s, track, camera);
    }

    /// Goes on with another recording by the same camera, in the same world.
    pub fn stand_on(&mut self, recording: Arc<Recording>) {
        self.stamps.insert(recording.path.clone(), stamp(&recording.path));
        self.shot.recording = recording;
        self.version += 1;
    }

    /// Each change gives another number.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// Each change of what is compared with gives another number.
    pub fn other_version(&self) -> u64 {
        self.other_version
    }

    /// Each change of the scene's models or light gives another number.
    pub fn scene_version(&self) -> u64 {
        self.scene_version
    }

    pub fn history(&self) -> &History<Edit> {
        &self.history
    }

    /// Why the picture is not that of all that is set.
    pub fn problem(&self) -> Option<&str> {
        self.problem.as_deref()
    }

    /// As the files say it.
    pub fn saved(&self) -> &Edit {
        &self.saved
    }

    pub fn is_saved(&self) -> bool {
        self.edit().saves_like(&self.saved) && !self.scene_is_stale
    }

    /// Like [`Project::is_saved`], without the uncommitted change.
    pub fn is_kept_saved(&self) -> bool {
        self.history.kept().saves_like(&self.saved) && !self.scene_is_stale
    }

    /// Whether the scene file lacks settings that have changed places with a profile's.
    pub fn scene_is_stale(&self) -> bool {
        self.scene_is_stale
    }

    /// Ends a drag: the next change is a step of its own.
    pub fn close_step(&mut self) {
        self.history.close();
    }

    /// Takes away the step of that name that is still open. Gives whether there was one.
    pub fn take_back(&mut self, what: &str) -> bool {
        let done = self.history.take_back(what);
        if done {
            self.follow();
        }
        done
    }

    /// Sets one parameter of the camera or of an effect.
    pub fn set(&mut self, table: &str, name: &str, value: &Value) -> Result<(), ParamError> {
        self.set_in(self.edit().clone(), table, name, value)
    }

    /// Sets one parameter, as [`Project::set`]. If the value equals the profile's, the scene's own
    /// settings no longer have it.
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
                return Err(ParamError::UnknownName { known: "no such table".to_owned(), table, name });
            }
        }
        if table == edit.rig.exposure.table() {
            // As with `--set`, an exposure that the user or the scene sets overrides each frame's own.
            let by_files = self.opened.settings.overrule_recorded_exposure;
            edit.settings.overrule_recorded_exposure = by_files;
            let is_set = self.settings_of(edit.look(), &edit.unpinned).has_table(table);
            edit.settings.overrule_recorded_exposure = by_files || is_set;
        }
        let changed = tables(&edit.rig, &edit.settings).into_iter().find(|params| params.table() == table);
        let what = changed.map_or_else(|| name.to_owned(), |params| called(params, name));
        self.change(&what, edit);
        Ok(())
    }

    /// Sets the camera's noise, as one step.
    pub fn set_noise(&mut self, noise: NoiseProfile) {
        let mut edit = self.edit().clone();
        edit.rig.noise = Some(noise);
        self.change("Camera: noise", edit);
        self.close_step();
    }

    /// Sets the camera's focal lengths, principal point and distortion, as one step.
    pub fn set_geometry(&mut self, geometry: &Geometry) {
        let mut edit = self.edit().clone();
        edit.rig.set_geometry(geometry);
        self.change("Camera: calibrated", edit);
        self.close_step();
    }

    /// A parameter's value.
    pub fn value(&self, table: &str, name: &str) -> Option<Value> {
        value(self.edit(), table, name)
    }

    /// Switches an effect on or off.
    pub fn switch(&mut self, effect: &str, on: bool) {
        let mut edit = self.edit().clone();
        if edit.settings.switch(effect, on).is_ok() {
            self.change(&format!("{}: {}", title(effect), if on { "on" } else { "off" }), edit);
            self.close_step();
        }
    }

    /// Switches an effect as the recording and the profile have it, and out of the scene's own
    /// settings, as one step.
    pub fn reset_switch(&mut self, effect: &str) -> Result<(), ParamError> {
        let on = self.opened.settings.is_on(effect);
        self.reset(effect, ON, &Value::Bool(on))?;
        self.close_step();
        Ok(())
    }

    /// Begins to compare what is set now (A) with the same that is changed from here on (B), or ends it; what is edited then
    /// stays.
    pub fn compare(&mut self, on: bool) {
        let mut edit = self.edit().clone();
        let copy = Other { rig: edit.rig.clone(), settings: edit.settings.clone(), is_a: true };
        edit.other = on.then(|| Box::new(copy));
        self.change(if on { "A and B compared" } else { "comparing ended" }, edit);
        self.close_step();
    }

    /// Edits the other one of A and B.
    pub fn exchange(&mut self) {
        let mut edit = self.edit().clone();
        let Some(other) = &mut edit.other else { return };
        std::mem::swap(&mut edit.rig, &mut other.rig);
        std::mem::swap(&mut edit.settings, &mut other.settings);
        other.is_a = !other.is_a;
        let what = if other.is_a { "B edited" } else { "A edited" };
        self.change(what, edit);
        self.close_step();
    }

    /// Makes the other one of A and B like the one that is edited.
    pub fn copy_to_other(&mut self) {
        let mut edit = self.edit().clone();
        let Some(other) = &mut edit.other else { return };
        (other.rig, other.settings) = (edit.rig.clone(), edit.settings.clone());
        let what = if other.is_a { "B copied to A" } else { "A copied to B" };
        self.change(what, edit);
        self.close_step();
    }

    /// What is compared with, as a shot.
    pub fn other_shot(&self) -> Option<Shot> {
        let other = self.edit().other.as_ref()?;
        let mut shot = self.shot.clone();
        (shot.rig, shot.settings) = (other.rig.clone(), other.settings.clone());
        let look = Look { rig: &other.rig, settings: &other.settings };
        shot.set_settings_of_scene(&self.settings_of(look, &self.edit().unpinned));
        Some(shot)
    }

    /// The value by the recording, the profiles and the analysis.
    pub fn opened(&self, table: &str, name: &str) -> Option<Value> {
        value(&self.opened, table, name)
    }

    pub fn origin(&self, table: &str, name: &str) -> Origin {
        let (now, opened) = (value(self.edit(), table, name), self.opened(table, name));
        if now != opened {
            Origin::Person
        } else if now != value(&self.defaults, table, name) {
            Origin::File
        } else {
            Origin::Default
        }
    }

    fn change(&mut self, what: &str, to: Edit) {
        self.history.change(what, to);
        self.follow();
    }

    /// Gives the name of what was taken back.
    pub fn undo(&mut self) -> Option<String> {
        let name = self.history.undo().map(str::to_owned);
        self.follow();
        name
    }

    pub fn redo(&mut self) -> Option<String> {
        let name = self.history.redo().map(str::to_owned);
        self.follow();
        name
    }

    /// Goes to a step of the history.
    pub fn go_to(&mut self, step: usize) {
        self.history.go_to(step);
        self.follow();
    }
}

/// A parameter as files and `--set` name it.
fn full_name(table: &str, name: &str) -> String {
    format!("{table}.{name}")
}

/// Every table of parameters, in the order of the light.
pub fn tables<'a>(rig: &'a Rig, settings: &'a Settings) -> Vec<&'a dyn Params> {
    rig.tables().into_iter().chain(settings.tables()).collect()
}

fn value(edit: &Edit, table: &str, name: &str) -> Option<Value> {
    tables(&edit.rig, &edit.settings).into_iter().find(|params| params.table() == table)?.get(name)
}
