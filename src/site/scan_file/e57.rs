//! E57: scans of laser scanners (ASTM E2807-11, *Standard Specification for 3D Imaging Data
//! Exchange*). Lengths are metres, angles radians; every page of 1024 bytes has a checksum.
//!
//! All scans of a file are read, each with its pose: p = R(q) s + t. By convention +Z is up.
//! Pictures and attributes other than positions are ignored.

use e57::{PointCloud, RecordDataType, RecordName, RecordValue};
use glam::{DQuat, DVec3};

use super::geometry_builder::GeometryBuilder;
use super::input::ScanReader;
use super::{ScanError, ScanGeometry};
use crate::text::quoted;

const REMEDY: &str =
    "the file is damaged or cut off: copy it again, or export it again from the program that registered the scans";
/// The most by which the length of a pose's quaternion may differ from 1 without a warning.
const QUATERNION_TOLERANCE: f64 = 1e-3;

pub(super) fn read(mut input: ScanReader<'_>) -> Result<ScanGeometry, ScanError> {
    input.seek(0)?;
    let (file, length) = (input.file, input.length());
    let damaged = |location: &str, error: e57::Error| ScanError::content(file, location, format!("{error}; {REMEDY}"));
    // Pages are read whole and in order, so that a buffer would only copy them.
    let mut reader = e57::E57Reader::new(input.into_reader().into_inner()).map_err(|error| damaged("header", error))?;
    let scans = reader.pointclouds();
    let mut builder = GeometryBuilder::default();
    for (n, scan) in scans.iter().enumerate().filter(|(_, scan)| scan.records > 0) {
        let name = scan.name.as_deref().map(|name| format!(" `{}`", quoted(name))).unwrap_or_default();
        let location = format!("scan {} of {}{name}", n + 1, scans.len());
        let invalid = |problem: String| ScanError::content(file, &location, problem);
        let layout = PointLayout::of(scan).map_err(invalid)?;
        let pose = ScanPose::of(scan, &location, &mut builder.warnings).map_err(invalid)?;
        let bits = point_bits(scan);
        if bits == 0 {
            // The decoder would not end: it could make any number of points of no data.
            return Err(invalid(format!("its points are all equal and take no space; {REMEDY}")));
        }
        builder.reserve(scan.records, length.saturating_mul(8) / bits);
        let points = reader.pointcloud_raw(scan).map_err(|error| damaged(&location, error))?;
        for point in points {
            let values = point.map_err(|error| damaged(&location, error))?;
            if let Some(position) = layout.position(&values) {
                builder.push(pose.rotation * position + pose.translation);
            }
        }
    }
    let geometry = builder.finish(file)?;
    Ok(ScanGeometry { metres_per_unit: Some(1.0), up: Some(DVec3::Z), ..geometry })
}

/// Placement of a scan in the file's axes.
struct ScanPose {
    rotation: DQuat,
    translation: DVec3,
}

impl ScanPose {
    fn of(scan: &PointCloud, location: &str, warnings: &mut Vec<String>) -> Result<Self, String> {
        let Some(pose) = &scan.transform else {
            return Ok(Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO });
        };
        let (turn, shift) = (&pose.rotation, &pose.translation);
        let rotation = DQuat::from_xyzw(turn.x, turn.y, turn.z, turn.w);
        let translation = DVec3::new(shift.x, shift.y, shift.z);
        let length = rotation.length();
        if !(translation.is_finite() && length.is_finite() && length > 0.0) {
            return Err(format!("its pose is not a rotation and a shift of finite numbers; {REMEDY}"));
        }
        if (length - 1.0).abs() > QUATERNION_TOLERANCE {
            warnings.push(format!("{location}: the quaternion of its pose has length {length:.4} and was normalized"));
        }
        Ok(Self { rotation: rotation.normalize(), translation })
    }
}

/// Bits of a point in the file.
fn point_bits(scan: &PointCloud) -> u64 {
    let bits = |record: &e57::Record| match record.data_type {
        RecordDataType::Single { .. } => 32,
        RecordDataType::Double { .. } => 64,
        RecordDataType::ScaledInteger { min, max, .. } | RecordDataType::Integer { min, max } => {
            u64::from(i64::BITS - max.wrapping_sub(min).leading_zeros())
        }
    };
    scan.prototype.iter().map(bits).sum()
}

/// A column of the raw values.
struct Column<'a> {
    index: usize,
    data_type: &'a RecordDataType,
}

impl Column<'_> {
    #[inline]
    fn value(&self, values: &[RecordValue]) -> f64 {
        let scaled = |value: i64| match self.data_type {
            RecordDataType::ScaledInteger { scale, offset, .. } => value as f64 * scale + offset,
            _ => value as f64,
        };
        match values.get(self.index) {
            Some(RecordValue::Single(value)) => f64::from(*value),
            Some(RecordValue::Double(value)) => *value,
            Some(RecordValue::ScaledInteger(value) | RecordValue::Integer(value)) => scaled(*value),
            None => f64::NAN,
        }
    }
}

/// Three coordinates and their state: 0 is valid; 1 is a direction without a range, 2 invalid.
struct Coordinates<'a> {
    columns: [Column<'a>; 3],
    invalid_state: Option<Column<'a>>,
}

impl<'a> Coordinates<'a> {
    fn of(scan: &'a PointCloud, names: [RecordName; 3], invalid_state: &RecordName) -> Option<Self> {
        let column = |name: &RecordName| {
            let index = scan.prototype.iter().position(|record| record.name == *name)?;
            Some(Column { index, data_type: &scan.prototype[index].data_type })
        };
        let [a, b, c] = names.each_ref().map(column);
        Some(Self { columns: [a?, b?, c?], invalid_state: column(invalid_state) })
    }

    #[inline]
    fn valid(&self, values: &[RecordValue]) -> Option<DVec3> {
        let is_valid = self.invalid_state.as_ref().is_none_or(|state| state.value(values) == 0.0);
        is_valid.then(|| DVec3::from_array(self.columns.each_ref().map(|column| column.value(values))))
    }
}

/// The columns of a scan's positions. A point may have both kinds of coordinates.
struct PointLayout<'a> {
    cartesian: Option<Coordinates<'a>>,
    /// Range, azimuth from +X towards +Y, elevation over the XY plane.
    spherical: Option<Coordinates<'a>>,
}

impl<'a> PointLayout<'a> {
    fn of(scan: &'a PointCloud) -> Result<Self, String> {
        use RecordName::{
            CartesianInvalidState, CartesianX, CartesianY, CartesianZ, SphericalAzimuth, SphericalElevation,
            SphericalInvalidState, SphericalRange,
        };
        let cartesian = Coordinates::of(scan, [CartesianX, CartesianY, CartesianZ], &CartesianInvalidState);
        let spherical =
            Coordinates::of(scan, [SphericalRange, SphericalAzimuth, SphericalElevation], &SphericalInvalidState);
        if cartesian.is_none() && spherical.is_none() {
            return Err(
                "its points have neither Cartesian nor spherical coordinates; export it again with them".to_owned()
            );
        }
        Ok(Self { cartesian, spherical })
    }

    /// The position in the scanner's axes, m, if it is valid.
    #[inline]
    fn position(&self, values: &[RecordValue]) -> Option<DVec3> {
        let spherical = || self.spherical.as_ref()?.valid(values).map(cartesian_of_spherical);
        self.cartesian.as_ref().and_then(|cartesian| cartesian.valid(values)).or_else(spherical)
    }
}

fn cartesian_of_spherical(coordinates: DVec3) -> DVec3 {
    let [range, azimuth, elevation] = coordinates.to_array();
    let (sin_azimuth, cos_azimuth) = azimuth.sin_cos();
    let (sin_elevation, cos_elevation) = elevation.sin_cos();
    range * DVec3::new(cos_elevation * cos_azimuth, cos_elevation * sin_azimuth, sin_elevation)
}

#[cfg(test)]
mod tests {
    use super::super::test_data::{read_bytes, refusal};
    use e57::{Quaternion, Record, Transform, Translation};
    use glam::Vec3;
    use std::f64::consts::{FRAC_1_SQRT_2, PI};
    use std::io::Cursor;

    use super::*;
    use RecordValue::{Double, Integer};

    const DOUBLE: RecordDataType = RecordDataType::Double { min: None, max: None };
    const STATE: RecordDataType = RecordDataType::Integer { min: 0, max: 2 };

    struct WrittenScan {
        columns: Vec<(RecordName, RecordDataType)>,
        points: Vec<Vec<RecordValue>>,
        pose: Option<Transform>,
    }

    fn written(scans: Vec<WrittenScan>) -> Vec<u8> {
        written_with(scans, |xml| xml)
    }

    /// A file with an edited XML section.
    fn written_with(scans: Vec<WrittenScan>, change: impl Fn(String) -> String) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        let mut writer = e57::E57Writer::new(&mut file, "file").unwrap();
        for scan in scans {
            let columns = scan.columns.into_iter().map(|(name, data_type)| Record { name, data_type }).collect();
            let mut points = writer.add_pointcloud("id", columns).unwrap();
            points.set_name(Some("scan".to_owned()));
            points.set_transform(scan.pose);
            scan.points.into_iter().for_each(|point| points.add_point(point).unwrap());
            points.finalize().unwrap();
        }
        writer.finalize_customized_xml(|xml| Ok(change(xml))).unwrap();
        drop(writer);
        file.into_inner()
    }

    fn cartesian_columns() -> Vec<(RecordName, RecordDataType)> {
        vec![
            (RecordName::CartesianX, DOUBLE),
            (RecordName::CartesianY, DOUBLE),
            (RecordName::CartesianZ, DOUBLE),
            (RecordName::CartesianInvalidState, STATE),
        ]
    }

    fn two_scans() -> Vec<u8> {
        let point = |x, y, z, state| vec![Double(x), Double(y), Double(z), Integer(state)];
        // A quarter turn about z.
        let rotation = Quaternion { w: FRAC_1_SQRT_2, x: 0.0, y: 0.0, z: FRAC_1_SQRT_2 };
        let pose = Transform { rotation, translation: Translation { x: 10.0, y: 20.0, z: 30.0 } };
        let spherical = vec![
            (RecordName::SphericalRange, DOUBLE),
            (RecordName::SphericalAzimuth, DOUBLE),
            (RecordName::SphericalElevation, DOUBLE),
        ];
        let ranges = vec![
            vec![Double(2.0), Double(PI / 2.0), Double(0.0)],
            vec![Double(3.0), Double(0.3), Double(-PI / 2.0)],
            vec![Double(f64::NAN), Double(0.3), Double(0.1)],
        ];
        written(vec![
            WrittenScan {
                columns: cartesian_columns(),
                points: vec![point(1.0, 2.0, 3.0, 0), point(1.0, 0.0, 0.0, 1), point(0.0, 0.0, 0.0, 2)],
                pose: Some(pose),
            },
            WrittenScan { columns: spherical, points: ranges, pose: None },
        ])
    }

    #[test]
    fn scans_are_placed_by_their_poses_and_invalid_points_left_out() {
        let read = read_bytes("a.e57", &two_scans()).unwrap();
        let expected = [Vec3::new(8.0, 21.0, 33.0), Vec3::new(0.0, 2.0, 0.0), Vec3::new(0.0, 0.0, -3.0)];
        assert_eq!(read.positions.len(), expected.len());
        for (expected, read) in expected.iter().zip(&read.positions) {
            assert!(expected.distance(*read) < 1e-6, "{read}");
        }
        assert_eq!((read.metres_per_unit, read.up), (Some(1.0), Some(DVec3::Z)));
        assert_eq!(read.warnings, ["dropped 1 of 4 points, whose coordinates are not finite"]);
    }

    #[test]
    fn one_point_is_a_scan_and_none_is_not() {
        let one = |points| WrittenScan { columns: cartesian_columns(), points, pose: None };
        let point = vec![Double(1.0), Double(2.0), Double(3.0), Integer(0)];
        let read = read_bytes("a.e57", &written(vec![one(vec![point])])).unwrap();
        assert_eq!(read.positions, [Vec3::new(1.0, 2.0, 3.0)]);
        for scans in [vec![], vec![one(vec![])]] {
            assert!(refusal("a.e57", &written(scans)).contains("it holds no points"));
        }
    }

    #[test]
    fn damaged_and_cut_files_are_refused() {
        let whole = two_scans();
        let mut flipped = whole.clone();
        flipped[100] ^= 1;
        let error = refusal("a.e57", &flipped);
        assert!(error.contains("invalid checksum") && error.contains("export it again"), "{error}");
        for length in [8, 40, 48, 1000, whole.len() - 1, whole.len() - 1024] {
            let error = refusal("a.e57", &whole[..length]);
            assert!(error.contains("the file is damaged or cut off"), "{length}: {error}");
        }
    }

    #[test]
    fn points_that_take_no_space_are_refused() {
        let narrow = RecordDataType::Integer { min: 4, max: 5 };
        let columns = cartesian_columns().into_iter().take(3).map(|(name, _)| (name, narrow.clone())).collect();
        let scan = WrittenScan { columns, points: vec![vec![Integer(4); 3]], pose: None };
        let file = written_with(vec![scan], |xml| xml.replace(r#"maximum="5""#, r#"maximum="4""#));
        let error = refusal("a.e57", &file);
        assert!(error.starts_with("a.e57, scan 1 of 1 `scan`: its points are all equal and take no space"), "{error}");
    }
}
