//! A video file, encoded by the `ffmpeg` program through a pipe.

use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ChildStdin;

use super::atomic::Partial;
use super::{Sink, SinkError, SinkOptions, little_endian};
use crate::pixels::Pixels;
use crate::source::ffmpeg::{self, Running};
use crate::source::video::{CONVERSION_FLAGS, ColorMatrix};
use crate::unfinished::MadeFolder;

const ENDED_EARLY: &str = "ffmpeg ended before it had all frames, and did not say why; see whether `ffmpeg` is ffmpeg";

/// Writes under a partial name and renames once ffmpeg has succeeded; otherwise nothing is left.
#[derive(Debug)]
pub struct VideoSink {
    path: PathBuf,
    options: SinkOptions,
    /// `None` once ended. Dropped before the file that it writes.
    running: Option<(Running, ChildStdin)>,
    partial: Partial,
    /// The folder that it lies in. Dropped after the file.
    made: Option<MadeFolder>,
    /// Number of frames passed to ffmpeg.
    frames: usize,
}

impl VideoSink {
    pub fn open(path: &Path, options: &SinkOptions) -> Result<Self, SinkError> {
        let refuse = |problem: &str| SinkError::Refused { path: path.to_owned(), problem: problem.to_owned() };
        if !(options.fps.is_finite() && options.fps > 0.0) {
            return Err(refuse("frames a second must be finite and above 0"));
        }
        let mkv = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mkv"));
        if options.lossless && options.bits == 16 && !mkv {
            return Err(refuse("lossless video with 16 bits goes into .mkv only"));
        }
        let made = path.parent().map(|folder| {
            MadeFolder::make(folder).map_err(|source| SinkError::Write { path: folder.to_owned(), source })
        });
        let made = made.transpose()?;
        let partial = Partial::create(path).map_err(|source| SinkError::Write { path: path.to_owned(), source })?;
        let mut running = Running::start("ffmpeg", &arguments(options, partial.path(), mkv))?;
        // Nobody reads ffmpeg's stdout; closed, it cannot block.
        drop(running.take_stdout());
        let running = running.take_stdin().map(|stdin| (running, stdin));
        Ok(Self { path: path.to_owned(), options: *options, running, partial, made, frames: 0 })
    }

    /// Waits for ffmpeg and reports a failure in its words.
    fn end(&mut self) -> Result<(), SinkError> {
        let Some((running, stdin)) = self.running.take() else { return Ok(()) };
        drop(stdin);
        running.finish().map(drop).map_err(|source| SinkError::Encoder { path: self.path.clone(), source })
    }

    fn refuse(&self, problem: &str) -> SinkError {
        SinkError::Refused { path: self.path.clone(), problem: problem.to_owned() }
    }
}

fn arguments(options: &SinkOptions, partial: &Path, mkv: bool) -> Vec<OsString> {
    let SinkOptions { fps, lossless, width, height, bits, .. } = *options;
    let input = if bits == 16 { "rgb48le" } else { "rgb24" };
    let (size, rate) = (format!("{width}x{height}"), fps.to_string());
    let mut text: Vec<&str> = vec!["-v", "error", "-xerror", "-y", "-f", "rawvideo", "-pix_fmt", input];
    text.extend(["-s", &size, "-framerate", &rate, "-i", "pipe:0", "-an"]);
    let (matrix, tag) = match ColorMatrix::usual(height) {
        ColorMatrix::Bt601 => ("bt601", "smpte170m"),
        _ => ("bt709", "bt709"),
    };
    // Chroma at half resolution needs even sizes, and the picture's size must not change for that.
    let chroma = if width % 2 == 0 && height % 2 == 0 { "yuv420p" } else { "yuv444p" };
    let filter = format!("scale=out_color_matrix={matrix}:out_range=limited:flags={CONVERSION_FLAGS},format={chroma}");
    match (lossless, bits) {
        (true, 16) => text.extend(["-c:v", "ffv1", "-level", "3", "-pix_fmt", "gbrp16le"]),
        (true, _) => text.extend(["-c:v", "libx264rgb", "-preset", "veryfast", "-qp", "0", "-pix_fmt", "rgb24"]),
        (false, _) => {
            text.extend(["-vf", &filter, "-c:v", "libx264", "-preset", "veryfast", "-crf", "16"]);
            text.extend(["-color_range", "tv", "-colorspace", tag, "-color_primaries", tag, "-color_trc", tag]);
        }
    }
    if !mkv {
        text.extend(["-movflags", "+faststart"]);
    }
    let mut arguments: Vec<OsString> = text.into_iter().map(OsString::from).collect();
    arguments.push(ffmpeg::file_argument(partial));
    arguments
}

impl Sink for VideoSink {
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError> {
        self.options.check(frame_index, pixels)?;
        let Some((_, stdin)) = &mut self.running else {
            return Err(self.refuse("the video has ended already"));
        };
        self.frames += 1;
        let Err(source) = stdin.write_all(&little_endian(&pixels.codes)) else { return Ok(()) };
        // A broken pipe means that ffmpeg gave up; its messages may say why.
        self.end()?;
        match source.kind() {
            std::io::ErrorKind::BrokenPipe => Err(self.refuse(ENDED_EARLY)),
            _ => Err(SinkError::Write { path: self.path.clone(), source }),
        }
    }

    fn finish(mut self: Box<Self>) -> Result<(), SinkError> {
        self.end()?;
        let is_empty = std::fs::metadata(self.partial.path()).is_ok_and(|file| file.len() == 0);
        if is_empty && self.frames > 0 {
            return Err(self.refuse(ENDED_EARLY));
        }
        let Self { path, partial, made, options, .. } = *self;
        partial.finish(options.force).map_err(|source| SinkError::of_writing(&path, source))?;
        made.into_iter().for_each(MadeFolder::keep);
        Ok(())
    }
}
