//! `locard doctor`.

use std::io::Write;

use anyhow::{Result, bail};

use crate::gpu::{Gpu, adapters};
use crate::source::ffmpeg;

/// How to control the choice of an adapter.
pub const HELP: &str = "\
Environment variables:
  WGPU_ADAPTER_NAME=TEXT  use the first adapter whose name contains TEXT
  WGPU_BACKEND=NAME       look at this kind of driver only: vulkan, metal, dx12
  VK_DRIVER_FILES=FILE    use this Vulkan driver (its .json; VK_ICD_FILENAMES for older loaders)";

pub fn run() -> Result<()> {
    let mut out = std::io::stdout().lock();
    let mut missing = 0;
    let found = adapters();
    for a in &found {
        let kind = if a.software { "software" } else { "hardware" };
        writeln!(out, "adapter   {} ({}, {kind}; {})", a.name, a.backend, a.driver)?;
    }
    match Gpu::open() {
        Ok(gpu) => {
            let timing = if gpu.timestamps { "with" } else { "without" };
            writeln!(
                out,
                "in use    {}, pictures up to {} px a side, {timing} pass timing",
                gpu.info.name,
                gpu.max_side_px()
            )?;
        }
        Err(error) => {
            missing += 1;
            writeln!(out, "missing   {error}")?;
        }
    }
    match ffmpeg::version() {
        Ok(version) => writeln!(out, "ffmpeg    {version}")?,
        Err(error) => {
            missing += 1;
            writeln!(out, "missing   {error}")?;
        }
    }
    if missing > 0 {
        bail!("something is missing, see above");
    }
    Ok(())
}
