//! Colour tags of still pictures: the chunk cICP of a PNG, `nclx` of a HEIF container, and the
//! primaries of an ICC profile (ICC.1:2022, tags rXYZ, gXYZ, bXYZ), in the names of a video's tags.
//!
//! Not modelled: curves of ICC profiles (sRGB is assumed), other white points.

use std::path::Path;

use super::still_format::{PNG_SIGNATURE, StillFormat};
use super::{heif, presentation, still_decoder};

/// Names of transfer function and primaries, as a video's. `None`: usual, or not stated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StillColor {
    pub transfer: Option<&'static str>,
    pub primaries: Option<&'static str>,
}

/// Colour tags of a picture's file. Those of damaged files and of other formats are the usual ones.
pub fn read(file: &Path) -> StillColor {
    let of_icc = |profile: Option<Vec<u8>>| StillColor {
        primaries: profile.as_deref().and_then(primaries_of_icc),
        ..StillColor::default()
    };
    match StillFormat::of_file(file) {
        Ok(Some(StillFormat::Heif)) => heif::read_color(file).map_or_else(StillColor::default, |color| match color {
            heif::HeifColor::Codes { primaries, transfer } => of_codes(primaries, transfer),
            heif::HeifColor::Icc(profile) => of_icc(Some(profile)),
        }),
        Ok(Some(format @ (StillFormat::Png | StillFormat::Jpeg | StillFormat::Tiff | StillFormat::WebP))) => {
            let Ok(bytes) = still_decoder::read(file, format) else { return StillColor::default() };
            let codes = (format == StillFormat::Png).then(|| codes_of_png(&bytes)).flatten();
            codes.map_or_else(
                || of_icc(still_decoder::icc_profile(&bytes, format)),
                |[primaries, transfer]| of_codes(primaries.into(), transfer.into()),
            )
        }
        _ => StillColor::default(),
    }
}

fn of_codes(primaries: u16, transfer: u16) -> StillColor {
    StillColor {
        transfer: presentation::transfer_of_code(transfer),
        primaries: presentation::primaries_of_code(primaries),
    }
}

/// Code points of primaries and transfer function in a PNG, which are before its pixels.
fn codes_of_png(bytes: &[u8]) -> Option<[u8; 2]> {
    let mut rest = bytes.strip_prefix(PNG_SIGNATURE)?;
    loop {
        let (length, after) = rest.split_first_chunk::<4>()?;
        let (name, content) = after.split_first_chunk::<4>()?;
        match name {
            b"cICP" => return content.first_chunk().copied(),
            b"IDAT" => return None,
            _ => rest = content.get((u32::from_be_bytes(*length) as usize).checked_add(4)?..)?,
        }
    }
}

/// Red of the distinguished primaries, adapted to D50: X, Y, Z.
const RED_D50: [(&str, [f64; 3]); 2] = [("smpte432", [0.5151, 0.2412, -0.0011]), ("bt2020", [0.6734, 0.2790, -0.0019])];
/// Largest difference from them. sRGB is 0.08 away from the nearest.
const RED_TOLERANCE: f64 = 0.01;

/// Name of the primaries of an RGB profile. `None` for those of sRGB and for unknown ones.
fn primaries_of_icc(profile: &[u8]) -> Option<&'static str> {
    // Header of 128 bytes, number of tags, and of each its signature, offset and size.
    let number = |at: usize| Some(u32::from_be_bytes(profile.get(at..at.checked_add(4)?)?.try_into().ok()?));
    let count = number(128)?.min(1024) as usize;
    let entry = (0..count).map(|tag| 132 + 12 * tag).find(|at| profile.get(*at..at + 4) == Some(b"rXYZ"))?;
    // The type's signature and four reserved bytes precede three numbers of 16.16 bits.
    let at = (number(entry + 4)? as usize).checked_add(8)?;
    let fixed = |n: usize| Some(f64::from(number(at.checked_add(4 * n)?)? as i32) / 65536.0);
    let red = [fixed(0)?, fixed(1)?, fixed(2)?];
    let is_near = |(_, expected): &&(&str, [f64; 3])| {
        red.iter().zip(expected).all(|(red, expected)| (red - expected).abs() < RED_TOLERANCE)
    };
    RED_D50.iter().find(is_near).map(|(name, _)| *name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn icc(red: [f64; 3]) -> Vec<u8> {
        let mut profile = vec![0; 128];
        profile.extend(1u32.to_be_bytes());
        profile.extend([&b"rXYZ"[..], &144u32.to_be_bytes(), &20u32.to_be_bytes(), b"XYZ ", &[0; 4]].concat());
        profile.extend(red.iter().flat_map(|value| ((value * 65536.0).round() as i32).to_be_bytes()));
        profile
    }

    #[test]
    fn primaries_of_profiles_are_recognised_by_their_red() {
        for (red, expected) in [
            ([0.4361, 0.2225, 0.0139], None),
            ([0.5150, 0.2412, -0.0010], Some("smpte432")),
            ([0.6735, 0.2791, -0.0019], Some("bt2020")),
        ] {
            assert_eq!(primaries_of_icc(&icc(red)), expected, "{red:?}");
        }
    }

    #[test]
    fn tags_of_written_frames_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.png");
        let mut png = Vec::new();
        image::ImageEncoder::write_image(
            image::codecs::png::PngEncoder::new(&mut png),
            &[1, 2, 3],
            1,
            1,
            image::ExtendedColorType::Rgb8,
        )
        .unwrap();
        std::fs::write(&file, &png).unwrap();
        assert_eq!(read(&file), StillColor::default());
        let chunk = b"\0\0\0\x04cICP\x09\x12\0\x01\0\0\0\0";
        std::fs::write(&file, [&png[..33], chunk, &png[33..]].concat()).unwrap();
        assert_eq!(read(&file), StillColor { transfer: Some("arib-std-b67"), primaries: Some("bt2020") });
    }

    proptest! {
        #[test]
        fn damaged_profiles_never_panic(at in 0usize..170, value in any::<u8>(), length in 0usize..180) {
            let mut profile = icc([0.5, 0.2, 0.0]);
            let at = at % profile.len();
            profile[at] = value;
            profile.truncate(length);
            let _ = primaries_of_icc(&profile);
        }
    }
}
