//! The window's size at the start: no larger than the screen.

use eframe::egui::{Context, Vec2, ViewportCommand};

/// So long after the start the window's own border may become known, s.
const BEGINS_S: f64 = 2.0;

/// Makes a window that has just been opened smaller, if it reaches beyond its screen with its border.
pub fn to_screen(ctx: &Context) {
    let (time_s, (screen, inner, outer)) = ctx.input(|i| {
        let window = i.viewport();
        (i.time, (window.monitor_size, window.inner_rect, window.outer_rect))
    });
    if let (true, Some(screen), Some(inner), Some(outer)) = (time_s < BEGINS_S, screen, inner, outer)
        && let Some(size) = fitting(screen, inner.size(), outer.size())
    {
        ctx.send_viewport_cmd(ViewportCommand::InnerSize(size));
    }
}

/// The inner size with which a window fits, if it does not.
fn fitting(screen: Vec2, inner: Vec2, outer: Vec2) -> Option<Vec2> {
    let fits = inner.min(screen - (outer - inner).max(Vec2::ZERO));
    (fits.min_elem() > 0.0 && (inner - fits).max_elem() > 0.5).then_some(fits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::vec2;

    #[test]
    fn a_window_with_its_border_fits_the_screen() {
        let border = vec2(2.0, 24.0);
        let of = |screen: Vec2, inner: Vec2| fitting(screen, inner, inner + border);
        assert_eq!(of(vec2(1280.0, 720.0), vec2(1280.0, 800.0)), Some(vec2(1278.0, 696.0)));
        assert_eq!(of(vec2(1920.0, 1080.0), vec2(1280.0, 800.0)), None);
        assert_eq!(of(vec2(1280.0, 720.0), vec2(1278.0, 696.0)), None);
        assert_eq!(of(Vec2::ZERO, vec2(1280.0, 800.0)), None);
    }
}
