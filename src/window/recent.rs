//! What was opened lately, the last one first, and where in it one was.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use eframe::egui::Context;
use serde::{Deserialize, Serialize};

use super::errand::Errand;
use super::project::Project;
use super::state;
use locard_engine::live::LiveFrom;

const MOST: usize = 12;
/// How often it is looked whether they are still there.
const LOOKED_EVERY: Duration = Duration::from_secs(2);

/// A recording with what was opened with it. Paths are absolute.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct Opened {
    pub recording: PathBuf,
    pub scene: Option<PathBuf>,
    pub profile: Option<PathBuf>,
    pub metres_per_unit: f64,
    #[serde(default)]
    pub at: At,
    /// In place of a recording; its path is the camera's name then.
    #[serde(default)]
    pub camera: Option<LiveFrom>,
}

/// Where one was: the frame, and how it was looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(default)]
pub struct At {
    pub frame: usize,
    /// Screen pixels to a picture's; `None`: as large as it fits.
    pub zoom: Option<f32>,
    /// The place of the picture in the middle, as a share of its size.
    pub centre: [f32; 2],
}

impl Opened {
    /// A recording alone.
    pub fn recording(recording: PathBuf) -> Self {
        Self { recording, scene: None, profile: None, metres_per_unit: 1.0, at: At::default(), camera: None }
    }

    /// A camera, with what is put to it.
    pub fn camera(from: LiveFrom, profile: Option<PathBuf>, scene: Option<PathBuf>) -> Self {
        let name = PathBuf::from(from.name());
        Self { scene, profile, camera: Some(from), ..Self::recording(name) }
    }

    /// What is open, at its beginning.
    pub fn of(project: &Project) -> Self {
        let whole = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let (scene, profile) = (project.scene.as_deref().map(whole), project.profile.as_deref().map(whole));
        match project.camera.clone().filter(|_| project.shot().recording.is_arriving()) {
            Some(from) => Self::camera(from, profile, scene),
            None => Self {
                scene,
                profile,
                metres_per_unit: project.metres_per_unit,
                ..Self::recording(whole(&project.shot().recording.path))
            },
        }
    }
}

/// Puts what is opened first.
fn add_to(list: &mut Vec<Opened>, opened: Opened) {
    list.retain(|other| other.recording != opened.recording);
    list.insert(0, opened);
    list.truncate(MOST);
}

/// Writes the list on a thread of its own.
#[derive(Debug)]
struct Writer {
    orders: Option<Sender<Opened>>,
    /// As they stand in the file: other windows add to it.
    lists: Receiver<Vec<Opened>>,
    thread: Option<JoinHandle<()>>,
}

impl Writer {
    /// `None` where no thread can be had.
    fn begin(file: PathBuf) -> Option<Self> {
        let ((orders, to_do), (tell, lists)) = (channel(), channel());
        let thread = Builder::new().name("recent".to_owned()).spawn(move || {
            for opened in to_do {
                // Another window may have added to it.
                let mut list = state::read(&file);
                add_to(&mut list, opened);
                // That it cannot be kept is no reason to stop.
                state::keep(&file, &list);
                let _ = tell.send(list);
            }
        });
        Some(Self { orders: Some(orders), lists, thread: Some(thread.ok()?) })
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        drop(self.orders.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The list of a file. Without a file it is empty, and is kept nowhere.
#[derive(Debug, Default)]
pub struct Recent {
    writer: Option<Writer>,
    list: Vec<Opened>,
    /// Those that are no longer there.
    gone: Vec<PathBuf>,
    looking: Option<Errand<Vec<PathBuf>>>,
    looked: Option<Instant>,
}

impl Recent {
    pub fn read(file: PathBuf) -> Self {
        let list = state::read(&file);
        Self { writer: Writer::begin(file), list, ..Self::default() }
    }

    /// Puts what is opened first.
    pub fn add(&mut self, opened: Opened) {
        if let Some(orders) = self.writer.as_ref().and_then(|writer| writer.orders.as_ref()) {
            let _ = orders.send(opened.clone());
        }
        add_to(&mut self.list, opened);
    }

    /// Each with whether it is still there, as far as that is known: a disk may be slow to say it.
    pub fn shown(&mut self, ctx: &Context) -> impl Iterator<Item = (&Opened, bool)> + use<'_> {
        if let Some(list) = self.writer.as_ref().and_then(|writer| writer.lists.try_iter().last()) {
            self.list = list;
        }
        if let Some(gone) = self.looking.as_ref().and_then(Errand::take) {
            (self.gone, self.looking) = (gone.unwrap_or_default(), None);
        }
        if self.looking.is_none() && self.looked.is_none_or(|looked| looked.elapsed() >= LOOKED_EVERY) {
            let recordings = self.list.iter().filter(|opened| opened.camera.is_none());
            let (wake, paths) = (ctx.clone(), recordings.map(|opened| opened.recording.clone()));
            let paths: Vec<PathBuf> = paths.collect();
            let gone = move || paths.into_iter().filter(|path| !path.exists()).collect();
            self.looking = Errand::begin("recent there", move || wake.request_repaint(), gone).ok();
            self.looked = Some(Instant::now());
        }
        self.list.iter().map(|opened| (opened, !self.gone.contains(&opened.recording)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_comes_first_and_each_once() {
        let temp = tempfile::tempdir().unwrap();
        let file = temp.path().join("new/recent.json");
        let opened = |n: usize| Opened {
            profile: Some("/p.toml".into()),
            at: At { frame: n, ..At::default() },
            ..Opened::recording(format!("/r/{n}").into())
        };
        let mut recent = Recent::read(file.clone());
        let mut other = Recent::read(file.clone());
        (0..MOST).for_each(|n| recent.add(opened(n)));
        drop(recent);
        // It has not seen what the first one added.
        other.add(opened(99));
        other.add(opened(5));
        drop(other);
        let list = Recent::read(file.clone()).list;
        assert_eq!((list.len(), &list[0], &list[1]), (MOST, &opened(5), &opened(99)));
        assert_eq!(list.iter().filter(|o| **o == opened(5)).count(), 1);
        std::fs::write(&file, "no list").unwrap();
        assert!(Recent::read(file).list.is_empty());
    }
}
