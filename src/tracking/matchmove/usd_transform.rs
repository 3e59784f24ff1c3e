//! The transform of a USD prim over time, from its `xformOp` attributes. Matrices are written row
//! by row for row vectors: the last row is the translation. Source: OpenUSD, `UsdGeomXformOp`.

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::keyframes::{KeyframeSamples, lerp, slerp};
use super::usd_text::{UsdPrim, UsdProperty, UsdTextError, UsdValue};

/// One operation with its value over time.
#[derive(Clone, Debug)]
enum TransformOp {
    Translate(KeyframeSamples<DVec3>),
    Scale(KeyframeSamples<DVec3>),
    Orient(KeyframeSamples<DQuat>),
    /// Angles in degrees, and the axes in the order of application.
    Rotate(KeyframeSamples<DVec3>, [usize; 3]),
    Matrix(KeyframeSamples<DMat4>),
}

/// The operations of a prim, the outermost first.
#[derive(Clone, Debug, Default)]
pub struct PrimTransform {
    ops: Vec<TransformOp>,
    /// The transforms of the parents have no effect.
    pub resets_parents: bool,
}

impl PrimTransform {
    pub fn of(prim: &UsdPrim) -> Result<Self, UsdTextError> {
        let mut transform = Self::default();
        let Some(order) = prim.property("xformOpOrder") else { return Ok(transform) };
        let Some(UsdValue::List(names)) = &order.value else { return Ok(transform) };
        for name in names {
            let UsdValue::Text(name) = name else {
                return Err((order.line, "xformOpOrder has an entry that is no name".to_owned()));
            };
            if name == "!resetXformStack!" {
                transform = Self { ops: Vec::new(), resets_parents: true };
                continue;
            }
            let property = prim.property(name.trim_start_matches("!invert!")).ok_or_else(|| {
                (
                    order.line,
                    format!("xformOpOrder names {}, and there is no such attribute", crate::text::quoted(name)),
                )
            })?;
            if name.starts_with("!invert!") {
                let problem = "inverted operations are not read; flatten the transform to `xformOp:transform`";
                return Err((order.line, problem.to_owned()));
            }
            transform.ops.push(op(property)?);
        }
        Ok(transform)
    }

    /// Times of all samples.
    pub fn times(&self) -> Vec<f64> {
        self.ops
            .iter()
            .flat_map(|op| match op {
                TransformOp::Translate(samples) | TransformOp::Scale(samples) | TransformOp::Rotate(samples, _) => {
                    samples.times().collect::<Vec<_>>()
                }
                TransformOp::Orient(samples) => samples.times().collect(),
                TransformOp::Matrix(samples) => samples.times().collect(),
            })
            .collect()
    }

    /// `parent_from_prim` at a time code.
    pub fn at(&self, time: f64) -> DAffine3 {
        let matrix = |op: &TransformOp| match op {
            TransformOp::Translate(samples) => {
                DAffine3::from_translation(samples.at(time, lerp).unwrap_or(DVec3::ZERO))
            }
            TransformOp::Scale(samples) => DAffine3::from_scale(samples.at(time, lerp).unwrap_or(DVec3::ONE)),
            TransformOp::Orient(samples) => {
                DAffine3::from_quat(samples.at(time, slerp).unwrap_or(DQuat::IDENTITY).normalize())
            }
            TransformOp::Rotate(samples, order) => {
                let angles = samples.at(time, lerp).unwrap_or(DVec3::ZERO);
                let rotation = order.iter().fold(DQuat::IDENTITY, |before, axis| about(*axis, angles) * before);
                DAffine3::from_quat(rotation)
            }
            TransformOp::Matrix(samples) => {
                let interpolate = |a: DMat4, b: DMat4, fraction: f64| a * (1.0 - fraction) + b * fraction;
                DAffine3::from_mat4(samples.at(time, interpolate).unwrap_or(DMat4::IDENTITY))
            }
        };
        self.ops.iter().map(matrix).fold(DAffine3::IDENTITY, |outer, inner| outer * inner)
    }
}

fn about(axis: usize, angles_deg: DVec3) -> DQuat {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    DQuat::from_axis_angle(axes[axis], angles_deg[axis].to_radians())
}

/// The values of a property as `N` numbers each.
fn samples<const N: usize, T>(
    property: &UsdProperty,
    convert: impl Fn([f64; N]) -> T,
) -> Result<KeyframeSamples<T>, UsdTextError> {
    let refuse =
        || (property.line, format!("{} has a value that is not {N} numbers", crate::text::quoted(&property.name)));
    let convert = |value: &UsdValue| -> Result<T, UsdTextError> {
        let numbers = value.numbers().filter(|numbers| numbers.iter().all(|n| n.is_finite())).ok_or_else(refuse)?;
        Ok(convert(numbers.try_into().map_err(|_| refuse())?))
    };
    let keys = match (&property.samples, &property.value) {
        (Some(samples), _) if !samples.is_empty() => {
            samples.iter().map(|(time, value)| Ok((*time, convert(value)?))).collect::<Result<_, UsdTextError>>()?
        }
        (_, Some(value)) => return Ok(KeyframeSamples::constant(convert(value)?)),
        _ => Vec::new(),
    };
    Ok(KeyframeSamples { keys, is_stepped: false })
}

fn op(property: &UsdProperty) -> Result<TransformOp, UsdTextError> {
    let kind = property.name.strip_prefix("xformOp:").unwrap_or(&property.name);
    let kind = kind.split(':').next().unwrap_or(kind);
    let axis_of = |letter: char| "XYZ".find(letter);
    Ok(match kind {
        "translate" => TransformOp::Translate(samples(property, DVec3::from_array)?),
        "scale" => TransformOp::Scale(samples(property, DVec3::from_array)?),
        "orient" => TransformOp::Orient(samples(property, |[w, x, y, z]| DQuat::from_xyzw(x, y, z, w))?),
        "transform" => TransformOp::Matrix(samples(property, |m: [f64; 16]| DMat4::from_cols_array(&m))?),
        "rotateX" | "rotateY" | "rotateZ" => {
            let axis = kind.chars().last().and_then(axis_of).unwrap_or_default();
            let angles = samples(property, move |[angle]: [f64; 1]| {
                let mut angles = DVec3::ZERO;
                angles[axis] = angle;
                angles
            })?;
            // The angles about the two other axes are 0.
            TransformOp::Rotate(angles, [0, 1, 2])
        }
        "rotateXYZ" | "rotateXZY" | "rotateYXZ" | "rotateYZX" | "rotateZXY" | "rotateZYX" => {
            let axes: Vec<usize> = kind["rotate".len()..].chars().filter_map(axis_of).collect();
            let order = axes.try_into().unwrap_or([0, 1, 2]);
            TransformOp::Rotate(samples(property, DVec3::from_array)?, order)
        }
        other => {
            let problem = format!(
                "the operation {} is not read; expected translate, rotate, orient, scale or transform",
                crate::text::quoted(other)
            );
            return Err((property.line, problem));
        }
    })
}

#[cfg(test)]
mod tests {
    use super::super::usd_text::parse;
    use super::*;

    fn at(body: &str, time: f64) -> DAffine3 {
        let layer = parse(&format!("#usda 1.0\ndef \"a\" {{ {body} }}")).unwrap();
        PrimTransform::of(&layer.prims[0]).unwrap().at(time)
    }

    #[test]
    fn operations_match_hand_calculation() {
        let translate = "double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 3: (4, 0, 0) }";
        let rotate = "float3 xformOp:rotateZXY = (0, 90, 90)";
        let order = "uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:rotateZXY\"]";
        let placed = at(&format!("{translate}\n{rotate}\n{order}"), 2.0);
        // About z first: x becomes y. About y then: y stays.
        assert!(placed.transform_point3(DVec3::X).distance(DVec3::new(2.0, 1.0, 0.0)) < 1e-12);
        // About z first: y becomes −x. About y then: −x becomes z.
        assert!(placed.transform_point3(DVec3::Y).distance(DVec3::new(2.0, 0.0, 1.0)) < 1e-12);
        let single = at("double xformOp:rotateX = 90\nuniform token[] xformOpOrder = [\"xformOp:rotateX\"]", 0.0);
        assert!(single.transform_point3(DVec3::Y).distance(DVec3::Z) < 1e-12);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let orient = format!(
            "quatd xformOp:orient = ({half}, 0, 0, {half})\nuniform token[] xformOpOrder = [\"xformOp:orient\"]"
        );
        assert!(at(&orient, 0.0).transform_point3(DVec3::X).distance(DVec3::Y) < 1e-12);
        let matrix = "matrix4d xformOp:transform = ((0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (5, 6, 7, 1))\n\
                      uniform token[] xformOpOrder = [\"!resetXformStack!\", \"xformOp:transform\"]";
        assert!(at(matrix, 0.0).transform_point3(DVec3::X).distance(DVec3::new(5.0, 7.0, 7.0)) < 1e-12);
        assert_eq!(at("double xformOp:rotateX = 90", 0.0), DAffine3::IDENTITY, "an operation outside the order");
    }
}
