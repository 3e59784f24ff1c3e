//! The cameras that there are, and one by what a person calls it.

use std::path::Path;

use super::error::CameraError;
use super::list::Listed;
use super::newest::{Newest, Putter};
use super::picture::Picture;
use super::played::Played;
use super::wanted::{Given, Wanted};
use crate::source::video::Overrides;

/// Puts pictures until nobody takes them any more.
type Run = Box<dyn FnOnce(&Putter<Picture>) + Send>;

/// A camera that has agreed on what it gives, and is not started.
pub struct Camera {
    pub given: Given,
    run: Run,
}

impl Camera {
    /// Has it deliver, until what is given here is dropped. A video begins now.
    pub fn start(self) -> Result<Newest<Picture>, CameraError> {
        let (putter, newest) = Newest::new();
        let thread = std::thread::Builder::new().name("camera".to_owned());
        thread.spawn(move || (self.run)(&putter)).map_err(CameraError::Thread)?;
        Ok(newest)
    }
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
        return Ok(Camera { given, run: Box::new(move |putter| running.run(putter)) });
    }
    if asked.parse::<usize>().is_ok() {
        return Err(CameraError::NotHere);
    }
    let file = Path::new(asked);
    if !file.exists() {
        let found = cameras().unwrap_or_default();
        let found = found.into_iter().map(|camera| format!("{} ({})", camera.number, camera.name)).collect();
        // What looks like a file's name was meant as one.
        return Err(match file.extension().is_some() || asked.contains(std::path::MAIN_SEPARATOR) {
            true => CameraError::NoFile { path: file.to_owned(), found },
            false => CameraError::None { asked: asked.to_owned(), found },
        });
    }
    let overrides = Overrides { range: wanted.range, matrix: wanted.matrix, ..Overrides::default() };
    let (played, given) = Played::open(file, &overrides)?;
    Ok(Camera { given, run: Box::new(move |putter| played.run(putter)) })
}
