//! Light and dark themes: egui's own, with legible text colours and sizes.

use eframe::egui::style::Visuals;
use eframe::egui::{Color32, Context, FontId, Rgba, TextStyle, Theme};

/// Smallest text size, points.
pub const MIN_TEXT_PT: f32 = 11.0;

/// Installs both themes. Secondary texts, warnings and errors have a contrast of at least 4.5 to
/// their background, as WCAG 2.2 (1.4.3) requires of small text.
pub fn install(ctx: &Context) {
    for theme in [Theme::Light, Theme::Dark] {
        ctx.style_mut_of(theme, |style| {
            readable(&mut style.visuals);
            style.text_styles.insert(TextStyle::Small, FontId::proportional(MIN_TEXT_PT));
        });
    }
}

/// Toggles between the light and the dark theme.
pub fn toggle(ctx: &Context) {
    let dark = ctx.global_style().visuals.dark_mode;
    ctx.set_theme(if dark { Theme::Light } else { Theme::Dark });
}

/// Display colour of linear light, normalized to its largest channel.
pub fn of_light(rgb: [f64; 3]) -> Color32 {
    let most = rgb.into_iter().fold(f64::MIN_POSITIVE, f64::max);
    let [r, g, b] = rgb.map(|c| (c / most) as f32);
    Rgba::from_rgb(r, g, b).into()
}

fn readable(visuals: &mut Visuals) {
    if visuals.dark_mode {
        visuals.widgets.noninteractive.fg_stroke.color = Color32::from_gray(175);
        visuals.weak_text_color = Some(Color32::from_gray(140));
        visuals.error_fg_color = Color32::from_rgb(255, 110, 100);
    } else {
        visuals.weak_text_color = Some(Color32::from_gray(98));
        visuals.warn_fg_color = Color32::from_rgb(160, 65, 0);
        visuals.error_fg_color = Color32::from_rgb(185, 0, 0);
        visuals.hyperlink_color = Color32::from_rgb(0, 90, 180);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance, WCAG 2.2.
    fn luminance(color: Color32) -> f64 {
        let light = |code: u8| {
            let c = f64::from(code) / 255.0;
            if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * light(color.r()) + 0.7152 * light(color.g()) + 0.0722 * light(color.b())
    }

    fn contrast(a: Color32, b: Color32) -> f64 {
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn text_contrast_meets_wcag() {
        assert!((contrast(Color32::WHITE, Color32::BLACK) - 21.0).abs() < 1e-9);
        for mut visuals in [Visuals::light(), Visuals::dark()] {
            readable(&mut visuals);
            let texts = [
                visuals.text_color(),
                visuals.weak_text_color(),
                visuals.warn_fg_color,
                visuals.error_fg_color,
                visuals.hyperlink_color,
            ];
            for text in texts {
                for ground in [visuals.panel_fill, visuals.window_fill, visuals.extreme_bg_color] {
                    let ratio = contrast(text, ground);
                    assert!(ratio >= 4.5, "{text:?} on {ground:?}: {ratio:.2}");
                }
            }
        }
    }
}
