//! The command line. Data goes to stdout, messages to stderr. Exits with 0, or with 2 and an error
//! message of one line. Effects come from their list and are not named here.

mod analyse;
mod analysis;
mod audit;
mod bench;
mod board;
mod calibrate;
mod clock;
mod composite;
mod doctor;
mod export;
mod farm;
mod inspect;
mod interrupt;
mod join;
mod labels;
mod light;
mod listen;
mod live;
mod meter;
mod open;
mod params;
mod photo;
mod photo_log;
mod pick;
mod place;
mod record;
mod render;
mod room_light;
mod send;
#[cfg(feature = "sign")]
mod sign;
mod simulate;
mod site;
mod solve;
mod start;
mod track;
#[cfg(feature = "window")]
mod tune;
mod verify;
mod watching;
mod which;

use std::io::{IsTerminal, Write};
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue};
use clap::{Parser, Subcommand};

use locard_engine::cleanup::undo_all;
use locard_engine::export::ExportError;
use locard_engine::sink::SinkError;
use locard_engine::text::{reason, shown};

#[cfg(not(feature = "window"))]
const WITHOUT_WINDOW: &str = "this program was built without its window: `cargo build --release` builds it with one";

#[cfg(not(feature = "sign"))]
const WITHOUT_SIGNING: &str =
    "this program was built without signing: `cargo build --release --features sign` builds it with it";

#[derive(Parser)]
#[command(name = "locard", version, about = "Puts virtual evidence into real footage so that it looks photographed there", long_about = None)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Put a scene into a recording
    Composite(composite::Args),
    /// Estimate the camera's true poses, clock offsets and the brightness of each frame from a
    /// recording's own pictures
    Analyse(analyse::Args),
    /// Write the estimated room light of an analysed recording as a scene's [light], to edit
    Light(room_light::Args),
    /// Recompute an output and compare it with its record: inputs, files, frames
    Audit(audit::Args),
    /// Measure a camera from pictures
    Calibrate(calibrate::Args),
    /// Write the camera, its lens and the evidence for other programs
    Export(export::Args),
    /// Composite a recording on many machines: files for Open Job Description, Slurm, GNU parallel
    /// and Dask
    Farm(farm::Args),
    /// Join parts of an output that were composited separately
    Join(join::Args),
    /// Describe a recording, a scene, a profile or a stream of poses, and report problems in it
    Inspect(inspect::Args),
    /// Put a scene into a camera's pictures as they come
    Live(live::Args),
    /// Report how bright a frame's scene is and which settings would expose it correctly
    Meter(meter::Args),
    /// Photograph a frame with its evidence: aperture, shutter, film speed, lens and focus as on a
    /// camera
    Photo(photo::Args),
    /// Write the log of a series of photographs, with checks of each and of the series
    PhotoLog(photo_log::Args),
    /// Make a case card, the first frame of a series of photographs
    CaseCard(photo_log::CardArgs),
    /// Put a piece of evidence on the surface at a pixel of a frame
    Place(place::Args),
    /// Put a scan of the place into a scene: depth for a recording without a depth sensor
    Site(site::Args),
    /// Record a camera, with poses
    Record(record::Args),
    /// Render a scene alone, through any camera
    Render(render::Args),
    /// Send a recording's poses as a stream: OpenTrackIO or FreeD
    Send(send::Args),
    /// Sign an output and its record (C2PA), or check signatures
    #[cfg(feature = "sign")]
    Sign(sign::Args),
    /// Sign an output and its record (C2PA), or check signatures: needs a build with it
    #[cfg(not(feature = "sign"))]
    #[command(disable_help_flag = true)]
    Sign {
        #[arg(hide = true, allow_hyphen_values = true, trailing_var_arg = true)]
        _arguments: Vec<std::ffi::OsString>,
    },
    /// Make a printable sheet of tags, by which `track` finds a camera's poses
    Board(board::Args),
    /// Find the camera's path and lens from a video or photographs alone, and make a recording;
    /// needs the program `colmap`
    Solve(solve::Args),
    /// Track a camera through a video that shows printed tags, and make a recording with poses
    Track(track::Args),
    /// List every parameter: unit, range, default, help
    Params(params::Args),
    /// Report installed and missing components of this machine, with advice
    #[command(after_help = doctor::HELP)]
    Doctor,
    /// Measure the cost of each effect on this machine
    Bench(bench::Args),
    /// Make a recording of a simulated site, together with its ground truth
    Simulate(simulate::Args),
    /// Put frames of a recording into others as objects, and report their deviation from the real
    /// ones
    Verify(verify::Args),
    /// Open the window: see the evidence in the picture and move sliders until it belongs there
    #[cfg(feature = "window")]
    Tune(tune::Args),
    /// Open the window: needs a build with it
    #[cfg(not(feature = "window"))]
    #[command(disable_help_flag = true)]
    Tune {
        #[arg(hide = true, allow_hyphen_values = true, trailing_var_arg = true)]
        _arguments: Vec<std::ffi::OsString>,
    },
}

/// Runs the program with the process' arguments.
pub fn main() -> ExitCode {
    start::without_device_selection();
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            print(&error);
            return if error.use_stderr() { ExitCode::from(2) } else { ExitCode::SUCCESS };
        }
    };
    let done = interrupt::install_handlers().and_then(|()| match cli.command {
        Command::Composite(args) => composite::run(args),
        Command::Analyse(args) => analyse::run(&args),
        Command::Light(args) => room_light::run(&args),
        Command::Audit(args) => audit::run(&args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Export(args) => export::run(&args),
        Command::Farm(args) => farm::run(&args),
        Command::Join(args) => join::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Live(args) => live::run(&args),
        Command::Meter(args) => meter::run(&args),
        Command::Photo(args) => photo::run(&args),
        Command::PhotoLog(args) => photo_log::run(&args),
        Command::CaseCard(args) => photo_log::run_card(&args),
        Command::Place(args) => place::run(&args),
        Command::Site(args) => site::run(&args),
        Command::Record(args) => record::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Send(args) => send::run(&args),
        #[cfg(feature = "sign")]
        Command::Sign(args) => sign::run(&args),
        #[cfg(not(feature = "sign"))]
        Command::Sign { .. } => Err(anyhow::anyhow!(WITHOUT_SIGNING)),
        Command::Board(args) => board::run(&args),
        Command::Solve(args) => solve::run(&args),
        Command::Track(args) => track::run(&args),
        Command::Params(args) => params::run(&args),
        Command::Doctor => doctor::run(),
        Command::Bench(args) => bench::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Verify(args) => verify::run(&args),
        #[cfg(feature = "window")]
        Command::Tune(args) => tune::run(args),
        #[cfg(not(feature = "window"))]
        Command::Tune { .. } => Err(anyhow::anyhow!(WITHOUT_WINDOW)),
    });
    // Blocks if an interrupt already ends the program, to avoid a second message.
    drop(undo_all());
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_closed_stdout(&error) => ExitCode::SUCCESS,
        Err(error) => {
            print_message(&message(&error));
            ExitCode::from(FAILED)
        }
    }
}

/// Prints help, or clap's message about invalid arguments. The message quotes arguments, so it is
/// made from arguments that are escaped for a terminal. A closed pipe is not an error.
fn print(error: &clap::Error) {
    let safe = std::env::args_os().map(|argument| shown(&argument.to_string_lossy()));
    match Cli::try_parse_from(safe).err().filter(|of_safe| of_safe.kind() == error.kind()) {
        Some(mut error) => {
            // clap's advice to escape an unknown option as a value: there are no such values.
            let is_escape = |value: &ContextValue| value.to_string().contains("as a value");
            if error.get(ContextKind::Suggested).is_some_and(is_escape) {
                error.remove(ContextKind::Suggested);
            }
            _ = error.print();
        }
        // An escaped argument is parsed differently.
        None => print_message(without_advice(&error.to_string())),
    }
}

/// clap's message without its title and the advice in further lines. Lines of a quoted argument
/// stay.
fn without_advice(text: &str) -> &str {
    let end = text.rfind("\n\nFor more information");
    text[..end.unwrap_or(text.len())].trim_start_matches("error: ").trim_end()
}

const FAILED: u8 = 2;

/// True if the reader of stdout closed it (`locard params | head`). Any other closed pipe is an
/// error.
fn is_closed_stdout(error: &anyhow::Error) -> bool {
    let bare = error.downcast_ref::<std::io::Error>();
    let of_sink = error.downcast_ref::<SinkError>().and_then(|error| match error {
        SinkError::Stdout { source } => Some(source),
        _ => None,
    });
    bare.or(of_sink).is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe)
}

/// Converts an export's error. Errors of its files stay recognizable, for [`is_closed_stdout`].
fn export_error(error: ExportError) -> anyhow::Error {
    match error {
        ExportError::Sink(error) => error.into(),
        error => error.into(),
    }
}

/// An error and its causes on one line. Causes that are quoted by the text before them are left
/// out. A bare I/O error comes from standard output.
fn message(error: &anyhow::Error) -> String {
    if let Some(error) = error.chain().next().and_then(|error| error.downcast_ref::<std::io::Error>()) {
        return format!("standard output: cannot be written: {}", reason(error));
    }
    error.chain().fold(String::new(), |text, cause| {
        // Also if it is quoted as the text of `reason`.
        let of_system = cause.downcast_ref::<std::io::Error>();
        let cause = cause.to_string();
        if text.is_empty() {
            cause
        } else if text.contains(&cause) || of_system.is_some_and(|error| text.contains(&reason(error))) {
            text
        } else {
            format!("{text}: {cause}")
        }
    })
}

/// Prints a line of a result on stdout.
fn print_line(text: &str) -> anyhow::Result<()> {
    Ok(writeln!(std::io::stdout(), "{}", shown(text))?)
}

/// Largest number of lines of a list.
const MAX_LISTED: usize = 10;

/// Prints the first lines of a list, indented, and the number of the others.
fn print_list(lines: &[impl std::fmt::Display]) -> anyhow::Result<()> {
    lines.iter().take(MAX_LISTED).try_for_each(|line| print_line(&format!("  {line}")))?;
    if lines.len() > MAX_LISTED {
        print_line(&format!("  and {} more", lines.len() - MAX_LISTED))?;
    }
    Ok(())
}

/// Prints a line on stderr. A closed stderr is not an error.
fn print_message(text: &str) {
    let _ = writeln!(std::io::stderr(), "locard: {}", shown(text));
}

/// The number of a frame, as an option's value.
fn frame_number(text: &str) -> Result<usize, String> {
    text.trim().parse().map_err(|_| "expected the number of a frame, from 0 on".to_owned())
}

/// Checks that a recording has a frame.
fn check_frame(frame: usize, count: usize) -> anyhow::Result<()> {
    match count.checked_sub(1) {
        Some(last) if frame > last => {
            anyhow::bail!(
                "--frame {frame}: the recording has {}, numbered 0 to {last}",
                locard_engine::text::count(count, "frame")
            )
        }
        None => anyhow::bail!("--frame {frame}: the recording has no frames"),
        _ => Ok(()),
    }
}

/// A line on stderr that is not an error.
fn warn(quiet: bool, text: &str) {
    if !quiet {
        print_message(text);
    }
}

/// True if stderr is a terminal, not a pipe.
fn is_interactive(quiet: bool) -> bool {
    !quiet && std::io::stderr().is_terminal()
}

/// Prints a closing line if stderr is a terminal.
fn print_status(quiet: bool, text: &str) {
    if is_interactive(quiet) {
        print_message(text);
    }
}

/// A progress bar over frames on a terminal, nothing in a pipe.
fn progress(quiet: bool, length: usize) -> indicatif::ProgressBar {
    progress_of(quiet, length, "{wide_bar} {pos}/{len} frames, {per_sec}, {eta} left")
}

/// A progress bar by an indicatif template.
fn progress_of(quiet: bool, length: usize, template: &str) -> indicatif::ProgressBar {
    if !is_interactive(quiet) {
        return indicatif::ProgressBar::hidden();
    }
    let style = indicatif::ProgressStyle::with_template(template);
    let bar = indicatif::ProgressBar::new(length as u64);
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

#[cfg(test)]
mod tests {
    use anyhow::Context;

    #[test]
    fn message_of_clap_keeps_the_quoted_argument_alone() {
        let text = "error: invalid value 'two\n\nlines' for '--mark'\n\nFor more information, try '--help'.\n";
        assert_eq!(super::without_advice(text), "invalid value 'two\n\nlines' for '--mark'");
        assert_eq!(super::without_advice("odd\n"), "odd");
    }

    #[test]
    fn message_quotes_each_cause_once() {
        let quoting = anyhow::anyhow!("disk full").context("a.png: cannot be written: disk full");
        assert_eq!(super::message(&quoting), "a.png: cannot be written: disk full");
        let adding = Err::<(), _>(anyhow::anyhow!("no pose")).context("frame 3").unwrap_err();
        assert_eq!(super::message(&adding), "frame 3: no pose");
        let named = Err::<(), _>(std::io::Error::other("odd")).context("p.toml: cannot be read").unwrap_err();
        assert_eq!(super::message(&named), "p.toml: cannot be read: odd");
        let gone = || std::io::Error::from_raw_os_error(2);
        let text = format!("p.toml: cannot be read: {}", super::reason(&gone()));
        let error = Err::<(), _>(gone()).context(text.clone()).unwrap_err();
        assert_eq!(super::message(&error), text);
        let bare = anyhow::Error::from(std::io::Error::from(std::io::ErrorKind::StorageFull));
        assert!(super::message(&bare).starts_with("standard output: cannot be written: the disk is full"));
    }
}
