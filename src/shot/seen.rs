//! Where the objects are in a frame's picture.

use glam::{DVec2, DVec3};

use super::outline::outline;
use super::{Eye, Shot, SurfaceError};
use crate::pixels::Rect;
use crate::scene::{Object, Part, Scene, Vertex};

/// An object in a frame's picture, px from the upper left.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenObject {
    /// Index into [`Scene::objects`]; [`crate::scene::SceneFile::entries`] has its place in the scene file.
    pub object: usize,
    /// Closed polygons around what is in the picture: its border, and that of each hole. Empty if nothing is.
    pub outline_px: Vec<Vec<DVec2>>,
    /// The corners of its box, as [`Object::corners_m`] has them. `None` behind the camera.
    pub corners_px: [Option<DVec2>; 8],
    /// Of [`Object::position_m`].
    pub position_px: Option<DVec2>,
}

/// A side of a triangle is straight in the picture up to this length: with an ordinary lens to a hundredth px.
const STRAIGHT_PX: f64 = 24.0;
/// A triangle is halved so many times at most; one that passes the camera, fewer times.
const MOST_HALVED: u32 = 10;
const MOST_HALVED_PASSING: u32 = 7;

impl Shot {
    /// Every object of the scene in a frame's picture, with distortion and rolling shutter as it is composited, at the middle
    /// of the exposure and in focus. What is real hides nothing here.
    pub fn seen_at(&self, frame: usize) -> Result<Vec<SeenObject>, SurfaceError> {
        let eye = self.eye(frame)?;
        Ok((0..self.scene.objects.len()).map(|object| eye.seen(&self.scene, object)).collect())
    }
}

impl Eye {
    /// An object of the scene as it is seen.
    ///
    /// # Panics
    /// If the scene has no such object.
    pub fn seen(&self, scene: &Scene, object: usize) -> SeenObject {
        let of = &scene.objects[object];
        let corners_px = of.corners_m(scene).map_or([None; 8], |corners| corners.map(|corner| self.project(corner)));
        SeenObject {
            object,
            outline_px: self.outline_px(scene, of),
            corners_px,
            position_px: self.project(of.position_m),
        }
    }

    /// The border of an object of the scene's meshes, which need not be one of the scene's: [`SeenObject::outline_px`].
    pub fn outline_px(&self, scene: &Scene, of: &Object) -> Vec<Vec<DVec2>> {
        let i = &self.geometry().intrinsics;
        // Closed beyond the picture, so that its rim is no side of the object.
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
        let corners: Vec<Corner> = mesh.vertices.iter().map(corner).collect();
        for triangle in mesh.indices.chunks_exact(3) {
            self.cut([0, 1, 2].map(|k| corners[triangle[k] as usize]), area, 0, triangles);
        }
    }

    /// Halves a triangle until its pieces are straight in the picture, and drops what is not before the camera.
    fn cut(&self, triangle: [Corner; 3], area: &Rect, halved: u32, out: &mut Vec<[DVec2; 3]>) {
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
                let length = |k: usize| self.geometry().way_px(px[k], px[(k + 1) % 3]).length();
                let split = longest(&length);
                if halved >= MOST_HALVED || length(split) <= STRAIGHT_PX {
                    return self.keep(px, out);
                }
                split
            }
            _ if halved >= MOST_HALVED_PASSING => return,
            _ => longest(&|k| side(k).0.0.distance(side(k).1.0)),
        };
        let ((a, _), (b, _)) = side(split);
        let middle = 0.5 * (a + b);
        let middle = (middle, self.project(middle));
        for from in [split, (split + 1) % 3] {
            let mut half = triangle;
            half[from] = middle;
            self.cut(half, area, halved + 1, out);
        }
    }

    /// Across a 360° picture's seam there are two pieces.
    fn keep(&self, [a, b, c]: [DVec2; 3], out: &mut Vec<[DVec2; 3]>) {
        let geometry = self.geometry();
        let near = [a, a + geometry.way_px(a, b), a + geometry.way_px(a, c)];
        out.push(near);
        if geometry.is_round() {
            let width = DVec2::new(geometry.intrinsics.width_px.into(), 0.0);
            out.extend([near.map(|p| p - width), near.map(|p| p + width)]);
        }
    }
}

/// In the world, and where it is seen.
type Corner = (DVec3, Option<DVec2>);
