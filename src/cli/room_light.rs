//! `locard light`: the light that an analysis found, as a scene's `[light]` to edit.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::tell;
use crate::analyse::{self, beside};
use crate::export::Inputs;
use crate::recording::OpenOptions;
use crate::scene::document::{Color, LampTable, LightTable, Up};
use crate::scene::{self, Document, SceneFile};
use crate::shot::{Analysed, AnalysisState, Given, Shot};
use crate::sink;
use crate::sink::atomic::write_atomically;
use crate::words::{fixed, shown};

/// Scenes' ups that differ by less are one: cosine of half a degree.
const SAME_UP: f64 = 0.99996;

#[derive(clap::Args)]
pub struct Args {
    /// Folder or file of the recording
    recording: PathBuf,
    /// A new scene file with nothing but the light
    #[arg(
        short = 'o',
        long = "output",
        value_name = "FILE",
        required_unless_present = "scene",
        conflicts_with = "scene"
    )]
    output: Option<PathBuf>,
    /// The scene file that gets it; everything else in it stays, comments too
    #[arg(long)]
    scene: Option<PathBuf>,
    /// What `locard analyse` found, where it does not lie beside the recording
    #[arg(long, value_name = "DIR")]
    analysis: Option<PathBuf>,
    /// The camera, where the recording does not know it
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Replace the light that the scene has, and files that are there
    #[arg(long)]
    force: bool,
    /// Say nothing
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(args: &Args) -> Result<()> {
    let analysis = args.analysis.clone().map_or(Analysed::Beside, Analysed::At);
    let given = Given { profile: args.profile.clone(), analysis, ..Given::default() };
    let shot = Shot::open(&args.recording, &OpenOptions::default(), &given)?;
    let recording = args.recording.display();
    let folder = match &shot.analysis {
        AnalysisState::Used(folder, _) => folder.clone(),
        AnalysisState::Unfit(folder, problem) => bail!("{}: {problem}: `locard analyse {recording}`", folder.display()),
        AnalysisState::Absent | AnalysisState::Left => {
            let place = beside(&shot.recording.path);
            bail!("{}: there is no analysis, which finds the light: `locard analyse {recording}`", place.display())
        }
    };
    let found = analyse::Analysis::read(&folder)?;
    let (Some(light), Some(around)) = (&found.findings.light, &found.environment) else {
        let why = found.findings.light.as_ref().and_then(|light| light.why.as_deref()).unwrap_or("nothing can be said");
        bail!("{}: the footage does not tell its light: {why}", folder.display());
    };
    let path = match (&args.output, &args.scene) {
        (Some(path), _) | (None, Some(path)) => path,
        (None, None) => bail!("-o FILE or --scene SCENE is missing"),
    };
    if !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
        bail!("{}: the name of a scene file ends in .toml", path.display());
    }
    let hdr = panorama_beside(path);
    let inputs = Inputs::of(&shot);
    inputs.check_file(&hdr)?;
    sink::check_file(&hdr, args.force)?;
    let up = light.up.unwrap_or([0.0, 0.0, 1.0]);
    let mut document = match &args.scene {
        Some(scene) => scene::document::read(scene)?,
        None => {
            inputs.check_file(path)?;
            sink::check_file(path, args.force)?;
            Document::new(SceneFile::default()).context("a new scene")?
        }
    };
    let mut file = document.value().clone();
    if file.light != LightTable::default() && !args.force {
        bail!("{}: it has a [light] already, which is kept; --force replaces it", path.display());
    }
    let is_same = |axis: glam::DVec3| axis.dot(glam::DVec3::from(up)) > SAME_UP;
    match file.up {
        Some(own) if !is_same(own.axis(path, "up")?) => {
            let up = up.map(|v| fixed(v, 3)).join(", ");
            bail!(
                "{}: its up is another than the analysis', [{up}]: the panorama would lie on its side",
                path.display()
            )
        }
        Some(_) => {}
        None => file.up = Some(Up::Direction(up)),
    }
    let name = hdr.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let lamp = |lamp: &analyse::FoundLamp| LampTable {
        at_m: lamp.at_m,
        color: Some(Color::Rgb(lamp.shown_at_1_m)),
        intensity: None,
        diameter_m: Some(analyse::FOUND_LAMP_M),
    };
    file.light = LightTable {
        environment: Some(name),
        white_lx: file.light.white_lx,
        lamp: light.lamps.iter().map(lamp).collect(),
        ..LightTable::default()
    };
    document.set(file).context("the scene file")?;
    write_atomically(&hdr, true, |out| out.write_all(&around.hdr))?;
    write_atomically(path, true, |out| out.write_all(document.to_string().as_bytes()))?;
    let mut out = std::io::stdout().lock();
    for (what, text) in light.lines() {
        writeln!(out, "{what:<11}{text}")?;
    }
    tell(args.quiet, &format!("{} and {}", shown(&path.display().to_string()), shown(&hdr.display().to_string())));
    Ok(())
}

/// Beside a scene file, of its name.
fn panorama_beside(scene: &Path) -> PathBuf {
    let stem = scene.file_stem().unwrap_or_default().to_string_lossy();
    scene.with_file_name(format!("{stem}-light.hdr"))
}
