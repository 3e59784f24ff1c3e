//! The central panel: the picture and the interaction with it.

use std::sync::Arc;

use eframe::egui::{self, Ui};
use glam::DVec2;

use super::super::click_context::ClickContext;
use super::super::handles::Overlay;
use super::super::loupe;
use super::super::notice::{self, Notice, NoticeButton, Refusal, Remedy};
use super::super::obstacle::{self, Obstacle};
use super::super::picture::{self, CapturedInput, Comparison, PictureOutput};
use super::super::tool::Tool;
use super::App;
use locard_engine::frame::Frame;

impl App {
    /// Shows the picture and handles the interaction with it.
    pub(super) fn picture(&mut self, ui: &mut Ui) {
        let frame = self.document.session.frame().cloned();
        let tool = self.document.tools.active();
        let taken = CapturedInput {
            clicks: tool.captures_clicks(),
            drags: tool.captures_drags() || self.document.handles.is_pressed(),
        };
        let (needs_place, is_selecting) = (tool.picks_point(), !tool.captures_clicks());
        let other = self.document.session.project.edit().other.as_ref();
        let compared = other.map(|other| Comparison { edits_a: !other.is_a });
        if compared.is_some() && self.document.view.wipe.is_some() {
            self.document.session.request_variant();
        }
        let placeholder = if frame.is_none() { self.document.session.placeholder() } else { "" };
        let viewer = &mut self.document.session.viewer;
        let output =
            picture::show(ui, &mut self.document.view, viewer, frame.as_deref().ok_or(placeholder), compared, taken);
        self.document.placed = output.as_ref().map(|output| output.placed);
        let (Some(mut output), Some(frame)) = (output, frame) else { return };
        self.keyboard_cursor.apply(&mut output);
        let obstacle = Obstacle::of(self.document.session.project.shot(), frame.index);
        if needs_place && obstacle.is_some() {
            // The notice explains the obstacle; a click has no effect.
            output.clicked = None;
            output.response.ctx.set_cursor_icon(egui::CursorIcon::NotAllowed);
        }
        if self.document.session.is_stale() {
            output.painter.rect_filled(output.placed.rect, 0.0, egui::Color32::from_black_alpha(170));
            output.prompt(&format!(
                "Frame {} cannot be shown; this is frame {}",
                self.document.session.player.frame(),
                frame.index
            ));
        }
        self.codes(&output, &frame);
        let shot = self.document.session.project.shot();
        self.document.scan_alignment.paint(&output, shot, frame.index, &self.document.tools);
        self.document.side.over_picture(&output, frame.index, self.document.session.player.playing);
        self.document.tools.update_region(&output);
        let over = Overlay {
            picture: &output,
            view: &self.document.view,
            frame: &frame,
            is_free: is_selecting,
            is_hidden: self.document.view.plain
                || (self.document.session.player.playing && !self.document.session.is_live()),
        };
        let transformed = self.document.tools.update_transform(|transform| {
            self.document.handles.show(
                &over,
                &mut self.document.session.project,
                &mut self.document.evidence.selected,
                transform,
            )
        });
        match transformed {
            Some(Ok(done)) => self.document.session.show_message(done),
            Some(Err(error)) => self.document.session.show_message(error),
            None => {}
        }
        self.notice(ui, &output, obstacle.as_ref(), frame.index, needs_place);
        if needs_place && obstacle.is_some() {
            return;
        }
        self.document.evidence.ground.picked.paint(&output, &self.document.session.project, frame.index);
        self.document.tools.paint(&output, &self.document.session.project, frame.index);
        if needs_place {
            self.pick_point(&output, &frame);
        }
        self.document.refusal = self.document.refusal.take().filter(|refusal| refusal.show(&output));
    }

    /// Passes clicks and drags to a tool that picks a point of the world.
    fn pick_point(&mut self, output: &PictureOutput, frame: &Arc<Frame>) {
        let (project, ground) = (&mut self.document.session.project, &mut self.document.evidence.ground.picked);
        let is_press_consumed = self.document.handles.has_consumed_press();
        let clicked = output.clicked.filter(|_| !(is_press_consumed && output.response.clicked()));
        let clicked = clicked.map(|at| DVec2::new(at.x.into(), at.y.into()));
        let turned = match self.document.tools.active_mut() {
            Tool::Place(placement) => {
                placement.show_preview(output, ground, project, frame);
                if is_press_consumed { None } else { placement.turn(output, ground, project, frame) }
            }
            _ => None,
        };
        let Some(at) = turned.or(clicked) else { return };
        let context = ClickContext { project, ground, frame, selected: &mut self.document.evidence.selected };
        match self.document.tools.click(context, at) {
            Ok(message) => message.into_iter().for_each(|message| self.document.session.show_message(message)),
            Err(error) => self.refuse(output, error),
        }
    }

    /// Shows at the click why it had no effect.
    fn refuse(&mut self, output: &PictureOutput, why: String) {
        if let Some(at_px) = output.clicked.or(output.pointed) {
            self.document.refusal = Some(Refusal::new(output, at_px, why.clone()));
        }
        self.document.session.show_message(why);
    }

    /// Shows a notice over the picture: a refused profile, or an obstacle to placement.
    fn notice(
        &mut self,
        ui: &mut Ui,
        output: &PictureOutput,
        obstacle: Option<&Obstacle>,
        frame: usize,
        needs_place: bool,
    ) {
        let refused = self.documents.refused_profile().map(str::to_owned);
        let refused = refused.map(|text| Notice { text, remedy: Some(Remedy::ChooseProfile), can_be_closed: true });
        let Some(notice) = refused.or_else(|| self.obstacle_notice(obstacle?, frame, needs_place)) else { return };
        match notice::show(ui, output.painter.clip_rect(), &notice) {
            Some(NoticeButton::Remedy(Remedy::ChooseProfile)) => {
                self.documents.choose_profile(&self.document.session.project)
            }
            Some(NoticeButton::Remedy(Remedy::GoToFrame(frame))) => self.document.session.player.seek(frame),
            Some(NoticeButton::Close) if self.documents.refused_profile().is_some() => self.documents.close_refusal(),
            Some(NoticeButton::Close) => self.document.hides_obstacle = true,
            None => {}
        }
    }

    /// The notice of an obstacle. A missing pose is only reported while a place is picked; other
    /// obstacles until the notice is closed.
    fn obstacle_notice(&mut self, obstacle: &Obstacle, frame: usize, needs_place: bool) -> Option<Notice> {
        let (text, remedy) = match obstacle {
            Obstacle::Camera(_) | Obstacle::Other(_) if self.document.hides_obstacle && !needs_place => return None,
            Obstacle::Camera(text) => (text.clone(), Some(Remedy::ChooseProfile)),
            Obstacle::Other(text) => (text.clone(), None),
            Obstacle::NoPose if !needs_place => return None,
            Obstacle::NoPose => {
                let nearest = self.document.nearest_pose.of(&self.document.session.project.shot().recording, frame);
                (obstacle::no_pose_text(nearest).to_owned(), nearest.map(Remedy::GoToFrame))
            }
        };
        Some(Notice { text, remedy, can_be_closed: !needs_place })
    }

    /// Shows code values in the loupe, and inside of pixels that are large enough on the screen.
    pub(super) fn codes(&mut self, output: &PictureOutput, frame: &Frame) {
        let ppp = output.response.ctx.pixels_per_point();
        let numbers = output.placed.scale * ppp >= loupe::MIN_NUMBERED_PX;
        if !numbers && !self.document.view.loupe {
            return;
        }
        self.document.session.request_codes();
        let codes = self.document.session.codes().filter(|codes| codes.frame.identity() == frame.identity());
        if numbers {
            loupe::numbers(output, output.camera, &frame.pixels, ppp);
            if let Some(codes) = &codes {
                loupe::numbers(output, output.composite, &codes.pixels, ppp);
            }
        }
        if self.document.view.loupe && output.pointed.is_some() {
            self.document.session.viewer.camera_picture(frame);
            let viewer = &self.document.session.viewer;
            let camera =
                viewer.camera().map(|shown| loupe::LoupeSide { name: "camera", shown, codes: Some(&frame.pixels) });
            let pixels = codes.as_ref().map(|codes| &*codes.pixels);
            let with = viewer.composite().map(|shown| loupe::LoupeSide { name: "with evidence", shown, codes: pixels });
            loupe::show(output, &camera.into_iter().chain(with).collect::<Vec<_>>());
        }
    }
}
