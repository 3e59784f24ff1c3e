//! A video's frames, decoded by `ffmpeg` through a pipe.

use std::ffi::OsString;
use std::io::Read;
use std::ops::Range;
use std::path::PathBuf;
use std::process::ChildStdout;
use std::sync::mpsc::{Receiver, sync_channel};

use super::SourceError;
use super::ffmpeg::{self, Running};
use super::video::{CONVERSION_FLAGS, ColorRange, MEND, Video};
use crate::pixels::{Codes, Pixels};

impl Video {
    /// Frames `range`, exactly. All frames before it are decoded and dropped, since seeking depends on the file's
    /// index, not on frame numbers.
    pub fn read(&self, range: Range<usize>) -> Result<VideoFrames, SourceError> {
        let wide = self.bits == 16;
        let pixel_format = if wide { "rgb48le" } else { "rgb24" };
        let range_name = match self.range {
            ColorRange::Limited => "limited",
            ColorRange::Full => "full",
        };
        let input = match self.matrix.name() {
            None => String::new(),
            Some(matrix) => format!("in_color_matrix={matrix}:in_range={range_name}:out_range=full:"),
        };
        let range_length = range.len();
        let Range { start, end } = range;
        // Renumbering the timestamps keeps ffmpeg from repeating or dropping frames for a steady rate.
        let filter = format!(
            "trim=start_frame={start}:end_frame={end},settb=1/25,setpts=N,scale={input}flags={CONVERSION_FLAGS},format={pixel_format}"
        );
        let mut arguments: Vec<OsString> =
            ["-nostdin", "-v", "error", "-noautorotate", "-i"].map(OsString::from).into();
        arguments.push(ffmpeg::file_argument(&self.file));
        let count = range_length.to_string();
        let rest = [
            "-map",
            "0:v:0",
            "-vf",
            &filter,
            "-r",
            "25",
            "-frames:v",
            &count,
            "-f",
            "rawvideo",
            "-pix_fmt",
            pixel_format,
            "pipe:1",
        ];
        arguments.extend(rest.map(OsString::from));
        let mut frames = VideoFrames {
            running: None,
            frames: None,
            next: start,
            range: start..end,
            size: (self.width, self.height),
            wide,
            file: self.file.clone(),
        };
        if start < end {
            let mut running = Running::start("ffmpeg", &arguments)?;
            let bytes = 3 * self.width as usize * self.height as usize * if wide { 2 } else { 1 };
            frames.frames = running.take_stdout().map(|pipe| read_ahead(pipe, bytes)).transpose()?;
            frames.running = Some(running);
        }
        Ok(frames)
    }
}

/// Reads whole frames from a pipe on a separate thread; ends with the pipe.
fn read_ahead(mut pipe: ChildStdout, bytes: usize) -> Result<Receiver<Vec<u8>>, SourceError> {
    let (sender, receiver) = sync_channel(2);
    let run = move || {
        loop {
            let mut frame = vec![0; bytes];
            if pipe.read_exact(&mut frame).is_err() || sender.send(frame).is_err() {
                break;
            }
        }
    };
    std::thread::Builder::new().name("video".to_owned()).spawn(run).map_err(SourceError::Thread)?;
    Ok(receiver)
}

/// The frames of a range of a video, in order. Dropping it kills its ffmpeg.
#[derive(Debug)]
pub struct VideoFrames {
    running: Option<Running>,
    frames: Option<Receiver<Vec<u8>>>,
    next: usize,
    range: Range<usize>,
    size: (u32, u32),
    wide: bool,
    file: PathBuf,
}

impl Iterator for VideoFrames {
    /// An error ends the iteration.
    type Item = Result<Pixels, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next >= self.range.end {
            self.running = None;
            return None;
        }
        let frame = self.frames.as_ref().and_then(|frames| frames.recv().ok());
        // ffmpeg fills in what it cannot decode and continues; it only complains.
        let last = self.next + 1 == self.range.end;
        let complaints = match &mut self.running {
            // Nothing is left to write, so it ends by itself, and all its messages are complete.
            running if last && frame.is_some() => {
                running.take().map(|running| running.finish().unwrap_or_else(|error| error.to_string()))
            }
            running => running.as_ref().map(Running::complaints),
        };
        if let Some(said) = complaints.filter(|said| frame.is_some() && !said.is_empty()) {
            let problem = format!("is damaged at frame {} or before it: ffmpeg says: {said}; {MEND}", self.next);
            self.next = self.range.end;
            self.running = None;
            return Some(Err(SourceError::content(&self.file, problem)));
        }
        let Some(bytes) = frame else {
            let Self { next, range, file, .. } = self;
            let (stopped_at, end) = (*next, range.end);
            *next = end;
            if let Some(Err(error)) = self.running.take().map(Running::finish) {
                return Some(Err(SourceError::content(
                    file,
                    format!("reading stopped at frame {stopped_at}: {error}"),
                )));
            }
            let problem = format!("ends before frame {stopped_at}; frames up to {end} were expected: is it truncated?");
            return Some(Err(SourceError::content(file, problem)));
        };
        self.next += 1;
        let (width, height) = self.size;
        let codes = if self.wide {
            Codes::U16(bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect())
        } else {
            Codes::U8(bytes)
        };
        Some(Ok(Pixels { width, height, codes }))
    }
}
