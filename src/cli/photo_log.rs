//! `locard photo-log` and `locard case-card`.

use std::io::Write;
use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Result, anyhow};

use super::{print_status, warn};
use locard_engine::label::SourceLabel;
use locard_engine::photo::log::{Finding, PhotoLog, csv, html, log_files, photographs};
use locard_engine::photo::{CaseCard, Particulars, PhotoContent, next_number, record_path, write_record};
use locard_engine::provenance::{InputDigests, WorkRecord};
use locard_engine::sink::atomic::write_atomically;
use locard_engine::sink::{SinkError, check_file, photograph};
use locard_engine::text::{count, shown};

#[derive(clap::Args)]
pub struct Args {
    /// Folders with photographs of `locard photo`, or the photographs themselves
    #[arg(required = true, value_name = "FOLDER|FILE")]
    pub photographs: Vec<PathBuf>,
    /// Name of the log: NAME.csv and NAME.html, which a browser prints
    #[arg(short = 'o', long = "output", value_name = "NAME")]
    pub output: PathBuf,
    /// Replace files that exist
    #[arg(long)]
    pub force: bool,
    /// No list of faults
    #[arg(long, short)]
    pub quiet: bool,
}

#[derive(clap::Args)]
pub struct CardArgs {
    /// A TOML file with case_number, date, place, photographer, and optionally camera and remarks
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    /// A .jpg or .png
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    pub output: PathBuf,
    /// The number in the photo log; by default that of the replaced card, or the next one in the
    /// folder
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub number: Option<u32>,
    /// Replace a picture that exists
    #[arg(long)]
    pub force: bool,
    /// No messages
    #[arg(long, short)]
    pub quiet: bool,
}

/// Writes the log, and prints the faults: first those of the series.
pub fn run(args: &Args) -> Result<()> {
    let files = log_files(&args.output);
    files.iter().try_for_each(|file| check_file(file, args.force))?;
    let log = PhotoLog::read(&photographs(&args.photographs).map_err(|problem| anyhow!(problem))?);
    let page = html(&log).map_err(|problem| anyhow!(problem))?;
    for (file, text) in files.iter().zip([csv(&log.entries), page]) {
        write_atomically(file, args.force, |out| out.write_all(text.as_bytes()))?;
    }
    let print = |of: &str, findings: &[Finding]| {
        findings.iter().for_each(|finding| warn(args.quiet, &format!("{of}{}: {}", finding.fault, finding.remedy)));
    };
    print("series: ", &log.findings);
    log.items.iter().for_each(|item| print("series: ", &item.findings));
    for entry in &log.entries {
        let number = entry.number().map_or_else(String::new, |number| format!("{number}, "));
        print(&format!("{number}{}: ", shown(&entry.name())), &entry.findings);
    }
    let counts = format!("{}, {}", count(log.entries.len(), "photograph"), count(log.finding_count(), "fault"));
    print_status(args.quiet, &format!("{}: {counts}", files[1].display()));
    Ok(())
}

/// Writes a case card and its record.
pub fn run_card(args: &CardArgs) -> Result<()> {
    let card = CaseCard::read(&args.case).map_err(|problem| anyhow!(problem))?;
    photograph::check(&args.output, args.force)?;
    check_file(&record_path(&args.output), true)?;
    let number = args.number.unwrap_or_else(|| next_number(&args.output));
    let now_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64());
    photograph::write(&args.output, &card.picture(), None, Some(&SourceLabel::case_card()), args.force)?;
    let taken = photograph::log_date_time(now_s);
    let inputs = InputDigests::start(vec![("card", args.case.clone())]).finish();
    let inputs = inputs.map_err(|(path, source)| SinkError::Read { path, source })?;
    let particulars = Particulars { number, taken, content: PhotoContent::Card(card) };
    write_record(&args.output, &particulars, WorkRecord::without_shot(inputs))?;
    print_status(args.quiet, &format!("{} and {}", args.output.display(), record_path(&args.output).display()));
    Ok(())
}
