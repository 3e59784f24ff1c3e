//! Simulated footage with complete ground truth, for demonstration and as a reference for
//! everything else.
//!
//! A small ray caster of its own images the site through a lens with distortion, a rolling shutter
//! and a noisy sensor, and writes a recording with its ground truth. [`Flaws`] add the defects of
//! real recordings. The simulation shares no rendering, blur or noise code with the code that it
//! evaluates, only plain values.
//!
//! Not modelled: vignetting, chromatic aberration, mosaic, light between the board and the site.

mod board;
mod bvh;
mod chart;
mod correlated_noise;
mod depth;
mod depth_errors;
mod edge_errors;
mod encode;
mod evidence;
mod finish;
mod flaws;
mod hemisphere;
mod lamps;
mod local_tone;
mod manifest;
mod output;
mod path;
mod person;
mod pose_errors;
pub(crate) mod random;
mod random_walk;
mod render;
mod sensor;
mod sensor_depth;
mod sensor_return;
mod shapes;
mod site;
mod static_scenes;
mod stray;
mod truth;
mod write;

use std::path::PathBuf;

use glam::{DQuat, DVec2, DVec3};

use crate::camera::{Distortion, Geometry, Intrinsics, LensModel, Response};
use crate::scene::Scene;
use crate::sink::SinkError;
use crate::text::reason;
use crate::tracking::{NotAscending, PoseTrack};

use evidence::Evidence;
use person::Person;

pub use board::{SimulatedBoard, board};
pub use depth_errors::DepthErrors;
pub use flaws::{DepthSensorModel, Flaws};
pub use path::{DOLLY_M_PER_S, PAN_RAD_PER_S};
pub use render::{SimulatedPicture, Snapshot};
pub use sensor::Sensor;
pub use site::Detail;
pub use static_scenes::{StaticScene, StaticScenes, static_scenes};
pub use write::{run, write};

crate::choices! {
    /// Motion of the simulated camera.
    pub enum Motion {
        /// A walk around the evidence with a hand's tremor and two fast turns.
        Handheld = "handheld",
        Static = "static",
        /// A turn to the right about the vertical at constant speed.
        Pan = "pan",
        /// A translation to the right at constant speed, without turning.
        Dolly = "dolly",
    }
}

crate::choices! {
    /// File format of the frames.
    pub enum Format { Png = "png", Jpg = "jpg" }
}

crate::choices! {
    /// Layout of the folder, if not Locard's own.
    pub enum FolderLayout {
        /// Stray Scanner's export from a phone.
        Stray = "stray",
    }
}

crate::choices! {
    /// Ground of the site and the objects on it, if not planks with the demonstration's objects.
    pub enum Ground {
        /// Plain concrete without objects.
        Concrete = "concrete",
        /// A white desk with a black screen, a cup and a keyboard.
        Desk = "desk",
    }
}

crate::params! {
    /// Parameters of a simulation. The defaults are the demonstration.
    pub struct Options in "simulate" {
        "width of the picture" width_px: u32 = 640, "px", 8.0..=4096.0;
        "height of the picture" height_px: u32 = 480, "px", 8.0..=4096.0;
        "number of frames" frames: u32 = 72, "1", 1.0..=10000.0;
        "frames per second" fps: f64 = 30.0, "1/s", 1.0..=1000.0;
        "how the camera moves" motion: Motion = Motion::Handheld;
        "factor on rotation, path or tremor of the motion" speed: f64 = 1.0, "1", 0.0..=20.0;
        "exposure time of each row" exposure_time_s: f64 = 1.0 / 60.0, "s", 0.0..=1.0;
        "from the first row's exposure to the last row's; none in a 360° picture" readout_time_s: f64 = 0.015, "s", 0.0..=1.0;
        "projection of the lens; equirectangular: a 360° picture" lens: LensModel = LensModel::Opencv;
        "focal length; unused in a 360° picture, where it follows from the size" focal_px: f64 = 520.0, "px", 1.0..=100000.0;
        "diameter of the aperture, only for the lens opencv; 0 for a pinhole" aperture_diameter_mm: f64 = 0.0, "mm", 0.0..=1000.0;
        "distance in focus with an aperture" focus_distance_m: f64 = 1.0, "m", 0.01..=100000.0;
        "radial distortion, r² (θ² of a fisheye); unused in a 360° picture" k1: f64 = -0.11, "1", -2.0..=2.0;
        "radial distortion, r⁴ (θ⁴)" k2: f64 = 0.03, "1", -2.0..=2.0;
        "tangential distortion; only for the lens opencv" p1: f64 = 0.0006, "1", -0.1..=0.1;
        "tangential distortion; only for the lens opencv" p2: f64 = -0.0004, "1", -0.1..=0.1;
        "factor on the light" gain: f64 = 1.0, "1", 0.0..=100.0;
        "factor on the sensor's noise; 0 for none" noise_scale: f64 = 1.0, "1", 0.0..=20.0;
        "correlation of noise between channels" channel_correlation: f64 = 0.45, "1", 0.0..=1.0;
        "correlation of noise between neighbours" neighbour_correlation: f64 = 0.6, "1", 0.0..=0.7;
        "seed of noise and samples" seed: u64 = 1, "1", 0.0..=9007199254740991.0;
        "minimum number of light samples per pixel" samples: u32 = 16, "1", 1.0..=4096.0;
        "how frames are stored" format: Format = Format::Jpg;
        "quality of jpg, colours not subsampled" jpeg_quality: u32 = 88, "1", 1.0..=100.0;
        "depth values per metre" depth_scale: f64 = 250.0, "1/m", 10.0..=10000.0;
        "number of lamps placed by the seed of the site, out of the camera's view; none: the demonstration's one" lamps: Option<u32> = None, "1", 1.0..=3.0;
        "seed of the site: where its lamps are and where things stand; none: the demonstration's" site: Option<u32> = None, "1", 0.0..=1000000000.0;
        "concrete: plain concrete on all sides, with a contrast of 3 codes, on which nothing stands; desk: a white desk, which clips with a gain of 1.6, a black screen, a cup and a keyboard; none: the demonstration's planks and things" ground: Option<Ground> = None;
        "whether the known board stands in the site" board: bool = false;
        "width of the depth pictures, of the frames' shape; none: the frames' own, in Stray Scanner's layout up to 256" depth_width_px: Option<u32> = None, "px", 8.0..=4096.0;
        "distance of a separate depth camera to the left of the frames' camera; none: depth is of the frames' view" depth_beside_mm: Option<f64> = None, "mm", -1000.0..=1000.0;
        "layout of the folder: stray is Stray Scanner's, of a lens without distortion and with y up; none: recording.toml" layout: Option<FolderLayout> = None;
    }
}

/// Errors of a simulation.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    #[error("{0}: exists already, and is kept (--force replaces it)")]
    Exists(PathBuf),
    #[error("{folder} is not replaced: {foreign} in it was not written by `locard simulate`; choose another folder")]
    Foreign { folder: PathBuf, foreign: PathBuf },
    #[error(
        "{folder} is not replaced: {changed} in it has changed since `locard simulate` wrote it; choose another folder"
    )]
    Changed { folder: PathBuf, changed: PathBuf },
    #[error(
        "{0} is not replaced: it has no truth.toml that lists its files as `locard simulate` wrote them; choose \
         another folder, or remove this one"
    )]
    NotSimulated(PathBuf),
    #[error("{0} is the current folder or contains it; choose a new one for the recording")]
    Within(PathBuf),
    #[error("{path}: cannot be written: {}", reason(source))]
    Write { path: PathBuf, source: std::io::Error },
    #[error("stopped; nothing was kept")]
    Stopped,
    #[error("its lists and descriptions cannot be written: {0}")]
    Text(String),
    #[error("{what}: cannot be encoded: {source}")]
    Encode { what: String, source: image::ImageError },
    #[error(
        "simulate.k1, k2, p1, p2: the lens has no ray for the corner of pixels at ({x}, {y}); \
         choose weaker distortion or a larger simulate.focal_px"
    )]
    Lens { x: u32, y: u32 },
    #[error("simulate: a 360° picture (lens = equirectangular) must be twice as wide as high; found: {width}x{height}")]
    PanoramaSize { width: u32, height: u32 },
    #[error("simulate.layout = stray: a phone has no such lens; give lens = opencv, and leave depth_beside_mm out")]
    UnsupportedPhoneLens,
    #[error("the scene has {0}, which the simulated site's light cannot go through or into; leave such objects out")]
    Unsupported(&'static str),
    #[error(transparent)]
    Video(#[from] SinkError),
    #[error("simulate.aperture_diameter_mm: only lens = opencv has an opening; give 0, or that lens")]
    NoAperture,
    #[error("simulate.lens: this model is not simulated; expected opencv, opencv_fisheye or equirectangular")]
    UnsupportedLens,
    #[error("simulate.fps: the camera's path has no ascending times: {0}")]
    Path(#[from] NotAscending),
}

/// A site, a camera and its trajectory, ready to take pictures.
#[derive(Clone, Debug)]
pub struct Simulation {
    options: Options,
    flaws: Flaws,
    site: site::Site,
    lens: render::SimulatedLens,
    geometry: Geometry,
    track: PoseTrack,
    /// Names of the objects that are a real part of the site.
    evidence: Vec<String>,
    pub sensor: Sensor,
    /// Number of threads. It affects no result.
    pub threads: usize,
}

impl Simulation {
    /// Uses one thread per core, and a site as detailed as the lens resolves.
    pub fn new(options: &Options) -> Result<Self, SimulateError> {
        Self::with_flaws(options, &Flaws::default())
    }

    /// A simulation with defects.
    pub fn with_flaws(options: &Options, flaws: &Flaws) -> Result<Self, SimulateError> {
        let threads = crate::parallel::processors();
        Self::with_flaws_and_detail(options, flaws, Detail::for_focal_px(geometry(options).intrinsics.fx_px), threads)
    }

    /// Uses a site of the given detail. Computes the site's light, which takes most of the time.
    pub fn with_detail(options: &Options, detail: Detail, threads: usize) -> Result<Self, SimulateError> {
        Self::with_flaws_and_detail(options, &Flaws::default(), detail, threads)
    }

    /// Uses a site of the given detail, with defects. Depth does not depend on the detail.
    pub fn with_flaws_and_detail(
        options: &Options,
        flaws: &Flaws,
        detail: Detail,
        threads: usize,
    ) -> Result<Self, SimulateError> {
        if matches!(
            options.lens,
            LensModel::OpencvRational | LensModel::Fov | LensModel::ThinPrismFisheye | LensModel::StMap
        ) {
            return Err(SimulateError::UnsupportedLens);
        }
        let geometry = geometry(options);
        let Options { width_px: width, height_px: height, .. } = *options;
        if geometry.is_equirectangular() && width != 2 * height {
            return Err(SimulateError::PanoramaSize { width, height });
        }
        if options.aperture_diameter_mm > 0.0 && options.lens != LensModel::Opencv {
            return Err(SimulateError::NoAperture);
        }
        let is_phone = options.layout == Some(FolderLayout::Stray);
        if is_phone && (options.lens != LensModel::Opencv || options.depth_beside_mm.is_some()) {
            return Err(SimulateError::UnsupportedPhoneLens);
        }
        let lens = render::SimulatedLens::new(geometry.clone())?;
        let board = if options.board { board().emissive_panel() } else { None };
        let placement_seed = options.site.map(u64::from);
        let lamps = match options.lamps {
            Some(count) => lamps::random_lamps(count, placement_seed.unwrap_or(0)),
            None => vec![lamps::DEMO_LAMP],
        };
        let mut site = site::Site::new(detail, lamps, (placement_seed, options.ground), board, threads);
        site.is_blank = flaws.blank;
        site.person = (flaws.person_m_per_s > 0.0).then(|| Person::new(flaws.person_m_per_s, detail.texture_m));
        Ok(Self {
            options: options.clone(),
            flaws: flaws.clone(),
            site,
            lens,
            geometry,
            track: path::track(options, flaws.poses_later_s.abs().max(flaws.depth_later_s.abs()))?,
            evidence: Vec::new(),
            sensor: Sensor {
                response: Response::default(),
                noise_scale: options.noise_scale,
                channel_correlation: options.channel_correlation,
                neighbour_correlation: options.neighbour_correlation,
                seed: options.seed,
            },
            threads,
        })
    }

    pub fn options(&self) -> &Options {
        &self.options
    }

    pub fn flaws(&self) -> &Flaws {
        &self.flaws
    }

    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The camera's true trajectory at 200 Hz. Between its poses the camera moves as in
    /// [`PoseTrack::at`].
    pub fn track(&self) -> &PoseTrack {
        &self.track
    }

    /// Rotates the camera in place; `turn` takes its axes to the rotated one's.
    pub fn turned(mut self, turn: DQuat) -> Self {
        self.track = self.track.turned(turn);
        self
    }

    /// Adds a scene's objects as a real part of the site, at their positions in the scene: z up,
    /// metres, the floor at 0. The scene's light is not used.
    ///
    /// # Errors
    /// Materials that the simulation cannot render: transparency, normal maps.
    pub fn with_evidence(mut self, scene: &Scene) -> Result<Self, SimulateError> {
        if let Some(what) = Evidence::unsupported(scene) {
            return Err(SimulateError::Unsupported(what));
        }
        self.site.evidence = Some(Evidence::new(scene));
        self.evidence = scene.objects.iter().map(|object| object.name.clone()).collect();
        Ok(self)
    }

    /// Names of the objects that are a real part of the site.
    pub fn evidence(&self) -> &[String] {
        &self.evidence
    }

    /// Radiance of a white diffuse surface facing up at a point: the irradiance from above over π.
    pub fn white_facing_up(&self, at_m: DVec3) -> DVec3 {
        self.site.white_facing_up(at_m)
    }

    /// Positions of the lamps, metres, and for each the radiance of a white surface facing it at 1
    /// m straight below.
    pub fn lamps(&self) -> Vec<(DVec3, DVec3)> {
        let lamp_light =
            |lamp: &lamps::SiteLamp| (lamp.centre_m, lamp.radiance * lamp.white_radiance(DVec3::Z, DVec3::Z));
        self.site.lamps.iter().map(lamp_light).collect()
    }

    /// The recorded poses, with the flaws' errors.
    pub fn recorded_track(&self) -> Result<PoseTrack, NotAscending> {
        self.flaws.recorded(&self.track)
    }

    /// A frame's depth as measured by the sensor, m, row by row; and without errors.
    pub fn depths(&self, frame: usize) -> Result<[Vec<f32>; 2], SimulateError> {
        let Some(sensor) = depth::DepthSensor::new(self)? else {
            let exact = self.picture(frame).depth_m;
            return Ok([exact.clone(), exact]);
        };
        let exact = sensor.exact(self, frame);
        let measured = sensor.measured(self, frame, &exact);
        Ok([measured.map_or_else(|| exact.depth_m.clone(), |picture| picture.depth_m), exact.depth_m])
    }

    /// Exact depth at a pixel position of a frame, m. `None` where there is no surface.
    pub fn depth_at(&self, frame: usize, at_px: DVec2) -> Option<f64> {
        // All pixels of a row are exposed at the same time.
        let time_s = self.timestamp_s(frame) + self.geometry.row_time_s(at_px.y.floor() + 0.5);
        let pose = self.track.at_or_nearest(time_s)?;
        let direction = pose.world_from_camera_rotation() * self.geometry.depth_ray(at_px)?;
        self.site.first_hit(pose.position_in_world_m(), direction, time_s).map(|met| met.t)
    }

    /// Gains of a frame's picture: red, green, blue.
    pub fn gains(&self, frame: usize) -> [f64; 3] {
        self.flaws.gains(self.timestamp_s(self.flaws.source_frame(frame))).map(|gain| self.options.gain * gain)
    }

    /// The middle of the middle row's exposure of a frame, seconds.
    pub fn timestamp_s(&self, frame: usize) -> f64 {
        path::timestamp_s(&self.options, frame)
    }

    /// Snapshot parameters of a recording's frame.
    pub fn snapshot(&self, frame: usize) -> Snapshot {
        Snapshot {
            timestamp_s: self.timestamp_s(frame),
            exposure_time_s: self.options.exposure_time_s,
            samples: self.options.samples,
            aperture_diameter_m: 1e-3 * self.options.aperture_diameter_mm,
            focus_distance_m: self.options.focus_distance_m,
            seed: self.options.seed,
            // A camera at rest sees the same light in every frame; different sample positions would
            // look like noise.
            frame: if self.options.motion == Motion::Static { 0 } else { frame as u64 },
        }
    }

    /// A frame in linear light, before the sensor.
    pub fn picture(&self, frame: usize) -> SimulatedPicture {
        self.shoot(&self.snapshot(frame))
    }

    /// Any snapshot of this camera.
    pub fn shoot(&self, snapshot: &Snapshot) -> SimulatedPicture {
        render::shoot(&self.site, &self.lens, &self.track, snapshot, self.threads)
    }
}

fn geometry(options: &Options) -> Geometry {
    let Options { width_px, height_px, focal_px, lens, k1, k2, p1, p2, readout_time_s, .. } = *options;
    let distortion = match lens {
        // The export has no field for distortion.
        LensModel::Opencv if options.layout == Some(FolderLayout::Stray) => Distortion::default(),
        LensModel::Opencv => Distortion { k1, k2, p1, p2, ..Distortion::default() },
        LensModel::OpencvFisheye => Distortion { model: lens, k1, k2, ..Distortion::default() },
        LensModel::Equirectangular
        | LensModel::OpencvRational
        | LensModel::Fov
        | LensModel::ThinPrismFisheye
        | LensModel::StMap => Distortion { model: lens, ..Distortion::default() },
    };
    let intrinsics = Intrinsics {
        width_px,
        height_px,
        fx_px: focal_px,
        fy_px: focal_px,
        // Slightly off the centre, as in real cameras.
        cx_px: 0.5 * f64::from(width_px) + 1.75,
        cy_px: 0.5 * f64::from(height_px) - 1.5,
        // The rows of a picture stitched from several sensors have no times of their own.
        readout_time_s: if lens == LensModel::Equirectangular { 0.0 } else { readout_time_s },
        ..Intrinsics::default()
    };
    Geometry::new(intrinsics, distortion)
}
