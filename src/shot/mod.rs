//! Footage with what is put into it: a recording, its camera, a scene and settings, held together.
//!
//! A [`Shot`] is used alike by the program, a window and a test. Its camera (`rig`) and `settings` may change between
//! two pictures, and the next one follows; nothing is read again. The GPU is the caller's: [`Shot::compositor`].

mod analysed;
mod analysing;
mod baseline;
mod check;
mod error;
mod eye;
mod facets;
mod floors;
mod given;
mod grounds;
mod light;
mod lit;
mod moved;
mod note;
mod outline;
mod pick;
mod planes;
mod points;
mod preview;
mod radiance;
mod reduced;
mod room_planes;
mod room_points;
mod seen;
mod standing;
mod stream;
mod surface;
mod tilt;
mod triangulate;
mod upright;
mod white;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::camera::{Camera, CameraExposure, Geometry, Lens};
use crate::compositor::{Compositor, Settings};
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::profile::{Rig, ShotSettings};
use crate::recording::{OpenOptions, Recording, RecordingError};
use crate::scene::{self, Gauge, Lighting, Scene};

pub use analysed::{AnalysisState, Follows};
use analysed::{LoadedAnalysis, Sources, follows};
pub use analysing::AnalyseError;
pub use baseline::Baseline;
pub use error::ShotError;
pub use eye::{Eye, Ray};
use floors::Floors;
pub use given::{Analysed, Given};
pub use light::{Known, SceneLight, USUAL_ISO};
pub use note::{Note, Tally, Wrong};
pub use pick::{Hit, nearest};
pub use points::{FittedPlane, metres_per_unit, plane_through};
pub use reduced::Reduced;
pub use seen::SeenObject;
pub use standing::Standing;
pub use stream::Composites;
pub use surface::{Surface, SurfaceError};
pub use tilt::Tilt;
pub use triangulate::{Triangulated, View};
pub use white::{FACTORS, ReferencePick, White, WhiteError};

/// A recording with its camera, what is put into it, and how. Cheap to clone: what is large is shared.
#[derive(Clone, Debug)]
pub struct Shot {
    pub recording: Arc<Recording>,
    /// Before an analysis, a scene's unit or its gauge changed it.
    recorded: Arc<Recording>,
    /// The camera from profiles and settings. For each frame it overrides the recording's own ([`Shot::geometry_at`]).
    pub rig: Rig,
    pub settings: Settings,
    /// Drawn by compositors made from it ([`Shot::compositor`]). Another one comes by [`Shot::set_scene`]. They follow its objects' placement; for other changes
    /// call [`Compositor::set_scene`].
    pub scene: Arc<Scene>,
    /// The scene's light as it was given, before the footage lit it.
    given_light: Lighting,
    /// The light of the room, by an analysis of the footage.
    found_light: Option<Arc<Lighting>>,
    /// The profiles that were read, and `Given::sets`.
    profiles: Vec<PathBuf>,
    sets: Vec<String>,
    /// The camera by profiles, and by the scene's settings and `Given::sets` alone: for a frame's
    /// exposure they have different ranks ([`Shot::taken`]).
    by_profile: Rig,
    by_sets: Rig,
    baseline: Arc<Baseline>,
    /// The recording's unit as it was opened, metres: 1 if nobody said it.
    opened_unit_m: f64,
    /// Whether an analysis of the footage is used, or why not.
    pub analysis: AnalysisState,
    /// The frame of the last picture, as recorded: usually the next one's too.
    held: Option<Arc<Frame>>,
    /// What the objects stand on.
    floors: Arc<Floors>,
}

impl Shot {
    /// Opens a recording and what is given with it. Only the headers of the frames' files are read.
    pub fn open(recording: &Path, options: &OpenOptions, given: &Given) -> Result<Self, ShotError> {
        Self::of(Recording::open(recording, options)?, given)
    }

    /// Like [`Shot::open`], for a recording that is open.
    ///
    /// Depth from a camera of its own comes into the picture of the camera as it is now: it stays there when `rig` is
    /// changed later.
    pub fn of(mut recording: Recording, given: &Given) -> Result<Self, ShotError> {
        let (mut rig, mut settings) = (Rig::default(), Settings::default());
        let profiles: Vec<_> = recording.camera_profile.iter().chain(&given.profile).cloned().collect();
        let of_recording = recording.camera_profile.iter().len();
        // What a stream says of a lens is measured now, a profile once; a profile that is named for a recording is meant to
        // override it.
        let yield_at = if recording.is_arriving() { profiles.len() } else { of_recording };
        for (at, profile) in profiles.iter().enumerate() {
            if at == yield_at && recording.frames_say_cameras() {
                rig.follow_frames();
            }
            rig.read(profile, &mut settings)?;
        }
        if yield_at == profiles.len() && recording.frames_say_cameras() {
            rig.follow_frames();
        }
        if let Some(geometry) = &recording.geometry {
            rig.lay_over(geometry);
        }
        let by_profile = rig.clone();
        let mut baseline = Baseline { rig: rig.clone(), settings: settings.clone(), found: Vec::new() };
        let scene_file = given.scene.as_deref().unwrap_or(Path::new(""));
        let of_scene = ShotSettings::read(&scene::document::settings(scene_file)?, scene_file)?;
        of_scene.apply(&mut rig, &mut settings, scene_file)?;
        for text in &given.sets {
            rig.set_text(text, &mut settings)?;
            baseline.rig.set_text(text, &mut baseline.settings)?;
        }
        let recorded = Arc::new(recording.clone());
        let scene = match &given.scene {
            Some(path) => scene::load_with(path, recording.up, given.missing_models)?,
            None => Scene::default(),
        };
        let opened_unit_m = recording.metres_per_unit;
        // Estimates depend on the unit.
        recording.rescale(unit_m(&scene, opened_unit_m));
        let LoadedAnalysis { state, light: found_light, analysis } = analysed::take(&mut recording, &rig, given)?;
        if let Some(analysis) = &analysis {
            let all = Sources { profiles: &profiles, of_scene: &of_scene, scene: scene_file, sets: &given.sets };
            Follows::apply(&follows(analysis, all)?, &mut rig, &mut settings);
            baseline.follow(follows(analysis, Sources { of_scene: &ShotSettings::default(), ..all })?);
        }
        recording.set_cameras(|own| rig.geometry_over(own));
        let (recording, scene) = (Arc::new(recording), Arc::new(scene));
        let mut shot = Self {
            recording,
            recorded,
            rig,
            settings,
            given_light: scene.lighting.clone(),
            scene,
            found_light,
            profiles,
            sets: given.sets.clone(),
            by_sets: by_profile.clone(),
            by_profile,
            baseline: Arc::new(baseline),
            opened_unit_m,
            analysis: state,
            held: None,
            floors: Arc::default(),
        };
        shot.set_settings_of_scene(&of_scene);
        shot.follow_scene();
        Ok(shot)
    }

    /// Has the scene's own settings rank above what was recorded of a frame's exposure
    /// ([`Shot::taken`]). `rig` and `settings` stay as they are.
    pub fn set_settings_of_scene(&mut self, of_scene: &ShotSettings) {
        let mut by_sets = self.by_profile.clone();
        by_sets.lens = Lens::default();
        by_sets.exposure = CameraExposure::default();
        let mut unused = Settings::default();
        // All of it was accepted before.
        let _ = of_scene.apply(&mut by_sets, &mut unused, Path::new(""));
        for text in &self.sets {
            let _ = by_sets.set_text(text, &mut unused);
        }
        self.by_sets = by_sets;
    }

    /// A profile with these values has been written, in place of the one that was given.
    pub fn profile_written(&mut self, profile: &Path, values: &ShotSettings) {
        let own = self.recording.camera_profile.iter().cloned();
        self.profiles = own.chain([profile.to_owned()]).collect();
        // They were accepted when they were set.
        let _ = values.apply(&mut self.by_profile, &mut Settings::default(), profile);
    }

    /// Takes over what another shot of the same recording has read from files and settings: its
    /// profiles, the values that were set, and the baseline. Recording, scene and camera stay.
    pub fn take_files(&mut self, fresh: Self) {
        let Self { profiles, sets, by_profile, by_sets, baseline, .. } = fresh;
        (self.profiles, self.sets, self.baseline) = (profiles, sets, baseline);
        (self.by_profile, self.by_sets) = (by_profile, by_sets);
    }

    /// Values that were given as text and override all files ([`Given::sets`]).
    pub fn sets(&self) -> &[String] {
        &self.sets
    }

    /// Puts another scene into the footage. If it says how long the recording's unit is, or where its camera stands, the recording
    /// follows.
    pub fn set_scene(&mut self, scene: Arc<Scene>) {
        self.given_light = scene.lighting.clone();
        self.scene = scene;
        self.follow_scene();
    }

    /// Takes the scene's unit and world, and gives it the light of the footage where it has none. What was said when the recording was opened overrides the scene file's unit.
    fn follow_scene(&mut self) {
        let wanted_m = unit_m(&self.scene, self.opened_unit_m);
        if wanted_m != self.recording.metres_per_unit && !self.recording.kind.is_metric() {
            Arc::make_mut(&mut self.recording).rescale(wanted_m);
            self.floors = Arc::default();
        }
        let found_light = self.found_light.as_deref().filter(|_| self.has_light_of_its_unit());
        lit::light(&mut self.scene, &self.given_light, found_light);
        let held = self.scene.gauge.and_then(|g| self.recording.held_at(g.frame, g.time_s, &g.pose()?));
        if let Some(world_from_other) = held {
            Arc::make_mut(&mut self.recording).move_to_world(&world_from_other);
            self.floors = Arc::default();
        }
    }

    /// Whether the light of the footage was found with the length that the recording's unit has now.
    fn has_light_of_its_unit(&self) -> bool {
        match &self.analysis {
            AnalysisState::Used(_, findings) => findings.is_light_of_unit(self.recording.metres_per_unit),
            _ => true,
        }
    }

    /// In which world things are placed in a frame, to be kept with them. `None` for pictures of a camera, which are gone, and
    /// without a pose.
    pub fn gauge(&self, frame: usize) -> Option<Gauge> {
        let pose = self.recording.pose_at_frame(frame).ok().filter(|_| !self.recording.is_arriving())?;
        Some(Gauge::of(frame, self.recording.timestamps_s[frame], &pose))
    }

    /// A compositor on a device, with the scene as it is now.
    pub fn compositor(&self, gpu: Gpu) -> Compositor {
        self.compositor_on_floors(gpu)
    }

    /// Camera and settings without the scene file's own settings.
    pub fn baseline(&self) -> &Baseline {
        &self.baseline
    }

    /// The profiles that were read, the recording's own first.
    pub fn profiles(&self) -> &[PathBuf] {
        &self.profiles
    }

    /// Every file that was read, or will be.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let given = self.profiles.iter().chain(&self.scene.files).map(PathBuf::as_path);
        self.recording.files().chain(given)
    }

    /// The camera of all frames, without their own geometry. If no exposure is known and the frames' times mean
    /// nothing, they are exposed for an instant: between such pictures there is no motion to blur along.
    pub fn camera(&self) -> Camera {
        let mut camera = self.rig.camera();
        if self.lacks_exposure() && !self.recording.kind.has_times() {
            camera.exposure.time_s = Some(0.0);
        }
        camera
    }

    /// The camera that took a frame: what was given, over the recording's own. A frame with an unknown camera, which
    /// therefore has no pose either, gets the first known one.
    pub fn geometry_at(&self, frame: usize) -> Result<Geometry, ShotError> {
        let count = self.recording.frame_count();
        let known = std::iter::once(frame).chain(0..count).find(|frame| self.given_geometry_at(*frame).is_some());
        check::geometry(&self.recording, &self.rig, known.unwrap_or(frame))
    }

    /// Like [`Shot::geometry_at`], unchecked. `None` if unknown.
    pub fn given_geometry_at(&self, frame: usize) -> Option<Geometry> {
        self.rig.geometry_over(self.recording.geometry_at_frame(frame))
    }

    /// Seconds from a frame to the next.
    pub fn interval_s(&self, frame: usize) -> f64 {
        self.recording.interval_s(frame)
    }

    /// A frame as it was recorded.
    pub fn read(&self, frame: usize) -> Result<Frame, ShotError> {
        let (range, missing) = self.single(frame)?;
        Ok(self.recording.frames(range)?.next().ok_or(missing)??)
    }

    /// The same with what its neighbours saw: for a picture of it.
    pub fn read_beside(&self, frame: usize) -> Result<Frame, ShotError> {
        let (range, missing) = self.single(frame)?;
        Ok(self.recording.frames_beside(range)?.next().ok_or(missing)??)
    }

    /// The range of a frame, and the error that there is no such frame.
    fn single(&self, frame: usize) -> Result<(Range<usize>, RecordingError), RecordingError> {
        let missing = || RecordingError::Range { start: frame, end: frame, count: self.recording.frame_count() };
        Ok((frame..frame.checked_add(1).ok_or_else(missing)?, missing()))
    }

    /// Whether no exposure is known, and effects are on to which it might matter.
    fn lacks_exposure(&self) -> bool {
        let exposure = &self.rig.exposure;
        let given = exposure.time_s.is_some() || exposure.shutter_angle_deg.is_some();
        !given && self.recording.exposure.iter().all(|e| e.time_s.or(e.blurred_s).is_none()) && !self.is_plain()
    }

    /// Whether every effect is switched off.
    fn is_plain(&self) -> bool {
        self.settings.on().next().is_none()
    }
}

/// Length of a recording's unit, m: the scene's, unless another one was given when the recording was opened.
fn unit_m(scene: &Scene, opened_unit_m: f64) -> f64 {
    scene.metres_per_unit.filter(|_| opened_unit_m == 1.0).unwrap_or(opened_unit_m)
}
