//! Detection of C2PA manifests in files and beside them, without their verification.
//!
//! Source: C2PA Technical Specification 2.2, sections Embedding Manifests into Assets and External
//! Manifests.

use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::source::file;

/// Chunk of a manifest in a PNG.
const PNG_CHUNK: [u8; 4] = *b"caBX";
/// Identifier of the box `uuid` of a manifest in an MP4 or a QuickTime file.
const BOX_UUID: [u8; 16] =
    [0xd8, 0xfe, 0xc3, 0xd6, 0x1b, 0x0e, 0x48, 0x3c, 0x92, 0x97, 0x58, 0x28, 0x87, 0x7e, 0xc4, 0x81];
/// Length of a PNG's signature, and of a chunk's length, type and checksum, bytes.
const PNG_START_BYTES: u64 = 8;
const CHUNK_FRAME_BYTES: u64 = 12;

/// Place of the manifest of a file in which it cannot be embedded.
pub fn sidecar_path(file: &Path) -> PathBuf {
    file.with_extension("c2pa")
}

/// True if a PNG, MP4, QuickTime or Matroska file has a manifest, valid or not.
pub fn has_signature(path: &Path) -> bool {
    match path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase().as_str() {
        "mkv" => sidecar_path(path).is_file(),
        "png" => embeds_manifest(path, true).unwrap_or(false),
        _ => embeds_manifest(path, false).unwrap_or(false),
    }
}

/// Walks the chunks of a PNG, or the boxes of an MP4. Fails at the file's end.
fn embeds_manifest(path: &Path, is_png: bool) -> io::Result<bool> {
    let mut file = file::open(path)?;
    let mut at = if is_png { PNG_START_BYTES } else { 0 };
    loop {
        file.seek(SeekFrom::Start(at))?;
        let length = u64::from(u32::from_be_bytes(read(&mut file)?));
        let kind: [u8; 4] = read(&mut file)?;
        if is_png && kind == PNG_CHUNK || !is_png && kind == *b"uuid" && read(&mut file)? == BOX_UUID {
            return Ok(true);
        }
        let length = match length {
            length if is_png => length + CHUNK_FRAME_BYTES,
            // The last box, to the file's end.
            0 => return Ok(false),
            // A length of 64 bits follows.
            1 => u64::from_be_bytes(read(&mut file)?),
            length => length,
        };
        at = at.saturating_add(length.max(8));
    }
}

fn read<const N: usize>(file: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    file.read_exact(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::label::with_chunks;
    use crate::pixels::Pixels;

    #[test]
    fn manifests_in_and_beside_files_are_found() {
        let temp = tempfile::tempdir().unwrap();
        let signed = |name: &str, bytes: &[u8]| {
            let path = temp.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            has_signature(&path)
        };
        let mut png = Vec::new();
        Pixels::from_u8(2, 1, vec![1; 6]).unwrap().write_png(&mut png).unwrap();
        assert!(!signed("a.png", &png) && !signed("a.png", b"short"));
        assert!(signed("a.png", &with_chunks(&png, &[(*b"tEXt", vec![7; 5]), (PNG_CHUNK, vec![0; 3])])));
        let head = [&b"\0\0\0\x0cftypisom"[..], b"\0\0\0\x01free\0\0\0\0\0\0\0\x14data"].concat();
        let manifest = [&b"\0\0\0\x1cuuid"[..], &BOX_UUID, b"data"].concat();
        let other = [&b"\0\0\0\x1cuuid"[..], &[7; 16], b"data"].concat();
        assert!(signed("a.mp4", &[&head[..], &other, &manifest].concat()));
        assert!(!signed("a.mov", &[&head[..], &other, b"\0\0\0\0mdat", &manifest].concat()));
        assert!(!signed("a.mkv", &manifest));
        std::fs::write(temp.path().join("a.c2pa"), "").unwrap();
        assert!(signed("a.mkv", &manifest));
        assert!(!has_signature(&temp.path().join("none.mp4")));
    }
}
