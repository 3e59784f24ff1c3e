//! What it costs that things stand in the room: the load's sphere on a floor, behind a real thing.

use glam::DVec3;

use super::{Load, Table, median_of};
use crate::compositor::{Settings, SubmitError};
use crate::pixels::{DepthMap, Pixels};
use crate::scene::Support;

/// The floor's normal: the camera looks down on it at 40°.
const NORMAL: DVec3 = DVec3::new(0.0, -0.766, -0.643);
/// How far away the real thing is, metres.
const THING_M: f32 = 1.2;

/// Rows for what hides, for shadows, and for both, over a plain composite.
pub fn standing(table: &mut Table<'_>, load: &Load, pixels: &Pixels) -> Result<(), SubmitError> {
    let mut scene = load.scene.clone();
    let normal = NORMAL.normalize();
    let sphere = scene.objects[0].parts[0].world_from_mesh;
    let point_m = sphere.translation - sphere.matrix3.x_axis.length() * normal;
    scene.objects[0].support = Some(Support { point_m, normal });

    // The thing covers the left third of the sphere; it is darker than the rest.
    let (width, height) = (pixels.width, pixels.height);
    let is_thing = |x: u32, y: u32| x * 20 > width * 7 && x * 20 < width * 9 && y * 5 > height && y * 5 < height * 4;
    let places = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let floor_m = |x: u32, y: u32| {
        let ray = load.geometry.depth_ray((f64::from(x) + 0.5, f64::from(y) + 0.5).into());
        ray.map_or(0.0, |ray| (point_m.dot(normal) / ray.dot(normal)).max(0.0) as f32)
    };
    let depth_m = places().map(|(x, y)| if is_thing(x, y) { THING_M } else { floor_m(x, y) }).collect();
    let depth = DepthMap { width, height, depth_m, timestamp_s: 0.0 };
    let codes = places().flat_map(|(x, y)| [if is_thing(x, y) { 60 } else { 120 }; 3]).collect();
    let pixels = &Pixels::from_u8(width, height, codes).unwrap_or_else(|| pixels.clone());

    let mut plain = Settings::default();
    plain.plain();
    let [mut hidden, mut shaded] = [plain.clone(), plain.clone()];
    hidden.depth.occlusion = true;
    shaded.shadow.cast = true;
    let mut both = hidden.clone();
    both.shadow = shaded.shadow.clone();
    for (name, settings) in [("occlusion", hidden), ("shadow", shaded), ("occlusion and shadow", both)] {
        let name = format!("plain + {name}");
        if table.wants(&name) {
            let ms = median_of(table.gpu, load, &scene, (pixels, Some(&depth)), &settings, &mut |_| ())?;
            table.push(name, ms)?;
        }
    }
    Ok(())
}
