//! Kind of a file or folder that was dropped into the window or chosen.

use std::path::Path;

use locard_engine::profile;
use locard_engine::recording::Recording;
use locard_engine::scene::{self, is_model};
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};

/// Kind of a file, by its content.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileKind {
    Recording,
    Scene,
    Profile,
    /// A model that can be placed.
    Model,
    /// None of these, with the reasons.
    Neither(String),
}

impl FileKind {
    /// Reads the file; may block.
    pub fn of(path: &Path) -> Self {
        if is_model(path) {
            return match scene::load(path, None) {
                Ok(_) => Self::Model,
                Err(error) => Self::Neither(by_name(path, &error.to_string())),
            };
        }
        let text = file::read_text(path, MAX_DOCUMENT_BYTES).map_err(|error| error.to_string());
        let of_profile = text.and_then(|text| {
            if profile::is_calibration(path, &text) {
                return profile::Rig::of_file(path).map(drop).map_err(|error| error.to_string());
            }
            let read = profile::ProfileFile::parse(&text, path).map_err(|error| error.to_string());
            read.map(drop)
        });
        match (of_profile, scene::document::read(path)) {
            (Ok(()), _) => Self::Profile,
            (_, Ok(_)) => Self::Scene,
            (Err(no_profile), Err(no_scene)) => match Recording::refusal_at(path) {
                // A recording's description is a TOML file, too.
                None => Self::Recording,
                Some(_) if path.extension().is_some_and(|ending| ending == "toml") => Self::Neither(format!(
                    "{}: neither a recording's folder, nor a model, nor a profile ({no_profile}), nor a scene ({no_scene})",
                    path.display()
                )),
                Some(refusal) => {
                    Self::Neither(format!("{refusal}; or a model (.glb, .gltf), a profile or a scene (.toml)"))
                }
            },
        }
    }
}

/// Replaces the path at the beginning of an error by the file name. Commands in the text keep the
/// path.
fn by_name(path: &Path, text: &str) -> String {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    text.strip_prefix(&path.display().to_string()).map_or_else(|| text.to_owned(), |rest| format!("{name}{rest}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_kind_follows_the_contents() {
        let kind = |path: &str| FileKind::of(Path::new(path));
        assert_eq!(kind("recordings/demo"), FileKind::Recording);
        assert_eq!(kind("recordings/demo/recording.toml"), FileKind::Recording);
        assert_eq!((kind("scenes/demo.toml"), kind("profiles/simulated.toml")), (FileKind::Scene, FileKind::Profile));
        assert_eq!(kind("scenes/marker-1.glb"), FileKind::Model);
        let folder = tempfile::tempdir().unwrap();
        let model = std::fs::read("scenes/marker-1.glb").unwrap();
        let cut = folder.path().join("kaputt.glb");
        std::fs::write(&cut, &model[..2000]).unwrap();
        let message =
            format!("kaputt.glb is incomplete (2 of {} kB); copy or download it again", (model.len() + 500) / 1000);
        assert_eq!(FileKind::of(&cut), FileKind::Neither(message));
        std::fs::write(&cut, "a picture").unwrap();
        assert_eq!(
            FileKind::of(&cut),
            FileKind::Neither(
                "kaputt.glb is not a glTF file; export the model as .glb, in Blender by File, Export, glTF 2.0"
                    .to_owned()
            )
        );
        std::fs::write(&cut, "").unwrap();
        assert!(
            matches!(FileKind::of(&cut), FileKind::Neither(why) if why.starts_with("kaputt.glb is empty (0 bytes)"))
        );
        assert!(matches!(kind("no/where.toml"), FileKind::Neither(why) if why.contains("no/where.toml")));
    }

    #[test]
    fn refusal_of_an_unreadable_capture_names_the_program_that_converts_it() {
        let folder = tempfile::tempdir().unwrap();
        let why = |name: &str| match FileKind::of(&folder.path().join(name)) {
            FileKind::Neither(why) => why,
            other => panic!("{name}: {other:?}"),
        };
        for (file, command) in [
            ("colmap/database.db", "colmap mapper"),
            ("polycam/keyframes/images/1.jpg", "ns-process-data polycam"),
            ("jls/still.jls", "ffmpeg -i"),
        ] {
            let path = folder.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
            let why = why(file.split('/').next().unwrap());
            assert!(why.contains(command) && why.ends_with("a profile or a scene (.toml)"), "{why}");
        }
        assert!(why("jls/still.jls").contains("is JPEG-LS, which is not read; convert it: ffmpeg"));
    }

    #[test]
    fn command_in_a_refusal_keeps_the_models_folder() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("draco.gltf");
        std::fs::write(&file, r#"{"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]}"#)
            .unwrap();
        let FileKind::Neither(why) = FileKind::of(&file) else { panic!() };
        let command = format!("gltf-transform copy {} ", file.display());
        assert!(why.starts_with("draco.gltf: ") && why.contains(&command), "{why}");
    }
}
