//! Outputs: a folder of PNG files, a video file, raw values on standard output; layers as OpenEXR.
//! Unfinished files never have their final name.

pub mod atomic;
pub mod exr;
pub mod folder;
pub mod lettering;
pub mod mark;
pub mod photograph;
pub mod picture;
pub mod raw;
pub(crate) mod rotation;
pub mod sdr;
mod timed;
pub(crate) mod video;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use self::atomic::Destination;
pub use self::video::default_codec;
pub(crate) use self::video::metadata as label_metadata;
use crate::label::SourceLabel;
use crate::pixels::{Codes, Pixels};
use crate::program::ProgramError;
use crate::source::presentation::Presentation;
use crate::source::video::Soundtrack;
use crate::text::reason;

/// Destination of finished frames, in order.
pub trait Sink {
    /// Writes a frame; `frame_index` names it if the sink names frames.
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError>;
    /// Completes the output. Without it a video stays unfinished and is removed.
    fn finish(self: Box<Self>) -> Result<(), SinkError>;
}

/// Kind of output, by its path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OutPath {
    /// A PNG sequence.
    Folder(PathBuf),
    /// `.mp4`, `.mkv` or `.mov`.
    Video(PathBuf),
    /// Raw R, G, B on standard output.
    Stdout,
    /// Raw R, G, B into an existing device or pipe.
    Stream(PathBuf),
}

/// True if a path is the standard output: `-`, `/dev/stdout`.
pub fn is_stdout(path: &Path) -> bool {
    ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"].iter().any(|name| path.as_os_str() == *name)
}

impl OutPath {
    /// Parses the user's argument: `-`, a name ending in .mp4, .mkv or .mov, an existing device or
    /// pipe, otherwise a folder. A name with another file extension is an error.
    pub fn parse(path: &Path) -> Result<Self, SinkError> {
        if is_stdout(path) {
            return Ok(Self::Stdout);
        }
        let is_stream = matches!(Destination::of(path), Ok(Destination::Stream));
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match extension.as_str() {
            _ if path.is_dir() => Ok(Self::Folder(path.to_owned())),
            "mp4" | "mkv" | "mov" if is_stream => Err(SinkError::Refused {
                path: path.to_owned(),
                problem: "is a pipe or a device, which takes raw RGB alone; name a file for a video".to_owned(),
            }),
            "mp4" | "mkv" | "mov" => Ok(Self::Video(path.to_owned())),
            "avi" | "webm" | "m4v" | "mpg" | "mpeg" | "gif" | "png" | "jpg" | "jpeg" | "tif" | "tiff" | "exr"
            | "raw" | "rgb" | "yuv" | "y4m" => Err(SinkError::Refused {
                path: path.to_owned(),
                problem: format!("cannot write .{extension}; {ACCEPTED_OUTPUTS}"),
            }),
            _ if is_stream => Ok(Self::Stream(path.to_owned())),
            _ => Ok(Self::Folder(path.to_owned())),
        }
    }
}

const ACCEPTED_OUTPUTS: &str = "expected a folder (PNG sequence), a .mp4, .mkv or .mov file, or - (raw RGB)";

/// Codec of a video that is not lossless.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VideoCodec {
    /// H.264 at quality 16, with 8 bits, or 10 bits for high dynamic range.
    H264,
    /// HEVC at quality 14, with 10 bits.
    Hevc,
    /// ProRes 422 HQ, or 4444 where a side is odd, with 10 bits.
    ProRes,
}

/// Output options.
#[derive(Clone, Debug, PartialEq)]
pub struct SinkOptions {
    /// True if existing output may be replaced.
    pub force: bool,
    /// Frames per second, for video.
    pub fps: f64,
    /// Presentation time of each frame by its index, seconds, for video with a variable frame rate.
    pub times_s: Option<Arc<[f64]>>,
    /// Presentation metadata of a video.
    pub presentation: Presentation,
    /// True for a lossless video.
    pub lossless: bool,
    /// Of a video that is not lossless; `None`: by the file's extension.
    pub codec: Option<VideoCodec>,
    /// Frames of each closed group of pictures of H.264 and HEVC, at a constant quantiser: a video
    /// of whole groups has the pictures of the same groups in a longer one. `None`: groups and
    /// quantisers of the encoder's choice.
    pub closed_groups: Option<u32>,
    /// Copied into a video.
    pub soundtrack: Option<Soundtrack>,
    /// Written into the file's metadata; raw values have none.
    pub label: Option<SourceLabel>,
    pub width: u32,
    pub height: u32,
    /// 8 or 16, the depth of the pixels.
    pub bits: u32,
}

/// Checks that a file can be created: nothing protected is in the way, and its folder is writable,
/// or can be created.
pub fn check_file(path: &Path, force: bool) -> Result<(), SinkError> {
    let refuse = |problem: String| Err(SinkError::Refused { path: path.to_owned(), problem });
    if path.is_dir() {
        return refuse("is a folder; name a file".to_owned());
    }
    let Destination::File(at) = Destination::of(path).map_err(|source| SinkError::of_writing(path, source))? else {
        return Ok(());
    };
    if at.exists() && !force {
        return Err(SinkError::Exists { path: path.to_owned() });
    }
    atomic::check_not_protected(&at).map_err(|source| SinkError::of_writing(path, source))?;
    // Writing creates missing folders. A dangling symbolic link is in the way.
    let mut folders = atomic::folder_of(&at).into_iter().flat_map(Path::ancestors);
    let there = folders.find(|folder| folder.symlink_metadata().is_ok()).unwrap_or(Path::new("."));
    if !there.is_dir() {
        let kind = if there.exists() { "a file and no folder" } else { "a link to a place that is gone" };
        return refuse(format!("cannot be written, for {} is {kind}; choose another place", there.display()));
    }
    // An unnamed file, deleted at once.
    tempfile::tempfile_in(there).map(drop).map_err(|source| SinkError::of_writing(path, source))
}

/// Why an output could not be written.
#[derive(Debug, thiserror::Error)]
pub enum SinkError {
    #[error("{}: {problem}", path.display())]
    Refused { path: PathBuf, problem: String },
    #[error("{}: exists already, and is kept (--force replaces it)", path.display())]
    Exists { path: PathBuf },
    #[error("{}: cannot be written: {}", path.display(), reason(source))]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{}: cannot be read for the record of the output: {}", path.display(), reason(source))]
    Read { path: PathBuf, source: std::io::Error },
    #[error("standard output: {}", reason(source))]
    Stdout { source: std::io::Error },
    #[error(transparent)]
    Program(#[from] ProgramError),
    #[error("{}: {source}", path.display())]
    Encoder { path: PathBuf, source: ProgramError },
    #[error("frame {frame} is {actual}; {expected} was announced")]
    Shape { frame: usize, actual: String, expected: String },
}

impl SinkError {
    pub(crate) fn of_writing(path: &Path, source: std::io::Error) -> Self {
        let path = path.to_owned();
        match source.kind() {
            std::io::ErrorKind::AlreadyExists => Self::Exists { path },
            _ => Self::Write { path, source },
        }
    }
}

/// Checks that the output does not exist. Unless `force`, an existing file is refused, and so is a
/// non-empty folder.
pub fn check(out: &OutPath, force: bool) -> Result<(), SinkError> {
    let taken = match out {
        _ if force => false,
        OutPath::Folder(path) => std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some()),
        OutPath::Video(path) => path.exists(),
        OutPath::Stdout | OutPath::Stream(_) => false,
    };
    match out {
        OutPath::Folder(path) | OutPath::Video(path) if taken => Err(SinkError::Exists { path: path.clone() }),
        _ => Ok(()),
    }
}

/// Opens an output after [`check`].
pub fn open(out: &OutPath, options: &SinkOptions) -> Result<Box<dyn Sink + Send>, SinkError> {
    let path = match out {
        OutPath::Folder(path) | OutPath::Video(path) | OutPath::Stream(path) => path.as_path(),
        OutPath::Stdout => Path::new("-"),
    };
    if !matches!(options.bits, 8 | 16) || options.width == 0 || options.height == 0 {
        let SinkOptions { bits, width, height, .. } = options;
        let problem = format!("{width}x{height} with {bits} bits cannot be written; expected 8 or 16 bits");
        return Err(SinkError::Refused { path: path.to_owned(), problem });
    }
    check(out, options.force)?;
    if options.codec.is_some() && !matches!(out, OutPath::Video(_)) {
        let problem = "a codec goes with a video; name a .mp4, .mkv or .mov file".to_owned();
        return Err(SinkError::Refused { path: path.to_owned(), problem });
    }
    Ok(match out {
        OutPath::Folder(path) => Box::new(folder::FolderSink::open(path, options)?),
        OutPath::Video(path) => Box::new(video::VideoSink::open(path, options)?),
        OutPath::Stdout => Box::new(raw::RawSink::new(std::io::stdout(), options)),
        OutPath::Stream(path) => {
            let file = std::fs::File::options().write(true).open(path);
            let file = file.map_err(|source| SinkError::of_writing(path, source))?;
            Box::new(raw::RawSink::new(file, options).named(path))
        }
    })
}

impl SinkOptions {
    /// Checks size and depth of a frame.
    fn check(&self, frame: usize, pixels: &Pixels) -> Result<(), SinkError> {
        let bits = if pixels.max_code() == 255 { 8 } else { 16 };
        if (pixels.width, pixels.height, bits) == (self.width, self.height, self.bits) {
            return Ok(());
        }
        Err(SinkError::Shape {
            frame,
            actual: format!("{}x{} with {bits} bits", pixels.width, pixels.height),
            expected: format!("{}x{} with {} bits", self.width, self.height, self.bits),
        })
    }
}

/// An encoding error as a write error. PNG's encoder wraps the system's error.
fn of_image(error: image::ImageError) -> std::io::Error {
    let image::ImageError::IoError(error) = error else {
        let causes = std::iter::successors(std::error::Error::source(&error), |cause| cause.source());
        let code = causes.filter_map(|cause| cause.downcast_ref::<std::io::Error>()).find_map(|e| e.raw_os_error());
        return code.map_or_else(|| std::io::Error::other(error), std::io::Error::from_raw_os_error);
    };
    // In the middle of a picture the encoder returns only the text.
    let text = error.to_string();
    let number = text.rsplit_once("(os error ").and_then(|(_, rest)| rest.strip_suffix(')')?.parse().ok());
    match number.filter(|_| error.raw_os_error().is_none()) {
        Some(number) => std::io::Error::from_raw_os_error(number),
        None => error,
    }
}

fn of_exr(error: ::exr::error::Error) -> std::io::Error {
    match error {
        ::exr::error::Error::Io(error) => error,
        other => std::io::Error::other(other),
    }
}

/// Code values as bytes, 16-bit ones in little-endian order.
pub fn little_endian(codes: &Codes) -> std::borrow::Cow<'_, [u8]> {
    match codes {
        Codes::U8(codes) => codes.into(),
        Codes::U16(codes) if cfg!(target_endian = "little") => bytemuck::cast_slice::<u16, u8>(codes).into(),
        Codes::U16(codes) => codes.iter().flat_map(|code| code.to_le_bytes()).collect::<Vec<u8>>().into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_path_determines_the_sink() {
        let folder = tempfile::tempdir().unwrap();
        let oddly_named = folder.path().join("frames.mp4");
        std::fs::create_dir(&oddly_named).unwrap();
        for (path, expected) in [
            ("-", OutPath::Stdout),
            ("out", OutPath::Folder("out".into())),
            ("take.2", OutPath::Folder("take.2".into())),
            ("a/b.MP4", OutPath::Video("a/b.MP4".into())),
            ("b.mkv", OutPath::Video("b.mkv".into())),
            (oddly_named.to_str().unwrap(), OutPath::Folder(oddly_named.clone())),
        ] {
            assert_eq!(OutPath::parse(Path::new(path)).unwrap(), expected);
        }
        let error = OutPath::parse(Path::new("b.avi")).unwrap_err().to_string();
        assert!(error.starts_with("b.avi: cannot write .avi; expected a folder"), "{error}");
    }

    /// Regardless of the encoder's own error type.
    #[cfg(target_os = "linux")]
    #[test]
    fn full_disk_is_reported_by_every_encoder() {
        let folder = tempfile::tempdir().unwrap();
        let full = |name: &str| {
            let path = folder.path().join(name);
            std::os::unix::fs::symlink("/dev/full", &path).unwrap();
            path
        };
        let light = crate::pixels::LinearImage { width: 200, height: 200, rgba: vec![[0.5; 4]; 40_000] };
        for name in ["a.png", "a.exr"] {
            let error = picture::write(&full(name), &light, &Default::default(), None, true).unwrap_err().to_string();
            assert!(error.contains("cannot be written: the disk is full"), "{error}");
        }
        // Exceeds the encoder's buffers.
        let codes = (0..3 * 640 * 480_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let frame = Pixels::from_u8(640, 480, codes).unwrap();
        let error = folder::write_frame(&full("large.png"), &frame, None, None, true).unwrap_err().to_string();
        assert!(error.contains("cannot be written: the disk is full"), "{error}");
    }
}
