//! The cameras of Agisoft Metashape (`File > Export > Export Cameras`, Agisoft XML). A camera's
//! `transform` is its pose in the chunk (camera to chunk, row by row) with OpenCV's axes. The
//! transform of the chunk, or of a component, leads to the world: scale · rotation · x +
//! translation. Sources: Agisoft Metashape User Manual, Professional Edition 2.1, appendix C
//! "Camera models"; <https://www.agisoft.com/forum/index.php?topic=6437.0>.
//!
//! With x = X/Z and y = Y/Z: x' = x(1 + K1 r² + K2 r⁴ + K3 r⁶ + K4 r⁸) + P1(r² + 2x²) + 2 P2 x y,
//! y' = y(…) + P2(r² + 2y²) + 2 P1 x y, u = w/2 + cx + x' f + x' B1 + y' B2, v = h/2 + cy + y' f.
//! So P1 is OpenCV's p2, and P2 is p1. A fisheye (equidistant) applies this to the angle from the
//! axis times the direction. Pixel centres are at +0.5.
//!
//! A referenced chunk's world is geocentric (ECEF), metres. It is replaced by the local east, north
//! and up at the cameras' centre. Not read: rolling shutter, markers, covariances, the offsets of
//! the cameras of a rig.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use roxmltree::Node;

use super::brown_camera::BrownCamera;
use super::parts::{Parts, RecordingFormat, equirectangular, geometry_from};
use super::photogrammetry::{self, LabelledPicture, LocatedPicture, PosedPicture};
use super::rigid::{NOT_RIGID, is_lost, rigid};
use super::{OpenOptions, RecordingError, xml};
use crate::camera::{Geometry, LensModel};
use crate::fit::SimilarityTransform;
use crate::pose::Pose;
use crate::text::{count, quoted};
use crate::tracking::records;

const FILE_NAME: &str = "cameras.xml";

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: "Metashape",
    has_times: false,
    is_metric: false,
    find: |path| {
        if path.is_file() {
            let is_xml = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("xml"));
            return is_xml.then(|| path.to_owned());
        }
        Some(path.join(FILE_NAME)).filter(|file| file.exists())
    },
    open,
};

const EXPORT_ADVICE: &str = "export the cameras again: File > Export > Export Cameras, Agisoft XML";

/// A camera of the file.
#[derive(Debug)]
struct ChunkCamera {
    /// `None`: not aligned, or disabled.
    world_from_camera: Option<(DVec3, DQuat)>,
    sensor: String,
}

/// The contents of the file.
#[derive(Debug, Default)]
struct CamerasFile {
    cameras: Vec<LabelledPicture<ChunkCamera>>,
    sensors: BTreeMap<String, Geometry>,
    up: Option<DVec3>,
    warnings: Vec<String>,
}

fn open(file: &Path, path: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let CamerasFile { cameras, sensors, up, warnings } = parse(&records::read(file)?, file)?;
    let (located, unread) = photogrammetry::locate(file, path, cameras)?;
    let posed = |LocatedPicture { file, data }: LocatedPicture<ChunkCamera>| {
        let pose = data.as_ref().and_then(|camera| camera.world_from_camera);
        let scaled = |(at, turn): (DVec3, DQuat)| Pose::from_camera_in_world(at * options.metres_per_unit, turn);
        PosedPicture {
            file,
            camera_from_world: pose.map(scaled),
            geometry: data.and_then(|camera| sensors.get(&camera.sensor).cloned()),
        }
    };
    let mut parts =
        photogrammetry::parts(path, file, "Metashape", located.into_iter().map(posed).collect(), &unread, options)?;
    parts.up = up;
    parts.description_files = vec![file.to_owned()];
    parts.warnings.extend(warnings);
    Ok(parts)
}

/// The contents of a `<transform>`.
fn similarity(node: Node<'_, '_>, file: &Path) -> Result<SimilarityTransform, RecordingError> {
    let refuse = |problem: String| xml::error_at(node, file, format!("transform: {problem}; {EXPORT_ADVICE}"));
    let text = |name: &str| xml::child(node, name).and_then(|child| child.text());
    let mut similarity = SimilarityTransform::IDENTITY;
    if let Some(text) = text("translation") {
        similarity.translation_m = xml::finite_numbers::<3>(text, "translation").map_err(refuse)?.into();
    }
    if let Some(text) = text("rotation") {
        let [a, b, c, d, e, f, g, h, i] = xml::finite_numbers::<9>(text, "rotation").map_err(refuse)?;
        let rows = [[a, b, c, 0.0], [d, e, f, 0.0], [g, h, i, 0.0]];
        let (rotation, _) = rigid(rows).ok_or_else(|| refuse(format!("rotation {NOT_RIGID}")))?;
        similarity.rotation = DQuat::from_mat3(&rotation).normalize();
    }
    if let Some(text) = text("scale") {
        [similarity.scale] = xml::finite_numbers(text, "scale").map_err(refuse)?;
    }
    if similarity.scale > 0.0 {
        return Ok(similarity);
    }
    Err(refuse(format!("scale is {}; expected above 0", similarity.scale)))
}

fn parse(text: &str, file: &Path) -> Result<CamerasFile, RecordingError> {
    let document = xml::parse(text, file)?;
    let root = document.root_element();
    let chunks: Vec<Node<'_, '_>> = root.descendants().filter(|node| node.has_tag_name("chunk")).collect();
    let chunk = match chunks.first() {
        Some(chunk) if root.has_tag_name("document") => *chunk,
        _ => {
            let problem = format!(
                "has the root <{}> and no <chunk>; expected <document> with a <chunk>, as Metashape exports cameras; \
                 {EXPORT_ADVICE}",
                quoted(root.tag_name().name())
            );
            return Err(xml::error_at(root, file, problem));
        }
    };
    let mut contents = CamerasFile::default();
    if chunks.len() > 1 {
        contents.warnings.push(format!("{}: the first of {} chunks is read", file.display(), chunks.len()));
    }
    let components = Components::of(chunk, file)?;
    let lines = xml::LineIndex::new(document.input_text());
    let mut counts = PoseCounts::default();
    let cameras = xml::child(chunk, "cameras").into_iter().flat_map(|cameras| cameras.descendants());
    for node in cameras.filter(|node| node.has_tag_name("camera")) {
        let data = camera(node, file, &components, &mut counts)?;
        contents.cameras.push(LabelledPicture { line: lines.line_at(node.range().start), ..data });
    }
    let aligned = || contents.cameras.iter().filter_map(|camera| camera.data.world_from_camera);
    if aligned().next().is_none() {
        let problem = format!(
            "none of its {} is aligned ({}); align the photos in Metashape, then {EXPORT_ADVICE}",
            count(contents.cameras.len(), "camera"),
            counts.summary()
        );
        return Err(xml::error_at(chunk, file, problem));
    }
    contents.warnings.extend(counts.warning(file, contents.cameras.len()));
    let used: Vec<String> = {
        let with_pose = contents.cameras.iter().filter(|camera| camera.data.world_from_camera.is_some());
        with_pose.map(|camera| camera.data.sensor.clone()).collect()
    };
    let centre = aligned().map(|(at, _)| at).sum::<DVec3>() / used.len() as f64;
    contents.sensors = sensors(chunk, file, &used, &mut contents.warnings)?;
    if components.has_transform {
        contents.up = Some(DVec3::Z);
    } else {
        let problem = "the chunk has no transform: neither its scale nor up is known (--metres-per-unit)";
        contents.warnings.push(format!("{}: {problem}", file.display()));
    }
    if is_geocentric(chunk, centre) {
        let world = LocalFrame::at(centre);
        for camera in &mut contents.cameras {
            camera.data.world_from_camera = camera.data.world_from_camera.map(|pose| world.of_geocentric(pose));
        }
        contents.warnings.push(format!(
            "{}: its world is the earth's; replaced by east, north and up at the cameras' centre, {:.1} {:.1} {:.1} m \
             from the earth's",
            file.display(),
            centre.x,
            centre.y,
            centre.z
        ));
    }
    Ok(contents)
}

/// The transforms to the world.
#[derive(Debug)]
struct Components {
    of_chunk: SimilarityTransform,
    by_id: BTreeMap<String, SimilarityTransform>,
    /// The selected component; `None` for files without components.
    active: Option<String>,
    has_transform: bool,
}

impl Components {
    fn of(chunk: Node<'_, '_>, file: &Path) -> Result<Self, RecordingError> {
        let transform = |node| xml::child(node, "transform").map(|node| similarity(node, file)).transpose();
        let of_chunk = transform(chunk)?;
        let (mut by_id, mut active, mut ids) = (BTreeMap::new(), None, Vec::new());
        if let Some(components) = xml::child(chunk, "components") {
            active = components.attribute("active_id").map(str::to_owned);
            for component in components.children().filter(|node| node.has_tag_name("component")) {
                let Some(id) = component.attribute("id") else { continue };
                ids.push(id.to_owned());
                if let Some(similarity) = transform(component)? {
                    by_id.insert(id.to_owned(), similarity);
                }
            }
        }
        if active.as_ref().is_none_or(|active| !ids.contains(active)) {
            active = ids.into_iter().next();
        }
        let has_transform = of_chunk.is_some() || active.as_ref().is_some_and(|active| by_id.contains_key(active));
        Ok(Self { of_chunk: of_chunk.unwrap_or(SimilarityTransform::IDENTITY), by_id, active, has_transform })
    }

    /// The transform of a camera's component; `None` if it is not the active one.
    fn world_from_chunk(&self, component: Option<&str>) -> Option<SimilarityTransform> {
        let Some((component, active)) = component.zip(self.active.as_deref()) else { return Some(self.of_chunk) };
        (component == active).then(|| self.by_id.get(component).copied().unwrap_or(self.of_chunk))
    }
}

/// Counts of the cameras without a pose.
#[derive(Debug, Default)]
struct PoseCounts {
    unaligned: usize,
    disabled: usize,
    of_rig: usize,
    in_other_component: usize,
    invalid: usize,
    first: String,
}

impl PoseCounts {
    fn summary(&self) -> String {
        let counts = [
            (self.unaligned, "not aligned"),
            (self.disabled, "disabled"),
            (self.of_rig, "of a rig, placed relative to another camera"),
            (self.in_other_component, "in another component"),
            (self.invalid, "with a pose that is not finite or has no rotation"),
        ];
        let counted: Vec<String> =
            counts.into_iter().filter(|(count, _)| *count > 0).map(|(count, name)| format!("{count} {name}")).collect();
        if counted.is_empty() { "it has none".to_owned() } else { counted.join(", ") }
    }

    fn warning(&self, file: &Path, all: usize) -> Option<String> {
        let Self { unaligned, disabled, of_rig, in_other_component, invalid, first } = self;
        let without = unaligned + disabled + of_rig + in_other_component + invalid;
        (without > 0).then(|| {
            format!(
                "{}: {without} of {} have no pose: {} (first: {})",
                file.display(),
                count(all, "camera"),
                self.summary(),
                quoted(first)
            )
        })
    }
}

fn camera(
    node: Node<'_, '_>,
    file: &Path,
    components: &Components,
    counts: &mut PoseCounts,
) -> Result<LabelledPicture<ChunkCamera>, RecordingError> {
    let label = node.attribute("label").filter(|label| !label.trim().is_empty()).ok_or_else(|| {
        xml::error_at(node, file, format!("the camera has no label, which names its picture; {EXPORT_ADVICE}"))
    })?;
    let label = super::listing::file_name(label, "").map_err(|problem| xml::error_at(node, file, problem))?;
    let transform = xml::child(node, "transform");
    let is_disabled = matches!(node.attribute("enabled"), Some("false" | "0"));
    let similarity = components.world_from_chunk(node.attribute("component_id"));
    let matrix = transform.and_then(|transform| transform.text());
    let counter = match (matrix, similarity) {
        _ if is_disabled => Some(&mut counts.disabled),
        (None, _) if node.has_attribute("master_id") => Some(&mut counts.of_rig),
        (None, _) => Some(&mut counts.unaligned),
        (Some(_), None) => Some(&mut counts.in_other_component),
        _ => None,
    };
    let mut world_from_camera = None;
    if let Some(counter) = counter {
        *counter += 1;
    } else if let Some((matrix, similarity)) = matrix.zip(similarity) {
        let refuse = |problem: String| {
            xml::error_at(transform.unwrap_or(node), file, format!("camera {}: {problem}", quoted(&label)))
        };
        world_from_camera = pose(matrix, &similarity).map_err(refuse)?;
        counts.invalid += usize::from(world_from_camera.is_none());
    }
    if world_from_camera.is_none() && counts.first.is_empty() {
        counts.first.clone_from(&label);
    }
    let sensor = node.attribute("sensor_id").unwrap_or_default().to_owned();
    // The caller replaces the line.
    Ok(LabelledPicture { label, line: 1, data: ChunkCamera { world_from_camera, sensor } })
}

/// Position and rotation of a camera in the world. `None` if the pose is lost.
fn pose(matrix: &str, world_from_chunk: &SimilarityTransform) -> Result<Option<(DVec3, DQuat)>, String> {
    let n: [f64; 16] = xml::numbers(matrix, "transform")?;
    let row = |i: usize| [n[4 * i], n[4 * i + 1], n[4 * i + 2], n[4 * i + 3]];
    let rows = [row(0), row(1), row(2), row(3)];
    if is_lost(&rows) {
        return Ok(None);
    }
    let [a, b, c, last] = rows;
    if last != [0.0, 0.0, 0.0, 1.0] {
        return Err("transform: the last row must be 0 0 0 1".to_owned());
    }
    let (turn, at) = rigid([a, b, c]).ok_or_else(|| format!("transform {NOT_RIGID}"))?;
    let turn = (world_from_chunk.rotation * DQuat::from_mat3(&turn)).normalize();
    Ok(Some((world_from_chunk.transform_point(at), turn)))
}

/// The geometries of the sensors with these ids.
fn sensors(
    chunk: Node<'_, '_>,
    file: &Path,
    used: &[String],
    warnings: &mut Vec<String>,
) -> Result<BTreeMap<String, Geometry>, RecordingError> {
    let all = xml::child(chunk, "sensors").into_iter().flat_map(|sensors| sensors.children());
    let mut geometries = BTreeMap::new();
    for node in all.filter(|node| node.has_tag_name("sensor")) {
        let id = node.attribute("id").unwrap_or_default();
        if !used.iter().any(|used| used == id) {
            continue;
        }
        let label = node.attribute("label").unwrap_or(id);
        let refuse = |problem: String| xml::error_at(node, file, format!("sensor {}: {problem}", quoted(label)));
        let (geometry, notes) = sensor(node).map_err(refuse)?;
        warnings
            .extend(notes.into_iter().map(|notes| format!("{}: sensor {}: {notes}", file.display(), quoted(label))));
        geometries.insert(id.to_owned(), geometry);
    }
    match used.iter().find(|id| !geometries.contains_key(*id)) {
        Some(id) => {
            let problem =
                format!("a camera has the sensor {}, which the file does not have; {EXPORT_ADVICE}", quoted(id));
            Err(xml::error_at(chunk, file, problem))
        }
        None => Ok(geometries),
    }
}

/// The geometry of a sensor, and warnings.
fn sensor(node: Node<'_, '_>) -> Result<(Geometry, Vec<String>), String> {
    let calibrations: Vec<Node<'_, '_>> = node.children().filter(|child| child.has_tag_name("calibration")).collect();
    let adjusted = calibrations.iter().find(|node| node.attribute("class") == Some("adjusted"));
    let calibration = adjusted.or(calibrations.first()).copied();
    let kind =
        calibration.and_then(|node| node.attribute("type")).or_else(|| node.attribute("type")).unwrap_or("frame");
    let [width, height] = size(calibration, node)?;
    if kind == "spherical" {
        return Ok((equirectangular(width as u32, height as u32)?, Vec::new()));
    }
    let Some(calibration) = calibration else {
        return Err(format!("has no calibration; align the photos, then {EXPORT_ADVICE}"));
    };
    let mut warnings = Vec::new();
    if adjusted.is_none() {
        warnings.push("its calibration is the initial one, not an adjusted one".to_owned());
    }
    let value = |name: &str| match xml::child(calibration, name).map(|node| node.text().unwrap_or_default()) {
        Some(text) => xml::finite_numbers::<1>(text, name).map(|[value]| Some(value)),
        None => Ok(None),
    };
    let or_zero = |name: &str| value(name).map(|value| value.unwrap_or(0.0));
    if value("fx")?.is_some() {
        return Err(format!(
            "its calibration has fx, as PhotoScan up to 1.1 wrote it; expected f, cx, cy …; open the project in \
             Metashape and {EXPORT_ADVICE}"
        ));
    }
    let f = value("f")?.ok_or("its calibration has no focal length f")?;
    for name in ["p3", "p4"] {
        if or_zero(name)? != 0.0 {
            return Err(format!("{name} is not 0; adjust the cameras again without it (Tools > Optimize Cameras)"));
        }
    }
    let [k1, k2, k3, k4] = [or_zero("k1")?, or_zero("k2")?, or_zero("k3")?, or_zero("k4")?];
    let camera = BrownCamera {
        size_px: [width, height],
        focal_px: [f + or_zero("b1")?, f],
        centre_px: [0.5 * width + or_zero("cx")?, 0.5 * height + or_zero("cy")?],
        skew_px: or_zero("b2")?,
        radial: [k1, k2, k3, k4],
        tangential: [or_zero("p2")?, or_zero("p1")?],
    };
    let (geometry, skew) = match kind {
        "frame" => camera.geometry()?,
        "fisheye" | "equidistant_fisheye" => fisheye(&camera)?,
        other => {
            return Err(format!(
                "its type is {}; expected frame, fisheye, equidistant_fisheye or spherical; export pictures without \
                 distortion (File > Export > Convert Images) and align those",
                quoted(other)
            ));
        }
    };
    warnings.extend(skew);
    Ok((geometry, warnings))
}

fn size(calibration: Option<Node<'_, '_>>, sensor: Node<'_, '_>) -> Result<[f64; 2], String> {
    let resolution_node = |node| xml::child(node, "resolution");
    let resolution =
        calibration.and_then(resolution_node).or_else(|| resolution_node(sensor)).ok_or("has no resolution")?;
    let side = |name: &str| match resolution.attribute(name) {
        Some(text) => xml::finite_numbers::<1>(text, name),
        None => Err(format!("its resolution has no {name}")),
    };
    let ([width], [height]) = (side("width")?, side("height")?);
    if [width, height].iter().all(|side| (1.0..=65536.0).contains(side) && side.fract() == 0.0) {
        return Ok([width, height]);
    }
    Err(format!("its resolution is {width}x{height}; expected whole numbers from 1 to 65536"))
}

/// An equidistant fisheye: the polynomial and the tangential terms are those of
/// `thin_prism_fisheye`.
fn fisheye(camera: &BrownCamera) -> Result<(Geometry, Option<String>), String> {
    let without_distortion = BrownCamera { radial: [0.0; 4], tangential: [0.0; 2], ..*camera };
    let (_, warning) = without_distortion.geometry()?;
    let model = if camera.tangential == [0.0; 2] { LensModel::OpencvFisheye } else { LensModel::ThinPrismFisheye };
    let values = [
        ("width_px", camera.size_px[0]),
        ("height_px", camera.size_px[1]),
        ("fx_px", camera.focal_px[0]),
        ("fy_px", camera.focal_px[1]),
        ("cx_px", camera.centre_px[0]),
        ("cy_px", camera.centre_px[1]),
        ("k1", camera.radial[0]),
        ("k2", camera.radial[1]),
        ("k3", camera.radial[2]),
        ("k4", camera.radial[3]),
        ("p1", camera.tangential[0]),
        ("p2", camera.tangential[1]),
    ];
    Ok((geometry_from(model, &values).map_err(|e| e.to_string())?, warning))
}

/// Semi-axes of the earth's ellipsoid WGS 84, m.
const EARTH_EQUATOR_M: f64 = 6_378_137.0;
const EARTH_POLE_M: f64 = 6_356_752.314_245;
/// Positions are geocentric if they are this close to the ellipsoid, m: mines to aeroplanes.
const EARTH_MARGIN_M: f64 = 30_000.0;

/// True if the world is the earth's, centred in it.
fn is_geocentric(chunk: Node<'_, '_>, centre: DVec3) -> bool {
    let reference = xml::child(chunk, "reference").and_then(|node| node.text()).unwrap_or_default();
    let is_local = ["LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"].iter().any(|word| reference.trim_start().starts_with(word));
    let distance_m = centre.length();
    let near = EARTH_POLE_M - EARTH_MARGIN_M..EARTH_EQUATOR_M + EARTH_MARGIN_M;
    !is_local && near.contains(&distance_m)
}

/// East, north and up at a place of the earth.
#[derive(Clone, Copy, Debug)]
struct LocalFrame {
    origin: DVec3,
    local_from_earth: DMat3,
}

impl LocalFrame {
    /// The frame at a geocentric position. Up is perpendicular to the ellipsoid, to within 1e-5 rad
    /// at heights of a few kilometres.
    fn at(origin: DVec3) -> Self {
        let squared = DVec3::new(EARTH_EQUATOR_M, EARTH_EQUATOR_M, EARTH_POLE_M).powf(2.0);
        let up = (origin / squared).normalize_or(DVec3::Z);
        let east = DVec3::Z.cross(up).normalize_or(DVec3::Y);
        let north = up.cross(east);
        Self { origin, local_from_earth: DMat3::from_cols(east, north, up).transpose() }
    }

    fn of_geocentric(&self, (at, turn): (DVec3, DQuat)) -> (DVec3, DQuat) {
        let rotation = DQuat::from_mat3(&self.local_from_earth).normalize();
        (self.local_from_earth * (at - self.origin), (rotation * turn).normalize())
    }
}

#[cfg(test)]
mod tests;
