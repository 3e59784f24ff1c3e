//! A list of cameras by time: each frame's lens as reported by a tracking system.

use std::path::Path;

use crate::camera::exposure::MAX_EXPOSURE_S;
use crate::camera::{CameraExposure, Geometry, Lens, LensModel};
use crate::frame::FrameLens;
use crate::params::{Params, Value};
use crate::text::number;
use crate::tracking::records::{self, TextError};

use super::frame_camera::FrameCamera;
use super::parts::geometry_from;

/// The columns of a geometry, named as in a profile.
const GEOMETRY: [&str; 12] =
    ["width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px", "film_width_mm", "k1", "k2", "p1", "p2", "k3"];
/// The columns of the lens.
const LENS: [&str; 4] = ["f_number", "focus_distance_m", "exposure_s", "iso"];
/// Placeholder of an unknown value.
const UNKNOWN: &str = "-";

/// True if the list can represent a geometry.
pub fn is_representable(geometry: &Geometry) -> bool {
    geometry.distortion.model == LensModel::Opencv && geometry.distortion.k4 == 0.0
}

/// Cameras by time as text. [`parse_cameras`] reads them back bit for bit, except for the readout
/// time. Geometries that are not [representable](is_representable) are left out.
pub fn write_cameras<'a>(entries: impl IntoIterator<Item = (f64, &'a FrameCamera)>) -> String {
    let head = format!("# timestamp {} {}\n", GEOMETRY.join(" "), LENS.join(" "));
    entries.into_iter().fold(head, |text, (time_s, FrameCamera { geometry, lens })| {
        let geometry = geometry.as_ref().filter(|geometry| is_representable(geometry));
        let of_geometry = |name: &&str| {
            let geometry = geometry?;
            match geometry.intrinsics.get(name).or_else(|| geometry.distortion.get(name))? {
                Value::Number(value) => Some(value),
                _ => None,
            }
        };
        let values = GEOMETRY.iter().map(of_geometry);
        let values = values.chain([lens.f_number, lens.focus_distance_m, lens.exposure_s, lens.iso]);
        let words: Vec<String> = values.map(|value| value.map_or_else(|| UNKNOWN.to_owned(), number)).collect();
        text + &format!("{} {}\n", number(time_s), words.join(" "))
    })
}

/// Parses a list of cameras: `timestamp`, the geometry's twelve numbers, or twelve times `-`, and
/// the lens's four, each of which may be `-`. Times ascend.
pub fn parse_cameras(text: &str, list: &Path) -> Result<Vec<(f64, FrameCamera)>, TextError> {
    super::listing::by_time(text, list, |mut rest| {
        let mut value = |name: &str| match rest.trim_start().strip_prefix(UNKNOWN) {
            // Otherwise it is a minus sign.
            Some(after) if after.is_empty() || after.starts_with(char::is_whitespace) => {
                rest = after;
                Ok(None)
            }
            _ => records::number(&mut rest, name).map(Some),
        };
        let of_geometry: Vec<Option<f64>> = GEOMETRY.iter().map(|name| value(name)).collect::<Result<_, _>>()?;
        let mut of_lens = [None; 4];
        for (parameter, name) in of_lens.iter_mut().zip(LENS) {
            *parameter = value(name)?;
        }
        records::end(rest)?;
        let values: Vec<(&str, f64)> =
            GEOMETRY.into_iter().zip(&of_geometry).filter_map(|(name, value)| Some((name, (*value)?))).collect();
        let geometry = match values.len() {
            0 => None,
            _ if values.len() < GEOMETRY.len() => {
                return Err(format!("a part of the camera is `{UNKNOWN}`; expected all of {}", GEOMETRY.join(" ")));
            }
            _ => Some(geometry_from(LensModel::Opencv, &values).map_err(|error| error.to_string())?),
        };
        Ok(FrameCamera { geometry, lens: checked(of_lens)? })
    })
}

/// The lens's numbers, checked against the ranges of a profile.
fn checked([f_number, focus_distance_m, exposure_s, iso]: [Option<f64>; 4]) -> Result<FrameLens, String> {
    let (mut lens, mut exposure) = (Lens::default(), CameraExposure::default());
    let set = |table: &mut dyn Params, name: &str, value: Option<f64>| {
        value.map_or(Ok(()), |value| table.set(name, &Value::Number(value)).map_err(|error| error.to_string()))
    };
    set(&mut lens, "f_number", f_number)?;
    set(&mut lens, "focus_distance_m", focus_distance_m)?;
    set(&mut exposure, "iso", iso)?;
    match exposure_s {
        Some(s) if !(s > 0.0 && s <= MAX_EXPOSURE_S) => {
            Err(format!("exposure_s is {}; expected above 0, at most {MAX_EXPOSURE_S}", number(s)))
        }
        _ => Ok(FrameLens { f_number, focus_distance_m, exposure_s, iso }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Intrinsics};
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<Vec<(f64, FrameCamera)>, String> {
        parse_cameras(text, Path::new("cameras.txt")).map_err(|error| error.to_string())
    }

    #[test]
    fn errors_name_the_line() {
        let camera = "640 480 500 501 320 240 36 0.1 0 0 0 0";
        assert_eq!(parse(&format!("1 {camera} - - - -\n")).unwrap()[0].1.lens, FrameLens::default());
        for (text, said) in [
            (format!("1 {camera} - - -\n"), "iso"),
            (format!("1 {camera} - - - - 5\n"), "line 1"),
            ("1 640 480 500 501 320 - 36 0 0 0 0 0 - - - -\n".to_owned(), "a part of the camera is `-`"),
            (format!("1 {camera} 0 - - -\n"), "f_number"),
            (format!("1 {camera} - - 61 -\n"), "expected above 0, at most 60"),
            (format!("1 {camera} - - - -\n0 {camera} - - - -\n"), "line 2"),
            ("1 0 480 500 501 320 240 36 0 0 0 0 0 - - - -\n".to_owned(), "width_px"),
        ] {
            let error = parse(&text).unwrap_err();
            assert!(error.contains(said) && error.starts_with("cameras.txt, line "), "{error}");
        }
    }

    proptest! {
        #[test]
        fn written_cameras_read_back_bit_for_bit(
            f in prop::array::uniform2(1.0f64..5e3), c in prop::array::uniform2(-500.0f64..900.0), film in 1.0f64..50.0,
            k in prop::array::uniform5(-0.5f64..0.5), lens in prop::array::uniform4(prop::option::of(1.0f64..60.0)),
            is_known in any::<bool>(),
        ) {
            let intrinsics = Intrinsics {
                fx_px: f[0], fy_px: f[1], cx_px: c[0], cy_px: c[1], film_width_mm: film, ..Intrinsics::default()
            };
            let distortion = Distortion { k1: k[0], k2: k[1], k3: k[2], p1: k[3], p2: k[4], ..Distortion::default() };
            let [f_number, focus_distance_m, exposure_s, iso] = lens;
            let camera = FrameCamera {
                geometry: is_known.then(|| Geometry::new(intrinsics, distortion)),
                lens: FrameLens { f_number, focus_distance_m, exposure_s, iso },
            };
            let text = write_cameras([(0.1, &camera), (0.3, &FrameCamera::default())]);
            prop_assert_eq!(parse(&text).unwrap(), [(0.1, camera), (0.3, FrameCamera::default())]);
        }

        #[test]
        fn no_text_panics(text in "[-0-9e. \n]{0,200}") {
            let _ = parse(&text);
        }
    }
}
