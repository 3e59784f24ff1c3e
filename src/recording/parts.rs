//! Data that every format delivers, and the checks common to all.

use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::depth::{Depth, DepthFiles};
use super::frame_camera::FrameCamera;
use super::{Landmark, OpenOptions, Recording, RecordingError, listing, picture_tags};
use crate::camera::{Distortion, Geometry, Intrinsics, LensModel, Levels, Response};
use crate::coding::ColorRange;
use crate::frame::{FrameExposure, FrameLens, PhotoSettings};
use crate::params::{ParamError, Params, Value};
use crate::pose::Pose;
use crate::source::presentation::Presentation;
use crate::source::still::{self, PictureHeader};
use crate::source::still_color::{self, StillColor};
use crate::source::video::Video;
use crate::text;
use crate::tracking::{PoseTrack, default_max_gap_s, median_interval_s};

/// The assumed rate of frames without a clock.
pub const NOMINAL_FPS: f64 = 30.0;
/// Maximum time difference between a frame and its depth map or exposure, as a share of the frame
/// interval: half, plus some jitter. At 30 frames per second, where a Kinect's median interval is
/// 0.032 s, this is the 0.02 s that the TUM benchmark's own association allows.
const ASSOCIATION_REACH: f64 = 0.65;

/// Tolerance of the association of frames and cameras, which have equal times, seconds.
const CAMERA_TIME_TOLERANCE_S: f64 = 1e-6;

/// A format of recordings.
#[derive(Debug)]
pub struct RecordingFormat {
    pub(super) name: &'static str,
    pub(super) has_times: bool,
    pub(super) is_metric: bool,
    /// The file or folder of the recording, given a folder or a file in it; `None` if it is not of
    /// this format.
    pub(super) find: fn(&Path) -> Option<PathBuf>,
    /// Opens a recording that was found. The second path is the user's argument.
    pub(super) open: fn(&Path, &Path, &OpenOptions) -> Result<Parts, RecordingError>,
}

impl RecordingFormat {
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// True if the format contains picture times; otherwise times are nominal.
    pub fn has_times(&self) -> bool {
        self.has_times
    }

    /// True if the format's unit is the metre; otherwise it is arbitrary.
    pub fn is_metric(&self) -> bool {
        self.is_metric
    }
}

impl fmt::Display for RecordingFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

/// The path itself if it is a file of this name, or the file of this name in it.
pub fn file_or_in_folder(path: &Path, name: &str) -> Option<PathBuf> {
    let inside = path.join(name);
    if path.is_dir() { inside.exists().then_some(inside) } else { path.ends_with(name).then(|| path.to_owned()) }
}

/// The folder that contains a file.
pub fn folder_of(file: &Path) -> PathBuf {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned()
}

/// Source of the pixels.
#[derive(Debug)]
pub enum Pictures {
    Stills(Vec<PathBuf>),
    /// A video, with file indices of the used frames if any are skipped.
    Video(Box<Video>, Option<Vec<usize>>),
}

/// A recording as read by its format's module, with axes and units converted.
#[derive(Debug)]
pub struct Parts {
    pub name: String,
    pub path: PathBuf,
    pub up: Option<DVec3>,
    pub has_floor: bool,
    pub pictures: Pictures,
    /// One per frame.
    pub timestamps_s: Vec<f64>,
    /// One per frame, or empty if all are 1: [`Frame::opacity`](crate::frame::Frame::opacity).
    pub opacity: Vec<f64>,
    /// Nominal frame interval, seconds, if the recording contains it.
    pub interval_s: Option<f64>,
    /// Whether the coding of PNG files is estimated. False for the recording of a live camera: its
    /// frames were composited without one.
    pub estimates_coding: bool,
    pub track: PoseTrack,
    /// One per frame, or empty.
    pub geometries: Vec<Option<Geometry>>,
    /// Individual cameras and lenses, ascending in time.
    pub cameras: Option<Vec<(f64, FrameCamera)>>,
    /// One list per frame, or empty.
    pub landmarks: Vec<Vec<Landmark>>,
    pub depth: Option<DepthFiles>,
    /// Ascending in time.
    pub exposure: Vec<(f64, FrameExposure)>,
    pub camera_profile: Option<PathBuf>,
    /// True for 360° pictures, whose camera follows from their size.
    pub equirectangular: bool,
    /// All files that were read, except pictures.
    pub description_files: Vec<PathBuf>,
    pub warnings: Vec<String>,
}

impl Parts {
    pub fn new(folder: &Path, pictures: Pictures, timestamps_s: Vec<f64>) -> Self {
        let absolute = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        Self {
            name: absolute.file_name().map_or_else(|| "recording".into(), |n| n.to_string_lossy().into_owned()),
            path: folder.to_owned(),
            up: None,
            has_floor: false,
            pictures,
            timestamps_s,
            opacity: Vec::new(),
            interval_s: None,
            estimates_coding: true,
            track: PoseTrack::default(),
            geometries: Vec::new(),
            cameras: None,
            landmarks: Vec::new(),
            depth: None,
            exposure: Vec::new(),
            camera_profile: None,
            equirectangular: false,
            description_files: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// Applies the checks common to all formats and collects warnings.
    pub fn assemble(
        mut self,
        kind: &'static RecordingFormat,
        options: &OpenOptions,
    ) -> Result<Recording, RecordingError> {
        if options.skip_missing {
            self.remove_missing();
        }
        if options.skip_duplicates {
            self.remove_duplicates()?;
        }
        if self.timestamps_s.is_empty() {
            return Err(self.without_frames());
        }
        let PictureHeader { width, height, bits } = self.common_header()?;
        let median_s = || median_interval_s(&self.timestamps_s).filter(|interval_s| *interval_s > 0.0);
        let frame_interval_s = self.interval_s.or_else(median_s).unwrap_or(1.0 / NOMINAL_FPS);
        self.warnings.extend(irregular_intervals(&self.timestamps_s, frame_interval_s));
        let frame_cameras = self.frame_cameras();
        if let Some(cameras) = &frame_cameras {
            self.geometries = cameras.iter().map(|camera| camera.geometry.clone()).collect();
        }
        let geometry = match self.equirectangular {
            true => Some(equirectangular(width, height).map_err(|e| RecordingError::content(&self.path, e))?),
            // A frame without a geometry uses the profile's camera, not that of its neighbours.
            false if frame_cameras.is_some() => None,
            false => common_geometry(&self.geometries),
        };
        self.check_camera_sizes((width, height))?;
        let reach_s = ASSOCIATION_REACH * frame_interval_s;
        let listed = self.listed_exposures(reach_s);
        let depth = self.frame_depth(reach_s, (width, height))?;
        let (photos, presentation) = match &self.pictures {
            Pictures::Stills(files) => {
                let (settings, orientation) = picture_tags::of_stills(files, &mut self.warnings);
                // Pictures of one camera are tagged alike.
                let StillColor { transfer, primaries } =
                    files.first().map(|file| still_color::read(file)).unwrap_or_default();
                (settings, Presentation { orientation, transfer, primaries, ..Presentation::default() })
            }
            Pictures::Video(video, _) => {
                let (settings, sidecar) = picture_tags::of_video(video, &self.timestamps_s, &mut self.warnings);
                self.description_files.extend(sidecar);
                (settings, video.presentation)
            }
        };
        let photos = photos.into_iter().chain(std::iter::repeat(PhotoSettings::default()));
        let levels = match &self.pictures {
            Pictures::Video(video, _) if video.range == ColorRange::Limited => Levels::Video,
            _ => Levels::Full,
        };
        let response = Response { levels, ..presentation.response() };
        let exposures = listed.into_iter().map(Option::unwrap_or_default).zip(photos);
        let lenses =
            frame_cameras.iter().flatten().map(|camera| camera.lens).chain(std::iter::repeat(FrameLens::default()));
        let exposure = exposures.zip(lenses).map(|((listed, photo), lens)| {
            // On a nominal clock, exposure times in seconds are meaningless.
            let time_s = listed.time_s.or(photo.time_s.filter(|_| kind.has_times()));
            FrameExposure { time_s, photo, ..listed }.with_lens(lens)
        });
        let clock_offset_s = self.track.clock_offset_s() + options.time_offset_s;
        Ok(Recording {
            metres_per_unit: if kind.is_metric() { 1.0 } else { options.metres_per_unit },
            name: self.name,
            path: self.path,
            kind,
            up: self.up,
            has_floor: self.has_floor,
            width,
            height,
            bits,
            timestamps_s: self.timestamps_s.into(),
            opacity: self.opacity.into(),
            frame_interval_s,
            has_even_intervals: self.interval_s.is_some(),
            track: self.track.with_clock_offset_s(clock_offset_s),
            geometries: if geometry.is_some() { Arc::default() } else { self.geometries.into() },
            geometry,
            landmarks: self.landmarks.into(),
            has_frame_cameras: frame_cameras.is_some(),
            registration_cameras: None,
            camera_profile: self.camera_profile,
            description_files: self.description_files,
            exposure: exposure.collect(),
            warnings: self.warnings,
            pictures: Arc::new(self.pictures),
            estimated_coding: Arc::new(if self.estimates_coding { OnceLock::new() } else { OnceLock::from(None) }),
            presentation,
            response,
            depth,
            depth_later_s: 0.0,
            surfels: Arc::default(),
            surfels_unit_m: 1.0,
            site: None,
            guard: None,
        })
    }

    /// The camera of each frame, if cameras are listed by time.
    fn frame_cameras(&self) -> Option<Vec<FrameCamera>> {
        let cameras = self.cameras.as_ref()?;
        let nearest = |time_s: &f64| {
            let nearest = listing::nearest(cameras, *time_s, CAMERA_TIME_TOLERANCE_S);
            nearest.map(|(_, camera)| camera.clone()).unwrap_or_default()
        };
        Some(self.timestamps_s.iter().map(nearest).collect())
    }

    /// Refuses cameras for pictures of another size.
    fn check_camera_sizes(&self, size: (u32, u32)) -> Result<(), RecordingError> {
        for (frame, camera) in self.geometries.iter().enumerate() {
            let Some(Intrinsics { width_px, height_px, .. }) = camera.as_ref().map(|c| &c.intrinsics) else { continue };
            if (*width_px, *height_px) != size {
                let (width, height) = size;
                let problem = format!("frame {frame} is {width}x{height}, its camera is for {width_px}x{height_px}");
                return Err(RecordingError::content(&self.path, problem));
            }
        }
        Ok(())
    }

    /// The listed exposure of each frame.
    fn listed_exposures(&mut self, reach_s: f64) -> Vec<Option<FrameExposure>> {
        let nearest = |t: &f64| listing::nearest(&self.exposure, *t, reach_s).map(|e| e.1);
        let listed: Vec<_> = self.timestamps_s.iter().map(nearest).collect();
        if !self.exposure.is_empty() {
            self.warn_missing("exposure", &listed, reach_s);
        }
        listed
    }

    /// The depth maps by frame.
    fn frame_depth(&mut self, reach_s: f64, size: (u32, u32)) -> Result<Option<Arc<Depth>>, RecordingError> {
        let Some(DepthFiles { by_time, stored }) = self.depth.take() else { return Ok(None) };
        let nearest = |t: &f64| listing::nearest(&by_time, *t, reach_s).cloned();
        let maps: Vec<_> = self.timestamps_s.iter().map(nearest).collect();
        self.warn_missing("depth picture", &maps, reach_s);
        let (depth, odd) = Depth::new(maps, stored, size)?;
        self.warnings.extend(odd);
        Ok(Some(Arc::new(depth)))
    }

    /// Warns of frames without an entry within `reach_s`.
    fn warn_missing<T>(&mut self, what: &str, entries: &[Option<T>], reach_s: f64) {
        let missing = entries.iter().filter(|entry| entry.is_none()).count();
        if missing > 0 {
            let reach = text::fixed(reach_s, 4);
            self.warnings.push(format!("no {what} within {reach} s for {missing} of {} frames", entries.len()));
        }
    }
}

impl Parts {
    fn without_frames(&self) -> RecordingError {
        RecordingError::content(&self.path, "the recording has no frames")
    }

    /// Skips pictures of an unsupported type and damaged ones, unless all are, and returns the
    /// headers of the others.
    fn headers(&mut self, files: &[PathBuf]) -> Result<Vec<PictureHeader>, RecordingError> {
        let named = |error| listing::missing_picture(&self.description_files, error, files.iter());
        let (mut headers, mut kept, mut unread) = (Vec::new(), vec![true; files.len()], Vec::new());
        for (file, kept) in files.iter().zip(&mut kept) {
            match still::read_header(file) {
                Ok(header) => headers.push(header),
                Err(error) if still::is_no_picture(&error) => {
                    *kept = false;
                    unread.push(error);
                }
                Err(error) => return Err(named(error)),
            }
        }
        if let Some(first) = unread.first() {
            if headers.is_empty() {
                return Err(named(unread.swap_remove(0)));
            }
            let are = if unread.len() == 1 { "is" } else { "are" };
            let all = text::count(files.len(), "picture");
            self.warnings.push(format!("{} of {all} {are} not read and left out (first: {first})", unread.len()));
            self.retain_frames(&kept);
        }
        Ok(headers)
    }

    /// The most frequent header; frames with others are skipped. For stills, the headers of all
    /// files are read.
    fn common_header(&mut self) -> Result<PictureHeader, RecordingError> {
        let files = match &self.pictures {
            Pictures::Video(video, _) => {
                let Video { width, height, bits, .. } = **video;
                return Ok(PictureHeader { width, height, bits });
            }
            Pictures::Stills(files) => files.clone(),
        };
        let headers = self.headers(&files)?;
        let Pictures::Stills(files) = &self.pictures else { return Err(self.without_frames()) };
        let mut counts: HashMap<PictureHeader, usize> = HashMap::new();
        for header in &headers {
            *counts.entry(*header).or_default() += 1;
        }
        let often = |header: &PictureHeader| counts.get(header).copied().unwrap_or_default();
        // The first one wins a tie.
        let Some(common) = headers.iter().rev().max_by_key(|header| often(header)).copied() else {
            return Err(self.without_frames());
        };
        let differs = headers.iter().position(|header| *header != common);
        if let Some((file, header)) = differs.and_then(|first| Some((files.get(first)?, headers.get(first)?))) {
            let text = |h: &PictureHeader| format!("{}x{} with {} bits", h.width, h.height, h.bits);
            self.warnings.push(format!(
                "left out because most pictures are {}: {} of {} (first: {} is {}); a separate recording can hold them",
                text(&common),
                headers.len() - often(&common),
                text::count(files.len(), "picture"),
                file.display(),
                text(header)
            ));
            self.retain_frames(&headers.iter().map(|header| *header == common).collect::<Vec<_>>());
        }
        match &self.pictures {
            Pictures::Stills(files) if common.width == 0 || common.height == 0 => {
                let file = files.first().map_or(self.path.as_path(), PathBuf::as_path);
                Err(RecordingError::content(file, "the picture has no pixels"))
            }
            _ => Ok(common),
        }
    }
}

/// A track of poses; the error names `file` if they do not ascend.
pub fn track_from(poses: Vec<(f64, Pose)>, max_gap_s: Option<f64>, file: &Path) -> Result<PoseTrack, RecordingError> {
    let max_gap_s = max_gap_s.unwrap_or_else(|| default_max_gap_s(poses.iter().map(|p| p.0)));
    PoseTrack::new(poses, max_gap_s).map_err(|e| RecordingError::content(file, e))
}

/// A camera's geometry from its lens model and named parameters. A value out of range is an error
/// that names it.
pub fn geometry_from(model: LensModel, values: &[(&str, f64)]) -> Result<Geometry, ParamError> {
    let (mut intrinsics, mut distortion) = (Intrinsics::default(), Distortion { model, ..Distortion::default() });
    for (name, value) in values {
        match distortion.get(name) {
            Some(_) => distortion.set(name, &Value::Number(*value))?,
            None => intrinsics.set(name, &Value::Number(*value))?,
        }
    }
    Ok(Geometry::new(intrinsics, distortion))
}

/// A camera without distortion, from fx, fy, cx and cy, px.
pub fn pinhole_geometry([fx, fy, cx, cy]: [f64; 4], width: u32, height: u32) -> Result<Geometry, ParamError> {
    let values = [
        ("width_px", f64::from(width)),
        ("height_px", f64::from(height)),
        ("fx_px", fx),
        ("fy_px", fy),
        ("cx_px", cx),
        ("cy_px", cy),
    ];
    geometry_from(LensModel::Opencv, &values)
}

/// The camera of an equirectangular 360° picture of this size.
pub fn equirectangular(width: u32, height: u32) -> Result<Geometry, String> {
    if u64::from(width) != 2 * u64::from(height) {
        return Err(format!(
            "a 360° picture (equirectangular) is twice as wide as high, and this one is {width}x{height}: crop or scale \
             the frames to 2:1, or name the camera that took them"
        ));
    }
    let sizes = [("width_px", f64::from(width)), ("height_px", f64::from(height))];
    geometry_from(LensModel::Equirectangular, &sizes).map_err(|e| e.to_string())
}

/// The common geometry of all frames that have one; `None` if they differ.
fn common_geometry(geometries: &[Option<Geometry>]) -> Option<Geometry> {
    let mut geometries_of_frames = geometries.iter().flatten();
    let first = geometries_of_frames.next()?;
    geometries_of_frames.all(|other| other == first).then(|| first.clone())
}

fn irregular_intervals(timestamps_s: &[f64], usual_s: f64) -> Option<String> {
    let odd = |pair: &[f64]| !(0.5..=1.5).contains(&((pair[1] - pair[0]) / usual_s));
    let first = timestamps_s.windows(2).position(odd)?;
    let count = timestamps_s.windows(2).filter(|pair| odd(pair)).count();
    let interval_s = timestamps_s[first + 1] - timestamps_s[first];
    Some(format!(
        "time from frame to frame far from the usual {} s: {} (first: {} s between frames {first} and {})",
        text::fixed(usual_s, 4),
        text::count(count, "interval"),
        text::fixed(interval_s, 4),
        first + 1
    ))
}
