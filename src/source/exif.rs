//! The settings that a camera wrote into a picture: a JPEG, or a container that the library reads
//! (HEIF, TIFF and raw files based on it). Source: CIPA DC-008 (Exif 2.32).

use std::io::{BufReader, Read, Seek};
use std::path::Path;

use exif::{DateTime, In, Tag, Value};

use super::still_format::StillFormat;
use super::{SourceError, file as plain, heif};
use crate::camera::exposure::MAX_EXPOSURE_S;
use crate::frame::PhotoSettings;

const IDENTIFIER: &[u8] = b"Exif\0\0";
/// Larger TIFF and raw files are not searched for EXIF, bytes.
const MAX_TIFF_BYTES: u64 = 512 << 20;
/// A PhotographicSensitivity that means: too large for this field, see the others.
const SEE_ELSEWHERE: f64 = 65535.0;
/// Larger APEX values mean unknown: Exif writes infinity as -1/0 or as the largest numerators.
const MAX_APEX: f64 = 20.0;

/// The contents of a picture's EXIF, as far as they are intact.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Exif {
    pub settings: PhotoSettings,
    /// How the picture should be turned or mirrored to be shown, 2 to 8. `None` if it should not
    /// be.
    pub orientation: Option<u32>,
    /// Damage in the rest of the data.
    pub damage: Option<String>,
}

/// The EXIF of a picture; empty for a file without EXIF, or one of another kind. An error if the
/// file cannot be read.
pub fn read(file: &Path) -> Result<Exif, SourceError> {
    let reader = plain::open(file).map_err(|source| SourceError::Read { file: file.to_owned(), source })?;
    let mut reader = BufReader::new(reader);
    match StillFormat::of_file(file)? {
        Some(StillFormat::Jpeg) => Ok(segment(&mut reader).map(parse).unwrap_or_default()),
        Some(format @ (StillFormat::Heif | StillFormat::Tiff | StillFormat::Raw)) => {
            let length = plain::open(file).and_then(|file| file.metadata()).map_or(u64::MAX, |data| data.len());
            // The library reads TIFF as a whole.
            if format != StillFormat::Heif && length > MAX_TIFF_BYTES {
                return Ok(Exif::default());
            }
            let exif = exif::Reader::new().continue_on_error(true).read_from_container(&mut reader);
            let exif = exif.or_else(|error| error.distill_partial_result(|_| {}));
            let mut read = exif.map(|exif| of_fields(&exif)).unwrap_or_default();
            if format == StillFormat::Heif {
                // The container's rotation counts for decoders, and the developed picture is
                // without it.
                let quarter_turns = heif::read(file)?.quarter_turns;
                read.orientation = [None, Some(8), Some(3), Some(6)][quarter_turns as usize & 3];
            }
            Ok(read)
        }
        _ => Ok(Exif::default()),
    }
}

/// The settings in the EXIF of a file's bytes.
pub fn settings_of(file: &[u8]) -> PhotoSettings {
    segment(&mut std::io::Cursor::new(file)).map(|segment| parse(segment).settings).unwrap_or_default()
}

/// The EXIF segment before a JPEG's first scan, without its identifier (ITU-T T.81, annex B). A
/// file that is damaged or ends earlier counts as one without: reading its pixels will report it.
fn segment(reader: &mut (impl Read + Seek)) -> Option<Vec<u8>> {
    let mut head = [0; 2];
    reader.read_exact(&mut head).ok()?;
    if head != [0xff, 0xd8] {
        return None;
    }
    loop {
        let mut head = [0; 4];
        reader.read_exact(&mut head).ok()?;
        let [0xff, marker, high, low] = head else { return None };
        let length = u16::from_be_bytes([high, low]).checked_sub(2)?;
        match marker {
            0xe1 => {
                let mut bytes = vec![0; length.into()];
                reader.read_exact(&mut bytes).ok()?;
                // XMP uses the same kind of segment.
                if let Some(exif) = bytes.strip_prefix(IDENTIFIER) {
                    return Some(exif.to_vec());
                }
            }
            0xda => return None,
            _ => reader.seek_relative(length.into()).ok()?,
        }
    }
}

fn parse(segment: Vec<u8>) -> Exif {
    let mut damage = None;
    let read = exif::Reader::new().continue_on_error(true).read_raw(segment).or_else(|error| {
        error.distill_partial_result(|problems| {
            damage = problems.first().map(|e| format!("the EXIF data is damaged: {e}"))
        })
    });
    match read {
        Ok(exif) => {
            let read = of_fields(&exif);
            Exif { damage: damage.or(read.damage.clone()), ..read }
        }
        Err(error) => Exif { damage: Some(format!("the EXIF data is damaged: {error}")), ..Exif::default() },
    }
}

fn of_fields(exif: &exif::Exif) -> Exif {
    let any_number = |tag: Tag| match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(v) => Some(v.first()?.to_f64()),
        Value::SRational(v) => Some(v.first()?.to_f64()),
        other => Some(f64::from(other.get_uint(0)?)),
    };
    // 0 and infinity mean unknown.
    let number = |tag: Tag| any_number(tag).filter(|v| v.is_finite() && *v > 0.0);
    // APEX values are base-2 logarithms, 0 among them: Exif 2.32, annex C. An f-number is 2^(Av/2),
    // a time 2^-Tv. They stand in for a plain value that is absent, not for one that is unknown.
    let of_apex = |plain: Tag, tag: Tag, per_stop: f64| {
        let value = any_number(tag).filter(|v| v.abs() <= MAX_APEX)?;
        exif.get_field(plain, In::PRIMARY).is_none().then(|| (per_stop * value).exp2())
    };
    let others = [Tag::RecommendedExposureIndex, Tag::StandardOutputSensitivity, Tag::ISOSpeed];
    let iso = number(Tag::PhotographicSensitivity).filter(|iso| *iso != SEE_ELSEWHERE);
    let mut time_s = number(Tag::ExposureTime).or_else(|| of_apex(Tag::ExposureTime, Tag::ShutterSpeedValue, -1.0));
    let odd_s = time_s.take_if(|time_s| *time_s > MAX_EXPOSURE_S);
    let damage = odd_s.map(|odd_s| format!("the EXIF exposure time is {odd_s} s; expected at most {MAX_EXPOSURE_S} s"));
    let settings = PhotoSettings {
        time_s,
        f_number: number(Tag::FNumber).or_else(|| of_apex(Tag::FNumber, Tag::ApertureValue, 0.5)),
        iso: iso.or_else(|| others.into_iter().find_map(number)),
        focal_length_m: number(Tag::FocalLength).map(|mm| 1e-3 * mm),
        taken_s: exif.get_field(Tag::DateTimeOriginal, In::PRIMARY).and_then(|field| match &field.value {
            Value::Ascii(texts) => seconds(&DateTime::from_ascii(texts.first()?).ok()?),
            _ => None,
        }),
    };
    let orientation = exif.get_field(Tag::Orientation, In::PRIMARY).and_then(|field| field.value.get_uint(0));
    Exif { settings, orientation: orientation.filter(|n| (2..=8).contains(n)), damage }
}

/// Seconds since 1970-01-01 0:00, for dates up to the year 8000. A day beyond its month's end is in
/// the next month. Years start in March, as in sink/photograph.rs.
fn seconds(at: &DateTime) -> Option<f64> {
    let (year, month, day) = (i64::from(at.year), i64::from(at.month), i64::from(at.day));
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) || at.hour > 23 || at.minute > 59 || at.second > 60 {
        return None;
    }
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days =
        365 * year + year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400) + (153 * month + 2) / 5 + day - 1;
    let of_day = i64::from(at.hour) * 3600 + i64::from(at.minute) * 60 + i64::from(at.second);
    // 1970-01-01 is 719468 days after 0000-03-01.
    (1970..8000).contains(&at.year).then(|| ((days - 719_468) * 86400 + of_day) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use exif::experimental::Writer;
    use exif::{Field, Rational};
    use proptest::prelude::*;
    use std::io::Cursor;

    fn block(fields: &[(Tag, Value)]) -> Vec<u8> {
        let fields: Vec<Field> =
            fields.iter().map(|(tag, value)| Field { tag: *tag, ifd_num: In::PRIMARY, value: value.clone() }).collect();
        let mut writer = Writer::new();
        fields.iter().for_each(|field| writer.push_field(field));
        let mut out = Cursor::new(Vec::new());
        writer.write(&mut out, false).unwrap();
        out.into_inner()
    }

    fn ratio(num: u32, denom: u32) -> Value {
        Value::Rational(vec![Rational { num, denom }])
    }

    fn door() -> Vec<u8> {
        block(&[
            (Tag::ExposureTime, ratio(10, 1250)),
            (Tag::FNumber, ratio(48, 10)),
            (Tag::PhotographicSensitivity, Value::Short(vec![400])),
            (Tag::FocalLength, ratio(290, 10)),
            (Tag::DateTimeOriginal, Value::Ascii(vec![b"2008:02:29 23:59:58".to_vec()])),
        ])
    }

    fn jpeg(exif: &[u8]) -> Vec<u8> {
        let xmp = b"http://ns.adobe.com/xap/1.0/\0<x/>";
        let mut out = vec![0xff, 0xd8];
        for (marker, bytes) in [(0xe0, &b"JFIF\0"[..]), (0xe1, xmp), (0xe1, &[IDENTIFIER, exif].concat())] {
            out.extend([0xff, marker]);
            out.extend((bytes.len() as u16 + 2).to_be_bytes());
            out.extend(bytes);
        }
        out.extend([0xff, 0xda, 0, 2]);
        out
    }

    #[test]
    fn settings_are_read_behind_other_segments() {
        let exif = parse(segment(&mut Cursor::new(jpeg(&door()))).unwrap());
        // 38 years of 365 days, 9 leap days before 2008, 59 days to February 29.
        let taken_s = f64::from((38 * 365 + 9 + 59) * 86400 + 86398);
        let expected = PhotoSettings {
            time_s: Some(0.008),
            f_number: Some(4.8),
            iso: Some(400.0),
            focal_length_m: Some(0.029),
            taken_s: Some(taken_s),
        };
        assert_eq!(exif, Exif { settings: expected, ..Exif::default() });
    }

    #[test]
    fn unset_camera_clock_gives_no_time() {
        for text in [&b"    :  :     :  :  "[..], b"0000:00:00 00:00:00", b"2008:13:01 00:00:00", b"soon"] {
            let exif = parse(block(&[(Tag::DateTimeOriginal, Value::Ascii(vec![text.to_vec()]))]));
            assert_eq!(exif.settings.taken_s, None, "{}", String::from_utf8_lossy(text));
        }
    }

    #[test]
    fn unknown_settings_stay_unknown() {
        let unknown = block(&[
            (Tag::ExposureTime, ratio(0, 1)),
            (Tag::ShutterSpeedValue, ratio(6, 1)),
            (Tag::FNumber, ratio(28, 0)),
            (Tag::ApertureValue, ratio(4, 1)),
            (Tag::PhotographicSensitivity, Value::Short(vec![65535])),
        ]);
        assert_eq!(parse(unknown), Exif::default());
        let elsewhere = block(&[
            (Tag::PhotographicSensitivity, Value::Short(vec![65535])),
            (Tag::RecommendedExposureIndex, Value::Long(vec![102_400])),
        ]);
        assert_eq!(parse(elsewhere).settings.iso, Some(102_400.0));
        assert_eq!(segment(&mut Cursor::new(b"\x89PNG\r\n\x1a\n")), None);
    }

    #[test]
    fn implausible_exposure_time_is_reported() {
        let exif_with_time =
            |seconds| parse(block(&[(Tag::ExposureTime, ratio(seconds, 1)), (Tag::FNumber, ratio(8, 1))]));
        assert_eq!(exif_with_time(60).settings.time_s, Some(60.0));
        let long = exif_with_time(61);
        assert_eq!((long.settings.time_s, long.settings.f_number), (None, Some(8.0)));
        let error = long.damage.unwrap();
        assert!(error.contains("61 s") && error.contains("at most 60 s"), "{error}");
    }

    #[test]
    fn damage_leaves_the_intact_settings() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.jpg");
        std::fs::write(&file, jpeg(&door()[..20])).unwrap();
        assert!(read(&file).unwrap().damage.unwrap().contains("EXIF data is damaged"));
        // The pointer to the GPS data leads out of the file.
        let mut exif = block(&[
            (Tag::FNumber, ratio(8, 1)),
            (Tag::PhotographicSensitivity, Value::Short(vec![125])),
            (Tag::GPSLatitudeRef, Value::Ascii(vec![b"N".to_vec()])),
        ]);
        // A directory's entry: tag, type LONG, one value.
        let entry = exif.windows(8).position(|bytes| bytes == [0x88, 0x25, 0, 4, 0, 0, 0, 1]).unwrap();
        exif[entry + 8..entry + 12].fill(0x7f);
        let exif_data = parse(exif);
        assert_eq!((exif_data.settings.f_number, exif_data.settings.iso), (Some(8.0), Some(125.0)));
        assert!(exif_data.damage.unwrap().contains("EXIF data is damaged"));
    }

    #[test]
    fn apex_values_stand_in_for_missing_settings() {
        let signed = |num, denom| Value::SRational(vec![exif::SRational { num, denom }]);
        let settings =
            parse(block(&[(Tag::ApertureValue, ratio(4, 1)), (Tag::ShutterSpeedValue, signed(6, 1))])).settings;
        assert_eq!((settings.f_number, settings.time_s), (Some(4.0), Some(1.0 / 64.0)));
        // f/1 and two seconds, by values that are not above 0.
        let settings =
            parse(block(&[(Tag::ApertureValue, ratio(0, 1)), (Tag::ShutterSpeedValue, signed(-1, 1))])).settings;
        assert_eq!((settings.f_number, settings.time_s), (Some(1.0), Some(2.0)));
        // The plain values go first; infinity is unknown.
        let both = parse(block(&[(Tag::FNumber, ratio(28, 10)), (Tag::ApertureValue, ratio(4, 1))])).settings;
        assert_eq!(both.f_number, Some(2.8));
        let unknown = parse(block(&[(Tag::ApertureValue, ratio(u32::MAX, 1)), (Tag::ShutterSpeedValue, signed(1, 0))]));
        assert_eq!(unknown, Exif::default());
    }

    #[test]
    fn an_orientation_is_read_unless_upright() {
        let orientation_of = |n| parse(block(&[(Tag::Orientation, Value::Short(vec![n]))])).orientation;
        assert_eq!([1, 6, 9].map(orientation_of), [None, Some(6), None]);
    }

    proptest! {
        #[test]
        fn damage_never_panics(at in 0usize..400, value in any::<u8>(), cut in 0usize..400) {
            let mut bytes = jpeg(&door());
            let (at, cut) = (at % bytes.len(), cut % bytes.len());
            bytes[at] = value;
            for bytes in [&bytes[..], &bytes[..cut]] {
                if let Some(block) = segment(&mut Cursor::new(bytes)) {
                    let _ = parse(block);
                }
            }
        }
    }
}
