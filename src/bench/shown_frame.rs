//! Cost of a frame that is shown in a view, and of the same frame with another parameter: a
//! retained frame repeats only the stages that read it.

use std::sync::Arc;

use super::occlusion_and_shadow::FloorLoad;
use super::{BenchTable, INTERVAL_S, Load, median_ms};
use crate::compositor::{Compositor, Job, Settings, SubmitError, Target};
use crate::frame::Frame;
use crate::gpu::Texture;
use crate::params::Value;
use crate::pixels::Pixels;

/// Parameters that take turns between two values, and the name of the row.
const CHANGES: [(&str, Option<(&str, &str)>); 4] = [
    ("a shown frame, another each time", None),
    ("a shown frame, noise.scale changed", Some(("noise", "scale"))),
    ("a shown frame, exposure.ev changed", Some(("exposure", "ev"))),
    ("a shown frame, shadow.strength changed", Some(("shadow", "strength"))),
];

/// Adds a row for each of the changes: all effects at their defaults, with occlusion and shadows.
pub fn time(table: &mut BenchTable<'_>, load: &Load, pixels: &Pixels) -> Result<(), SubmitError> {
    let floor = FloorLoad::new(load, pixels);
    for (name, change) in CHANGES {
        if table.includes(name) {
            let ms = shown_frame_ms(table, load, &floor, change)?;
            table.push(name.to_owned(), ms)?;
        }
    }
    Ok(())
}

fn shown_frame_ms(
    table: &BenchTable<'_>,
    load: &Load,
    floor: &FloorLoad,
    change: Option<(&str, &str)>,
) -> Result<f64, SubmitError> {
    let Load { camera, geometry, track, .. } = load;
    let FloorLoad { scene, pixels, depth } = floor;
    let gpu = table.gpu;
    let mut compositor = Compositor::new(gpu.clone(), scene.clone());
    let format = wgpu::TextureFormat::Rgba8Unorm;
    let view = Texture::new(gpu, "shown frame", pixels.width, pixels.height, format, 1).view;
    let shown = Frame { depth: Some(Arc::new(depth.clone())), ..Frame::new(0, 0.0, pixels.clone()) };
    let mut count = 0;
    let frame_and_settings = || {
        count += 1;
        let mut settings = Settings::default();
        let Some((table, name)) = change else {
            let depth = Some(Arc::new(depth.clone()));
            return (Frame { depth, ..Frame::new(count, 0.0, pixels.clone()) }, settings);
        };
        let value = Value::Number(if count % 2 == 0 { 1.0 } else { 1.1 });
        let is_set = settings.set(table, name, &value);
        debug_assert!(matches!(is_set, Some(Ok(()))), "{table}.{name}");
        (shown.clone(), settings)
    };
    median_ms(frame_and_settings, |(frame, settings)| {
        let job = Job::of_frame(frame, camera, &settings, geometry, track, INTERVAL_S)?;
        let pending = compositor.submit(job, camera, &settings, Target::View(&view, format))?;
        pending.await_drawn(compositor.gpu())?;
        Ok::<_, SubmitError>(())
    })
}
