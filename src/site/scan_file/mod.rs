//! Laser scans and meshes of a place, as scanners and scanning programs export them.
//!
//! Positions and triangles are read; colours, intensities, normals and textures are not.

mod e57;
mod error;
mod geometry;
mod geometry_builder;
mod input;
mod las;
mod las_header;
mod las_units;
mod laz;
mod obj;
mod ply;
mod ply_header;
mod refused;
mod stl;
#[cfg(test)]
mod test_data;
mod watched_file;
mod xyz;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

pub use error::ScanError;
pub use geometry::ScanGeometry;
use input::ScanReader;
pub use watched_file::ReadingWatch;

use crate::text::quoted;

/// A format that can be read.
struct ScanFormat {
    name: &'static str,
    /// First bytes of each file of the format. Empty if the extension alone decides.
    magic: &'static [u8],
    /// Lower case.
    extensions: &'static [&'static str],
    read: fn(ScanReader<'_>) -> Result<ScanGeometry, ScanError>,
}

const FORMATS: [ScanFormat; 6] = [
    ScanFormat { name: "E57", magic: b"ASTM-E57", extensions: &["e57"], read: e57::read },
    ScanFormat { name: "PLY", magic: b"ply", extensions: &["ply"], read: ply::read },
    ScanFormat { name: "LAS", magic: b"LASF", extensions: &["las", "laz"], read: las::read },
    ScanFormat { name: "OBJ", magic: b"", extensions: &["obj"], read: obj::read },
    ScanFormat { name: "STL", magic: b"", extensions: &["stl"], read: stl::read },
    ScanFormat { name: "XYZ", magic: b"", extensions: &["xyz", "pts", "asc", "txt", "csv"], read: xyz::read },
];

/// Reads a point cloud or a mesh: E57, PLY, LAS, LAZ, OBJ, STL, or columns of text (XYZ, PTS). glTF
/// is read as a scene ([`read_scan`](crate::scene::read_scan)). The content decides about the
/// format, and the extension only where the content has no signature.
///
/// # Errors
/// If the file cannot be read, is of another format, is damaged, or holds no finite point. No input
/// causes a panic. At most 2^28 points and as many triangles are read.
pub fn read(path: &Path) -> Result<ScanGeometry, ScanError> {
    read_watched(path, &ReadingWatch::default())
}

/// Like [`read`]; another thread watches the progress and may end it with an error.
pub fn read_watched(path: &Path, watch: &ReadingWatch) -> Result<ScanGeometry, ScanError> {
    // The readers validate their input; this catches the decoders' own panics.
    catch_unwind(AssertUnwindSafe(|| read_unguarded(path, watch))).unwrap_or_else(|panic| {
        let message = panic.downcast_ref::<String>().cloned();
        let message = message.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
        Err(ScanError::DecoderPanic { file: path.to_owned(), message: message.unwrap_or_default() })
    })
}

fn read_unguarded(path: &Path, watch: &ReadingWatch) -> Result<ScanGeometry, ScanError> {
    let mut input = ScanReader::open(path, watch)?;
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    let extension = extension.as_deref().unwrap_or_default();
    let start = input.peek(refused::SIGNATURE_BYTES)?;
    let by_content = FORMATS.iter().find(|format| !format.magic.is_empty() && start.starts_with(format.magic));
    if let Some(format) = by_content {
        return (format.read)(input);
    }
    if let Some(advice) = refused::advice(start, extension) {
        return Err(ScanError::unsupported(path, advice));
    }
    let Some(format) = FORMATS.iter().find(|format| format.extensions.contains(&extension)) else {
        let actual = if extension.is_empty() { "none".to_owned() } else { format!("`{}`", quoted(extension)) };
        let problem = format!(
            "it is of an unknown format (extension: {actual}); expected E57, PLY, LAS, LAZ, GLB, glTF, OBJ, STL, XYZ \
             or PTS: CloudCompare opens most scans and saves E57 and PLY"
        );
        return Err(ScanError::unsupported(path, problem));
    };
    if format.magic.is_empty() {
        return (format.read)(input);
    }
    let [magic, start_text] =
        [format.magic, &start[..start.len().min(format.magic.len())]].map(String::from_utf8_lossy);
    let problem = format!(
        "it is not a file of {}, which starts with `{magic}`; this one starts with `{}`: {}",
        format.name,
        quoted(&start_text),
        input::REMEDY
    );
    Err(ScanError::unsupported(path, problem))
}

#[cfg(test)]
mod tests {
    use super::test_data::{read_bytes, refusal};
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;

    const PLY: &[u8] = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
        property float z\nend_header\n1 2 3\n";

    #[test]
    fn content_decides_before_the_extension() {
        for name in ["a.ply", "a.xyz", "a.rcp", "a"] {
            assert_eq!(read_bytes(name, PLY).unwrap().positions, [Vec3::new(1.0, 2.0, 3.0)], "{name}");
        }
        let error = refusal("a.E57", PLY.strip_prefix(b"p").unwrap());
        assert!(error.starts_with("a.E57: it is not a file of E57, which starts with `ASTM-E57`"), "{error}");
        assert!(error.contains("starts with `ly\\nforma`"), "{error}");
    }

    #[test]
    fn other_formats_are_refused_with_the_way_to_export() {
        for (name, bytes, said) in [
            ("a.rcp", &b"x"[..], "ReCap"),
            ("a.fls", b"x", "SCENE"),
            ("a.usdz", b"PK\x03\x04", ".glb"),
            ("a.zip", b"PK\x03\x04", "unpack"),
            ("a.xyz", b"PK\x03\x04", "unpack"),
            ("a.bin", b"CCB2", "CloudCompare"),
            ("a.what", b"x", "unknown format (extension: `what`)"),
            ("a", b"x", "unknown format (extension: none)"),
            ("a.ply", b"", "it is empty (0 bytes)"),
        ] {
            let error = refusal(name, bytes);
            assert!(error.contains(said) && error.lines().count() == 1, "{error}");
        }
        let missing = read(Path::new("/nowhere/a.ply")).unwrap_err().to_string();
        assert!(missing.contains("there is no such file"), "{missing}");
    }

    proptest! {
        #[test]
        fn damaged_texts_never_panic(
            at in 0usize..130,
            with in any::<u8>(),
            cut in 0usize..400,
            name in "a\\.(ply|obj|stl|xyz|las|e57)",
        ) {
            let text = [PLY, b"v 1 2 3\nf 1 1 1\nsolid a\nvertex 1 2 3\nendloop\nLASF ASTM-E57 {}"].concat();
            for mut bytes in [text.clone(), text[PLY.len()..].to_vec()] {
                let at = at % bytes.len();
                bytes[at] = with;
                bytes.truncate(cut.max(1));
                let panicked = matches!(read_bytes(&name, &bytes), Err(ScanError::DecoderPanic { .. }));
                prop_assert!(!panicked);
            }
        }
    }
}
