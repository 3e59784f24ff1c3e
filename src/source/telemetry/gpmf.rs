//! GPMF tracks of GoPro cameras: exposure times (key SHUT) and film speeds (ISOE). Source: the GPMF
//! introduction of gopro/gpmf-parser.
//!
//! Not modelled: the sensor gain of older cameras (ISOG), orientations (CORI, IORI), which a
//! stabilised picture needs together, positions.

use super::setting::Setting;
use super::track::DataPacket;
use crate::camera::exposure::MAX_EXPOSURE_S;
use crate::frame::PhotoSettings;

/// Identifies a GPMF track.
pub const TAG: &str = "gpmd";
/// Depth of nesting that is followed; GPMF has two levels, the device and its streams.
const MAX_NESTING: u32 = 4;

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

/// The settings in a packet's payload. Samples are spread evenly over the packet's duration.
pub fn settings(payload: &[u8], packet: &DataPacket) -> Vec<Setting> {
    let Some((start_s, duration_s)) = packet.start_s().zip(packet.duration_s()) else { return Vec::new() };
    let times_s = numbers(payload, b"SHUT", MAX_NESTING).unwrap_or_default();
    let iso = numbers(payload, b"ISOE", MAX_NESTING).unwrap_or_default();
    let setting = |(at, time_s): (usize, &f64)| {
        let share = at as f64 / times_s.len() as f64;
        let is_plausible = *time_s > 0.0 && *time_s <= MAX_EXPOSURE_S;
        let film_speed = iso.get((share * iso.len() as f64) as usize).copied().filter(|iso| *iso > 0.0);
        let photo =
            PhotoSettings { time_s: is_plausible.then_some(*time_s), iso: film_speed, ..PhotoSettings::default() };
        Setting { at_s: start_s + share * duration_s, photo }
    };
    times_s.iter().enumerate().map(setting).collect()
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

    fn packet(start_s: f64) -> DataPacket {
        DataPacket { pts_time: Some(start_s.to_string()), duration_time: Some("1".to_owned()), size: None }
    }

    #[test]
    fn samples_are_spread_over_their_packet() {
        // The first packet also holds another device, whose times do not count.
        let other = item(b"DEVC", 0, 1, &item(b"SHUT", b'f', 4, &[0; 4]));
        let first = [payload(&[0.01, 0.02, 0.04, 0.005], &[100, 200]), other].concat();
        let both = [settings(&first, &packet(0.0)), settings(&payload(&[0.008, 0.0], &[400]), &packet(1.0))].concat();
        let values = both.iter().map(|setting| (setting.at_s, setting.photo.time_s, setting.photo.iso));
        let expected = [
            (0.0, Some(0.01f32), 100.0),
            (0.25, Some(0.02), 100.0),
            (0.5, Some(0.04), 200.0),
            (0.75, Some(0.005), 200.0),
            (1.0, Some(0.008), 400.0),
            // 0 is no exposure time.
            (1.5, None, 400.0),
        ];
        let expected = expected.map(|(at_s, time_s, iso)| (at_s, time_s.map(f64::from), Some(iso)));
        assert_eq!(values.collect::<Vec<_>>(), expected);
    }

    proptest! {
        #[test]
        fn damaged_payloads_never_panic(at in 0usize..90, value in any::<u8>(), length in 0usize..120) {
            let mut bytes = payload(&[0.01, 0.02], &[100, 200]);
            let at = at % bytes.len();
            bytes[at] = value;
            bytes.truncate(length);
            let _ = settings(&bytes, &packet(0.0));
        }
    }

    #[test]
    fn deep_nesting_is_not_followed() {
        let nested = (0..10_000).fold(Vec::new(), |inner, _| item(b"STRM", 0, 4, &inner[..inner.len().min(200_000)]));
        assert_eq!(numbers(&nested, b"SHUT", MAX_NESTING), None);
    }
}
