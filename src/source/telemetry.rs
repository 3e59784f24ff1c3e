//! Exposure times and film speeds that an action camera wrote beside its video: the GPMF track of
//! GoPro cameras. Source: the GPMF introduction of gopro/gpmf-parser (keys SHUT and ISOE).
//!
//! Not modelled: the sensor gain of older cameras (ISOG), orientations (CORI, IORI), which a
//! stabilised picture needs together, positions, telemetry of other makers.

use std::ffi::OsString;
use std::path::Path;

use serde::Deserialize;

use super::{SourceError, ffmpeg};
use crate::camera::exposure::MAX_EXPOSURE_S;
use crate::frame::PhotoSettings;
use crate::program;

/// Identifies a GPMF track.
const GPMF_TAG: &str = "gpmd";
/// Depth of nesting that is followed; GPMF has two levels, the device and its streams.
const MAX_NESTING: u32 = 4;

/// A camera's settings while it filmed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Telemetry {
    /// Settings with their times after the file's start, s. Ascending.
    pub settings: Vec<(f64, PhotoSettings)>,
}

impl Telemetry {
    /// The settings nearest to a time after the file's start.
    pub fn at(&self, time_s: f64) -> PhotoSettings {
        let after = self.settings.partition_point(|(at_s, _)| *at_s < time_s);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| self.settings.get(at));
        let nearest = near.min_by(|a, b| (a.0 - time_s).abs().total_cmp(&(b.0 - time_s).abs()));
        nearest.map(|(_, settings)| *settings).unwrap_or_default()
    }
}

/// ffprobe's JSON output for data streams.
#[derive(Deserialize)]
struct DataProbe {
    #[serde(default)]
    streams: Vec<DataStream>,
    #[serde(default)]
    packets: Vec<DataPacket>,
}

/// A data stream in ffprobe's JSON output.
#[derive(Deserialize)]
struct DataStream {
    index: usize,
    #[serde(default)]
    codec_tag_string: String,
}

/// A packet of a data stream in ffprobe's JSON output.
#[derive(Deserialize)]
struct DataPacket {
    pts_time: Option<String>,
    duration_time: Option<String>,
    /// Bytes.
    size: Option<String>,
}

fn probe(file: &Path, streams: &str, entries: &str) -> Result<DataProbe, SourceError> {
    let options = ["-v", "error", "-select_streams", streams, "-show_entries", entries, "-of", "json"];
    let arguments: Vec<OsString> = options.into_iter().map(OsString::from).chain(ffmpeg::input(file)).collect();
    let written = program::output("ffprobe", &arguments)?.written;
    serde_json::from_slice(&written)
        .map_err(|e| SourceError::content(file, format!("ffprobe's output cannot be parsed: {e}")))
}

/// The telemetry of a video file. `None` if it has none.
pub fn read(file: &Path) -> Result<Option<Telemetry>, SourceError> {
    let streams = probe(file, "d", "stream=index,codec_tag_string")?.streams;
    let Some(stream) = streams.iter().find(|stream| stream.codec_tag_string == GPMF_TAG) else { return Ok(None) };
    let number = stream.index.to_string();
    let packets = probe(file, &number, "packet=pts_time,duration_time,size")?.packets;
    let start: Vec<OsString> = ["-nostdin", "-v", "error"].map(OsString::from).into();
    let track = ["-map", &format!("0:{number}"), "-c", "copy", "-f", "data", "pipe:1"].map(OsString::from);
    let arguments: Vec<OsString> = start.into_iter().chain(ffmpeg::input(file)).chain(track).collect();
    let payloads = program::output("ffmpeg", &arguments)?.written;
    let telemetry = parse(&payloads, &packets);
    Ok((!telemetry.settings.is_empty()).then_some(telemetry))
}

/// An item of a GPMF payload: four letters, type, content.
struct Item<'a> {
    key: &'a [u8],
    kind: u8,
    content: &'a [u8],
}

/// The items of a payload: key, type, size and number of its elements, content padded to four
/// bytes. Ends at damage.
fn items(mut bytes: &[u8]) -> impl Iterator<Item = Item<'_>> {
    std::iter::from_fn(move || {
        let (head, rest) = bytes.split_first_chunk::<8>()?;
        let length = usize::from(head[5]) * usize::from(u16::from_be_bytes([head[6], head[7]]));
        let item = Item { key: &bytes[..4], kind: head[4], content: rest.get(..length)? };
        bytes = rest.get(length.next_multiple_of(4)..).unwrap_or_default();
        Some(item)
    })
}

/// All numbers of the first item with a key, within nested items.
fn numbers(bytes: &[u8], key: &[u8; 4], levels: u32) -> Option<Vec<f64>> {
    items(bytes).find_map(|item| match item.kind {
        0 if levels > 0 => numbers(item.content, key, levels - 1),
        b'f' if item.key == key => {
            Some(item.content.as_chunks().0.iter().map(|word| f64::from(f32::from_be_bytes(*word))).collect())
        }
        b'S' if item.key == key => {
            Some(item.content.as_chunks().0.iter().map(|word| f64::from(u16::from_be_bytes(*word))).collect())
        }
        _ => None,
    })
}

/// The samples of a packet are spread evenly over its duration.
fn parse(payloads: &[u8], packets: &[DataPacket]) -> Telemetry {
    let seconds = |text: &Option<String>| text.as_deref()?.parse::<f64>().ok();
    let mut settings = Vec::new();
    let mut rest = payloads;
    for packet in packets {
        let Some(length) = packet.size.as_deref().and_then(|text| text.parse().ok()) else { break };
        let Some((payload, after)) = rest.split_at_checked(length) else { break };
        rest = after;
        let Some((start_s, duration_s)) = seconds(&packet.pts_time).zip(seconds(&packet.duration_time)) else {
            continue;
        };
        let times_s = numbers(payload, b"SHUT", MAX_NESTING).unwrap_or_default();
        let iso = numbers(payload, b"ISOE", MAX_NESTING).unwrap_or_default();
        for (at, time_s) in times_s.iter().enumerate() {
            let share = at as f64 / times_s.len() as f64;
            let is_plausible = *time_s > 0.0 && *time_s <= MAX_EXPOSURE_S;
            let film_speed = iso.get((share * iso.len() as f64) as usize).copied().filter(|iso| *iso > 0.0);
            let photo =
                PhotoSettings { time_s: is_plausible.then_some(*time_s), iso: film_speed, ..PhotoSettings::default() };
            settings.push((start_s + share * duration_s, photo));
        }
    }
    Telemetry { settings }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn item(key: &[u8; 4], kind: u8, size: u8, content: &[u8]) -> Vec<u8> {
        let count = (content.len() / usize::from(size)) as u16;
        let mut bytes = [&key[..], &[kind, size], &count.to_be_bytes(), content].concat();
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        bytes
    }

    fn payload(times_s: &[f32], iso: &[u16]) -> Vec<u8> {
        let times: Vec<u8> = times_s.iter().flat_map(|time_s| time_s.to_be_bytes()).collect();
        let iso: Vec<u8> = iso.iter().flat_map(|iso| iso.to_be_bytes()).collect();
        let streams = [
            item(b"STRM", 0, 1, &[item(b"STNM", b'c', 1, b"Exposure"), item(b"SHUT", b'f', 4, &times)].concat()),
            item(b"STRM", 0, 1, &item(b"ISOE", b'S', 2, &iso)),
        ];
        item(b"DEVC", 0, 1, &streams.concat())
    }

    fn packet(start_s: f64, bytes: usize) -> DataPacket {
        DataPacket {
            pts_time: Some(start_s.to_string()),
            duration_time: Some("1".to_owned()),
            size: Some(bytes.to_string()),
        }
    }

    #[test]
    fn samples_are_spread_over_their_packet() {
        // The first packet also holds another device, whose times do not count.
        let other = item(b"DEVC", 0, 1, &item(b"SHUT", b'f', 4, &[0; 4]));
        let first = [payload(&[0.01, 0.02, 0.04, 0.005], &[100, 200]), other].concat();
        let payloads = [&first[..], &payload(&[0.008, 0.0], &[400])].concat();
        let telemetry = parse(&payloads, &[packet(0.0, first.len()), packet(1.0, payloads.len() - first.len())]);
        let times_s: Vec<f64> = telemetry.settings.iter().map(|(at_s, _)| *at_s).collect();
        assert_eq!(times_s, [0.0, 0.25, 0.5, 0.75, 1.0, 1.5]);
        for (at_s, time_s, iso) in [(0.0, 0.01, 100.0), (0.3, 0.02, 100.0), (0.5, 0.04, 200.0), (1.1, 0.008, 400.0)] {
            let settings = telemetry.at(at_s);
            assert!(
                (settings.time_s.unwrap() - time_s).abs() < 1e-8 && settings.iso == Some(iso),
                "{at_s}: {settings:?}"
            );
        }
        // 0 is no exposure time.
        assert_eq!(telemetry.at(9.0).time_s, None);
        assert_eq!(Telemetry::default().at(0.0), PhotoSettings::default());
    }

    proptest! {
        #[test]
        fn damaged_payloads_never_panic(at in 0usize..90, value in any::<u8>(), length in 0usize..120) {
            let mut bytes = payload(&[0.01, 0.02], &[100, 200]);
            let at = at % bytes.len();
            bytes[at] = value;
            bytes.truncate(length);
            let _ = parse(&bytes, &[packet(0.0, 40), packet(1.0, bytes.len().saturating_sub(40))]);
        }
    }

    #[test]
    fn deep_nesting_is_not_followed() {
        let nested = (0..10_000).fold(Vec::new(), |inner, _| item(b"STRM", 0, 4, &inner[..inner.len().min(200_000)]));
        assert_eq!(numbers(&nested, b"SHUT", MAX_NESTING), None);
    }
}
