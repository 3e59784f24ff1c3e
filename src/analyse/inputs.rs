//! Fingerprint of the recording from which an analysis was made.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::recording::Recording;
pub use crate::text::hex;

/// Number of bytes at either end of a picture that are hashed, with its length. A file of this size
/// or less is hashed whole.
const END_BYTES: u64 = 4096;

/// SHA-256 over the recording's files, hexadecimal: their names, lengths and contents (of pictures
/// the ends), the frames' times, the poses in the format's unit, the storage of depth, and the
/// recognised format. Of poses whose unit's length is given beside the files, positions count to
/// the precision of an `f32`: the precision left by multiplying and dividing by that length. A
/// recording in another folder is the same recording. A file that cannot be read counts as empty.
pub fn fingerprint(recording: &Recording) -> String {
    let mut hash = Sha256::new();
    let number = |n: u64, hash: &mut Sha256| hash.update(n.to_le_bytes());
    number(recording.frame_count() as u64, &mut hash);
    recording.timestamps_s.iter().for_each(|t| number(t.to_bits(), &mut hash));
    number(recording.track.clock_offset_s().to_bits(), &mut hash);
    for (time_s, pose) in recording.track.poses() {
        let (q, p) = (pose.rotation, pose.translation_m);
        [*time_s, q.x, q.y, q.z, q.w].into_iter().for_each(|v| number(v.to_bits(), &mut hash));
        for metres in p.to_array() {
            let bits = if recording.kind.is_metric() {
                metres.to_bits()
            } else {
                u64::from(((metres / recording.metres_per_unit) as f32).to_bits())
            };
            number(bits, &mut hash);
        }
    }
    hash.update(recording.depth_stored());
    for landmark in (0..recording.frame_count()).flat_map(|frame| recording.landmarks(frame)) {
        number(landmark.number, &mut hash);
        landmark.at_px.into_iter().for_each(|px| number(px.to_bits().into(), &mut hash));
    }
    let mut files: Vec<&Path> = recording.pictures().collect();
    files.sort_unstable();
    files.dedup();
    for file in files {
        hash.update(file.file_name().unwrap_or_default().as_encoded_bytes());
        let _ = ends(file, &mut hash);
    }
    hex(&hash.finalize())
}

fn ends(file: &Path, hash: &mut Sha256) -> std::io::Result<()> {
    let mut file = File::open(file)?;
    let length = file.metadata()?.len();
    hash.update(length.to_le_bytes());
    let mut bytes = Vec::new();
    if length <= 2 * END_BYTES {
        file.take(2 * END_BYTES).read_to_end(&mut bytes)?;
    } else {
        file.by_ref().take(END_BYTES).read_to_end(&mut bytes)?;
        file.seek(SeekFrom::End(-(END_BYTES as i64)))?;
        file.take(END_BYTES).read_to_end(&mut bytes)?;
    }
    hash.update(&bytes);
    Ok(())
}
