//! `cargo +nightly fuzz run gltf scenes`: any bytes as a model. Nothing may panic, hang or take much memory.
#![no_main]

use libfuzzer_sys::fuzz_target;
use locard::scene::{self, SceneError};

fuzz_target!(|bytes: &[u8]| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(if bytes.starts_with(b"glTF") { "model.glb" } else { "model.gltf" });
    std::fs::write(&path, bytes).expect("a temporary file");
    match scene::load(&path, None) {
        Ok(scene) => drop(scene::describe(&scene)),
        // A panic that the loader caught is still a mistake of ours.
        Err(SceneError::Inside { message, .. }) => panic!("caught inside: {message}"),
        Err(error) => drop(error.to_string()),
    }
});
