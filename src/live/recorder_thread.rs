//! A recorder on a thread of its own, so that no frame waits for the disk.

use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::error::LiveError;
use super::picture_file::PictureFile;
use crate::recording::FrameCamera;
use crate::recording::recorder::{Recorder, RecorderError, Store};
use crate::tracking::covariance::Covariance;
use crate::tracking::tum::Line;

/// Queue capacity: about a second of frames, for disks that stall.
const QUEUE_CAPACITY: usize = 32;
/// Pending data is committed after this time without a frame.
const COMMIT_IDLE: Duration = Duration::from_millis(500);

enum RecorderTask {
    Frame { time_s: f64, file: Arc<PictureFile>, exposure_s: Option<f64>, opacity: Option<f64> },
    Opacity { time_s: f64, opacity: f64, camera: Option<Box<FrameCamera>> },
    Poses(Vec<Line>),
    Covariance(Covariance),
}

/// Handle of the recorder's thread.
#[derive(Debug)]
pub struct RecorderThread {
    tasks: Option<SyncSender<RecorderTask>>,
    error: Arc<Mutex<Option<RecorderError>>>,
    thread: Option<JoinHandle<usize>>,
}

impl RecorderThread {
    pub fn new<S: Store + Send + 'static>(mut recorder: Recorder<S>) -> Result<Self, LiveError> {
        let (sender, tasks) = sync_channel(QUEUE_CAPACITY);
        let error = Arc::new(Mutex::new(None));
        let error_slot = Arc::clone(&error);
        let write = move || {
            loop {
                let done = match tasks.recv_timeout(COMMIT_IDLE) {
                    Ok(RecorderTask::Poses(lines)) => {
                        lines.into_iter().for_each(|line| recorder.pose(line));
                        Ok(())
                    }
                    Ok(RecorderTask::Covariance(covariance)) => {
                        recorder.covariance(covariance);
                        Ok(())
                    }
                    Ok(RecorderTask::Opacity { time_s, opacity, camera }) => {
                        camera.into_iter().for_each(|camera| recorder.camera(time_s, *camera));
                        recorder.set_opacity(time_s, opacity)
                    }
                    Ok(RecorderTask::Frame { time_s, file, exposure_s, opacity }) => {
                        frame(&mut recorder, time_s, &file, exposure_s, opacity)
                    }
                    Err(RecvTimeoutError::Timeout) => recorder.commit(),
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                if let Err(error) = done {
                    // Later tasks are dropped.
                    *error_slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    return recorder.frames();
                }
            }
            let frames = recorder.frames();
            if let Err(error) = recorder.finish() {
                *error_slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            }
            frames
        };
        let thread = std::thread::Builder::new().name("recorder".to_owned());
        let thread = thread.spawn(write).map_err(LiveError::Thread)?;
        Ok(Self { tasks: Some(sender), error, thread: Some(thread) })
    }

    /// Queues a frame. Returns false if the disk is too slow for it or the recording has ended;
    /// then it is not recorded. A frame without an opacity is listed once [its opacity is
    /// set](Self::set_opacity).
    pub fn frame(&self, time_s: f64, file: Arc<PictureFile>, exposure_s: Option<f64>, opacity: Option<f64>) -> bool {
        let frame = RecorderTask::Frame { time_s, file, exposure_s, opacity };
        self.tasks.as_ref().is_some_and(|tasks| tasks.try_send(frame).is_ok())
    }

    /// Sets the opacity of a frame if it is recorded, and its camera if frames have their own. Its
    /// poses were queued before.
    pub fn set_opacity(&self, time_s: f64, opacity: f64, camera: Option<&FrameCamera>) {
        if let Some(tasks) = self.tasks.as_ref() {
            let camera = camera.cloned().map(Box::new);
            let _ = tasks.send(RecorderTask::Opacity { time_s, opacity, camera });
        }
    }

    pub fn covariance(&self, covariance: Covariance) {
        if let Some(tasks) = self.tasks.as_ref() {
            let _ = tasks.send(RecorderTask::Covariance(covariance));
        }
    }

    pub fn poses(&self, lines: Vec<Line>) {
        if let Some(tasks) = self.tasks.as_ref().filter(|_| !lines.is_empty()) {
            let _ = tasks.send(RecorderTask::Poses(lines));
        }
    }

    /// Takes the error that ended the recording, if any.
    pub fn failure(&self) -> Option<RecorderError> {
        self.error.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Ends the recording. Returns its number of frames, and the error if one ended it earlier.
    pub fn finish(mut self) -> (usize, Option<RecorderError>) {
        self.tasks = None;
        let frames = self.thread.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        (frames, self.failure())
    }
}

impl Drop for RecorderThread {
    fn drop(&mut self) {
        self.tasks = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn frame<S: Store>(
    recorder: &mut Recorder<S>,
    time_s: f64,
    file: &PictureFile,
    exposure_s: Option<f64>,
    opacity: Option<f64>,
) -> Result<(), RecorderError> {
    match file.encode() {
        Ok((ending, bytes)) => recorder.frame(time_s, ending, &bytes, exposure_s, opacity),
        // Only a picture without pixels cannot be encoded.
        Err(source) => Err(RecorderError::Write { path: "a frame".into(), source }),
    }
}
