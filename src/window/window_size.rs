//! Limits the initial size of the window to the screen.

use eframe::egui::{Context, Vec2, ViewportCommand};

/// Time after the start within which the size of the window's border becomes known, s.
const STARTUP_S: f64 = 2.0;

/// Shrinks a newly opened window that exceeds its screen including its border.
pub fn fit_to_screen(ctx: &Context) {
    let (time_s, (screen, inner, outer)) = ctx.input(|i| {
        let window = i.viewport();
        (i.time, (window.monitor_size, window.inner_rect, window.outer_rect))
    });
    if let (true, Some(screen), Some(inner), Some(outer)) = (time_s < STARTUP_S, screen, inner, outer)
        && let Some(size) = fitting(screen, inner.size(), outer.size())
    {
        ctx.send_viewport_cmd(ViewportCommand::InnerSize(size));
    }
}

/// Inner size with which the window fits the screen; `None` if it fits already.
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
        let fitting_size = |screen: Vec2, inner: Vec2| fitting(screen, inner, inner + border);
        assert_eq!(fitting_size(vec2(1280.0, 720.0), vec2(1280.0, 800.0)), Some(vec2(1278.0, 696.0)));
        assert_eq!(fitting_size(vec2(1920.0, 1080.0), vec2(1280.0, 800.0)), None);
        assert_eq!(fitting_size(vec2(1280.0, 720.0), vec2(1278.0, 696.0)), None);
        assert_eq!(fitting_size(Vec2::ZERO, vec2(1280.0, 800.0)), None);
    }
}
