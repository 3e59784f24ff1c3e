//! XMP in MP4 files: a box `uuid` at the end. Source: XMP Specification Part 3, 1.1.7; ISO/IEC
//! 14496-12, 4.2.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

const XMP_UUID: [u8; 16] =
    [0xbe, 0x7a, 0xcf, 0xcb, 0x97, 0xa9, 0x42, 0xe8, 0x9c, 0x71, 0x99, 0x94, 0x91, 0xe3, 0xaf, 0xac];

/// Appends a packet to an MP4. The offsets in the file stay valid.
pub fn append_box(file: &Path, packet: &str) -> io::Result<()> {
    let length = (8 + XMP_UUID.len() + packet.len()) as u32;
    let mut file = File::options().append(true).open(file)?;
    file.write_all(&[&length.to_be_bytes(), &b"uuid"[..], &XMP_UUID, packet.as_bytes()].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_is_appended_with_its_length() {
        let temp = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(temp.path(), b"film").unwrap();
        append_box(temp.path(), "<x/>").unwrap();
        let bytes = std::fs::read(temp.path()).unwrap();
        assert_eq!(&bytes[..12], b"film\0\0\0\x1cuuid");
        assert_eq!((&bytes[12..28], &bytes[28..]), (&XMP_UUID[..], &b"<x/>"[..]));
    }
}
