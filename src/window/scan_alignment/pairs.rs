//! The pairs of points: their list, and their marks in the picture and in the view of the scan.

use eframe::egui::{self, Button, Color32, Painter, RichText, Ui, vec2};
use glam::DVec3;

use super::super::picture::PictureOutput;
use super::super::player::Player;
use super::super::point_picker::paint_ring;
use super::super::tool::ToolStack;
use super::view::FreeView;
use locard_engine::shot::{FramePoint, PickedPair};
use locard_engine::site::SiteScan;
use locard_engine::text::fixed;

/// Colour of the marks of the selected pair and of an incomplete one.
const SELECTED: Color32 = Color32::from_rgb(255, 210, 80);
/// Opacity of a mark behind a surface of the scan.
const HIDDEN_OPACITY: f32 = 0.35;

/// A pair with its error in the last alignment.
#[derive(Clone, Copy, Debug)]
struct AlignedPair {
    pair: PickedPair,
    error_px: Option<f64>,
}

/// The picked pairs.
#[derive(Debug, Default)]
pub struct PairList {
    pairs: Vec<AlignedPair>,
    selected: Option<usize>,
    /// A point of the scan that awaits its position in a frame, in the scan's unit.
    pub pending_point: Option<DVec3>,
}

impl PairList {
    pub fn pairs(&self) -> impl ExactSizeIterator<Item = PickedPair> {
        self.pairs.iter().map(|pair| pair.pair)
    }

    /// Makes a pair of the point that awaits its position and of a clicked position.
    pub fn complete(&mut self, tools: &mut ToolStack) {
        let Some((pick, point)) = tools.scan_pick_mut().zip(self.pending_point) else { return };
        let Some(view) = pick.view.take() else { return };
        self.pending_point = None;
        self.selected = Some(self.pairs.len());
        self.pairs.push(AlignedPair { pair: PickedPair { view, point }, error_px: None });
    }

    /// Takes the errors of an alignment, and the pair that contradicts the others.
    pub fn set_errors(&mut self, errors_px: &[f64], wrong_pair: Option<usize>) {
        for (n, pair) in self.pairs.iter_mut().enumerate() {
            pair.error_px = errors_px.get(n).copied();
        }
        self.selected = wrong_pair.or(self.selected);
    }

    /// Colour of a pair's marks.
    fn ink(&self, pair: usize) -> Color32 {
        if pair == self.pairs.len() || self.selected == Some(pair) { SELECTED } else { Color32::WHITE }
    }

    /// Paints the marks of a frame over the picture.
    pub fn paint(&self, picture: &PictureOutput, frame: usize, tools: &ToolStack) {
        let pending = tools.scan_pick().and_then(|pick| pick.view);
        let views = self.pairs.iter().map(|pair| pair.pair.view).chain(pending);
        for (n, FramePoint { at_px, .. }) in views.enumerate().filter(|(_, view)| view.frame == frame) {
            let at = picture.placed.screen(vec2(at_px.x as f32, at_px.y as f32));
            paint_ring(&picture.painter, at, &(n + 1).to_string(), self.ink(n));
        }
    }

    /// Paints the marks over the view of the scan.
    pub fn paint_in_view(&self, painter: &Painter, view: &FreeView, scan: &SiteScan) {
        let points = self.pairs.iter().map(|pair| pair.pair.point).chain(self.pending_point);
        for (n, point) in points.enumerate() {
            let Some((at, is_hidden)) = view.mark(point * scan.metres_per_unit) else { continue };
            let opacity = if is_hidden { HIDDEN_OPACITY } else { 1.0 };
            paint_ring(painter, at, &(n + 1).to_string(), self.ink(n).gamma_multiply(opacity));
        }
    }

    /// Shows the list. A click on a pair shows its frame.
    pub fn show(&mut self, ui: &mut Ui, player: &mut Player) {
        let mut removed = None;
        for (n, AlignedPair { pair: PickedPair { view, point }, error_px }) in self.pairs.iter().enumerate() {
            ui.horizontal(|ui| {
                let name = format!("Remove pair {}", n + 1);
                let remove = ui.small_button("×").on_hover_text(&name);
                remove.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
                if remove.clicked() {
                    removed = Some(n);
                }
                let [x, y] = view.at_px.to_array().map(|px| fixed(px, 1));
                let point = point.to_array().map(|n| fixed(n, 3)).join(", ");
                let text = format!("{}   frame {}: {x}, {y} = {point}", n + 1, view.frame);
                let row = ui.add(Button::selectable(self.selected == Some(n), text));
                if row.on_hover_text("Shows its frame").clicked() {
                    self.selected = Some(n);
                    player.seek(view.frame);
                }
                if let Some(px) = error_px {
                    let hint = "Distance in the picture after the alignment by the pairs";
                    ui.label(RichText::new(format!("{px:.1} px off")).strong()).on_hover_text(hint);
                }
            });
        }
        if let Some(n) = removed {
            self.pairs.remove(n);
            self.selected = None;
        }
    }
}
