//! `locard calibrate camera`.

use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use super::existing::{existing, pictures_beside, unreadable};
use super::watched::collect_views;
use crate::cli::watching::PicturesArgs;
use locard_engine::calibrate::board::{ChessboardSize, TargetChoice};
use locard_engine::calibrate::geometry::{
    CameraCalibration, LensOptions, Views, calibrate, residuals, views_from_paths,
};
use locard_engine::camera::{LensModel, Response};
use locard_engine::compositor::Settings;
use locard_engine::export::Inputs;
use locard_engine::params::{Field, Value};
use locard_engine::profile::Rig;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::sink::photograph;
use locard_engine::tags;

#[derive(clap::Args)]
pub struct Args {
    /// Photographs of a chessboard or of the sheet that `locard board` prints, folders of them, or
    /// videos: one camera, one zoom, one focus
    #[arg(required_unless_present = "camera")]
    photos: Vec<PathBuf>,
    /// Instead of photographs, a camera (its number or device), or a video that is played in its
    /// place: views are taken while the board is held still
    #[arg(long, value_name = "N|VIDEO", conflicts_with = "photos")]
    camera: Option<String>,
    /// With --camera: minimum number of views; collection continues until no view is missing
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(3..=200))]
    views: u64,
    /// A chessboard's inner corners, where four squares meet, as 9x6, or the file of a board of
    /// tags; by default the board that is detected
    #[arg(long, value_name = "COLUMNSxROWS|FILE", value_parser = board)]
    board: Option<BoardArg>,
    /// The side of a square, for distances in millimetres
    #[arg(long, value_name = "MM", value_parser = square, allow_negative_numbers = true)]
    square_mm: Option<f64>,
    /// Projection of the lens: opencv or opencv_fisheye; by default the one that fits the
    /// photographs
    #[arg(long, value_parser = model)]
    model: Option<LensModel>,
    /// The profile to write; everything else in it is kept
    #[arg(short = 'o', long = "output", value_name = "PROFILE")]
    output: PathBuf,
    /// A picture of the residuals to write (.png, .jpg)
    #[arg(long, value_name = "FILE")]
    residuals: Option<PathBuf>,
    /// Replace the lens of a profile that has one, and an existing picture
    #[arg(long)]
    force: bool,
    #[command(flatten, next_help_heading = "With --camera")]
    pictures: PicturesArgs,
}

/// A chessboard's size, or the file of a board of tags.
#[derive(Clone, Debug)]
enum BoardArg {
    Size(ChessboardSize),
    File(PathBuf),
}

impl BoardArg {
    fn target_choice(&self) -> Result<TargetChoice> {
        Ok(match self {
            Self::Size(board) => TargetChoice::Chessboard(*board),
            Self::File(file) => TargetChoice::Tags(tags::Board::read(file)?),
        })
    }
}

fn board(text: &str) -> Result<BoardArg, String> {
    let accepted = "expected the inner corners of both sides of a chessboard, 3 to 200 each, as in 9x6, or the file of a \
                    board of tags";
    let sides = text.trim().split_once(['x', 'X', '×']);
    let sides = sides.and_then(|(columns, rows)| Some((columns.trim().parse().ok()?, rows.trim().parse().ok()?)));
    match sides {
        Some((columns, rows)) if (3..=200).contains(&columns) && (3..=200).contains(&rows) => {
            Ok(BoardArg::Size(ChessboardSize::new(columns, rows)))
        }
        None if Path::new(text).is_file() => Ok(BoardArg::File(text.into())),
        Some(_) => Err(accepted.to_owned()),
        None => Err(format!("there is no such file; {accepted}")),
    }
}

fn square(text: &str) -> Result<f64, String> {
    let side = text.trim().parse().ok().filter(|mm: &f64| *mm >= 0.01 && *mm <= 1e5);
    side.ok_or_else(|| "expected a length of 0.01 to 100000 mm".to_owned())
}

fn model(text: &str) -> Result<LensModel, String> {
    let kind = LensModel::kind(None);
    let named = LensModel::from_value(&Value::Text(text.to_owned()), &kind)
        .filter(|model| matches!(model, LensModel::Opencv | LensModel::OpencvFisheye));
    named.ok_or_else(|| "expected opencv or opencv_fisheye".to_owned())
}

fn from_photos(
    args: &Args,
    target: &TargetChoice,
    response: &Response,
    options: &LensOptions,
) -> Result<CameraCalibration> {
    if let Some(option) = args.pictures.conflicting_option() {
        bail!("{option} is for a camera: name one with --camera");
    }
    let bar = crate::cli::progress(args.pictures.quiet, 0);
    let views = views_from_paths(&args.photos, target, response, &mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    let Views { size, views, refused } = views?;
    Ok(calibrate(size, views, refused, options)?)
}

pub fn run(args: &Args) -> Result<()> {
    // Checked before the work starts, so that no files of the user are lost.
    let inputs = Inputs::default().and(&args.photos).and(&pictures_beside(args.photos.iter()));
    let board_file = match &args.board {
        Some(BoardArg::File(file)) => Some(file),
        _ => None,
    };
    let inputs = inputs.and(board_file);
    // Unreadable pictures are listed with the others.
    let (files, mut problems) = unreadable(args.photos.iter());
    if problems.len() == files && files > 0 {
        return Err(problems.swap_remove(0).into());
    }
    inputs.check_file(&args.output)?;
    let target = args.board.as_ref().map(BoardArg::target_choice).transpose()?.unwrap_or_default();
    let (is_there, mut profile) = existing(&args.output)?;
    let mut rig = Rig::default();
    if is_there {
        rig.read(&args.output, &mut Settings::default())?;
        if rig.gives_lens() && !args.force {
            bail!(
                "{}: has a lens already, in [camera] or [camera.distortion]; it is kept (--force replaces it)",
                args.output.display()
            );
        }
    }
    if let Some(picture) = &args.residuals {
        inputs.and([&args.output]).check_file(picture)?;
        photograph::check(picture, args.force)?;
    }
    let board = match target {
        TargetChoice::Chessboard(board) => Some(board),
        _ => None,
    };
    let options = LensOptions { board, square_mm: args.square_mm, model: args.model };
    let response = &rig.camera().response;
    let calibrated = match &args.camera {
        Some(camera) => {
            collect_views(camera, &args.pictures, args.views as usize, (&target, response), options)?.calibrated()?
        }
        None => from_photos(args, &target, response, &options)?,
    };
    let origin = format!("`, from {}.\nOne standard deviation: {}.", calibrated.origin(), calibrated.deviations());
    profile.set_geometry(&calibrated.geometry, &origin);
    write_atomically(&args.output, is_there, |file| file.write_all(profile.to_string().as_bytes()))?;
    if let Some(picture) = &args.residuals {
        photograph::write(picture, &residuals(&calibrated), None, None, args.force)?;
    }
    write!(std::io::stdout().lock(), "{calibrated}")?;
    Ok(())
}
