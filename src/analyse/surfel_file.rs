//! File of an analysis's surfels: binary PLY.

use std::path::Path;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::inputs::hex;
use crate::frame::Surfel;
use crate::source::file;
use crate::text::reason;

/// Larger files are refused, bytes.
const MAX_FILE_BYTES: u64 = 1 << 24;
/// Six numbers of 32 bits and three bytes.
const SURFEL_BYTES: usize = 27;
const PROPERTIES: &str = "property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\n\
                          property float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n";

/// Surfels with the precision of their file: eight bits per colour channel.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfelMap {
    pub surfels: Arc<[Surfel]>,
    /// The file.
    pub ply: Arc<[u8]>,
}

impl SurfelMap {
    /// `None` if there are none.
    pub fn of(surfels: &[Surfel]) -> Option<Self> {
        let ply = encode(surfels);
        let surfels = decode(&ply)?;
        (!surfels.is_empty()).then(|| Self { surfels: surfels.into(), ply: ply.into() })
    }

    /// SHA-256 of its file, hexadecimal.
    pub fn fingerprint(&self) -> String {
        hex(&Sha256::digest(&self.ply))
    }

    /// Reads a file and checks its SHA-256.
    pub fn read(path: &Path, fingerprint: &str) -> Result<Self, String> {
        let ply = file::read(path, MAX_FILE_BYTES).map_err(|error| reason(&error))?;
        let surfels = decode(&ply).filter(|_| hex(&Sha256::digest(&ply)) == fingerprint);
        let surfels = surfels.ok_or("these are not the surfaces that were found: analyse the recording again")?;
        Ok(Self { surfels: surfels.into(), ply: ply.into() })
    }
}

fn header(count: usize) -> String {
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment surfaces of a room in its world's axes, m; colours are square roots of \
         linear light\nelement vertex {count}\n{PROPERTIES}end_header\n"
    )
}

fn encode(surfels: &[Surfel]) -> Vec<u8> {
    let mut ply = header(surfels.len()).into_bytes();
    for surfel in surfels {
        surfel.to_array()[..6].iter().for_each(|number| ply.extend(number.to_le_bytes()));
        ply.extend(surfel.sqrt_color.map(|color| (255.0 * color).round().clamp(0.0, 255.0) as u8));
    }
    ply
}

/// `None` if it is not a file of [`encode`].
fn decode(ply: &[u8]) -> Option<Vec<Surfel>> {
    let count = (ply.len().saturating_sub(header(0).len())) / SURFEL_BYTES;
    let surfels = ply.strip_prefix(header(count).as_bytes())?;
    let chunks = surfels.chunks_exact(SURFEL_BYTES);
    if chunks.len() != count || !chunks.remainder().is_empty() {
        return None;
    }
    let surfel = |bytes: &[u8]| {
        let number = |n: usize| f32::from_le_bytes([0, 1, 2, 3].map(|k| bytes[4 * n + k]));
        let color = |n: usize| f32::from(bytes[18 + n]) / 255.0;
        Surfel::from_array(std::array::from_fn(|n| if n < 6 { number(n) } else { color(n) }))
    };
    let is_finite = |surfel: &Surfel| surfel.position_m.is_finite() && surfel.normal.is_finite();
    let surfels: Vec<Surfel> = chunks.map(surfel).collect();
    surfels.iter().all(is_finite).then_some(surfels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn surfel(n: u16) -> Surfel {
        let x = f32::from(n);
        Surfel { position_m: Vec3::new(x, 0.1, -2.5), normal: Vec3::Z, sqrt_color: [0.2, 0.4, x / 255.0] }
    }

    #[test]
    fn surfels_of_any_count_come_back_as_they_were_written() {
        for count in [1, 9, 10, 11, 100, 1000] {
            let surfels: Vec<Surfel> = (0..count).map(|n| surfel(n % 256)).collect();
            let map = SurfelMap::of(&surfels).unwrap();
            assert_eq!(map.surfels.as_ref(), surfels, "{count}");
        }
        assert_eq!(SurfelMap::of(&[]), None);
    }

    #[test]
    fn another_or_a_damaged_file_is_refused() {
        let map = SurfelMap::of(&[surfel(1), surfel(2)]).unwrap();
        let file = tempfile::NamedTempFile::new().unwrap();
        let read = |bytes: &[u8]| {
            std::fs::write(file.path(), bytes).unwrap();
            SurfelMap::read(file.path(), &map.fingerprint())
        };
        assert_eq!(read(&map.ply), Ok(map.clone()));
        let other = SurfelMap::of(&[surfel(1), surfel(3)]).unwrap();
        for bytes in [&other.ply[..], &map.ply[..map.ply.len() - 1], b"ply\n", b""] {
            assert!(read(bytes).unwrap_err().contains("analyse the recording again"));
        }
    }
}
