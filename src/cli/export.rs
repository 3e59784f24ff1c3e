//! `locard export`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Result;

use super::analysis::AnalysisArgs;
use super::composite::{frame_range, parse_range};
use super::open::OpenArgs;
use super::{export_error, warn};
use locard_engine::export::Inputs;
use locard_engine::export::camera::{CameraExport, CameraFormat};
use locard_engine::recording::Recording;
use locard_engine::shot::ShotOptions;

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: ExportTarget,
}

#[derive(clap::Subcommand)]
enum ExportTarget {
    /// The camera of each frame, with the evidence: Nuke's .chan, USD, glTF; the lens as ST maps
    Camera(ExportCameraArgs),
}

#[derive(clap::Args)]
struct ExportCameraArgs {
    /// Folder or file of the recording
    recording: PathBuf,
    /// One or several, with commas between
    #[arg(long, value_enum, value_delimiter = ',', required = true)]
    format: Vec<FormatChoice>,
    /// Evidence to put in place: a .glb or .gltf in the recording's world coordinates, or a
    /// scene.toml
    #[arg(long)]
    scene: Option<PathBuf>,
    /// A folder for the camera, its ST maps, the list of frames and a README.txt
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: PathBuf,
    /// Half-open range of frames, counted from 0, as in 40..50
    #[arg(long, value_name = "A..B", value_parser = parse_range)]
    frames: Option<(Option<usize>, Option<usize>)>,
    /// Number of the recording's first frame in the other program
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true)]
    first_frame: i64,
    /// Frame rate of the other program, by default the recording's; glTF then has one keyframe per
    /// frame of this rate (Blender), instead of the frames' own times
    #[arg(long, value_name = "HZ", value_parser = frame_rate)]
    fps: Option<f64>,
    /// The recorded poses, even if an analysis refined them
    #[arg(long)]
    recorded: bool,
    /// The camera, if the recording lacks it
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Set a parameter, as in --set camera.fx_px=1200; `locard params` lists them
    #[arg(long = "set", value_name = "TABLE.NAME=VALUE")]
    sets: Vec<String>,
    /// Replace files that exist
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    analysis: AnalysisArgs,
    #[command(flatten)]
    open: OpenArgs,
    /// No progress bar, no warnings
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum FormatChoice {
    /// Nuke: the camera alone
    Chan,
    /// USD as text
    Usda,
    /// glTF, as .glb
    Gltf,
}

impl FormatChoice {
    fn format(self) -> CameraFormat {
        match self {
            Self::Chan => CameraFormat::Chan,
            Self::Usda => CameraFormat::Usda,
            Self::Gltf => CameraFormat::Gltf,
        }
    }
}

fn frame_rate(text: &str) -> Result<f64, String> {
    let rate = text.trim().parse().ok().filter(|fps| (1e-3..=1e5).contains(fps));
    rate.ok_or_else(|| "expected 0.001 to 100000 frames per second".to_owned())
}

pub fn run(args: &Args) -> Result<()> {
    match &args.what {
        ExportTarget::Camera(args) => camera(args),
    }
}

fn camera(args: &ExportCameraArgs) -> Result<()> {
    let options = args.open.options();
    let shot_options = ShotOptions {
        profile: args.profile.clone(),
        sets: args.sets.clone(),
        scene: args.scene.clone(),
        analysis: args.analysis.choice(),
        recorded_poses: args.recorded,
        ..ShotOptions::default()
    };
    let mut formats: Vec<CameraFormat> = Vec::new();
    for format in args.format.iter().map(|choice| choice.format()) {
        if !formats.contains(&format) {
            formats.push(format);
        }
    }
    let recording = Recording::open(&args.recording, &options)?;
    let (shot, export) = args.analysis.open(recording, &shot_options, args.quiet, |shot| {
        let range = frame_range(args.frames, shot.recording.frame_count())?;
        let export = CameraExport {
            range,
            folder: args.output.clone(),
            formats: formats.clone(),
            first_number: args.first_frame,
            fps: args.fps,
            force: args.force,
        };
        export.plan(shot).and_then(|plan| plan.check(&Inputs::of(shot))).map_err(export_error)?;
        Ok(export)
    })?;
    let plan = export.plan(&shot).map_err(export_error)?;
    let of_analysis =
        shot.unused_analysis_note().into_iter().chain(shot.stale_estimates()).map(|note| note.to_string());
    let recording = &shot.recording;
    let missing =
        recording.missing_poses(export.range.clone()).map(|text| text.replace("passed through untouched", "left out"));
    let of_scene = shot.scene.warnings.iter().cloned();
    for text in recording.warnings.iter().cloned().chain(of_analysis).chain(missing).chain(of_scene).chain(plan.notes())
    {
        warn(args.quiet, &text);
    }
    if args.scene.is_some() && !formats.iter().any(|format| format.has_scene()) {
        warn(args.quiet, "--scene: a .chan has no evidence; --format usda and gltf have it");
    }
    let mut out = std::io::stdout().lock();
    for file in plan.write().map_err(export_error)? {
        writeln!(out, "{}", file.display())?;
    }
    Ok(())
}
