//! The cameras that there are, and one by what a person calls it.

use std::path::Path;

use super::error::CameraError;
use super::list::Listed;
use super::newest::{Newest, Putter};
use super::picture::Picture;
use super::played::Played;
use super::wanted::{Given, Wanted};
use crate::source::video::Overrides;

/// A camera that delivers. It stops when this is dropped.
#[derive(Debug)]
pub struct Camera {
    pub given: Given,
    pub newest: Newest<Picture>,
}

/// The cameras, by their numbers. Devices that take no pictures are left out.
pub fn cameras() -> Result<Vec<Listed>, CameraError> {
    #[cfg(all(feature = "camera", target_os = "linux"))]
    {
        Ok(super::negotiate::cameras())
    }
    #[cfg(not(all(feature = "camera", target_os = "linux")))]
    {
        Err(CameraError::NotHere)
    }
}

/// Opens a camera by its number, by its device (`/dev/video0`), or a video in its place by its file.
pub fn open(asked: &str, wanted: &Wanted) -> Result<Camera, CameraError> {
    #[cfg(all(feature = "camera", target_os = "linux"))]
    if let Some(number) = super::device::number(asked) {
        let path = super::negotiate::path_of(number);
        if !path.exists() {
            return Err(CameraError::None { asked: asked.to_owned(), found: super::negotiate::names() });
        }
        let (running, given) = super::device::Running::open(number, wanted)?;
        return started(given, move |putter| running.run(putter));
    }
    if asked.parse::<usize>().is_ok() {
        return Err(CameraError::NotHere);
    }
    let file = Path::new(asked);
    if !file.exists() {
        let found = cameras().unwrap_or_default();
        let found = found.into_iter().map(|camera| format!("{} ({})", camera.number, camera.name)).collect();
        return Err(CameraError::None { asked: asked.to_owned(), found });
    }
    let overrides = Overrides { range: wanted.range, matrix: wanted.matrix, ..Overrides::default() };
    let (played, given) = Played::open(file, &overrides)?;
    started(given, move |putter| played.run(putter))
}

fn started(given: Given, run: impl FnOnce(&Putter<Picture>) + Send + 'static) -> Result<Camera, CameraError> {
    let (putter, newest) = Newest::new();
    let thread = std::thread::Builder::new().name("camera".to_owned());
    thread.spawn(move || run(&putter)).map_err(CameraError::Thread)?;
    Ok(Camera { given, newest })
}
