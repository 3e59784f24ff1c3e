//! Checkpoints: results of an analysis's finished stages, by which an interrupted analysis resumes.
//!
//! They lie in a folder beside the artefact's, of its name with `.part`: one file per stage, in
//! order, as CBOR, which is exact for floating-point numbers. The result of a resumed analysis has
//! the same bytes as one without interruption. The folder is bound to all inputs of the stages; a
//! folder with another binding is discarded. Each file begins with a SHA-256 of its content, its
//! stage number and that binding: a stage that is damaged, exchanged or from another folder is
//! computed again.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use super::capture_info::CaptureInfo;
use super::dependencies::Dependencies;
use super::inputs;
use crate::camera::Geometry;
use crate::recording::Recording;
use crate::sink::atomic::write_atomically;
use crate::source::file;

/// File with the folder's binding.
const BINDING_FILE: &str = "bound.txt";
const STAGE_PREFIX: &str = "stage-";
/// Largest file of a stage, bytes.
const MAX_STAGE_BYTES: u64 = 1 << 30;

/// Checkpoints of an analysis, one for each finished stage.
#[derive(Debug, Default)]
pub struct Checkpoints {
    /// `None`: nothing is stored.
    folder: Option<PathBuf>,
    /// Digest of all inputs of the stages.
    binding: String,
    stage: usize,
}

impl Checkpoints {
    /// Stores nothing.
    pub fn none() -> Self {
        Self::default()
    }

    /// Checkpoints of the analysis that will be written to `folder`. Where the file system refuses,
    /// nothing is stored.
    pub fn of(folder: &Path, recording: &Recording, camera: &Geometry, capture: &CaptureInfo<'_>) -> Self {
        let mut name = folder.file_name().unwrap_or_default().to_owned();
        name.push(".part");
        let folder = folder.with_file_name(name);
        let binding = binding(recording, camera, capture);
        let path = folder.join(BINDING_FILE);
        let is_bound = file::read_text(&path, 1 << 10).is_ok_and(|text| text == binding);
        let is_usable = is_bound || {
            clear(&folder);
            let made = std::fs::create_dir_all(&folder).is_ok();
            made && write_atomically(&path, true, |out| out.write_all(binding.as_bytes())).is_ok()
        };
        Self { folder: Some(folder).filter(|_| is_usable), binding, stage: 0 }
    }

    /// The result of the next stage: from its checkpoint, or computed by `make` and stored.
    pub fn stage<T: Serialize + DeserializeOwned, E>(&mut self, make: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        let stage = self.stage;
        self.stage += 1;
        let path = self.folder.as_ref().map(|folder| folder.join(format!("{STAGE_PREFIX}{stage:02}")));
        if let Some(there) = path.as_deref().and_then(|path| self.read(path, stage)) {
            return Ok(there);
        }
        let made = make()?;
        let mut bytes = Vec::new();
        if let Some(path) = path
            && ciborium::into_writer(&made, &mut bytes).is_ok()
        {
            let checksum = self.checksum(stage, &bytes);
            // A stage that cannot be stored is computed again by a resumed analysis.
            let _ = write_atomically(&path, true, |out| out.write_all(&checksum).and_then(|()| out.write_all(&bytes)));
        }
        Ok(made)
    }

    /// A stage's checkpoint; `None` if there is none, or not the one that was written there.
    fn read<T: DeserializeOwned>(&self, path: &Path, stage: usize) -> Option<T> {
        let file = file::read(path, MAX_STAGE_BYTES).ok()?;
        let (checksum, bytes) = file.split_first_chunk::<32>()?;
        let is_intact = *checksum == self.checksum(stage, bytes);
        is_intact.then(|| ciborium::from_reader(bytes).ok())?
    }

    /// SHA-256 of a stage's content, its number and the folder's binding.
    fn checksum(&self, stage: usize, bytes: &[u8]) -> [u8; 32] {
        let mut hash = Sha256::new();
        hash.update(format!("{} {stage} ", self.binding));
        hash.update(bytes);
        hash.finalize().into()
    }

    /// Removes the checkpoints, after the analysis is written.
    pub fn finish(self) {
        if let Some(folder) = self.folder {
            clear(&folder);
        }
    }
}

/// Removes the checkpoints, and the folder if nothing else is in it.
fn clear(folder: &Path) {
    let own = |name: &str| name == BINDING_FILE || name.starts_with(STAGE_PREFIX);
    for entry in folder.read_dir().into_iter().flatten().flatten() {
        if own(&entry.file_name().to_string_lossy()) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
    let _ = std::fs::remove_dir(folder);
}

/// SHA-256 of the inputs of all stages: the recording, the camera, and the program with its version
/// of the format.
fn binding(recording: &Recording, camera: &Geometry, capture: &CaptureInfo<'_>) -> String {
    let mut hash = Sha256::new();
    let program = (env!("CARGO_PKG_VERSION"), super::artefact::VERSION);
    hash.update(inputs::fingerprint(recording));
    let made_with = Dependencies::of(recording);
    hash.update(format!("{program:?} {camera:?} {made_with:?} {:?} {:?}", capture.response, capture.noise));
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Curve, NoiseBin, NoiseProfile, Response};
    use crate::recording::OpenOptions;

    fn checkpoints(folder: &Path) -> Checkpoints {
        Checkpoints { folder: Some(folder.to_owned()), ..Checkpoints::default() }
    }

    /// A folder with checkpoints of two stages, whose results are 1 and 2.
    fn two_stages() -> tempfile::TempDir {
        let temp = tempfile::tempdir().unwrap();
        let mut checkpoints = checkpoints(temp.path());
        assert_eq!((checkpoints.stage(|| Ok::<u64, ()>(1)), checkpoints.stage(|| Ok::<u64, ()>(2))), (Ok(1), Ok(2)));
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
            assert_eq!(checkpoints(temp.path()).stage(|| Ok::<u64, ()>(9)), Ok(9), "byte {at}");
        }
        std::fs::write(&file, intact).unwrap();
        assert_eq!(checkpoints(temp.path()).stage(|| Ok::<u64, ()>(9)), Ok(1));
    }

    #[test]
    fn checkpoints_that_were_exchanged_or_belong_to_another_analysis_are_made_again() {
        let temp = two_stages();
        let at = |name: &str| temp.path().join(name);
        std::fs::copy(at("stage-01"), at("stage-00")).unwrap();
        let mut exchanged = checkpoints(temp.path());
        assert_eq!(exchanged.stage(|| Ok::<u64, ()>(9)), Ok(9));
        assert_eq!(exchanged.stage(|| Ok::<u64, ()>(9)), Ok(2));
        let mut other = Checkpoints { binding: "another".to_owned(), ..checkpoints(temp.path()) };
        assert_eq!(other.stage(|| Ok::<u64, ()>(8)), Ok(8));
    }

    #[test]
    fn checkpoints_are_exact_and_end_at_the_interrupted_stage() {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path().join("a.part");
        std::fs::create_dir(&folder).unwrap();
        let values = vec![0.1, -1.0 / 3.0, 5e-324, f64::MAX, 2.5];
        let made: Result<Vec<f64>, ()> = checkpoints(&folder).stage(|| Ok(values.clone()));
        assert_eq!(made, Ok(values.clone()));
        let mut again = checkpoints(&folder);
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        let there: Result<Vec<f64>, ()> = again.stage(|| Err(()));
        assert_eq!(bits(&there.unwrap()), bits(&values));
        // The second stage was interrupted, and its truncated file is ignored.
        assert_eq!(again.stage(|| Err::<u32, _>("interrupted")), Err("interrupted"));
        std::fs::write(folder.join("stage-01"), [0x9b]).unwrap();
        let mut third = checkpoints(&folder);
        let _: Result<Vec<f64>, ()> = third.stage(|| Err(()));
        assert_eq!(third.stage(|| Ok::<Vec<f64>, ()>(vec![7.0])), Ok(vec![7.0]));
        // Other files in the folder stay.
        std::fs::write(folder.join("mine"), "").unwrap();
        third.finish();
        let left: Vec<_> = folder.read_dir().unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, ["mine"]);
        assert_eq!(Checkpoints::none().stage(|| Ok::<u32, ()>(3)), Ok(3));
    }

    #[test]
    fn stage_bound_to_another_camera_response_or_noise_is_made_again() {
        let temp = tempfile::tempdir().unwrap();
        let recording = Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap();
        let analyse = |focal_px: f64, response: &Response, noise: Option<&NoiseProfile>, value: u32| {
            let capture = CaptureInfo { response, noise, exposure_s: &|_| 0.01 };
            let camera = Geometry::pinhole(640, 480, focal_px);
            Checkpoints::of(&temp.path().join("a"), &recording, &camera, &capture)
                .stage(|| Ok::<u32, ()>(value))
                .unwrap()
        };
        let srgb = Response::default();
        let gamma = Response { curve: Curve::Gamma, ..srgb.clone() };
        let steeper = Response { gamma: gamma.gamma + 0.1, ..gamma.clone() };
        let noise_of = |sigma| NoiseProfile {
            example: None,
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
