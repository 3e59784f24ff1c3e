//! Why there is no camera.

use std::path::PathBuf;

use super::driver_name::DriverName;
use super::list::CameraMode;
use crate::source::SourceError;

/// Why a camera could not be opened, or has no pictures.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    #[error("{name}: is not a camera; there {}; or give a video file", available_cameras(cameras))]
    NotACamera { name: String, cameras: Vec<String> },
    #[error("{}: there is no such file; expected a video file, or a camera's number or device: there {}", path.display(), available_cameras(cameras))]
    NoFile { path: PathBuf, cameras: Vec<String> },
    #[error("{camera}: permission denied: {advice}")]
    Permission { camera: String, advice: String },
    #[error("{camera}: another program uses it; close that, then try again")]
    Busy { camera: String },
    #[error("{camera} is unplugged")]
    Unplugged { camera: String },
    #[error("{camera}: captures no pictures")]
    NoCapture { camera: String },
    #[error("{camera}: does not offer {layout}; it has {}", if has.is_empty() { "no supported format" } else { has })]
    Layout { camera: String, layout: String, has: String },
    #[error("{camera}: {problem}")]
    Driver { camera: String, problem: String },
    #[error("{camera}: its driver has not answered for {seconds} s; unplug it, or end the program that uses it")]
    NoAnswer { camera: String, seconds: f64 },
    #[error("this program was built without cameras; build it with the feature `camera`, or name a video's file")]
    NotBuilt,
    #[error("the driver {driver} is not on this system; leave --driver out, or choose {here}")]
    NoDriver { driver: DriverName, here: DriverName },
    #[error(
        "this program may not use cameras; allow it (System Settings, Privacy & Security, Camera: the terminal that it \
         is started from), then start it again"
    )]
    NotAllowed,
    #[error("a thread for the camera could not be started: {0}")]
    Thread(std::io::Error),
    #[error(transparent)]
    Source(#[from] SourceError),
}

impl CameraError {
    /// No mode of those that are offered has the layout.
    pub fn layout(camera: &str, layout: &str, offered: &[CameraMode]) -> Self {
        let mut has: Vec<&str> = offered.iter().map(|mode| mode.code.as_str()).collect();
        has.dedup();
        Self::Layout { camera: camera.to_owned(), layout: layout.to_owned(), has: has.join(", ") }
    }
}

/// The end of a sentence that begins with "there".
fn available_cameras(cameras: &[String]) -> String {
    match cameras {
        [] => "is none on this machine (`locard doctor`)".to_owned(),
        [one] => format!("is {one}"),
        _ => format!("are {}", cameras.join(", ")),
    }
}
