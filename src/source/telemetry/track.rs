//! Streams of a video file beside its pictures, by ffprobe and ffmpeg.

use std::ffi::OsString;
use std::path::Path;

use serde::Deserialize;

use super::setting::Setting;
use crate::program;
use crate::source::{SourceError, ffmpeg};

/// ffprobe's JSON output for streams and packets.
#[derive(Deserialize)]
pub struct StreamProbe {
    #[serde(default)]
    pub streams: Vec<TaggedStream>,
    #[serde(default)]
    packets: Vec<DataPacket>,
}

/// A stream in ffprobe's JSON output.
#[derive(Deserialize)]
pub struct TaggedStream {
    pub index: usize,
    #[serde(default)]
    pub codec_type: String,
    #[serde(default)]
    pub codec_tag_string: String,
}

/// A packet of a data stream in ffprobe's JSON output.
#[derive(Deserialize)]
pub struct DataPacket {
    pub pts_time: Option<String>,
    pub duration_time: Option<String>,
    /// Bytes.
    pub size: Option<String>,
}

impl DataPacket {
    pub fn start_s(&self) -> Option<f64> {
        self.pts_time.as_deref()?.parse().ok()
    }

    pub fn duration_s(&self) -> Option<f64> {
        self.duration_time.as_deref()?.parse().ok()
    }
}

pub fn probe(file: &Path, options: &[&str], entries: &str) -> Result<StreamProbe, SourceError> {
    let options = [&["-v", "error"], options, &["-show_entries", entries, "-of", "json"]].concat();
    let arguments: Vec<OsString> = options.into_iter().map(OsString::from).chain(ffmpeg::input(file)).collect();
    let written = program::output("ffprobe", &arguments)?.written;
    serde_json::from_slice(&written)
        .map_err(|e| SourceError::content(file, format!("ffprobe's output cannot be parsed: {e}")))
}

/// The bytes of one stream, as ffmpeg's `format`.
pub fn stream_bytes(file: &Path, index: usize, format: &str) -> Result<Vec<u8>, SourceError> {
    let start: Vec<OsString> = ["-nostdin", "-v", "error"].map(OsString::from).into();
    let codec: &[&str] = if format == "data" { &["-c", "copy"] } else { &[] };
    let map = format!("0:{index}");
    let track = [&["-map", &map], codec, &["-f", format, "pipe:1"]].concat();
    let track = track.into_iter().map(OsString::from);
    let arguments: Vec<OsString> = start.into_iter().chain(ffmpeg::input(file)).chain(track).collect();
    Ok(program::output("ffmpeg", &arguments)?.written)
}

/// The settings of all packets of a data track.
pub fn track_settings(
    file: &Path,
    stream: &TaggedStream,
    of_payload: impl Fn(&[u8], &DataPacket) -> Vec<Setting>,
) -> Result<Vec<Setting>, SourceError> {
    let packets =
        probe(file, &["-select_streams", &stream.index.to_string()], "packet=pts_time,duration_time,size")?.packets;
    Ok(packet_settings(&stream_bytes(file, stream.index, "data")?, &packets, of_payload))
}

/// The settings of payloads that follow each other. Ends at damage.
fn packet_settings(
    mut payloads: &[u8],
    packets: &[DataPacket],
    of_payload: impl Fn(&[u8], &DataPacket) -> Vec<Setting>,
) -> Vec<Setting> {
    let mut settings = Vec::new();
    for packet in packets {
        let Some(length) = packet.size.as_deref().and_then(|text| text.parse().ok()) else { break };
        let Some((payload, rest)) = payloads.split_at_checked(length) else { break };
        payloads = rest;
        settings.extend(of_payload(payload, packet));
    }
    settings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::PhotoSettings;

    fn setting(at_s: f64, iso: f64) -> Setting {
        Setting { at_s, photo: PhotoSettings { iso: Some(iso), ..PhotoSettings::default() } }
    }

    #[test]
    fn each_packet_has_its_own_part_of_the_track() {
        let packet = |size: &str| DataPacket { pts_time: None, duration_time: None, size: Some(size.to_owned()) };
        let of_payload = |payload: &[u8], _: &DataPacket| vec![setting(0.0, payload.len() as f64)];
        // The last packet is cut short.
        let packets = [packet("2"), packet("3"), packet("4")];
        let settings = packet_settings(&[0; 8], &packets, of_payload);
        assert_eq!(settings, [setting(0.0, 2.0), setting(0.0, 3.0)]);
    }
}
