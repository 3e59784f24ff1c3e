//! Arguments of the `ffmpeg` and `ffprobe` programs.

use std::ffi::OsString;
use std::path::Path;

use crate::program::{self, ProgramError};

/// ffmpeg's names of the containers that are read. None of them names other files. Playlists, which
/// do, are not read.
const CONTAINERS: &str = "mov,matroska,avi,mpegts,mpeg,mxf";
/// Names of the containers for messages.
const CONTAINERS_READ: &str = "MP4, QuickTime, Matroska, WebM, AVI, MPEG-TS, MPEG-PS and MXF";
/// ffmpeg's words for a file of another kind.
const NOT_WHITELISTED: &str = "not on whitelist";

/// A video file as ffmpeg's or ffprobe's input: this file alone, and only if it is a container that
/// is read.
pub fn input(path: &Path) -> impl Iterator<Item = OsString> {
    let options = ["-protocol_whitelist", "file", "-format_whitelist", CONTAINERS, "-i"].map(OsString::from);
    options.into_iter().chain([file_argument(path)])
}

/// The refusal of a file whose container a program refused to read; `None` for other problems.
pub fn container_refusal(problem: &str) -> Option<String> {
    problem.contains(NOT_WHITELISTED).then(|| {
        format!(
            "is not a supported video container; supported are {CONTAINERS_READ}. Playlists are refused because they name \
             other files (ffmpeg -i FILE -c copy NEW.mkv makes one file of one)"
        )
    })
}

/// A path as an argument of ffmpeg: never an option, never a protocol such as `concat:`.
pub fn file_argument(path: &Path) -> OsString {
    let mut argument = OsString::from("file:");
    argument.push(path);
    argument
}

/// The first line of `ffmpeg -version`.
pub fn version() -> Result<String, ProgramError> {
    let banner = program::output("ffmpeg", &["-version".into()])?.written;
    Ok(String::from_utf8_lossy(&banner).lines().next().unwrap_or_default().to_owned())
}
