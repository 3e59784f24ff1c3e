//! Why there is no camera.

use std::path::PathBuf;

use crate::source::SourceError;

#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    #[error("{asked}: is no camera; there {}; or name a video's file", are(found))]
    None { asked: String, found: Vec<String> },
    #[error("{}: there is no such file; a video's file is expected, or a camera's number or device: there {}", path.display(), are(found))]
    NoFile { path: PathBuf, found: Vec<String> },
    #[error("{}: may not be opened: {}", path.display(), advice)]
    Permission { path: PathBuf, advice: String },
    #[error("{}: another program uses it; end that one, then try again", path.display())]
    Busy { path: PathBuf },
    #[error("{}: takes no pictures", path.display())]
    TakesNone { path: PathBuf },
    #[error("{}: gives no {}; it has {}", path.display(), asked, if has.is_empty() { "nothing that is read here" } else { has })]
    Layout { path: PathBuf, asked: String, has: String },
    #[error("{}: {problem}", path.display())]
    Driver { path: PathBuf, problem: String },
    #[error("cameras are read on Linux, by programs built with the feature `camera`; name a video's file")]
    NotHere,
    #[error("a thread for the camera could not be started: {0}")]
    Thread(std::io::Error),
    #[error(transparent)]
    Source(#[from] SourceError),
}

fn are(found: &[String]) -> String {
    match found {
        [] => "is none on this machine (`locard doctor`)".to_owned(),
        [one] => format!("is {one}"),
        _ => format!("are {}", found.join(", ")),
    }
}
