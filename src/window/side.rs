//! What stands at the right of the picture: settings, plots that say whether it matches, and calibration.

use eframe::egui::{Ui, UiBuilder};
use glam::DVec2;

use super::calibrating::Calibrating;
use super::controls::Controls;
use super::matching::{self, Matching};
use super::picture::Seen;
use super::region_picker::RegionPicker;
use super::session::Session;

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
    /// Where the pointer was last, px of the picture.
    pointed: Option<DVec2>,
}

impl Side {
    /// Shows the tab that is chosen. Values that are refused are given back as text.
    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, picker: &mut RegionPicker) -> Option<String> {
        fixed(ui, |ui| self.within(ui, session, picker))
    }

    fn within(&mut self, ui: &mut Ui, session: &mut Session, picker: &mut RegionPicker) -> Option<String> {
        // Whatever tab is shown: a person holds a board.
        self.calibrating.look(session);
        let before = self.tab;
        ui.horizontal(|ui| {
            for (tab, name) in [(Tab::Settings, "Settings"), (Tab::Match, "Match"), (Tab::Calibrate, "Calibrate")] {
                ui.selectable_value(&mut self.tab, tab, name);
            }
        });
        ui.separator();
        if self.tab != before {
            // What another tab asks for goes with it.
            picker.cancel();
        }
        if self.tab != Tab::Match {
            self.matching.rest();
        }
        if self.tab != Tab::Calibrate {
            self.calibrating.rest();
        }
        match self.tab {
            Tab::Settings => {
                let at_work = session.stats().map(|stats| stats.effects.clone());
                return self.controls.show(ui, &mut session.project, at_work.as_deref());
            }
            Tab::Match => {
                let picked = self.calibrating.points();
                self.matching.show(ui, session, picker, self.pointed, picked);
            }
            Tab::Calibrate => self.calibrating.show(ui, session, picker),
        }
        None
    }

    /// Marks in the picture of a frame what the tab is about, unless it plays, and keeps where the pointer is.
    pub fn over_picture(&mut self, seen: &Seen, frame: usize, plays: bool) {
        let pointed = seen.pointed.map(|at| DVec2::new(at.x.into(), at.y.into()));
        if self.tab == Tab::Match && pointed != self.pointed && pointed.is_some() {
            seen.response.ctx.request_repaint();
        }
        self.pointed = pointed.or(self.pointed);
        match self.tab {
            _ if plays => {}
            Tab::Settings => {}
            Tab::Match => matching::paint(seen, self.matching.marks().map(|(rect, name)| (rect, name.to_owned()))),
            Tab::Calibrate => matching::paint(seen, self.calibrating.marks(frame)),
        }
    }
}

/// Shows what a panel holds. What is too wide for the panel is cut: it does not grow, and the picture beside it stays.
pub fn fixed<R>(ui: &mut Ui, show: impl FnOnce(&mut Ui) -> R) -> R {
    let room = ui.available_rect_before_wrap();
    let mut inner = ui.new_child(UiBuilder::new().max_rect(room));
    inner.shrink_clip_rect(room);
    inner.add_space(4.0);
    let shown = show(&mut inner);
    ui.advance_cursor_after_rect(room);
    shown
}
