//! Replay buffer: the last seconds of a camera, in memory.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

use super::picture_file::PictureFile;
use crate::recording::FrameCamera;
use crate::recording::recorder::{Recorder, RecorderError, RecordingInfo};
use crate::tracking::covariance::Covariance;
use crate::tracking::tum::Line;

/// Duration, seconds.
const DURATION_S: f64 = 10.0;
/// Size limit, bytes: uncompressed pictures may be large.
const MAX_BYTES: usize = 512 << 20;
/// Poses are kept for this long before the first frame, seconds.
const POSE_LEAD_S: f64 = 2.0;

#[derive(Clone, Debug)]
struct BufferedFrame {
    time_s: f64,
    file: Arc<PictureFile>,
    exposure_s: Option<f64>,
    opacity: f64,
    camera: Option<FrameCamera>,
}

/// Frames and poses of the last ten seconds; fewer if they exceed 512 MiB. Cheap to clone.
#[derive(Clone, Debug, Default)]
pub struct ReplayBuffer {
    frames: VecDeque<BufferedFrame>,
    poses: VecDeque<Line>,
    covariances: VecDeque<Covariance>,
    size_bytes: usize,
}

impl ReplayBuffer {
    pub fn add_frame(&mut self, time_s: f64, file: Arc<PictureFile>, exposure_s: Option<f64>) {
        self.size_bytes += file.size_bytes();
        self.frames.push_back(BufferedFrame { time_s, file, exposure_s, opacity: 1.0, camera: None });
        while self.frames.len() > 1
            && (self.size_bytes > MAX_BYTES
                || self.frames.front().is_some_and(|first| first.time_s < time_s - DURATION_S))
        {
            self.size_bytes -= self.frames.pop_front().map_or(0, |first| first.file.size_bytes());
        }
        let first_s = self.frames.front().map_or(time_s, |first| first.time_s);
        while self.poses.front().is_some_and(|line| line.time_s < first_s - POSE_LEAD_S) {
            self.poses.pop_front();
        }
        while self.covariances.front().is_some_and(|covariance| covariance.time_s < first_s - POSE_LEAD_S) {
            self.covariances.pop_front();
        }
    }

    /// Sets the opacity of a buffered frame, and its camera if frames have their own.
    pub fn set_opacity(&mut self, time_s: f64, opacity: f64, camera: Option<&FrameCamera>) {
        if let Some(frame) = self.frames.iter_mut().rev().find(|frame| frame.time_s == time_s) {
            (frame.opacity, frame.camera) = (opacity, camera.cloned());
        }
    }

    pub fn add_covariance(&mut self, covariance: Covariance) {
        self.covariances.push_back(covariance);
    }

    pub fn add_poses(&mut self, lines: &[Line]) {
        self.poses.extend(lines);
        // Poses may arrive while no frames do.
        let last_s = lines.last().map_or(f64::NEG_INFINITY, |line| line.time_s);
        while self.poses.front().is_some_and(|line| line.time_s < last_s - DURATION_S - 2.0 * POSE_LEAD_S) {
            self.poses.pop_front();
        }
    }

    pub fn poses(&self) -> Vec<Line> {
        self.poses.iter().copied().collect()
    }

    pub fn frames(&self) -> usize {
        self.frames.len()
    }

    /// Time from the first frame to the last, seconds.
    pub fn span_s(&self) -> f64 {
        self.frames.front().zip(self.frames.back()).map_or(0.0, |(first, last)| last.time_s - first.time_s)
    }

    /// Removes the frames after a time.
    pub fn until(mut self, time_s: f64) -> Self {
        while self.frames.back().is_some_and(|last| last.time_s > time_s) {
            self.size_bytes -= self.frames.pop_back().map_or(0, |last| last.file.size_bytes());
        }
        self
    }

    /// Writes a recording into a new folder. Returns the number of frames.
    pub fn write(&self, folder: &Path, about: &RecordingInfo) -> Result<usize, RecorderError> {
        let mut recorder = Recorder::create(folder, about)?;
        self.poses.iter().for_each(|line| recorder.pose(*line));
        self.covariances.iter().for_each(|covariance| recorder.covariance(*covariance));
        for BufferedFrame { time_s, file, exposure_s, opacity, camera } in &self.frames {
            let unwritten = |source| RecorderError::Write { path: folder.to_owned(), source };
            let (ending, bytes) = file.encode().map_err(unwritten)?;
            recorder.frame(*time_s, ending, &bytes, *exposure_s, None)?;
            camera.iter().for_each(|camera| recorder.camera(*time_s, camera.clone()));
            recorder.set_opacity(*time_s, *opacity)?;
        }
        recorder.finish()?;
        Ok(self.frames.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::Pixels;
    use crate::pose::Pose;
    use crate::recording::{OpenOptions, Recording};

    fn filled(frames: u32) -> ReplayBuffer {
        let mut buffer = ReplayBuffer::default();
        for i in 0..frames {
            let time_s = 100.0 + 0.1 * f64::from(i);
            buffer.add_poses(&[Line::new(time_s, &Pose::IDENTITY)]);
            buffer.add_covariance(Covariance { time_s, upper: [1e-6; 21] });
            let pixels = Pixels::from_u8(16, 16, vec![i as u8; 768]).unwrap();
            buffer.add_frame(time_s, Arc::new(PictureFile::Pixels(pixels)), None);
        }
        buffer
    }

    #[test]
    fn buffer_of_ten_seconds_is_written_as_a_recording() {
        // 30 s of frames.
        let mut buffer = filled(300);
        assert_eq!((buffer.frames(), buffer.size_bytes), (101, 101 * 768));
        assert!((buffer.span_s() - 10.0).abs() < 1e-9);
        assert!((buffer.poses[0].time_s - 117.9).abs() < 1e-9, "poses of two seconds before");
        let temp = tempfile::tempdir().unwrap();
        let about = RecordingInfo {
            interval_s: 0.1,
            max_gap_s: 0.1,
            up: None,
            has_floor: false,
            camera: None,
            delivered: None,
            has_exposure: false,
            has_cameras: false,
            profile: None,
        };
        let folder = temp.path().join("last");
        buffer.set_opacity(100.0 + 0.1 * 200.0, 0.25, None);
        assert_eq!(buffer.clone().until(128.05).write(&folder, &about).unwrap(), 82);
        let recording = Recording::open(&folder, &OpenOptions::default()).unwrap();
        assert_eq!(recording.timestamps_s.len(), 82);
        let last = recording.frames(81..82).unwrap().next().unwrap().unwrap();
        assert_eq!(
            (last.timestamp_s, Arc::unwrap_or_clone(last.pixels)),
            (128.0, Pixels::from_u8(16, 16, vec![(280 % 256) as u8; 768]).unwrap())
        );
        assert!(recording.pose_at_frame(0).is_ok());
        let covariance_text = std::fs::read_to_string(folder.join("covariance.txt")).unwrap();
        assert_eq!(covariance_text.lines().count(), 2 + buffer.poses().len());
        assert_eq!([0, 1].map(|frame| recording.opacity(frame)), [1.0, 0.25]);
    }
}
