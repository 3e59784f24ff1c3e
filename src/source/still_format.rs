//! Formats of still pictures. JPEG, PNG, TIFF, WebP, BMP, PPM and OpenEXR are decoded here; HEIF,
//! camera raw files, JPEG 2000 and JPEG XL by other programs (developed.rs).

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::{SourceError, file as plain, heif};

pub const PNG_SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
pub const JPEG_SIGNATURE: &[u8] = b"\xff\xd8\xff";
pub const EXR_SIGNATURE: &[u8] = b"\x76\x2f\x31\x01";

/// A format of still pictures, by content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StillFormat {
    Png,
    Jpeg,
    Tiff,
    WebP,
    Bmp,
    /// Netpbm: PBM, PGM, PPM, PAM.
    Pnm,
    Exr,
    /// OpenEXR with the compression DWA, whose decoder here trusts damaged sizes.
    DwaExr,
    /// HEIC and AVIF.
    Heif,
    /// A camera's raw file.
    Raw,
    Jpeg2000,
    JpegXl,
}

/// The contents of a picture's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PictureHeader {
    pub width: u32,
    pub height: u32,
    /// 8 or 16: depth of the result of [`read_pixels`].
    pub bits: u32,
}

/// Supported formats, for messages.
pub const FORMATS: &str = "PNG, JPEG, HEIC, AVIF, TIFF, WebP, BMP, PPM, OpenEXR, JPEG 2000, JPEG XL or a camera's raw \
                           format";

/// File extensions in lower case.
const EXTENSIONS: [(StillFormat, &[&str]); 11] = [
    (StillFormat::Png, &["png"]),
    (StillFormat::Jpeg, &["jpg", "jpeg"]),
    (StillFormat::Tiff, &["tif", "tiff"]),
    (StillFormat::WebP, &["webp"]),
    (StillFormat::Bmp, &["bmp"]),
    (StillFormat::Pnm, &["ppm", "pgm", "pnm", "pam"]),
    (StillFormat::Exr, &["exr"]),
    (StillFormat::Heif, &["heic", "heif", "hif", "avif"]),
    (StillFormat::Raw, &["dng", "cr2", "cr3", "nef", "nrw", "arw", "raf", "orf", "rw2", "pef", "srw"]),
    (StillFormat::Jpeg2000, &["jp2", "j2k"]),
    (StillFormat::JpegXl, &["jxl"]),
];

/// Number of bytes that determine the format of a file.
const SIGNATURE_BYTES: u64 = 32;

impl StillFormat {
    /// The format of a file: by its content. Raw files of most makers begin as TIFF does and differ
    /// by their names. `None` for files of another kind.
    pub fn of_file(file: &Path) -> Result<Option<Self>, SourceError> {
        let failed = |source| SourceError::Read { file: file.to_owned(), source };
        let mut start = Vec::new();
        plain::open(file).map_err(failed)?.take(SIGNATURE_BYTES).read_to_end(&mut start).map_err(failed)?;
        Ok(match Self::of_content(&start) {
            Some(Self::Tiff) | None if Self::of_name(file) == Some(Self::Raw) => Some(Self::Raw),
            format => format,
        })
    }

    /// The format of a file by its first bytes.
    pub fn of_content(start: &[u8]) -> Option<Self> {
        Some(match start {
            _ if start.starts_with(PNG_SIGNATURE) => Self::Png,
            // JPEG-LS begins like a JPEG.
            _ if start.starts_with(b"\xff\xd8\xff\xf7") => return None,
            _ if start.starts_with(JPEG_SIGNATURE) => Self::Jpeg,
            _ if start.starts_with(EXR_SIGNATURE) => Self::Exr,
            _ if start.starts_with(b"FUJIFILM") || heif::has_brand(start, &[b"crx "]) => Self::Raw,
            _ if heif::is_picture(start) => Self::Heif,
            // With "+" BigTIFF.
            [b'I', b'I', b'*' | b'+', 0, ..] | [b'M', b'M', 0, b'*' | b'+', ..] => Self::Tiff,
            _ if start.starts_with(b"RIFF") && start.get(8..12) == Some(b"WEBP") => Self::WebP,
            _ if start.starts_with(b"BM") => Self::Bmp,
            [b'P', b'1'..=b'7', space, ..] if space.is_ascii_whitespace() => Self::Pnm,
            _ if start.starts_with(b"\xff\x0a") || start.starts_with(b"\0\0\0\x0cJXL ") => Self::JpegXl,
            _ if start.starts_with(b"\0\0\0\x0cjP  ") || start.starts_with(b"\xff\x4f\xff\x51") => Self::Jpeg2000,
            _ => return None,
        })
    }

    /// The format of a file by its extension.
    pub fn of_name(file: &Path) -> Option<Self> {
        let extension = file.extension()?.to_string_lossy().to_ascii_lowercase();
        EXTENSIONS.iter().find(|(_, names)| names.contains(&extension.as_str())).map(|(format, _)| *format)
    }

    /// Name of the format for messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Tiff => "TIFF",
            Self::WebP => "WebP",
            Self::Bmp => "BMP",
            Self::Pnm => "PPM",
            Self::Exr => "OpenEXR",
            Self::DwaExr => "OpenEXR (DWA)",
            Self::Heif => "HEIF (HEIC, AVIF)",
            Self::Raw => "a camera's raw format",
            Self::Jpeg2000 => "JPEG 2000",
            Self::JpegXl => "JPEG XL",
        }
    }

    /// True if another program decodes the format.
    pub fn is_developed(self) -> bool {
        matches!(self, Self::DwaExr | Self::Heif | Self::Raw | Self::Jpeg2000 | Self::JpegXl)
    }

    /// True if files of this format often hold depth or other data beside pictures in a folder.
    fn may_hold_data(self) -> bool {
        matches!(self, Self::Tiff | Self::Pnm | Self::Exr)
    }

    /// Of files of one name those of the lowest rank are the frame.
    fn rank(self) -> u8 {
        match self {
            Self::Png | Self::Jpeg => 0,
            Self::Raw => 2,
            _ => 1,
        }
    }
}

/// True if a file has the extension of a picture.
pub fn is_picture_name(file: &Path) -> bool {
    StillFormat::of_name(file).is_some()
}

/// The picture in a folder whose name omits the extension; it may contain further dots. PNG and
/// JPEG come first.
pub fn with_omitted_extension(folder: &Path, name: &str) -> Option<PathBuf> {
    let extensions = EXTENSIONS.iter().flat_map(|(_, extensions)| extensions.iter());
    let spelled = extensions.flat_map(|extension| [(*extension).to_owned(), extension.to_uppercase()]);
    spelled.map(|extension| folder.join(format!("{name}.{extension}"))).find(|file| file.is_file())
}

/// The pictures of a folder by their names, without order. Of several files of one name a PNG or
/// JPEG counts, else any other format before a raw one: they are copies of it, or the camera's own
/// picture. TIFF, PPM and OpenEXR beside pictures of other formats are taken for depth or other
/// data.
pub fn pictures_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files: Vec<(StillFormat, PathBuf)> = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let file = entry?.path();
        let is_hidden = file.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if let Some(format) = StillFormat::of_name(&file).filter(|_| !is_hidden) {
            files.push((format, file));
        }
    }
    let has_pictures = files.iter().any(|(format, _)| !format.may_hold_data());
    files.retain(|(format, _)| !(has_pictures && format.may_hold_data()));
    let stem = |file: &Path| file.file_stem().map(OsString::from);
    let mut best: BTreeMap<Option<OsString>, u8> = BTreeMap::new();
    for (format, file) in &files {
        let rank = best.entry(stem(file)).or_insert(format.rank());
        *rank = format.rank().min(*rank);
    }
    files.retain(|(format, file)| best.get(&stem(file)) == Some(&format.rank()));
    Ok(files.into_iter().map(|(_, file)| file).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_recognised_by_content_and_by_name() {
        for (start, file, format) in [
            (&b"\0\0\0\x18ftypheic\0\0\0\0"[..], "a/IMG_1.HEIC", StillFormat::Heif),
            (b"\0\0\0\x1cftypavif", "a.avif", StillFormat::Heif),
            (b"\0\0\0\x18ftypcrx ", "a.CR3", StillFormat::Raw),
            (b"\x76\x2f\x31\x01", "f.exr", StillFormat::Exr),
            (b"II*\0", "f.tif", StillFormat::Tiff),
            (b"P6\n3 2\n255\n", "f.ppm", StillFormat::Pnm),
            (b"RIFF\0\0\0\0WEBP", "f.webp", StillFormat::WebP),
            (b"\xff\xd8\xff\xe0", "f.JPG", StillFormat::Jpeg),
        ] {
            assert_eq!(StillFormat::of_content(start), Some(format), "{file}");
            assert_eq!(StillFormat::of_name(Path::new(file)), Some(format), "{file}");
        }
        for start in [&b"\0\0\0\x18ftypisom"[..], b"", b"P6", b"PK\x03\x04", b"\xff\xd8\xff\xf7\0\x0b"] {
            assert_eq!(StillFormat::of_content(start), None, "{start:?}");
        }
    }

    #[test]
    fn raw_and_tiff_are_distinguished_by_name() {
        let folder = tempfile::tempdir().unwrap();
        for (name, format) in [("a.dng", StillFormat::Raw), ("a.tif", StillFormat::Tiff), ("a.x", StillFormat::Tiff)] {
            let file = folder.path().join(name);
            std::fs::write(&file, b"II*\0\x08\0\0\0").unwrap();
            assert_eq!(StillFormat::of_file(&file).unwrap(), Some(format), "{name}");
        }
    }

    #[test]
    fn folder_lists_copies_once_and_no_data_files() {
        let folder = tempfile::tempdir().unwrap();
        let names = |written: &[&str]| -> Vec<String> {
            for name in written {
                std::fs::write(folder.path().join(name), "").unwrap();
            }
            let files = pictures_in(folder.path()).unwrap();
            let mut names: Vec<String> =
                files.iter().map(|file| file.file_name().unwrap().to_string_lossy().into_owned()).collect();
            names.sort();
            written.iter().for_each(|name| std::fs::remove_file(folder.path().join(name)).unwrap());
            names
        };
        let phone = ["b.heic", "c.heic", "c.jpg", ".d.heic", "e.npy", "c_depth.exr", "c.tif", "f.dng", "f.JPG"];
        assert_eq!(names(&phone), ["b.heic", "c.jpg", "f.JPG"]);
        assert_eq!(names(&["a.dng", "a.heic", "b.dng"]), ["a.heic", "b.dng"]);
        assert_eq!(names(&["1.exr", "2.exr", "3.txt"]), ["1.exr", "2.exr"]);
        assert!(pictures_in(&folder.path().join("none")).is_err());
    }
}
