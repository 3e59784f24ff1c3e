//! Projections of the scene's objects into a frame's picture.

use glam::{DVec2, DVec3};

use super::outline::outline;
use super::{PosedCamera, Shot, SurfaceError};
use crate::pixels::Rect;
use crate::scene::{Object, Part, Scene, Vertex};

/// An object's projection into a frame's picture, px from the upper left.
#[derive(Clone, Debug, PartialEq)]
pub struct ProjectedObject {
    /// Index into [`Scene::objects`]; [`crate::scene::SceneFile::entries`] has its place in the
    /// scene file.
    pub object: usize,
    /// Closed polygons around the visible part: its border, and those of holes. Empty outside the
    /// picture.
    pub outline_px: Vec<Vec<DVec2>>,
    /// The corners of its box, in the order of [`Object::corners_m`]. `None` behind the camera.
    pub corners_px: [Option<DVec2>; 8],
    /// Projection of [`Object::position_m`].
    pub position_px: Option<DVec2>,
}

/// Longest side of a triangle that is drawn straight, px: with an ordinary lens the error is a
/// hundredth px.
const MAX_STRAIGHT_PX: f64 = 24.0;
/// Largest number of halvings of a triangle, and of one that is partly behind the camera.
const MAX_HALVINGS: u32 = 10;
const MAX_HALVINGS_BEHIND: u32 = 7;

impl Shot {
    /// The projections of all objects, with distortion and rolling shutter as they are composited,
    /// at the middle of the exposure and in focus. Occlusion by real objects is not considered.
    pub fn projected_objects(&self, frame: usize) -> Result<Vec<ProjectedObject>, SurfaceError> {
        let eye = self.posed_camera(frame)?;
        Ok((0..self.scene.objects.len()).map(|object| eye.project_object(&self.scene, object)).collect())
    }
}

impl PosedCamera {
    /// Projects an object of the scene.
    ///
    /// # Panics
    /// If the scene has no such object.
    pub fn project_object(&self, scene: &Scene, object: usize) -> ProjectedObject {
        let of = &scene.objects[object];
        let corners_px = of.corners_m(scene).map_or([None; 8], |corners| corners.map(|corner| self.project(corner)));
        ProjectedObject {
            object,
            outline_px: self.outline_px(scene, of),
            corners_px,
            position_px: self.project(of.position_m),
        }
    }

    /// The outline of an object of the scene's meshes, which need not be in the scene's list:
    /// [`ProjectedObject::outline_px`].
    pub fn outline_px(&self, scene: &Scene, of: &Object) -> Vec<Vec<DVec2>> {
        let i = &self.geometry().intrinsics;
        // Closed outside the picture, so that the picture's rim is no edge of the outline.
        let area = Rect::full(i.width_px, i.height_px).grown(4);
        let mut triangles = Vec::new();
        of.placed().for_each(|part| self.project_part(scene, part, &area, &mut triangles));
        outline(&triangles, &area)
    }

    fn project_part(&self, scene: &Scene, part: &Part, area: &Rect, triangles: &mut Vec<[DVec2; 3]>) {
        let Some(mesh) = scene.meshes.get(part.mesh) else { return };
        let corner = |v: &Vertex| {
            let point = part.world_from_mesh.transform_point3(DVec3::from(v.position.map(f64::from)));
            (point, self.project(point))
        };
        let corners: Vec<ProjectedCorner> = mesh.vertices.iter().map(corner).collect();
        for triangle in mesh.indices.chunks_exact(3) {
            self.subdivide([0, 1, 2].map(|k| corners[triangle[k] as usize]), area, 0, triangles);
        }
    }

    /// Halves a triangle until its pieces are straight in the picture, and drops those behind the
    /// camera.
    fn subdivide(&self, triangle: [ProjectedCorner; 3], area: &Rect, halved: u32, out: &mut Vec<[DVec2; 3]>) {
        let side = |k: usize| (triangle[k], triangle[(k + 1) % 3]);
        let longest =
            |length: &dyn Fn(usize) -> f64| (0..3).max_by(|a, b| length(*a).total_cmp(&length(*b))).unwrap_or(0);
        let split = match triangle.map(|(_, px)| px) {
            [None, None, None] => return,
            [Some(a), Some(b), Some(c)] => {
                let px = [a, b, c];
                let (low, high) = (a.min(b).min(c), a.max(b).max(c));
                if high.x < f64::from(area.x0)
                    || high.y < f64::from(area.y0)
                    || low.x > f64::from(area.x1)
                    || low.y > f64::from(area.y1)
                {
                    return;
                }
                let length = |k: usize| self.geometry().displacement_px(px[k], px[(k + 1) % 3]).length();
                let split = longest(&length);
                if halved >= MAX_HALVINGS || length(split) <= MAX_STRAIGHT_PX {
                    return self.add(px, out);
                }
                split
            }
            _ if halved >= MAX_HALVINGS_BEHIND => return,
            _ => longest(&|k| side(k).0.0.distance(side(k).1.0)),
        };
        let ((a, _), (b, _)) = side(split);
        let middle = 0.5 * (a + b);
        let middle = (middle, self.project(middle));
        for from in [split, (split + 1) % 3] {
            let mut half = triangle;
            half[from] = middle;
            self.subdivide(half, area, halved + 1, out);
        }
    }

    /// Adds a triangle; across a 360° picture's seam, at both rims.
    fn add(&self, [a, b, c]: [DVec2; 3], out: &mut Vec<[DVec2; 3]>) {
        let geometry = self.geometry();
        let near = [a, a + geometry.displacement_px(a, b), a + geometry.displacement_px(a, c)];
        out.push(near);
        if geometry.is_equirectangular() {
            let width = DVec2::new(geometry.intrinsics.width_px.into(), 0.0);
            out.extend([near.map(|p| p - width), near.map(|p| p + width)]);
        }
    }
}

/// A point in the world, and its projection.
type ProjectedCorner = (DVec3, Option<DVec2>);
