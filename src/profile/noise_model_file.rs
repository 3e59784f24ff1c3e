//! Files of noise by example that noise tables name.

use std::path::Path;
use std::sync::Arc;

use crate::example_noise::{NoiseModel, NoiseModelFile, file};
use crate::memo::{ByAddress, Memo};
use crate::source::file::{self as plain, FileStamp};
use crate::text;

/// Largest file of a model, bytes: ten times that of a calibration.
const MAX_MODEL_BYTES: u64 = 1 << 28;
/// Number of models in memory: those of the profiles that are compared, and of the ones before.
const CAPACITY: usize = 4;

/// Models by the state of their files. A profile that is read again has the same model until its
/// file changes.
static MODELS: Memo<FileStamp, ByAddress<NoiseModel>> = Memo::new(CAPACITY);

/// The model in a file. The error states the reason and the remedy, without the file's name.
pub fn read(path: &Path) -> Result<NoiseModelFile, String> {
    let canonical = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let model = MODELS.get_or_try_insert_with(FileStamp::of(&canonical), |stamp| {
        let unread = |error: &std::io::Error| {
            let reason = text::reason(error);
            format!(
                "cannot be read: {reason}; copy the file there, calibrate again with `locard calibrate noise`, or remove \
                 the key: noise then follows the table alone"
            )
        };
        let bytes = plain::read(&stamp.file, MAX_MODEL_BYTES).map_err(|error| unread(&error))?;
        let model = file::from_bytes(&bytes).map_err(|error| error.to_string())?;
        Ok::<_, String>(ByAddress(Arc::new(model)))
    })?;
    Ok(NoiseModelFile { file: path.to_owned(), model })
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::super::{ProfileFile, Rig};
    use super::*;
    use crate::compositor::Settings;
    use crate::example_noise::tests::MODEL;

    const TABLE: &str = "version = 1\n[camera.noise]\ncode = [8.0]\nsigma_r = [1.0]\nsigma_g = [1.0]\nsigma_b = [1.0]\n\
                         channel_correlation = [0.0, 0.0, 0.0]\nneighbour_correlation = [0.0, 0.0]\n\
                         example = \"camera.locnoise\" # at rest\n";

    /// A folder with a profile and its model; returns it and the profile.
    fn folder() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let profile = folder.path().join("camera.toml");
        std::fs::write(&profile, TABLE).unwrap();
        std::fs::write(folder.path().join("camera.locnoise"), file::to_bytes(&MODEL).unwrap()).unwrap();
        (folder, profile)
    }

    fn read_text(text: &str, path: &Path) -> Result<Rig, String> {
        let mut rig = Rig::default();
        rig.read_text(text, path, &mut Settings::default()).map_err(|error| error.to_string())?;
        Ok(rig)
    }

    fn reason(profile: &Path) -> String {
        Rig::of_file(profile).unwrap_err().to_string()
    }

    #[test]
    fn profile_with_an_example_reads_back_with_the_same_model() {
        let (_folder, profile) = folder();
        let rig = Rig::of_file(&profile).unwrap();
        let noise = rig.noise.clone().unwrap();
        let example = noise.example.as_ref().unwrap();
        assert!(*example.model == *MODEL && example.file == profile.with_file_name("camera.locnoise"));
        // The file is not read again: the model is the same object.
        assert!(Rig::of_file(&profile).unwrap() == rig);
        let mut document = ProfileFile::parse(TABLE, &profile).unwrap();
        document.set_noise(&noise, "", &profile);
        assert_eq!(document.to_string(), TABLE);
        document.set_noise(&crate::camera::NoiseProfile { example: None, ..noise }, "", &profile);
        assert!(!document.to_string().contains("example"), "{document}");
    }

    #[test]
    fn profile_written_elsewhere_names_the_same_model() {
        let (folder, profile) = folder();
        let rig = Rig::of_file(&profile).unwrap();
        let other = folder.path().join("sub").join("other.toml");
        std::fs::create_dir(folder.path().join("sub")).unwrap();
        let mut moved = ProfileFile::parse(TABLE, &profile).unwrap();
        moved.relocate(&profile, &profile.with_file_name("renamed.toml"));
        assert_eq!(moved.to_string(), TABLE);
        moved.relocate(&profile, &other);
        let text = moved.to_string();
        assert_eq!(text, TABLE.replace("\"camera", "\"../camera"));
        assert!(read_text(&text, &other).unwrap() == rig);
        let without = "version = 1\n[camera]\nwidth_px = 640\n";
        let mut unchanged = ProfileFile::parse(without, &profile).unwrap();
        unchanged.relocate(&profile, &other);
        assert_eq!(unchanged.to_string(), without);
        let mut new = ProfileFile::new("");
        new.set_noise(rig.noise.as_ref().unwrap(), "", &other);
        assert!(new.to_string().contains("\nexample = \"../camera.locnoise\"\n"), "{new}");
        // Without a file of its own the path is absolute.
        new.set_noise(rig.noise.as_ref().unwrap(), "", Path::new(""));
        assert!(read_text(&new.to_string(), Path::new("")).unwrap() == rig, "{new}");
    }

    #[test]
    fn serialized_rig_keeps_its_example_while_the_file_exists() {
        let (_folder, profile) = folder();
        let rig = Rig::of_file(&profile).unwrap();
        let text = serde_json::to_string(&rig).unwrap();
        assert!(serde_json::from_str::<Rig>(&text).unwrap() == rig);
        std::fs::remove_file(profile.with_file_name("camera.locnoise")).unwrap();
        let without: Rig = serde_json::from_str(&text).unwrap();
        assert_eq!(without.noise.map(|noise| (noise.example, noise.bins[0].len())), Some((None, 1)));
    }

    #[test]
    fn unusable_example_is_refused_with_profile_key_file_and_remedy() {
        let (_folder, profile) = folder();
        let model = profile.with_file_name("camera.locnoise");
        let bytes = std::fs::read(&model).unwrap();
        let check = |expected: &str| {
            let reason = reason(&profile);
            for part in
                [&profile.display().to_string(), "[camera.noise] example", &model.display().to_string(), expected]
            {
                assert!(reason.contains(part), "{part}: {reason}");
            }
        };
        let version = [&bytes[..8], &[9], &bytes[9..]].concat();
        let damaged = [&bytes[..200], &[bytes[200] ^ 1], &bytes[201..]].concat();
        for (content, expected) in [
            (&bytes[..bytes.len() - 1], "damaged or cut short at"),
            (&damaged, "damaged or cut short"),
            (&version, "version 9, expected 1; calibrate again"),
            (b"noise", "does not start with LOCNOISE; give a file of `locard calibrate noise`"),
        ] {
            std::fs::write(&model, content).unwrap();
            check(expected);
        }
        std::fs::remove_file(&model).unwrap();
        check("cannot be read");
        check("or remove the key");
        // A profile can be edited all the same.
        ProfileFile::parse(TABLE, &profile).unwrap();
    }
}
