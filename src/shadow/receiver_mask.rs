//! Weight of a planar shadow on a facet: 1 within its rectangle, except near another real surface
//! with a planar shadow of its own.
//!
//! Near a corner of the room a pixel is equally close to two planes, within the error of depth, and
//! would be darkened twice. Points near a surface of higher priority therefore belong to that one,
//! by its weight there (`weight_around` in shaders/shadow_mask.wgsl). Beyond 1.9 m, where the error
//! of depth exceeds `TOLERANCE_M`, both apply in a part of the transition.

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::extent::Extent;
use super::receiver_plane::ReceiverPlane;
use crate::depth::PLANE_TOLERANCE_M;
use crate::digest::digestible;
use crate::plane::Plane;
use crate::scene::{Facet, Object};

/// Width over which the rectangle's sides fade out, m.
const FADE_M: f32 = 0.01;
/// Distance from a surface up to which it applies fully, m; at three times the distance it no
/// longer applies.
const TOLERANCE_M: f32 = PLANE_TOLERANCE_M as f32;

/// Weights of a shadow on a facet, in the axes of the facet's plane.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceiverMask {
    own: Rectangle,
    prior: Vec<PriorSurface>,
}

/// A rectangle in the plane, with coordinates x = `x.truncate() · place + x.z` and y alike.
#[derive(Clone, Debug, PartialEq)]
struct Rectangle {
    x: Vec3,
    y: Vec3,
    low: Vec2,
    high: Vec2,
}

/// A surface of higher priority: a point's height above it, as such a linear function, and its
/// rectangle.
#[derive(Clone, Debug, PartialEq)]
struct PriorSurface {
    height: Vec3,
    rectangle: Option<Rectangle>,
}

digestible! {
    ReceiverMask { own, prior }
    Rectangle { x, y, low, high }
    PriorSurface { height, rectangle }
}

impl ReceiverMask {
    /// The mask of an object's facet, by the facet's index.
    pub fn new(object: &Object, facet: usize, plane: &ReceiverPlane) -> Self {
        let prior = object.facets[..facet].iter().map(|facet| PriorSurface {
            height: height(&facet.plane, plane),
            rectangle: Some(Rectangle::new(facet, plane)),
        });
        let support =
            object.support.iter().map(|support| PriorSurface { height: height(support, plane), rectangle: None });
        Self { own: Rectangle::new(&object.facets[facet], plane), prior: support.chain(prior).collect() }
    }

    /// Weight of the planar shadow at a point, 0 to 1.
    pub fn weight(&self, place_m: Vec2) -> f32 {
        let remaining = |surface: &PriorSurface| {
            let height_m = linear_at(surface.height, place_m).abs();
            let near = (1.5 - 0.5 * height_m / TOLERANCE_M).clamp(0.0, 1.0);
            1.0 - near * surface.rectangle.as_ref().map_or(1.0, |rectangle| rectangle.weight(place_m))
        };
        self.own.weight(place_m) * self.prior.iter().map(remaining).product::<f32>()
    }

    /// True if a ray from a place in front of the facet hits it, in the plane's axes.
    pub fn is_hit(&self, from: Vec3, towards: Vec3) -> bool {
        towards.z < 0.0 && self.own.weight((from - towards * (from.z / towards.z)).truncate()) > 0.5
    }

    /// The part of an extent in the rectangle or in `under`, the place of the object, with a margin
    /// in which a planar shadow fades out.
    pub fn clip(&self, extent: Extent, under: Extent) -> Extent {
        let own = self.own.bounds().union(under);
        let margin = 0.1 * (own.high - own.low);
        Extent { low: extent.low.max(own.low - margin), high: extent.high.min(own.high + margin) }
    }
}

impl Rectangle {
    /// A facet's rectangle as a function of places on the plane of `floor`, its own or another one.
    fn new(facet: &Facet, plane: &ReceiverPlane) -> Self {
        let axis = |along: DVec3| {
            let off = along.dot(plane.origin_m - facet.plane.point_m);
            DVec3::new(along.dot(plane.axes.x_axis), along.dot(plane.axes.y_axis), off).as_vec3()
        };
        let [low, high] = [facet.low_m, facet.high_m].map(|side: DVec2| side.as_vec2());
        Self { x: axis(facet.along), y: axis(facet.plane.normal.cross(facet.along)), low, high }
    }

    fn weight(&self, place_m: Vec2) -> f32 {
        let at = Vec2::new(linear_at(self.x, place_m), linear_at(self.y, place_m));
        let outside = (self.low - at).max(at - self.high).max_element();
        (1.0 - outside / FADE_M).clamp(0.0, 1.0)
    }

    fn bounds(&self) -> Extent {
        let (x, y) = (self.x.truncate(), self.y.truncate());
        let middle = 0.5 * (self.low + self.high);
        let corner = |at: Vec2| x * (at.x - self.x.z) + y * (at.y - self.y.z);
        let half = 0.5 * (self.high - self.low) + FADE_M;
        let reach = x.abs() * half.x + y.abs() * half.y;
        Extent { low: corner(middle) - reach, high: corner(middle) + reach }
    }
}

/// Height of places on a floor above a plane, as a linear function.
fn height(surface: &Plane, plane: &ReceiverPlane) -> Vec3 {
    let ReceiverPlane { origin_m, axes } = plane;
    let over = surface.height_m(*origin_m);
    DVec3::new(surface.normal.dot(axes.x_axis), surface.normal.dot(axes.y_axis), over).as_vec3()
}

/// The value of a linear function at a place.
fn linear_at(by: Vec3, place_m: Vec2) -> f32 {
    by.truncate().dot(place_m) + by.z
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall at x = 0.2 m that faces left, 0.4 m wide and high. In front of it the top of a box at
    /// z = 0.1 m.
    fn corner() -> Object {
        let on = |point_m: DVec3, normal: DVec3| Plane { point_m, normal };
        let facet = |plane: Plane, along: DVec3, half: f64| Facet {
            plane,
            along,
            low_m: DVec2::splat(-half),
            high_m: DVec2::splat(half),
        };
        Object {
            support: Some(on(DVec3::ZERO, DVec3::Z)),
            facets: vec![
                facet(on(DVec3::new(0.1, 0.0, 0.1), DVec3::Z), DVec3::X, 0.1),
                facet(on(DVec3::new(0.2, 0.0, 0.2), DVec3::NEG_X), DVec3::Y, 0.2),
            ],
            ..Object::default()
        }
    }

    #[test]
    fn weight_is_1_in_the_rectangle_and_0_near_surfaces_of_higher_priority() {
        let object = corner();
        let plane = ReceiverPlane::new(DVec3::new(0.2, -0.05, 0.3), DVec3::NEG_X);
        let mask = ReceiverMask::new(&object, 1, &plane);
        let weight = |y: f64, z: f64| {
            let place = plane.plane_from_world().transform_point3(DVec3::new(0.2, y, z));
            assert!(place.z.abs() < 1e-12);
            mask.weight(place.truncate().as_vec2())
        };
        let near = |actual: f32, expected: f32| (actual - expected).abs() < 1e-4;
        assert!(near(weight(0.0, 0.3), 1.0) && near(weight(0.15, 0.06), 1.0));
        // Points up to 15 mm above the floor belong to it, from 45 mm on to the wall.
        assert!(near(weight(0.15, 0.01), 0.0) && near(weight(0.15, 0.03), 0.5));
        // The box's top at y from -0.1 to 0.1.
        assert!(near(weight(0.0, 0.1), 0.0) && near(weight(0.0, 0.13), 0.5) && near(weight(0.15, 0.1), 1.0));
        // Outside the rectangle the weight falls to 0 within a centimetre.
        assert!(near(weight(0.205, 0.3), 0.5) && near(weight(0.22, 0.3), 0.0) && near(weight(0.0, 0.405), 0.5));
    }

    #[test]
    fn extent_is_clipped_to_the_rectangle_and_the_object() {
        let object = corner();
        let plane = ReceiverPlane::new(DVec3::new(0.2, -0.05, 0.3), DVec3::NEG_X);
        let mask = ReceiverMask::new(&object, 1, &plane);
        let at = |y: f64, z: f64| plane.plane_from_world().transform_point3(DVec3::new(0.2, y, z)).truncate().as_vec2();
        let bounds = |a: Vec2, b: Vec2| Extent { low: a.min(b), high: a.max(b) };
        let wide = Extent { low: Vec2::splat(-9.0), high: Vec2::splat(9.0) };
        let own = bounds(at(-0.21, -0.01), at(0.21, 0.41));
        let clipped = mask.clip(wide, own);
        let margin = Vec2::splat(0.042);
        assert!(clipped.low.abs_diff_eq(own.low - margin, 1e-5) && clipped.high.abs_diff_eq(own.high + margin, 1e-5));
        let beside = bounds(at(0.3, 0.0), at(0.5, 0.1));
        let clipped = mask.clip(wide, beside);
        assert!(clipped.low.cmplt(beside.low).all() && clipped.high.cmpgt(beside.high).all());
        let narrow = Extent { low: Vec2::splat(-0.01), high: Vec2::splat(0.01) };
        assert_eq!(mask.clip(narrow, own), narrow);
    }
}
