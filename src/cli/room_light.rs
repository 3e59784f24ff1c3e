//! `locard light`: the light that an analysis found, as a scene's `[light]` to edit.

mod lamp;
mod own;
mod white;

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use glam::Vec3;

use super::print_status;
use locard_engine::analyse::{Analysis, Findings, default_folder, panorama_beside};
use locard_engine::export::Inputs;
use locard_engine::recording::OpenOptions;
use locard_engine::scene::document::{LightTable, Up};
use locard_engine::scene::{self, Document, SceneFile};
use locard_engine::shot::{AnalysisChoice, AnalysisState, ReferencePick, Shot, ShotOptions};
use locard_engine::sink;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::text::shown;

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
    /// The scene file to write it into; everything else in it is kept, including comments
    #[arg(long)]
    scene: Option<PathBuf>,
    /// The results of `locard analyse`, if they are not beside the recording
    #[arg(long, value_name = "DIR")]
    analysis: Option<PathBuf>,
    /// A neutral matt surface: the frame, and column and row from the upper left. It reflects 0.8,
    /// as white paper and paint do, or the given value. The light gets the brightness and colour
    /// that it implies; may be repeated for several surfaces
    #[arg(long, value_name = "FRAME:X,Y[=REFLECTANCE]", value_parser = white::parse, allow_hyphen_values = true)]
    white: Vec<ReferencePick>,
    /// A visible lamp: the frame, column and row; without depth there also its distance from the
    /// camera in metres, or its place in another frame. Its brightness follows from the light on
    /// surfaces; may be repeated for several lamps
    #[arg(long, value_name = "FRAME:X,Y[,M][+FRAME:X,Y]", value_parser = lamp::MarkedLamp::parse, allow_hyphen_values = true)]
    lamp: Vec<lamp::MarkedLamp>,
    /// A Radiance or OpenEXR panorama of the place, which replaces the estimated one and its lamps;
    /// it is scaled to their brightness
    #[arg(long, value_name = "HDR")]
    environment: Option<PathBuf>,
    /// Rotation of that panorama about up, counter-clockwise seen from above
    #[arg(long, value_name = "DEG", requires = "environment", allow_hyphen_values = true, value_parser = own::turn)]
    turn: Option<f64>,
    /// The camera, if the recording lacks it
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Replace the light of the scene, and existing files
    #[arg(long)]
    force: bool,
    /// No output
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(args: &Args) -> Result<()> {
    let (shot, folder, analysis) = open_analysed(args)?;
    let (Some(light), Some(around)) = (&analysis.findings.light, &analysis.environment) else {
        let why = analysis.findings.light.as_ref().and_then(|light| light.why.as_deref()).unwrap_or(
            "no reason was \
                                                                                                  recorded",
        );
        bail!("{}: the light was not estimated from the footage: {why}", folder.display());
    };
    let path = match (&args.output, &args.scene) {
        (Some(path), _) | (None, Some(path)) => path,
        (None, None) => bail!("-o FILE or --scene SCENE is missing"),
    };
    if !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
        bail!("{}: the name of a scene file ends in .toml", path.display());
    }
    let hdr = panorama_beside(path);
    let inputs = Inputs::of(&shot).and(&args.environment);
    if args.environment.is_none() {
        inputs.check_file(&hdr)?;
        sink::check_file(&hdr, args.force)?;
    }
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
    let relit = lamp::relit(&shot, &analysis, &args.lamp)?;
    let (light, around) = relit.as_ref().map_or((light, around), |(light, around)| (light, around));
    let mut lines = light.lines();
    let mut lighting = light.lighting(around).context("the light that was found")?;
    // Radiance of a white surface that faces up.
    let place = light.place_m.unwrap_or_default().into();
    let turned = file.up.map_or(Ok(up.into()), |up| up.axis(path, "up"))?;
    let by = own::upward(&lighting, place, turned);
    lines.extend(lamp::dark_lamp_warnings(&args.lamp, &by));
    match &args.environment {
        Some(panorama) => {
            file.up = file.up.or(Some(Up::Direction(up)));
            // Lamps that the user pointed at are added to the panorama; other lamps are part of it.
            let kept = args.lamp.len();
            let target_light = by.far + by.lamps.iter().skip(kept).map(|lamp| lamp.0).sum::<Vec3>();
            let lamps = light.lamp_tables().into_iter().take(kept).collect();
            let (table, lit, line) = own::light(panorama, args.turn, lamps, (&file, path), turned, target_light)?;
            (file.light, lighting) = (table, lit);
            let mut user_lamps = 0..kept;
            lines.retain(|(what, _)| *what != "bounce" && (*what != "lamp" || user_lamps.next().is_some()));
            lines.push(("panorama", line));
        }
        None => {
            let name = hdr.file_name().unwrap_or_default().to_string_lossy().into_owned();
            light.put_into(&mut file, path, name).map_err(anyhow::Error::msg)?;
        }
    }
    if !args.white.is_empty() {
        let upward = own::upward(&lighting, place, turned).light();
        let (correction, about) = white::correction(&shot, &args.white, &lighting, (upward, light.between))?;
        correction.apply(&mut file.light);
        lines.extend(about);
    }
    document.set(file).context("the scene file")?;
    if args.environment.is_none() {
        write_atomically(&hdr, true, |out| out.write_all(&around.hdr))?;
    }
    write_atomically(path, true, |out| out.write_all(document.to_string().as_bytes()))?;
    let mut out = std::io::stdout().lock();
    for (what, text) in lines {
        writeln!(out, "{what:<11}{text}")?;
    }
    let written = args.environment.as_ref().map_or(format!(" and {}", hdr.display()), |_| String::new());
    print_status(args.quiet, &shown(&format!("{}{written}", path.display())));
    Ok(())
}

/// Opens the recording with its analysis and the analysis' folder.
fn open_analysed(args: &Args) -> Result<(Shot, PathBuf, Analysis)> {
    let analysis = args.analysis.clone().map_or(AnalysisChoice::Beside, AnalysisChoice::At);
    let shot_options = ShotOptions { profile: args.profile.clone(), analysis, ..ShotOptions::default() };
    let shot = Shot::open(&args.recording, &OpenOptions::default(), &shot_options)?;
    let recording = args.recording.display();
    let folder = match &shot.analysis {
        AnalysisState::Used(folder, _) => folder.clone(),
        AnalysisState::Unfit(folder, problem) => {
            bail!("{}: {problem}; `locard analyse {recording}` creates it again", folder.display())
        }
        AnalysisState::Absent | AnalysisState::Ignored => {
            let place = default_folder(&shot.recording.path);
            bail!("{}: there is no analysis; `locard analyse {recording}` estimates the light", place.display())
        }
    };
    let artefact = Analysis::read(&folder)?;
    let has_light = |findings: &Findings| findings.light.as_ref().is_some_and(|light| light.white_level.is_some());
    if let AnalysisState::Used(_, used) = &shot.analysis
        && !has_light(used)
        && has_light(&artefact.findings)
    {
        bail!("{}: {}; `locard analyse {recording}` creates it again", folder.display(), used.left_out.join("; "));
    }
    Ok((shot, folder, artefact))
}
