//! `locard board`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Result, bail};

use super::print_status;
use locard_engine::params::{Field, Value};
use locard_engine::sink;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};
use locard_engine::tags::{Board, Family, Paper, Sheet, pdf, png};
use locard_engine::text::count;

#[derive(clap::Args)]
pub struct Args {
    /// The sheet to write (.pdf, or .png at 300 dots per inch); the board's file (.toml) is written
    /// beside it. With --charuco the board's file alone
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    output: PathBuf,
    /// The paper: a4 or letter
    #[arg(long, default_value = "a4", value_parser = paper)]
    paper: Paper,
    /// Describe a printed ChArUco board (OpenCV) of this many columns and rows of squares
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = squares, requires_all = ["square_mm", "tag_mm"])]
    charuco: Option<[u32; 2]>,
    /// Dictionary of its tags
    #[arg(long, default_value = "4x4_50", value_parser = family, requires = "charuco")]
    family: Family,
    /// Side of its squares, mm
    #[arg(long, value_name = "MM", requires = "charuco")]
    square_mm: Option<f64>,
    /// Side of its tags, mm
    #[arg(long, value_name = "MM", requires = "charuco")]
    tag_mm: Option<f64>,
    /// The board is of before OpenCV 4.6: with an even number of rows its upper left square is
    /// white
    #[arg(long, requires = "charuco")]
    legacy: bool,
    /// Replace existing files
    #[arg(long)]
    force: bool,
    /// No closing line
    #[arg(long, short)]
    quiet: bool,
}

fn paper(text: &str) -> Result<Paper, String> {
    let named = Paper::from_value(&Value::Text(text.to_ascii_lowercase()), &Paper::kind(None));
    named.ok_or_else(|| "expected a4 or letter".to_owned())
}

fn squares(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once('x').and_then(|(columns, rows)| Some([columns.parse().ok()?, rows.parse().ok()?]));
    sides.ok_or_else(|| "expected columns and rows of squares, as in 5x7".to_owned())
}

fn family(text: &str) -> Result<Family, String> {
    Family::of_name(text).ok_or_else(|| format!("expected one of {}", Family::names().join(", ")))
}

/// Writes the file of a printed board.
fn describe_charuco(args: &Args, squares: [u32; 2]) -> Result<()> {
    if args.output.extension().is_none_or(|extension| extension != "toml") {
        bail!("{}: the file of a ChArUco board is a .toml", args.output.display());
    }
    let metres = |mm: Option<f64>| mm.unwrap_or_default() / 1e3;
    let board = Board::charuco(args.family, squares, metres(args.square_mm), metres(args.tag_mm), args.legacy)
        .map_err(|problem| anyhow::anyhow!("--charuco: {problem}"))?;
    sink::check_file(&args.output, args.force)?;
    write_atomically(&args.output, args.force, |out| out.write_all(board.to_string().as_bytes()))?;
    let message = format!("{}: {}", args.output.display(), count(board.tags.len(), "tag"));
    print_status(args.quiet, &message);
    Ok(())
}

pub fn run(args: &Args) -> Result<()> {
    if let Some(squares) = args.charuco {
        return describe_charuco(args, squares);
    }
    let sheet = Sheet::new(args.paper);
    let ending = args.output.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let bytes = match ending.as_str() {
        "pdf" => pdf(&sheet),
        "png" => png(&sheet)?,
        _ => bail!(
            "{}: a sheet is written as .pdf or .png (a .toml describes a board with --charuco)",
            args.output.display()
        ),
    };
    let board = args.output.with_extension("toml");
    let text = sheet.board.to_string();
    // Either both files are written or none.
    sink::check_file(&args.output, args.force)?;
    // The same board may be printed on another paper.
    let same = file::read_text(&board, MAX_DOCUMENT_BYTES).is_ok_and(|there| there == text);
    if !same {
        sink::check_file(&board, args.force)?;
    }
    write_atomically(&args.output, args.force, |out| out.write_all(&bytes))?;
    if !same {
        write_atomically(&board, args.force, |out| out.write_all(text.as_bytes()))?;
    }
    let message = format!("{} and {}: print at 100 %, then measure the ruler", args.output.display(), board.display());
    print_status(args.quiet, &message);
    Ok(())
}
