//! PLY: polygons and points (Turk, *The PLY Polygon File Format*, 1994), as text and binary.
//!
//! The x, y and z of vertices, faces (as triangle fans) and triangle strips are read. The format
//! defines neither a unit nor an up. Colours, normals, range grids and materials are ignored.
//! Compressed Gaussian splats are refused.

use glam::DVec3;

use super::geometry_builder::GeometryBuilder;
use super::input::{ScanReader, number, words};
use super::ply_header::{PlyElement, PlyEncoding, PlyHeader, PlyScalar};
use super::{ScanError, ScanGeometry};
use crate::text::quoted;

const COORDINATES: [&str; 3] = ["x", "y", "z"];
/// Names of the list of a face's or a strip's vertices.
const VERTEX_LISTS: [&str; 2] = ["vertex_indices", "vertex_index"];
/// Ends a strip within the list of strips.
const STRIP_END: i64 = -1;
/// A property of every file of Gaussian splats.
const SPLAT_PROPERTY: &str = "f_dc_0";

pub(super) fn read(mut input: ScanReader<'_>) -> Result<ScanGeometry, ScanError> {
    let header = PlyHeader::read(&mut input)?;
    if !header.elements.iter().any(|element| element.name == "vertex") {
        return Err(ScanError::content(
            input.file,
            "header",
            "it has no `element vertex`; export it again with points",
        ));
    }
    let mut builder = GeometryBuilder::default();
    for element in &header.elements {
        let min_bytes = element.min_bytes(header.encoding);
        if min_bytes == 0 {
            continue;
        }
        input.check_count(element.count, min_bytes, &format!("records of `{}`", quoted(&element.name)))?;
        match header.encoding {
            PlyEncoding::Ascii => read_element(&mut AsciiValues::new(&mut input), element, &mut builder)?,
            PlyEncoding::LittleEndian => read_element(&mut BinaryValues::<false>(&mut input), element, &mut builder)?,
            PlyEncoding::BigEndian => read_element(&mut BinaryValues::<true>(&mut input), element, &mut builder)?,
        }
    }
    builder.finish(input.file)
}

/// Numbers of records in order.
trait Values {
    fn start_record(&mut self) -> Result<(), ScanError>;
    fn value(&mut self, scalar: PlyScalar) -> Result<f64, ScanError>;
    fn error(&self, problem: String) -> ScanError;
}

struct BinaryValues<'i, 'f, const BIG_ENDIAN: bool>(&'i mut ScanReader<'f>);

impl<const BIG_ENDIAN: bool> BinaryValues<'_, '_, BIG_ENDIAN> {
    #[inline]
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], ScanError> {
        let mut bytes = self.0.array("a value")?;
        if BIG_ENDIAN {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

impl<const BIG_ENDIAN: bool> Values for BinaryValues<'_, '_, BIG_ENDIAN> {
    fn start_record(&mut self) -> Result<(), ScanError> {
        Ok(())
    }

    #[inline]
    fn value(&mut self, scalar: PlyScalar) -> Result<f64, ScanError> {
        Ok(match scalar {
            PlyScalar::I8 => i8::from_le_bytes(self.bytes()?).into(),
            PlyScalar::U8 => u8::from_le_bytes(self.bytes()?).into(),
            PlyScalar::I16 => i16::from_le_bytes(self.bytes()?).into(),
            PlyScalar::U16 => u16::from_le_bytes(self.bytes()?).into(),
            PlyScalar::I32 => i32::from_le_bytes(self.bytes()?).into(),
            PlyScalar::U32 => u32::from_le_bytes(self.bytes()?).into(),
            PlyScalar::F32 => f32::from_le_bytes(self.bytes()?).into(),
            PlyScalar::F64 => f64::from_le_bytes(self.bytes()?),
        })
    }

    fn error(&self, problem: String) -> ScanError {
        self.0.byte_error(problem)
    }
}

/// A record of ASCII is a line.
struct AsciiValues<'i, 'f> {
    input: &'i mut ScanReader<'f>,
    line: Vec<u8>,
    /// Where the next word of the line is searched.
    at: usize,
}

impl<'i, 'f> AsciiValues<'i, 'f> {
    fn new(input: &'i mut ScanReader<'f>) -> Self {
        Self { input, line: Vec::new(), at: 0 }
    }
}

impl Values for AsciiValues<'_, '_> {
    fn start_record(&mut self) -> Result<(), ScanError> {
        self.at = 0;
        loop {
            if !self.input.next_line(&mut self.line)? {
                return Err(self.input.line_error("the next record is missing: the file is cut off".to_owned()));
            }
            if !self.line.trim_ascii().is_empty() {
                return Ok(());
            }
        }
    }

    #[inline]
    fn value(&mut self, _: PlyScalar) -> Result<f64, ScanError> {
        let rest = self.line[self.at..].trim_ascii_start();
        let Some(word) = words(rest).next() else {
            let problem =
                format!("it ends before the record's last value: `{}`", quoted(&String::from_utf8_lossy(&self.line)));
            return Err(self.error(problem));
        };
        self.at = self.line.len() - rest.len() + word.len();
        number(word).ok_or_else(|| self.error(format!("`{}` is not a number", quoted(&String::from_utf8_lossy(word)))))
    }

    fn error(&self, problem: String) -> ScanError {
        self.input.line_error(problem)
    }
}

fn read_element(
    values: &mut impl Values,
    element: &PlyElement,
    builder: &mut GeometryBuilder,
) -> Result<(), ScanError> {
    match element.name.as_str() {
        "vertex" => read_vertices(values, element, builder),
        "face" => read_lists(values, element, |values, corners| {
            let corners: Result<Vec<u32>, ScanError> = corners.iter().map(|corner| vertex(values, *corner)).collect();
            corners.map(|corners| builder.fan(&corners))
        }),
        "tristrips" => read_lists(values, element, |values, corners| {
            for strip in corners.split(|corner| *corner == STRIP_END) {
                let strip: Result<Vec<u32>, ScanError> = strip.iter().map(|corner| vertex(values, *corner)).collect();
                builder.strip(&strip?);
            }
            Ok(())
        }),
        _ => read_lists(values, element, |_, _| Ok(())),
    }
}

fn vertex(values: &impl Values, corner: i64) -> Result<u32, ScanError> {
    // The last number marks dropped vertices.
    let in_range = u32::try_from(corner).ok().filter(|corner| *corner < u32::MAX);
    in_range.ok_or_else(|| values.error(format!("a face refers to vertex {corner}; vertices count from 0")))
}

fn read_vertices(
    values: &mut impl Values,
    element: &PlyElement,
    builder: &mut GeometryBuilder,
) -> Result<(), ScanError> {
    let axis = |name: &str| COORDINATES.iter().position(|coordinate| *coordinate == name);
    // Axis of each property that is a coordinate.
    let axes: Vec<Option<usize>> =
        element.properties.iter().map(|p| axis(&p.name).filter(|_| p.length.is_none())).collect();
    if let Some(n) = (0..3).find(|n| !axes.contains(&Some(*n))) {
        let (missing, properties) = (COORDINATES[n], quoted(&element.property_names()));
        return Err(
            values.error(format!("the vertices have no coordinate `{missing}`; their properties are: {properties}"))
        );
    }
    if element.properties.iter().any(|property| property.name == SPLAT_PROPERTY) {
        let warning = "the file holds Gaussian splats; their centres are read as points and need not lie on surfaces";
        builder.warnings.push(warning.to_owned());
    }
    // The caller has checked that this number of elements fits into the file.
    builder.reserve(element.count, element.count);
    for _ in 0..element.count {
        values.start_record()?;
        let mut position = [0.0; 3];
        for (property, axis) in element.properties.iter().zip(&axes) {
            match (property.length, axis) {
                (Some(length), _) => skip_list(values, length, property.scalar)?,
                (None, Some(axis)) => position[*axis] = values.value(property.scalar)?,
                (None, None) => {
                    values.value(property.scalar)?;
                }
            }
        }
        builder.push(DVec3::from_array(position));
    }
    Ok(())
}

/// Reads an element's records and hands over their vertex lists.
fn read_lists<V: Values>(
    values: &mut V,
    element: &PlyElement,
    mut add: impl FnMut(&V, &[i64]) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let mut corners = Vec::new();
    for _ in 0..element.count {
        values.start_record()?;
        corners.clear();
        for property in &element.properties {
            match property.length {
                Some(length) if VERTEX_LISTS.contains(&property.name.as_str()) => {
                    for _ in 0..list_length(values, length)? {
                        corners.push(values.value(property.scalar)? as i64);
                    }
                }
                Some(length) => skip_list(values, length, property.scalar)?,
                None => {
                    values.value(property.scalar)?;
                }
            }
        }
        add(values, &corners)?;
    }
    Ok(())
}

fn skip_list(values: &mut impl Values, length: PlyScalar, scalar: PlyScalar) -> Result<(), ScanError> {
    for _ in 0..list_length(values, length)? {
        values.value(scalar)?;
    }
    Ok(())
}

fn list_length(values: &mut impl Values, scalar: PlyScalar) -> Result<u64, ScanError> {
    let length = values.value(scalar)?;
    if length < 0.0 || length.fract() != 0.0 {
        return Err(values.error(format!("a list has the length {length}; a whole number is needed")));
    }
    Ok(length as u64)
}

#[cfg(test)]
mod tests {
    use super::super::test_data::{read_bytes, refusal};
    use glam::Vec3;

    /// A square of double coordinates with colours and a face of four corners.
    fn binary(big_endian: bool) -> Vec<u8> {
        let name = if big_endian { "big" } else { "little" };
        let header = format!(
            "ply\r\nformat binary_{name}_endian 1.0\r\ncomment a b\r\nelement vertex 4\r\nproperty uchar red\r\n\
             property double x\r\nproperty float y\r\nproperty list uchar short w\r\nproperty short z\r\n\
             element face 2\r\nproperty list uchar int vertex_indices\r\nproperty float q\r\nend_header\r\n"
        );
        let mut file = header.into_bytes();
        let mut put = |mut bytes: Vec<u8>| {
            if big_endian {
                bytes.reverse();
            }
            file.extend(bytes);
        };
        for (x, y, z) in [(0.0f64, 0.0f32, -3i16), (1.0, 0.0, -3), (1.0, 1.5, -3), (0.0, 1.5, -3)] {
            put(vec![200]);
            put(x.to_le_bytes().to_vec());
            put(y.to_le_bytes().to_vec());
            put(vec![1]);
            put(7i16.to_le_bytes().to_vec());
            put(z.to_le_bytes().to_vec());
        }
        for corners in [&[0, 1, 2, 3][..], &[0, 1]] {
            put(vec![corners.len() as u8]);
            corners.iter().for_each(|corner: &i32| put(corner.to_le_bytes().to_vec()));
            put(0.5f32.to_le_bytes().to_vec());
        }
        file
    }

    #[test]
    fn binary_of_both_byte_orders_is_read() {
        for big_endian in [false, true] {
            let read = read_bytes("a.ply", &binary(big_endian)).unwrap();
            let corner = |x: f32, y: f32| Vec3::new(x, y, -3.0);
            assert_eq!(read.positions, [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.5), corner(0.0, 1.5)]);
            assert_eq!(read.triangles, [[0, 1, 2], [0, 2, 3]]);
            assert_eq!((read.metres_per_unit, read.up), (None, None));
        }
    }

    #[test]
    fn every_cut_of_a_binary_file_is_an_error() {
        let whole = binary(false);
        for length in 1..whole.len() {
            assert!(read_bytes("a.ply", &whole[..length]).is_err(), "{length}");
        }
        let error = refusal("a.ply", &whole[..whole.len() - 60]);
        assert!(error.contains("byte ") && error.contains("the number of records of `vertex` is 4"), "{error}");
        assert!(error.ends_with("the file is cut off; copy the file again, or export it again"), "{error}");
    }

    fn ascii(vertices: usize, body: &str) -> String {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uchar int vertex_index\nend_header\n{body}"
        )
    }

    #[test]
    fn ascii_is_read_and_its_errors_name_the_line() {
        let read = read_bytes("a.ply", ascii(4, "0 0 0\n1e0 0 .5\n\nnan 1 0\n 0 1 0 \n4 0 1 2 3").as_bytes()).unwrap();
        assert_eq!(read.positions, [Vec3::ZERO, Vec3::new(1.0, 0.0, 0.5), Vec3::Y]);
        assert!(read.triangles.is_empty() && read.warnings[0].contains("and 2 triangles with them"));
        for (body, said) in [
            ("0 0 0\n1 0\n", "a.ply, line 11: it ends before the record's last value: `1 0`"),
            ("0 0 0\n1 0 a\n", "a.ply, line 11: `a` is not a number"),
            (
                "0 0 0\n1 0 0\n3 0 1 2\n",
                "a.ply, triangle 0: it refers to vertex 2 (counted from 0), and the file has 2",
            ),
            ("0 0 0\n1 0 0\n3 0 1 -2\n", "a.ply, line 12: a face refers to vertex -2"),
            ("0 0 0\n1 0 0\n-1 0\n", "a.ply, line 12: a list has the length -1"),
            ("0 0 0\n1 0 0\n", "a.ply, byte 164: the number of records of `face` is 1, and the 0 bytes left"),
            ("0 0 0\n", "a.ply, byte "),
        ] {
            let error = refusal("a.ply", ascii(2, body).as_bytes());
            assert!(error.starts_with(said), "{error}");
        }
    }

    #[test]
    fn strips_end_at_minus_one() {
        let file = "ply\nformat ascii 1.0\nelement tristrips 1\nproperty list int int vertex_indices\n\
                    element vertex 5\nproperty int x\nproperty int y\nproperty int z\nend_header\n\
                    8 0 1 2 3 -1 2 3 4\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 2 2\n";
        let read = read_bytes("a.ply", file.as_bytes()).unwrap();
        assert_eq!(read.triangles, [[0, 1, 2], [2, 1, 3], [2, 3, 4]]);
    }

    #[test]
    fn invalid_headers_are_refused() {
        let whole = ascii(1, "0 0 0\n0\n");
        for (from, to, said) in [
            ("ascii", "ebcdic", "a.ply, line 2: found `format ebcdic 1.0`; expected ascii, binary_little_endian or"),
            ("float y", "int128 y", "a.ply, line 5: found `property int128 y`; expected `property TYPE NAME`"),
            ("vertex 1", "vertex -1", "a.ply, line 3: found `element vertex -1`; expected `element NAME COUNT`"),
            ("vertex 1", "point 1", "a.ply, header: it has no `element vertex`"),
            ("float y", "float v", "a.ply, line 9: the vertices have no coordinate `y`; their properties are: x, v, z"),
            ("vertex 1", "vertex 18446744073709551615", "a.ply, byte "),
            ("end_header", "comment", "a.ply, line 10: found `0 0 0`; expected format, element"),
        ] {
            let error = refusal("a.ply", whole.replacen(from, to, 1).as_bytes());
            assert!(error.starts_with(said), "{error}");
        }
    }
}
