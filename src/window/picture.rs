//! The picture: fitted to the panel or magnified to single pixels, panned by dragging, with a wipe
//! between the camera's own picture and the composite.

use eframe::egui::{self, Color32, Painter, Pos2, Rect, Response, Sense, Stroke, Ui, Vec2, pos2, vec2};

use super::canvas::Canvas;
use super::picture_transform::PictureTransform;
use super::viewer::{DisplayTexture, Viewer};
use locard_engine::frame::Frame;

/// Zoom from which nearest-neighbour sampling is used.
const NEAREST_FROM_ZOOM: f32 = 2.0;
pub const MIN_ZOOM: f32 = 1.0 / 32.0;
pub const MAX_ZOOM: f32 = 64.0;
/// Distance from the wipe's line within which a drag moves it, points.
pub const WIPE_GRIP_PT: f32 = 6.0;

/// Display settings of the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureView {
    /// Screen pixels per pixel of the picture; `None`: fitted to the panel.
    pub zoom: Option<f32>,
    /// Point of the picture at the centre of the panel, as a fraction of its size.
    pub centre: Vec2,
    /// Position of the wipe's line as a fraction of the width, with the camera's own picture to its
    /// right; `None`: no wipe.
    pub wipe: Option<f32>,
    /// Shows the camera's own picture only.
    pub plain: bool,
    /// Hides the panels.
    pub alone: bool,
    /// Shows a loupe at the pointer.
    pub loupe: bool,
    /// The wipe's line is being dragged.
    wiping: bool,
}

impl Default for PictureView {
    fn default() -> Self {
        Self { zoom: None, centre: vec2(0.5, 0.5), wipe: None, plain: false, alone: false, loupe: false, wiping: false }
    }
}

impl PictureView {
    /// Placement of a picture of `size` px in a panel.
    pub fn placed(&self, panel: Rect, size: Vec2, pixels_per_point: f32) -> PictureTransform {
        let fit = (panel.size() / size).min_elem();
        let scale = self.zoom.map_or(fit, |zoom| zoom / pixels_per_point);
        let centre = if self.zoom.is_none() { vec2(0.5, 0.5) } else { self.centre };
        let min = panel.center() - centre * size * scale;
        // Aligned to the pixels of the screen.
        let min = pos2((min.x * pixels_per_point).round(), (min.y * pixels_per_point).round()) / pixels_per_point;
        PictureTransform { rect: Rect::from_min_size(min, size * scale), scale }
    }

    /// Zooms by a factor about a fixed point of the screen.
    pub fn zoom_about(&mut self, at: Pos2, factor: f32, panel: Rect, size: Vec2, pixels_per_point: f32) {
        let before = self.placed(panel, size, pixels_per_point);
        let share = (at - before.rect.min) / before.rect.size();
        let zoom = (before.scale * pixels_per_point * factor).clamp(MIN_ZOOM, MAX_ZOOM);
        self.zoom = Some(zoom);
        let now = size * (zoom / pixels_per_point);
        self.centre = (share - (at - panel.center()) / now).clamp(Vec2::ZERO, Vec2::splat(1.0));
    }

    /// Sets the zoom, about the centre of the panel.
    pub fn zoom_to(&mut self, zoom: f32) {
        if self.zoom.is_none() {
            self.centre = vec2(0.5, 0.5);
        }
        self.zoom = Some(zoom.clamp(MIN_ZOOM, MAX_ZOOM));
    }

    /// Sets the zoom and the point at the centre of the panel, as a fraction of the picture's size.
    pub fn look_at(&mut self, zoom: Option<f32>, centre: [f32; 2]) {
        self.zoom = zoom.map(|zoom| zoom.clamp(MIN_ZOOM, MAX_ZOOM));
        if zoom.is_some() {
            self.centre = Vec2::from(centre).clamp(Vec2::ZERO, Vec2::splat(1.0));
        }
    }

    fn pan(&mut self, by: Vec2, size: Vec2, scale: f32) {
        self.centre = (self.centre - by / (size * scale)).clamp(Vec2::ZERO, Vec2::splat(1.0));
    }
}

/// The picture as painted in this frame of the window, for overlays and pointer input.
pub struct PictureOutput {
    pub placed: PictureTransform,
    /// Size of the picture, px.
    pub size: Vec2,
    pub response: Response,
    /// Paints over the picture, clipped to its panel.
    pub painter: Painter,
    /// Clicked point, px of the picture.
    pub clicked: Option<Vec2>,
    /// Hovered point, px of the picture.
    pub pointed: Option<Vec2>,
    /// Part of the panel with the camera's own picture.
    pub camera: Rect,
    /// Part of the panel with the composite.
    pub composite: Rect,
}

impl PictureOutput {
    /// Shows an instruction at the lower edge of the picture.
    pub fn prompt(&self, text: &str) {
        let at = self.painter.clip_rect().center_bottom() - vec2(0.0, 16.0);
        plate(&self.painter, at, egui::Align2::CENTER_BOTTOM, text, 14.0);
    }
}

/// Text on a dark plate, legible on every picture.
pub fn plate(painter: &Painter, at: Pos2, align: egui::Align2, text: &str, size: f32) {
    let room = (painter.clip_rect().width() - 2.0 * size).max(60.0);
    let galley = painter.layout(text.to_owned(), egui::FontId::proportional(size), Color32::WHITE, room);
    let rect = align.anchor_size(at, galley.size());
    painter.rect_filled(rect.expand2(vec2(0.5 * size, 0.25 * size)), 4.0, Color32::from_black_alpha(180));
    painter.galley(rect.min, galley, Color32::WHITE);
}

/// Pointer input in the picture that other parts of the window capture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CapturedInput {
    /// Clicks are captured: a double-click does not zoom.
    pub clicks: bool,
    /// Drags with the primary button are captured: they do not pan. Other buttons still do.
    pub drags: bool,
}

/// Comparison of two settings, A at the left of the line and B at the right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Comparison {
    /// A is edited, otherwise B.
    pub edits_a: bool,
}

/// Paints the picture of a frame into the rest of the window, or the reason why there is none.
pub fn show(
    ui: &mut Ui,
    view: &mut PictureView,
    viewer: &mut Viewer,
    frame: Result<&Frame, &str>,
    comparison: Option<Comparison>,
    captured: CapturedInput,
) -> Option<PictureOutput> {
    let panel = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(panel, Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "picture"));
    let ground = Color32::from_gray(if ui.visuals().dark_mode { 18 } else { 160 });
    let frame = match frame {
        Ok(frame) => frame,
        Err(why) => {
            let painter = ui.painter().with_clip_rect(panel);
            painter.rect_filled(panel, 0.0, ground);
            plate(&painter, panel.center(), egui::Align2::CENTER_CENTER, why, 14.0);
            let at = Rect::from_center_size(panel.center(), vec2(1.0, 1.0));
            let notice = ui.interact(at, response.id.with("notice"), Sense::hover());
            notice.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Label, true, why));
            return None;
        }
    };
    let (width, height) = (frame.pixels.width, frame.pixels.height);
    let size = vec2(width as f32, height as f32);
    let ppp = ui.ctx().pixels_per_point();

    if let Some(at) = response.hover_pos() {
        let (scroll, pinch) = ui.input(|i| (i.smooth_scroll_delta().y, i.zoom_delta()));
        let factor = pinch * (scroll / 240.0).exp2();
        if factor != 1.0 {
            view.zoom_about(at, factor, panel, size, ppp);
        }
    }
    if response.double_clicked() && !captured.clicks {
        match view.zoom {
            Some(_) => view.zoom = None,
            None => {
                let at = response.interact_pointer_pos().unwrap_or(panel.center());
                let placed = view.placed(panel, size, ppp);
                view.zoom_about(at, 4.0 / (placed.scale * ppp), panel, size, ppp);
            }
        }
    }
    let placed = view.placed(panel, size, ppp);
    wipe_or_pan(ui, view, &response, size, placed, captured);
    let placed = view.placed(panel, size, ppp);

    let painter = ui.painter().with_clip_rect(panel);
    let line_x = view.wipe.map(|share| placed.rect.min.x + share * placed.rect.width());
    let x = line_x.unwrap_or(f32::NEG_INFINITY);
    let left = Rect::everything_left_of(x);
    let fits = |shown: &&DisplayTexture| shown.size == (width, height);
    let composite = viewer.composite().filter(|shown| fits(shown) && !view.plain);
    let (edited, counterpart) = match composite {
        None => (Rect::NOTHING, panel),
        Some(_) => split(panel, line_x, comparison),
    };
    let is_camera = comparison.is_none() || composite.is_none();
    let edited_texture = composite.map(|shown| shown.texture.clone());
    let other_texture = match viewer.comparison().filter(fits) {
        Some(other) if !is_camera => other.texture.clone(),
        _ if counterpart.is_positive() => viewer.camera_picture(frame).texture.clone(),
        _ => edited_texture.clone()?,
    };
    let edited_texture = edited_texture.unwrap_or_else(|| other_texture.clone());
    let pictures = if edited == left { [edited_texture, other_texture] } else { [other_texture, edited_texture] };
    let squares = placed.scale * ppp >= NEAREST_FROM_ZOOM;
    painter.add(Canvas { placed, size, line_x: x, pictures, ground, squares }.shape(panel));
    if let (Some(x), false) = (line_x, view.plain) {
        let line = |offset: f32, color| painter.vline(x + offset, placed.rect.y_range(), Stroke::new(1.0, color));
        line(0.0, Color32::WHITE);
        line(1.0, Color32::from_black_alpha(160));
        let y = placed.rect.intersect(panel).min.y + 8.0;
        let names = if comparison.is_some() { ["A", "B"] } else { ["with evidence", "camera"] };
        plate(&painter, pos2(x - 12.0, y), egui::Align2::RIGHT_TOP, names[0], 12.0);
        plate(&painter, pos2(x + 12.0, y), egui::Align2::LEFT_TOP, names[1], 12.0);
    }
    let camera = if is_camera { counterpart } else { Rect::NOTHING };
    let inside =
        |at: Pos2| Some(placed.picture_px(at)).filter(|px| px.min_elem() >= 0.0 && px.x < size.x && px.y < size.y);
    let clicked = response.clicked().then(|| response.interact_pointer_pos()).flatten().and_then(inside);
    let pointed = response.hover_pos().and_then(inside);
    Some(PictureOutput { placed, size, response, painter, clicked, pointed, camera, composite: edited })
}

/// Parts of the panel with the edited composite, and with its counterpart: the camera's own
/// picture, or the other one of A and B. With the line at the left edge only the camera's picture
/// is visible.
fn split(panel: Rect, line_x: Option<f32>, comparison: Option<Comparison>) -> (Rect, Rect) {
    let Some(x) = line_x else { return (panel, Rect::NOTHING) };
    let [left, right] = [Rect::everything_left_of(x), Rect::everything_right_of(x)];
    match comparison {
        Some(Comparison { edits_a: false }) => (right, left),
        _ => (left, right),
    }
}

fn wipe_or_pan(
    ui: &Ui,
    view: &mut PictureView,
    response: &Response,
    size: Vec2,
    placed: PictureTransform,
    captured: CapturedInput,
) {
    let line_x = view.wipe.map(|share| placed.rect.min.x + share * placed.rect.width());
    let near_line = |at: Pos2| line_x.is_some_and(|x| (at.x - x).abs() <= WIPE_GRIP_PT);
    if response.hover_pos().is_some_and(near_line) || view.wiping {
        ui.ctx().set_cursor_icon(egui::CursorIcon::ResizeHorizontal);
    }
    if response.drag_started() {
        let origin = ui.input(|i| i.pointer.press_origin());
        view.wiping = response.dragged_by(egui::PointerButton::Primary) && origin.is_some_and(near_line);
    }
    if response.dragged() {
        match response.interact_pointer_pos() {
            Some(at) if view.wiping => {
                view.wipe = Some(((at.x - placed.rect.min.x) / placed.rect.width()).clamp(0.0, 1.0));
            }
            _ if captured.drags && response.dragged_by(egui::PointerButton::Primary) => {}
            _ if view.zoom.is_some() => view.pan(response.drag_delta(), size, placed.scale),
            _ => {}
        }
    }
    if response.drag_stopped() {
        view.wiping = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PANEL: Rect = Rect { min: pos2(100.0, 50.0), max: pos2(900.0, 650.0) };
    const SIZE: Vec2 = vec2(640.0, 480.0);

    #[test]
    fn zoom_keeps_the_point_under_the_pointer() {
        let mut view = PictureView::default();
        let placed = view.placed(PANEL, SIZE, 1.0);
        assert_eq!(placed.rect, PANEL);
        assert_eq!(placed.picture_px(pos2(500.0, 350.0)), vec2(320.0, 240.0));
        let at = pos2(300.0, 200.0);
        let under = placed.picture_px(at);
        for factor in [2.0, 1.5, 4.0] {
            view.zoom_about(at, factor, PANEL, SIZE, 2.0);
            let now = view.placed(PANEL, SIZE, 2.0).picture_px(at);
            // The picture's corner goes to a pixel of the screen.
            let pixel = 0.5 / view.zoom.unwrap_or(1.0) + 1e-3;
            assert!((now - under).abs().max_elem() <= pixel, "{now:?} {under:?}");
        }
        view.zoom_about(at, 1e9, PANEL, SIZE, 1.0);
        assert_eq!(view.zoom, Some(MAX_ZOOM));
    }

    #[test]
    fn zoom_of_a_fitted_picture_is_about_its_centre() {
        let mut view = PictureView { zoom: Some(4.0), centre: vec2(0.1, 0.9), ..PictureView::default() };
        // A magnified picture keeps its centre.
        view.zoom_to(1.0);
        assert_eq!(view.centre, vec2(0.1, 0.9));
        view.zoom = None;
        view.zoom_to(2.0);
        assert_eq!((view.zoom, view.placed(PANEL, SIZE, 1.0).rect.center()), (Some(2.0), PANEL.center()));
    }

    #[test]
    fn wipe_at_an_edge_shows_one_picture_only() {
        let picture = PictureView::default().placed(PANEL, SIZE, 1.0).rect;
        let [composite, camera] = [picture.min.x, picture.max.x].map(|x| split(PANEL, Some(x), None));
        assert!(composite.1.contains_rect(picture) && composite.0.intersect(picture).width() <= 0.0);
        assert!(camera.0.contains_rect(picture) && camera.1.intersect(picture).width() <= 0.0);
        // A is left, whichever is edited.
        let split_picture = |edits_a| split(PANEL, Some(300.0), Some(Comparison { edits_a }));
        assert_eq!(
            (split_picture(true).0, split_picture(false).1),
            (Rect::everything_left_of(300.0), Rect::everything_left_of(300.0))
        );
        assert_eq!(split(PANEL, None, None), (PANEL, Rect::NOTHING));
    }
}
