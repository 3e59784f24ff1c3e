//! Preview of a placement: outline of the model at the pointer, where the next click places it.
//!
//! It is computed on a thread of its own, one position at a time, so that a large model does not
//! block the window.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use eframe::egui::{Pos2, vec2};
use glam::DVec2;

use super::super::picture::PictureOutput;
use super::super::task::BackgroundTask;
use super::draw;
use super::outline::{Outline, outline};
use locard_engine::frame::Frame;
use locard_engine::scene::document::PlacedModel;
use locard_engine::scene::{LoadedModels, MissingModels, SceneFile, load_file_with};
use locard_engine::shot::Shot;

/// Inputs of a preview.
#[derive(Clone, Debug, PartialEq)]
pub struct PreviewKey {
    pub model: PathBuf,
    pub frame: usize,
    pub at_px: DVec2,
    pub lies_flat: bool,
    pub turned_deg: f64,
    /// Version of the project.
    pub version: u64,
}

/// The current preview and the computation of the next one.
#[derive(Debug)]
pub struct PlacementPreview {
    models: Arc<Mutex<LoadedModels>>,
    running: Option<(PreviewKey, BackgroundTask<Outline>)>,
    /// No memo: it is shown until the outline of a newer key has arrived.
    shown: Option<(PreviewKey, Outline)>,
}

impl PlacementPreview {
    pub fn new(models: Arc<Mutex<LoadedModels>>) -> Self {
        Self { models, running: None, shown: None }
    }

    /// Shows the outline of the item that `lay` places; nothing where it returns `None`.
    pub fn show(
        &mut self,
        picture: &PictureOutput,
        key: PreviewKey,
        shot: &Shot,
        frame: &Arc<Frame>,
        file: PathBuf,
        lay: impl FnOnce(&Shot, &Frame) -> Option<PlacedModel> + Send + 'static,
    ) {
        if let Some((of, task)) = self.running.take() {
            match task.take() {
                Some(outline) => self.shown = outline.ok().map(|outline| (of, outline)),
                None => self.running = Some((of, task)),
            }
        }
        let is_current = self.shown.as_ref().is_some_and(|(of, _)| *of == key);
        if self.running.is_none() && !is_current {
            let (shot, frame, models) = (shot.clone(), Arc::clone(frame), Arc::clone(&self.models));
            let wake = picture.response.ctx.clone();
            let compute = move || {
                let placed = lay(&shot, &frame)?;
                let alone = SceneFile { objects: vec![placed], ..SceneFile::default() };
                let mut models = models.lock().unwrap_or_else(PoisonError::into_inner);
                let scene =
                    load_file_with(&alone, &file, shot.recording.up, &mut models, MissingModels::Refuse).ok()?;
                let eye = shot.posed_camera(frame.index).ok()?;
                Some(outline(&eye, &scene, scene.objects.first()?))
            };
            let task =
                BackgroundTask::spawn("preview", move || wake.request_repaint(), move || compute().unwrap_or_default());
            self.running = task.ok().map(|task| (key.clone(), task));
        }
        let Some((_, outline)) = self.shown.as_ref().filter(|(of, _)| of.model == key.model) else { return };
        let screen = |px: &DVec2| picture.placed.screen(vec2(px.x as f32, px.y as f32));
        let polygons: Vec<Vec<Pos2>> = outline.iter().map(|polygon| polygon.iter().map(screen).collect()).collect();
        draw::footprint(&picture.painter, &polygons);
    }

    /// The current outline, px of the picture.
    pub fn outline(&self) -> Option<&Outline> {
        self.shown.as_ref().map(|(_, outline)| outline)
    }
}
