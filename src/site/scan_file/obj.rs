//! OBJ: meshes as text (Wavefront, *Object Files*, appendix B1 of the Advanced Visualizer manual).
//!
//! Vertices (`v`) and faces (`f`) are read. Indices start at 1; negative ones count back from the
//! last vertex. Faces of more than three corners become triangle fans. The format defines neither a
//! unit nor an up. Normals, textures, materials, lines, curves and surfaces are ignored.

use glam::DVec3;

use super::geometry_builder::GeometryBuilder;
use super::input::{ScanReader, number, words};
use super::{ScanError, ScanGeometry};
use crate::text::quoted;

pub(super) fn read(mut input: ScanReader<'_>) -> Result<ScanGeometry, ScanError> {
    let mut builder = GeometryBuilder::default();
    let (mut line, mut next) = (Vec::new(), Vec::new());
    let mut corners = Vec::new();
    while input.next_line(&mut line)? {
        // A backslash continues the line.
        while line.last() == Some(&b'\\') {
            line.pop();
            if !input.next_line(&mut next)? {
                break;
            }
            line.push(b' ');
            line.extend(&next);
        }
        let mut words = words(&line);
        let invalid = |expected: &str| {
            input.line_error(format!("found `{}`; expected {expected}", quoted(&String::from_utf8_lossy(&line))))
        };
        match words.next() {
            Some(b"v") => {
                let mut coordinate = || words.next().and_then(number);
                let position = coordinate().zip(coordinate()).zip(coordinate());
                let ((x, y), z) = position.ok_or_else(|| invalid("`v X Y Z`"))?;
                builder.push(DVec3::new(x, y, z));
            }
            Some(b"f") => {
                corners.clear();
                for word in words {
                    corners.push(vertex(word, builder.len()).ok_or_else(|| {
                        invalid(
                            "`f A B C …`, each a vertex's number from 1, or counted back from the last with a minus",
                        )
                    })?);
                }
                builder.fan(&corners);
            }
            _ => {}
        }
    }
    builder.finish(input.file)
}

/// Index from 0 of a face's corner such as `3`, `-1` or `3/1/2`, after `vertices` vertices.
fn vertex(word: &[u8], vertices: usize) -> Option<u32> {
    let word = word.split(|byte| *byte == b'/').next()?;
    let number: i64 = str::from_utf8(word).ok()?.parse().ok()?;
    let index = if number < 0 { number.checked_add_unsigned(vertices as u64)? } else { number - 1 };
    // The last number marks dropped vertices.
    u32::try_from(index).ok().filter(|index| *index < u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::super::test_data::{read_bytes, refusal};
    use glam::Vec3;

    #[test]
    fn faces_of_any_notation_are_read() {
        let file = "# a mesh\r\nmtllib a.mtl\no a\nv 0 0 0 0.5 0.5 0.5\nv 1 0 0\nv\t1 1 \\\n 0\nvt 0 0\nvn 0 0 1\ng b\n\
                    f 1/1/1 2//1 3/1\nv 0 1e0 0\nf -4 -2 -1\nf 1 2 3 4\nf 5 6 7\nl 1 2\nv 0 0 9\nv 1 0 9\nv 0 1 9\n";
        let read = read_bytes("a.OBJ", file.as_bytes()).unwrap();
        assert_eq!(read.positions.len(), 7);
        assert_eq!(read.positions[2..4], [Vec3::new(1.0, 1.0, 0.0), Vec3::Y]);
        assert_eq!(read.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3], [4, 5, 6]]);
        assert_eq!((read.metres_per_unit, read.up), (None, None));
    }

    #[test]
    fn invalid_lines_are_refused_by_number() {
        for (body, said) in [
            ("v 0 0\n", "a.obj, line 2: found `v 0 0`; expected `v X Y Z`"),
            ("v 0 0 a\n", "a.obj, line 2: found `v 0 0 a`"),
            ("v 0 0 0\nf 1 0 1\n", "a.obj, line 3: found `f 1 0 1`; expected `f A B C …`"),
            ("v 0 0 0\nf 1 -2 1\n", "a.obj, line 3: found `f 1 -2 1`"),
            (
                "v 0 0 0\nf 1 2 3\n",
                "a.obj, triangle 0: it refers to vertex 2 (counted from 0), and the file has 1 vertex",
            ),
            ("f 1 -9223372036854775808 3\n", "a.obj, line 2"),
        ] {
            let error = refusal("a.obj", format!("#\n{body}").as_bytes());
            assert!(error.starts_with(said), "{error}");
        }
        assert!(refusal("a.obj", b"# nothing\n").contains("it holds no points"));
    }
}
