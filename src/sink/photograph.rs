//! Photograph files: JPEG or PNG with Exif metadata. Source: CIPA DC-008 (Exif 2.32).

use std::io::{self, Cursor, Write};
use std::path::Path;

use exif::experimental::Writer;
use exif::{Field, In, Rational, Tag, Value};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageError};

use super::atomic::write_atomically;
use super::{SinkError, check_file, of_image};
use crate::label::{SourceLabel, with_chunks, with_packet, xmp_chunk};
use crate::pixels::{Codes, Pixels};
use crate::source::orientation::Orientation;

/// Exif metadata of a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct ExifNotes {
    pub f_number: f64,
    pub time_s: f64,
    pub iso: f64,
    pub focal_length_mm: f64,
    /// The focal length with the same angle of view on 36×24 mm.
    pub equivalent_mm: f64,
    /// Up to infinity.
    pub focus_distance_m: f64,
    /// Requested exposure compensation, stops.
    pub compensation_ev: f64,
    /// Exif code: 1 manual, 2 program, 3 aperture priority, 4 shutter priority.
    pub program: u16,
    /// Seconds since 1970-01-01 0:00, in UTC or on the clock of the camera that made the recording.
    pub taken_s: f64,
    /// A description of the picture.
    pub description: String,
    /// How the picture is to be shown.
    pub orientation: Orientation,
}

const JPEG_QUALITY: u8 = 95;

/// Checks that a photograph can be written to a path.
pub fn check(path: &Path, force: bool) -> Result<(), SinkError> {
    match extension(path).as_str() {
        "jpg" | "jpeg" | "png" => check_file(path, force),
        other => {
            let extension = if other.is_empty() { "no ending".to_owned() } else { format!(".{other}") };
            let problem = format!("a photograph cannot be written with {extension}; expected .jpg or .png");
            Err(SinkError::Refused { path: path.to_owned(), problem })
        }
    }
}

/// True if a path has the extension of a photograph.
pub fn is_photograph_name(path: &Path) -> bool {
    matches!(extension(path).as_str(), "jpg" | "jpeg" | "png")
}

/// Name of the codec of a photograph, by its extension.
pub fn codec(path: &Path) -> &'static str {
    if extension(path) == "png" { "png" } else { "jpeg" }
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// Writes 8-bit pixels. The file is either complete or absent. An existing one is kept unless
/// `force`.
pub fn write(
    path: &Path,
    pixels: &Pixels,
    notes: Option<&ExifNotes>,
    label: Option<&SourceLabel>,
    force: bool,
) -> Result<(), SinkError> {
    check(path, force)?;
    let Codes::U8(codes) = &pixels.codes else {
        let problem = "a photograph has 8 bits a code value, these pixels have 16".to_owned();
        return Err(SinkError::Refused { path: path.to_owned(), problem });
    };
    let (width, height) = (pixels.width, pixels.height);
    let exif = notes.map(|notes| exif_block(notes, width, height)).transpose();
    let exif = exif.map_err(|source| SinkError::Write { path: path.to_owned(), source })?;
    let xmp = label.map(SourceLabel::xmp);
    write_atomically(path, force, |writer| {
        let mut file = Vec::new();
        let encoded = if codec(path) == "png" {
            encode(PngEncoder::new(&mut file), codes, width, height, exif)
        } else {
            encode(JpegEncoder::new_with_quality(&mut file, JPEG_QUALITY), codes, width, height, exif)
        };
        encoded.map_err(of_image)?;
        let labelled = xmp.map(|xmp| match codec(path) {
            "png" => with_chunks(&file, &[xmp_chunk(&xmp)]),
            _ => with_packet(&file, &xmp),
        });
        writer.write_all(&labelled.unwrap_or(file))
    })
}

fn encode(
    mut encoder: impl ImageEncoder,
    codes: &[u8],
    width: u32,
    height: u32,
    exif: Option<Vec<u8>>,
) -> Result<(), ImageError> {
    if let Some(exif) = exif {
        encoder.set_exif_metadata(exif).map_err(ImageError::Unsupported)?;
    }
    encoder.write_image(codes, width, height, ExtendedColorType::Rgb8)
}

/// A number as a fraction of integers: below 0.3 as 10/n, otherwise in ten-thousandths.
/// 4294967295/1 means infinity.
fn ratio(value: f64) -> Rational {
    if !value.is_finite() {
        return Rational { num: u32::MAX, denom: 1 };
    }
    if value > 0.0 && value < 0.3 {
        return Rational { num: 10, denom: (10.0 / value).round() as u32 };
    }
    Rational { num: (1e4 * value).round() as u32, denom: 10_000 }
}

fn exif_block(notes: &ExifNotes, width: u32, height: u32) -> io::Result<Vec<u8>> {
    let text = |text: &str| Value::Ascii(vec![text.as_bytes().iter().copied().filter(u8::is_ascii).collect()]);
    let number = |value: f64| Value::Rational(vec![ratio(value)]);
    let short = |value: f64| Value::Short(vec![value.round().clamp(0.0, 65535.0) as u16]);
    let taken = date_time(notes.taken_s);
    let third = |ev: f64| exif::SRational { num: (ev * 100.0).round() as i32, denom: 100 };
    let fields = [
        (Tag::ImageDescription, text(&notes.description)),
        (Tag::Make, text("Locard")),
        (Tag::Model, text("Locard virtual SLR")),
        (Tag::Software, text(concat!("Locard ", env!("CARGO_PKG_VERSION")))),
        (Tag::Orientation, short(f64::from(notes.orientation.exif()))),
        // Dots per inch are meaningless for a picture that is not printed, but readers expect them.
        (Tag::XResolution, number(72.0)),
        (Tag::YResolution, number(72.0)),
        (Tag::ResolutionUnit, short(2.0)),
        // Chroma is sampled at the centre of the pixels that share it.
        (Tag::YCbCrPositioning, short(1.0)),
        (Tag::DateTime, text(&taken)),
        (Tag::ExposureTime, number(notes.time_s)),
        (Tag::FNumber, number(notes.f_number)),
        (Tag::ExposureProgram, Value::Short(vec![notes.program])),
        (Tag::PhotographicSensitivity, short(notes.iso)),
        (Tag::ExifVersion, Value::Undefined(b"0232".to_vec(), 0)),
        (Tag::DateTimeOriginal, text(&taken)),
        (Tag::DateTimeDigitized, text(&taken)),
        // Y, Cb, Cr.
        (Tag::ComponentsConfiguration, Value::Undefined(vec![1, 2, 3, 0], 0)),
        (Tag::ExposureBiasValue, Value::SRational(vec![third(notes.compensation_ev)])),
        (Tag::SubjectDistance, number(notes.focus_distance_m)),
        (Tag::FocalLength, number(notes.focal_length_mm)),
        (Tag::FocalLengthIn35mmFilm, short(notes.equivalent_mm)),
        (Tag::FlashpixVersion, Value::Undefined(b"0100".to_vec(), 0)),
        (Tag::ColorSpace, short(1.0)),
        (Tag::PixelXDimension, Value::Long(vec![width])),
        (Tag::PixelYDimension, Value::Long(vec![height])),
    ];
    let fields: Vec<Field> =
        fields.into_iter().map(|(tag, value)| Field { tag, ifd_num: In::PRIMARY, value }).collect();
    let mut writer = Writer::new();
    fields.iter().for_each(|field| writer.push_field(field));
    let mut block = Cursor::new(Vec::new());
    writer.write(&mut block, false).map_err(io::Error::other)?;
    Ok(block.into_inner())
}

/// Date and time for people, "2011-05-10 12:34:56", of seconds since 1970.
pub fn log_date_time(seconds: f64) -> String {
    date_time(seconds).replacen(':', "-", 2)
}

/// Exif date format, "2011:05:10 12:34:56". The date is in the proleptic Gregorian calendar, in
/// which 400 years have 146097 days. Years start in March here, so that the leap day is the last.
fn date_time(seconds: f64) -> String {
    let seconds = seconds.clamp(0.0, 2e11) as i64;
    let (days, second) = (seconds.div_euclid(86400), seconds.rem_euclid(86400));
    // Counted from 0000-03-01.
    let days = days + 719_468;
    let (era, day) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year = (day - day / 1460 + day / 36524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (month, year) = if month < 10 { (month + 3, year) } else { (month - 9, year + 1) };
    let year = year + 400 * era;
    format!("{year:04}:{month:02}:{day:02} {:02}:{:02}:{:02}", second / 3600, second / 60 % 60, second % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn notes() -> ExifNotes {
        ExifNotes {
            f_number: 2.8,
            time_s: 1.0 / 60.0,
            iso: 400.0,
            focal_length_mm: 31.4,
            equivalent_mm: 48.0,
            focus_distance_m: 1.25,
            compensation_ev: -0.33,
            program: 3,
            taken_s: 1_305_031_103.7,
            description: "frame 20".to_owned(),
            orientation: Orientation::of_exif(6),
        }
    }

    #[test]
    fn dates_match_hand_calculation() {
        assert_eq!(date_time(0.0), "1970:01:01 00:00:00");
        assert_eq!(log_date_time(0.0), "1970-01-01 00:00:00");
        assert_eq!(date_time(951_782_400.0), "2000:02:29 00:00:00");
        assert_eq!(date_time(1_305_031_103.7), "2011:05:10 12:38:23");
        assert_eq!(date_time(4_107_542_399.0), "2100:02:28 23:59:59");
        assert_eq!(date_time(4_107_542_400.0), "2100:03:01 00:00:00");
    }

    #[test]
    fn exif_reads_back_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let pixels = Pixels::from_u8(16, 16, vec![100; 768]).unwrap();
        for name in ["a.jpg", "a.png"] {
            let path = folder.path().join(name);
            write(&path, &pixels, Some(&notes()), Some(&SourceLabel::rendering()), false).unwrap();
            let exif =
                exif::Reader::new().read_from_container(&mut io::BufReader::new(std::fs::File::open(&path).unwrap()));
            let exif = exif.unwrap();
            let text = |tag| exif.get_field(tag, In::PRIMARY).unwrap().display_value().with_unit(&exif).to_string();
            let tags = [
                Tag::Make,
                Tag::Model,
                Tag::ExposureTime,
                Tag::FNumber,
                Tag::PhotographicSensitivity,
                Tag::FocalLength,
                Tag::FocalLengthIn35mmFilm,
                Tag::SubjectDistance,
                Tag::DateTimeOriginal,
                Tag::ExposureProgram,
                Tag::Orientation,
            ];
            let expected = [
                "\"Locard\"",
                "\"Locard virtual SLR\"",
                "1/60 s",
                "f/2.8",
                "400",
                "31.4 mm",
                "48 mm",
                "1.25 m",
                "2011-05-10 12:38:23",
                "aperture priority",
                "row 0 at right and column 0 at top",
            ];
            assert_eq!(tags.map(text), expected, "{name}");
            let read = image::open(&path).unwrap().to_rgb8();
            assert!(read.as_raw().iter().all(|c| c.abs_diff(100) <= 1));
            assert!(write(&path, &pixels, None, None, false).unwrap_err().to_string().contains("--force"));
        }
        // The recordings' Exif reader returns the same values.
        let settings = crate::source::exif::read(&folder.path().join("a.jpg")).unwrap().settings;
        assert_eq!((settings.iso, settings.f_number), (Some(400.0), Some(2.8)));
        assert_eq!(settings.taken_s, Some(1_305_031_103.0), "whole seconds");
        assert!(write(Path::new("a.gif"), &pixels, None, None, true).unwrap_err().to_string().contains(".jpg or .png"));
    }
}
