//! Views from photographs, folders of them and videos.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use glam::DVec2;

use super::calibration::{NamedView, RejectedView};
use crate::calibrate::board::{BoardDetection, BoardDetector, NotOnPlane, TargetChoice};
use crate::calibrate::is_picture;
use crate::camera::Response;
use crate::parallel::{over_rows, processors};
use crate::source::file::is_lfs_pointer;
use crate::source::video::{Overrides, Video, probe};
use crate::source::{SourceError, still, unsupported};
use crate::text::reason;

/// Approximate number of frames of a video that are searched, evenly spaced.
const MAX_SEARCHED_FRAMES: usize = 180;
/// Largest number of frames of a video that are used.
const MAX_USED_FRAMES: usize = 40;
/// Photographs per processor between two progress reports.
const BATCH: usize = 2;
/// Smallest difference of two views of a video, as a share of the picture's diagonal.
const MIN_DIFFERENCE: f64 = 0.04;
/// Largest motion of a board from frame to frame, as a share of the picture's diagonal; faster
/// boards are blurred, and bent by a rolling shutter.
const MAX_MOTION: f64 = 0.005;

/// Called with the number of completed pictures and of all pictures. A break stops the search.
pub type LensProgress<'a> = &'a mut dyn FnMut(usize, usize) -> ControlFlow<()>;

/// Reason why there are no pictures to search.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error("{}: the folder cannot be read: {}", folder.display(), reason(source))]
    Folder { folder: PathBuf, source: std::io::Error },
    #[error(transparent)]
    NotOnPlane(#[from] NotOnPlane),
    #[error("no photographs: give pictures of a chessboard or of printed tags, folders of them, or a video")]
    Nothing,
    #[error("stopped")]
    Stopped,
}

/// Detected views.
#[derive(Clone, Debug, PartialEq)]
pub struct Views {
    /// Size of all used pictures, px.
    pub size: (u32, u32),
    pub views: Vec<NamedView>,
    pub refused: Vec<RejectedView>,
}

/// Detects boards in photographs, folders of them and videos. Pictures of another size than most
/// are rejected, because they were cropped or scaled. So are those of another kind of board.
/// `response` linearizes the camera's codes.
pub fn views_from_paths(
    paths: &[PathBuf],
    target: &TargetChoice,
    response: &Response,
    progress: LensProgress<'_>,
) -> Result<Views, LoadError> {
    let begin = || BoardDetector::new(target, response);
    let mut search = begin()?;
    let (mut photos, mut videos) = (Vec::new(), Vec::new());
    for path in paths {
        if path.is_dir() {
            photos.extend(pictures_in(path)?);
            // Each is rejected with the command that converts it.
            photos.extend(unsupported::in_folder(path));
        } else if is_picture(path) || unsupported::by_name(path).is_some() || !path.exists() {
            photos.push(path.clone());
        } else {
            videos.push(probe(path, &Overrides::default())?);
        }
    }
    let every = |video: &Video| video.timestamps_s.len().div_ceil(MAX_SEARCHED_FRAMES).max(1);
    let all = photos.len() + videos.iter().map(|video| video.timestamps_s.len().div_ceil(every(video))).sum::<usize>();
    if all == 0 {
        return Err(LoadError::Nothing);
    }
    let mut views = from_photos(&photos, &begin, all, progress)?;
    for video in &videos {
        let done = views.len();
        views.extend(from_video(video, every(video), &mut search, &mut |n| progress(done + n, all))?);
    }
    Ok(keep_majority(views))
}

/// The PNG and JPEG files of a folder, ordered by name.
fn pictures_in(folder: &Path) -> Result<Vec<PathBuf>, LoadError> {
    let failed = |source| LoadError::Folder { folder: folder.to_owned(), source };
    let entries = std::fs::read_dir(folder).map_err(failed)?;
    let mut files: Vec<PathBuf> = entries.map(|entry| Ok(entry?.path())).collect::<Result<_, _>>().map_err(failed)?;
    files.retain(|file| is_picture(file));
    files.sort();
    Ok(files)
}

/// A picture's name, its size, and the detection in it.
struct DetectionAttempt {
    name: String,
    size: (u32, u32),
    detection: Result<BoardDetection, String>,
}

fn keep_majority(photos: Vec<DetectionAttempt>) -> Views {
    let sizes = || photos.iter().filter(|searched| searched.detection.is_ok()).map(|searched| searched.size);
    let often = |size: (u32, u32)| sizes().filter(|own| *own == size).count();
    // The larger of two equally frequent sizes.
    let size = sizes().max_by_key(|size| (often(*size), *size)).unwrap_or_default();
    let kinds = || photos.iter().filter_map(|searched| Some(searched.detection.as_ref().ok()?.target.kind()));
    let kind = kinds().max_by_key(|kind| kinds().filter(|own| own == kind).count()).unwrap_or_default();
    let (mut views, mut refused) = (Vec::new(), Vec::new());
    for DetectionAttempt { name, size: own, detection: photos } in photos {
        match photos {
            Ok(_) if own != size => {
                let reason =
                    format!("is {}x{} px where most are {}x{}: cropped or scaled?", own.0, own.1, size.0, size.1);
                refused.push(RejectedView { name, reason });
            }
            Ok(detection) if detection.target.kind() != kind => {
                let reason = format!("shows {} where most show {kind}", detection.target.kind());
                refused.push(RejectedView { name, reason });
            }
            Ok(detection) => views.push(NamedView { name, detection }),
            Err(reason) => refused.push(RejectedView { name, reason }),
        }
    }
    Views { size, views, refused }
}

/// Reads photographs on all processors, and keeps their order.
fn from_photos(
    files: &[PathBuf],
    begin: &(impl Fn() -> Result<BoardDetector, NotOnPlane> + Sync),
    all: usize,
    progress: LensProgress<'_>,
) -> Result<Vec<DetectionAttempt>, LoadError> {
    let read = |file: &Path| {
        let name = file.display().to_string();
        match still::read_pixels(file) {
            Ok(pixels) => {
                let detection = begin()?.find(&pixels);
                Ok(DetectionAttempt { name, size: (pixels.width, pixels.height), detection })
            }
            // A damaged file is skipped. A missing file is an error.
            Err(SourceError::Content { problem, .. }) => {
                Ok(DetectionAttempt { name, size: (0, 0), detection: Err(problem) })
            }
            Err(SourceError::Read { source, .. }) if is_lfs_pointer(&source) => {
                Ok(DetectionAttempt { name, size: (0, 0), detection: Err(reason(&source)) })
            }
            Err(error) => Err(error.into()),
        }
    };
    let mut searched_photos = Vec::new();
    for batch in files.chunks(BATCH * processors()) {
        if progress(searched_photos.len(), all).is_break() {
            return Err(LoadError::Stopped);
        }
        let mut searched: Vec<Option<Result<DetectionAttempt, LoadError>>> = batch.iter().map(|_| None).collect();
        over_rows(&mut searched, 1, processors(), |n, slot| slot[0] = batch.get(n).map(|file| read(file)));
        for searched in searched.into_iter().flatten() {
            searched_photos.push(searched?);
        }
    }
    Ok(searched_photos)
}

/// Selects frames of a video: the most static first, each different from those before.
fn from_video(
    video: &Video,
    every: usize,
    search: &mut BoardDetector,
    progress: &mut dyn FnMut(usize) -> ControlFlow<()>,
) -> Result<Vec<DetectionAttempt>, LoadError> {
    let count = video.timestamps_s.len();
    let mut detections: Vec<(usize, BoardDetection)> = Vec::new();
    for (n, pixels) in video.read(0..count)?.enumerate() {
        let pixels = pixels?;
        if n % every == 0 {
            if progress(n / every).is_break() {
                return Err(LoadError::Stopped);
            }
            detections.extend(search.find(&pixels).ok().map(|detection| (n, detection)));
        }
    }
    let size = (video.width, video.height);
    let name = |frame: usize| format!("{} frame {frame}", video.file.display());
    let chosen = stillest(&detections, f64::from(size.0).hypot(f64::from(size.1)));
    if chosen.is_empty() {
        let what = if detections.is_empty() {
            "no board is seen in any frame"
        } else {
            "the board moves too fast in all frames"
        };
        return Ok(vec![DetectionAttempt {
            name: video.file.display().to_string(),
            size,
            detection: Err(what.to_owned()),
        }]);
    }
    Ok(chosen
        .into_iter()
        .map(|i| DetectionAttempt { name: name(detections[i].0), size, detection: Ok(detections[i].1.clone()) })
        .collect())
}

/// Position, size and shear of a board in the picture, as points that move with it, px.
fn position_marks(detection: &BoardDetection) -> [DVec2; 3] {
    let count = detection.corners_px.len().max(1) as f64;
    let middle = detection.corners_px.iter().sum::<DVec2>() / count;
    let from_middle = || detection.corners_px.iter().map(|at| *at - middle);
    let wide = (from_middle().map(|p| p * p).sum::<DVec2>() / count).map(f64::sqrt);
    let skew = from_middle().map(|p| p.x * p.y).sum::<f64>() / count / (wide.x + wide.y).max(1e-9);
    [middle, wide, DVec2::new(skew, 0.0)]
}

fn difference_px(a: &BoardDetection, b: &BoardDetection) -> f64 {
    position_marks(a).iter().zip(position_marks(b)).map(|(a, b)| a.distance(b)).fold(0.0, f64::max)
}

/// Indices of the selected views, ascending: those that move least, each different from the others.
/// `diagonal_px` is that of the picture.
fn stillest(detections: &[(usize, BoardDetection)], diagonal_px: f64) -> Vec<usize> {
    // Motion since the previous frame; for the first frame, until the next one.
    let moved = |i: usize| match (detections.get(i.max(1) - 1), detections.get(i.max(1))) {
        (Some(before), Some(own)) => difference_px(&own.1, &before.1) / (own.0 - before.0).max(1) as f64,
        _ => 0.0,
    };
    let mut order: Vec<(f64, usize)> = (0..detections.len()).map(|i| (moved(i), i)).collect();
    order.retain(|(moved, _)| *moved <= MAX_MOTION * diagonal_px);
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let differ = MIN_DIFFERENCE * diagonal_px;
    let mut chosen: Vec<usize> = Vec::new();
    for (_, i) in order {
        if chosen.len() < MAX_USED_FRAMES
            && chosen.iter().all(|other| difference_px(&detections[i].1, &detections[*other].1) > differ)
        {
            chosen.push(i);
        }
    }
    chosen.sort_unstable();
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::board::{ChessboardSize, DetectedTarget};

    /// A board whose corners are a grid with spacing `side` px, from a point.
    fn detection(x: f64, y: f64, side: f64) -> BoardDetection {
        let board: Vec<DVec2> = (0..20).map(|i| DVec2::new(f64::from(i % 5), f64::from(i / 5))).collect();
        let corners_px = board.iter().map(|place| DVec2::new(x, y) + side * *place).collect();
        BoardDetection { board, corners_px, target: DetectedTarget::Chessboard(ChessboardSize::new(5, 4)) }
    }

    #[test]
    fn video_frames_at_rest_that_differ_are_selected() {
        // At rest, fast motion, at rest elsewhere, closer, at rest.
        let places =
            [(0.0, 30.0), (0.5, 30.0), (80.0, 30.0), (160.0, 30.0), (160.2, 30.0), (160.2, 45.0), (160.3, 45.0)];
        let views: Vec<(usize, BoardDetection)> =
            places.iter().enumerate().map(|(i, (x, side))| (3 * i, detection(*x, 40.0, *side))).collect();
        assert_eq!(stillest(&views, 750.0), [0, 4, 6]);
        assert_eq!(stillest(&views[..1], 750.0), [0]);
        assert_eq!(stillest(&[], 750.0), Vec::<usize>::new());
    }

    #[test]
    fn pictures_of_another_size_are_refused_with_both_sizes() {
        let one = |name: &str, size, detection| DetectionAttempt { name: name.to_owned(), size, detection };
        let good = || Ok(detection(0.0, 0.0, 20.0));
        let views = keep_majority(vec![
            one("a", (640, 480), good()),
            one("b", (1281, 721), good()),
            one("c", (640, 480), good()),
            one("d", (1281, 721), Err("nothing there".to_owned())),
        ]);
        assert_eq!(views.size, (640, 480));
        assert_eq!(views.views.iter().map(|view| view.name.as_str()).collect::<Vec<_>>(), ["a", "c"]);
        let reasons: Vec<&str> = views.refused.iter().map(|refused| refused.reason.as_str()).collect();
        assert_eq!(reasons, ["is 1281x721 px where most are 640x480: cropped or scaled?", "nothing there"]);
    }
}
