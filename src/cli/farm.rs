//! `locard farm`.

mod part;
mod plan;

use anyhow::{Result, bail};
use clap::builder::PossibleValuesParser;

use locard_engine::farm::ADAPTER_KINDS;
use locard_engine::gpu::Gpu;
use locard_engine::provenance::{DeviceRecord, ProgramRecord};
use locard_engine::text::quoted;

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    task: FarmTask,
}

#[derive(clap::Subcommand)]
enum FarmTask {
    /// Write a folder of files that composite a recording in parts, on many machines
    Template(plan::TemplateArgs),
    /// Composite one part, unless it is there and complete; called by the templates' tasks
    Part(part::PartArgs),
    /// Check that this machine fits a plan; called by the templates' tasks
    Check(MachineArgs),
}

/// Requirements on a machine.
#[derive(clap::Args)]
struct MachineArgs {
    /// SHA-256 of the program that all machines must have
    #[arg(long, value_name = "SHA256")]
    build: String,
    /// Kind of adapter that all machines must have, as in DiscreteGpu; without it any
    #[arg(long, value_name = "KIND", value_parser = PossibleValuesParser::new(ADAPTER_KINDS))]
    adapter_kind: Option<String>,
}

impl MachineArgs {
    /// Checks the program; returns its build.
    fn check_build(&self) -> Result<String> {
        let build = ProgramRecord::current().build;
        if build != self.build {
            bail!(
                "this machine has another build of the program: SHA-256 {build}, expected {}; install that build here, or \
                 write the plan again with this one (`locard farm template`)",
                quoted(&self.build)
            );
        }
        Ok(build)
    }

    fn check_adapter(&self) -> Result<()> {
        let gpu = Gpu::open()?;
        let kind = adapter_kind(&gpu);
        match &self.adapter_kind {
            Some(expected) if *expected != kind => bail!(
                "this machine's adapter {} is of the kind {kind}, expected {}; leave this machine out, or write the plan \
                 again with --adapter-kind {kind}",
                quoted(&gpu.info.name),
                quoted(expected)
            ),
            _ => Ok(()),
        }
    }
}

/// Kind of an adapter, as records name it: `DiscreteGpu`, `IntegratedGpu`, `Cpu` and so on.
fn adapter_kind(gpu: &Gpu) -> String {
    DeviceRecord::of(&gpu.info).kind
}

pub fn run(args: &Args) -> Result<()> {
    match &args.task {
        FarmTask::Template(args) => plan::run(args),
        FarmTask::Part(args) => part::run(args),
        FarmTask::Check(args) => {
            args.check_build()?;
            args.check_adapter()
        }
    }
}
