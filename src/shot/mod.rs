//! A shot: a recording with its camera, the scene that is put into it, and settings.
//!
//! The program, a window and tests use the same [`Shot`]. Its camera (`rig`) and `settings` may
//! change between two pictures; the next picture uses the new values without reading files again.
//! The caller owns the GPU: [`Shot::compositor`].

mod analysing;
mod apply_lighting;
mod check;
mod error;
mod layers;
mod light;
mod load_analysis;
mod motion_px;
mod note;
mod options;
mod outline;
mod pick;
mod posed_camera;
mod preview;
mod projected;
mod radiance;
mod reduced;
mod site;
mod site_alignment;
mod stream;
mod support_gaps;
mod support_report;
mod supports;
mod surface;
mod triangulate;
mod unit;
mod upright;
mod white_reference;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::camera::{Camera, Geometry, NoiseProfile};
use crate::compositor::{Compositor, ExposureTime, Settings};
use crate::effects::noise::NoiseMethod;
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::memo::{ByAddress, Memo};
use crate::params::Field;
use crate::profile::{Rig, ShotSettings};
use crate::recording::{OpenOptions, Recording, RecordingError};
use crate::scene::{self, Gauge, Lighting, Scene};
use crate::site::SiteScan;

pub use analysing::AnalyseError;
pub use error::ShotError;
use layers::SettingsLayers;
pub use layers::{EstimatedParam, ResolvedSettings};
pub use light::{DEFAULT_ISO, PartialExposure, SceneLight};
pub use load_analysis::AnalysisState;
pub use note::{FrameCounts, Note, ObjectIssue};
pub use options::{AnalysisChoice, ShotOptions};
pub use pick::{PickHit, nearest};
pub use posed_camera::{PosedCamera, ViewRay};
pub use projected::ProjectedObject;
pub use reduced::ReducedFrame;
pub use site_alignment::{PairAlignmentError, PickedPair, SiteByPairs, SiteScaleError};
pub use stream::Composites;
pub use support_gaps::SupportGap;
use supports::RoomMemos;
pub use surface::{Surface, SurfaceError};
pub use triangulate::{FramePoint, TriangulatedPoint};
pub use unit::metres_per_unit;
use unit::unit_m;
pub use white_reference::{ACCEPTED_FACTORS, ReferencePick, WhiteReference, WhiteReferenceError};

/// A recording with its camera, scene and settings. Cheap to clone: large parts are shared.
#[derive(Clone, Debug)]
pub struct Shot {
    pub recording: Arc<Recording>,
    /// The recording as it was read, before an analysis, the scene's unit or its gauge changed it.
    recorded: Arc<Recording>,
    /// The camera from profiles and settings. Overrides each frame's own camera
    /// ([`Shot::geometry_at`]).
    pub rig: Rig,
    pub settings: Settings,
    /// Drawn by the compositors made from it ([`Shot::compositor`]). Replaced with
    /// [`Shot::set_scene`]. Compositors follow the placement of its objects; after other changes,
    /// call [`Compositor::set_scene`].
    pub scene: Arc<Scene>,
    /// The scene's own lighting, without the estimate from the footage.
    scene_lighting: Lighting,
    /// The room's lighting as an analysis of the footage estimated it.
    estimated_lighting: Option<Arc<Lighting>>,
    /// The sources of `rig` and `settings`.
    layers: SettingsLayers,
    /// Unit of the recording as it was opened, m.
    opened_unit_m: f64,
    /// Whether an analysis of the footage is used, and why not.
    pub analysis: AnalysisState,
    /// Decoded frames of [`Shot::picture`].
    decoded: Memo<(ByAddress<Recording>, usize), Arc<Frame>>,
    /// Measured points and support planes.
    room: Arc<RoomMemos>,
    /// Reason why the scan of a scene that was set later cannot be read.
    site_problem: Option<String>,
    /// Scan that was read last. No memo: the scene may name it again.
    last_scan: Option<Arc<SiteScan>>,
}

impl Shot {
    /// Opens a recording with its options. Only the headers of the frames' files are read.
    pub fn open(recording: &Path, options: &OpenOptions, shot_options: &ShotOptions) -> Result<Self, ShotError> {
        Self::of(Recording::open(recording, options)?, shot_options)
    }

    /// Like [`Shot::open`], for an open recording.
    ///
    /// Depth from a separate depth camera is registered to the picture of the present camera. It is
    /// not registered again when `rig` changes later.
    pub fn of(mut recording: Recording, options: &ShotOptions) -> Result<Self, ShotError> {
        let layers = SettingsLayers::read(&recording, options)?;
        let ResolvedSettings { rig, settings } = layers.resolve()?;
        let mut recorded = recording.clone();
        let scene = match &options.scene {
            Some(path) => scene::load_with(path, recording.up, options.missing_models)?,
            None => Scene::default(),
        };
        let opened_unit_m = recording.metres_per_unit;
        // The analysis's estimates depend on the unit.
        recording.rescale(unit_m(&scene, opened_unit_m));
        site::set_site_of(&mut recording, &scene, None)?;
        recorded.set_site(recording.site().cloned());
        let mut shot = Self {
            recording: Arc::new(recording),
            recorded: Arc::new(recorded),
            rig,
            settings,
            scene_lighting: scene.lighting.clone(),
            scene: Arc::new(scene),
            estimated_lighting: None,
            layers,
            opened_unit_m,
            analysis: AnalysisState::Absent,
            decoded: Memo::default(),
            room: Arc::default(),
            site_problem: None,
            last_scan: None,
        };
        shot.load_analysis(options)?;
        // Now with the analysis's estimates.
        ResolvedSettings { rig: shot.rig, settings: shot.settings } = shot.layers.resolve()?;
        shot.register_depth();
        shot.follow_scene();
        Ok(shot)
    }

    /// Registers depth from a separate depth camera, or of a scan, to the picture of the present
    /// camera.
    pub fn register_depth(&mut self) {
        let rig = &self.rig;
        Arc::make_mut(&mut self.recording).set_cameras(|own| rig.geometry_over(own));
    }

    /// Gives the scene's own settings precedence over the recorded exposure of a frame
    /// ([`Shot::exposure_settings`]). `rig` and `settings` stay as they are.
    pub fn set_settings_of_scene(&mut self, of_scene: &ShotSettings) {
        self.layers.set_scene(of_scene);
    }

    /// Replaces the given profile by one that was written with these values.
    pub fn replace_profile(&mut self, profile: &Path, values: &ShotSettings) {
        let own = self.recording.camera_profile.iter().cloned();
        self.layers.replace_profiles(own.chain([profile.to_owned()]).collect(), values);
    }

    /// Replaces the inputs from files and settings by those of another shot of the same recording.
    /// Recording, scene and camera stay.
    pub fn take_files(&mut self, fresh: Self) {
        self.layers = fresh.layers;
    }

    /// The unit with which the recording was opened, m: 1 if none was given.
    pub fn opened_unit_m(&self) -> f64 {
        self.opened_unit_m
    }

    /// Values in text form that override all files ([`ShotOptions::sets`]).
    pub fn sets(&self) -> &[String] {
        self.layers.sets()
    }

    /// Replaces the scene. If it sets the recording's unit, or the pose of its camera, the
    /// recording is updated.
    pub fn set_scene(&mut self, scene: Arc<Scene>) {
        self.scene_lighting = scene.lighting.clone();
        self.scene = scene;
        self.follow_scene();
    }

    /// Applies the scene's unit and gauge to the recording, and the estimated lighting to a scene
    /// without its own. A unit given when the recording was opened overrides the scene file's.
    fn follow_scene(&mut self) {
        let wanted_m = unit_m(&self.scene, self.opened_unit_m);
        if wanted_m != self.recording.metres_per_unit && !self.recording.kind.is_metric() {
            Arc::make_mut(&mut self.recording).rescale(wanted_m);
            self.room = Arc::default();
        }
        let estimated_lighting = self.estimated_lighting.as_deref().filter(|_| self.lighting_matches_unit());
        apply_lighting::apply_lighting(&mut self.scene, &self.scene_lighting, estimated_lighting);
        if let Some(world_from_other) = site::world_from_gauge(&self.recording, &self.scene) {
            Arc::make_mut(&mut self.recording).move_to_world(&world_from_other);
            self.room = Arc::default();
        }
        self.follow_site();
    }

    /// Whether the lighting was estimated with the recording's present unit.
    fn lighting_matches_unit(&self) -> bool {
        match &self.analysis {
            AnalysisState::Used(_, findings) => findings.is_light_of_unit(self.recording.metres_per_unit),
            _ => true,
        }
    }

    /// The world in which objects are placed in a frame, for the scene file. `None` for the
    /// pictures of a live camera, which are not kept, and without a pose.
    pub fn gauge(&self, frame: usize) -> Option<Gauge> {
        let pose = self.recording.pose_at_frame(frame).ok().filter(|_| !self.recording.is_live())?;
        Some(Gauge::of(frame, self.recording.timestamps_s[frame], &pose))
    }

    /// A compositor of the present scene on a device.
    pub fn compositor(&self, gpu: Gpu) -> Compositor {
        self.compositor_with_supports(gpu)
    }

    /// Camera and settings without the scene file's own settings.
    pub fn baseline(&self) -> Result<ResolvedSettings, ShotError> {
        self.layers.without_scene().resolve()
    }

    /// The parameters that the analysis estimated for this recording alone, and that neither
    /// profiles nor `--set` override.
    pub fn estimates(&self) -> Vec<EstimatedParam> {
        self.layers.without_scene().effective_estimates().cloned().collect()
    }

    /// The camera's noise as the analysis measured it, if no profile gives it.
    pub fn estimated_noise(&self) -> Option<&NoiseProfile> {
        self.layers.effective_noise()
    }

    /// The profiles that were read, the recording's own first.
    pub fn profiles(&self) -> &[PathBuf] {
        self.layers.profiles()
    }

    /// Every file that was read or will be read.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let own_files = self.profiles().iter().chain(&self.scene.files).map(PathBuf::as_path);
        self.recording.files().chain(own_files)
    }

    /// The camera of all frames, without their own geometry. Without a known exposure and without
    /// meaningful frame times, the exposure is 0: such pictures have no motion blur.
    pub fn camera(&self) -> Camera {
        let mut camera = self.rig.camera();
        if let Some(noise) = &mut camera.noise {
            noise.example = noise.example.take().or_else(|| self.layers.estimated_example().cloned());
        }
        if self.lacks_exposure() && !self.recording.kind.has_times() {
            camera.exposure.time_s = Some(0.0);
        }
        camera
    }

    /// Whether noise by example is chosen and has a model. Frames of another coding still get the
    /// pattern.
    pub fn has_noise_by_example(&self) -> bool {
        let noise = self.settings.on().find(|effect| effect.table() == "noise");
        let method = noise.and_then(|noise| noise.get("method"));
        let is_chosen =
            method.is_some_and(|value| NoiseMethod::BY_MODEL.iter().any(|method| method.to_value() == value));
        is_chosen && self.camera().noise.is_some_and(|noise| noise.example.is_some())
    }

    /// The camera of a frame: the given values over the recording's own. A frame with an unknown
    /// camera, which therefore has no pose either, uses the first known one.
    pub fn geometry_at(&self, frame: usize) -> Result<Geometry, ShotError> {
        let count = self.recording.frame_count();
        let calibrated_frame =
            std::iter::once(frame).chain(0..count).find(|frame| self.known_geometry_at(*frame).is_some());
        check::geometry(&self.recording, &self.rig, calibrated_frame.unwrap_or(frame))
    }

    /// Like [`Shot::geometry_at`], unchecked. `None` if unknown.
    pub fn known_geometry_at(&self, frame: usize) -> Option<Geometry> {
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

    /// A frame with the neighbouring frames that its depth consensus needs.
    pub fn read_with_neighbours(&self, frame: usize) -> Result<Frame, ShotError> {
        let (range, missing) = self.single(frame)?;
        Ok(self.recording.frames_with_neighbours(range)?.next().ok_or(missing)??)
    }

    /// The range of one frame, and the error for a missing frame.
    fn single(&self, frame: usize) -> Result<(Range<usize>, RecordingError), RecordingError> {
        let missing = || RecordingError::Range { start: frame, end: frame, count: self.recording.frame_count() };
        Ok((frame..frame.checked_add(1).ok_or_else(missing)?, missing()))
    }

    /// The exposure time of a frame.
    pub fn exposure_time(&self, frame: &Frame) -> ExposureTime {
        ExposureTime::of_frame(&self.camera(), &self.settings, &frame.exposure, self.interval_s(frame.index))
    }

    /// Whether the exposure is unknown although effects are on that may depend on it.
    fn lacks_exposure(&self) -> bool {
        let exposure = &self.rig.exposure;
        let has_camera_exposure = exposure.time_s.is_some() || exposure.shutter_angle_deg.is_some();
        !has_camera_exposure && !self.recording.has_exposure_times() && !self.is_plain()
    }

    /// Whether every effect is switched off.
    fn is_plain(&self) -> bool {
        self.settings.on().next().is_none()
    }
}
