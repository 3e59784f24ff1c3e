//! Exposure times and film speeds that a camera wrote while it filmed: in a data track of the video
//! (GPMF of GoPro, real-time metadata of Sony), as its subtitles, or in a file of subtitles beside
//! it (DJI).
//!
//! Not modelled: tracks in MXF, of Canon, Insta360, RED and Blackmagic, and DJI's binary track.

mod gpmf;
mod rtmd;
mod setting;
mod subtitles;
mod track;

use std::path::Path;

use super::{SourceError, file};
use track::{probe, stream_bytes, track_settings};

pub use setting::Telemetry;

/// The telemetry of a video file. `None` if it has none.
pub fn read(video: &Path) -> Result<Option<Telemetry>, SourceError> {
    let streams = probe(video, &[], "stream=index,codec_type,codec_tag_string")?.streams;
    for stream in &streams {
        let settings = match stream.codec_tag_string.as_str() {
            gpmf::TAG => track_settings(video, stream, gpmf::settings)?,
            rtmd::TAG => track_settings(video, stream, rtmd::settings)?,
            _ if stream.codec_type == "subtitle" => {
                subtitles::settings(&String::from_utf8_lossy(&stream_bytes(video, stream.index, "srt")?))
            }
            _ => continue,
        };
        if let Some(telemetry) = Telemetry::new(settings, None) {
            return Ok(Some(telemetry));
        }
    }
    let sidecar =
        ["SRT", "srt"].map(|extension| video.with_extension(extension)).into_iter().find(|path| path.is_file());
    let Some(sidecar) = sidecar else { return Ok(None) };
    let text = file::read(&sidecar, file::MAX_TEXT_BYTES)
        .map_err(|source| SourceError::Read { file: sidecar.clone(), source })?;
    Ok(Telemetry::new(subtitles::settings(&String::from_utf8_lossy(&text)), Some(sidecar)))
}
