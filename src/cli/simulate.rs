//! `locard simulate`.

use std::io::Write;
use std::ops::ControlFlow;
use std::path::PathBuf;

use anyhow::{Result, bail};
use glam::DVec3;

use super::{print_status, progress};
use locard_engine::params::{Params, Value};
use locard_engine::scene;
use locard_engine::simulate::{self, Flaws, Options, Simulation};
use locard_engine::text::{count, shown_unit};

#[derive(clap::Args)]
pub struct Args {
    /// The folder of the recording
    #[arg(short = 'o', long = "output", value_name = "DIR", required_unless_present = "list")]
    output: Option<PathBuf>,
    /// Set an option, as in --set frames=30 or --set flaws.jitter_mm=1; without any, the demo is
    /// made
    #[arg(long = "set", value_name = "NAME=VALUE")]
    sets: Vec<String>,
    /// Real objects in the site: a scene file (z up, metres, the floor at 0); its light is not used
    #[arg(long, value_name = "SCENE")]
    evidence: Option<PathBuf>,
    /// List the options
    #[arg(long)]
    list: bool,
    /// Replace a simulated recording that exists
    #[arg(long)]
    force: bool,
    /// No progress bar
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(args: &Args) -> Result<()> {
    let (mut options, mut flaws) = (Options::default(), Flaws::default());
    if args.list {
        let mut out = std::io::stdout().lock();
        let tables: [(&dyn Params, &str); 2] = [(&options, ""), (&flaws, "flaws.")];
        for (table, before) in tables {
            for s in table.specs() {
                let unit = shown_unit(s.unit);
                writeln!(out, "{before}{} = {}{unit}    ({})\n      {}", s.name, s.default, s.kind, s.help)?;
            }
        }
        return Ok(());
    }
    for set in &args.sets {
        let Some((name, value)) = set.split_once('=') else { bail!("--set {set}: expected name=value") };
        let (name, value) = (name.trim(), Value::parse(value));
        match name.strip_prefix("flaws.") {
            Some(name) => flaws.set(name, &value)?,
            None => options.set(name.trim_start_matches("simulate."), &value)?,
        }
    }
    let Some(output) = &args.output else { bail!("-o DIR is missing") };
    let bar = progress(args.quiet, options.frames as usize);
    let evidence = args.evidence.as_ref().map(|path| scene::load(path, Some(DVec3::Z))).transpose()?;
    let made = || match &evidence {
        Some(scene) => Simulation::with_flaws(&options, &flaws)?.with_evidence(scene),
        None => Simulation::with_flaws(&options, &flaws),
    };
    let done = simulate::write(output, args.force, made, &mut |done, _| {
        bar.set_position(done as u64);
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    done?;
    print_status(args.quiet, &format!("{}: {}", count(options.frames as usize, "frame"), output.display()));
    Ok(())
}
