//! Real-time metadata of Sony cameras, one packet a frame: SMPTE RDD 18, Acquisition Metadata Sets
//! of Camera Parameters.

use super::setting::Setting;
use super::track::DataPacket;
use crate::camera::exposure::MAX_EXPOSURE_S;
use crate::frame::PhotoSettings;

/// Identifies such a track in MP4.
pub const TAG: &str = "rtmd";
/// The first two bytes of a set's 16-byte key, in the place of an item's tag.
const SET_KEY: u16 = 0x060e;
/// Bytes of a set's key.
const SET_KEY_BYTES: usize = 16;
/// A set within the set, of the camera's maker.
const NESTED_SET: u16 = 0x8300;
/// Iris (F-number), as the exponent of a power of 2.
const IRIS_F_NUMBER: u16 = 0x8000;
/// Shutter speed (time), a rational number of seconds.
const SHUTTER_TIME: u16 = 0x8109;
const ISO_SENSITIVITY: u16 = 0x810b;

/// The settings of a packet's frame.
pub fn settings(payload: &[u8], packet: &DataPacket) -> Vec<Setting> {
    let Some(at_s) = packet.start_s() else { return Vec::new() };
    let mut photo = PhotoSettings::default();
    for (tag, content) in items(payload) {
        match (tag, content) {
            // RDD 18, "Iris (F-Number)": F = 2^(8·(1 − x/2^16)).
            (IRIS_F_NUMBER, [a, b]) => {
                let closed = f64::from(u16::from_be_bytes([*a, *b])) / 65536.0;
                photo.f_number = Some((8.0 * (1.0 - closed)).exp2());
            }
            (SHUTTER_TIME, [a, b, c, d, e, f, g, h]) => {
                let [above, below] = [[*a, *b, *c, *d], [*e, *f, *g, *h]].map(u32::from_be_bytes).map(f64::from);
                photo.time_s = Some(above / below).filter(|time_s| *time_s > 0.0 && *time_s <= MAX_EXPOSURE_S);
            }
            (ISO_SENSITIVITY, [a, b]) => {
                photo.iso = Some(f64::from(u16::from_be_bytes([*a, *b]))).filter(|iso| *iso > 0.0);
            }
            _ => {}
        }
    }
    if photo == PhotoSettings::default() { Vec::new() } else { vec![Setting { at_s, photo }] }
}

/// The items of a packet: tag, number of bytes, content. The first two bytes give the length of the
/// packet's header. Ends at damage.
fn items(payload: &[u8]) -> impl Iterator<Item = (u16, &[u8])> {
    let word = |bytes: &[u8], at: usize| Some(u16::from_be_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
    let header = word(payload, 0).map_or(payload.len(), usize::from);
    let mut rest = payload.get(header..).unwrap_or_default();
    std::iter::from_fn(move || {
        loop {
            let (tag, length) = word(rest, 0).zip(word(rest, 2))?;
            match tag {
                0 => return None,
                // The set's length, two bytes, follows its key.
                SET_KEY => rest = rest.get(SET_KEY_BYTES + 2..)?,
                NESTED_SET => rest = rest.get(4..)?,
                _ => {
                    let (content, after) = rest.get(4..)?.split_at_checked(usize::from(length))?;
                    rest = after;
                    return Some((tag, content));
                }
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn item(tag: u16, content: &[u8]) -> Vec<u8> {
        [&tag.to_be_bytes()[..], &(content.len() as u16).to_be_bytes(), content].concat()
    }

    fn packet() -> DataPacket {
        DataPacket { pts_time: Some("0.04".to_owned()), duration_time: None, size: None }
    }

    /// f/4 is 2^2, so x = 3/4 · 2^16; 1/50 s; ISO 800.
    fn payload() -> Vec<u8> {
        let mut header = vec![0; 28];
        header[1] = 28;
        let lens = item(IRIS_F_NUMBER, &49152u16.to_be_bytes());
        let time = [1u32.to_be_bytes(), 50u32.to_be_bytes()].concat();
        let camera = [item(SHUTTER_TIME, &time), item(0x8101, &[1])].concat();
        let nested = item(NESTED_SET, &item(ISO_SENSITIVITY, &800u16.to_be_bytes()));
        [header, lens, camera, nested, vec![0; 6]].concat()
    }

    #[test]
    fn aperture_time_and_film_speed_of_a_frame_are_read() {
        let photo =
            PhotoSettings { f_number: Some(4.0), time_s: Some(0.02), iso: Some(800.0), ..PhotoSettings::default() };
        assert_eq!(settings(&payload(), &packet()), [Setting { at_s: 0.04, photo }]);
        assert_eq!(settings(&[0, 28], &packet()), []);
        assert_eq!(settings(&[], &packet()), []);
    }

    proptest! {
        #[test]
        fn damaged_packets_never_panic(at in 0usize..90, value in any::<u8>(), length in 0usize..100) {
            let mut bytes = payload();
            let at = at % bytes.len();
            bytes[at] = value;
            bytes.truncate(length);
            let _ = settings(&bytes, &packet());
        }
    }
}
