//! What finished stages of an analysis gave, kept until all of it is written: one that was interrupted goes on where it was.
//!
//! A folder beside the artefact's, of its name with `.part`: a file for each stage, in their order, as CBOR, which keeps numbers to
//! the last bit. So the files at the end have the bytes that they have without interruption. The folder is bound to everything that
//! the stages follow from; a folder with another binding is discarded. Each file begins with a SHA-256 of its content, its
//! stage number and that binding: a stage that is damaged, exchanged or from another folder is computed again.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use super::dependencies::Dependencies;
use super::inputs;
use super::taken::Taken;
use crate::camera::Geometry;
use crate::recording::Recording;
use crate::sink::atomic::write_atomically;
use crate::source::file;

/// Says what a folder is bound to.
const BOUND: &str = "bound.txt";
const STAGE: &str = "stage-";
/// No stage gives more, bytes.
const MOST_STAGE: u64 = 1 << 30;

/// Checkpoints of an analysis, one for each finished stage.
#[derive(Debug, Default)]
pub struct Part {
    /// `None`: nothing is kept.
    folder: Option<PathBuf>,
    /// Digest of everything that the stages follow from.
    bound: String,
    stage: usize,
}

impl Part {
    /// Nothing is kept.
    pub fn none() -> Self {
        Self::default()
    }

    /// Of the analysis that is to lie in `folder`. Where nothing can be kept, an analysis is made all the same.
    pub fn of(folder: &Path, recording: &Recording, camera: &Geometry, taken: &Taken<'_>) -> Self {
        let mut name = folder.file_name().unwrap_or_default().to_owned();
        name.push(".part");
        let folder = folder.with_file_name(name);
        let bound = bound(recording, camera, taken);
        let is_bound = file::read_text(&folder.join(BOUND), 1 << 10).is_ok_and(|text| text == bound);
        let is_there = is_bound || {
            clear(&folder);
            let made = std::fs::create_dir_all(&folder).is_ok();
            made && write_atomically(&folder.join(BOUND), true, |out| out.write_all(bound.as_bytes())).is_ok()
        };
        Self { folder: Some(folder).filter(|_| is_there), bound, stage: 0 }
    }

    /// The next stage: what it gave before, or what it gives now.
    pub fn stage<T: Serialize + DeserializeOwned, E>(&mut self, make: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        let stage = self.stage;
        self.stage += 1;
        let path = self.folder.as_ref().map(|folder| folder.join(format!("{STAGE}{stage:02}")));
        if let Some(there) = path.as_deref().and_then(|path| self.read(path, stage)) {
            return Ok(there);
        }
        let made = make()?;
        let mut bytes = Vec::new();
        if let Some(path) = path
            && ciborium::into_writer(&made, &mut bytes).is_ok()
        {
            let checksum = self.checksum(stage, &bytes);
            // What cannot be kept is made again.
            let _ = write_atomically(&path, true, |out| out.write_all(&checksum).and_then(|()| out.write_all(&bytes)));
        }
        Ok(made)
    }

    /// A stage's checkpoint; `None` if there is none, or not the one that was written there.
    fn read<T: DeserializeOwned>(&self, path: &Path, stage: usize) -> Option<T> {
        let file = file::read(path, MOST_STAGE).ok()?;
        let (checksum, bytes) = file.split_first_chunk::<32>()?;
        let is_intact = *checksum == self.checksum(stage, bytes);
        is_intact.then(|| ciborium::from_reader(bytes).ok())?
    }

    /// SHA-256 of a stage's content, its number and the folder's binding.
    fn checksum(&self, stage: usize, bytes: &[u8]) -> [u8; 32] {
        let mut hash = Sha256::new();
        hash.update(format!("{} {stage} ", self.bound));
        hash.update(bytes);
        hash.finalize().into()
    }

    /// The analysis is written: nothing of this is needed any more.
    pub fn finish(self) {
        if let Some(folder) = self.folder {
            clear(&folder);
        }
    }
}

/// Removes what was kept, and the folder if nothing else is in it.
fn clear(folder: &Path) {
    let own = |name: &str| name == BOUND || name.starts_with(STAGE);
    for entry in folder.read_dir().into_iter().flatten().flatten() {
        if own(&entry.file_name().to_string_lossy()) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
    let _ = std::fs::remove_dir(folder);
}

/// SHA-256 of what stages follow from: the recording, the camera, and the program with its version of the format.
fn bound(recording: &Recording, camera: &Geometry, taken: &Taken<'_>) -> String {
    let mut hash = Sha256::new();
    let program = (env!("CARGO_PKG_VERSION"), super::artefact::VERSION);
    hash.update(inputs::fingerprint(recording));
    let made_with = Dependencies::of(recording);
    hash.update(format!("{program:?} {camera:?} {made_with:?} {:?} {:?}", taken.response, taken.noise));
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Curve, NoiseBin, NoiseProfile, Response};
    use crate::recording::OpenOptions;

    fn part(folder: &Path) -> Part {
        Part { folder: Some(folder.to_owned()), ..Part::default() }
    }

    /// A folder with two stages, 1 and 2.
    fn two_stages() -> tempfile::TempDir {
        let temp = tempfile::tempdir().unwrap();
        let mut part = part(temp.path());
        assert_eq!((part.stage(|| Ok::<u64, ()>(1)), part.stage(|| Ok::<u64, ()>(2))), (Ok(1), Ok(2)));
        temp
    }

    #[test]
    fn checkpoint_with_any_flipped_bit_is_made_again() {
        let temp = two_stages();
        let file = temp.path().join("stage-00");
        let intact = std::fs::read(&file).unwrap();
        for at in 0..intact.len() {
            let mut damaged = intact.clone();
            damaged[at] ^= 1;
            std::fs::write(&file, damaged).unwrap();
            assert_eq!(part(temp.path()).stage(|| Ok::<u64, ()>(9)), Ok(9), "byte {at}");
        }
        std::fs::write(&file, intact).unwrap();
        assert_eq!(part(temp.path()).stage(|| Ok::<u64, ()>(9)), Ok(1));
    }

    #[test]
    fn checkpoints_that_were_exchanged_or_belong_to_another_analysis_are_made_again() {
        let temp = two_stages();
        let at = |name: &str| temp.path().join(name);
        std::fs::copy(at("stage-01"), at("stage-00")).unwrap();
        let mut exchanged = part(temp.path());
        assert_eq!(exchanged.stage(|| Ok::<u64, ()>(9)), Ok(9));
        assert_eq!(exchanged.stage(|| Ok::<u64, ()>(9)), Ok(2));
        let mut other = Part { bound: "another".to_owned(), ..part(temp.path()) };
        assert_eq!(other.stage(|| Ok::<u64, ()>(8)), Ok(8));
    }

    #[test]
    fn what_a_stage_gave_comes_back_to_the_last_bit_and_no_further() {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path().join("a.part");
        std::fs::create_dir(&folder).unwrap();
        let values = vec![0.1, -1.0 / 3.0, 5e-324, f64::MAX, 2.5];
        let made: Result<Vec<f64>, ()> = part(&folder).stage(|| Ok(values.clone()));
        assert_eq!(made, Ok(values.clone()));
        let mut again = part(&folder);
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        let there: Result<Vec<f64>, ()> = again.stage(|| Err(()));
        assert_eq!(bits(&there.unwrap()), bits(&values));
        // The second was interrupted, and half a file is none.
        assert_eq!(again.stage(|| Err::<u32, _>("interrupted")), Err("interrupted"));
        std::fs::write(folder.join("stage-01"), [0x9b]).unwrap();
        let mut third = part(&folder);
        let _: Result<Vec<f64>, ()> = third.stage(|| Err(()));
        assert_eq!(third.stage(|| Ok::<Vec<f64>, ()>(vec![7.0])), Ok(vec![7.0]));
        // What is somebody else's stays.
        std::fs::write(folder.join("mine"), "").unwrap();
        third.finish();
        let left: Vec<_> = folder.read_dir().unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, ["mine"]);
        assert_eq!(Part::none().stage(|| Ok::<u32, ()>(3)), Ok(3));
    }

    #[test]
    fn stage_bound_to_another_camera_response_or_noise_is_made_again() {
        let temp = tempfile::tempdir().unwrap();
        let recording = Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap();
        let analyse = |focal_px: f64, response: &Response, noise: Option<&NoiseProfile>, value: u32| {
            let taken = Taken { response, noise, exposure_s: &|_| 0.01 };
            let camera = Geometry::pinhole(640, 480, focal_px);
            Part::of(&temp.path().join("a"), &recording, &camera, &taken).stage(|| Ok::<u32, ()>(value)).unwrap()
        };
        let srgb = Response::default();
        let gamma = Response { curve: Curve::Gamma, ..srgb };
        let steeper = Response { gamma: gamma.gamma + 0.1, ..gamma };
        let noise_of = |sigma| NoiseProfile {
            bins: [0, 1, 2].map(|_| vec![NoiseBin { code: 0.0, sigma }]),
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
        };
        assert_eq!(analyse(500.0, &srgb, None, 1), 1);
        assert_eq!(analyse(500.0, &srgb, None, 2), 1, "nothing changed");
        assert_eq!(analyse(510.0, &srgb, None, 3), 3, "another camera");
        assert_eq!(analyse(510.0, &gamma, None, 4), 4, "another response curve");
        assert_eq!(analyse(510.0, &steeper, None, 5), 5, "another exponent of the response curve");
        assert_eq!(analyse(510.0, &steeper, Some(&noise_of(1.0)), 6), 6, "noise that was calibrated");
        assert_eq!(analyse(510.0, &steeper, Some(&noise_of(2.0)), 7), 7, "another noise");
    }
}
