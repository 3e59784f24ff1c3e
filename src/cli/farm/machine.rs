//! Requirements of a plan on a machine: the same program, and an adapter of the right kind.

use anyhow::{Result, bail};
use clap::builder::PossibleValuesParser;

use locard_engine::farm::ADAPTER_KINDS;
use locard_engine::gpu::Gpu;
use locard_engine::provenance::{DeviceRecord, ProgramRecord};
use locard_engine::text::quoted;

/// Requirements on a machine.
#[derive(clap::Args)]
pub struct MachineArgs {
    /// SHA-256 of the program that all machines must have
    #[arg(long, value_name = "SHA256")]
    pub build: String,
    /// Kind of adapter that all machines must have, as in DiscreteGpu; without it any
    #[arg(long, value_name = "KIND", value_parser = PossibleValuesParser::new(ADAPTER_KINDS))]
    pub adapter_kind: Option<String>,
}

impl MachineArgs {
    /// Checks the program; returns its build.
    pub fn check_build(&self) -> Result<String> {
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

    pub fn check_adapter(&self) -> Result<()> {
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
pub fn adapter_kind(gpu: &Gpu) -> String {
    DeviceRecord::of(&gpu.info).kind
}
