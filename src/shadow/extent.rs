//! The rectangle of a plane in which an object's shadow is visible: where the object's bounding box
//! blocks more than a small fraction of the light.

use glam::{Vec2, Vec3};

use super::sky::PlaneLighting;
use crate::digest::digestible;

/// Smallest visible fraction of blocked light, after the fade at the planar shadow's border: less
/// than a code of a mid-grey floor.
const MIN_SHADOW: f32 = 0.005;
/// Distances from the box of the samples of its shadow, in heights.
const SAMPLE_DISTANCES: [f32; 19] =
    [0.1, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 16.0, 20.0];
/// Intervals between samples along the box.
const INTERVALS_ALONG: usize = 4;

/// A rectangle on the plane, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    pub low: Vec2,
    pub high: Vec2,
}

digestible! { Extent { low, high } }

impl Extent {
    pub fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    pub fn overlaps(&self, other: &Self) -> bool {
        self.low.cmplt(other.high).all() && other.low.cmplt(self.high).all()
    }

    /// The extent of the shadow of a box on the plane from `low` to `high`, with a height.
    pub fn of(low: Vec2, high: Vec2, height: f32, sky: &PlaneLighting) -> Self {
        // Flat objects have a margin too.
        let step = height.max(0.05 * (high - low).max_element()).max(1e-4);
        let [xs, ys] = [(low.x, high.x), (low.y, high.y)].map(|(low, high)| sample_coordinates(low, high, step));
        let mut extent = Self { low, high };
        for (row, y) in ys.iter().enumerate() {
            for (column, x) in xs.iter().enumerate() {
                if blocked_fraction(Vec2::new(*x, *y), low, high, height, sky) <= MIN_SHADOW {
                    continue;
                }
                // Half-way to the next sample, which has no shadow.
                let next = |list: &[f32], at: usize| {
                    let halfway = |next: usize| 0.5 * (list[at] + list[next]);
                    (halfway(at.saturating_sub(1)), halfway((at + 1).min(list.len() - 1)))
                };
                let ((left, right), (top, bottom)) = (next(&xs, column), next(&ys, row));
                extent = extent.union(Self { low: Vec2::new(left, top), high: Vec2::new(right, bottom) });
            }
        }
        extent
    }
}

fn sample_coordinates(low: f32, high: f32, step: f32) -> Vec<f32> {
    let before = SAMPLE_DISTANCES.iter().rev().map(|far| low - far * step);
    let along = (0..=INTERVALS_ALONG).map(|i| low + (high - low) * i as f32 / INTERVALS_ALONG as f32);
    before.chain(along).chain(SAMPLE_DISTANCES.iter().map(|far| high + far * step)).collect()
}

/// Fraction of the light at a place that the box blocks.
fn blocked_fraction(at: Vec2, low: Vec2, high: Vec2, height: f32, sky: &PlaneLighting) -> f32 {
    let is_blocked = |slope: Vec2| hits_box(at, slope, low, high, height);
    let mut all = sky.light.element_sum();
    let mut blocked: f32 = sky.rays.iter().filter(|ray| is_blocked(ray.slope)).map(|ray| ray.light.element_sum()).sum();
    for lamp in &sky.lamps {
        let light = lamp.light_at(at).element_sum();
        let share = light / lamp.points_m.len() as f32;
        all += light;
        blocked += share * lamp.points_m.iter().filter(|point| is_blocked(slope_to(at, **point))).count() as f32;
    }
    if all > 0.0 { blocked / all } else { 0.0 }
}

/// Horizontal offset for each metre of height, from a place on the plane to a point.
fn slope_to(at: Vec2, point: Vec3) -> Vec2 {
    (point.truncate() - at) / point.z
}

/// True if a ray from a place on the plane hits the box.
fn hits_box(at: Vec2, slope: Vec2, low: Vec2, high: Vec2, height: f32) -> bool {
    let (mut from, mut to) = (0.0f32, height);
    for axis in 0..2 {
        let (at, slope, low, high) = (at[axis], slope[axis], low[axis], high[axis]);
        if slope.abs() < 1e-6 {
            if at < low || at > high {
                return false;
            }
            continue;
        }
        let (a, b) = ((low - at) / slope, (high - at) / slope);
        (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
    }
    from <= to
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Environment, Lighting, Sun};
    use crate::shadow::ReceiverPlane;
    use crate::shadow::sky::{EnvironmentImage, rays};
    use glam::DVec3;

    fn sky(suns: Vec<Sun>, radiance: f32) -> PlaneLighting {
        let environment = Environment::Uniform(Vec3::splat(radiance));
        let lighting = Lighting { suns, points: Vec::new(), environment };
        let plane = ReceiverPlane::new(DVec3::ZERO, DVec3::Z);
        PlaneLighting::new(
            &lighting,
            rays(&lighting, &EnvironmentImage::new(&lighting.environment), &plane),
            &plane,
            None,
        )
    }

    #[test]
    fn shadow_of_a_uniform_sky_extends_by_a_few_heights() {
        let (low, high) = (Vec2::splat(-0.05), Vec2::splat(0.05));
        let extent = Extent::of(low, high, 0.1, &sky(Vec::new(), 1.0));
        // (w h² / (2π ε))^⅓ from the centre: 0.32 m for a width and a height of 0.1 m.
        let reach = 0.5 * (extent.high - extent.low);
        assert!(reach.min_element() > 0.3 && reach.max_element() < 0.6, "{extent:?}");
    }

    #[test]
    fn shadow_of_a_low_sun_is_long_on_one_side() {
        let towards = ReceiverPlane::new(DVec3::ZERO, DVec3::Z).axes.as_mat3() * Vec3::new(4.0, 0.0, 1.0).normalize();
        let sun = Sun { towards_light_in_world: towards, color: Vec3::ONE, diameter_rad: 0.01 };
        let extent = Extent::of(Vec2::splat(-0.05), Vec2::splat(0.05), 0.1, &sky(vec![sun], 0.0));
        assert!(extent.low.x < -0.45 && extent.low.x > -0.8, "{extent:?}");
        assert!(extent.high.x < 0.1 && extent.high.y < 0.1 && extent.low.y > -0.1, "{extent:?}");
    }
}
