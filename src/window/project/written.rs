//! What a project writes: its profile and its scene file, whose comments and other keys stay.

use std::path::{Path, PathBuf};

use super::super::Project;
use super::tables;
use crate::compositor::Settings;
use crate::profile::{self, ProfileError, Rig};
use crate::scene::{self, SceneError, SceneFile};
use crate::sink::SinkError;
use crate::sink::atomic::write_atomically;
use crate::source::file::{self, MOST_DOCUMENT};

/// Why something was not saved.
#[derive(Debug, thiserror::Error)]
pub enum SaveError {
    #[error(transparent)]
    Profile(#[from] ProfileError),
    #[error(transparent)]
    Sink(#[from] SinkError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error("{path}: {reason}")]
    Text { path: PathBuf, reason: String },
}

impl Project {
    /// Writes what differs from the recording's own camera and from a profile's text into that profile, whose comments and
    /// other keys stay. A new file is made where there is none.
    pub fn save_profile(&mut self, path: &Path) -> Result<(), SaveError> {
        let (mut rig, mut settings) = (Rig::default(), Settings::default());
        if let Some(own) = &self.shot.recording.camera_profile {
            rig.read(own, &mut settings)?;
        }
        if let Some(geometry) = &self.shot.recording.geometry {
            rig.lay_over(geometry);
        }
        let mut document = match path.exists() {
            true => {
                let failed = |source| ProfileError::Read { path: path.to_owned(), source };
                let bytes = file::read(path, MOST_DOCUMENT).map_err(failed)?;
                let text = String::from_utf8(bytes).map_err(|_| SaveError::Text {
                    path: path.to_owned(),
                    reason: "the file is no text, so no profile: nothing was saved".to_owned(),
                })?;
                rig.read_text(&text, path, &mut settings)?;
                profile::Document::parse(&text, path)?
            }
            false => profile::Document::new(""),
        };
        let edit = self.edit().clone();
        let [before, now] =
            [(&rig, &settings), (&edit.rig, &edit.settings)].map(|(rig, settings)| tables(rig, settings));
        for (before, now) in before.into_iter().zip(now) {
            for spec in now.specs() {
                if before.get(spec.name) != now.get(spec.name) {
                    document.set_param(now, spec.name);
                }
            }
        }
        for effect in edit.settings.effects().map(|effect| effect.table()) {
            let on = edit.settings.is_on(effect);
            if settings.is_on(effect) != on {
                document.switch(effect, on);
            }
        }
        match &edit.rig.noise {
            Some(noise) if rig.noise.as_ref() != Some(noise) => {
                document.set_noise(noise, "`'s method, from places picked in the window.");
            }
            None => document.remove_noise(),
            Some(_) => {}
        }
        write_atomically(path, true, |writer| std::io::Write::write_all(writer, document.to_string().as_bytes()))?;
        self.saved.rig = edit.rig;
        self.saved.settings = edit.settings;
        self.profile = Some(path.to_owned());
        Ok(())
    }

    /// Writes the scene file, whose comments and order stay. In another folder it names the same models.
    pub fn save_scene(&mut self, path: &Path) -> Result<(), SaveError> {
        let from = self.scene_path();
        let scene = moved(&self.edit().scene, &from, path);
        let failed =
            |error: &dyn std::fmt::Display| SaveError::Text { path: path.to_owned(), reason: error.to_string() };
        let text = match self.scene_text.take() {
            Some(mut text) => {
                let done = text.set(scene.clone());
                let written = text.to_string();
                self.scene_text = Some(text);
                done.map(|()| written).map_err(|e| failed(&e))?
            }
            None => {
                let made = scene::Document::new(scene.clone()).map_err(|e| failed(&e))?;
                self.scene_text.insert(made).to_string()
            }
        };
        write_atomically(path, true, |writer| std::io::Write::write_all(writer, text.as_bytes()))?;
        self.history.each(|edit| edit.scene = moved(&edit.scene, &from, path));
        self.opened.scene = moved(&self.opened.scene, &from, path);
        self.loaded = moved(&self.loaded, &from, path);
        self.saved.scene = scene;
        self.scene = Some(path.to_owned());
        Ok(())
    }
}

/// A scene whose file moves: its models and its panorama are the same files.
fn moved(scene: &SceneFile, from: &Path, to: &Path) -> SceneFile {
    let folder = |path: &Path| std::path::absolute(path).ok().and_then(|path| Some(path.parent()?.to_owned()));
    let mut scene = scene.clone();
    let (Some(old), Some(new)) = (folder(from), folder(to)) else { return scene };
    if old != new {
        let names = scene.objects.iter_mut().map(|object| &mut object.model).chain(&mut scene.light.environment);
        names.for_each(|name| *name = scene::relative(&old.join(&*name), to));
    }
    scene
}
