//! Plots as SVG with colours from the page's style, for light and dark mode.

use std::ops::Range;

use plotters::coord::ranged1d::ValueFormatter;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::{
    ChartBuilder, Circle, Color, IntoDrawingArea, IntoLogRange, LineSeries, PathElement, Polygon, RGBColor, Ranged,
    SVGBackend, TextStyle,
};
use plotters::style::{FontFamily, FontStyle};
use serde::Serialize;

use super::ReportError;
use crate::fit::quantile::upper_median;
use crate::text::short;

/// Width of the drawing, units. Coordinates are integers, so it is at least twice as large as
/// shown.
const WIDTH: u32 = 1840;
const FONT_SIZE: f64 = 31.0;
/// Largest number of points in a line.
const MAX_POINTS: usize = 2000;
/// Smallest range of an axis, by the largest value.
const MIN_RANGE: f64 = 1e-6;

/// Colour of a shape. The page's style maps the colours' codes (page.html).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Ink {
    /// The recorded values.
    Recorded,
    /// The estimated values.
    Found,
    Red,
    Green,
    Blue,
}

/// Letters, axes and grid.
const TEXT: RGBColor = RGBColor(1, 1, 1);
const AXIS: RGBColor = RGBColor(2, 2, 2);
const GRID: RGBColor = RGBColor(3, 3, 3);

impl Ink {
    fn colour(self) -> RGBColor {
        match self {
            Self::Recorded => RGBColor(4, 4, 4),
            Self::Found => RGBColor(5, 5, 5),
            Self::Red => RGBColor(6, 6, 6),
            Self::Green => RGBColor(7, 7, 7),
            Self::Blue => RGBColor(8, 8, 8),
        }
    }
}

/// A series of a plot, as pairs of x and y in the units of the axes.
#[derive(Clone, Debug)]
pub enum ChartShape {
    /// A value per frame; where frames are missing the line is interrupted.
    Line(Vec<(f64, f64)>),
    Dots(Vec<(f64, f64)>),
    /// Begin, end and height of each bar.
    Bars(Vec<(f64, f64, f64)>),
    /// A constant value over a range, with a band of ± σ.
    Level {
        from: f64,
        to: f64,
        value: f64,
        sigma: f64,
    },
}

/// Horizontal axis of a plot.
#[derive(Clone, Debug)]
pub enum XAxis {
    /// The frames of a recording: their number.
    Frames(usize),
    /// Another quantity: label with unit, and range.
    Values(&'static str, Range<f64>),
}

/// A plot of some series over a common horizontal axis; the height is in px.
#[derive(Clone, Debug)]
pub struct Chart {
    pub x_axis: XAxis,
    /// Label of the vertical axis, with its unit.
    pub y: String,
    /// Whether the horizontal axis has labels: in the last of several plots.
    pub labels_x_axis: bool,
    pub is_logarithmic: bool,
    /// Whether the range includes 0.
    pub from_zero: bool,
    pub height: u32,
    pub shapes: Vec<(Ink, ChartShape)>,
}

impl Chart {
    /// The SVG. Its text is not from the recording's files, so it needs no escaping.
    pub fn svg(&self) -> Result<String, ReportError> {
        let mut text = String::new();
        let range = self.range();
        let across = match &self.x_axis {
            XAxis::Frames(frames) => 0.0..(frames.max(&2) - 1) as f64,
            XAxis::Values(_, range) => range.clone(),
        };
        let area = SVGBackend::with_string(&mut text, (WIDTH, self.height)).into_drawing_area();
        let failed = |error: &dyn std::fmt::Display| ReportError::Plot(error.to_string());
        let mut chart = ChartBuilder::on(&area);
        chart.margin_top(14).margin_right(20).y_label_area_size(120);
        chart.x_label_area_size(if self.labels_x_axis { 84 } else { 20 });
        if self.is_logarithmic {
            let built = chart.build_cartesian_2d(across, range.log_scale());
            self.draw(&mut built.map_err(|error| failed(&error))?)?;
        } else {
            let built = chart.build_cartesian_2d(across, range);
            self.draw(&mut built.map_err(|error| failed(&error))?)?;
        }
        area.present().map_err(|error| failed(&error))?;
        drop(chart);
        drop(area);
        // The page gives it its size.
        Ok(text.replacen(&format!("width=\"{WIDTH}\" height=\"{}\" ", self.height), "", 1))
    }

    fn range(&self) -> Range<f64> {
        let values = self.shapes.iter().flat_map(|(_, shape)| match shape {
            ChartShape::Line(points) | ChartShape::Dots(points) => points.iter().map(|point| point.1).collect(),
            ChartShape::Bars(bars) => bars.iter().map(|bar| bar.2).collect(),
            ChartShape::Level { value, sigma, .. } => vec![value - sigma, value + sigma],
        });
        let zero = self.from_zero.then_some(0.0);
        let (low, high) = values
            .chain(zero)
            .filter(|value| value.is_finite() && (!self.is_logarithmic || *value > 0.0))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if low > high {
            return if self.is_logarithmic { 0.1..10.0 } else { 0.0..1.0 };
        }
        if self.is_logarithmic {
            return 0.8 * low..1.25 * high;
        }
        let room = (0.06 * (high - low)).max(MIN_RANGE * high.abs().max(1.0));
        (if self.from_zero && low == 0.0 { 0.0 } else { low - room })..high + room
    }

    fn draw<'a, Y>(
        &self,
        chart: &mut plotters::prelude::ChartContext<
            'a,
            SVGBackend<'_>,
            plotters::prelude::Cartesian2d<RangedCoordf64, Y>,
        >,
    ) -> Result<(), ReportError>
    where
        Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        let failed = |error: &dyn std::fmt::Display| ReportError::Plot(error.to_string());
        let letters = TextStyle::from((FontFamily::SansSerif, FONT_SIZE, FontStyle::Normal)).color(&TEXT);
        let span = self.range();
        let label = |value: &f64| {
            // Rounding errors of zero.
            let is_zero = value.abs() < 1e-9 * (span.end - span.start).abs();
            if is_zero { "0".to_owned() } else { short(*value).replace('-', "−") }
        };
        let mut mesh = chart.configure_mesh();
        mesh.disable_x_mesh().bold_line_style(GRID).light_line_style(GRID.mix(0.0)).axis_style(AXIS);
        mesh.label_style(letters.clone()).axis_desc_style(letters.clone());
        mesh.y_desc(self.y.as_str()).y_labels(5).y_label_formatter(&label);
        let number = |frame: &f64| if frame.fract() == 0.0 { format!("{frame}") } else { String::new() };
        let none = |_: &f64| String::new();
        let plain = |value: &f64| short(*value).replace('-', "−");
        mesh.x_labels(10);
        match &self.x_axis {
            _ if !self.labels_x_axis => mesh.x_label_formatter(&none),
            XAxis::Frames(_) => mesh.x_desc("frame").x_label_formatter(&number),
            XAxis::Values(name, _) => mesh.x_desc(*name).x_label_formatter(&plain),
        };
        mesh.draw().map_err(|error| failed(&error))?;
        for (ink, shape) in &self.shapes {
            let colour = ink.colour();
            match shape {
                ChartShape::Line(points) => {
                    for part in connected(&thinned(points)) {
                        let line = LineSeries::new(part, colour.stroke_width(4));
                        chart.draw_series(line).map_err(|error| failed(&error))?;
                    }
                }
                ChartShape::Dots(points) => {
                    let points = thinned(points);
                    let dots = points.into_iter().map(|at| Circle::new(at, 6, colour.mix(0.7).filled()));
                    chart.draw_series(dots).map_err(|error| failed(&error))?;
                }
                ChartShape::Bars(bars) => {
                    let bar = |(from, to, value): &(f64, f64, f64)| {
                        let corners = vec![(*from, 0.0), (*to, 0.0), (*to, *value), (*from, *value)];
                        Polygon::new(corners, colour.mix(0.7).filled())
                    };
                    chart.draw_series(bars.iter().map(bar)).map_err(|error| failed(&error))?;
                }
                ChartShape::Level { from, to, value, sigma } => {
                    let band =
                        [(*from, value - sigma), (*to, value - sigma), (*to, value + sigma), (*from, value + sigma)];
                    let band = Polygon::new(band.to_vec(), colour.mix(0.22).filled());
                    chart.draw_series([band]).map_err(|error| failed(&error))?;
                    let line = PathElement::new(vec![(*from, *value), (*to, *value)], colour.stroke_width(4));
                    chart.draw_series([line]).map_err(|error| failed(&error))?;
                }
            }
        }
        Ok(())
    }
}

/// At most [`MAX_POINTS`] of the points, evenly spaced.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    points.iter().step_by(points.len().div_ceil(MAX_POINTS).max(1)).copied().collect()
}

/// Splits a line where points are missing: at gaps of at least twice the median distance.
fn connected(points: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
    let max_gap = 2.0 * upper_median(points.windows(2).map(|pair| pair[1].0 - pair[0].0)).unwrap_or(0.0);
    points.chunk_by(|a, b| b.0 - a.0 < max_gap).map(<[_]>::to_vec).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(shapes: Vec<(Ink, ChartShape)>) -> Chart {
        let y = "turn, °".to_owned();
        Chart {
            x_axis: XAxis::Frames(11),
            y,
            labels_x_axis: true,
            is_logarithmic: false,
            from_zero: false,
            height: 300,
            shapes,
        }
    }

    #[test]
    fn line_is_interrupted_where_frames_are_missing() {
        let points: Vec<(f64, f64)> = [0, 1, 2, 6, 7].map(|n| (f64::from(n), 1.0)).to_vec();
        assert_eq!(connected(&points).iter().map(Vec::len).collect::<Vec<_>>(), [3, 2]);
        assert_eq!(connected(&points[..1]).len(), 1);
        assert_eq!(connected(&[]).len(), 0);
        let svg = chart(vec![(Ink::Found, ChartShape::Line(points))]).svg().unwrap();
        assert_eq!(svg.matches("stroke=\"#050505\"").count(), 2, "{svg}");
    }

    #[test]
    fn values_are_drawn_at_their_axis_coordinates() {
        let dots = ChartShape::Dots(vec![(0.0, 0.0), (5.0, 5.0), (10.0, 10.0)]);
        let svg = chart(vec![(Ink::Red, dots)]).svg().unwrap();
        let places = |name: &str| -> Vec<f64> {
            let circles = svg.split("<circle").skip(1);
            let attribute =
                |text: &str| text.split(&format!("{name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse();
            circles.map(|text| attribute(text).unwrap()).collect()
        };
        let (x, y) = (places("cx"), places("cy"));
        // From the labels' area to the margin, and in the middle between.
        assert_eq!((x[0], x[2]), (120.0, f64::from(WIDTH) - 21.0));
        assert!((x[1] - 0.5 * (x[0] + x[2])).abs() <= 1.0 && (y[1] - 0.5 * (y[0] + y[2])).abs() <= 1.0, "{x:?} {y:?}");
        assert!(y[0] > y[2], "upwards");
        assert!(svg.contains("turn, °") && svg.contains("frame"));
    }

    #[test]
    fn bars_extend_from_zero_to_their_values() {
        let bars = ChartShape::Bars(vec![(0.0, 1.0, 4.0), (1.0, 2.0, 2.0)]);
        let x_axis = XAxis::Values("σ, px", 0.0..2.0);
        let svg = Chart { x_axis, from_zero: true, ..chart(vec![(Ink::Found, bars)]) }.svg().unwrap();
        let corners = |n: usize| -> Vec<Vec<f64>> {
            let text = svg.split("<polygon").nth(n + 1).unwrap().split("points=\"").nth(1).unwrap();
            let pairs = text.split('"').next().unwrap().split_whitespace();
            pairs.map(|pair| pair.split(',').map(|v| v.parse().unwrap()).collect()).collect()
        };
        let (first, second) = (corners(0), corners(1));
        assert_eq!((first[0][0], first[1][0], second[0][0]), (120.0, second[0][0], first[1][0]));
        // Twice as high above the same floor.
        let high = |bar: &[Vec<f64>]| bar[0][1] - bar[2][1];
        assert!((high(&first) / high(&second) - 2.0).abs() < 0.03 && first[0][1] == second[0][1], "{svg}");
        assert!(svg.contains("σ, px"));
    }

    #[test]
    fn empty_and_non_finite_values_do_not_panic() {
        for values in [vec![], vec![(0.0, f64::NAN)], vec![(3.0, 5.0)], vec![(0.0, 1e300), (1.0, -1e300)]] {
            for is_logarithmic in [false, true] {
                let shapes = vec![(Ink::Blue, ChartShape::Dots(values.clone()))];
                Chart { is_logarithmic, ..chart(shapes) }.svg().unwrap();
            }
        }
        Chart { x_axis: XAxis::Frames(0), ..chart(Vec::new()) }.svg().unwrap();
    }
}
