//! Frames, decoded on a thread of their own: the one asked for last is decoded next, and nothing waits for it.

use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;

use crate::frame::Frame;
use crate::recording::{Recording, RecordingError};

/// A frame that was asked for, or why there is none.
pub type Decoded = (usize, Result<Frame, RecordingError>);

/// Decodes a recording's frames in any order; one after the other costs least.
#[derive(Debug)]
pub struct Reader {
    asked: Option<Sender<usize>>,
    decoded: Receiver<Decoded>,
    thread: Option<JoinHandle<()>>,
}

impl Reader {
    /// `wake` is called from the thread whenever a frame is there.
    pub fn new(recording: Recording, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (asked, to_decode) = channel::<usize>();
        let (done, decoded) = channel();
        let thread = std::thread::Builder::new().name("window reader".to_owned()).spawn(move || {
            let mut stream: Option<(usize, crate::recording::Frames)> = None;
            while let Ok(first) = to_decode.recv() {
                // What was asked for before is no longer wanted.
                let frame = to_decode.try_iter().last().unwrap_or(first);
                let running = stream.take().filter(|(next, _)| *next == frame);
                let opened = match running {
                    Some((_, frames)) => Ok(frames),
                    None => recording.frames(frame..recording.frame_count()),
                };
                let result = opened.and_then(|mut frames| {
                    let missing = RecordingError::Range { start: frame, end: frame, count: recording.frame_count() };
                    let decoded = frames.next().unwrap_or(Err(missing))?;
                    stream = Some((frame + 1, frames));
                    Ok(decoded)
                });
                if done.send((frame, result)).is_err() {
                    return;
                }
                wake();
            }
        })?;
        Ok(Self { asked: Some(asked), decoded, thread: Some(thread) })
    }

    /// Asks for a frame.
    pub fn ask(&self, frame: usize) {
        // A thread that is gone gives nothing; `take` tells of it.
        let _ = self.asked.as_ref().map(|asked| asked.send(frame));
    }

    /// What has been decoded since this was last called; `Err` where nothing more will come.
    pub fn take(&self) -> Result<Option<Decoded>, ()> {
        match self.decoded.try_recv() {
            Ok(decoded) => Ok(Some(decoded)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(()),
        }
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        drop(self.asked.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
