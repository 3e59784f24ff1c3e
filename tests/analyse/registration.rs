//! The real desk as a virtual object, in the recording that it was reconstructed from.

use crate::common;
use crate::gpu;
use crate::shot;
use crate::tier::fast_or_full;
use locard::fit::quantile::upper_median;
use locard::grey_image::GreyImage;
use locard::measure::displacement::{DisplacementOptions, displacements};

/// Patches must be much larger than the displacements, which reach 10 px in a few frames.
const PATCH_PX: usize = 64;

/// Reconstructed with one pose for the whole frame, and with a pose per row.
const GLOBAL: (&str, f64) = ("twins/tum-fr1-rpy-020.glb", 0.0);
const ROWS: (&str, f64) = ("twins/tum-fr1-rpy-020-rows.glb", 0.02);

/// Lengths of the displacements of all patches that a twin covers in these frames, rendered with
/// its readout time, px.
fn twin_displacements((twin, readout_time_s): (&str, f64), frames: std::ops::Range<usize>) -> Option<Vec<f64>> {
    let folder = common::data("tum-fr1-rpy")?;
    let twin = common::data(twin)?;
    let mut shot = shot::open(&folder, Some("profiles/tum-fr1.toml"), &twin);
    shot.rig.intrinsics.readout_time_s = readout_time_s;
    shot.settings.plain();
    let gpu = gpu::gpu();
    let mut lengths = Vec::new();
    for done in shot::composited(&gpu, &shot, frames) {
        let real = shot.read(done.frame).unwrap().pixels;
        let layer = done.layer.unwrap();
        let mask: Vec<bool> = layer.rgba.iter().map(|p| p[3] > 0.999).collect();
        let displacements = displacements(
            &GreyImage::luma_709(&real),
            &GreyImage::luma_709(&done.pixels),
            Some(&mask),
            &DisplacementOptions { patch_px: PATCH_PX, step_px: PATCH_PX / 2, ..Default::default() },
        )
        .unwrap();
        assert!(displacements.patches.len() > 5, "{} patches", displacements.patches.len());
        println!(
            "frame {}: median {:.3} px of {} patches",
            done.frame,
            displacements.median_length_px().unwrap(),
            displacements.patches.len()
        );
        lengths.extend(displacements.patches.iter().map(|p| p.displacement_px[0].hypot(p.displacement_px[1])));
    }
    Some(lengths)
}

#[test]
fn twin_coincides_with_its_own_frame() {
    let Some(lengths) = twin_displacements(GLOBAL, 20..21) else { return };
    let median = upper_median(lengths).unwrap();
    println!("frame 20: median displacement {median:.3} px");
    assert!(median <= 0.3, "{median}");
}

#[test]
fn twin_follows_the_camera() {
    let Some(lengths) = twin_displacements(GLOBAL, fast_or_full(24..27, 22..31)) else { return };
    let median = upper_median(lengths).unwrap();
    println!("frames from 22 on: median displacement {median:.3} px");
    assert!(median <= 2.2, "{median}");
}

#[test]
fn twin_by_row_times_is_closer_with_the_readout_time() {
    let Some(lengths) = twin_displacements(ROWS, 20..21) else { return };
    let own = upper_median(lengths).unwrap();
    assert!(own <= 0.3, "frame 20: {own}");
    let [Some(rows), Some(global)] = [ROWS, GLOBAL].map(|twin| {
        twin_displacements(twin, fast_or_full(24..27, 22..31)).map(|lengths| upper_median(lengths).unwrap())
    }) else {
        return;
    };
    println!("frame 20: {own:.3} px; frames 22 to 30: {rows:.3} px, without rows' times {global:.3} px");
    assert!(rows <= 0.92 * global, "{rows} {global}");
}
