//! Frames, decoded on a thread of their own in the order in which they are asked for.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;

use crate::frame::Frame;
use crate::recording::{Frames, Recording, RecordingError};

/// So many frames are decoded and thrown away rather than begun anew at the one that is wanted.
const SKIPPED: usize = 8;

/// A frame that was asked for, or why there is none.
pub type Decoded = (usize, Result<Frame, RecordingError>);

/// Decodes a recording's frames in any order; one after the other costs least.
#[derive(Debug)]
pub struct Reader {
    asked: Option<Sender<Asked>>,
    decoded: Receiver<Decoded>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Asked {
    frame: usize,
    /// What was asked for before is no longer wanted.
    instead: bool,
}

impl Reader {
    /// `wake` is called from the thread whenever a frame is there.
    pub fn new(recording: Arc<Recording>, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (asked, to_decode) = channel::<Asked>();
        let (done, decoded) = channel();
        let thread = std::thread::Builder::new().name("window reader".to_owned()).spawn(move || {
            let mut stream = None;
            let mut queue = VecDeque::new();
            let take = |queue: &mut VecDeque<usize>, asked: Asked| {
                if asked.instead {
                    queue.clear();
                }
                queue.push_back(asked.frame);
            };
            loop {
                match queue.is_empty() {
                    true => match to_decode.recv() {
                        Ok(asked) => take(&mut queue, asked),
                        Err(_) => return,
                    },
                    false => to_decode.try_iter().for_each(|asked| take(&mut queue, asked)),
                }
                let Some(frame) = queue.pop_front() else { continue };
                if done.send((frame, decode(&recording, &mut stream, frame))).is_err() {
                    return;
                }
                wake();
            }
        })?;
        Ok(Self { asked: Some(asked), decoded, thread: Some(thread) })
    }

    /// Asks for a frame after those that were asked for, or `instead` of them.
    pub fn ask(&self, frame: usize, instead: bool) {
        // A thread that is gone gives nothing; `take` tells of it.
        let _ = self.asked.as_ref().map(|asked| asked.send(Asked { frame, instead }));
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

/// Goes on with the stream, which stands at the frame of its number, where it comes by the frame soon.
fn decode(recording: &Recording, stream: &mut Option<(usize, Frames)>, frame: usize) -> Result<Frame, RecordingError> {
    let running = stream.take().filter(|(next, _)| (*next..=*next + SKIPPED).contains(&frame));
    let (at, mut frames) = match running {
        Some(running) => running,
        None => (frame, recording.frames(frame..recording.frame_count())?),
    };
    let missing = RecordingError::Range { start: frame, end: frame, count: recording.frame_count() };
    let decoded = frames.nth(frame - at).unwrap_or(Err(missing))?;
    *stream = Some((frame + 1, frames));
    Ok(decoded)
}

impl Drop for Reader {
    fn drop(&mut self) {
        drop(self.asked.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
