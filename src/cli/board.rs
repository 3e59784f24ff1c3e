//! `locard board`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Result, bail};

use super::print_status;
use locard_engine::params::{Field, Value};
use locard_engine::sink;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};
use locard_engine::tags::{Paper, Sheet, pdf, png};

#[derive(clap::Args)]
pub struct Args {
    /// The sheet to write (.pdf, or .png at 300 dots per inch); the board's file (.toml) is written
    /// beside it
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    output: PathBuf,
    /// The paper: a4 or letter
    #[arg(long, default_value = "a4", value_parser = paper)]
    paper: Paper,
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

pub fn run(args: &Args) -> Result<()> {
    let sheet = Sheet::new(args.paper);
    let ending = args.output.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let bytes = match ending.as_str() {
        "pdf" => pdf(&sheet),
        "png" => png(&sheet)?,
        _ => bail!("{}: a sheet is written as .pdf or .png", args.output.display()),
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
