//! Duplicate frames, and removal of frames.

use std::ops::Range;

use super::frames::SelectedFrames;
use super::parts::{Parts, Pictures};
use super::{Recording, RecordingError};
use crate::pixels::Pixels;
use crate::source::ahead::Ahead;
use crate::source::still;
use crate::text::count;

/// Indices of frames that repeat a property of the previous frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Duplicates {
    /// Equal pictures.
    pub pictures: Vec<usize>,
    /// Equal pictures with different poses.
    pub moved: Vec<usize>,
    /// Equal poses with different pictures. Empty if the camera is at rest throughout.
    pub poses: Vec<usize>,
    /// Equal timestamps.
    pub times: Vec<usize>,
}

impl Recording {
    /// Finds duplicates. Every picture is decoded; `each` is called after each. An unreadable still
    /// counts as different ([`Recording::check_ends`] finds it).
    pub fn repeats(&self, mut each: impl FnMut()) -> Result<Duplicates, RecordingError> {
        let frames = 0..self.frame_count();
        let mut pictures = Vec::new();
        repeating(&self.pictures, frames.clone(), |frame, repeats| {
            pictures.extend(repeats.then_some(frame));
            each();
        })?;
        let poses: Vec<_> = frames.clone().map(|frame| self.pose_at_frame(frame).ok()).collect();
        let stays = |frame: usize| poses[frame].is_some() && poses[frame] == poses[frame - 1];
        let later = || frames.clone().skip(1);
        let repeats = |frame: &usize| pictures.binary_search(frame).is_ok();
        let rests = later().all(|frame| poses[frame].is_none() || stays(frame));
        Ok(Duplicates {
            moved: pictures.iter().copied().filter(|frame| poses[*frame].is_some() && !stays(*frame)).collect(),
            poses: later().filter(|frame| !rests && stays(*frame) && !repeats(frame)).collect(),
            times: later().filter(|frame| self.timestamps_s[*frame] == self.timestamps_s[frame - 1]).collect(),
            pictures,
        })
    }
}

/// Calls `on_frame` for each frame, in order, with true if its picture has the code values of the
/// previous one.
fn repeating(
    pictures: &Pictures,
    frames: Range<usize>,
    mut on_frame: impl FnMut(usize, bool),
) -> Result<(), RecordingError> {
    let mut before: Option<Pixels> = None;
    let mut next = |frame: usize, pixels: Option<Pixels>| {
        on_frame(frame, pixels.is_some() && pixels == before);
        before = pixels;
    };
    match pictures {
        Pictures::Stills(files) => {
            let files = files.clone();
            let read = move |i: usize| files.get(i).and_then(|file| still::read_pixels(file).ok());
            for (frame, pixels) in frames.clone().zip(Ahead::new(frames, read)?) {
                next(frame, pixels?);
            }
        }
        Pictures::Video(video, kept) => {
            let decoded = SelectedFrames::new(video, kept.as_deref(), frames.clone())?;
            for (frame, pixels) in frames.zip(decoded) {
                next(frame, Some(pixels?));
            }
        }
    }
    Ok(())
}

impl Parts {
    /// Removes frames whose picture is missing, and missing depth pictures.
    pub fn remove_missing(&mut self) {
        let Pictures::Stills(files) = &self.pictures else { return };
        let there: Vec<bool> = files.iter().map(|file| file.exists()).collect();
        if let Some(first) = there.iter().position(|there| !there) {
            let missing = there.iter().filter(|there| !**there).count();
            let first = files[first].display().to_string();
            let of = count(there.len(), "picture");
            self.warnings.push(format!("{missing} of {of} are missing and left out (first: {first})"));
            self.retain_frames(&there);
        }
        if let Some(depth) = &mut self.depth {
            let all = depth.by_time.len();
            depth.by_time.retain(|(_, file)| file.exists());
            let missing = all - depth.by_time.len();
            if missing > 0 {
                self.warnings.push(format!("{missing} of {} are missing and left out", count(all, "depth picture")));
            }
        }
    }

    /// Removes frames that repeat the previous one.
    pub fn remove_duplicates(&mut self) -> Result<(), RecordingError> {
        let mut differs = vec![true; self.timestamps_s.len()];
        repeating(&self.pictures, 0..self.timestamps_s.len(), |frame, repeats| differs[frame] = !repeats)?;
        let repeated = differs.iter().filter(|differs| !**differs).count();
        if repeated > 0 {
            let of = count(differs.len(), "frame");
            self.warnings.push(format!("{repeated} of {of} repeat the one before and are left out"));
            self.retain_frames(&differs);
        }
        Ok(())
    }

    /// Keeps the frames marked in `kept`. Poses, depth and exposure stay: they are associated by
    /// time.
    pub(super) fn retain_frames(&mut self, kept: &[bool]) {
        fn retain<T>(values: &mut Vec<T>, kept: &[bool]) {
            let mut kept = kept.iter();
            values.retain(|_| kept.next().copied().unwrap_or(true));
        }
        match &mut self.pictures {
            Pictures::Stills(files) => retain(files, kept),
            Pictures::Video(video, numbers) => {
                let numbers = numbers.get_or_insert_with(|| (0..video.timestamps_s.len()).collect());
                numbers.truncate(kept.len());
                retain(numbers, kept);
            }
        }
        retain(&mut self.timestamps_s, kept);
        retain(&mut self.opacity, kept);
        retain(&mut self.geometries, kept);
        retain(&mut self.landmarks, kept);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Geometry;
    use crate::recording::Landmark;

    #[test]
    fn remaining_frames_keep_their_values() {
        let folder = tempfile::tempdir().unwrap();
        // The second and the fourth picture repeat the previous one.
        let codes = [10, 10, 20, 20, 30];
        let files: Vec<_> = (0..codes.len()).map(|i| folder.path().join(format!("{i}.png"))).collect();
        for (file, code) in files.iter().zip(codes) {
            image::RgbImage::from_pixel(2, 2, image::Rgb([code; 3])).save(file).unwrap();
        }
        let mut parts = Parts::new(folder.path(), Pictures::Stills(files.clone()), vec![0.0, 0.1, 0.2, 0.3, 0.4]);
        parts.opacity = vec![1.0, 0.75, 0.5, 0.25, 0.0];
        parts.geometries = (1..=5).map(|i| Some(Geometry::pinhole(2, 2, f64::from(i)))).collect();
        parts.landmarks = (0..5).map(|number| vec![Landmark { number, at_px: [1.0; 2] }]).collect();
        parts.remove_duplicates().unwrap();

        let Pictures::Stills(left) = &parts.pictures else { panic!("{:?}", parts.pictures) };
        assert_eq!(*left, [0, 2, 4].map(|i: usize| files[i].clone()));
        assert_eq!(parts.timestamps_s, [0.0, 0.2, 0.4]);
        assert_eq!(parts.opacity, [1.0, 0.5, 0.0]);
        let focal_px: Vec<_> = parts.geometries.iter().flatten().map(|camera| camera.intrinsics.fx_px).collect();
        assert_eq!(focal_px, [1.0, 3.0, 5.0]);
        assert_eq!(parts.landmarks.iter().flatten().map(|landmark| landmark.number).collect::<Vec<_>>(), [0, 2, 4]);
    }
}
