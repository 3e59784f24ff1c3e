//! COLMAP's camera models: numbers, names and parameters, and the geometry of a camera. Pixel
//! centres are at +0.5. Source: <https://colmap.github.io/cameras.html>, `sensor/models.h` there.
//!
//! To add a model: its parameters in [`CAMERA_MODELS`], with Locard's names.

use crate::camera::LensModel::{Opencv, OpencvRational};
use crate::camera::{Geometry, LensModel};
use crate::params::{Params, Value};
use crate::recording::parts::geometry_from;
use crate::text::quoted;

/// Advice for unsupported models.
const UNDISTORT_ADVICE: &str = "make pictures without distortion: colmap image_undistorter --image_path IMAGES \
                                --input_path sparse/0 --output_path NEW";

/// A camera model of COLMAP.
#[derive(Debug)]
pub struct ColmapCameraModel {
    pub name: &'static str,
    projection: ModelLens,
}

/// The projection of a camera model.
#[derive(Debug)]
enum ModelLens {
    /// A lens model with its parameters in COLMAP's order. `f` sets both focal lengths.
    Lens(LensModel, &'static [&'static str]),
    Unsupported,
}

use ModelLens::{Lens, Unsupported};

const fn model(name: &'static str, projection: ModelLens) -> ColmapCameraModel {
    ColmapCameraModel { name, projection }
}

/// All models; a model's index is its number in binary files.
static CAMERA_MODELS: [ColmapCameraModel; 18] = [
    model("SIMPLE_PINHOLE", Lens(LensModel::Opencv, &["f", "cx_px", "cy_px"])),
    model("PINHOLE", Lens(LensModel::Opencv, &["fx_px", "fy_px", "cx_px", "cy_px"])),
    model("SIMPLE_RADIAL", Lens(LensModel::Opencv, &["f", "cx_px", "cy_px", "k1"])),
    model("RADIAL", Lens(LensModel::Opencv, &["f", "cx_px", "cy_px", "k1", "k2"])),
    model("OPENCV", Lens(LensModel::Opencv, &["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2"])),
    model(
        "OPENCV_FISHEYE",
        Lens(LensModel::OpencvFisheye, &["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "k3", "k4"]),
    ),
    model(
        "FULL_OPENCV",
        Lens(
            LensModel::OpencvRational,
            &["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
        ),
    ),
    model("FOV", Lens(LensModel::Fov, &["fx_px", "fy_px", "cx_px", "cy_px", "omega"])),
    model("SIMPLE_RADIAL_FISHEYE", Lens(LensModel::OpencvFisheye, &["f", "cx_px", "cy_px", "k1"])),
    model("RADIAL_FISHEYE", Lens(LensModel::OpencvFisheye, &["f", "cx_px", "cy_px", "k1", "k2"])),
    model(
        "THIN_PRISM_FISHEYE",
        Lens(
            LensModel::ThinPrismFisheye,
            &["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"],
        ),
    ),
    model("RAD_TAN_THIN_PRISM_FISHEYE", Unsupported),
    model("SIMPLE_DIVISION", Unsupported),
    model("DIVISION", Unsupported),
    model("SIMPLE_FISHEYE", Lens(LensModel::OpencvFisheye, &["f", "cx_px", "cy_px"])),
    model("FISHEYE", Lens(LensModel::OpencvFisheye, &["fx_px", "fy_px", "cx_px", "cy_px"])),
    model("EUCM", Unsupported),
    model("EQUIRECTANGULAR", Unsupported),
];

impl ColmapCameraModel {
    /// The supported model of a name.
    pub fn named(name: &str) -> Result<&'static Self, String> {
        let model = CAMERA_MODELS.iter().find(|model| model.name == name);
        model.filter(|model| model.is_supported()).ok_or_else(|| refusal(name))
    }

    /// The supported model of a number in a binary file.
    pub fn numbered(number: i32) -> Result<&'static Self, String> {
        let Some(model) = usize::try_from(number).ok().and_then(|index| CAMERA_MODELS.get(index)) else {
            let last = CAMERA_MODELS.len() - 1;
            return Err(format!(
                "the camera model has the number {number}; expected 0 to {last}: the file is damaged, or of a newer \
                 COLMAP; export the model as text: colmap model_converter --output_type TXT"
            ));
        };
        if model.is_supported() { Ok(model) } else { Err(refusal(model.name)) }
    }

    fn is_supported(&self) -> bool {
        matches!(self.projection, Lens(..))
    }

    /// The names of the parameters in COLMAP's order.
    pub fn parameters(&self) -> &'static [&'static str] {
        match self.projection {
            Lens(_, parameters) => parameters,
            Unsupported => &[],
        }
    }

    /// The geometry of a camera with `parameters` in COLMAP's order.
    pub fn geometry(&self, size_px: [f64; 2], parameters: &[f64]) -> Result<Geometry, String> {
        let Lens(lens, names) = self.projection else { return Err(refusal(self.name)) };
        let mut values = vec![("width_px", size_px[0]), ("height_px", size_px[1])];
        for (name, value) in names.iter().copied().zip(parameters.iter().copied()) {
            match name {
                "f" => values.extend([("fx_px", value), ("fy_px", value)]),
                name => values.push((name, value)),
            }
        }
        // Without a denominator it is the polynomial, which is faster.
        let has_denominator = values.iter().any(|(name, value)| matches!(*name, "k4" | "k5" | "k6") && *value != 0.0);
        let lens = if lens == LensModel::OpencvRational && !has_denominator { LensModel::Opencv } else { lens };
        geometry_from(lens, &values).map_err(|e| e.to_string())
    }
}

/// The model and parameters of a camera. `None` if COLMAP has no such lens.
pub fn camera_parameters(geometry: &Geometry) -> Option<(&'static str, Vec<f64>)> {
    let Geometry { intrinsics, distortion, .. } = geometry;
    let coefficient = |name: &str| match distortion.get(name) {
        Some(Value::Number(value)) => Some(value),
        _ => None,
    };
    let used: Vec<_> = distortion.specs().into_iter().map(|spec| spec.name).collect();
    let used: Vec<_> = used.into_iter().filter(|name| coefficient(name).is_some_and(|value| value != 0.0)).collect();
    // FULL_OPENCV without a denominator is the polynomial with k3.
    let is_same = |lens| lens == distortion.model || (lens, distortion.model) == (OpencvRational, Opencv);
    CAMERA_MODELS.iter().find_map(|model| {
        let Lens(lens, names) = model.projection else { return None };
        let is_complete = !names.contains(&"f") && used.iter().all(|name| names.contains(name));
        let value = |name: &&str| match intrinsics.get(name) {
            Some(Value::Number(value)) => Some(value),
            _ => coefficient(name),
        };
        (is_same(lens) && is_complete).then(|| Some((model.name, names.iter().map(value).collect::<Option<_>>()?)))?
    })
}

fn refusal(name: &str) -> String {
    let supported: Vec<&str> =
        CAMERA_MODELS.iter().filter(|model| model.is_supported()).map(|model| model.name).collect();
    format!(
        "the camera model `{}` is not supported; expected {}; {UNDISTORT_ADVICE}",
        quoted(name),
        supported.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Intrinsics};

    #[test]
    fn camera_and_its_parameters_are_the_same_camera() {
        let intrinsics = Intrinsics { fx_px: 500.0, fy_px: 510.0, cx_px: 320.0, cy_px: 241.0, ..Intrinsics::default() };
        let lens = |model, k3: f64, k4: f64| {
            let distortion = Distortion { model, k1: 0.1, k2: -0.05, k3, k4, ..Distortion::default() };
            Geometry::new(intrinsics.clone(), distortion)
        };
        for (geometry, name) in [
            (Geometry::new(intrinsics.clone(), Distortion::default()), "PINHOLE"),
            (lens(Opencv, 0.0, 0.0), "OPENCV"),
            (lens(Opencv, 0.02, 0.0), "FULL_OPENCV"),
            (lens(OpencvRational, 0.02, 0.03), "FULL_OPENCV"),
            (lens(LensModel::OpencvFisheye, 0.02, 0.03), "OPENCV_FISHEYE"),
        ] {
            let (model, parameters) = camera_parameters(&geometry).unwrap();
            assert_eq!(model, name);
            let size = [f64::from(intrinsics.width_px), f64::from(intrinsics.height_px)];
            let read = ColmapCameraModel::named(name).unwrap().geometry(size, &parameters).unwrap();
            assert_eq!(read, geometry);
        }
        assert!(camera_parameters(&lens(LensModel::Equirectangular, 0.0, 0.0)).is_none());
    }
}
