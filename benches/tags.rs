//! Cost of tags per frame: detection, corners and pose, on one core.
//!
//! `RAYON_NUM_THREADS=1 cargo bench --bench tags`. The pictures show the sheet that
//! `locard board` prints, 0.8 m away.

#[path = "../tests/common/sheet.rs"]
mod sheet;
#[path = "../tests/common/srgb.rs"]
mod srgb;

use std::time::Instant;

use anyhow::{Context, Result};
use glam::DVec3;
use locard::camera::{Distortion, Geometry, Intrinsics, Response};
use locard::pixels::Pixels;
use locard::tags::{BoardTracker, Paper, Sheet, picture};
use sheet::{CAMERA, CameraPose, Sheet as Printed};

const PICTURES: u32 = 5;
const ROUNDS: usize = 40;

fn main() -> Result<()> {
    let sheet = Sheet::new(Paper::A4);
    let drawn = picture(&sheet);
    let grey = drawn.pixels().map(|p| p[0]).collect();
    let printed = Printed::of(drawn.width() as usize, drawn.height() as usize, grey);
    let intrinsics = Intrinsics {
        fx_px: CAMERA.focal_px,
        fy_px: CAMERA.focal_px,
        cx_px: CAMERA.centre_px.x,
        cy_px: CAMERA.centre_px.y,
        ..Intrinsics::default()
    };
    let distortion = Distortion { k1: CAMERA.k1, k2: CAMERA.k2, p1: CAMERA.p1, p2: CAMERA.p2, ..Distortion::default() };
    let mut searcher = BoardTracker::new(sheet.board, Geometry::new(intrinsics, distortion), &Response::default())?;
    let mut times_ms = Vec::new();
    for i in 0..PICTURES {
        let tilt = 0.2 + 0.15 * f64::from(i);
        let place = CameraPose::look_at(0.8 * DVec3::new(0.0, -tilt.sin(), tilt.cos()), DVec3::ZERO, 0.1);
        let codes = printed.photograph(&CAMERA, 4, 1.5, i.into(), |_| place);
        let pixels = Pixels::from_u8(sheet::SIZE.0, sheet::SIZE.1, codes).context("the picture has another size")?;
        for _ in 0..ROUNDS {
            let began = Instant::now();
            searcher.look(&pixels)?.ok().context("the sheet is not found")?;
            times_ms.push(1e3 * began.elapsed().as_secs_f64());
        }
    }
    times_ms.sort_by(f64::total_cmp);
    println!("tags: {:.2} ms in the median, {:.2} ms at least", times_ms[times_ms.len() / 2], times_ms[0]);
    Ok(())
}
