//! A lens's table as text: numbers separated by spaces.

use std::fmt::Write;

use glam::DVec2;

use super::{LensMap, MapCamera, MapTable, ORDER};
use crate::params::{Field, Kind, Value};

/// Largest number of cells along a side.
const MAX_CELLS: usize = 1024;
/// Numbers before the control points.
const HEADER: usize = 16;

impl LensMap {
    /// The sizes of the pictures (0 if the recorded one's is open), the domain, the cells, the
    /// camera (0 without), and the control points.
    fn to_text(&self) -> String {
        let MapTable { undistorted_px, recorded_px, low_px, high_px, cells, controls } = &*self.table;
        let camera = self.binding.as_ref().map_or([0.0; 6], |(camera, _)| {
            let MapCamera { size_px, focal_px, principal_px } = camera;
            [size_px.x, size_px.y, focal_px.x, focal_px.y, principal_px.x, principal_px.y]
        });
        let sizes = undistorted_px.iter().chain(recorded_px.as_ref().unwrap_or(&[0; 2])).map(|side| f64::from(*side));
        let domain = low_px.to_array().into_iter().chain(high_px.to_array());
        let numbers = sizes.chain(domain).chain(cells.map(|count| count as f64)).chain(camera);
        let mut text = String::new();
        for number in numbers.chain(controls.iter().flat_map(|control| control.to_array())) {
            let separator = if text.is_empty() { "" } else { " " };
            // Writing into a string cannot fail. The shortest text of a number preserves its bits.
            let _ = write!(text, "{separator}{number}");
        }
        text
    }

    fn parse(text: &str) -> Option<Self> {
        let numbers: Vec<f64> = text.split_whitespace().map(str::parse).collect::<Result<_, _>>().ok()?;
        let (header, controls) = numbers.split_first_chunk::<HEADER>()?;
        let [uw, uh, rw, rh, x0, y0, x1, y1, columns, rows, camera @ ..] = *header;
        let side = |number: f64| (number.fract() == 0.0 && (1.0..=65536.0).contains(&number)).then_some(number as u32);
        let count = |number: f64| side(number).map(|cells| cells as usize).filter(|cells| *cells <= MAX_CELLS);
        let cells = [count(columns)?, count(rows)?];
        let (controls, rest) = controls.as_chunks::<2>();
        let is_complete = rest.is_empty() && controls.len() == (cells[0] + ORDER) * (cells[1] + ORDER);
        let is_finite = numbers.iter().all(|number| number.abs() < 1e9);
        if !is_complete || !is_finite || x0 >= x1 || y0 >= y1 {
            return None;
        }
        let mut map = Self::new(MapTable {
            undistorted_px: [side(uw)?, side(uh)?],
            recorded_px: if [rw, rh] == [0.0; 2] { None } else { Some([side(rw)?, side(rh)?]) },
            low_px: DVec2::new(x0, y0),
            high_px: DVec2::new(x1, y1),
            cells,
            controls: controls.iter().map(|control| DVec2::from(*control)).collect(),
        });
        if camera != [0.0; 6] {
            let [width, height, fx, fy, cx, cy] = camera;
            if camera[..4].iter().any(|length| *length <= 0.0) {
                return None;
            }
            let [size_px, focal_px, principal_px] = [[width, height], [fx, fy], [cx, cy]].map(DVec2::from);
            let binding = MapCamera { size_px, focal_px, principal_px };
            map.binding = Some((binding, map.table.bound(&binding).into()));
        }
        Some(map)
    }
}

impl Field for LensMap {
    fn kind(_: Option<(f64, f64)>) -> Kind {
        Kind::LensTable
    }

    fn to_value(&self) -> Value {
        Value::Text(self.to_text())
    }

    fn from_value(value: &Value, _: &Kind) -> Option<Self> {
        match value {
            Value::Text(text) => Self::parse(text),
            _ => None,
        }
    }
}
