//! Composites single frames, and ranges of frames in order.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use super::{Shot, ShotError};
use crate::camera::Geometry;
use crate::compositor::{
    Composited, Compositor, Job, Pending, StreamFrame, StreamInputs, SubmitError, Target, poses_within_s,
};
use crate::frame::Frame;
use crate::memo::ByAddress;

/// The composited frames of a range, in order, from [`Shot::frames`]. Ends after an error.
pub struct Composites<'a>(Box<dyn Iterator<Item = Result<Composited, ShotError>> + 'a>);

impl std::fmt::Debug for Composites<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Composites")
    }
}

impl Iterator for Composites<'_> {
    type Item = Result<Composited, ShotError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.next()
    }
}

impl Shot {
    /// Starts a frame's picture with the current settings. A repeated frame is decoded once.
    pub fn picture(&self, compositor: &mut Compositor, frame: usize, target: Target<'_>) -> Result<Pending, ShotError> {
        let recorded = self.decoded_frame(frame)?;
        self.submit(compositor, Frame::clone(&recorded), &self.geometry_at(frame)?, target, false)
    }

    fn decoded_frame(&self, frame: usize) -> Result<Arc<Frame>, ShotError> {
        let key = (ByAddress(Arc::clone(&self.recording)), frame);
        self.decoded.get_or_try_insert_with(key, |_| self.read_with_neighbours(frame).map(Arc::new))
    }

    /// Starts a frame's picture with the current settings, optionally with its layer. The frame is
    /// one of the recording's, but its pixels may be others; the geometry is that of
    /// [`Shot::geometry_at`], or derived from it.
    pub fn submit(
        &self,
        compositor: &mut Compositor,
        frame: Frame,
        geometry: &Geometry,
        target: Target<'_>,
        want_layer: bool,
    ) -> Result<Pending, ShotError> {
        self.update_compositor(compositor);
        let frame = self.with_live_depth(frame, geometry, &self.recording.track);
        let index = frame.index;
        let failed = |source: SubmitError| ShotError::Submit { frame: index, source };
        let camera = self.camera();
        let track = &self.recording.track;
        let interval_s = self.interval_s(index);
        let job = Job::of_frame(frame, &camera, &self.settings, geometry, track, interval_s)?;
        let job = Job { want_layer, ..job };
        compositor.submit(job, &camera, &self.settings, target).map_err(failed)
    }

    /// Time before and after a frame within which poses affect its picture, s.
    pub fn poses_within_s(&self, frame: &Frame) -> Result<(f64, f64), ShotError> {
        let camera = self.camera();
        let geometry = self.geometry_at(frame.index)?;
        Ok(poses_within_s(frame, &camera, &self.settings, &geometry, self.interval_s(frame.index)))
    }

    /// Composites a range of frames. Frames are decoded ahead, and `in_flight` of them (at least
    /// one) are on the GPU at a time. Memory does not grow with the range's length.
    pub fn frames<'a>(
        &'a self,
        compositor: &'a mut Compositor,
        range: Range<usize>,
        want_layers: bool,
        in_flight: usize,
    ) -> Result<Composites<'a>, ShotError> {
        self.update_compositor(compositor);
        let frames = self.recording.frames_with_neighbours(range)?.map(|frame| {
            let frame = frame?;
            let geometry = self.geometry_at(frame.index)?;
            let interval_s = self.interval_s(frame.index);
            Ok(StreamFrame { frame, geometry, interval_s })
        });
        let inputs = StreamInputs {
            camera: Cow::Owned(self.camera()),
            settings: &self.settings,
            track: &self.recording.track,
            want_layers,
            in_flight,
        };
        Ok(Composites(Box::new(compositor.composite_stream(inputs, frames).map(|done| Ok(done?)))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::OpenOptions;
    use crate::shot::ShotOptions;
    use std::path::Path;

    #[test]
    fn repeated_frame_is_decoded_once_and_again_after_the_recording_changed() {
        let mut shot =
            Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &ShotOptions::default()).unwrap();
        let first = shot.decoded_frame(3).unwrap();
        assert!(Arc::ptr_eq(&first, &shot.decoded_frame(3).unwrap()));
        assert_eq!(shot.decoded_frame(4).unwrap().index, 4);
        // Another camera may register depth elsewhere.
        let before = shot.decoded_frame(3).unwrap();
        shot.register_depth();
        assert!(!Arc::ptr_eq(&before, &shot.decoded_frame(3).unwrap()));
    }
}
