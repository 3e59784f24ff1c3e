//! `locard tune`: the window.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, anyhow};

use locard_engine::assets;
use locard_engine::recording::OpenOptions;
use locard_engine::shot::ShotOptions;
use locard_window::{self, DEMO, DEMO_SCENE, InitialContent, Measure, Project};

#[derive(clap::Args)]
pub struct Args {
    /// The recording; by default the demonstration
    recording: Option<PathBuf>,
    /// The scene file or model to put into it
    #[arg(long)]
    scene: Option<PathBuf>,
    /// A camera's profile; a new file is made when it is saved
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Length of a unit of the recording, in metres
    #[arg(long, default_value_t = 1.0)]
    metres_per_unit: f64,
    /// Measure the cost of the window: it plays, changes each parameter, prints figures and closes
    #[arg(long)]
    measure: bool,
}

pub fn run(args: Args) -> Result<()> {
    let started = Instant::now();
    let Args { recording, mut scene, profile, metres_per_unit, measure } = args;
    let is_demo = recording.is_none();
    let demo = assets::find(DEMO);
    if is_demo && !measure && demo.is_none() {
        return check_opened(locard_window::open(InitialContent { start: true, ..InitialContent::default() }));
    }
    if is_demo {
        scene = scene.or_else(|| Some(assets::path(DEMO_SCENE)));
    }
    let recording = recording.or(demo).unwrap_or_else(|| DEMO.into());
    let new_profile = profile.clone().filter(|path| !path.exists());
    let shot_options = ShotOptions {
        profile: profile.filter(|path| path.exists()),
        sets: Vec::new(),
        scene,
        ..ShotOptions::default()
    };
    let options = OpenOptions { metres_per_unit, ..OpenOptions::default() };
    let mut project = Project::open(&recording, &options, &shot_options)?;
    if let Some(path) = new_profile {
        project.profile = Some(path);
    }
    let measure = measure.then(|| Measure::new(started, project.shot())).transpose()?;
    check_opened(locard_window::open(InitialContent {
        project: Some(project),
        start: is_demo,
        measure,
        ..InitialContent::default()
    }))
}

pub fn check_opened(ended: Result<(), locard_window::Error>) -> Result<()> {
    ended.map_err(|error| anyhow!("the window cannot be opened: {}", reason(&error.to_string())))
}

/// The reason without source files of libraries, or a hint for the user.
fn reason(error: &str) -> String {
    let has = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    if cfg!(target_os = "linux") && !has("DISPLAY") && !has("WAYLAND_DISPLAY") {
        return "there is no display (DISPLAY and WAYLAND_DISPLAY are unset): start it on a desktop or through ssh -X; \
                all other commands work without one"
            .to_owned();
    }
    // For example "os error at /src/mod.rs:788: Failed to open connection to X server".
    let after = error.rsplit_once(".rs:").and_then(|(_, rest)| rest.split_once(": "));
    after.map_or(error, |(_, reason)| reason).to_owned()
}

#[cfg(test)]
mod tests {
    #[test]
    fn reason_omits_source_files_of_libraries() {
        let error = "os error at /src/linux/mod.rs:788: Failed to open connection to X server";
        let text = super::reason(error);
        assert!(!text.contains("mod.rs") && (text.contains("X server") || text.contains("no display")), "{text}");
        if text.contains("X server") {
            assert_eq!(super::reason("no adapter"), "no adapter");
        }
    }
}
