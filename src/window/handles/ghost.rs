//! The thing that the next click would place: its outline where it would stand, which follows the pointer. It is found on a
//! thread of its own, the newest place next, so that a large model holds nothing up.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use eframe::egui::{Pos2, vec2};
use glam::DVec2;

use super::super::picture::Seen;
use super::super::task::BackgroundTask;
use super::draw;
use super::look::{Border, border};
use locard_engine::frame::Frame;
use locard_engine::scene::document::PlacedModel;
use locard_engine::scene::{MissingModels, ModelCache, SceneFile, load_file_with};
use locard_engine::shot::Shot;

/// What a ghost depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Would {
    pub model: PathBuf,
    pub frame: usize,
    pub at_px: DVec2,
    pub lies_flat: bool,
    pub turned_deg: f64,
    /// The project's.
    pub version: u64,
}

/// See above.
#[derive(Debug, Default)]
pub struct Ghost {
    models: Arc<Mutex<ModelCache>>,
    running: Option<(Would, BackgroundTask<Border>)>,
    shown: Option<(Would, Border)>,
}

impl Ghost {
    /// Nothing is placed.
    pub fn rest(&mut self) {
        (self.running, self.shown) = (None, None);
    }

    /// Shows the thing where it would stand, as `laid` says it; nothing where that is not known.
    pub fn show(
        &mut self,
        seen: &Seen,
        would: Would,
        shot: &Shot,
        frame: &Arc<Frame>,
        file: PathBuf,
        laid: impl FnOnce(&Shot, &Frame) -> Option<PlacedModel> + Send + 'static,
    ) {
        if let Some((of, task)) = self.running.take() {
            match task.take() {
                Some(border) => self.shown = border.ok().map(|border| (of, border)),
                None => self.running = Some((of, task)),
            }
        }
        let is_known = self.shown.as_ref().is_some_and(|(of, _)| *of == would);
        if self.running.is_none() && !is_known {
            let (shot, frame, models) = (shot.clone(), Arc::clone(frame), Arc::clone(&self.models));
            let wake = seen.response.ctx.clone();
            let find = move || {
                let placed = laid(&shot, &frame)?;
                let alone = SceneFile { objects: vec![placed], ..SceneFile::default() };
                let mut models = models.lock().unwrap_or_else(PoisonError::into_inner);
                let scene =
                    load_file_with(&alone, &file, shot.recording.up, &mut models, MissingModels::Refuse).ok()?;
                let eye = shot.eye(frame.index).ok()?;
                Some(border(&eye, &scene, scene.objects.first()?))
            };
            let task =
                BackgroundTask::spawn("ghost", move || wake.request_repaint(), move || find().unwrap_or_default());
            self.running = task.ok().map(|task| (would.clone(), task));
        }
        let Some((_, border)) = self.shown.as_ref().filter(|(of, _)| of.model == would.model) else { return };
        let screen = |px: &DVec2| seen.placed.screen(vec2(px.x as f32, px.y as f32));
        let polygons: Vec<Vec<Pos2>> = border.iter().map(|polygon| polygon.iter().map(screen).collect()).collect();
        draw::footprint(&seen.painter, &polygons);
    }

    /// Where it was shown last, px of the picture.
    pub fn border(&self) -> Option<&Border> {
        self.shown.as_ref().map(|(_, border)| border)
    }
}
