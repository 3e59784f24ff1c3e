//! XMP sidecars: each value is an attribute or a child of `rdf:Description`.

use std::path::{Path, PathBuf};

use glam::DQuat;
use roxmltree::Node;

use super::exported_camera::{ExportedCamera, posed};
use crate::pose::Pose;
use crate::recording::parts::Parts;
use crate::recording::photogrammetry;
use crate::recording::rigid::{NOT_RIGID, is_lost, rigid};
use crate::recording::{OpenOptions, RecordingError, listing, xml};
use crate::source::unsupported;
use crate::text::{count, quoted};
use crate::tracking::records;
use crate::tracking::tum::PoseNotes;

const NAMESPACE: &str = "http://www.capturingreality.com/ns/xcr/1.1#";
/// Distortion models whose coefficients are k1, k2, k3, k4, t1, t2, unused ones 0.
const MODELS: [&str; 5] = ["perspective", "brown3", "brown4", "brown3t2", "brown4t2"];

/// True if a text begins like a sidecar of RealityCapture, not of a raw converter.
pub fn is_sidecar(head: &str) -> bool {
    head.contains("www.capturingreality.com/ns/xcr/")
}

/// The sidecar of a picture: `a.xmp` or `a.jpg.xmp`.
fn sidecar(picture: &Path) -> Option<PathBuf> {
    let with = |ending: &str| {
        let name = format!("{}.{ending}", picture.file_name()?.to_string_lossy());
        Some(picture.with_file_name(name))
    };
    let candidates = [Some(picture.with_extension("xmp")), Some(picture.with_extension("XMP")), with("xmp")];
    candidates.into_iter().flatten().find(|file| file.is_file())
}

pub fn open(folder: &Path, path: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let (mut frames, mut description_files, mut warnings) = (Vec::new(), Vec::new(), Vec::new());
    let (mut notes, mut without_pose, mut posed_count) = (PoseNotes::default(), Vec::new(), 0);
    for picture in listing::pictures_in(folder)? {
        // Other programs write sidecars, too.
        let own = sidecar(&picture).map(|file| Ok::<_, RecordingError>((records::read_description(&file)?, file)));
        let Some((text, file)) = own.transpose()?.filter(|(text, _)| is_sidecar(text)) else {
            frames.push(posed(picture, None, None, &mut warnings, |problem| RecordingError::content(folder, problem))?);
            continue;
        };
        let Sidecar { pose, camera } = parse(&text, &file, options.metres_per_unit)?;
        match pose {
            SidecarPose::Known(_) => posed_count += 1,
            SidecarPose::Lost => notes.count_lost(file.display().to_string()),
            SidecarPose::Missing => without_pose.push(file.clone()),
        }
        let pose = if let SidecarPose::Known(pose) = pose { Some(pose) } else { None };
        let refuse = |problem| RecordingError::content(&file, problem);
        frames.push(posed(picture, pose, Some(&camera), &mut warnings, refuse)?);
        description_files.push(file);
    }
    if posed_count == 0 {
        let problem = format!(
            "none of its {} with a sidecar has a pose (xcr:Rotation and xcr:Position): align the pictures in \
             RealityCapture, then export the registration as XMP, with the poses",
            count(description_files.len(), "picture")
        );
        return Err(RecordingError::content(folder, problem));
    }
    if let Some(first) = without_pose.first() {
        let number = count(without_pose.len(), "sidecar");
        warnings.push(format!("{number} without a pose (first: {}): not aligned", first.display()));
    }
    warnings.extend(notes.warnings(folder, posed_count));
    let unread = unsupported::in_folder(folder);
    let path = if path.is_dir() { path } else { folder };
    let mut parts = photogrammetry::parts(path, folder, "RealityCapture", frames, &unread, options)?;
    parts.description_files = description_files;
    parts.warnings.extend(warnings);
    Ok(parts)
}

/// The contents of a sidecar.
#[derive(Debug)]
struct Sidecar {
    pose: SidecarPose,
    camera: ExportedCamera,
}

#[derive(Debug)]
enum SidecarPose {
    Known(Pose),
    /// Not finite, or without a rotation.
    Lost,
    /// The sidecar has the calibration alone.
    Missing,
}

fn parse(text: &str, file: &Path, metres_per_unit: f64) -> Result<Sidecar, RecordingError> {
    let document = xml::parse(text, file)?;
    let root = document.root_element();
    let is_description = |node: &Node<'_, '_>| node.is_element() && node.tag_name().name() == "Description";
    let has_values = |node: &Node<'_, '_>| {
        node.attributes().any(|attribute| attribute.namespace() == Some(NAMESPACE))
            || node.children().any(|child| child.tag_name().namespace() == Some(NAMESPACE))
    };
    let Some(node) = root.descendants().filter(is_description).find(has_values) else {
        let problem = "has no rdf:Description with xcr: values; export the registration as XMP metadata again";
        return Err(xml::error_at(root, file, problem));
    };
    description(node, metres_per_unit).map_err(|problem| xml::error_at(node, file, problem))
}

fn description(node: Node<'_, '_>, metres_per_unit: f64) -> Result<Sidecar, String> {
    let text = |name: &str| {
        let child = node.children().find(|child| child.has_tag_name((NAMESPACE, name)));
        node.attribute((NAMESPACE, name)).or_else(|| child.map(|child| child.text().unwrap_or_default()))
    };
    let named = |name: &str| format!("xcr:{name}");
    let number = |name: &str| {
        let text = text(name).map(|text| xml::finite_numbers::<1>(text, &named(name)));
        text.transpose().map(|value| value.map(|[value]| value))
    };
    match text("Coordinates") {
        None | Some("absolute") => {}
        Some(other) => {
            return Err(format!(
                "xcr:Coordinates is {}; expected absolute: export the registration again, not relative to a rig",
                quoted(other)
            ));
        }
    }
    let model = text("DistortionModel").unwrap_or("perspective");
    if !MODELS.contains(&model) {
        return Err(format!(
            "xcr:DistortionModel is {}; expected {}: select Brown3 or Brown4 as distortion model in the alignment \
             settings, align and export again",
            quoted(model),
            MODELS.join(", ")
        ));
    }
    let distortion = match text("DistortionCoeficients").or_else(|| text("DistortionCoefficients")) {
        Some(text) => xml::finite_numbers::<6>(text, "xcr:DistortionCoeficients")?,
        None => [0.0; 6],
    };
    let camera = ExportedCamera {
        focal_35mm: number("FocalLength35mm")?.ok_or("xcr:FocalLength35mm is missing; export the calibration, too")?,
        principal_point: [number("PrincipalPointU")?.unwrap_or(0.0), number("PrincipalPointV")?.unwrap_or(0.0)],
        distortion,
        aspect_ratio: number("AspectRatio")?.unwrap_or(1.0),
        skew: number("Skew")?.unwrap_or(0.0),
    };
    let Some((rotation, position)) = text("Rotation").zip(text("Position")) else {
        return Ok(Sidecar { pose: SidecarPose::Missing, camera });
    };
    let [a, b, c, d, e, f, g, h, i] = xml::numbers::<9>(rotation, "xcr:Rotation")?;
    let [x, y, z] = xml::numbers::<3>(position, "xcr:Position")?;
    let rows = [[a, b, c, x], [d, e, f, y], [g, h, i, z]];
    if is_lost(&rows) {
        return Ok(Sidecar { pose: SidecarPose::Lost, camera });
    }
    let (camera_from_world, centre) = rigid(rows).ok_or_else(|| format!("xcr:Rotation {NOT_RIGID}"))?;
    let world_from_camera = DQuat::from_mat3(&camera_from_world).normalize().conjugate();
    let pose = Pose::from_camera_in_world(centre * metres_per_unit, world_from_camera);
    Ok(Sidecar { pose: SidecarPose::Known(pose), camera })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    /// At (66.9, 45.3, 5.5), level, to the world's −x: the picture's right is the world's y.
    const SIDECAR: &str = r#"<x:xmpmeta xmlns:x="adobe:ns:meta/">
  <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
    <rdf:Description xcr:Version="3" xcr:PosePrior="locked" xcr:Coordinates="absolute"
       xcr:DistortionModel="brown3t2" xcr:FocalLength35mm="24.5" xcr:Skew="0" xcr:AspectRatio="1"
       xcr:PrincipalPointU="-0.0005" xcr:PrincipalPointV="0.25" xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#">
      <xcr:Rotation>0 1 0 0 0 -1 -1 0 0</xcr:Rotation>
      <xcr:Position>66.9 45.3 5.5</xcr:Position>
      <xcr:DistortionCoeficients>-0.1 0.2 -0.3 0 0.01 0.02</xcr:DistortionCoeficients>
    </rdf:Description>
  </rdf:RDF>
</x:xmpmeta>
"#;

    fn read(text: &str) -> Result<Sidecar, String> {
        parse(text, Path::new("a.xmp"), 2.0).map_err(|e| e.to_string())
    }

    #[test]
    fn values_are_read_from_attributes_and_elements() {
        let Sidecar { pose, camera } = read(SIDECAR).unwrap();
        assert!(is_sidecar(SIDECAR));
        assert_eq!((camera.focal_35mm, camera.principal_point), (24.5, [-0.0005, 0.25]));
        assert_eq!(camera.distortion, [-0.1, 0.2, -0.3, 0.0, 0.01, 0.02]);
        let SidecarPose::Known(pose) = pose else { panic!("no pose") };
        // Twice the unit: at (133.8, 90.6, 11). 2 m ahead, 0.5 m to the right, 0.25 m up.
        let in_camera = pose.transform_point(DVec3::new(131.8, 91.1, 11.25));
        assert!((in_camera - DVec3::new(0.5, -0.25, 2.0)).length() < 1e-12, "{in_camera}");
        let attributes = SIDECAR
            .replace("<xcr:Rotation>0 1 0 0 0 -1 -1 0 0</xcr:Rotation>", "")
            .replace("xcr:Skew", "xcr:Rotation=\"0 1 0 0 0 -1 -1 0 0\" xcr:Skew");
        let SidecarPose::Known(again) = read(&attributes).unwrap().pose else { panic!("no pose") };
        assert_eq!(again, pose);
    }

    #[test]
    fn sidecar_without_a_pose_is_a_calibration() {
        let text = SIDECAR.replace("<xcr:Position>66.9 45.3 5.5</xcr:Position>", "");
        assert!(matches!(read(&text).unwrap().pose, SidecarPose::Missing));
        let text = SIDECAR.replace("66.9 45.3", "nan 45.3");
        assert!(matches!(read(&text).unwrap().pose, SidecarPose::Lost));
    }

    #[test]
    fn refusals_name_the_line_and_the_value() {
        for (from, to, expected) in [
            ("brown3t2", "division", "a.xmp, line 3: xcr:DistortionModel is division; expected perspective, brown3"),
            ("\"absolute\"", "\"relative\"", "a.xmp, line 3: xcr:Coordinates is relative; expected absolute"),
            ("\"24.5\"", "\"x\"", "a.xmp, line 3: xcr:FocalLength35mm holds `x`; expected a number"),
            ("xcr:FocalLength35mm", "xcr:Focal", "a.xmp, line 3: xcr:FocalLength35mm is missing"),
            ("0 1 0 0 0 -1", "0 2 0 0 0 -1", "a.xmp, line 3: xcr:Rotation is not a rotation"),
            ("0 1 0 0 0 -1", "0 1 0 0 0", "a.xmp, line 3: xcr:Rotation holds 8; expected 9 numbers"),
            (" 0.01 0.02<", "<", "a.xmp, line 3: xcr:DistortionCoeficients holds 4; expected 6 numbers"),
            ("xcr/1.1#", "xcr/2#", "a.xmp, line 1: has no rdf:Description with xcr: values"),
        ] {
            let error = read(&SIDECAR.replacen(from, to, 1)).unwrap_err();
            assert!(error.starts_with(expected), "{error}");
        }
        for length in (0..SIDECAR.len()).step_by(7) {
            assert!(read(&SIDECAR[..length]).unwrap_err().starts_with("a.xmp, line "));
        }
    }

    proptest! {
        #[test]
        fn arbitrary_values_never_panic(text in "\\PC*", numbers in "([-0-9.eNa]{1,9} ){9}") {
            let _ = (read(&text), read(&SIDECAR.replace("0 1 0 0 0 -1 -1 0 0", &numbers)));
        }
    }
}
