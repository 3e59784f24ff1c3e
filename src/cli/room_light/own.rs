//! The user's panorama in place of the estimated one, scaled to the brightness of the footage.

use std::path::Path;

use anyhow::{Result, bail};
use glam::{DVec3, Vec3};

use locard_engine::plane::Plane;
use locard_engine::scene::document::{LampTable, LightTable};
use locard_engine::scene::{self, Lighting, SceneFile};
use locard_engine::shadow::{Room, WhiteRadiance, white_radiance};
use locard_engine::text::fixed;

/// Radiance of a white surface that faces up, without occluders.
pub fn upward(lighting: &Lighting, at_m: DVec3, up: DVec3) -> WhiteRadiance {
    white_radiance(lighting, &Room::default(), &Plane { point_m: at_m, normal: up })
}

/// A scene's light table for a panorama and additional lamps, the resulting lighting, and a line
/// about it. The panorama is scaled so that a white surface that faces up has the radiance
/// `target`. `file` has the scene's up, and `scene` is its path, which may not exist yet.
pub fn light(
    panorama: &Path,
    turn_deg: Option<f64>,
    lamps: Vec<LampTable>,
    (file, scene): (&SceneFile, &Path),
    up: DVec3,
    target: Vec3,
) -> Result<(LightTable, Lighting, String)> {
    let mut table = LightTable {
        environment: Some(scene::relative(panorama, scene)),
        environment_rotation_deg: turn_deg,
        white_lx: file.light.white_lx,
        lamp: lamps,
        ..LightTable::default()
    };
    let lighting_of = |light: &LightTable| {
        let file = SceneFile { up: file.up, light: light.clone(), ..SceneFile::default() };
        Ok::<_, scene::SceneError>(scene::load_file(&file, scene, None)?.lighting)
    };
    let unscaled = upward(&lighting_of(&table)?, DVec3::ZERO, up).far;
    let intensity = f64::from(target.element_sum()) / f64::from(unscaled.element_sum());
    if !(intensity.is_finite() && intensity > 0.0) {
        bail!(
            "{}: it has no light from above, or the footage has none, so its brightness is unknown",
            panorama.display()
        );
    }
    let shown = |light: Vec3| light.to_array().map(|v| fixed(v.into(), 2)).join(", ");
    let line = format!(
        "upward-facing matt white shows {} by it; times {}, as bright as the light that was found, {}",
        shown(unscaled),
        fixed(intensity, 4),
        shown(unscaled * intensity as f32)
    );
    table.environment_intensity = Some(format!("{intensity:.6}").parse().unwrap_or(intensity));
    let lighting = lighting_of(&table)?;
    Ok((table, lighting, line))
}

pub fn turn(text: &str) -> Result<f64, String> {
    let deg = text.trim().parse().ok().filter(|deg| (-360.0..=360.0).contains(deg));
    deg.ok_or_else(|| "expected -360 to 360 degrees".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::scene::document::{Axis, Up};
    use locard_engine::scene::{Environment, EnvironmentMap};

    /// A file of 64 × 32 px: 2 above the horizon, 0.5 below.
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
    fn panorama_is_scaled_to_the_footage_and_rotated() {
        let temp = tempfile::tempdir().unwrap();
        std::fs::create_dir(temp.path().join("scenes")).unwrap();
        let (sky, scene) = (sky(temp.path()), temp.path().join("scenes/a.toml"));
        let file = SceneFile { up: Some(Up::Named(Axis::Z)), ..SceneFile::default() };
        let target = Vec3::new(0.4, 0.5, 0.6);
        let result = light(&sky, Some(90.0), Vec::new(), (&file, &scene), DVec3::Z, target);
        let (table, lighting, line) = result.unwrap();
        // A quarter of the 2 above the horizon is 0.5.
        assert!((table.environment_intensity.unwrap() - 0.25).abs() < 2e-3, "{table:?} {line}");
        assert_eq!(table.environment_rotation_deg, Some(90.0));
        assert_eq!(table.environment.as_deref(), Some("../sky.hdr"));
        let radiance = |normal| upward(&lighting, DVec3::ZERO, normal).light().x;
        // 0.5 · 0.25 from below, and half of each on a wall.
        for (normal, expected) in [(DVec3::Z, 0.5), (DVec3::NEG_Z, 0.125), (DVec3::X, 0.3125)] {
            assert!((radiance(normal) - expected).abs() < 0.01, "{normal}: {} {expected}", radiance(normal));
        }
        // −z, the centre of the panorama, is the world's y, the same as for an upright model;
        // turned by 90° it is −x.
        let Environment::Map(EnvironmentMap { map_from_world, .. }) = lighting.environment else {
            panic!("a panorama")
        };
        assert!((map_from_world * Vec3::NEG_X).abs_diff_eq(Vec3::NEG_Z, 1e-5), "{map_from_world}");
    }
}
