//! `locard doctor`.

use std::collections::BTreeSet;
use std::io::Write;

use anyhow::{Result, bail};

use locard_engine::gpu::{Gpu, adapters};
use locard_engine::sfm;
use locard_engine::source::{developed, ffmpeg};
use locard_engine::text::count;
use locard_engine::webcam::{self, CameraError, CameraListing, DriverName};

/// How to control the choice of an adapter.
pub const HELP: &str = "\
Environment variables:
  WGPU_ADAPTER_NAME=TEXT  use the first adapter whose name contains TEXT
  WGPU_BACKEND=NAME       look at this kind of driver only: vulkan, metal, dx12
  VK_DRIVER_FILES=FILE    use this Vulkan driver (its .json; VK_ICD_FILENAMES for older loaders)";

pub fn run() -> Result<()> {
    let mut out = std::io::stdout().lock();
    let mut missing = 0;
    let all_adapters = adapters();
    for a in &all_adapters {
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
    // Only `solve` needs it.
    match sfm::version() {
        Ok(version) => writeln!(out, "colmap    {version}")?,
        Err(error) => writeln!(out, "colmap    {error}")?,
    }
    for (formats, decoder) in developed::decoders() {
        match decoder {
            Ok(program) => writeln!(out, "pictures  {program} ({formats})")?,
            Err(error) => writeln!(out, "pictures  {error}")?,
        }
    }
    cameras(&mut out)?;
    if missing > 0 {
        let (components, are) = (count(missing, "required component"), if missing == 1 { "is" } else { "are" });
        bail!("{components} {are} missing (marked `missing` above)");
    }
    Ok(())
}

/// Prints each driver's cameras with their modes, or the error that opening gave. A machine without
/// cameras is not reported as a problem.
fn cameras(out: &mut impl Write) -> Result<()> {
    let drivers = webcam::cameras();
    if drivers.is_empty() {
        writeln!(out, "camera    {}", CameraError::NotBuilt)?;
    }
    let has_none = |(_, cameras): &(DriverName, Result<Vec<CameraListing>, CameraError>)| {
        cameras.as_ref().is_ok_and(Vec::is_empty)
    };
    if !drivers.is_empty() && drivers.iter().all(has_none) {
        writeln!(out, "camera    none takes pictures (plug one in; a video may stand in for one)")?;
    }
    for (driver, cameras) in drivers {
        match cameras {
            Ok(cameras) => cameras.iter().try_for_each(|camera| listed(out, camera))?,
            Err(error) => writeln!(out, "camera    driver {driver}: {error}")?,
        }
    }
    Ok(())
}

fn listed(out: &mut impl Write, camera: &CameraListing) -> Result<()> {
    let CameraListing { driver, number, name, place, modes } = camera;
    writeln!(out, "camera    {number} {name} ({place}; driver {driver})")?;
    match modes {
        Ok(modes) => {
            modes.iter().filter(|mode| mode.layout.is_some()).try_for_each(|mode| writeln!(out, "          {mode}"))?;
            let other: BTreeSet<&str> =
                modes.iter().filter(|mode| mode.layout.is_none()).map(|mode| mode.code.as_str()).collect();
            if !other.is_empty() {
                let other: Vec<&str> = other.into_iter().collect();
                writeln!(out, "          not read here: {}", other.join(", "))?;
            }
        }
        Err(problem) => writeln!(out, "          {problem}")?,
    }
    Ok(())
}
