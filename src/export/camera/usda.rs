//! A camera as a USD layer in text form. Focal length and apertures are in tenths of the layer's
//! unit, which is the metre (OpenUSD, `UsdGeomCamera`). Time codes are frame numbers.

use super::plate::{Plate, PlateLens};
use super::shot_camera::ShotCamera;
use super::usd_writer::{TRANSFORM_ORDER, UsdWriter, matrix};
use crate::text::number;

/// Millimetres in a tenth of a metre.
const MM_PER_TENTH: f64 = 100.0;

/// The camera's lens, in tenths of a metre.
struct UsdLens {
    focal_length: f64,
    offset: [f64; 2],
}

/// Width and height of the plate's aperture, in tenths of a metre. Its pixels have the film's size.
fn aperture(plate: &Plate, camera: &ShotCamera) -> [f64; 2] {
    let film = &camera.lenses[0].intrinsics;
    let per_px = film.film_width_mm / f64::from(film.width_px) / MM_PER_TENTH;
    [f64::from(plate.width_px) * per_px, f64::from(plate.height_px) * per_px]
}

fn lens(plate: &Plate, lens: &PlateLens, [width, height]: [f64; 2]) -> UsdLens {
    // The principal point is at (1/2 − offset / aperture) of the width from the left, and of the
    // height from below.
    let at = lens.principal_px / plate.size_px();
    UsdLens {
        focal_length: lens.focal_px.x / f64::from(plate.width_px) * width,
        offset: [width * (0.5 - at.x), height * (at.y - 0.5)],
    }
}

/// The layer's text. `evidence` is the text of the prims below /World.
pub fn write(camera: &ShotCamera, plate: &Plate, name: &str, evidence: &str) -> String {
    let rate = number(camera.fps);
    let [first, last] =
        [camera.frames.first(), camera.frames.last()].map(|frame| frame.map_or(0, |frame| frame.number));
    let name = name.replace(['"', '\\', '\n', '\r'], "_");
    let mut out = UsdWriter::default();
    out.line("#usda 1.0");
    out.line("(");
    for entry in [
        "defaultPrim = \"World\"".to_owned(),
        format!("doc = \"Camera of {name}\""),
        format!("endTimeCode = {last}"),
        format!("framesPerSecond = {rate}"),
        "metersPerUnit = 1".to_owned(),
        "renderSettingsPrimPath = \"/Render/Settings\"".to_owned(),
        format!("startTimeCode = {first}"),
        format!("timeCodesPerSecond = {rate}"),
        "upAxis = \"Y\"".to_owned(),
    ] {
        out.line(format_args!("    {entry}"));
    }
    out.line(")");
    out.line("");
    out.block("def Xform \"World\"", |out| {
        out.block("def Camera \"Camera\"", |out| write_camera(out, camera, plate));
        out.text.push_str(evidence);
    });
    out.line("");
    out.block("def Scope \"Render\"", |out| {
        out.block("def RenderSettings \"Settings\"", |out| {
            out.line("rel camera = </World/Camera>");
            out.line("uniform float pixelAspectRatio = 1");
            out.line(format_args!("uniform int2 resolution = ({}, {})", plate.width_px, plate.height_px));
        });
    });
    out.text
}

fn write_camera(out: &mut UsdWriter, camera: &ShotCamera, plate: &Plate) {
    let size = aperture(plate, camera);
    let lenses: Vec<UsdLens> = plate.lenses.iter().map(|of| lens(plate, of, size)).collect();
    let mut write_lens = |attribute: &str, value: &dyn Fn(&UsdLens) -> f64| {
        // Below a nanometre there are rounding errors only.
        let values: Vec<f64> =
            lenses.iter().map(value).map(|value| if value.abs() < 1e-10 { 0.0 } else { value }).collect();
        if values.windows(2).all(|pair| pair[0] == pair[1]) {
            out.line(format_args!("float {attribute} = {}", number(values[0])));
        } else {
            let samples = camera.frames.iter().map(|frame| (frame.number, number(values[frame.lens])));
            out.time_samples(format_args!("float {attribute}"), samples);
        }
    };
    write_lens("focalLength", &|lens| lens.focal_length);
    write_lens("horizontalAperture", &|_| size[0]);
    write_lens("horizontalApertureOffset", &|lens| lens.offset[0]);
    write_lens("verticalAperture", &|_| size[1]);
    write_lens("verticalApertureOffset", &|lens| lens.offset[1]);
    out.line("float2 clippingRange = (0.01, 1000)");
    out.line("token projection = \"perspective\"");
    let placements = camera.posed().map(|(frame, placement)| (frame.number, matrix(&placement.file_from_camera())));
    out.time_samples("matrix4d xformOp:transform", placements);
    out.line(TRANSFORM_ORDER);
}
