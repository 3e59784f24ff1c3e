//! The charts that were made last: for the same things, and for floors that have moved a little.

use super::chart::Chart;
use super::floor::Floor;
use crate::scene::{Object, Scene};

/// A chart may be of another floor that differs less: cosine of its tilt (10°), and metres.
const NEAR_TILT: f64 = 0.985;
const NEAR_HEIGHT_M: f64 = 0.03;

/// The objects that were asked for last, and their charts, each with the numbers of the objects that share a floor.
#[derive(Debug)]
pub struct Last {
    objects: Vec<Object>,
    charts: Vec<(Chart, Vec<usize>)>,
}

impl Last {
    pub fn new(objects: Vec<Object>, charts: Vec<(Chart, Vec<usize>)>) -> Self {
        Self { objects, charts }
    }

    pub fn charts(&self) -> Vec<Chart> {
        self.charts.iter().map(|(chart, _)| chart.clone()).collect()
    }

    /// The charts, if these are the objects.
    pub fn of(&self, objects: &[Object]) -> Option<Vec<Chart>> {
        (self.objects == objects).then(|| self.charts())
    }

    /// The charts moved to floors that are a little different, with nothing else changed. Those beside stay where they were.
    pub fn on_floors_of(&self, scene: &Scene) -> Option<Vec<Chart>> {
        let is_same =
            |(a, b): (&Object, &Object)| Object { support: b.support, facets: b.facets.clone(), ..a.clone() } == *b;
        if self.objects.len() != scene.objects.len() || !self.objects.iter().zip(&scene.objects).all(is_same) {
            return None;
        }
        let on_floor = |(chart, members): &(Chart, Vec<usize>)| {
            if chart.is_beside {
                return Some(chart.clone());
            }
            let first = &scene.objects[*members.first()?];
            let floor = Floor::below(&first.support?, &first.parts.first()?.world_from_mesh)?;
            let tilt = chart.floor.normal().dot(floor.normal());
            let is_near = tilt > NEAR_TILT && chart.floor.height_m(floor.origin_m).abs() < NEAR_HEIGHT_M;
            is_near.then(|| Chart { floor, ..chart.clone() })
        };
        self.charts.iter().map(on_floor).collect()
    }
}
