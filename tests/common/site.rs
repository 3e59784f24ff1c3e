//! Recordings with a scene, for tests of laws that hold for every picture.

use std::path::Path;

use locard::compositor::Settings;
use locard::shot::Shot;

use crate::{common, shot};

/// The knife and the dagger on the desk of tum-fr1-rpy, real size.
const DESK: &str = r#"
version = 1
[[objects]]
model = "MODELS/knife.gltf"
size_m = 0.25
position_m = [0.45, 0.55, 0.8]
[[objects]]
model = "MODELS/dagger.gltf"
size_m = 0.3
position_m = [0.25, 0.35, 0.8]
rotation_deg = [0, 0, 50]
[light]
ambient = 0.6
"#;

pub struct NamedShot {
    pub name: &'static str,
    pub shot: Shot,
}

impl NamedShot {
    /// Applies profiles. Laws must hold with all effects on: noise, exposure and a lens with
    /// typical values.
    fn with(name: &'static str, mut shot: Shot, profiles: &[&str]) -> Self {
        for text in profiles {
            shot.rig.read_text(text, Path::new(name), &mut Settings::default()).unwrap();
        }
        Self { name, shot }
    }
}

/// The demonstration, and a real recording if `LOCARD_DATA` is set.
pub fn sites() -> Vec<NamedShot> {
    [Some(NamedShot::with("demo", shot::demo("scenes/demo.toml"), &[LENS])), desk()].into_iter().flatten().collect()
}

/// Opens a copy of the demonstration with the demonstration's scene and lens.
pub fn demo_like(recording: &Path) -> NamedShot {
    NamedShot::with("demo", shot::open(recording, None, Path::new("scenes/demo.toml")), &[LENS])
}

pub fn desk() -> Option<NamedShot> {
    let folder = common::data_if_any("tum-fr1-rpy")?;
    let models = common::data_if_any("props")?;
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    std::fs::write(&file, DESK.replace("MODELS", models.to_str().unwrap())).unwrap();
    let shot = shot::open(&folder, Some("profiles/tum-fr1.toml"), &file);
    Some(NamedShot::with("desk", shot, &[NOISE, LENS]))
}

const LENS: &str = "version = 1\n[camera.lens]\naperture_diameter_mm = 4\nfocus_distance_m = 0.8\n";

pub const NOISE: &str = "version = 1\n[camera.exposure]\ntime_s = 0.016\niso = 400\n[camera.noise]\ncode = [0, 255]\n\
    sigma_r = [2, 4]\nsigma_g = [2, 3]\nsigma_b = [3, 4]\nchannel_correlation = [0.3, 0.2, 0.3]\nneighbour_correlation = [0.4, 0.4]\n";
