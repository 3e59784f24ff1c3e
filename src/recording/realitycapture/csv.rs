//! The CSV: a header that begins with `#name`, then a line per picture. A line `#cameras 12` may
//! precede the header. Columns are found by their names; those of the lens may be missing.

use std::path::Path;

use glam::{DQuat, DVec3};

use super::exported_camera::{ExportedCamera, posed};
use crate::pose::Pose;
use crate::recording::parts::Parts;
use crate::recording::photogrammetry::{self, LabelledPicture};
use crate::recording::{OpenOptions, RecordingError, listing};
use crate::text::quoted;
use crate::tracking::records::{self, TextError};
use crate::tracking::tum::PoseNotes;

/// Columns of a pose, with the names of older and newer versions.
const POSITION: [&[&str]; 3] = [&["x"], &["y"], &["alt", "z"]];
const ANGLES: [&[&str]; 3] = [&["heading", "yaw"], &["pitch"], &["roll"]];
const FOCAL: &[&str] = &["f", "f_35mm"];
const PRINCIPAL_POINT: [&[&str]; 2] = [&["px", "px_norm"], &["py", "py_norm"]];
const DISTORTION: [&[&str]; 6] = [&["k1"], &["k2"], &["k3"], &["k4"], &["t1"], &["t2"]];

const EXPORT_ADVICE: &str = "export the registration again as Internal/External camera parameters";

/// The header: its line, from 1, the separator and the columns' names in lower case.
struct TableHeader {
    line: usize,
    separator: char,
    names: Vec<String>,
}

impl TableHeader {
    fn of(text: &str) -> Option<Self> {
        let lines = text.trim_start_matches('\u{feff}').lines().enumerate();
        let (line, header) =
            lines.map(|(i, line)| (i + 1, line.trim())).find(|(_, line)| !line.is_empty() && !is_preamble(line))?;
        let separator = [';', '\t'].into_iter().find(|separator| header.contains(*separator)).unwrap_or(',');
        let name = |name: &str| name.trim().trim_matches('"').trim_start_matches('#').trim().to_ascii_lowercase();
        let names: Vec<String> = header.split(separator).map(name).collect();
        (names.first().is_some_and(|first| first == "name") && names.len() > 3).then_some(Self {
            line,
            separator,
            names,
        })
    }

    fn column(&self, names: &[&str]) -> Option<usize> {
        self.names.iter().position(|own| names.contains(&own.as_str()))
    }

    /// The columns of a group; `None` if any is missing.
    fn columns<const N: usize>(&self, group: [&[&str]; N]) -> Option<[usize; N]> {
        let columns: Option<Vec<usize>> = group.iter().map(|names| self.column(names)).collect();
        columns.and_then(|columns| columns.try_into().ok())
    }
}

fn is_preamble(line: &str) -> bool {
    line.to_ascii_lowercase().starts_with("#cameras")
}

/// True if a text begins like an export: the header has a name, a position and angles of any kind.
pub fn is_export(head: &str) -> bool {
    TableHeader::of(head).is_some_and(|header| {
        header.columns(POSITION).is_some()
            && (header.column(ANGLES[0]).is_some() || header.column(&["omega"]).is_some())
    })
}

/// A line of the file.
#[derive(Clone, Debug, PartialEq)]
struct ExportLine {
    pose: Option<Pose>,
    camera: Option<ExportedCamera>,
    line: usize,
}

pub fn open(file: &Path, path: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let (pictures, mut warnings) = parse(&records::read(file)?, file, options.metres_per_unit)?;
    if pictures.is_empty() {
        return Err(RecordingError::content(file, format!("holds no cameras; {EXPORT_ADVICE}")));
    }
    if pictures.iter().any(|picture| picture.data.camera.is_none()) {
        warnings
            .push(format!("{}: has no focal length (column f): the camera must come from a profile", file.display()));
    }
    let (located, unread) = photogrammetry::locate(file, path, pictures)?;
    let mut frames = Vec::new();
    for picture in located {
        let (pose, camera, line) = picture.data.map_or((None, None, 0), |line| (line.pose, line.camera, line.line));
        let refuse = |problem: String| TextError::line(file, line, problem).into();
        frames.push(posed(picture.file, pose, camera.as_ref(), &mut warnings, refuse)?);
    }
    let mut parts = photogrammetry::parts(path, file, "RealityCapture", frames, &unread, options)?;
    parts.description_files = vec![file.to_owned()];
    parts.warnings.extend(warnings);
    Ok(parts)
}

type Lines = Vec<LabelledPicture<ExportLine>>;

fn parse(text: &str, file: &Path, metres_per_unit: f64) -> Result<(Lines, Vec<String>), TextError> {
    let Some(header) = TableHeader::of(text) else {
        return Err(TextError::line(
            file,
            1,
            format!("the header is missing; expected #name,x,y,alt,…; {EXPORT_ADVICE}"),
        ));
    };
    let missing = |names: &str| {
        let problem = format!("the header has no {names}; {EXPORT_ADVICE}");
        TextError::line(file, header.line, problem)
    };
    let position = header.columns(POSITION).ok_or_else(|| missing("x, y, alt"))?;
    let angles = header.columns(ANGLES).ok_or_else(|| missing("heading, pitch, roll"))?;
    let focal = header.column(FOCAL);
    let principal_point = header.columns(PRINCIPAL_POINT);
    let (mut pictures, mut notes) = (Lines::new(), PoseNotes::default());
    let lines = text.trim_start_matches('\u{feff}').lines().enumerate().skip(header.line);
    for (line, record) in lines.map(|(i, line)| (i + 1, line.trim())) {
        if record.is_empty() || record.starts_with('#') {
            continue;
        }
        let refuse = |problem: String| TextError::line(file, line, problem);
        let fields: Vec<&str> = record.split(header.separator).map(|field| field.trim().trim_matches('"')).collect();
        if fields.len() < header.names.len() {
            let problem = format!(
                "holds {} of {} values; the file is cut off: {EXPORT_ADVICE}",
                fields.len(),
                header.names.len()
            );
            return Err(refuse(problem));
        }
        let number = |column: usize| -> Result<f64, TextError> {
            let (name, field) = (header.names.get(column), fields.get(column).copied().unwrap_or_default());
            let name = name.map_or("", String::as_str);
            field.parse().map_err(|_| refuse(format!("{} is `{}`; a number is needed", quoted(name), quoted(field))))
        };
        let finite = |column: usize| match number(column)? {
            value if value.is_finite() => Ok(value),
            value => Err(refuse(format!("{} is {value}; a finite number is needed", quoted(&header.names[column])))),
        };
        let label = listing::file_name(fields[0], "the picture's name is missing").map_err(refuse)?;
        let mut values = [0.0; 6];
        for (value, column) in values.iter_mut().zip(position.into_iter().chain(angles)) {
            *value = number(column)?;
        }
        let [x, y, z, heading, pitch, roll] = values;
        let pose = if values.iter().all(|value| value.is_finite()) {
            Some(pose(DVec3::new(x, y, z) * metres_per_unit, [heading, pitch, roll]))
        } else {
            notes.count_lost(format!("line {line}"));
            None
        };
        let camera = match focal {
            None => None,
            Some(focal) => {
                let mut camera = ExportedCamera {
                    focal_35mm: finite(focal)?,
                    principal_point: [0.0; 2],
                    distortion: [0.0; 6],
                    aspect_ratio: 1.0,
                    skew: 0.0,
                };
                if let Some([px, py]) = principal_point {
                    camera.principal_point = [finite(px)?, finite(py)?];
                }
                for (value, names) in camera.distortion.iter_mut().zip(DISTORTION) {
                    *value = header.column(names).map_or(Ok(0.0), finite)?;
                }
                Some(camera)
            }
        };
        pictures.push(LabelledPicture { label, line, data: ExportLine { pose, camera, line } });
    }
    let posed = pictures.iter().filter(|picture| picture.data.pose.is_some()).count();
    Ok((pictures, notes.warnings(file, posed)))
}

/// The pose of a camera at a position, from heading, pitch and roll in degrees: turned about −z by
/// the heading, about x by the pitch, about y by the roll, from a camera that faces down with the
/// picture's up to the north.
fn pose(at_m: DVec3, angles_deg: [f64; 3]) -> Pose {
    let [heading, pitch, roll] = angles_deg.map(f64::to_radians);
    let turn = DQuat::from_rotation_z(-heading) * DQuat::from_rotation_x(pitch) * DQuat::from_rotation_y(roll);
    // From OpenGL's axes to OpenCV's: half a turn about x.
    Pose::from_camera_in_world(at_m, turn * DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const HEADER: &str = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2";

    fn read(text: &str) -> Result<Lines, String> {
        parse(text, Path::new("c.csv"), 1.0).map(|read| read.0).map_err(|e| e.to_string())
    }

    #[test]
    fn angles_are_those_of_an_aeroplane_over_a_map() {
        let in_camera =
            |angles: [f64; 3], point: [f64; 3]| pose(DVec3::new(1.0, 2.0, 3.0), angles).transform_point(point.into());
        // Straight down from a height of 3: north is the picture's up, −y.
        assert!((in_camera([0.0; 3], [1.5, 2.25, 0.0]) - DVec3::new(0.5, -0.25, 3.0)).length() < 1e-12);
        // The picture's up is to the east, so its right is to the south.
        assert!((in_camera([90.0, 0.0, 0.0], [2.0, 1.5, 0.0]) - DVec3::new(0.5, -1.0, 3.0)).length() < 1e-12);
        // Level, to the north: up is the world's.
        assert!((in_camera([0.0, 90.0, 0.0], [1.5, 6.0, 3.25]) - DVec3::new(0.5, -0.25, 4.0)).length() < 1e-12);
        // Level, to the east.
        assert!((in_camera([90.0, 90.0, 0.0], [5.0, 1.5, 3.25]) - DVec3::new(0.5, -0.25, 4.0)).length() < 1e-12);
        // Level, turned about the picture's up by a quarter: its axis is to the west.
        assert!((in_camera([0.0, 90.0, 90.0], [-3.0, 2.5, 3.25]) - DVec3::new(0.5, -0.25, 4.0)).length() < 1e-12);
    }

    #[test]
    fn columns_of_old_and_new_versions_are_read() {
        let row = "a b.jpg,1,2,3,10,20,30,18,0.01,-0.02,1,2,3,4,5,6";
        let newer = "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2";
        let old = read(&format!("#cameras 1\n{HEADER}\n{row}\n")).unwrap();
        assert!(
            is_export(&format!("#cameras 1\r\n{HEADER}\r\n")) && is_export(newer) && !is_export("timestamp,x,y,alt")
        );
        let ExportLine { pose: old_pose, camera, line } = &old[0].data;
        assert_eq!((old[0].label.as_str(), old[0].line, *line), ("a b.jpg", 3, 3));
        assert_eq!(*old_pose, Some(pose(DVec3::new(1.0, 2.0, 3.0), [10.0, 20.0, 30.0])));
        let camera = camera.unwrap();
        assert_eq!((camera.focal_35mm, camera.principal_point), (18.0, [0.01, -0.02]));
        assert_eq!(camera.distortion, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let new = read(&format!("{newer}\n{row}\n")).unwrap();
        assert_eq!(new[0].data, ExportLine { line: 2, ..old[0].data.clone() });
        let semicolons = read(&format!("{HEADER}\n{row}\n").replace(',', ";")).unwrap();
        assert_eq!(semicolons[0].data, new[0].data);
        let bare = read("#name,x,y,alt,heading,pitch,roll\na.jpg,1,2,3,10,20,30").unwrap();
        assert_eq!((bare[0].data.pose, bare[0].data.camera), (*old_pose, None));
    }

    #[test]
    fn refusals_name_line_and_column() {
        let row = "a.jpg,1,2,3,10,20,30,18,0,0,1,2,3,4,5,6";
        for (text, expected) in [
            ("", "c.csv, line 1: the header is missing"),
            ("#name,x,y,alt,omega,phi,kappa\n", "c.csv, line 1: the header has no heading, pitch, roll; export"),
            (&format!("{HEADER}\n{}", &row[..20]), "c.csv, line 2: holds 7 of 16 values; the file is cut off"),
            (&format!("{HEADER}\n{}", row.replace("20", "x")), "c.csv, line 2: pitch is `x`; a number is needed"),
            (&format!("{HEADER}\n{}", row.replace("18", "nan")), "c.csv, line 2: f is NaN; a finite number"),
            (&format!("{HEADER}\n{}", &row[5..]).replacen('\n', "\n,", 1), "c.csv, line 2: the picture's name is"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.starts_with(expected), "{error}");
        }
        let (lines, warnings) =
            parse(&format!("{HEADER}\n{}", row.replace("20", "nan")), Path::new("c.csv"), 1.0).unwrap();
        assert!(lines[0].data.pose.is_none() && warnings[0].contains("1 of 1 poses is not finite"), "{warnings:?}");
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "([-0-9.eNa]{0,4}[,\n]){0,40}") {
            for text in [text, format!("{HEADER}\n{near}")] {
                let _ = (is_export(&text), read(&text));
            }
        }
    }
}
