//! Solves a piece of footage.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};

use super::colmap::{self, ColmapInputs, ColmapOptions, ReportStage};
use super::error::{SolveError, SolveStage};
use super::footage::FootageFrames;
use super::gauge::{GaugeInputs, MeasuredDistance, WorldGauge, gauge};
use super::keyframes::{MAX_KEYFRAMES, MotionMeter, choose};
use super::patch::LumaPyramid;
use super::resection::{PosedFrame, Resection, resect};
use crate::camera::{Geometry, Response};
use crate::cleanup::{Undo, UndoGuard};
use crate::fit::quantile::upper_median;
use crate::parallel::{over_rows, processors};
use crate::pixels::{Codes, Pixels};
use crate::pose::Pose;
use crate::recording::colmap::ColmapModel;
use crate::sink::folder::write_frame;
use crate::source::still;
use crate::tags::{Board, LumaCodes};

/// Smallest share of the chosen frames in the largest model.
const MIN_MODEL_SHARE: f64 = 0.3;
/// Accepted focal lengths, by the picture's width: 150° to 6°.
const FOCAL_BY_WIDTH: std::ops::RangeInclusive<f64> = 0.13..=10.0;
/// Pyramid levels for tracking landmarks.
const LEVELS: usize = 4;
/// Largest number of frames between two solved ones that are held in memory.
const MAX_HELD_FRAMES: usize = 64;

/// The known properties of the footage.
#[derive(Debug)]
pub struct SolveOptions<'a> {
    /// A calibrated camera; it is not refined.
    pub camera: Option<&'a Geometry>,
    pub response: &'a Response,
    /// A board of tags in the pictures: the one named, or the usual one.
    pub board: &'a Board,
    pub is_board_named: bool,
    pub distance: Option<MeasuredDistance>,
}

/// How a frame's pose is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolvedFrame {
    /// Camera from world.
    pub pose: Pose,
    /// True for a frame of the model, false for one posed by its neighbours' landmarks.
    pub is_keyframe: bool,
    /// Number of landmarks, and the root mean square of their residuals, px.
    pub landmarks: usize,
    pub rms_px: f64,
}

/// The camera's motion and lens.
#[derive(Debug)]
pub struct Solution {
    pub geometry: Geometry,
    /// True if the camera was given.
    pub is_camera_given: bool,
    pub times_s: Vec<f64>,
    /// One for each frame.
    pub frames: Vec<Option<SolvedFrame>>,
    /// Number of frames that were chosen, and of landmarks.
    pub chosen: usize,
    pub landmarks: usize,
    pub gauge: WorldGauge,
    /// Chosen frames of further models, which do not fit the largest one.
    pub apart: Vec<Vec<usize>>,
}

/// Solves footage. `report` receives the progress.
pub fn solve(
    footage: &FootageFrames,
    options: &SolveOptions<'_>,
    report: ReportStage<'_>,
) -> Result<Solution, SolveError> {
    let (width, height) = footage.size();
    if let Some(intrinsics) = options.camera.map(|camera| &camera.intrinsics)
        && (intrinsics.width_px, intrinsics.height_px) != (width, height)
    {
        let camera = (intrinsics.width_px, intrinsics.height_px);
        return Err(SolveError::CameraSize { footage: (width, height), camera });
    }
    if let (FootageFrames::Video(video), None) = (footage, options.camera)
        && let Some(aspect) = video.presentation.pixel_aspect
    {
        return Err(SolveError::PixelAspect { file: video.file.clone(), aspect });
    }
    let count = footage.frame_count();
    if count < 3 {
        return Err(SolveError::TooFew(count));
    }
    let is_inside =
        |at_px: &DVec2| at_px.cmpge(DVec2::ZERO).all() && at_px.cmplt(DVec2::new(width.into(), height.into())).all();
    if let Some(distance) = &options.distance
        && !(distance.frame < count && distance.points_px.iter().all(is_inside))
    {
        return Err(SolveError::DistanceOutside { frame: distance.frame, count, size: (width, height) });
    }
    // Before the video is decoded: a missing program is reported at once.
    let program = ColmapOptions::of_installed()?;
    let (folder, _unfinished) = temporary_folder()?;
    let chosen = ChosenFrames::of(footage, folder.path(), report)?;
    let names = chosen.names();
    let inputs = ColmapInputs {
        folder: folder.path(),
        images: &chosen.folder,
        names: &names,
        matching: footage.matching(),
        camera: options.camera,
    };
    let mut models = colmap::models(&inputs, &program, report)?.into_iter();
    let model = models.next().ok_or(SolveError::NoModel)?;
    let in_model = chosen.frames_of(&model);
    // Models overlap.
    let rest = |model: ColmapModel| {
        chosen.frames_of(&model).into_iter().filter(|i| in_model.binary_search(i).is_err()).collect()
    };
    let apart: Vec<Vec<usize>> = models.map(rest).filter(|frames: &Vec<usize>| !frames.is_empty()).collect();
    if in_model.len() < 3 || (in_model.len() as f64) < MIN_MODEL_SHARE * names.len() as f64 {
        let span = in_model.first().copied().unwrap_or_default()..=in_model.last().copied().unwrap_or_default();
        return Err(SolveError::SmallModel { frames: in_model.len(), chosen: names.len(), span });
    }
    let geometry = match options.camera {
        Some(camera) => camera.clone(),
        None => model.cameras.values().next().cloned().ok_or(SolveError::NoModel)?,
    };
    let focal_px = geometry.intrinsics.fx_px;
    if !FOCAL_BY_WIDTH.contains(&(focal_px / f64::from(width))) {
        return Err(SolveError::Focal { focal_px, width_px: width });
    }
    let posed = posed_frames(&model, &chosen);
    let mut frames: Vec<Option<SolvedFrame>> = vec![None; count];
    for frame in &posed {
        let rms_px = residual_rms_px(&geometry, frame);
        frames[frame.frame] =
            Some(SolvedFrame { pose: frame.pose, is_keyframe: true, landmarks: frame.landmarks.len(), rms_px });
    }
    pose_others(footage, &geometry, &posed, &mut frames, report)?;
    let light = LumaCodes::table(options.response);
    let gauge = gauge(
        &GaugeInputs {
            geometry: &geometry,
            frames: &posed,
            board: options.board,
            is_board_named: options.is_board_named,
            light: &light,
        },
        options.distance.as_ref(),
        &|frame| chosen.read(frame),
    )?;
    for frame in frames.iter_mut().flatten() {
        frame.pose = gauge.world_from_model.transform_pose(&frame.pose);
    }
    Ok(Solution {
        geometry,
        is_camera_given: options.camera.is_some(),
        times_s: footage.times_s(),
        frames,
        chosen: names.len(),
        landmarks: model.landmarks.len(),
        gauge,
        apart,
    })
}

/// A folder for pictures and COLMAP's files. Removed at the end, also of an interrupted program.
fn temporary_folder() -> Result<(tempfile::TempDir, UndoGuard), SolveError> {
    let made = UndoGuard::begin(|| {
        let folder = tempfile::Builder::new().prefix("locard-solve-").tempdir()?;
        let path = folder.path().to_owned();
        let undo: Undo = Box::new(move || _ = std::fs::remove_dir_all(path));
        Ok((folder, undo))
    });
    made.map_err(SolveError::writing(&std::env::temp_dir()))
}

/// The frames that are solved, as pictures in a folder.
struct ChosenFrames {
    folder: PathBuf,
    /// Frame by file name.
    frames: BTreeMap<String, usize>,
}

impl ChosenFrames {
    /// Photographs stay where they are. Of a video the chosen frames are written.
    fn of(footage: &FootageFrames, work: &Path, report: ReportStage<'_>) -> Result<Self, SolveError> {
        if let FootageFrames::Pictures { files, .. } = footage
            && footage.is_unordered()
        {
            let folder = files.first().and_then(|file| file.parent()).unwrap_or(Path::new("")).to_owned();
            let name = |file: &PathBuf| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            return Ok(Self { folder, frames: files.iter().enumerate().map(|(i, file)| (name(file), i)).collect() });
        }
        let count = footage.frame_count();
        let mut meter = MotionMeter::default();
        let mut motions = Vec::with_capacity(count);
        for pixels in footage.pixels(0..count)? {
            motions.push(meter.measure(&pixels?));
            // Half of this stage: the chosen frames are read again.
            if report(SolveStage::Selection, motions.len() / 2, count).is_break() {
                return Err(SolveError::Stopped);
            }
        }
        let chosen = choose(&motions, &footage.times_s(), MAX_KEYFRAMES);
        let folder = work.join("frames");
        std::fs::create_dir(&folder).map_err(SolveError::writing(&folder))?;
        let mut frames = BTreeMap::new();
        let last = chosen.last().map_or(0, |last| last + 1);
        for (i, pixels) in footage.pixels(0..last)?.enumerate() {
            let pixels = pixels?;
            if chosen.binary_search(&i).is_ok() {
                let name = format!("{i:06}.png");
                let file = folder.join(&name);
                write_frame(&file, &eight_bit(pixels), None, None, true)
                    .map_err(|error| SolveError::Write { path: file.clone(), source: std::io::Error::other(error) })?;
                frames.insert(name, i);
            }
            if report(SolveStage::Selection, (count + i) / 2, count).is_break() {
                return Err(SolveError::Stopped);
            }
        }
        Ok(Self { folder, frames })
    }

    fn names(&self) -> Vec<String> {
        let mut names: Vec<(&String, &usize)> = self.frames.iter().collect();
        names.sort_by_key(|(_, frame)| **frame);
        names.into_iter().map(|(name, _)| name.clone()).collect()
    }

    fn frames_of(&self, model: &ColmapModel) -> Vec<usize> {
        let mut frames: Vec<usize> =
            model.images.iter().filter_map(|image| self.frames.get(&image.name).copied()).collect();
        frames.sort_unstable();
        frames
    }

    fn read(&self, frame: usize) -> Result<Pixels, SolveError> {
        let name = self.frames.iter().find(|(_, other)| **other == frame).map(|(name, _)| name.as_str());
        Ok(still::read_pixels(&self.folder.join(name.unwrap_or_default()))?)
    }
}

/// COLMAP detects features in 8 bits.
fn eight_bit(pixels: Pixels) -> Pixels {
    let codes = Codes::U8(pixels.codes.to_eight_bit().into_owned());
    Pixels::uncoded(pixels.width, pixels.height, codes)
}

/// The frames of a model, ascending.
fn posed_frames(model: &ColmapModel, chosen: &ChosenFrames) -> Vec<PosedFrame> {
    let mut posed: Vec<PosedFrame> = model
        .images
        .iter()
        .filter_map(|image| {
            let at = |number: u64| model.landmarks.get(&number).copied();
            let landmarks = image.landmarks.iter().filter_map(|landmark| {
                Some((at(landmark.number)?, DVec2::new(landmark.at_px[0].into(), landmark.at_px[1].into())))
            });
            Some(PosedFrame {
                frame: *chosen.frames.get(&image.name)?,
                pose: image.camera_from_world,
                landmarks: landmarks.collect(),
            })
        })
        .collect();
    posed.sort_by_key(|frame| frame.frame);
    posed
}

fn residual_rms_px(geometry: &Geometry, frame: &PosedFrame) -> f64 {
    let residual = |(point, observed_px): &(DVec3, DVec2)| {
        Some(geometry.project(frame.pose.transform_point(*point))?.distance_squared(*observed_px))
    };
    let squares: Vec<f64> = frame.landmarks.iter().filter_map(residual).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// Poses the frames between those of the model, before the first and after the last.
fn pose_others(
    footage: &FootageFrames,
    geometry: &Geometry,
    posed: &[PosedFrame],
    frames: &mut [Option<SolvedFrame>],
    report: ReportStage<'_>,
) -> Result<(), SolveError> {
    // Photographs that are not in the model have no neighbours in time.
    if footage.is_unordered() {
        return Ok(());
    }
    let count = frames.len();
    let mut pictures = footage.pixels(0..count)?;
    let mut before: Option<(&PosedFrame, LumaPyramid)> = None;
    let mut batch: Vec<(usize, LumaPyramid)> = Vec::new();
    for i in 0..count {
        let Some(pixels) = pictures.next() else { break };
        let picture = LumaPyramid::of(&pixels?, LEVELS);
        let here = posed.iter().find(|posed| posed.frame == i);
        match here {
            Some(here) => {
                let after = (here, picture);
                let neighbours: Vec<_> = before.iter().chain([&after]).map(|(posed, p)| (*posed, p)).collect();
                resect_held(geometry, &neighbours, &mut batch, frames);
                before = Some(after);
            }
            None => batch.push((i, picture)),
        }
        // Long stretches without a frame of the model, and the end of the footage.
        if batch.len() >= MAX_HELD_FRAMES || i + 1 == count {
            let neighbours: Vec<_> = before.iter().map(|(posed, p)| (*posed, p)).collect();
            resect_held(geometry, &neighbours, &mut batch, frames);
        }
        if report(SolveStage::Poses, i + 1, count).is_break() {
            return Err(SolveError::Stopped);
        }
    }
    Ok(())
}

/// Poses the held frames by one or two neighbours, and empties the list.
fn resect_held(
    geometry: &Geometry,
    neighbours: &[(&PosedFrame, &LumaPyramid)],
    batch: &mut Vec<(usize, LumaPyramid)>,
    frames: &mut [Option<SolvedFrame>],
) {
    let initial = |i: usize| match neighbours {
        [] => None,
        [(only, _)] => Some(only.pose),
        [(a, _), (b, _), ..] => {
            let fraction = (i - a.frame) as f64 / (b.frame - a.frame).max(1) as f64;
            Some(a.pose.interpolate(&b.pose, fraction))
        }
    };
    let mut resections: Vec<Option<Resection>> = vec![None; batch.len()];
    over_rows(&mut resections, 1, processors(), |n, resections| {
        let (i, picture) = &batch[n];
        resections[0] = initial(*i).and_then(|initial| resect(geometry, neighbours, picture, &initial));
    });
    for ((i, _), resections) in batch.drain(..).zip(resections) {
        frames[i] = resections.map(|resections| SolvedFrame {
            pose: resections.pose,
            is_keyframe: false,
            landmarks: resections.fitting,
            rms_px: resections.rms_px,
        });
    }
}

impl Solution {
    /// Runs of frames without a pose.
    pub fn unsolved_ranges(&self) -> Vec<Range<usize>> {
        let mut runs: Vec<Range<usize>> = Vec::new();
        for (i, _) in self.frames.iter().enumerate().filter(|(_, frame)| frame.is_none()) {
            match runs.last_mut().filter(|run| run.end == i) {
                Some(run) => run.end = i + 1,
                None => runs.push(i..i + 1),
            }
        }
        runs
    }

    /// Median over frames of the root mean square residual, px.
    pub fn median_residual_px(&self) -> f64 {
        upper_median(self.frames.iter().flatten().map(|frame| frame.rms_px)).unwrap_or(f64::NAN)
    }
}
