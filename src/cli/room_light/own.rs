//! A person's own panorama in place of the one that was found, as bright as the footage.

use std::path::Path;

use anyhow::{Result, bail};
use glam::{DVec3, Vec3};

use locard_engine::scene::document::{LampTable, LightTable};
use locard_engine::scene::{self, Lighting, SceneFile, Support};
use locard_engine::shadow::{Room, WhiteRadiance, white_radiance};
use locard_engine::text::fixed;

/// White matt that looks up, at a place of the world where nothing hides anything.
pub fn upward(lighting: &Lighting, at_m: DVec3, up: DVec3) -> WhiteRadiance {
    white_radiance(lighting, &Room::default(), &Support { point_m: at_m, normal: up })
}

/// A scene's light by a panorama and lamps besides, and what the scene makes of it. White matt that looks up shows `wanted` by the
/// panorama: its intensity follows. `file` has the scene's up, and `scene` is where it is or would be.
pub fn light(
    panorama: &Path,
    turn_deg: Option<f64>,
    lamps: Vec<LampTable>,
    (file, scene): (&SceneFile, &Path),
    up: DVec3,
    wanted: Vec3,
) -> Result<(LightTable, Lighting, String)> {
    let mut table = LightTable {
        environment: Some(scene::relative(panorama, scene)),
        environment_rotation_deg: turn_deg,
        white_lx: file.light.white_lx,
        lamp: lamps,
        ..LightTable::default()
    };
    let lit = |light: &LightTable| {
        let file = SceneFile { up: file.up, light: light.clone(), ..SceneFile::default() };
        Ok::<_, scene::SceneError>(scene::load_file(&file, scene, None)?.lighting)
    };
    let has = upward(&lit(&table)?, DVec3::ZERO, up).far;
    let intensity = f64::from(wanted.element_sum()) / f64::from(has.element_sum());
    if !(intensity.is_finite() && intensity > 0.0) {
        bail!(
            "{}: no light comes from above in it, or none in the footage: nothing says how bright it is",
            panorama.display()
        );
    }
    let shown = |light: Vec3| light.to_array().map(|v| fixed(v.into(), 2)).join(", ");
    let line = format!(
        "white matt that looks up shows {} by it; times {}, as bright as the light that was found, {}",
        shown(has),
        fixed(intensity, 4),
        shown(has * intensity as f32)
    );
    table.environment_intensity = Some(format!("{intensity:.6}").parse().unwrap_or(intensity));
    let lighting = lit(&table)?;
    Ok((table, lighting, line))
}

pub fn turn(text: &str) -> Result<f64, String> {
    let deg = text.trim().parse().ok().filter(|deg| (-360.0..=360.0).contains(deg));
    deg.ok_or_else(|| format!("{text} is refused: accepted is -360 to 360 degrees"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::scene::document::{Axis, Up};
    use locard_engine::scene::{Environment, EnvironmentMap};

    /// 64 × 32: 2 above the horizon, 0.5 below, written as a file.
    fn sky(folder: &Path) -> std::path::PathBuf {
        let half = |light: f32| vec![image::Rgb([light; 3]); 64 * 16];
        let mut hdr = Vec::new();
        let encoder = image::codecs::hdr::HdrEncoder::new(&mut hdr);
        encoder.encode(&[half(2.0), half(0.5)].concat(), 64, 32).unwrap();
        let path = folder.join("sky.hdr");
        std::fs::write(&path, hdr).unwrap();
        path
    }

    #[test]
    fn a_panorama_is_as_bright_upward_as_the_footage_and_is_turned() {
        let temp = tempfile::tempdir().unwrap();
        std::fs::create_dir(temp.path().join("scenes")).unwrap();
        let (sky, scene) = (sky(temp.path()), temp.path().join("scenes/a.toml"));
        let file = SceneFile { up: Some(Up::Named(Axis::Z)), ..SceneFile::default() };
        let wanted = Vec3::new(0.4, 0.5, 0.6);
        let lit = light(&sky, Some(90.0), Vec::new(), (&file, &scene), DVec3::Z, wanted);
        let (table, lighting, line) = lit.unwrap();
        // All from above is 2: a quarter of it is 0.5.
        assert!((table.environment_intensity.unwrap() - 0.25).abs() < 2e-3, "{table:?} {line}");
        assert_eq!(table.environment_rotation_deg, Some(90.0));
        assert_eq!(table.environment.as_deref(), Some("../sky.hdr"));
        let shows = |normal| upward(&lighting, DVec3::ZERO, normal).light().x;
        // From below 0.5 · 0.25, and half of each on a wall.
        for (normal, expected) in [(DVec3::Z, 0.5), (DVec3::NEG_Z, 0.125), (DVec3::X, 0.3125)] {
            assert!((shows(normal) - expected).abs() < 0.01, "{normal}: {} {expected}", shows(normal));
        }
        // −z of the panorama, its middle, looks along the world's y as an upright model does; by 90° it comes to −x.
        let Environment::Map(EnvironmentMap { map_from_world, .. }) = lighting.environment else {
            panic!("a panorama")
        };
        assert!((map_from_world * Vec3::NEG_X).abs_diff_eq(Vec3::NEG_Z, 1e-5), "{map_from_world}");
    }
}
