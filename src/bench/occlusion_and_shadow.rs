//! Cost of occlusion and shadows: the load's sphere on a floor, behind a real object.

use glam::DVec3;

use super::{BenchTable, Load, median_frame_ms};
use crate::compositor::{Settings, SubmitError};
use crate::pixels::{DepthMap, Pixels};
use crate::plane::Plane;
use crate::scene::Scene;

/// Normal of the floor, which the camera views at 40° from above.
const NORMAL: DVec3 = DVec3::new(0.0, -0.766, -0.643);
/// Depth of the real object, metres.
const REAL_OBJECT_M: f32 = 1.2;

/// The sphere on a floor, and a frame with depth.
pub struct FloorLoad {
    pub scene: Scene,
    pub pixels: Pixels,
    pub depth: DepthMap,
}

impl FloorLoad {
    pub fn new(load: &Load, pixels: &Pixels) -> Self {
        let mut scene = load.scene.clone();
        let normal = NORMAL.normalize();
        let sphere = scene.objects[0].parts[0].world_from_mesh;
        let point_m = sphere.translation - sphere.matrix3.x_axis.length() * normal;
        scene.objects[0].support = Some(Plane { point_m, normal });

        // The real object covers the left third of the sphere and is darker than the rest.
        let (width, height) = (pixels.width, pixels.height);
        let is_real_object =
            |x: u32, y: u32| x * 20 > width * 7 && x * 20 < width * 9 && y * 5 > height && y * 5 < height * 4;
        let places = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let floor_m = |x: u32, y: u32| {
            let ray = load.geometry.depth_ray((f64::from(x) + 0.5, f64::from(y) + 0.5).into());
            ray.map_or(0.0, |ray| (point_m.dot(normal) / ray.dot(normal)).max(0.0) as f32)
        };
        let depth_m = places().map(|(x, y)| if is_real_object(x, y) { REAL_OBJECT_M } else { floor_m(x, y) }).collect();
        let depth = DepthMap { width, height, depth_m, timestamp_s: 0.0 };
        let codes = places().flat_map(|(x, y)| [if is_real_object(x, y) { 60 } else { 120 }; 3]).collect();
        let pixels = Pixels::from_u8(width, height, codes).unwrap_or_else(|| pixels.clone());
        Self { scene, pixels, depth }
    }
}

/// Adds rows for occlusion, for shadows, and for both, over a plain composite.
pub fn time(table: &mut BenchTable<'_>, load: &Load, pixels: &Pixels) -> Result<(), SubmitError> {
    let FloorLoad { scene, pixels, depth } = FloorLoad::new(load, pixels);
    let mut plain = Settings::default();
    plain.plain();
    let [mut occluded, mut shaded] = [plain.clone(), plain.clone()];
    occluded.depth.occlusion = true;
    shaded.shadow.cast = true;
    let mut both = occluded.clone();
    both.shadow = shaded.shadow.clone();
    for (name, settings) in [("occlusion", occluded), ("shadow", shaded), ("occlusion and shadow", both)] {
        let name = format!("plain + {name}");
        if table.includes(&name) {
            let ms = median_frame_ms(table.gpu, load, &scene, (&pixels, Some(&depth)), &settings, &mut |_| ())?;
            table.push(name, ms)?;
        }
    }
    Ok(())
}
