//! Places a model at rest on a surface.

use std::path::{Component, Path};

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};

use super::document::{Axis, PlacedModel, Up};
use super::heading::Heading;
use super::place::{bounds, min_along, shortest_rotation};
use super::{Scene, SceneError, load};
use crate::plane::Plane;

/// Resting posture of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Posture {
    /// The model's up is vertical, whatever the surface: a marker tent.
    Upright,
    /// The flattest side lies on the surface: a scale, a knife, a cartridge case.
    Flat,
}

/// A planar patch of a real object beside an evidence object: a box's side, a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facet {
    pub plane: Plane,
    /// Unit vector in the plane along a side of the bounding rectangle. The other side is normal ×
    /// along.
    pub along: DVec3,
    /// Minimum of the rectangle, from the plane's point, along these sides, metres.
    pub low_m: DVec2,
    pub high_m: DVec2,
}

impl Facet {
    /// True if the projection of a point lies in the rectangle; `off` is relative to the plane's
    /// point.
    pub fn contains(&self, off: DVec3) -> bool {
        let at = DVec2::new(self.along.dot(off), self.plane.normal.cross(self.along).dot(off));
        at.cmpge(self.low_m).all() && at.cmple(self.high_m).all()
    }
}

/// Largest tilt of a surface on which flat models lie exactly level.
const MAX_LEVEL_TILT_DEG: f64 = 2.0;
/// Cosine of the largest tilt at which a surface supports upright objects, 40°.
pub const MIN_SUPPORT_COSINE: f64 = 0.766;
/// Decimal factor for rounding written numbers, m and 1.
const DECIMAL_ROUNDING: f64 = 1e4;

/// Placement of a model that makes it rest on a surface. `model` is its path as referenced by the
/// scene file `file`. The model is rotated about the world's up; flat on a slope about the slope's
/// normal. Upright at a steep surface it is moved horizontally until it touches the surface from
/// outside; below a ceiling it stays at the point. `size_m` is its largest extent, if it differs
/// from the model's.
pub fn place_at_rest(
    model: &str,
    file: &Path,
    support: &Plane,
    posture: Posture,
    heading: Heading,
    world_up: DVec3,
    size_m: Option<f64>,
) -> Result<PlacedModel, SceneError> {
    let scene = load(&file.parent().unwrap_or(Path::new("")).join(model), None)?;
    let up = match posture {
        Posture::Upright => Axis::Y,
        Posture::Flat => thinnest_axis(&scene),
    };
    let axis = if up == Axis::Z {
        DVec3::Z
    } else if up == Axis::X {
        DVec3::X
    } else {
        DVec3::Y
    };
    let heading_deg = round(heading.degrees(axis, world_up));
    let laid = PlacedModel {
        model: model.to_owned(),
        up: (up != Axis::Y).then_some(Up::Named(up)),
        ground: true,
        position_m: Some(support.point_m.to_array().map(round)),
        heading_deg: (heading_deg != 0.0).then_some(heading_deg),
        size_m,
        ..PlacedModel::default()
    };
    let slope = support.normal.dot(world_up);
    let parts = scene.objects.first().map(|object| object.parts.as_slice()).unwrap_or_default();
    let extent_m = bounds(&scene, parts, DAffine3::IDENTITY).map(|(low, high)| (high - low).max_element());
    let factor = size_m.zip(extent_m).map_or(1.0, |(size_m, extent_m)| size_m / extent_m);
    // Minimum of the rotated model's vertices, relative to its origin, along a world direction.
    let below = |turn: DQuat, along: DVec3| {
        let model_from_world = DMat3::from_quat(turn * shortest_rotation(axis, world_up)).transpose();
        factor * min_along(&scene, parts, model_from_world * along).unwrap_or(0.0)
    };
    let turn = DQuat::from_axis_angle(world_up, heading_deg.to_radians());
    if posture == Posture::Upright && slope.abs() < MIN_SUPPORT_COSINE {
        let Some(outwards) = support.normal.reject_from(world_up).try_normalize() else { return Ok(laid) };
        // The lowest vertex is at the height of the point.
        let depth_m = slope * below(turn, world_up) - below(turn, support.normal);
        let position = support.point_m + depth_m / support.normal.dot(outwards) * outwards;
        return Ok(PlacedModel { position_m: Some(position.to_array().map(round)), ..laid });
    }
    if posture == Posture::Upright || slope > MAX_LEVEL_TILT_DEG.to_radians().cos() {
        return Ok(laid);
    }
    // Rotated on the level, then tilted onto the slope.
    let turn = shortest_rotation(world_up, support.normal) * turn;
    let position = support.point_m - below(turn, support.normal) * support.normal;
    let quaternion = turn.to_array().map(|n| (n * 1e6).round() / 1e6);
    Ok(PlacedModel {
        ground: false,
        heading_deg: None,
        quaternion: Some(quaternion),
        position_m: Some(position.to_array().map(round)),
        ..laid
    })
}

/// A model's path as referenced by a scene file: relative to the file if they share a parent
/// folder, with slashes; otherwise absolute.
pub fn relative(model: &Path, file: &Path) -> String {
    let whole = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut model = whole(model);
    let file = whole(file);
    if model.components().any(|part| part == Component::ParentDir) {
        model = model.canonicalize().unwrap_or(model);
    }
    let folder = file.parent().unwrap_or(Path::new(""));
    let (from, to): (Vec<_>, Vec<_>) = (folder.components().collect(), model.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let up = std::iter::repeat_n("..".to_owned(), from.len() - shared);
    let down = to[shared..].iter().map(|part| part.as_os_str().to_string_lossy().into_owned());
    let relative = up.chain(down).collect::<Vec<_>>().join("/");
    // A symbolic link's parent is that of its target.
    let is_elsewhere = match (folder.join(&relative).canonicalize(), model.canonicalize()) {
        (Ok(named), Ok(model)) => named != model,
        (named, model) => folder.is_dir() && named.is_ok() != model.is_ok(),
    };
    // A common root alone does not count.
    if shared < 2 || is_elsewhere { model.to_string_lossy().into_owned() } else { relative }
}

fn round(n: f64) -> f64 {
    (n * DECIMAL_ROUNDING).round() / DECIMAL_ROUNDING
}

/// The axis of the model's smallest extent; its up in a tie.
fn thinnest_axis(scene: &Scene) -> Axis {
    let parts = scene.objects.first().map(|object| object.parts.as_slice()).unwrap_or_default();
    let Some((low, high)) = bounds(scene, parts, DAffine3::IDENTITY) else { return Axis::Y };
    let size = high - low;
    // A difference of less than 1 % counts as a tie.
    let thinnest = 1.01 * size.min_element();
    if size.y <= thinnest {
        Axis::Y
    } else if size.z <= thinnest {
        Axis::Z
    } else {
        Axis::X
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assets;
    use crate::scene::{SceneFile, load_file};

    const FILE: &str = "scenes/new.toml";

    /// Bounding box of the placed model, and its transform.
    fn laid(model: &str, support: &Plane, posture: Posture, heading_deg: f64) -> (DVec3, DVec3, Scene, PlacedModel) {
        let file = assets::source_folder().join(FILE);
        let placed = place_at_rest(model, &file, support, posture, Heading::Deg(heading_deg), DVec3::Z, None).unwrap();
        loaded(placed, &file)
    }

    fn loaded(placed: PlacedModel, file: &Path) -> (DVec3, DVec3, Scene, PlacedModel) {
        let scene = SceneFile { objects: vec![placed.clone()], ..SceneFile::default() };
        let scene = load_file(&scene, file, Some(DVec3::Z)).unwrap();
        let (low, high) = bounds(&scene, &scene.objects[0].parts, DAffine3::IDENTITY).unwrap();
        (low, high, scene, placed)
    }

    #[test]
    fn models_are_named_from_the_scene_file() {
        let relative = |model: &str, file: &str| super::relative(Path::new(model), Path::new(file));
        assert_eq!(relative("/a/b/m.glb", "/a/b/scene.toml"), "m.glb");
        assert_eq!(relative("/a/models/m.glb", "/a/b/c/scene.toml"), "../../models/m.glb");
        assert_eq!(relative("/x/m.glb", "/a/scene.toml"), "/x/m.glb");
        assert_eq!(relative("scenes/m.glb", "out/scene.toml"), "../scenes/m.glb");
        let temp = tempfile::tempdir().unwrap();
        let at = |name: &str| temp.path().canonicalize().unwrap().join(name);
        for folder in ["case/models", "far/away/desk"] {
            std::fs::create_dir_all(at(folder)).unwrap();
        }
        std::fs::write(at("case/models/m.glb"), "").unwrap();
        let named = |model: &str, file: &str| super::relative(&at(model), &at(file));
        assert_eq!(named("far/../case/models/m.glb", "case/scene.toml"), "models/m.glb");
        #[cfg(unix)]
        {
            // `..` would lead to far/away.
            std::os::unix::fs::symlink(at("far/away/desk"), at("case/desk")).unwrap();
            assert_eq!(named("case/models/m.glb", "case/desk/scene.toml"), at("case/models/m.glb").to_str().unwrap());
        }
    }

    #[test]
    fn placed_model_faces_the_viewer() {
        let (file, level) = (assets::source_folder().join(FILE), Plane { point_m: DVec3::ZERO, normal: DVec3::Z });
        let looks = DVec3::new(-3.0, 4.0, 1.0);
        for (model, posture, front) in [
            ("marker-1.glb", Posture::Upright, DVec3::Z),
            ("l-scale.glb", Posture::Flat, DVec3::Z),
            // It lies with its z up: its foot, −y, is towards the viewer.
            ("cartridge-case-9mm.glb", Posture::Flat, DVec3::NEG_Y),
        ] {
            let heading = Heading::Towards { direction: looks, turned_deg: 0.0 };
            let placed = place_at_rest(model, &file, &level, posture, heading, DVec3::Z, None).unwrap();
            let scene = SceneFile { objects: vec![placed], ..SceneFile::default() };
            let scene = load_file(&scene, &file, Some(DVec3::Z)).unwrap();
            let front = scene.objects[0].world_from_model.transform_vector3(front).normalize();
            // Within the written tenth of a degree.
            assert!(front.dot(looks.reject_from(DVec3::Z).normalize()) > 0.1f64.to_radians().cos(), "{model}: {front}");
        }
    }

    #[test]
    fn flat_and_upright_models_touch_the_surface() {
        let level = Plane { point_m: DVec3::new(0.4, -0.3, 0.41), normal: DVec3::Z };
        let (low, high, ..) = laid("cartridge-case-9mm.glb", &level, Posture::Flat, 30.0);
        let size = high - low;
        // 19 mm long, 10 mm wide: lying it is as high as it is wide.
        assert!((low.z - 0.41).abs() < 1e-4 && size.z < 0.0105, "{low} {size}");
        let (low, high, _, placed) = laid("marker-1.glb", &level, Posture::Upright, 30.0);
        assert!((low.z - 0.41).abs() < 1e-4 && high.z - low.z > 0.05, "{low} {high}");
        assert_eq!((placed.heading_deg, placed.ground, placed.up), (Some(30.0), true, None));
    }

    #[test]
    fn on_a_slope_flat_models_lie_and_markers_stand() {
        let normal = DVec3::new(0.0, -0.6, 0.8);
        let slope = Plane { point_m: DVec3::new(1.0, 2.0, 0.5), normal };
        let file = assets::source_folder().join(FILE);
        let heading = || Heading::Deg(45.0);
        let sized = place_at_rest("l-scale.glb", &file, &slope, Posture::Flat, heading(), DVec3::Z, Some(1.0)).unwrap();
        let as_it_is = place_at_rest("l-scale.glb", &file, &slope, Posture::Flat, heading(), DVec3::Z, None).unwrap();
        for (placed, max_m) in [(as_it_is, 0.005), (sized, 0.02)] {
            let (.., scene, _) = loaded(placed, &file);
            let min_distance = |direction: DVec3| min_along(&scene, &scene.objects[0].parts, direction).unwrap();
            let [below, above] = [min_distance(normal), -min_distance(-normal)];
            // It lies on the plane, and is as thin there as a scale.
            let off_m = below - normal.dot(slope.point_m);
            assert!(off_m.abs() < 2e-4 && above - below < max_m, "{below} {above}");
        }
        let (_, _, scene, placed) = laid("marker-1.glb", &slope, Posture::Upright, 0.0);
        assert_eq!((placed.heading_deg, placed.position_m), (None, Some(slope.point_m.to_array())));
        let up = scene.objects[0].parts[0].world_from_mesh.transform_vector3(DVec3::Y);
        assert!(up.normalize().abs_diff_eq(DVec3::Z, 1e-9), "{up}");
    }

    #[test]
    fn upright_at_a_steep_surface_touches_it_from_outside() {
        let file = assets::source_folder().join(FILE);
        for normal in [DVec3::new(0.0, -1.0, 0.0), DVec3::new(0.48, -0.64, 0.6), DVec3::new(0.0, -0.8, -0.6)] {
            let wall = Plane { point_m: DVec3::new(1.0, 2.0, 0.5), normal };
            for size_m in [None, Some(0.3)] {
                let heading = Heading::Deg(35.0);
                let placed =
                    place_at_rest("marker-1.glb", &file, &wall, Posture::Upright, heading, DVec3::Z, size_m).unwrap();
                let (low, _, scene, _) = loaded(placed, &file);
                let below = min_along(&scene, &scene.objects[0].parts, normal).unwrap() - normal.dot(wall.point_m);
                assert!(below.abs() < 2e-4 && (low.z - 0.5).abs() < 1e-4, "{normal}: {below}, {low}");
            }
        }
        let ceiling = Plane { point_m: DVec3::new(1.0, 2.0, 0.5), normal: DVec3::new(0.0, 0.035, -1.0).normalize() };
        let placed =
            place_at_rest("marker-1.glb", &file, &ceiling, Posture::Upright, Heading::Deg(0.0), DVec3::Z, None)
                .unwrap();
        assert_eq!(placed.position_m, Some(ceiling.point_m.to_array()));
    }
}
