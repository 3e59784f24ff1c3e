//! Depth pictures of a recording: association with frames, and registration to their picture.

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::RecordingError;
use crate::camera::Geometry;
use crate::depth::{DepthCamera, is_same_aspect, upsampled};
use crate::pixels::DepthMap;
use crate::source::SourceError;
use crate::source::depth_map::{self, DepthHeader};
use crate::source::still;
use crate::text::count;

/// Encoding of depth pictures, and their view.
#[derive(Debug)]
pub struct DepthEncoding {
    pub codes_per_metre: f64,
    /// Smallest code that marks an unmeasured pixel, in addition to 0.
    pub invalid_from: Option<u16>,
    /// Folder of confidence pictures with the same names: pixels with confidence 0 count as not
    /// measured.
    pub confidence_folder: Option<PathBuf>,
    /// The depth camera. `None`: the depth has the frames' view, at any size.
    pub camera: Option<DepthCamera>,
    /// Key or file by which the recording can specify the unit, if `codes_per_metre` is the
    /// format's default.
    pub unit_advice: Option<&'static str>,
}

impl DepthEncoding {
    /// Registered to the frames; only code 0 is invalid.
    pub fn plain(codes_per_metre: f64) -> Self {
        Self { codes_per_metre, invalid_from: None, confidence_folder: None, camera: None, unit_advice: None }
    }

    fn confidence_file(&self, depth: &Path) -> Option<PathBuf> {
        Some(self.confidence_folder.as_ref()?.join(depth.file_name()?))
    }
}

/// Depth pictures in ascending order of time.
#[derive(Debug)]
pub struct DepthFiles {
    pub by_time: Vec<(f64, PathBuf)>,
    pub stored: DepthEncoding,
}

/// Registration of the depth to the frames' picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthRegistration {
    /// The depth has the frames' size and view.
    SameView,
    /// The depth has the frames' view at this size, px.
    Enlarged(u32, u32),
    /// The depth was measured by a separate camera with this size, px.
    OtherCamera(u32, u32),
    /// The depth's view is unknown; its size is in px. It is not used for occlusion.
    Unknown(u32, u32),
}

/// Depth of an opened recording.
#[derive(Debug)]
pub struct Depth {
    /// The nearest picture in time of each frame: time of measurement, seconds, and file.
    of_frame: Vec<Option<(f64, PathBuf)>>,
    confidence: Vec<PathBuf>,
    stored: DepthEncoding,
    pub registration: DepthRegistration,
    /// Pictures that could not be decoded, with the reason.
    undecoded: Mutex<BTreeMap<PathBuf, String>>,
}

/// True if an error concerns one picture only, whose frame then has no depth. Pipes and devices are
/// refused.
fn is_of_one_picture(error: &SourceError) -> bool {
    match error {
        SourceError::Content { .. } => true,
        SourceError::Read { source, .. } => source.kind() == ErrorKind::NotFound,
        _ => false,
    }
}

/// Warning that `number` of `all` depth pictures cannot be read, with the error of the first.
fn unreadable(number: usize, all: usize, first: &str) -> String {
    let frames = if number == 1 { "its frames have" } else { "their frames have" };
    format!("{number} of {} cannot be read, and {frames} no depth (first: {first})", count(all, "depth picture"))
}

/// Warning that the unit of floating-point depth is the format's default.
fn assumed_unit_warning(file: &Path, codes_per_metre: f64, unit_advice: &str) -> String {
    let unit = crate::text::number(1.0 / codes_per_metre);
    format!(
        "{}: holds floating-point depth, and the recording does not give its unit: {unit} m is taken; if it is in metres, \
         {unit_advice}",
        file.display()
    )
}

impl Depth {
    /// The encoding as text that changes with it, for comparison.
    pub fn stored(&self) -> String {
        let DepthEncoding { codes_per_metre, invalid_from, camera, .. } = &self.stored;
        let camera = camera.as_ref().map(|camera| camera.identity());
        format!("{codes_per_metre} {invalid_from:?} {camera:?}")
    }

    /// Reads the header of every picture. A frame whose depth picture cannot be read has no depth.
    /// `size` is the frames'. Also returns warnings about pictures that cannot be read or do not
    /// fit the frames.
    pub fn new(
        mut of_frame: Vec<Option<(f64, PathBuf)>>,
        stored: DepthEncoding,
        size: (u32, u32),
    ) -> Result<(Self, Vec<String>), RecordingError> {
        let (mut registration, mut warning) = (DepthRegistration::SameView, None);
        // One depth picture may serve several frames.
        let files: BTreeSet<PathBuf> = of_frame.iter().flatten().map(|(_, file)| file.clone()).collect();
        let mut unread: BTreeMap<&PathBuf, String> = BTreeMap::new();
        let (mut confidence, mut first_float) = (Vec::new(), None);
        for file in &files {
            let beside = stored.confidence_file(file);
            let headers = depth_map::read_header(file).and_then(|header| {
                beside.as_deref().map(still::read_header).transpose()?;
                Ok(header)
            });
            let DepthHeader { width, height, is_float } = match headers {
                Ok(header) => header,
                Err(error) if is_of_one_picture(&error) => {
                    unread.insert(file, error.to_string());
                    continue;
                }
                Err(error) => return Err(error.into()),
            };
            confidence.extend(beside);
            first_float = first_float.or(is_float.then_some(file));
            let from_camera = match &stored.camera {
                Some(camera) if camera.size() != (width, height) => {
                    return Err(RecordingError::content(file, other_size((width, height), camera.size())));
                }
                Some(_) => DepthRegistration::OtherCamera(width, height),
                None if (width, height) == size => continue,
                None if is_same_aspect((width, height), size) => DepthRegistration::Enlarged(width, height),
                None => DepthRegistration::Unknown(width, height),
            };
            if matches!(from_camera, DepthRegistration::Unknown(..)) && warning.is_none() {
                warning = Some(format!(
                    "{}: depth is {width}x{height}, the frames are {}x{}: with another aspect ratio it cannot occlude \
                     (describe its camera by `camera` in [depth] of a recording.toml)",
                    file.display(),
                    size.0,
                    size.1
                ));
            }
            if !matches!(registration, DepthRegistration::Unknown(..)) {
                registration = from_camera;
            }
        }
        for depth in &mut of_frame {
            depth.take_if(|(_, file)| unread.contains_key(file));
        }
        let unreadable = unread.values().next().map(|first| unreadable(unread.len(), files.len(), first));
        let unsure = first_float
            .zip(stored.unit_advice)
            .map(|(file, by)| assumed_unit_warning(file, stored.codes_per_metre, by));
        let warnings = unreadable.into_iter().chain(warning).chain(unsure).collect();
        let depth = Self { of_frame, confidence, stored, registration, undecoded: Mutex::default() };
        Ok((depth, warnings))
    }

    /// Warning about the pictures that could not be decoded so far.
    pub fn undecoded(&self) -> Option<String> {
        let undecoded = self.undecoded.lock().unwrap_or_else(PoisonError::into_inner);
        let all: BTreeSet<&PathBuf> = self.of_frame.iter().flatten().map(|(_, file)| file).collect();
        undecoded.values().next().map(|first| unreadable(undecoded.len(), all.len(), first))
    }

    /// The number of files, and an error for each truncated one. Their depth counts as not decoded.
    pub fn check_ends(&self) -> (usize, Vec<SourceError>) {
        let depth: BTreeSet<&PathBuf> = self.of_frame.iter().flatten().map(|(_, file)| file).collect();
        let (mut count, mut problems) = (0, Vec::new());
        let mut undecoded = self.undecoded.lock().unwrap_or_else(PoisonError::into_inner);
        for file in depth {
            let confidence = self.stored.confidence_file(file);
            let ends = [Some(depth_map::check_end(file)), confidence.map(|confidence| still::check_end(&confidence))];
            for end in ends.into_iter().flatten() {
                count += 1;
                if let Err(error) = end {
                    undecoded.entry(file.clone()).or_insert_with(|| error.to_string());
                    problems.push(error);
                }
            }
        }
        (count, problems)
    }

    pub fn has_any(&self) -> bool {
        self.of_frame.iter().any(Option::is_some)
    }

    /// All files that are read: depth and confidence.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.of_frame.iter().flatten().map(|(_, file)| file).chain(&self.confidence).map(PathBuf::as_path)
    }

    /// A frame's depth registered to its picture of this `size`, taken by `camera`. `None` without
    /// depth, if its picture cannot be decoded, or if a separate camera measured it and the frames'
    /// camera is unknown.
    pub fn read(
        &self,
        frame: usize,
        size: (u32, u32),
        camera: Option<&Geometry>,
    ) -> Result<Option<DepthMap>, SourceError> {
        let Some((time_s, file)) = self.of_frame.get(frame).and_then(Option::as_ref) else { return Ok(None) };
        self.read_file(file, *time_s, size, camera).or_else(|error| {
            if !is_of_one_picture(&error) {
                return Err(error);
            }
            let mut undecoded = self.undecoded.lock().unwrap_or_else(PoisonError::into_inner);
            undecoded.insert(file.clone(), error.to_string());
            Ok(None)
        })
    }

    fn read_file(
        &self,
        file: &Path,
        time_s: f64,
        size: (u32, u32),
        camera: Option<&Geometry>,
    ) -> Result<Option<DepthMap>, SourceError> {
        let map = self.measured(file, time_s)?;
        Ok(match (&self.stored.camera, camera) {
            (Some(_), None) => None,
            (Some(own), Some(camera)) if own.size() == (map.width, map.height) => Some(own.registered(&map, camera)),
            (Some(own), _) => {
                let problem = other_size((map.width, map.height), own.size());
                return Err(SourceError::Content { file: file.to_owned(), problem });
            }
            (None, _) if (map.width, map.height) != size && is_same_aspect((map.width, map.height), size) => {
                Some(upsampled(&map, size.0, size.1))
            }
            (None, _) => Some(map),
        })
    }

    /// The depth map as measured, 0 where invalid.
    fn measured(&self, file: &Path, time_s: f64) -> Result<DepthMap, SourceError> {
        let codes_per_metre = self.stored.codes_per_metre;
        let mut map = depth_map::read(file, codes_per_metre, time_s)?;
        if let Some(code) = self.stored.invalid_from {
            let unknown_from_m = (f64::from(code) / codes_per_metre) as f32;
            map.depth_m.iter_mut().filter(|z| **z >= unknown_from_m).for_each(|z| *z = 0.0);
        }
        if let Some(confidence) = self.stored.confidence_file(file) {
            let sure = still::read_pixels(&confidence)?;
            if (sure.width, sure.height) != (map.width, map.height) {
                let problem = format!("is {}x{}, its depth {}x{}", sure.width, sure.height, map.width, map.height);
                return Err(SourceError::Content { file: confidence, problem });
            }
            let places = (0..map.height).flat_map(|y| (0..map.width).map(move |x| (x, y)));
            for (z, (x, y)) in map.depth_m.iter_mut().zip(places) {
                if sure.at(x, y)[0] == 0 {
                    *z = 0.0;
                }
            }
        }
        Ok(map)
    }
}

fn other_size(size_px: (u32, u32), camera: (u32, u32)) -> String {
    format!("is {}x{}, the depth camera's pictures are {}x{}", size_px.0, size_px.1, camera.0, camera.1)
}
