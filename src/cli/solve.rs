//! `locard solve`.

use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use glam::DVec2;

use super::{analyse, print_status, progress_of, warn};
use locard_engine::analyse::default_folder;
use locard_engine::camera::Geometry;
use locard_engine::compositor::Settings;
use locard_engine::profile::{ProfileFile, Rig};
use locard_engine::recording::OpenOptions;
use locard_engine::sfm::{FootageFrames, MeasuredDistance, SolveOptions, new_folder, record, solve};
use locard_engine::shot::{AnalysisChoice, Shot, ShotOptions};
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};
use locard_engine::tags::{Board, Paper, Sheet};
use locard_engine::text::{count, reason};

#[derive(clap::Args)]
pub struct Args {
    /// A video, or a folder of photographs or of a video's frames
    input: PathBuf,
    /// The profile of the camera, if it is calibrated; without it, the lens is estimated
    #[arg(long)]
    profile: Option<PathBuf>,
    /// The positions of the tags in view; by default those of the sheet that `locard board` prints
    #[arg(long, value_name = "FILE")]
    board: Option<PathBuf>,
    /// A measured distance in metres between two points of a frame, in px, for the scale
    #[arg(long, value_name = "FRAME:X,Y:X,Y=M", value_parser = parse_distance)]
    distance: Option<MeasuredDistance>,
    /// The folder of the recording
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: PathBuf,
    /// Replace a recording that was solved
    #[arg(long)]
    force: bool,
    /// Do not analyse the recording afterwards
    #[arg(long)]
    no_analysis: bool,
    /// No progress bar and no warnings
    #[arg(long, short)]
    quiet: bool,
}

/// `30:210,330:330,260=0.42`.
fn parse_distance(text: &str) -> Result<MeasuredDistance, String> {
    let parsed = || {
        let (points, length) = text.split_once('=')?;
        let mut parts = points.split(':');
        let frame = parts.next()?.trim().parse().ok()?;
        let mut point = || {
            let (x, y) = parts.next()?.split_once(',')?;
            Some(DVec2::new(x.trim().parse().ok()?, y.trim().parse().ok()?)).filter(|at| at.is_finite())
        };
        let points_px = [point()?, point()?];
        let length_m: f64 = length.trim().parse().ok()?;
        let is_valid = parts.next().is_none() && length_m.is_finite() && length_m > 0.0;
        is_valid.then_some(MeasuredDistance { frame, points_px, length_m })
    };
    parsed().ok_or_else(|| {
        "expected FRAME:X,Y:X,Y=METRES, as in 30:210,330:330,260=0.42: two points of one frame, and a length above 0"
            .to_owned()
    })
}

pub fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    let (rig, profile) = match &args.profile {
        Some(path) => {
            let text = file::read_text(path, MAX_DOCUMENT_BYTES)
                .map_err(|error| anyhow::anyhow!("{}: cannot be read: {}", path.display(), reason(&error)))?;
            let mut rig = Rig::default();
            rig.read_text(&text, path, &mut Settings::default())?;
            (rig, Some(text))
        }
        None => (Rig::default(), None),
    };
    let camera = rig.camera();
    if let (None, Some(path)) = (&camera.geometry, &args.profile) {
        let missing = rig.missing_keys().join(", ");
        bail!("{}: [camera] lacks {missing}; `locard calibrate camera` measures them", path.display());
    }
    let board = match &args.board {
        Some(file) => Board::read(file)?,
        None => Sheet::new(Paper::A4).board,
    };
    let folder = new_folder(&args.output, args.force);
    let inputs: Vec<&Path> = [Some(&args.input), args.profile.as_ref(), args.board.as_ref()]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
        .collect();
    // Checked before the work starts, so that no files of the user are lost.
    folder.check(&inputs)?;
    let footage = FootageFrames::open(&args.input)?;
    footage.warnings().iter().for_each(|text| warn(args.quiet, text));
    let bar = progress_of(args.quiet, 100, "{wide_bar} {pos}/{len}, {msg}");
    let solved = solve(
        &footage,
        &SolveOptions {
            camera: camera.geometry.as_ref(),
            response: &camera.response,
            board: &board,
            is_board_named: args.board.is_some(),
            distance: args.distance,
        },
        &mut |stage, done, steps| {
            bar.set_message(stage.name());
            bar.set_length(steps as u64);
            bar.set_position(done as u64);
            ControlFlow::Continue(())
        },
    );
    bar.finish_and_clear();
    let solution = solved.with_context(|| args.input.display().to_string())?;
    let profile = profile.unwrap_or_else(|| estimated_profile(&solution.geometry));
    record(&folder, &footage, &solution, profile)?;
    write!(std::io::stdout().lock(), "{solution}")?;
    let poses = count(solution.frames.iter().flatten().count(), "pose");
    print_status(args.quiet, &format!("{poses} in {:.0} s: {}", start.elapsed().as_secs_f64(), args.output.display()));
    if args.no_analysis || footage.is_unordered() {
        return Ok(());
    }
    let options = ShotOptions { analysis: AnalysisChoice::No, ..ShotOptions::default() };
    let shot = Shot::open(&args.output, &OpenOptions::default(), &options)?;
    let (analysis, _) = analyse::make(&shot, &default_folder(&args.output), args.force, args.quiet)?;
    write!(std::io::stdout().lock(), "{}", analysis.findings)?;
    Ok(())
}

/// A profile with an estimated lens.
fn estimated_profile(geometry: &Geometry) -> String {
    let mut profile = ProfileFile::new(
        "The camera as `locard solve` estimated it, together with its path; `locard calibrate camera` is more exact.",
    );
    profile.set_estimated_geometry(geometry);
    profile.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measured_distance_is_parsed_or_explained() {
        let parsed = parse_distance("30:210,330.5:330,260=0.42").unwrap();
        assert_eq!((parsed.frame, parsed.length_m), (30, 0.42));
        assert_eq!(parsed.points_px, [DVec2::new(210.0, 330.5), DVec2::new(330.0, 260.0)]);
        for text in [
            "",
            "30:1,2=3",
            "30:1,2:3,4",
            "30:1,2:3,4=0",
            "30:1,2:3,4=nan",
            "30:1,2:3,4:5,6=1",
            "a:1,2:3,4=1",
            "1:x,2:3,4=1",
        ] {
            assert!(parse_distance(text).unwrap_err().contains("30:210,330:330,260=0.42"), "{text}");
        }
    }
}
