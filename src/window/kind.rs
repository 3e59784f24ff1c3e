//! What a file or a folder is that was dropped into the window, or chosen.

use std::path::Path;

use crate::profile;
use crate::recording::Recording;
use crate::scene;
use crate::source::file::{self, MOST_DOCUMENT};

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kind {
    Recording,
    Scene,
    Profile,
    /// None of them, with the reasons.
    Neither(String),
}

impl Kind {
    /// Reads what is there, which may take its time.
    pub fn of(path: &Path) -> Self {
        let text = file::read_text(path, MOST_DOCUMENT).map_err(|error| error.to_string());
        let of_profile = text.and_then(|text| {
            let read = profile::Document::parse(&text, path).map_err(|error| error.to_string());
            read.map(drop)
        });
        match (of_profile, scene::document::read(path)) {
            (Ok(()), _) => Self::Profile,
            (_, Ok(_)) => Self::Scene,
            // Recordings too are described by such files.
            _ if Recording::is_at(path) => Self::Recording,
            (Err(no_profile), Err(no_scene)) => Self::Neither(format!(
                "{}: neither a recording's folder, nor a model, nor a profile ({no_profile}), nor a scene ({no_scene})",
                path.display()
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_told_by_what_is_in_them() {
        let kind = |path: &str| Kind::of(Path::new(path));
        assert_eq!(kind("recordings/demo"), Kind::Recording);
        assert_eq!(kind("recordings/demo/recording.toml"), Kind::Recording);
        assert_eq!((kind("scenes/demo.toml"), kind("profiles/simulated.toml")), (Kind::Scene, Kind::Profile));
        assert!(matches!(kind("no/where.toml"), Kind::Neither(why) if why.contains("no/where.toml")));
    }
}
