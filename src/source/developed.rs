//! Pictures that other programs decode: HEIF by `heif-convert`, camera raw files by `dcraw_emu`,
//! JPEG 2000 and OpenEXR with DWA by `ffmpeg`, JPEG XL by `djxl`. Each is developed once into a PNG
//! in the user's cache folder.
//!
//! The result has the orientation of the sensor: rotations of the file are undone, so that upright
//! and landscape photographs of one camera have one size and one set of intrinsics, as JPEGs do.
//!
//! Raw files become linear light (black level subtracted, white balance as shot, demosaiced by AHD,
//! Rec. 709 primaries, not brightened), which is encoded by the sRGB curve with 16 bits. The curve
//! is that of a default profile, so light in the program is proportional to the sensor's signal.
//!
//! Not modelled: the orientation of JPEG XL, embedded colour profiles, gain maps, lens corrections
//! of a raw file's maker notes.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use sha2::Digest as _;

use super::orientation::Orientation;
use super::still_format::{PictureHeader, StillFormat};
use super::{SourceError, ffmpeg, file as plain, heif, scene_linear, still_decoder};
use crate::pixels::Pixels;
use crate::program::{self, ProgramError};
use crate::user_folders;

/// Folder of developed pictures within the cache.
const FOLDER: &str = "developed";
/// Version of the development: results of others are rebuilt.
const VERSION: u32 = 2;
/// The least recently used pictures are removed beyond this size, bytes.
const CACHE_BYTES: u64 = 16 << 30;
/// Age of leftovers of interrupted developments, which are removed.
const LEFTOVER_AGE: Duration = Duration::from_secs(24 * 3600);

/// Names of the programs: of each list the first that is installed is used.
const HEIF_DECODERS: &[&str] = &["heif-dec", "heif-convert"];
const RAW_DECODERS: &[&str] = &["dcraw_emu"];
const JPEG_XL_DECODERS: &[&str] = &["djxl"];

/// The formats, each with the installed program that decodes it, or the reason for its absence.
pub fn decoders() -> impl Iterator<Item = (&'static str, Result<&'static str, ProgramError>)> {
    [("HEIC, AVIF", HEIF_DECODERS), ("camera raw files", RAW_DECODERS), ("JPEG XL", JPEG_XL_DECODERS)]
        .into_iter()
        .map(|(formats, programs)| (formats, installed(programs)))
}

fn installed(programs: &[&'static str]) -> Result<&'static str, ProgramError> {
    let mut missing = Err(ProgramError::Missing { program: String::new() });
    for program in programs {
        // Not every one has this option, and then it fails.
        match program::output(program, &["--version".into()]) {
            Err(error @ ProgramError::Missing { .. }) => missing = Err(error),
            _ => return Ok(program),
        }
    }
    missing
}

/// A picture's header. HEIF has it in its container, others are developed.
pub fn read_header(file: &Path, format: StillFormat) -> Result<PictureHeader, SourceError> {
    if format == StillFormat::Heif {
        let heif::HeifPicture { width, height, bits, .. } = heif::read(file)?;
        return Ok(PictureHeader { width, height, bits: if bits > 8 { 16 } else { 8 } });
    }
    still_decoder::read_header(&png_of(file, format)?, StillFormat::Png)
}

/// The developed picture. A damaged one in the cache is rebuilt.
pub fn read_pixels(file: &Path, format: StillFormat) -> Result<Pixels, SourceError> {
    let png = png_of(file, format)?;
    still_decoder::read_pixels(&png, StillFormat::Png).or_else(|_| {
        // If it cannot be removed, it is read again with the same error.
        let _ = std::fs::remove_file(&png);
        still_decoder::read_pixels(&png_of(file, format)?, StillFormat::Png)
    })
}

/// The developed picture's file, from the cache or made now.
fn png_of(file: &Path, format: StillFormat) -> Result<PathBuf, SourceError> {
    png_in(&user_folders::cache().join(FOLDER), file, format)
}

fn png_in(cache: &Path, file: &Path, format: StillFormat) -> Result<PathBuf, SourceError> {
    let failed = |source| SourceError::Read { file: file.to_owned(), source };
    let path = std::fs::canonicalize(file).map_err(failed)?;
    let metadata = path.metadata().map_err(failed)?;
    let since = metadata.modified().ok().and_then(|at| at.duration_since(UNIX_EPOCH).ok()).unwrap_or_default();
    let state = format!("{VERSION} {} {} {}", path.display(), metadata.len(), since.as_nanos());
    let png = cache.join(format!("{:x}.png", sha2::Sha256::digest(state)));
    if png.is_file() {
        // The least recently used files are removed first. On failure it is removed earlier.
        let _ = std::fs::File::options().append(true).open(&png).and_then(|file| file.set_modified(SystemTime::now()));
        return Ok(png);
    }
    let unwritable = |source| SourceError::Cache { folder: cache.to_owned(), source };
    std::fs::create_dir_all(cache).map_err(unwritable)?;
    let work = tempfile::tempdir_in(cache).map_err(unwritable)?;
    let developed = work.path().join("developed.png");
    develop(&path, format, work.path(), &developed)?;
    std::fs::rename(&developed, &png).map_err(unwritable)?;
    evict_lru(cache, CACHE_BYTES);
    Ok(png)
}

/// Develops a picture. `work` is an empty folder for intermediate files.
fn develop(file: &Path, format: StillFormat, work: &Path, png: &Path) -> Result<(), SourceError> {
    let text = |words: &[&str]| words.iter().map(OsString::from).collect::<Vec<_>>();
    match format {
        StillFormat::Heif => {
            let picture = heif::read(file)?;
            convert(file, HEIF_DECODERS, &[text(&["--quiet"]), paths(&[file, png])].concat())?;
            if !png.is_file() {
                let problem = "it holds several pictures; write the one to use into a file of its own: heif-convert \
                               FILE.heic FILE.png";
                return Err(undeveloped(file, problem));
            }
            let undone = Orientation { is_mirrored: false, rotation_deg: -90.0 * f64::from(picture.quarter_turns) };
            let pixels = undone.apply(still_decoder::read_pixels(png, StillFormat::Png)?);
            if (pixels.width, pixels.height) != (picture.width, picture.height) {
                let problem = format!(
                    "is cropped from {}x{} to {}x{} by its own properties, which is not supported; convert it: \
                     heif-convert FILE.heic FILE.png",
                    picture.width, picture.height, pixels.width, pixels.height
                );
                return Err(SourceError::content(file, problem));
            }
            if picture.quarter_turns > 0 {
                save(&pixels, png)?;
            }
            Ok(())
        }
        StillFormat::Raw => {
            let tiff = work.join("linear.tiff");
            let options = ["-T", "-4", "-w", "-t", "0", "-o", "1", "-q", "3", "-Z"];
            convert(file, RAW_DECODERS, &[text(&options), paths(&[&tiff, file])].concat())?;
            let linear = still_decoder::read_pixels(&tiff, StillFormat::Tiff).map_err(|_| {
                let problem = "dcraw_emu wrote no picture; is it truncated, or newer than the installed LibRaw?";
                undeveloped(file, problem)
            })?;
            save(&scene_linear::srgb_encoded(linear), png)
        }
        StillFormat::JpegXl => convert(file, JPEG_XL_DECODERS, &paths(&[file, png])),
        StillFormat::DwaExr => {
            let reader = plain::open(file).map_err(|source| SourceError::Read { file: file.to_owned(), source })?;
            let part = scene_linear::dwa_part(std::io::BufReader::new(reader));
            let part = part.map_err(|problem| SourceError::content(file, problem))?.to_string();
            let decoder = ["-f", "exr_pipe", "-apply_trc", "iec61966_2_1", "-part", &part, "-i"];
            let start = text(&[&["-v", "error", "-y"][..], &decoder].concat());
            let rest = text(&["-frames:v", "1", "-pix_fmt", "rgb48be"]);
            let arguments = [start, vec![ffmpeg::file_argument(file)], rest, vec![ffmpeg::file_argument(png)]].concat();
            convert(file, &["ffmpeg"], &arguments)
        }
        _ => {
            // Named formats: a `%` in the name would be a pattern.
            let start = text(&["-v", "error", "-y", "-f", "j2k_pipe", "-i"]);
            let arguments = [start, vec![ffmpeg::file_argument(file), ffmpeg::file_argument(png)]].concat();
            convert(file, &["ffmpeg"], &arguments)
        }
    }
}

fn paths(paths: &[&Path]) -> Vec<OsString> {
    paths.iter().map(|path| path.as_os_str().to_owned()).collect()
}

fn undeveloped(file: &Path, problem: &str) -> SourceError {
    SourceError::content(file, format!("cannot be developed: {problem}"))
}

/// Runs the first of `programs` that is installed.
fn convert(file: &Path, programs: &[&'static str], arguments: &[OsString]) -> Result<(), SourceError> {
    let mut missing = ProgramError::Missing { program: String::new() };
    for program in programs {
        match program::output(program, arguments) {
            Ok(_) => return Ok(()),
            Err(error @ ProgramError::Missing { .. }) => missing = error,
            Err(source) => return Err(SourceError::Undeveloped { file: file.to_owned(), source }),
        }
    }
    Err(SourceError::Undeveloped { file: file.to_owned(), source: missing })
}

fn save(pixels: &Pixels, png: &Path) -> Result<(), SourceError> {
    let failed = |source| SourceError::Cache { folder: png.parent().unwrap_or(png).to_owned(), source };
    let out = std::io::BufWriter::new(std::fs::File::create(png).map_err(failed)?);
    pixels.write_png(out).map_err(|error| match error {
        image::ImageError::IoError(error) => failed(error),
        other => failed(std::io::Error::other(other)),
    })
}

/// Removes pictures from the cache, the least recently used first, until it holds at most
/// `max_bytes`, and leftovers. A file that cannot be removed stays.
fn evict_lru(cache: &Path, max_bytes: u64) {
    let mut pictures = Vec::new();
    for entry in std::fs::read_dir(cache).into_iter().flatten().flatten() {
        let Ok(metadata) = entry.metadata() else { continue };
        let used = metadata.modified().unwrap_or(UNIX_EPOCH);
        if metadata.is_file() {
            pictures.push((used, metadata.len(), entry.path()));
        } else if used.elapsed().is_ok_and(|age| age > LEFTOVER_AGE) {
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
    pictures.sort();
    let mut bytes: u64 = pictures.iter().map(|(_, bytes, _)| bytes).sum();
    // The newest one has just been made.
    pictures.pop();
    for (_, length, picture) in pictures {
        if bytes <= max_bytes {
            break;
        }
        if std::fs::remove_file(picture).is_ok() {
            bytes -= length;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_that_were_read_longest_ago_are_removed_first() {
        let cache = tempfile::tempdir().unwrap();
        for (name, age_s) in [("old", 30), ("used", 20), ("new", 10)] {
            let file = std::fs::File::create(cache.path().join(name)).unwrap();
            file.set_len(100).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age_s)).unwrap();
        }
        let names = || {
            let mut names: Vec<String> = std::fs::read_dir(cache.path())
                .unwrap()
                .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
                .collect();
            names.sort();
            names
        };
        evict_lru(cache.path(), 300);
        assert_eq!(names(), ["new", "old", "used"]);
        evict_lru(cache.path(), 200);
        assert_eq!(names(), ["new", "used"]);
        // The newest one stays in any case.
        evict_lru(cache.path(), 10);
        assert_eq!(names(), ["new"]);
    }

    #[test]
    fn missing_decoder_is_named_with_its_package() {
        let error = convert(Path::new("a.heic"), &["heif-not-there"], &[]).unwrap_err().to_string();
        assert!(error.starts_with("a.heic: cannot be developed: the program `heif-not-there` is missing"), "{error}");
        for (program, package) in [("heif-convert", "libheif-examples"), ("dcraw_emu", "libraw-bin")] {
            let error = ProgramError::Missing { program: program.to_owned() }.to_string();
            assert!(error.contains(package), "{error}");
        }
    }

    #[test]
    fn picture_is_developed_once_until_its_file_changes() {
        let folder = tempfile::tempdir().unwrap();
        let (cache, file) = (folder.path().join("cache"), folder.path().join("a.jp2"));
        let source = folder.path().join("source.png");
        let write = |pixels: Pixels| {
            save(&pixels, &source).unwrap();
            let input = ["-v", "error", "-y", "-i"].map(OsString::from).into_iter();
            let codec = ["-c:v", "jpeg2000", "-pred", "1", "-pix_fmt", "rgb24"].map(OsString::from);
            let arguments: Vec<OsString> = input.chain(paths(&[&source])).chain(codec).chain(paths(&[&file])).collect();
            program::output("ffmpeg", &arguments).unwrap();
        };
        let grey = |width: u32, code: u8| Pixels::from_u8(width, 16, vec![code; 48 * width as usize]).unwrap();
        write(grey(16, 90));
        let first = png_in(&cache, &file, StillFormat::Jpeg2000).unwrap();
        let [red, ..] = still_decoder::read_pixels(&first, StillFormat::Png).unwrap().at(8, 8);
        assert!(red.abs_diff(90) <= 2, "{red}");
        // A second development would bring the pixels back.
        std::fs::write(&first, "kept").unwrap();
        assert_eq!(png_in(&cache, &file, StillFormat::Jpeg2000).unwrap(), first);
        assert_eq!(std::fs::read(&first).unwrap(), b"kept");
        write(grey(32, 9));
        let second = png_in(&cache, &file, StillFormat::Jpeg2000).unwrap();
        assert_ne!(second, first);
        assert_eq!(still_decoder::read_header(&second, StillFormat::Png).unwrap().width, 32);
        assert_eq!(std::fs::read_dir(&cache).unwrap().count(), 2);
    }

    /// 64x48 pixels of (4x, 5y, 60), tagged to be shown turned by 90° clockwise, as a phone held
    /// upright does. Written by pillow-heif.
    #[test]
    fn heic_has_the_sensors_orientation() {
        let (cache, file) = (tempfile::tempdir().unwrap(), Path::new("tests/stills/turned.heic"));
        assert_eq!(read_header(file, StillFormat::Heif).unwrap(), PictureHeader { width: 64, height: 48, bits: 8 });
        let pixels =
            still_decoder::read_pixels(&png_in(cache.path(), file, StillFormat::Heif).unwrap(), StillFormat::Png)
                .unwrap();
        assert_eq!((pixels.width, pixels.height), (64, 48));
        for (x, y) in [(5, 40), (60, 3), (33, 20)] {
            let (code, expected) = (pixels.at(x, y), [4 * x, 5 * y, 60]);
            assert!(code.iter().zip(expected).all(|(code, of)| code.abs_diff(of) <= 4), "{x}, {y}: {code:?}");
        }
        let exif = super::super::exif::read(file).unwrap();
        assert_eq!((exif.orientation, exif.settings.time_s, exif.settings.iso), (Some(6), Some(0.008), Some(200.0)));
    }

    /// An RGGB mosaic, black 512, white 15872, neutral (0.5, 1, 0.8). The left half is a grey of
    /// 1/4 of full scale, the right half of 1/8. Written by tifffile.
    #[test]
    fn raw_file_becomes_linear_light_with_the_white_balance_as_shot() {
        let (cache, file) = (tempfile::tempdir().unwrap(), Path::new("tests/stills/grey.dng"));
        let pixels =
            still_decoder::read_pixels(&png_in(cache.path(), file, StillFormat::Raw).unwrap(), StillFormat::Png)
                .unwrap();
        // Tagged to be turned, and stored as the sensor has it.
        assert_eq!((pixels.width, pixels.height, pixels.max_code()), (64, 48, 65535));
        let light =
            |x| pixels.at(x, 20).map(|code| crate::camera::Response::default().decode(f64::from(code) / 65535.0));
        for (x, expected) in [(10, 0.25), (50, 0.125)] {
            assert!(light(x).iter().all(|light| (light - expected).abs() < 5e-5), "{x}: {:?}", light(x));
        }
        assert_eq!(super::super::exif::read(file).unwrap().orientation, Some(6));
    }
}
