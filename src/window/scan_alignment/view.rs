//! The view of a scan: its picture, drawn on a background thread, and the pointer in it. While it
//! moves, a smaller picture is drawn.

use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::{
    self, Color32, PointerButton, Pos2, Rect, Response, Sense, TextureHandle, TextureOptions, Ui, Vec2,
};
use glam::{DVec2, DVec3};

use super::super::background::Background;
use super::super::picture_transform::PictureTransform;
use super::super::progress;
use super::orbit::OrbitCamera;
use super::shading;
use locard_engine::camera::Geometry;
use locard_engine::memo::ByAddress;
use locard_engine::pixels::DepthMap;
use locard_engine::pose::Pose;
use locard_engine::site::SiteScan;

/// Time without a motion after which the picture is drawn at its whole size, s.
const REST_S: f64 = 0.15;
/// Largest number of pixels of a picture at rest.
const MAX_PIXELS: f32 = 1.5e6;
/// Time in which a picture in motion should be drawn, s, and limits of its reduction.
const MOTION_S: f32 = 0.04;
const REDUCTIONS: std::ops::RangeInclusive<f32> = 1.5..=8.0;
/// Distance within which a click finds a point of the scan, px.
const REACH_PX: i32 = 3;
/// Relative depth by which a hidden point lies behind the surface.
const HIDDEN_BEHIND: f64 = 0.03;

/// The content of a picture of the view.
#[derive(Clone, Debug, PartialEq)]
struct ViewKey {
    scan: ByAddress<SiteScan>,
    camera: OrbitCamera,
    size_px: [u32; 2],
    cut_m: f32,
}

/// A picture of a scan with its depth.
struct ScanPicture {
    geometry: Geometry,
    camera_from_scan: Pose,
    map: DepthMap,
    texture: TextureHandle,
    drawn_in: Duration,
}

impl ScanPicture {
    fn draw(key: &ViewKey, scan: &SiteScan, ctx: &egui::Context) -> Self {
        let begun = Instant::now();
        let (geometry, camera_from_scan) = (OrbitCamera::geometry(key.size_px), key.camera.pose());
        let map = scan.view(&geometry, &camera_from_scan, key.cut_m);
        let image = shading::shaded(&geometry, &map);
        let texture = ctx.load_texture("scan", image, TextureOptions::LINEAR);
        Self { geometry, camera_from_scan, map, texture, drawn_in: begun.elapsed() }
    }

    /// The point of the scan nearest to a pixel, m.
    fn point_m(&self, at_px: DVec2) -> Option<DVec3> {
        let (width, height) = (self.map.width as i32, self.map.height as i32);
        let (x, y) = (at_px.x.floor() as i32, at_px.y.floor() as i32);
        let around = (-REACH_PX..=REACH_PX).flat_map(|dy| (-REACH_PX..=REACH_PX).map(move |dx| (dx, dy)));
        let inside = around.filter(|(dx, dy)| (0..width).contains(&(x + dx)) && (0..height).contains(&(y + dy)));
        let depth_m = |dx: i32, dy: i32| self.map.depth_m[((y + dy) * width + x + dx) as usize];
        let measured = inside.filter(|(dx, dy)| depth_m(*dx, *dy) > 0.0);
        let (dx, dy) = measured.min_by_key(|(dx, dy)| dx * dx + dy * dy)?;
        let ray = self.geometry.depth_ray(at_px)?;
        Some(self.camera_from_scan.inverse_transform_point(f64::from(depth_m(dx, dy)) * ray))
    }

    /// The pixel of a point, and whether a surface hides it.
    fn project(&self, point_m: DVec3) -> Option<(DVec2, bool)> {
        let in_camera = self.camera_from_scan.transform_point(point_m);
        let at_px = self.geometry.project(in_camera)?;
        let is_inside = at_px.cmpge(DVec2::ZERO).all()
            && at_px.x < f64::from(self.map.width)
            && at_px.y < f64::from(self.map.height);
        let (x, y) = (at_px.x as usize, at_px.y as usize);
        let depth_m = is_inside.then(|| f64::from(self.map.depth_m[y * self.map.width as usize + x]))?;
        Some((at_px, depth_m > 0.0 && depth_m < (1.0 - HIDDEN_BEHIND) * in_camera.z))
    }
}

/// State of the view.
pub struct FreeView {
    camera: Option<OrbitCamera>,
    /// Surfaces nearer than this part of the distance to the middle of the scan are cut away.
    pub cut: f32,
    picture: Background<ViewKey, ScanPicture>,
    requested: Option<ViewKey>,
    /// Reduction of pictures in motion.
    reduction: f32,
    moved_at_s: f64,
    /// Point of the scan that a drag is about, m.
    pivot_m: Option<DVec3>,
    placed: Option<PictureTransform>,
}

impl Default for FreeView {
    fn default() -> Self {
        Self {
            camera: None,
            cut: 0.0,
            picture: Background::default(),
            requested: None,
            reduction: 3.0,
            moved_at_s: f64::NEG_INFINITY,
            pivot_m: None,
            placed: None,
        }
    }
}

/// The view as painted in this frame of the window.
pub struct FreeViewOutput {
    pub painter: egui::Painter,
    /// The clicked point of the scan, m, or `None` for a click beside it.
    pub clicked_m: Option<Option<DVec3>>,
}

impl FreeView {
    /// Shows the whole scan from the next frame on.
    pub fn fit(&mut self) {
        self.camera = None;
    }

    /// Takes the pose of a camera of the footage.
    pub fn take_pose(&mut self, camera_from_scan: &Pose) {
        if let Some(camera) = &mut self.camera {
            camera.take_pose(camera_from_scan);
        }
    }

    /// Another value than the camera changes now: meanwhile a smaller picture is drawn.
    pub fn touch(&mut self, now_s: f64) {
        self.moved_at_s = now_s;
    }

    /// True if the picture is that of the current camera, at its whole size.
    pub fn is_settled(&self, now_s: f64) -> bool {
        let is_drawn = self.requested.as_ref().is_some_and(|key| self.picture.is_of(key));
        let camera = self.requested.as_ref().map(|key| key.camera);
        is_drawn && camera.is_some() && camera == self.camera && now_s - self.moved_at_s > 2.0 * REST_S
    }

    /// Position of a visible point of the scan on the screen.
    pub fn on_screen(&self, point_m: DVec3) -> Option<Pos2> {
        self.mark(point_m).filter(|(_, is_hidden)| !is_hidden).map(|(at, _)| at)
    }

    /// Position of a point on the screen, and whether a surface hides it.
    pub fn mark(&self, point_m: DVec3) -> Option<(Pos2, bool)> {
        let (at_px, is_hidden) = self.picture.last()?.project(point_m)?;
        Some((self.placed?.screen(egui::vec2(at_px.x as f32, at_px.y as f32)), is_hidden))
    }

    /// Point of the scan at a point of the screen, m.
    fn point_m(&self, at: Pos2) -> Option<DVec3> {
        let at_px = self.placed?.picture_px(at);
        self.picture.last()?.point_m(DVec2::new(at_px.x.into(), at_px.y.into()))
    }

    /// Shows the view in a rectangle.
    pub fn show(&mut self, ui: &mut Ui, rect: Rect, scan: &Arc<SiteScan>) -> FreeViewOutput {
        let response = ui.allocate_rect(rect, Sense::click_and_drag());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "scan"));
        let aspect = f64::from(rect.width() / rect.height().max(1.0));
        let mut camera = self.camera.unwrap_or_else(|| OrbitCamera::fitted(scan, aspect));
        self.navigate(ui, &response, &mut camera);
        let now_s = ui.input(|i| i.time);
        if self.camera.replace(camera) != Some(camera) {
            self.moved_at_s = now_s;
        }
        self.request(ui.ctx(), scan, rect.size(), camera, now_s);
        let painter = ui.painter().with_clip_rect(rect);
        painter.rect_filled(rect, 0.0, shading::BACKGROUND);
        match self.picture.last() {
            Some(picture) => {
                let scale = rect.width() / picture.map.width.max(1) as f32;
                self.placed = Some(PictureTransform { rect, scale });
                let uv = Rect::from_min_max(Pos2::ZERO, egui::pos2(1.0, 1.0));
                painter.image(picture.texture.id(), rect, uv, Color32::WHITE);
            }
            None => progress::failure(ui, "The scan cannot be drawn", &self.picture),
        }
        let clicked = response.clicked().then(|| response.interact_pointer_pos()).flatten();
        FreeViewOutput { painter, clicked_m: clicked.map(|at| self.point_m(at)) }
    }

    /// Orbits, moves and zooms by the pointer.
    fn navigate(&mut self, ui: &Ui, response: &Response, camera: &mut OrbitCamera) {
        let side = response.rect.width().max(response.rect.height());
        if response.drag_started() {
            let origin = ui.input(|i| i.pointer.press_origin());
            self.pivot_m = origin.and_then(|origin| self.point_m(origin));
        }
        let drag = response.drag_delta() / side;
        if drag != Vec2::ZERO {
            let drag = DVec2::new(drag.x.into(), drag.y.into());
            let is_orbit = response.dragged_by(PointerButton::Primary) && !ui.input(|i| i.modifiers.shift);
            if is_orbit { camera.orbit(drag, self.pivot_m) } else { camera.shift(drag, self.pivot_m) }
        }
        let Some(at) = response.hover_pos() else { return };
        let (scroll, pinch) = ui.input(|i| (i.smooth_scroll_delta().y, i.zoom_delta()));
        let factor = pinch * (scroll / 240.0).exp2();
        if factor != 1.0 {
            camera.zoom(factor.into(), self.point_m(at));
        }
    }

    /// Requests the picture of a camera, a smaller one while it moves. A picture in progress is
    /// completed first, since many short motions would cancel each other's pictures.
    fn request(&mut self, ctx: &egui::Context, scan: &Arc<SiteScan>, size: Vec2, camera: OrbitCamera, now_s: f64) {
        let pixels = size * ctx.pixels_per_point();
        let rest_px = pixels * (MAX_PIXELS / pixels.x.max(1.0) / pixels.y.max(1.0)).sqrt().min(1.0);
        let is_moving = now_s - self.moved_at_s < REST_S;
        let is_drawing = self.picture.progress().is_some();
        if let Some(picture) = self.picture.last().filter(|_| is_moving && !is_drawing) {
            let whole_s = picture.drawn_in.as_secs_f32() * (rest_px.x / picture.map.width as f32).powi(2);
            self.reduction = (whole_s / MOTION_S).sqrt().clamp(*REDUCTIONS.start(), *REDUCTIONS.end());
        }
        let size_px = if is_moving { rest_px / self.reduction } else { rest_px };
        let size_px = [size_px.x, size_px.y].map(|side| (side.round() as u32).max(16));
        let middle_m = (camera.pose().transform_point(scan.center_m())).length() as f32;
        let key = ViewKey { scan: ByAddress(Arc::clone(scan)), camera, size_px, cut_m: self.cut * middle_m };
        if is_moving {
            ctx.request_repaint_after_secs(REST_S as f32);
        }
        let in_progress = self.requested.take().filter(|_| is_drawing);
        let key = in_progress.unwrap_or(key);
        let (of_thread, ctx_of_thread, scan) = (key.clone(), ctx.clone(), Arc::clone(scan));
        self.picture.request(ctx, key.clone(), move |_| ScanPicture::draw(&of_thread, &scan, &ctx_of_thread));
        self.requested = Some(key);
    }
}
