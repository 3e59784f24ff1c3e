//! A recorder on a thread of its own, so that no frame waits for the disk.

use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::encode::Encoded;
use super::error::LiveError;
use crate::recording::FrameCamera;
use crate::recording::recorder::{Recorder, RecorderError, Store};
use crate::tracking::covariance::Covariance;
use crate::tracking::tum::Line;

/// Frames on their way to the disk at once: a second of a camera, for disks that pause.
const MOST: usize = 32;
/// Without a frame for so long, what is held is written.
const IDLE: Duration = Duration::from_millis(500);

enum Work {
    Frame { time_s: f64, file: Arc<Encoded>, exposure_s: Option<f64>, presence: Option<f64> },
    Settled { time_s: f64, presence: f64, camera: Option<Box<FrameCamera>> },
    Poses(Vec<Line>),
    Covariance(Covariance),
}

/// The sending end of a recorder.
#[derive(Debug)]
pub struct Writer {
    work: Option<SyncSender<Work>>,
    failed: Arc<Mutex<Option<RecorderError>>>,
    thread: Option<JoinHandle<usize>>,
}

impl Writer {
    pub fn new<S: Store + Send + 'static>(mut recorder: Recorder<S>) -> Result<Self, LiveError> {
        let (sender, work) = sync_channel(MOST);
        let failed = Arc::new(Mutex::new(None));
        let told = Arc::clone(&failed);
        let write = move || {
            loop {
                let done = match work.recv_timeout(IDLE) {
                    Ok(Work::Poses(lines)) => {
                        lines.into_iter().for_each(|line| recorder.pose(line));
                        Ok(())
                    }
                    Ok(Work::Covariance(covariance)) => {
                        recorder.covariance(covariance);
                        Ok(())
                    }
                    Ok(Work::Settled { time_s, presence, camera }) => {
                        camera.into_iter().for_each(|camera| recorder.camera(time_s, *camera));
                        recorder.settle(time_s, presence)
                    }
                    Ok(Work::Frame { time_s, file, exposure_s, presence }) => {
                        frame(&mut recorder, time_s, &file, exposure_s, presence)
                    }
                    Err(RecvTimeoutError::Timeout) => recorder.commit(),
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                if let Err(error) = done {
                    // Whatever comes now finds nobody.
                    *told.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    return recorder.frames();
                }
            }
            let frames = recorder.frames();
            if let Err(error) = recorder.finish() {
                *told.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            }
            frames
        };
        let thread = std::thread::Builder::new().name("recorder".to_owned());
        let thread = thread.spawn(write).map_err(LiveError::Thread)?;
        Ok(Self { work: Some(sender), failed, thread: Some(thread) })
    }

    /// Hands a frame on. False if the disk is too slow for it, or the recording has ended: then it is not recorded. A frame
    /// whose presence is not known yet is listed once it is [told](Self::settle).
    pub fn frame(&self, time_s: f64, file: Arc<Encoded>, exposure_s: Option<f64>, presence: Option<f64>) -> bool {
        let frame = Work::Frame { time_s, file, exposure_s, presence };
        self.work.as_ref().is_some_and(|work| work.try_send(frame).is_ok())
    }

    /// Tells the presence of a frame, and its camera if frames have their own, if it is recorded. Its poses were given before.
    pub fn settle(&self, time_s: f64, presence: f64, camera: Option<&FrameCamera>) {
        if let Some(work) = self.work.as_ref() {
            let camera = camera.cloned().map(Box::new);
            let _ = work.send(Work::Settled { time_s, presence, camera });
        }
    }

    pub fn covariance(&self, covariance: Covariance) {
        if let Some(work) = self.work.as_ref() {
            let _ = work.send(Work::Covariance(covariance));
        }
    }

    pub fn poses(&self, lines: Vec<Line>) {
        if let Some(work) = self.work.as_ref().filter(|_| !lines.is_empty()) {
            let _ = work.send(Work::Poses(lines));
        }
    }

    /// Why the recording has ended, if it has.
    pub fn failure(&self) -> Option<RecorderError> {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Ends the recording, and says how many frames it has, and why it ended earlier if it did.
    pub fn finish(mut self) -> (usize, Option<RecorderError>) {
        self.work = None;
        let frames = self.thread.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        (frames, self.failure())
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        self.work = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn frame<S: Store>(
    recorder: &mut Recorder<S>,
    time_s: f64,
    file: &Encoded,
    exposure_s: Option<f64>,
    presence: Option<f64>,
) -> Result<(), RecorderError> {
    match file.file() {
        Ok((ending, bytes)) => recorder.frame(time_s, ending, &bytes, exposure_s, presence),
        // Only a picture without pixels cannot be encoded.
        Err(source) => Err(RecorderError::Write { path: "a frame".into(), source }),
    }
}
