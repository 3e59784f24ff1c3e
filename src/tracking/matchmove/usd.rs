//! A camera of a USD layer in text form (`.usda`): the first prim of type `Camera`, with the
//! transforms of its parents. Time codes are numbers of frames. References, payloads, variants and
//! splines are not followed.

use std::path::Path;

use glam::{DAffine3, DVec3};

use super::animated_camera::{AnimatedCamera, CameraKeyframe, KeyframeClock};
use super::axes::CameraPlacement;
use super::keyframes::ascending;
use super::usd_text::{self, UsdLayer, UsdPrim, UsdTextError, UsdValue};
use super::usd_transform::PrimTransform;
use crate::source::file::{self, MAX_TEXT_BYTES};
use crate::tracking::records::TextError;

/// Extensions of USD's binary forms.
pub const BINARY_EXTENSIONS: [&str; 2] = ["usdc", "usdz"];

pub fn read(path: &Path) -> Result<AnimatedCamera, TextError> {
    let bytes = file::read(path, MAX_TEXT_BYTES).map_err(|source| TextError::Read { file: path.to_owned(), source })?;
    if bytes.starts_with(b"PXR-USDC") || bytes.starts_with(b"PK") {
        let problem = "is USD in binary form; convert it to text: usdcat --flatten FILE -o FILE.usda";
        return Err(TextError::line(path, 1, problem));
    }
    let text = String::from_utf8(bytes)
        .map_err(|_| TextError::line(path, 1, "is not text in UTF-8; expected USD's text format, .usda"))?;
    parse(&text).map_err(|(line, problem)| TextError::line(path, line, problem))
}

/// A camera with its parents, the outermost first.
struct PlacedCamera<'a> {
    camera: &'a UsdPrim,
    parents: Vec<&'a UsdPrim>,
}

fn cameras<'a>(prims: &'a [UsdPrim], parents: &[&'a UsdPrim], placed: &mut Vec<PlacedCamera<'a>>) {
    for prim in prims {
        if prim.kind == "Camera" {
            placed.push(PlacedCamera { camera: prim, parents: parents.to_vec() });
        }
        let parents: Vec<&UsdPrim> = parents.iter().copied().chain([prim]).collect();
        cameras(&prim.children, &parents, placed);
    }
}

fn metadata<'a>(layer: &'a UsdLayer, name: &str) -> Option<&'a UsdValue> {
    layer.metadata.iter().find(|entry| entry.0 == name).map(|entry| &entry.1)
}

fn parse(text: &str) -> Result<AnimatedCamera, UsdTextError> {
    let layer = usd_text::parse(text)?;
    let mut placed_cameras = Vec::new();
    cameras(&layer.prims, &[], &mut placed_cameras);
    let Some(PlacedCamera { camera, parents }) = placed_cameras.first() else {
        let advice = "if it is in another layer, usdcat --flatten FILE -o FILE.usda puts both into one";
        return Err((1, format!("has no prim of type Camera; {advice}")));
    };
    let mut chain = Vec::new();
    for prim in parents.iter().copied().chain([*camera]) {
        let transform = PrimTransform::of(prim)?;
        if transform.resets_parents {
            chain.clear();
        }
        chain.push(transform);
    }
    let metres_per_unit = match metadata(&layer, "metersPerUnit") {
        Some(UsdValue::Number(unit)) if unit.is_finite() && *unit > 0.0 => *unit,
        // USD's default is the centimetre.
        None => 0.01,
        Some(_) => return Err((1, "metersPerUnit is not a number above 0".to_owned())),
    };
    let up = match metadata(&layer, "upAxis") {
        Some(UsdValue::Text(axis)) if axis == "Z" => DVec3::Z,
        _ => DVec3::Y,
    };
    let mut times = ascending(chain.iter().flat_map(PrimTransform::times));
    if times.is_empty() {
        // A camera at rest. Its keyframes cover the layer's time codes.
        let time = |name| match metadata(&layer, name) {
            Some(UsdValue::Number(time)) if time.is_finite() => Some(*time),
            _ => None,
        };
        times = ascending([time("startTimeCode"), time("endTimeCode")].into_iter().flatten());
    }
    if times.is_empty() {
        return Err((camera.line, format!("the camera {} has no time samples", crate::text::quoted(&camera.name))));
    }
    let mut keyframes = Vec::with_capacity(times.len());
    for at in times {
        let mut placed = chain.iter().fold(DAffine3::IDENTITY, |outer, inner| outer * inner.at(at));
        placed.translation *= metres_per_unit;
        let placement = CameraPlacement::of_transform(placed).ok_or_else(|| {
            let problem = "is mirrored, sheared or not finite";
            (camera.line, format!("the transform at time code {} {problem}", crate::text::number(at)))
        })?;
        keyframes.push(CameraKeyframe { at, placement });
    }
    let mut warnings = Vec::new();
    if placed_cameras.len() > 1 {
        let name = crate::text::quoted(&camera.name);
        warnings.push(format!("the first of {} cameras is read: {name}", placed_cameras.len()));
    }
    Ok(AnimatedCamera { clock: KeyframeClock::FrameNumbers, keyframes, up, warnings })
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    const LAYER: &str = r#"#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Z"
)
def Xform "rig"
{
    double3 xformOp:translate = (100, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Camera "cam"
    {
        double3 xformOp:translate.timeSamples = { 1001: (0, 50, 0), 1002: (0, 70, 0) }
        float xformOp:rotateX = 90
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
    }
    def Camera "witness" {}
}
"#;

    #[test]
    fn camera_is_read_with_its_parents_in_metres() {
        let camera = parse(LAYER).unwrap();
        assert_eq!((camera.clock, camera.up, camera.keyframes.len()), (KeyframeClock::FrameNumbers, DVec3::Z, 2));
        let last = camera.keyframes[1];
        assert!(last.at == 1002.0 && last.placement.position_m.distance(DVec3::new(1.0, 0.7, 0.0)) < 1e-12);
        // A quarter turn about x: from down to ahead.
        let ahead = last.placement.rotation * DVec3::NEG_Z;
        assert!((ahead - DVec3::Y).length() < 1e-9, "{ahead}");
        assert_eq!(camera.warnings, ["the first of 2 cameras is read: cam"]);
    }

    #[test]
    fn camera_at_rest_covers_the_layers_time_codes() {
        let text = "#usda 1.0\n(\n startTimeCode = 1\n endTimeCode = 90\n)\ndef Camera \"c\" {}";
        let camera = parse(text).unwrap();
        assert_eq!(camera.keyframes.iter().map(|key| key.at).collect::<Vec<_>>(), [1.0, 90.0]);
        assert_eq!(camera.keyframes[0].placement.rotation, DQuat::IDENTITY);
    }

    #[test]
    fn layers_without_a_usable_camera_are_refused() {
        let order = "uniform token[] xformOpOrder";
        for (text, expected) in [
            ("#usda 1.0\ndef Xform \"a\" {}".to_owned(), "has no prim of type Camera"),
            ("#usda 1.0\ndef Camera \"a\" {}".to_owned(), "the camera a has no time samples"),
            (
                format!("#usda 1.0\ndef Camera \"a\" {{ {order} = [\"xformOp:scale\"] }}"),
                "xformOpOrder names xformOp:scale",
            ),
            (LAYER.replace("(0, 70, 0)", "(0, 70)"), "xformOp:translate has a value that is not 3 numbers"),
            (LAYER.replace("0.01", "0"), "metersPerUnit is not"),
        ] {
            let (_, problem) = parse(&text).unwrap_err();
            assert!(problem.starts_with(expected), "{problem}");
        }
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.usd");
        std::fs::write(&file, b"PXR-USDC\0\x08").unwrap();
        let error = read(&file).unwrap_err().to_string();
        assert!(error.contains("a.usd, line 1: is USD in binary form; convert it to text: usdcat"), "{error}");
    }
}
