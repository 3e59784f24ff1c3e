//! Plot of a calibration's residuals: shows where the model does not fit, and where there are no
//! corners.

use glam::DVec2;
use image::{Rgb, RgbImage};

use super::calibration::CameraCalibration;
use crate::pixels::{Codes, Pixels};
use crate::sink::lettering::{Style, line, width_px, write};
use crate::text::{count, fixed, number};

/// Length of the longer side, px, without the legend below.
const PLOT_SIZE_PX: f64 = 1400.0;
const LEGEND_PX: u32 = 40;
const BACKGROUND: Rgb<u8> = Rgb([250; 3]);
const FRAME: Rgb<u8> = Rgb([190; 3]);
const LETTERS: Style = Style { height_px: 22.0, ink: Rgb([40; 3]) };
/// Length of a residual of typical size in the plot, px.
const TYPICAL_LENGTH_PX: f64 = 18.0;

/// Draws each corner's residual as a line from the detected corner, magnified, in the colour of its
/// view.
pub fn residuals(calibrated: &CameraCalibration) -> Pixels {
    let of = &calibrated.geometry.intrinsics;
    let size = DVec2::new(of.width_px.into(), of.height_px.into());
    let scale = PLOT_SIZE_PX / size.max_element();
    let (width, height) = ((scale * size.x).round().max(1.0) as u32, (scale * size.y).round().max(1.0) as u32);
    let mut sheet = RgbImage::from_pixel(width, height + LEGEND_PX, BACKGROUND);
    let (right, bottom) = (f64::from(width) - 0.5, f64::from(height) - 0.5);
    let rim = [(0.5, 0.5), (right, 0.5), (right, bottom), (0.5, bottom), (0.5, 0.5)].map(DVec2::from);
    rim.windows(2).for_each(|ends| line(&mut sheet, ends[0], ends[1], 1.0, FRAME));
    let centre = scale * DVec2::new(of.cx_px, of.cy_px);
    for arm in [DVec2::X, DVec2::Y] {
        line(&mut sheet, centre - 9.0 * arm, centre + 9.0 * arm, 1.5, LETTERS.ink);
    }
    let enlarged = round(TYPICAL_LENGTH_PX / calibrated.rms_px.max(1e-6));
    for (n, (view, residuals)) in calibrated.views.iter().zip(&calibrated.residuals_px).enumerate() {
        let color = color(n);
        for (at, residual) in view.detection.corners_px.iter().zip(residuals) {
            let at = scale * *at;
            line(&mut sheet, at, at, 4.0, color);
            line(&mut sheet, at, at + enlarged * *residual, 1.5, color);
        }
    }
    let top = f64::from(height) + 0.5 * f64::from(LEGEND_PX);
    let bar_px = round(60.0 / enlarged);
    line(&mut sheet, DVec2::new(16.0, top), DVec2::new(16.0 + enlarged * bar_px, top), 2.0, LETTERS.ink);
    let text = format!(
        "{} px, residuals {}-fold; rms {} px, {}; + is the principal point",
        number(bar_px),
        number(enlarged),
        fixed(calibrated.rms_px, 3),
        count(calibrated.views.len(), "view")
    );
    let from = 16.0 + (enlarged * bar_px) as f32 + 12.0;
    // The text is smaller in a narrow plot.
    let room = (width as f32 - from - 8.0).max(1.0);
    let style = Style {
        height_px: (LETTERS.height_px * room / width_px(&text, LETTERS.height_px)).min(LETTERS.height_px),
        ..LETTERS
    };
    write(&mut sheet, (from, height as f32 + 0.5 * (LEGEND_PX as f32 - style.height_px)), width as f32, &text, style);
    let (width, height) = sheet.dimensions();
    Pixels::uncoded(width, height, Codes::U8(sheet.into_raw()))
}

/// Rounds down to 1, 2 or 5 times a power of ten.
fn round(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    [5.0, 2.0].into_iter().find(|step| value >= step * power).unwrap_or(1.0) * power
}

/// Distinct colours for consecutive indices: hues a golden angle apart.
fn color(n: usize) -> Rgb<u8> {
    let hue = (n as f64 * 0.618_034).fract() * 6.0;
    let channel = |shift: f64| {
        let t = (hue + shift).rem_euclid(6.0);
        (190.0 * ((t - 3.0).abs() - 1.0).clamp(0.0, 1.0)) as u8
    };
    Rgb([channel(0.0), channel(4.0), channel(2.0)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_is_rounded_down_to_1_2_or_5() {
        let cases = [(0.7, 0.5), (1.0, 1.0), (4.9, 2.0), (5.0, 5.0), (99.0, 50.0), (230.0, 200.0)];
        for (value, expected) in cases {
            assert!((round(value) - expected).abs() < 1e-12, "{value}: {}", round(value));
        }
        assert_eq!((color(0), color(1) == color(2)), (Rgb([190, 0, 0]), false));
    }
}
