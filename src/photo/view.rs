//! Measures the content of a photograph: objects in view, the subject's plane, scales.

use glam::{DVec2, DVec3};

use super::coverage::{MAX_PARTIAL_VIEW, PictureCoverage, coverage};
use super::particulars::{ObjectInView, ScaleInView, Subject};
use super::plane_view::{angle_between_deg, flat_normal, height_error, longest_side_m, mm_per_px, tilt_error};
use crate::camera::{Geometry, Opening};
use crate::pose::Pose;
use crate::scene::{Object, ObjectKind, Scene};

/// Smallest share of a scale in view that counts as a scale in the photograph.
const MIN_SCALE_IN_VIEW: f64 = 0.05;

/// Camera of a photograph, and the objects with their support planes, in the scene's order.
#[derive(Clone, Copy, Debug)]
pub struct PhotoView<'a> {
    /// Geometry of the photograph.
    pub geometry: &'a Geometry,
    /// Pose at the photograph's time. The rolling shutter is not considered.
    pub pose: Pose,
    pub scene: &'a Scene,
    pub objects: &'a [Object],
    /// The world's up, for objects whose support is unknown.
    pub up: DVec3,
    pub opening: Option<Opening>,
}

/// An object's place in the photograph, and its box.
#[derive(Clone, Debug)]
pub struct ViewedObject {
    /// Index into [`PhotoView::objects`].
    pub object: usize,
    pub corners_m: [DVec3; 8],
    pub in_view: ObjectInView,
    /// Projection of the centre, px; `None` behind the camera.
    pub centre_px: Option<DVec2>,
}

impl PhotoView<'_> {
    fn size_px(&self) -> DVec2 {
        let i = &self.geometry.intrinsics;
        DVec2::new(i.width_px.into(), i.height_px.into())
    }

    /// All objects with parts, in the scene's order.
    pub fn viewed_objects(&self) -> Vec<ViewedObject> {
        self.objects.iter().enumerate().filter_map(|(n, object)| self.viewed(n, object)).collect()
    }

    fn viewed(&self, n: usize, object: &Object) -> Option<ViewedObject> {
        let corners_m = object.corners_m(self.scene)?;
        let centre_m = corners_m.iter().sum::<DVec3>() / 8.0;
        let in_camera = self.pose.transform_point(centre_m);
        let (triangles, is_cut) = self.triangles_px(object);
        let PictureCoverage { share, in_view, low_px, high_px } = coverage(&triangles, self.size_px());
        // A part behind the camera is out of view.
        let in_view = if is_cut { in_view.min(MAX_PARTIAL_VIEW) } else { in_view };
        let in_view = ObjectInView {
            name: object.name.clone(),
            kind: object.kind,
            size_m: longest_side_m(&corners_m),
            centre_m: centre_m.to_array(),
            distance_m: in_camera.length(),
            mm_per_px: mm_per_px(in_camera.z.max(0.0), self.geometry.intrinsics.fx_px),
            share,
            in_view,
            bounds_px: [low_px.x, low_px.y, high_px.x, high_px.y],
        };
        Some(ViewedObject { object: n, corners_m, in_view, centre_px: self.geometry.project(in_camera) })
    }

    /// Triangles with all corners in front of the camera, px, and whether there are others.
    fn triangles_px(&self, object: &Object) -> (Vec<[DVec2; 3]>, bool) {
        let (mut triangles, mut count) = (Vec::new(), 0);
        for part in object.placed() {
            let Some(mesh) = self.scene.meshes.get(part.mesh) else { continue };
            let project = |position: [f32; 3]| {
                let in_world = part.world_from_mesh.transform_point3(DVec3::from(position.map(f64::from)));
                self.geometry.project(self.pose.transform_point(in_world))
            };
            let corners_px: Vec<_> = mesh.vertices.iter().map(|vertex| project(vertex.position)).collect();
            let corner = |index: u32| corners_px.get(index as usize).copied().flatten();
            count += mesh.indices.len() / 3;
            triangles.extend(
                mesh.indices
                    .chunks_exact(3)
                    .filter_map(|index| Some([corner(index[0])?, corner(index[1])?, corner(index[2])?])),
            );
        }
        let is_cut = triangles.len() < count;
        (triangles, is_cut)
    }

    /// The subject: the named object, otherwise the evidence in view whose centre is nearest to the
    /// picture's, otherwise the marker.
    pub fn subject<'a>(&self, viewed: &'a [ViewedObject], name: Option<&str>) -> Option<&'a ViewedObject> {
        if let Some(name) = name {
            return viewed.iter().find(|object| object.in_view.name == name);
        }
        let middle = 0.5 * self.size_px();
        let nearest = |kind: ObjectKind| {
            let of_kind = viewed.iter().filter(move |v| v.in_view.kind == kind && v.in_view.in_view > 0.0);
            let distance_px = |v: &ViewedObject| v.centre_px.map_or(f64::INFINITY, |at| at.distance(middle));
            of_kind.min_by(|a, b| distance_px(a).total_cmp(&distance_px(b)))
        };
        nearest(ObjectKind::Evidence).or_else(|| nearest(ObjectKind::Marker))
    }

    /// Normal and point of an object's plane: a flat object's own plane, otherwise the surface on
    /// which it lies, otherwise the level plane through its lowest corner.
    fn plane_of(&self, viewed: &ViewedObject) -> (DVec3, DVec3) {
        let centre_m = DVec3::from(viewed.in_view.centre_m);
        if let Some(normal) = flat_normal(&viewed.corners_m) {
            return (normal, centre_m);
        }
        if let Some(support) = self.objects.get(viewed.object).and_then(|object| object.support) {
            return (support.normal, support.point_m);
        }
        let lowest = viewed.corners_m.iter().min_by(|a, b| a.dot(self.up).total_cmp(&b.dot(self.up)));
        (self.up, lowest.copied().unwrap_or(centre_m))
    }

    /// Particulars of the subject, without those of the picture's pixels and of motion.
    pub fn subject_particulars(&self, subject: &ViewedObject, is_named: bool, viewed: &[ViewedObject]) -> Subject {
        let (normal, on_plane_m) = self.plane_of(subject);
        let axis = self.pose.world_from_camera_rotation() * DVec3::Z;
        // The side of the plane on which the camera is.
        let towards = self.pose.position_in_world_m() - on_plane_m;
        let normal = if normal.dot(towards) < 0.0 { -normal } else { normal };
        let ObjectInView { name, distance_m, mm_per_px, .. } = subject.in_view.clone();
        Subject {
            name,
            is_named,
            distance_m,
            angle_deg: angle_between_deg(axis, normal),
            mm_per_px,
            defocus_px: self.defocus_px(subject),
            motion_px: None,
            clipped_share: 0.0,
            scale: self.nearest_scale(subject, viewed).map(|scale| {
                let tilt_deg = angle_between_deg(self.plane_of(scale).0, normal);
                let height_m = normal.dot(DVec3::from(scale.in_view.centre_m) - on_plane_m);
                ScaleInView {
                    name: scale.in_view.name.clone(),
                    tilt_deg,
                    tilt_error: Some(tilt_error(tilt_deg)).filter(|error| error.is_finite()),
                    height_m,
                    height_error: height_error(height_m, distance_m),
                }
            }),
        }
    }

    fn nearest_scale<'a>(&self, subject: &ViewedObject, viewed: &'a [ViewedObject]) -> Option<&'a ViewedObject> {
        let is_scale =
            |v: &&ViewedObject| v.in_view.kind == ObjectKind::Scale && v.in_view.in_view >= MIN_SCALE_IN_VIEW;
        let centre_m = DVec3::from(subject.in_view.centre_m);
        let distance_m = |v: &ViewedObject| DVec3::from(v.in_view.centre_m).distance(centre_m);
        let others = viewed.iter().filter(|v| v.object != subject.object).filter(is_scale);
        others.min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)))
    }

    /// Largest circle of confusion over the corners of the subject's box, px. Corners behind the
    /// camera are left out.
    fn defocus_px(&self, subject: &ViewedObject) -> f64 {
        let Some(opening) = self.opening else { return 0.0 };
        let depths_m = subject.corners_m.iter().map(|&corner| self.pose.transform_point(corner).z);
        let circle = |z: f64| opening.circle_px(self.geometry.intrinsics.fx_px, z).abs();
        depths_m.filter(|z| *z > 1e-3).map(circle).fold(0.0, f64::max)
    }
}

/// Length of the path of a point's projections, px. `None` without two of them.
pub fn path_px(projections: &[Option<DVec2>]) -> Option<f64> {
    let all: Option<Vec<DVec2>> = projections.iter().copied().collect();
    let all = all.filter(|all| all.len() > 1)?;
    Some(all.windows(2).map(|pair| pair[0].distance(pair[1])).sum())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::camera::{Distortion, Intrinsics};
    use crate::plane::Plane;
    use crate::scene::{Mesh, Part, Vertex};
    use glam::DAffine3;

    fn close(actual: f64, expected: f64, within: f64) {
        assert!((actual - expected).abs() <= within, "{actual} is not {expected}");
    }

    /// A rectangle of x by y metres in the plane z = 0, 1 mm thick for a defined thinnest side.
    fn plate(width_m: f32, height_m: f32) -> Mesh {
        let (x, y) = (0.5 * width_m, 0.5 * height_m);
        let vertex = |x: f32, y: f32, z: f32| Vertex {
            position: [x, y, z],
            normal: [0.0, 0.0, 1.0],
            tangent: [0.0; 4],
            uv0: [0.0; 2],
            uv1: [0.0; 2],
            color: [1.0; 4],
        };
        let vertices = vec![
            vertex(-x, -y, 0.0),
            vertex(x, -y, 0.0),
            vertex(x, y, 0.0),
            vertex(-x, y, 0.0),
            vertex(0.0, 0.0, 0.001),
        ];
        Mesh { vertices, indices: vec![0, 1, 2, 0, 2, 3, 0, 1, 4], material: 0 }
    }

    fn object(name: &str, kind: ObjectKind, mesh: usize, world_from_mesh: DAffine3) -> Object {
        let parts = vec![Part { mesh, world_from_mesh }];
        Object { name: name.to_owned(), kind, parts, world_from_model: world_from_mesh, ..Object::default() }
    }

    /// A note of 20 × 10 cm on the ground z = 0, and a scale of 10 × 2 cm beside it, tilted by 12°,
    /// under a camera 1 m above with f = 500 px that points down.
    fn scene() -> Scene {
        let tilted = DAffine3::from_rotation_x(12f64.to_radians());
        let beside = DAffine3::from_translation(DVec3::new(0.0, 0.15, 0.02)) * tilted;
        Scene {
            meshes: vec![Arc::new(plate(0.2, 0.1)), Arc::new(plate(0.1, 0.02))],
            objects: vec![
                object("note", ObjectKind::Evidence, 0, DAffine3::IDENTITY),
                object("scale", ObjectKind::Scale, 1, beside),
            ],
            ..Scene::default()
        }
    }

    fn geometry() -> Geometry {
        let i = Intrinsics { fx_px: 500.0, fy_px: 500.0, cx_px: 320.0, cy_px: 240.0, ..Default::default() };
        Geometry::new(i, Distortion::default())
    }

    fn above(height_m: f64, off_m: f64) -> Pose {
        Pose::look_at(DVec3::new(0.0, off_m, height_m), DVec3::ZERO, DVec3::X).unwrap()
    }

    fn view<'a>(scene: &'a Scene, geometry: &'a Geometry, pose: Pose) -> PhotoView<'a> {
        let opening = Opening { diameter_m: 0.01, focus_distance_m: 0.5, blades: 0, rotation_rad: 0.0 };
        PhotoView { geometry, pose, scene, objects: &scene.objects, up: DVec3::Z, opening: Some(opening) }
    }

    #[test]
    fn particulars_of_a_view_from_above_match_hand_calculation() {
        let (scene, geometry) = (scene(), geometry());
        let view = view(&scene, &geometry, above(1.0, 0.0));
        let viewed = view.viewed_objects();
        let note = &viewed[0].in_view;
        // 200 mm at 2 mm per px: 100 × 50 px of 640 × 480.
        close(note.mm_per_px, 2.0, 2e-3);
        close(note.longest_px(), 100.0, 0.1);
        close(note.share, 5000.0 / 307_200.0, 2e-4);
        assert!(note.is_whole() && note.size_m > 0.199);
        let subject = view.subject_particulars(view.subject(&viewed, None).unwrap(), false, &viewed);
        assert_eq!(subject.name, "note");
        close(subject.distance_m, 1.0, 1e-3);
        close(subject.angle_deg, 0.0, 1e-6);
        // fx · D · (1/0.5 − 1/1) = 500 · 0.01.
        close(subject.defocus_px, 5.0, 0.01);
        let scale = subject.scale.unwrap();
        close(scale.tilt_deg, 12.0, 1e-6);
        close(scale.tilt_error.unwrap(), 0.0223, 1e-4);
        close(scale.height_m, 0.02, 1e-3);
        close(scale.height_error, -0.02, 1e-3);
    }

    #[test]
    fn view_from_the_side_has_the_angle_of_its_axis() {
        let (scene, geometry) = (scene(), geometry());
        let view = view(&scene, &geometry, above(1.0, -1.0));
        let viewed = view.viewed_objects();
        let subject = view.subject_particulars(&viewed[0], true, &viewed);
        close(subject.angle_deg, 45.0, 1e-6);
        close(subject.distance_m, 2f64.sqrt(), 1e-3);
    }

    #[test]
    fn plane_of_a_solid_object_is_its_support_then_the_level_plane() {
        let mut scene = scene();
        let geometry = geometry();
        // A cube of 0.1 m.
        let mut cube = plate(0.1, 0.1);
        cube.vertices[4].position[2] = 0.1;
        scene.meshes[0] = Arc::new(cube);
        let level = view(&scene, &geometry, above(1.0, 0.0));
        let viewed = level.viewed_objects();
        close(level.subject_particulars(&viewed[0], true, &viewed).angle_deg, 0.0, 1e-6);
        let slope = DVec3::new(0.0, 0.6, 0.8);
        scene.objects[0].support = Some(Plane { point_m: DVec3::ZERO, normal: slope });
        let on_slope = view(&scene, &geometry, above(1.0, 0.0));
        close(on_slope.subject_particulars(&viewed[0], true, &viewed).angle_deg, 36.87, 0.01);
    }

    #[test]
    fn object_out_of_view_is_no_subject_unless_named() {
        let (scene, geometry) = (scene(), geometry());
        let up = Pose::look_at(DVec3::Z, DVec3::new(0.0, 0.0, 2.0), DVec3::X).unwrap();
        let view = view(&scene, &geometry, up);
        let viewed = view.viewed_objects();
        assert!(view.subject(&viewed, None).is_none());
        let named = view.subject(&viewed, Some("note")).unwrap();
        assert_eq!((named.in_view.share, named.in_view.in_view, named.in_view.mm_per_px), (0.0, 0.0, 0.0));
    }

    #[test]
    fn path_is_the_sum_of_its_steps() {
        let at = |x: f64, y: f64| Some(DVec2::new(x, y));
        assert_eq!(path_px(&[at(0.0, 0.0), at(3.0, 4.0), at(3.0, 5.0)]), Some(6.0));
        assert_eq!(path_px(&[at(0.0, 0.0), None]), None);
        assert_eq!(path_px(&[at(0.0, 0.0)]), None);
    }
}
