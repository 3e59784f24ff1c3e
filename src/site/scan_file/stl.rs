//! STL: triangles as text and binary (3D Systems, *StereoLithography Interface Specification*,
//! 1988).
//!
//! Each triangle has three vertices of its own, shared with no other. The format defines neither a
//! unit nor an up.

use glam::{DVec3, Vec3};

use super::geometry_builder::GeometryBuilder;
use super::input::{REMEDY, ScanReader, number, words};
use super::{ScanError, ScanGeometry};
use crate::text::quoted;

/// A title and the number of triangles.
const HEADER_BYTES: u64 = 84;
/// A normal, three vertices and an attribute.
const TRIANGLE_BYTES: u64 = 50;

pub(super) fn read(mut input: ScanReader<'_>) -> Result<ScanGeometry, ScanError> {
    let start = input.peek(HEADER_BYTES as usize)?;
    let announced = start.last_chunk().filter(|_| start.len() as u64 == HEADER_BYTES).map(|n| u32::from_le_bytes(*n));
    let begins_as_text = start.trim_ascii_start().starts_with(b"solid");
    let binary_length = announced.map(|count| HEADER_BYTES + TRIANGLE_BYTES * u64::from(count));
    // Titles of binary files begin with "solid" as well, in spite of the specification.
    if begins_as_text && binary_length != Some(input.length()) { read_text(input) } else { read_binary(input) }
}

fn read_binary(mut input: ScanReader<'_>) -> Result<ScanGeometry, ScanError> {
    let mut builder = GeometryBuilder::default();
    input.array::<{ HEADER_BYTES as usize - 4 }>("the title")?;
    let count = u32::from_le_bytes(input.array("the number of triangles")?);
    input.check_count(count.into(), TRIANGLE_BYTES, "triangles")?;
    builder.reserve(3 * u64::from(count), 3 * u64::from(count));
    for n in 0..count {
        let bytes: [u8; TRIANGLE_BYTES as usize] = input.array("a triangle")?;
        for vertex in bytes[12..48].chunks_exact(12) {
            let coordinate = |axis: usize| f32::from_le_bytes([0, 1, 2, 3].map(|n| vertex[4 * axis + n]));
            builder.push(Vec3::new(coordinate(0), coordinate(1), coordinate(2)).as_dvec3());
        }
        builder.triangle([0, 1, 2].map(|corner| n.saturating_mul(3).saturating_add(corner)));
    }
    builder.finish(input.file)
}

fn read_text(mut input: ScanReader<'_>) -> Result<ScanGeometry, ScanError> {
    let mut builder = GeometryBuilder::default();
    let mut line = Vec::new();
    let mut corners = Vec::new();
    while input.next_line(&mut line)? {
        let mut words = words(&line);
        match words.next() {
            Some(b"vertex") => {
                let mut coordinate = || words.next().and_then(number);
                let Some(((x, y), z)) = coordinate().zip(coordinate()).zip(coordinate()) else {
                    let actual = quoted(&String::from_utf8_lossy(&line));
                    return Err(input.line_error(format!("found `{actual}`; expected `vertex X Y Z`")));
                };
                corners.push(builder.len() as u32);
                builder.push(DVec3::new(x, y, z));
            }
            Some(b"endloop") => {
                builder.fan(&corners);
                corners.clear();
            }
            _ => {}
        }
    }
    if !corners.is_empty() {
        let problem = format!("the last triangle has no `endloop`: the file is cut off; {REMEDY}");
        return Err(ScanError::content(input.file, "end", problem));
    }
    builder.finish(input.file)
}

#[cfg(test)]
mod tests {
    use super::super::test_data::{read_bytes, refusal};
    use glam::Vec3;

    fn binary(title: &str) -> Vec<u8> {
        let mut file = vec![b' '; 80];
        file[..title.len()].copy_from_slice(title.as_bytes());
        file.extend(2u32.to_le_bytes());
        for z in [0.0f32, 2.0] {
            let numbers = [0.0, 0.0, 1.0, 0.0, 0.0, z, 1.0, 0.0, z, 0.0, 1.0, z];
            file.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
            file.extend([0, 0]);
        }
        file
    }

    #[test]
    fn binary_and_text_give_the_same_triangles() {
        let facet = |z: f32| {
            let corners = [[0, 0], [1, 0], [0, 1]].map(|[x, y]| format!("vertex {x} {y}e0 {z}\n")).concat();
            format!("facet normal 0 0 1\n outer loop\n{corners} endloop\nendfacet\n")
        };
        let text = format!("solid a\n{}{}endsolid a\n", facet(0.0), facet(2.0));
        for file in [binary("a"), binary("solid a"), text.into_bytes()] {
            let read = read_bytes("a.stl", &file).unwrap();
            assert_eq!(read.triangles, [[0, 1, 2], [3, 4, 5]]);
            assert_eq!(read.positions[4], Vec3::new(1.0, 0.0, 2.0));
        }
    }

    #[test]
    fn cut_files_are_refused() {
        let whole = binary("a");
        for length in 1..whole.len() {
            assert!(refusal("a.stl", &whole[..length]).contains("the file is cut off"), "{length}");
        }
        let text = "solid a\nfacet\nouter loop\nvertex 0 0 0\n";
        assert!(refusal("a.stl", text.as_bytes()).contains("has no `endloop`: the file is cut off"));
        let error = refusal("a.stl", format!("{text}vertex 0 0\n").as_bytes());
        assert!(error.starts_with("a.stl, line 5: found `vertex 0 0`; expected `vertex X Y Z`"), "{error}");
    }
}
