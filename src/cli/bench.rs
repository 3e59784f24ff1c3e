//! `locard bench`.

use std::io::Write;

use anyhow::Result;

use locard_engine::bench::bench;
use locard_engine::gpu::Gpu;

#[derive(clap::Args)]
pub struct Args {
    /// Size of the picture
    #[arg(long, default_value = "640x480", value_name = "WxH", value_parser = size)]
    size: (u32, u32),
    /// Only rows whose names contain this
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let wrong = || format!("{text} is not a size; expected WxH, 16 to 8192 each, as in 640x480");
    let (w, h) = text.split_once('x').ok_or_else(wrong)?;
    let side = |t: &str| t.parse::<u32>().ok().filter(|v| (16..=8192).contains(v)).ok_or_else(wrong);
    Ok((side(w)?, side(h)?))
}

pub fn run(args: &Args) -> Result<()> {
    let gpu = Gpu::open()?;
    let (width, height) = args.size;
    let rows = bench(&gpu, width, height, args.only.as_deref())?;
    let mut out = std::io::stdout().lock();
    if args.json {
        let report = serde_json::json!({
            "adapter": gpu.info.name, "width": width, "height": height, "rows": rows,
        });
        writeln!(out, "{}", serde_json::to_string_pretty(&report)?)?;
        return Ok(());
    }
    writeln!(
        out,
        "{}, {width}x{height}: median ms from upload to readback, and in full-screen rgba16f copies",
        gpu.info.name
    )?;
    for row in rows {
        writeln!(out, "{:36} {:8.2} ms {:7.2} copies", row.name, row.ms, row.copies)?;
    }
    Ok(())
}
