//! SHA-256 digests of files and pictures.

use std::io::{self, Read};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use sha2::{Digest, Sha256};

use crate::pixels::Pixels;
use crate::sink::little_endian;
use crate::source::file;
use crate::text::hex;

/// Length of a block that is read at once, bytes.
const BLOCK_BYTES: usize = 1 << 20;

/// Length and digest of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DigestedFile {
    pub bytes: u64,
    pub sha256: String,
}

/// Digests a file.
pub fn file_digest(path: &Path) -> io::Result<DigestedFile> {
    digest_of(path, &AtomicBool::new(false))
}

/// Digests a file, or fails with [`io::ErrorKind::Interrupted`] once `is_cancelled` is set.
pub(super) fn digest_of(path: &Path, is_cancelled: &AtomicBool) -> io::Result<DigestedFile> {
    let (mut file, mut sha, mut bytes) = (file::open(path)?, Sha256::new(), 0);
    let mut block = vec![0; BLOCK_BYTES];
    while !is_cancelled.load(Ordering::Relaxed) {
        let length = match file.read(&mut block) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            length => length?,
        };
        if length == 0 {
            return Ok(DigestedFile { bytes, sha256: hex(&sha.finalize()) });
        }
        sha.update(&block[..length]);
        bytes += length as u64;
    }
    Err(io::ErrorKind::Interrupted.into())
}

/// Digest of a picture's code values.
pub fn pixels_digest(pixels: &Pixels) -> String {
    bytes_digest(&little_endian(&pixels.codes))
}

/// Digest of bytes.
pub fn bytes_digest(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FIPS 180-2, appendix B.1: the digest of "abc".
    const ABC: &str = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

    #[test]
    fn digests_match_the_published_example() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc");
        std::fs::write(&path, "abc").unwrap();
        assert_eq!(file_digest(&path).unwrap(), DigestedFile { bytes: 3, sha256: ABC.to_owned() });
        assert_eq!(pixels_digest(&Pixels::from_u8(1, 1, b"abc".to_vec()).unwrap()), ABC);
        // Little-endian: 0x6261 is "ab".
        let deep = Pixels::from_u16(1, 1, vec![0x6261, 0x0063, 0]).unwrap();
        assert_eq!(pixels_digest(&deep), hex(&Sha256::digest(b"abc\0\0\0")));
    }
}
