//! The side panel: settings, plots of the match, and calibration.

use eframe::egui::{Ui, UiBuilder};
use glam::DVec2;

use super::calibrating::Calibrating;
use super::controls::Controls;
use super::matching::{self, Matching};
use super::picture::PictureOutput;
use super::session::Session;
use super::tool::ToolStack;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Tab {
    #[default]
    Settings,
    Match,
    Calibrate,
}

/// The tabs, each with its state.
#[derive(Debug, Default)]
pub struct Side {
    tab: Tab,
    pub controls: Controls,
    matching: Matching,
    calibrating: Calibrating,
    /// Last position of the pointer, px of the picture.
    pointed: Option<DVec2>,
}

impl Side {
    /// Shows the chosen tab. Returns the error of a rejected value.
    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, tools: &mut ToolStack) -> Option<String> {
        fixed(ui, |ui| self.show_contents(ui, session, tools))
    }

    fn show_contents(&mut self, ui: &mut Ui, session: &mut Session, tools: &mut ToolStack) -> Option<String> {
        // In every tab, since the user may be holding a board.
        self.calibrating.process_newest(session);
        let before = self.tab;
        ui.horizontal(|ui| {
            for (tab, name) in [(Tab::Settings, "Settings"), (Tab::Match, "Match"), (Tab::Calibrate, "Calibrate")] {
                ui.selectable_value(&mut self.tab, tab, name);
            }
        });
        ui.separator();
        if self.tab != before {
            // Cancels region picking of the previous tab.
            tools.cancel_region_pick();
        }
        if self.tab != Tab::Match {
            self.matching.cancel();
        }
        if self.tab != Tab::Calibrate {
            self.calibrating.cancel();
        }
        match self.tab {
            Tab::Settings => {
                let active_effects = session.stats().map(|stats| stats.effects.clone());
                return self.controls.show(ui, &mut session.project, active_effects.as_deref());
            }
            Tab::Match => {
                let picked = self.calibrating.points();
                self.matching.show(ui, session, tools, self.pointed, picked);
            }
            Tab::Calibrate => self.calibrating.show(ui, session, tools),
        }
        None
    }

    /// Paints the tab's marks over the picture, except during playback, and stores the position of
    /// the pointer.
    pub fn over_picture(&mut self, picture: &PictureOutput, frame: usize, plays: bool) {
        let pointed = picture.pointed.map(|at| DVec2::new(at.x.into(), at.y.into()));
        if self.tab == Tab::Match && pointed != self.pointed && pointed.is_some() {
            picture.response.ctx.request_repaint();
        }
        self.pointed = pointed.or(self.pointed);
        match self.tab {
            _ if plays => {}
            Tab::Settings => {}
            Tab::Match => matching::paint(picture, self.matching.marks().map(|(rect, name)| (rect, name.to_owned()))),
            Tab::Calibrate => matching::paint(picture, self.calibrating.marks(frame)),
        }
    }
}

/// Shows contents in a panel of fixed width. Contents that are too wide are clipped.
pub fn fixed<R>(ui: &mut Ui, show: impl FnOnce(&mut Ui) -> R) -> R {
    let room = ui.available_rect_before_wrap();
    let mut inner = ui.new_child(UiBuilder::new().max_rect(room));
    inner.shrink_clip_rect(room);
    inner.add_space(4.0);
    let shown = show(&mut inner);
    ui.advance_cursor_after_rect(room);
    shown
}
