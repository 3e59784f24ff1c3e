//! The panels beside the picture: evidence and lamps at the left, settings and plots at the right.
//! In a small window they shrink, then share one place, so that the picture keeps at least half of
//! the width.

use eframe::egui::{self, Frame, Panel, Ui};

use super::super::lamps;
use super::super::missing;
use super::super::side::fixed;
use super::App;
use super::document::OpenDocument;

/// Widths of the left panel, points.
const LEFT_DEFAULT: f32 = 200.0;
const LEFT_MIN: f32 = 140.0;
const LEFT_MAX: f32 = 400.0;
/// Widths of the right panel, points.
const RIGHT_DEFAULT: f32 = 424.0;
const RIGHT_MIN: f32 = 350.0;
const RIGHT_MAX: f32 = 700.0;
/// Width of the right panel that still shows all controls, their names cut, points.
const RIGHT_NARROW: f32 = 310.0;
/// Largest width of the only panel of a small window, points.
const SINGLE_MAX: f32 = 360.0;
/// Smallest width of the panel that aligns a scan, points.
const SCAN_MIN: f32 = 300.0;

/// Panel that a small window shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PanelTab {
    Evidence,
    #[default]
    Adjustments,
}

/// The tabs of a small window.
#[derive(Debug, Default)]
pub struct PanelTabs {
    shown: PanelTab,
    /// True if a model was being placed in the last frame.
    was_placing: bool,
    /// True if the scene lacked a file in the last frame.
    was_missing: bool,
}

impl PanelTabs {
    /// Shows the evidence tab when placing a model starts or a scene file is missing: their
    /// controls are there.
    fn follow(&mut self, is_placing: bool, is_missing: bool) {
        if is_placing && !self.was_placing || is_missing && !self.was_missing {
            self.shown = PanelTab::Evidence;
        }
        (self.was_placing, self.was_missing) = (is_placing, is_missing);
    }

    /// Keeps the shown tab for a recording that has just been opened.
    pub fn reopened(&self) -> Self {
        Self { shown: self.shown, ..Self::default() }
    }
}

/// Layout of the panels for a window's width.
#[derive(Clone, Copy, Debug, PartialEq)]
enum PanelLayout {
    /// Both, with widths set by the user, together at most `both`.
    Resizable { both: f32 },
    /// Both, as wide as the space allows.
    Fixed { left: f32, right: f32 },
    /// One at a time.
    Single { width: f32 },
}

impl PanelLayout {
    fn of(window_width: f32) -> Self {
        let both = (0.5 * window_width).floor();
        if both >= LEFT_DEFAULT + RIGHT_DEFAULT {
            Self::Resizable { both }
        } else if both >= LEFT_MIN + RIGHT_NARROW {
            let left = (both - RIGHT_NARROW).clamp(LEFT_MIN, (0.32 * both).max(LEFT_MIN)).min(LEFT_DEFAULT);
            Self::Fixed { left, right: both - left }
        } else {
            Self::Single { width: both.min(SINGLE_MAX) }
        }
    }
}

impl App {
    /// Updates evidence state that does not depend on whether its panel is shown.
    pub(super) fn update_evidence(&mut self) {
        let project = &self.document.session.project;
        self.document.evidence.update_selection(project);
        self.panel_tabs.follow(self.document.tools.placement().is_some(), missing::is_any_needed(project));
    }

    /// Shows the panels. Each layout has separate panels, which remember their widths.
    pub(super) fn panels(&mut self, ui: &mut Ui, frame: Frame) {
        if self.document.scan_alignment.is_open() {
            let both = (0.5 * ui.ctx().content_rect().width()).floor();
            let panel = Panel::right("scan").default_size(both).size_range(SCAN_MIN.min(both)..=both);
            panel.frame(frame).show(ui, |ui| self.scan_panel(ui));
            return;
        }
        match PanelLayout::of(ui.ctx().content_rect().width()) {
            PanelLayout::Resizable { both } => {
                let left_max = LEFT_MAX.min(both - RIGHT_MIN);
                let left = Panel::left("evidence").default_size(LEFT_DEFAULT).size_range(LEFT_MIN..=left_max);
                let left = left.frame(frame).show(ui, |ui| self.evidence_panel(ui)).response.rect.width();
                let right = RIGHT_MIN..=RIGHT_MAX.min(both - left).max(RIGHT_MIN);
                let right = Panel::right("controls").default_size(RIGHT_DEFAULT).size_range(right);
                right.frame(frame).show(ui, |ui| self.adjustments_panel(ui));
            }
            PanelLayout::Fixed { left, right } => {
                let panel = Panel::left("evidence, narrow").resizable(false).exact_size(left);
                panel.frame(frame).show(ui, |ui| self.evidence_panel(ui));
                let panel = Panel::right("controls, narrow").resizable(false).exact_size(right);
                panel.frame(frame).show(ui, |ui| self.adjustments_panel(ui));
            }
            PanelLayout::Single { width } => {
                let panel = Panel::right("panel").resizable(false).exact_size(width);
                panel.frame(frame).show(ui, |ui| self.single_panel(ui));
            }
        }
    }

    /// The alignment of a scan, in place of both panels.
    fn scan_panel(&mut self, ui: &mut Ui) {
        let OpenDocument { scan_alignment, session, tools, .. } = &mut self.document;
        fixed(ui, |ui| scan_alignment.show(ui, session, tools));
    }

    /// The only panel of a small window, with a tab for each.
    fn single_panel(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            ui.selectable_value(&mut self.panel_tabs.shown, PanelTab::Evidence, "Evidence");
            ui.selectable_value(&mut self.panel_tabs.shown, PanelTab::Adjustments, "Adjustments");
        });
        match self.panel_tabs.shown {
            PanelTab::Evidence => self.evidence_panel(ui),
            PanelTab::Adjustments => self.adjustments_panel(ui),
        }
    }

    /// Evidence and lamps.
    fn evidence_panel(&mut self, ui: &mut Ui) {
        let session = &mut self.document.session;
        let frame = session.frame().cloned();
        let gpu = session.viewer.gpu();
        let (evidence, tools) = (&mut self.document.evidence, &mut self.document.tools);
        let error = fixed(ui, |ui| {
            let scrolled = egui::ScrollArea::vertical().show(ui, |ui| {
                let of_evidence = evidence.show(ui, &mut session.project, gpu, frame.as_ref(), tools);
                let of_lamps = lamps::show(ui, &mut session.project, frame.as_ref(), &mut evidence.selected, tools);
                if tools.lamp_pick().is_some() {
                    evidence.ground.picked.cancel_scale();
                }
                of_evidence.or(of_lamps)
            });
            scrolled.inner
        });
        if let Some(error) = error {
            self.document.session.show_message(error);
        }
    }

    /// Settings, plots and calibration, with the offer to analyse the footage above them.
    fn adjustments_panel(&mut self, ui: &mut Ui) {
        self.documents.output_jobs.show_analysis_offer(ui, &mut self.document.session);
        if let Some(refused) = self.document.side.show(ui, &mut self.document.session, &mut self.document.tools) {
            self.document.session.show_message(refused);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_picture_keeps_half_of_any_window() {
        for width in 320..4000 {
            let width = width as f32;
            let panels = match PanelLayout::of(width) {
                PanelLayout::Resizable { both } => both,
                PanelLayout::Fixed { left, right } => {
                    assert!(
                        (LEFT_MIN..=LEFT_DEFAULT).contains(&left) && right >= RIGHT_NARROW,
                        "{width}: {left} {right}"
                    );
                    left + right
                }
                PanelLayout::Single { width } => width,
            };
            assert!(panels <= 0.5 * width, "{width}: {panels}");
        }
        assert!(matches!(PanelLayout::of(1280.0), PanelLayout::Resizable { .. }), "the window's first size");
        assert_eq!(PanelLayout::of(900.0), PanelLayout::Fixed { left: 140.0, right: 310.0 });
        assert_eq!(PanelLayout::of(640.0), PanelLayout::Single { width: 320.0 });
    }
}
