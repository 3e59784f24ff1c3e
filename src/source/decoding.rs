//! A video's frames through a pipe of `ffmpeg`, which decodes them or copies the packets of Motion
//! JPEG (motion_jpeg.rs).

use std::ffi::OsString;
use std::io::Read;
use std::ops::Range;
use std::path::PathBuf;
use std::process::ChildStdout;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::JoinHandle;

use super::SourceError;
use super::ffmpeg;
use super::index::{DecodingStart, Index};
use super::motion_jpeg::{self, Packets};
use super::orientation::Orientation;
use super::video::{CONVERSION_FLAGS, MEND, Video};
use crate::coding::PictureCoding;
use crate::coding::{ColorMatrix, ColorRange};
use crate::pixels::{Codes, Pixels};
use crate::program::{ProgramError, Running};

/// Properties of a video that decoding depends on.
#[derive(Clone, Debug)]
struct VideoInput {
    file: PathBuf,
    /// Size as stored.
    size: (u32, u32),
    /// Applied to each frame.
    orientation: Orientation,
    wide: bool,
    range: ColorRange,
    matrix: ColorMatrix,
    /// Of frames that ffmpeg decodes.
    coding: Option<Arc<PictureCoding>>,
    is_jpeg: bool,
    index: Option<Arc<Index>>,
}

/// Frames in order, or the problem of a frame. Ends with the pipe.
type FrameReader = Box<dyn Iterator<Item = Result<Pixels, String>> + Send>;

impl Video {
    /// Frames `range`, exactly. If the file's times distinguish the frames, decoding starts at a
    /// keyframe before them.
    pub fn read(&self, range: Range<usize>) -> Result<VideoFrames, SourceError> {
        let Self {
            file, width, height, applied_orientation, bits, range: colors, matrix, coding, is_jpeg, index, ..
        } = self;
        let source = VideoInput {
            file: file.clone(),
            // Quarter turns forth and back exchange the sides alike.
            size: applied_orientation.oriented_size((*width, *height)),
            orientation: *applied_orientation,
            wide: *bits == 16,
            range: *colors,
            matrix: *matrix,
            coding: coding.clone(),
            is_jpeg: *is_jpeg,
            index: index.clone(),
        };
        let start = source.index.as_ref().and_then(|index| index.start(range.start)).filter(|_| !range.is_empty());
        let mut frames = VideoFrames { source, stream: None, is_sought: start.is_some(), next: range.start, range };
        frames.begin(start)?;
        Ok(frames)
    }
}

impl VideoInput {
    /// ffmpeg's arguments for frames that start at `start`, or at their number from the file's
    /// first. Packets are copied from the file's first.
    fn arguments(&self, Range { start: first, end }: Range<usize>, start: Option<&DecodingStart>) -> Vec<OsString> {
        if self.is_jpeg {
            return motion_jpeg::arguments(&self.file, start);
        }
        let pixel_format = if self.wide { "rgb48le" } else { "rgb24" };
        let range_name = match self.range {
            ColorRange::Limited => "limited",
            ColorRange::Full => "full",
        };
        let input = match self.matrix.name() {
            None => String::new(),
            Some(matrix) => format!("in_color_matrix={matrix}:in_range={range_name}:out_range=full:"),
        };
        let count = end - first;
        let chosen = match start {
            None => format!("trim=start_frame={first}:end_frame={end}"),
            // If seeking fails to land before the frame, no frame is selected rather than a wrong
            // one.
            Some(DecodingStart { ticks, tick_s, .. }) => {
                format!("settb={tick_s},select='eq(pts,{ticks})+gte(prev_selected_pts,{ticks})',trim=end_frame={count}")
            }
        };
        // Renumbering the timestamps keeps ffmpeg from repeating or dropping frames for a steady
        // rate.
        let filter =
            format!("{chosen},settb=1/25,setpts=N,scale={input}flags={CONVERSION_FLAGS},format={pixel_format}");
        let mut arguments: Vec<OsString> = ["-nostdin", "-v", "error", "-noautorotate"].map(OsString::from).into();
        if let Some(DecodingStart { time_s, .. }) = start {
            // Time stamps as in the file; frames from the keyframe on, not from the time.
            let seek = ["-copyts", "-seek_timestamp", "1", "-noaccurate_seek", "-ss", &format!("{time_s:.6}")];
            arguments.extend(seek.map(OsString::from));
        }
        arguments.extend(ffmpeg::input(&self.file));
        let count = count.to_string();
        let rest = ["-map", "0:v:0", "-vf", &filter, "-r", "25", "-frames:v", &count, "-f", "rawvideo", "-pix_fmt"];
        arguments.extend(rest.map(OsString::from));
        arguments.extend([pixel_format, "pipe:1"].map(OsString::from));
        arguments
    }

    fn pixels(&self, bytes: Vec<u8>) -> Pixels {
        let (width, height) = self.size;
        let codes = if self.wide {
            Codes::U16(bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect())
        } else {
            Codes::U8(bytes)
        };
        let pixels = self.orientation.apply(Pixels::uncoded(width, height, codes));
        Pixels { coding: self.coding.clone(), ..pixels }
    }

    /// Reader of the frames in ffmpeg's output. The first `skipped` packets that are copied are not
    /// decoded.
    fn reader(self, mut pipe: ChildStdout, skipped: usize) -> FrameReader {
        let (width, height) = self.size;
        if self.is_jpeg {
            let packets = Packets::new(pipe).skip(skipped);
            return Box::new(packets.map(move |packet| motion_jpeg::decode(&packet, self.size, self.orientation)));
        }
        let bytes = 3 * width as usize * height as usize * if self.wide { 2 } else { 1 };
        Box::new(std::iter::from_fn(move || {
            let mut frame = vec![0; bytes];
            pipe.read_exact(&mut frame).ok()?;
            Some(Ok(self.pixels(frame)))
        }))
    }
}

/// A running ffmpeg with the frames of its output.
#[derive(Debug)]
struct DecoderProcess {
    running: Running,
    frames: Receiver<Result<Pixels, String>>,
    /// Keeps the pipe open.
    reader: JoinHandle<FrameReader>,
}

impl DecoderProcess {
    /// Reads at most `limit` frames on a separate thread; ends with the pipe. The thread returns
    /// its reader, so that the pipe stays open until ffmpeg is killed: ffmpeg reports a closed one.
    fn new(running: Running, mut reader: FrameReader, limit: usize) -> Result<Self, SourceError> {
        let (sender, frames) = sync_channel(2);
        let run = move || {
            for frame in reader.by_ref().take(limit) {
                if sender.send(frame).is_err() {
                    break;
                }
            }
            reader
        };
        let reader = std::thread::Builder::new().name("video".to_owned()).spawn(run).map_err(SourceError::Thread)?;
        Ok(Self { running, frames, reader })
    }

    /// Waits for ffmpeg's end. It cannot wait for a reader of surplus frames: the pipe is closed
    /// when the thread ends.
    fn finish(self) -> Result<String, ProgramError> {
        let Self { running, frames, reader } = self;
        drop((frames, reader));
        running.finish()
    }
}

/// The frames of a range of a video, in order. Dropping it kills its ffmpeg.
#[derive(Debug)]
pub struct VideoFrames {
    source: VideoInput,
    stream: Option<DecoderProcess>,
    /// True if decoding started in the middle of the file.
    is_sought: bool,
    next: usize,
    range: Range<usize>,
}

impl VideoFrames {
    /// Starts ffmpeg for the remaining frames.
    fn begin(&mut self, start: Option<DecodingStart>) -> Result<(), SourceError> {
        self.stream = None;
        if self.next >= self.range.end {
            return Ok(());
        }
        let mut running = Running::start("ffmpeg", &self.source.arguments(self.next..self.range.end, start.as_ref()))?;
        let Some(pipe) = running.take_stdout() else { return Ok(()) };
        let skipped = if start.is_some() { 0 } else { self.next };
        let limit = if self.source.is_jpeg { self.range.end - self.next } else { usize::MAX };
        self.stream = Some(DecoderProcess::new(running, self.source.clone().reader(pipe, skipped), limit)?);
        Ok(())
    }

    /// The next frame, or the error.
    fn step(&mut self) -> Result<Pixels, String> {
        let (at, end) = (self.next, self.range.end);
        let frame = self.stream.as_ref().and_then(|stream| stream.frames.recv().ok());
        let Some(frame) = frame else {
            if let Some(Err(error)) = self.stream.take().map(DecoderProcess::finish) {
                return Err(format!("reading stopped at frame {at}: {error}"));
            }
            return Err(format!("ends before frame {at}; frames up to {end} were expected: is it truncated?"));
        };
        // ffmpeg conceals errors and continues; they only show in its messages.
        let complaints = match self.stream.take() {
            // A copy of packets continues to the end of the file; it is killed.
            Some(stream) if at + 1 == end && self.source.is_jpeg => stream.running.complaints(),
            // Nothing is left to write, so it ends by itself, and all its messages are complete.
            Some(stream) if at + 1 == end => stream.finish().unwrap_or_else(|error| error.to_string()),
            Some(stream) => {
                let message = stream.running.complaints();
                self.stream = Some(stream);
                message
            }
            None => String::new(),
        };
        match (frame, complaints.as_str()) {
            (Ok(pixels), "") => Ok(pixels),
            (Err(problem), "") => Err(format!("frame {at}: {problem}; {MEND}")),
            (_, message) => Err(format!("is damaged at frame {at} or before it: ffmpeg reports: {message}; {MEND}")),
        }
    }
}

impl Iterator for VideoFrames {
    /// An error ends the iteration.
    type Item = Result<Pixels, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next >= self.range.end {
            self.stream = None;
            return None;
        }
        let mut frame = self.step();
        if frame.is_err() && std::mem::take(&mut self.is_sought) {
            // A decoder that starts in the middle may lack data of the file's start. The error from
            // the start counts.
            self.source.index.iter().for_each(|index| index.distrust());
            frame = match self.begin(None) {
                Ok(()) => self.step(),
                Err(error) => {
                    self.next = self.range.end;
                    return Some(Err(error));
                }
            };
        }
        Some(match frame {
            Ok(pixels) => {
                self.next += 1;
                Ok(pixels)
            }
            Err(problem) => {
                (self.next, self.stream) = (self.range.end, None);
                Err(SourceError::content(&self.source.file, problem))
            }
        })
    }
}
